"""Hybrid parameters: planes, sines against quadrature, missing pixels, spacing, stencils."""

import numpy as np
import pytest
from scipy.integrate import quad

from tsplinejax import InputError
from tsplinejax.areal import hybrid_parameters

STENCILS = pytest.mark.parametrize("stencil", ["differences", "seven-point"])


def numbers(*arguments, **options) -> list[float]:
    """Sdq and Sdr as plain numbers."""
    return [float(value) for value in hybrid_parameters(*arguments, **options)]


def plane(slope_x: float, slope_y: float, spacing: tuple[float, float]) -> np.ndarray:
    """A plane of 12 × 15 pixels."""
    return slope_x * spacing[0] * np.arange(15) + slope_y * spacing[1] * np.arange(12)[:, None]


@STENCILS
@pytest.mark.parametrize("spacing", [(1.0, 1.0), (0.5, 2.0), (2e-9, 1e-9)])
def test_plane(stencil, spacing):
    """A plane of gradient (a, b): Sdq² = a² + b² and Sdr = √(1 + a² + b²) - 1, at any spacing, with holes, too."""
    heights = plane(0.3, 0.4, spacing)
    heights[5, 11] = np.nan
    assert numbers(heights, spacing, stencil=stencil) == pytest.approx([0.5, 100 * (np.sqrt(1.25) - 1)], rel=1e-9)


def test_shallow_slopes_in_single_precision():
    """Sdr of a slope of 1e-4 is half its square, not lost against one."""
    heights = plane(1e-4, 0, (1.0, 1.0)).astype(np.float32)
    assert numbers(heights, (1.0, 1.0))[1] == pytest.approx(100 * 0.5e-8, rel=1e-3)


@pytest.mark.parametrize(
    ("stencil", "pixels", "tolerance"),
    [("differences", 201, (np.pi / 20) ** 2 / 3), ("seven-point", 206, 2 * (2 * np.pi / 20) ** 6 / 140)],
)
def test_sine_against_quadrature(stencil, pixels, tolerance):
    """Sdq and Sdr of ten periods of 20 pixels, against the integrals, within the first term that is left out."""
    step, length, amplitude = 0.5, 10.0, 2.0
    heights = amplitude * np.sin(2 * np.pi * (np.arange(pixels) + 0.5) * step / length) * np.ones((9, 1))
    k = 2 * np.pi / length
    area = quad(lambda x: np.sqrt(1 + (amplitude * k * np.cos(k * x)) ** 2) - 1, 0, length)[0] / length
    found = numbers(heights, (step, 3.0), stencil=stencil)
    assert found == pytest.approx([amplitude * k / np.sqrt(2), 100 * area], rel=1.5 * tolerance)


def test_what_differences_miss():
    """Differences see a shallow sine of λ = 20 pixels through the factor sinc(π / 20), as the documentation says."""
    heights = 1e-3 * np.sin(2 * np.pi * np.arange(2001) / 20) * np.ones((2, 1))
    slope, area = numbers(heights, (1.0, 1.0))
    true = 1e-3 * 2 * np.pi / 20 / np.sqrt(2)
    assert slope / true == pytest.approx(np.sinc(1 / 20), rel=1e-9)
    assert 1 - slope / true == pytest.approx((np.pi / 20) ** 2 / 6, rel=0.01)
    assert 1 - area / (50 * true**2) == pytest.approx((np.pi / 20) ** 2 / 3, rel=0.01)


@STENCILS
def test_no_stencil_crosses_a_gap(stencil):
    """Two planes that differ by a step, a row of missing pixels between them: the step is not seen."""
    heights = np.vstack([plane(0.1, 0, (1.0, 1.0)), np.full(15, np.nan), 100 + plane(0.1, 0, (1.0, 1.0))])
    assert numbers(heights, (1.0, 1.0), stencil=stencil)[0] == pytest.approx(0.1, rel=1e-9)


@STENCILS
def test_missing_borders(stencil):
    """A frame of missing pixels leaves the parameters of the map inside."""
    heights = np.random.default_rng(0).normal(size=(20, 30))
    framed = np.pad(heights, 4, constant_values=np.nan)
    assert numbers(framed, (1.0, 2.0), stencil=stencil) == pytest.approx(numbers(heights, (1.0, 2.0), stencil=stencil))


@STENCILS
def test_mirrored_and_transposed(stencil):
    """Mirroring changes nothing, transposing swaps the spacing."""
    heights = np.random.default_rng(1).normal(size=(20, 30))
    heights[4:7, 10] = np.nan
    plain = numbers(heights, (1.0, 2.0), stencil=stencil)
    assert numbers(heights[::-1], (1.0, 2.0), stencil=stencil) == pytest.approx(plain)
    assert numbers(heights[:, ::-1], (1.0, 2.0), stencil=stencil) == pytest.approx(plain)
    assert numbers(heights.T, (2.0, 1.0), stencil=stencil) == pytest.approx(plain)


def test_weights():
    """Half a map steep, half flat: weights say how much each counts."""
    heights = np.concatenate([np.zeros(50), np.arange(50.0)]) * np.ones((40, 1))
    weights = np.where(np.arange(100) < 50, 1.0, 3.0) * np.ones((40, 1))
    for stencil in ("differences", "seven-point"):
        assert numbers(heights, (1.0, 1.0), weights, stencil=stencil)[0] ** 2 == pytest.approx(0.75, rel=0.03)


def test_too_narrow():
    """No complete stencil, no parameter."""
    assert np.isnan(numbers(np.ones((1, 9)), (1.0, 1.0))).all()
    assert np.isnan(numbers(np.ones((6, 40)), (1.0, 1.0), stencil="seven-point")).all()


def test_bad_input():
    """Scattered samples and unknown stencils are refused."""
    with pytest.raises(InputError, match="rows, columns"):
        hybrid_parameters(np.ones(5), (1.0, 1.0))
    with pytest.raises(InputError, match="'seven-point'"):
        hybrid_parameters(np.ones((5, 5)), (1.0, 1.0), stencil="sobel")
