"""Holes, windows over them, coarse maps, and the patches that are hidden."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tsplinejax.filling import SplineFiller
from tsplinejax.filling._filler import Field
from tsplinejax.filling._holes import bounds_of, depth_of, interior, windows
from tsplinejax.filling._patches import hidden_patches
from tsplinejax.filling._predict import predict


@settings(max_examples=30)
@given(st.integers(0, 10_000), st.floats(0.02, 0.6))
def test_windows_cover_every_wanted_pixel_once(seed, share):
    """Each wanted pixel is wanted in exactly one window, at its own place."""
    wanted = np.random.default_rng(seed).random((70, 45)) < share
    counts = np.zeros(wanted.shape, int)
    for window in windows(wanted, depth_of(wanted), 6):
        counts[window.rows, window.columns] += window.wanted
    np.testing.assert_array_equal(counts, wanted)


def test_interior_leaves_the_border_alone():
    """Holes that touch the border along a side are left; those that touch it at no pixel are not."""
    missing = np.zeros((20, 20), bool)
    missing[0:3, 4:6] = missing[8:12, 8:12] = missing[5:7, 19] = True
    expected = np.zeros_like(missing)
    expected[8:12, 8:12] = True
    np.testing.assert_array_equal(interior(missing), expected)


def test_bounds_are_those_of_the_rim():
    """A hole's heights are bounded by its rim's, not by what is further away."""
    heights = np.zeros((20, 20))
    heights[9, 12], heights[0, 0] = 2.0, 9.0
    heights[9:11, 8:10] = np.nan
    low, high = bounds_of(heights, np.isnan(heights))
    assert (low[9, 8], high[9, 8]) == (0.0, 2.0)
    assert np.isinf(high[0, 1])


def test_deep_holes_go_from_coarse_to_fine():
    """A hole of 70 pixels across in a smooth dome is filled to a hundredth of its height."""
    y, x = np.mgrid[-1:1:128j, -1:1:128j]
    heights = np.cos(1.5 * x) * np.cos(y)
    holed = np.where(np.hypot(x, y) < 0.55, np.nan, heights)
    wanted = np.isnan(holed)
    result = predict(SplineFiller(3), Field(holed, (1.0, 1.0), 1.0), wanted)
    assert np.abs(result - heights).max() < 0.01


def test_hidden_patches_have_the_holes_shapes():
    """Hidden pixels are known ones, in patches of the hole's shape; like places are preferred."""
    rng = np.random.default_rng(0)
    heights = rng.normal(size=(90, 90)) * 0.01
    heights[:, 45:] += np.arange(45) * 0.5  # a flank on the right
    heights[30:36, 60:68] = np.nan
    hidden, ratios = hidden_patches(heights, np.isnan(heights), rng, 300, 50)
    assert 6 <= len(ratios) <= 8
    assert 250 < hidden.sum() <= 348
    assert not np.isnan(heights[hidden]).any()
    assert hidden[:, 45:].sum() > 0.8 * hidden.sum()


@pytest.mark.parametrize("shape", [(6, 6), (3, 40)])
def test_no_room_to_hide(shape):
    """Where nothing fits, nothing is hidden."""
    heights = np.zeros(shape)
    heights[1 : shape[0] - 1, 1 : shape[1] - 1] = np.nan
    hidden, ratios = hidden_patches(heights, np.isnan(heights), np.random.default_rng(0), 100, 10)
    assert not hidden.any()
    assert not ratios
