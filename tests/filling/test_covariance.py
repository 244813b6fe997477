"""Kriging by the map's own covariance: the covariance itself, and that lay and period are made use of."""

import numpy as np
import pytest

from tsplinejax.filling import CovarianceFiller, SplineFiller
from tsplinejax.filling._covariance import _periods, covariance_of
from tsplinejax.filling._filler import Field
from tsplinejax.filling._predict import predict


def rms(values):
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def test_covariance_of_filtered_noise():
    """The covariance of Gaussian-filtered noise is the Gaussian it should be, with pixels missing."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(0)
    heights = gaussian_filter(rng.normal(size=(256, 256)), 2.0, mode="wrap")
    heights[rng.random(heights.shape) < 0.2] = np.nan
    covariance = covariance_of(heights)
    lags = np.arange(5)
    measured = covariance.values[covariance.reach, covariance.reach + lags] / covariance.variance
    np.testing.assert_allclose(measured, np.exp(-(lags**2) / (4 * 2.0**2)), atol=0.06)


@pytest.mark.parametrize("order", range(4))
def test_covariance_is_positive(order):
    """The matrix of covariances between any pixels has no negative eigenvalue, whatever is missing."""
    rng = np.random.default_rng(3)
    heights = np.cumsum(rng.normal(size=(60, 80)), axis=1)
    heights[10:30, 20:50] = np.nan
    places = rng.integers(0, 60, (50, 2))
    matrix = covariance_of(heights, order).between(places, places)
    assert np.linalg.eigvalsh(matrix).min() > -1e-9 * matrix.max()


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("missing", [0.0, 0.15])
def test_increments_find_small_waves_under_large_ones(order, missing):
    """The mean square of second differences is found, within a factor of 1.5, though waves a thousand times as high lie
    over it; from the products of the heights themselves it comes out more than twice as large or as small.
    """
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(order)
    fine = gaussian_filter(rng.normal(size=(200, 160)), 1.5, mode="wrap")
    i, j = np.indices(fine.shape)
    heights = fine / fine.std() + 1000 * np.sin(i / 90 + 1) * np.cos(j / 70)
    heights[rng.random(heights.shape) < missing] = np.nan
    # In first differences the large waves themselves have a part.
    weights = np.array([1, -2, 1])

    def square(covariance):
        return sum(
            weights[a] * weights[b] * covariance.values[covariance.reach, covariance.reach + a - b]
            for a in range(3)
            for b in range(3)
        )

    true = np.mean(np.diff(fine / fine.std(), 2, axis=1) ** 2)
    assert 1 / 1.5 < square(covariance_of(heights, order, 12)) / true < 1.5
    assert not 0.5 < square(covariance_of(heights)) / true < 2


def test_what_is_near_tells_a_lay_that_turns():
    """Grooves of one direction on the left, of another on the right: counted nearby, they are gone on with better."""
    from scipy.ndimage import gaussian_filter1d

    rng = np.random.default_rng(2)
    left, right = (gaussian_filter1d(rng.normal(size=(96, 96)), 9, axis=axis) for axis in (0, 1))
    heights = np.hstack([left[:, :48], right[:, 48:]])
    holed = heights.copy()
    for top, corner in ((20, 15), (60, 18), (20, 70), (60, 73)):
        holed[top : top + 6, corner : corner + 6] = np.nan
    wanted = np.isnan(holed)
    field = Field(holed, (1.0, 1.0), float(np.ptp(heights)))
    fillers = CovarianceFiller(1, 9, nearby=12), CovarianceFiller(1, 9)
    near, everywhere = (rms((predict(filler, field, wanted) - heights)[wanted]) for filler in fillers)
    assert near < 0.9 * everywhere, (near, everywhere)


def test_periods_are_found():
    """A pattern's period is among the lags at which the map is like itself."""
    i, j = np.indices((120, 120))
    pattern = ((i // 6) % 4 == 0) * ((j // 5) % 4 == 0) * 1.0
    found = {tuple(np.abs(lag)) for lag in _periods(covariance_of(pattern))}
    assert found & {(24, 0), (0, 20), (24, 20)}
    rough = np.random.default_rng(0).normal(size=(120, 120))
    assert not len(_periods(covariance_of(rough)))


@pytest.mark.parametrize("kind", ["lay", "period"])
def test_better_than_a_plate_where_the_map_repeats(kind):
    """Grooves in any direction, and pillars on a raster, are filled far better than by a plate."""
    i, j = np.indices((96, 96))
    if kind == "lay":
        from scipy.ndimage import gaussian_filter1d

        profile = gaussian_filter1d(np.random.default_rng(5).normal(size=400), 1.5)
        heights = profile[np.clip(np.round(i * 0.6 + j * 0.8).astype(int) + 50, 0, 399)]
    else:
        heights = ((i % 16 < 7) & (j % 16 < 7)) * 1.0
    field_heights = heights.copy()
    field_heights[40:50, 36:47] = np.nan
    wanted = np.isnan(field_heights)
    field = Field(field_heights, (1.0, 1.0), float(np.ptp(heights)))
    errors = [rms((predict(f, field, wanted) - heights)[wanted]) for f in (CovarianceFiller(), SplineFiller())]
    assert errors[0] < 0.5 * errors[1]
