"""Spatial parameters: the autocorrelation against loops, known fields and waves, missing pixels, no answer."""

import jax.numpy as jnp
import numpy as np
import pytest

from tsplinejax import InputError
from tsplinejax.areal import SpatialParameters, spatial_parameters
from tsplinejax.areal._autocorrelation import autocorrelation
from tsplinejax.areal._measured import measured


def numbers(*arguments, **options) -> SpatialParameters:
    """Sal, Str and Std as plain numbers."""
    return SpatialParameters(*map(float, spatial_parameters(*arguments, **options)))


def waves(direction: float, length: float, shape=(300, 400), spacing=(0.5, 0.8)) -> np.ndarray:
    """A sine whose crests follow each other in a direction, in degrees from x towards y."""
    x, y = spacing[0] * np.arange(shape[1]), spacing[1] * np.arange(shape[0])[:, None]
    angle = np.radians(direction)
    return np.sin(2 * np.pi * (np.cos(angle) * x + np.sin(angle) * y) / length)


def field(lengths: tuple[float, float], shape=(800, 900), seed=0) -> np.ndarray:
    """A Gaussian field whose autocorrelation is exp(-x² / 2 a² - y² / 2 b²), (a, b) in pixels."""
    size = (shape[0] + 300, shape[1] + 300)
    rows, columns = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])
    response = np.exp(-((np.pi * lengths[0] * columns) ** 2) - (np.pi * lengths[1] * rows) ** 2)
    noise = np.random.default_rng(seed).normal(size=size)
    return np.fft.irfft2(np.fft.rfft2(noise) * response, s=size)[: shape[0], : shape[1]]


