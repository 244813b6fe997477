"""The noise estimate: white, correlated, rounded and slope-dependent noise, texture, clean maps, holes, tiny maps."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tsplinejax import data
from tsplinejax.data import HeightMap, NoiseEstimate, Samples, estimate_noise, noise_deviation

SURFACES: dict[str, Callable[[], HeightMap]] = {
    "laser texture": data.laser_textured_disk,
    "plate": data.plate_with_particles,
    "bumps": data.sparse_bumps,
    "peaks": lambda: data.peaks((512, 512)),
}
ON_EACH_SURFACE = pytest.mark.parametrize("surface", SURFACES)


@pytest.fixture(scope="module")
def clean() -> dict[str, HeightMap]:
    """The surfaces without noise, made once."""
    return {name: make() for name, make in SURFACES.items()}


def white(shape: tuple[int, int] = (512, 512), seed: int = 0) -> np.ndarray:
    """Uncorrelated noise of standard deviation one."""
    return np.random.default_rng(seed).normal(size=shape)


def correlated(length: float) -> np.ndarray:
    """White noise smoothed by a Gaussian of `length` pixels, of standard deviation one."""
    smooth = gaussian_filter(white(), length, mode="wrap")
    return smooth / smooth.std()


def self_affine(hurst: float, seed: int = 1) -> np.ndarray:
    """A texture whose power falls as frequency^(-2 - 2 H) from the longest wave down to the pixel."""
    frequency = np.hypot(np.fft.fftfreq(512)[:, np.newaxis], np.fft.rfftfreq(512))
    frequency[0, 0] = np.inf
    texture = np.fft.irfft2(np.fft.rfft2(white(seed=seed)) * frequency ** (-1 - hurst), s=(512, 512))
    return texture / texture.std()


def steepness(height_map: HeightMap) -> np.ndarray:
    """Slope of a map, in heights per length."""
    dx, dy = height_map.spacing
    return np.hypot(*np.gradient(height_map.heights, dy, dx))


def estimate_of(height_map: HeightMap, heights: np.ndarray) -> NoiseEstimate:
    """The estimate for other heights in the place of a map's."""
    return estimate_noise(height_map.with_heights(heights))


@ON_EACH_SURFACE
@pytest.mark.parametrize("share", [0.001, 0.01, 0.05])
def test_white_noise(clean, surface, share):
    """The standard deviation of white noise on structured surfaces, to 5 %."""
    height_map, sigma = clean[surface], share * clean[surface].range
    estimate = estimate_of(height_map, height_map.heights + sigma * white())
    assert estimate.sigma == pytest.approx(sigma, rel=0.05)
    assert (estimate.correlation_length, estimate.neighbour_correlation) == (0.0, 0.0)
    assert (estimate.correlated_samples, estimate.quantisation) == (1.0, 0.0)
    assert not estimate.texture_limited


def test_noise_on_scattered_points():
    """The standard deviation of the noise on a scattered cloud, to 5 %."""
    assert estimate_noise(data.scattered_peaks()).sigma == pytest.approx(0.05, rel=0.05)


@ON_EACH_SURFACE
def test_correlated_noise(clean, surface):
    """Noise correlated over 1.5 pixels: its full standard deviation, not only what neighbours differ by."""
    height_map, sigma = clean[surface], 0.01 * clean[surface].range
    estimate = estimate_of(height_map, height_map.heights + sigma * correlated(1.5))
    assert estimate.sigma == pytest.approx(sigma, rel=0.15)
    assert estimate.correlation_length == pytest.approx(1.5, abs=0.2)
    assert not estimate.texture_limited
    assert estimate.neighbour_correlation == pytest.approx(np.exp(-1 / 9), abs=0.05)
    assert estimate.correlated_samples == pytest.approx(9 * np.pi, rel=0.3)


@pytest.mark.parametrize("levels", [64, 256, 4096])
@ON_EACH_SURFACE
def test_rounded_heights(clean, surface, levels):
    """Heights rounded to steps q, with no other noise, deviate by q / √12."""
    height_map = clean[surface]
    step = height_map.range / levels
    estimate = estimate_of(height_map, np.round(height_map.heights / step) * step)
    assert estimate.quantisation == pytest.approx(step, rel=1e-6)
    assert estimate.sigma == pytest.approx(step / np.sqrt(12), rel=0.05)


@ON_EACH_SURFACE
def test_clean_surfaces(clean, surface):
    """Surfaces without noise are taken to be so, and nobody is warned of texture."""
    estimate = estimate_noise(clean[surface])
    assert estimate.sigma <= 1e-4 * clean[surface].range
    assert (estimate.texture_limited, estimate.note) == (False, "")


