"""Filters and levelling: transmission, missing data, borders, provenance, and refusals."""

import numpy as np
import pytest

from tsplinejax import HeightMap, InputError, PointCloud, l_filter, level, s_filter
from tsplinejax.characterise._filters import gaussian_mean


def wave(length: float, shape: tuple[int, int] = (120, 300), spacing: tuple[float, float] = (0.1, 0.2)) -> HeightMap:
    """A cosine along x, in millimetres."""
    x = np.arange(shape[1]) * spacing[0]
    return HeightMap(np.ones((shape[0], 1)) * np.cos(2 * np.pi * (x - x.mean()) / length), spacing, "mm")


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0, 4.0])
def test_transmission(ratio):
    """In the middle of a map a wave passes as ISO 16610-61 says: exp(-π (α λc / λ)²), one half at the cut-off."""
    cutoff = 3.0
    through = s_filter(wave(ratio * cutoff), cutoff).heights[60, 149:151].mean()
    top = np.cos(np.pi * 0.1 / (ratio * cutoff))
    assert through / top == pytest.approx(0.5 ** (1 / ratio**2), abs=2e-4)


def test_both_filters_add_up():
    """What the S-filter lets through and what the L-filter of the same cut-off keeps are the map."""
    height_map = wave(2.0)
    total = s_filter(height_map, "2mm").heights + l_filter(height_map, "2000um").heights
    np.testing.assert_allclose(total, height_map.heights, atol=1e-12)


def test_missing_pixels_weigh_nothing():
    """With 30 % missing and at all borders, the mean is that of a plain sum over what is there."""
    generator = np.random.default_rng(0)
    heights = generator.normal(size=(23, 31)) + 100.0
    heights[generator.random(heights.shape) < 0.3] = np.nan
    found = gaussian_mean(heights, (0.5, 0.4), 3.0)
    y, x = np.meshgrid(np.arange(23) * 0.4, np.arange(31) * 0.5, indexing="ij")
    alpha = np.sqrt(np.log(2) / np.pi)
    valid = ~np.isnan(heights)
    for i, j in ((0, 0), (11, 15), (22, 3), (5, 30)):
        across, down = (
            np.exp(-np.pi * ((x - x[i, j]) / alpha / 3) ** 2),
            np.exp(-np.pi * ((y - y[i, j]) / alpha / 3) ** 2),
        )
        weights = (across * down)[valid]
        expected = (weights * heights[valid]).sum() / weights.sum() if valid[i, j] else np.nan
        np.testing.assert_allclose(found[i, j], expected, rtol=1e-7)
    assert np.array_equal(np.isnan(found), ~valid)


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_a_constant_stays(dtype):
    """An offset of a thousand ranges passes unchanged, in both precisions."""
    heights = np.full((20, 30), 1e3, dtype)
    filtered = s_filter(HeightMap(heights, 0.1, "mm"), 1.0)
    assert filtered.heights.dtype == dtype
    np.testing.assert_allclose(filtered.heights, heights, rtol=1e-12)


def test_levelling_takes_off_what_it_says():
    """Each form's map is flat afterwards; provenance says what was taken, after what came before."""
    x, y = np.meshgrid(np.arange(40) * 0.1, np.arange(30) * 0.1)
    surfaces = {"plane": 2 * x - y, "poly2": x * y + x**2, "sphere": np.sqrt(100 - x**2 - y**2)}
    for form, heights in surfaces.items():
        levelled = level(HeightMap(heights, 0.1, "mm", provenance={"operations": ["crop"]}), form)
        assert levelled.range < 1e-9
        first, second = levelled.provenance["operations"]
        assert (first, second.split(",")[0]) == ("crop", f"F-operation {form}")
    cloud = level(PointCloud(np.column_stack([x.ravel(), y.ravel(), (3 * x).ravel()])), "plane")
    np.testing.assert_allclose(cloud.points[:, 2], 0, atol=1e-12)


def test_operations_are_recorded_with_their_numbers():
    """Cut-offs in the data's unit, in the order of application."""
    done = l_filter(level(s_filter(wave(5.0), "0.8mm"), "plane"), "8mm").provenance["operations"]
    assert done[0] == "S-filter Gaussian ISO 16610-61, cut-off 0.8 mm"
    assert done[1].startswith("F-operation plane, least squares along z: normal [")
    assert done[2] == "L-filter Gaussian ISO 16610-61, cut-off 8 mm"


def test_refusals():
    """Clouds, bare arrays, and cut-offs that say nothing on this map."""
    bare = np.random.default_rng(1).normal(size=(20, 30))
    with pytest.raises(InputError, match="--spacing, --unit"):
        s_filter(bare, 5.0)
    with pytest.raises(InputError, match="--spacing, --unit"):
        level(bare, "sphere")
    assert level(bare, "poly2").range > 0
    with pytest.raises(InputError, match="works on a height map"):
        l_filter(np.ones((9, 3)), 1.0)
    for cutoff in (0.1, 1e3, -1.0):
        with pytest.raises(InputError, match="between two pixels and the map"):
            s_filter(wave(2.0), cutoff)