def by_loops(heights: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """The definition: the weighted mean product over all pairs a lag apart, over the mean square."""
    weights = np.where(np.isnan(heights), 0, weights)
    filled = np.where(np.isnan(heights), 0, heights)
    z = filled - (weights * filled).sum() / weights.sum()
    rows, columns = heights.shape
    down, right = rows // 2, columns // 2
    result = np.full((2 * down + 1, 2 * right + 1), np.nan)
    for i in range(-down, down + 1):
        for j in range(-right, right + 1):
            here = slice(max(i, 0), rows + min(i, 0)), slice(max(j, 0), columns + min(j, 0))
            there = slice(max(-i, 0), rows + min(-i, 0)), slice(max(-j, 0), columns + min(-j, 0))
            pairs = weights[here] * weights[there]
            if pairs.sum() > 0.05 * (weights**2).sum():
                result[down + i, right + j] = (pairs * z[here] * z[there]).sum() / pairs.sum()
    return result / ((weights * z**2).sum() / weights.sum())


@pytest.mark.parametrize("shape", [(7, 10), (12, 9), (1, 8)])
@pytest.mark.parametrize("hidden", [0.0, 0.3, 0.85])
def test_autocorrelation_against_loops(shape, hidden):
    """By Fourier transforms and by the definition: the same, with missing pixels and weights."""
    generator = np.random.default_rng(4)
    heights = generator.normal(size=shape) + 5
    heights[generator.random(shape) < hidden] = np.nan
    heights[0, 0] = 1.0
    weights = generator.random(shape) + 0.5
    weights /= weights[~np.isnan(heights)].max()
    found = np.asarray(autocorrelation(measured(jnp.asarray(heights), jnp.asarray(weights))))
    np.testing.assert_allclose(found, by_loops(heights, weights), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found, found[::-1, ::-1], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("direction", [0, 17, 45, 90, 130])
def test_waves(direction):
    """A sine of wavelength λ: Sal = λ arccos(0.2) / 2π across the lay, no Str along it, Std is the lay's direction.

    Parts of a wave at the map's border change the autocorrelation by up to 1 / (k L) if the waves run along an axis.
    """
    found = numbers(waves(direction, 8.0), (0.5, 0.8))
    k, phase, extent = 2 * np.pi / 8, np.arccos(0.2), 200
    border = 1 / (k * extent) / (phase * np.sin(phase)) if direction in (0, 90) else 0
    assert found.Sal == pytest.approx(phase / k, rel=border + 2e-4)
    assert np.isnan(found.Str)
    assert (found.Std - direction - 90 + 90) % 180 - 90 == pytest.approx(0, abs=0.5)


@pytest.mark.parametrize("threshold", [0.2, 0.5])
def test_isotropic_field(threshold):
    """Autocorrelation exp(-r² / 2 ℓ²): Sal = ℓ √(2 ln 1/s), within what one field of 800 × 900 pixels scatters."""
    found = numbers(field((6.0, 6.0)), (0.25, 0.25), threshold=threshold)
    assert found.Sal == pytest.approx(1.5 * np.sqrt(-2 * np.log(threshold)), rel=0.03)
    assert found.Str > 0.9


def test_anisotropic_field():
    """Correlation lengths of 5 and 20 pixels: Str is their ratio, the lay runs along the longer one."""
    found = numbers(field((5.0, 20.0)), (1.0, 1.0))
    assert found.Sal == pytest.approx(5 * np.sqrt(2 * np.log(5)), rel=0.04)
    assert found.Str == pytest.approx(0.25, rel=0.15)
    assert found.Std == pytest.approx(90, abs=3)


def test_spacing_is_physical():
    """An isotropic surface on pixels of 3 × 1: the same lengths as on square ones."""
    square = field((8.0, 8.0))
    plain, stretched = numbers(square, (0.4, 0.4)), numbers(square[:, ::3], (1.2, 0.4))
    assert stretched.Sal == pytest.approx(plain.Sal, rel=0.01)
    assert stretched.Str == pytest.approx(plain.Str, abs=0.03)


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_direction_with_noise_and_gaps(noise):
    """The lay is found to one degree under noise as high as the waves, with a fifth of the pixels missing."""
    generator = np.random.default_rng(2)
    heights = waves(33, 13.0) + noise * generator.normal(size=(300, 400))
    heights[generator.random(heights.shape) < 0.2] = np.nan
    assert numbers(heights, (0.5, 0.8)).Std == pytest.approx(123, abs=1)


def test_missing_at_random():
    """A fifth of the pixels missing at random leaves Sal and Str of a field within a percent."""
    heights = field((6.0, 8.0), (300, 400))
    gappy = np.where(np.random.default_rng(1).random(heights.shape) < 0.2, np.nan, heights)
    plain, found = numbers(heights, (1.0, 1.0)), numbers(gappy, (1.0, 1.0))
    assert found.Sal == pytest.approx(plain.Sal, rel=0.01)
    assert found.Str == pytest.approx(plain.Str, rel=0.01)


def test_missing_borders():
    """A frame of missing pixels leaves Sal and Str of the map inside."""
    heights = field((4.0, 6.0), (120, 150))
    plain, framed = numbers(heights, (1.0, 1.0)), numbers(np.pad(heights, 5, constant_values=np.nan), (1.0, 1.0))
    assert [framed.Sal, framed.Str] == pytest.approx([plain.Sal, plain.Str], rel=1e-9)


def test_mirrored_and_transposed():
    """Mirroring turns the lay to the other side, transposing swaps x and y; lengths stay."""
    heights = field((2.0, 4.0), (120, 150)) + 0.03 * waves(30, 20.0, (120, 150), (1.0, 1.0))
    plain = numbers(heights, (1.0, 1.0))
    mirrored, turned = numbers(heights[:, ::-1], (1.0, 1.0)), numbers(heights.T, (1.0, 1.0))
    for other, direction in ((mirrored, 180 - plain.Std), (turned, 90 - plain.Std)):
        assert other.Sal == pytest.approx(plain.Sal, rel=1e-4)
        assert other.Str == pytest.approx(plain.Str, rel=1e-3)
        assert (other.Std - direction + 90) % 180 - 90 == pytest.approx(0, abs=0.1)


def test_units_and_precision(dtype):
    """Metres in single precision give the numbers of micrometres in double precision."""
    heights = field((4.0, 6.0), (120, 150))
    plain = numbers(heights, (1.0, 1.0))
    found = numbers((1e-9 * heights).astype(dtype), (1e-6, 1e-6))
    assert found.Sal * 1e6 == pytest.approx(plain.Sal, rel=1e-3)
    assert found.Str == pytest.approx(plain.Str, rel=2e-3)


def test_isolated_places():
    """Two small islands far apart: lags of which there are too few pairs are not answered, nor is Str along the gap."""
    heights = np.full((60, 200), np.nan)
    heights[:, :12], heights[:, -12:] = 1.0, 1.0
    heights *= waves(90, 8.0, (60, 200), (1.0, 1.0))
    found = numbers(heights, (1.0, 1.0))
    assert found.Sal == pytest.approx(8 * np.arccos(0.2) / (2 * np.pi), rel=0.02)
    assert np.isnan(found.Str)


def test_no_answer():
    """A map of few pixels, or of equal heights, has no Sal and no Str."""
    for heights in (np.random.default_rng(0).normal(size=(3, 3)), np.full((30, 30), 2.0), np.full((30, 30), np.nan)):
        found = numbers(heights, (1.0, 1.0))
        assert np.isnan([found.Sal, found.Str]).all()


def test_bad_threshold():
    """A threshold outside (0, 1) is refused."""
    with pytest.raises(InputError, match="between 0 and 1"):
        spatial_parameters(np.ones((9, 9)), (1.0, 1.0), threshold=1.0)