@ON_EACH_SURFACE
def test_noise_that_grows_with_the_slope(clean, surface):
    """Ten times the noise on the steepest slope: the growth is found, and steep pixels are given more noise."""
    height_map, slope = clean[surface], steepness(clean[surface])
    flat = 0.002 * height_map.range
    noisy = height_map.with_heights(height_map.heights + flat * (1 + 9 * slope / slope.max()) * white())
    estimate = estimate_noise(noisy)
    assert estimate.slope_coefficient > 0
    assert estimate.slope_coefficient == pytest.approx(9 * flat / slope.max(), rel=0.5)
    deviation = noise_deviation(estimate, noisy.samples())
    assert deviation.shape == (slope.size,)
    steep = slope.ravel() > np.quantile(slope, 0.9)
    assert deviation[steep].mean() > 1.5 * deviation[slope.ravel() < np.median(slope)].mean()


def test_white_noise_does_not_grow_with_the_slope(clean):
    """Where the noise is the same everywhere, so is its deviation, one a sample."""
    height_map = clean["plate"]
    noisy = height_map.with_heights(height_map.heights + 0.01 * height_map.range * white())
    estimate = estimate_noise(noisy)
    assert estimate.slope_coefficient == 0
    np.testing.assert_array_equal(noise_deviation(estimate, noisy.samples()), np.full(512 * 512, estimate.sigma))


@pytest.mark.parametrize(
    "heights",
    [
        pytest.param(lambda: gaussian_filter(white(), 0.6), id="smoothed over 0.6 pixels"),
        pytest.param(lambda: self_affine(0.5), id="self-affine, H = 0.5"),
        pytest.param(lambda: self_affine(0.8), id="self-affine, H = 0.8"),
    ],
)
def test_texture_down_to_the_pixel(heights):
    """Roughness without a smallest wavelength cannot be told from noise, and the estimate says so."""
    estimate = estimate_noise(heights())
    assert estimate.texture_limited
    assert "texture" in estimate.note


@ON_EACH_SURFACE
def test_missing_pixels(clean, surface):
    """A fifth of the pixels missing in blobs, and some strewn about, hardly change the estimate."""
    height_map, sigma = clean[surface], 0.01 * clean[surface].range
    noisy = height_map.heights + sigma * white()
    blobs = gaussian_filter(white(seed=2), 8)
    missing = (blobs < np.quantile(blobs, 0.2)) | (white(seed=3) > 2.5)
    complete = estimate_of(height_map, noisy)
    holed = estimate_of(height_map, np.where(missing, np.nan, noisy))
    assert holed.sigma == pytest.approx(complete.sigma, rel=0.05)
    assert not holed.texture_limited


@pytest.mark.parametrize(
    "heights",
    [
        pytest.param(np.full((100, 100), 3.7), id="constant"),
        pytest.param(np.zeros((20, 20), np.float32), id="zero"),
        pytest.param(white((1, 500)), id="one row"),
        pytest.param(white((500, 1)), id="one column"),
        pytest.param(white((4, 300)), id="four rows"),
        pytest.param(white((2, 2)), id="four pixels"),
    ],
)
def test_nothing_to_judge_by(heights):
    """Constant maps have no noise; of maps too small to judge none is reported (a warning would fail the test)."""
    estimate = estimate_noise(HeightMap(heights))
    assert (estimate.sigma, estimate.texture_limited, estimate.note) == (0.0, False, "")


def test_units_and_precision(clean):
    """In other units the same estimate, scaled; and the same again from float32 and from samples."""
    height_map = clean["plate"]
    noisy = height_map.with_heights(height_map.heights + 0.01 * height_map.range * white())
    sigma = estimate_noise(noisy).sigma
    assert estimate_noise(noisy.with_heights(1e-9 * noisy.heights)).sigma == pytest.approx(1e-9 * sigma, rel=1e-6)
    assert estimate_noise(noisy.with_heights(noisy.heights.astype(np.float32))).sigma == pytest.approx(sigma, rel=1e-3)
    assert estimate_noise(noisy.samples()).sigma == pytest.approx(sigma, rel=1e-9)


def test_few_scattered_points():
    """Fewer points than two neighbourhoods are not judged."""
    rng = np.random.default_rng(0)
    assert estimate_noise(Samples(rng.random((23, 2)), rng.random(23))).sigma == 0.0
