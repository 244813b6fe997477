"""What a map picture shows of more data than it has pixels."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from tsplinejax.data import Frame, HeightMap, PointCloud, Samples
from tsplinejax.plot._raster import raster_of_cloud, raster_of_map, raster_of_samples

SHAPES = st.tuples(st.integers(1, 40), st.integers(1, 40))
HEIGHTS = SHAPES.flatmap(lambda shape: arrays(float, shape, elements=st.floats(-1, 1) | st.just(np.nan)))


def _raster(heights):
    return raster_of_map(HeightMap(heights, (0.5, 2.0), "mm"))


@given(HEIGHTS, st.integers(1, 40))
def test_reduction_keeps_extremes_and_place(heights, most):
    """The largest error anywhere survives any reduction, and the picture keeps its place and its size."""
    if np.isnan(heights).all():
        return
    whole = _raster(heights)
    reduced = whole.reduced("largest", most)
    assert max(reduced.values.shape) <= most
    assert np.nanmax(np.abs(reduced.values)) == np.nanmax(np.abs(heights))
    assert (reduced.start, reduced.size) == (whole.start, whole.size)


@given(HEIGHTS, st.integers(1, 40))
def test_reduction_shows_missing_only_where_all_is_missing(heights, most):
    """A drawn pixel is missing only if nothing below it was measured, and a mean lies between the heights below it."""
    if np.isnan(heights).all():
        return
    reduced = _raster(heights).reduced("mean", most).values
    assert np.isnan(reduced).sum() <= np.isnan(heights).sum()
    assert np.nanmin(heights) - 1e-12 <= np.nanmin(reduced)
    assert np.nanmax(reduced) <= np.nanmax(heights) + 1e-12


def test_pixels_are_centred_on_their_coordinates():
    """Pixel [0, 0] spreads half a spacing around the origin, in both directions."""
    raster = raster_of_map(HeightMap(np.zeros((3, 5)), (0.5, 2.0), "mm", origin=(10.0, 20.0)))
    assert raster.edges == (9.75, 12.25, 25.0, 19.0)


def test_samples_of_a_grid_return_to_it(height_map):
    """Values at a height map's samples are drawn where the map's own pixels are."""
    samples, expected = height_map.samples(), raster_of_map(height_map)
    drawn = raster_of_samples(samples, samples.values[:, 0], "mean")
    np.testing.assert_array_equal(drawn.values, height_map.heights)
    np.testing.assert_allclose(drawn.edges, expected.edges, rtol=1e-12)


@pytest.mark.parametrize("by", ["mean", "largest"])
def test_scattered_samples_are_binned(by):
    """Each of scattered samples falls into the bin that holds its parameters; a bin shows the larger of ±."""
    parameters = np.array([[0.1, 0.1], [0.12, 0.1], [1.0, 1.0], [0.9, 0.1]] * 8)
    values = np.tile([1.0, -3.0, 5.0, 0.5], 8)
    drawn = raster_of_samples(Samples(parameters, values, frame=Frame((0, 0), (2, 2), "mm")), values, by).values
    assert drawn[0, 0] == (-1.0 if by == "mean" else -3.0)
    assert drawn[-1, -1] == 5.0
    assert np.isnan(drawn[-1, 0])


def test_cloud_shows_mean_heights():
    """A cloud on a plane is drawn as that plane."""
    x, y = np.random.default_rng(0).random((2, 4000))
    raster = raster_of_cloud(PointCloud(np.stack([3 * x, y, 2 * x], 1), "mm"))
    assert raster.values.shape[1] > 2 * raster.values.shape[0]
    assert np.nanmean(raster.values) == pytest.approx(1.0, abs=0.05)
