"""Height maps: axes, spacing, units, missing pixels, and what is refused."""

import dataclasses

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import HeightMap

HEIGHTS = np.arange(12.0).reshape(3, 4)


def test_rows_are_y_and_columns_are_x():
    """Pixel (i, j) lies at x = x0 + j dx, y = y0 + i dy; the extent is (n - 1) spacings, to 1e-12."""
    height_map = HeightMap(HEIGHTS, (0.1, 0.25), "mm", origin=(5.0, -1.0))
    assert height_map.shape == (3, 4)
    assert height_map.extent == pytest.approx((0.3, 0.5), rel=1e-12)
    samples = height_map.samples()
    xy = samples.frame.xy_of(samples.parameters)
    i, j = np.divmod(samples.grid_index, 4)
    np.testing.assert_allclose(xy, np.stack([5.0 + 0.1 * j, -1.0 + 0.25 * i], axis=1), rtol=1e-12)
    np.testing.assert_array_equal(samples.values[:, 0], HEIGHTS[i, j])
    np.testing.assert_allclose(samples.frame.parameters_of(xy[:, 0], xy[:, 1]), samples.parameters, atol=1e-12)


def test_heights_are_copied_and_read_only():
    """A map does not change when the array it came from does, nor can it be changed."""
    array = HEIGHTS.copy()
    height_map = HeightMap(array)
    array[0, 0] = 99
    assert height_map.heights[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        height_map.heights[0, 0] = 1
    with pytest.raises(dataclasses.FrozenInstanceError):
        height_map.unit = "mm"


@pytest.mark.parametrize(
    ("dtype", "kept"),
    [
        (np.float32, np.float32),
        (np.float64, np.float64),
        (np.float16, np.float32),
        (np.int16, np.float64),
        (np.uint8, np.float64),
        (">f4", np.float32),
        (">f8", np.float64),
        (np.longdouble, np.float64),
    ],
)
def test_dtypes(dtype, kept):
    """float32 and float64 stay, integers become float64, everything is native."""
    assert HeightMap(HEIGHTS.astype(dtype)).heights.dtype == np.dtype(kept)


def test_height_units_are_converted_on_construction():
    """One unit serves all axes: heights in nm over a grid in µm become µm."""
    height_map = HeightMap(HEIGHTS, 2.0, "um", "nm")
    assert (height_map.unit, height_map.spacing) == ("µm", (2.0, 2.0))
    np.testing.assert_allclose(height_map.heights, HEIGHTS * 1e-3, rtol=1e-15)


def test_units_change_together():
    """`to_unit` converts spacing, origin and heights, and back again to 1e-15."""
    height_map = HeightMap(HEIGHTS, (0.1, 0.2), "mm", origin=(1.0, 2.0))
    metres = height_map.to_unit("m")
    assert metres.spacing == pytest.approx((1e-4, 2e-4), rel=1e-15)
    assert metres.origin == pytest.approx((1e-3, 2e-3), rel=1e-15)
    np.testing.assert_allclose(metres.to_unit("mm").heights, HEIGHTS, rtol=1e-15)
    assert HeightMap(HEIGHTS.astype(np.float32), unit="mm").to_unit("m").heights.dtype == np.float32


def test_missing_pixels_come_from_nan_masked_arrays_and_masks():
    """All three mark the same; an infinite or absurd height under a mask does not matter."""
    with_nan = np.where(HEIGHTS == 5, np.nan, HEIGHTS)
    masked = np.ma.masked_array(HEIGHTS.astype(int), HEIGHTS == 5)
    infinite = np.where(HEIGHTS == 5, np.inf, HEIGHTS)
    for height_map in (HeightMap(with_nan), HeightMap(masked), HeightMap(infinite, mask=HEIGHTS == 5)):
        np.testing.assert_array_equal(height_map.heights, with_nan)
        assert height_map.valid.sum() == 11
        assert len(height_map.samples()) == 11
    assert HeightMap(with_nan).range == 11.0


def test_scatter_puts_samples_back():
    """Residuals return to their pixels, missing ones are NaN."""
    with_nan = np.where(HEIGHTS == 5, np.nan, HEIGHTS)
    samples = HeightMap(with_nan).samples()
    np.testing.assert_array_equal(samples.scatter(samples.values[:, 0]), with_nan)


def test_weights_may_be_a_map():
    """Weights of the map's shape are taken at the valid pixels."""
    weights = np.arange(12.0).reshape(3, 4)
    samples = HeightMap(np.where(HEIGHTS == 5, np.nan, HEIGHTS)).samples(weights)
    np.testing.assert_array_equal(samples.weights, np.delete(np.arange(12.0), 5))


def test_crop_keeps_places():
    """A cropped map lies where it lay; pixel centres on the edge belong to it."""
    height_map = HeightMap(HEIGHTS, (0.1, 0.5), "mm")
    part = height_map.crop(0.1, "500um", 0.3, 1.0)
    np.testing.assert_array_equal(part.heights, HEIGHTS[1:, 1:])
    assert part.origin == pytest.approx((0.1, 0.5), rel=1e-12)
    assert part.provenance["operations"] == ["crop 0.1,0.5,0.3,1 mm"]
    assert height_map.provenance == {}


def test_operations_return_new_maps():
    """Masks and other heights give new maps and leave the old one."""
    height_map = HeightMap(HEIGHTS, unit="mm")
    assert np.isnan(height_map.with_mask(HEIGHTS > 10).heights).sum() == 1
    assert height_map.with_heights(HEIGHTS + 1).unit == "mm"
    assert not np.isnan(height_map.heights).any()


def test_repr_says_what_it_is():
    """Shape, spacing, unit and range are in the representation, NaN range included."""
    assert "3 rows × 4 columns" in repr(HeightMap(HEIGHTS, unit="um"))
    assert "range=nan" in repr(HeightMap([[np.nan]]))
    assert "99.9 % valid" in repr(HeightMap(np.where(np.arange(10_000).reshape(100, 100) == 5, np.nan, 1.0)))


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (np.zeros((3, 4), bool), "mask="),
        (np.zeros((3, 4), complex), "real part"),
        (np.array([["a", "b"]]), "dtype"),
        (np.array([[object(), 1]]), "dtype object"),
        (np.zeros((2, 2), "M8[s]"), "dtype"),
        ([[1, 2], [3]], "cannot read"),
        (np.zeros(4), "2-D"),
        (np.zeros((2, 2, 2)), "2-D"),
        (3.0, "2-D"),
        (np.zeros((0, 4)), "empty"),
        ([[1.0, np.inf]], "1 of 2 are infinite"),
        ([[1.0, -np.inf]], "infinite"),
        (None, "dtype object"),
    ],
)
def test_bad_heights_are_refused(heights, message):
    """Wrong dtypes, shapes and infinities are refused, with what was received."""
    with pytest.raises(InputError, match=message):
        HeightMap(heights)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spacing": (0.0, 1.0)}, "positive"),
        ({"spacing": -1.0}, "positive"),
        ({"spacing": (np.nan, 1.0)}, "finite"),
        ({"spacing": (1.0, 2.0, 3.0)}, "pair"),
        ({"spacing": "wide"}, "pair"),
        ({"unit": "volt"}, "not a unit"),
        ({"height_unit": "nm"}, "need the unit of the spacing"),
        ({"origin": (np.inf, 0.0)}, "finite"),
        ({"mask": np.zeros((4, 3), bool)}, "shape"),
        ({"mask": np.full((3, 4), np.nan)}, "finite"),
        ({"mask": np.full((3, 4), "x")}, "booleans"),
    ],
)
def test_bad_options_are_refused(options, message):
    """Spacing, units, origin and mask are checked."""
    with pytest.raises(InputError, match=message):
        HeightMap(HEIGHTS, **options)


@pytest.mark.parametrize("heights", [np.zeros((1, 5)), np.zeros((5, 1)), np.zeros((1, 1))])
def test_a_single_row_is_data_but_no_surface(heights):
    """A 1 x N map is accepted, but has no samples of a surface: its extent is zero."""
    height_map = HeightMap(heights)
    assert 0.0 in height_map.extent
    with pytest.raises(InputError, match="positive extent"):
        height_map.samples()


def test_bad_uses_are_refused():
    """What an operation cannot do, it says."""
    height_map = HeightMap(HEIGHTS)
    with pytest.raises(InputError, match="missing"):
        HeightMap(np.full((2, 2), np.nan)).samples()
    with pytest.raises(InputError, match="unknown unit"):
        height_map.to_unit("mm")
    with pytest.raises(InputError, match="holds no pixel"):
        height_map.crop(10, 10, 20, 20)
    with pytest.raises(InputError, match="x0 ≤ x1"):
        height_map.crop(2, 0, 1, 1)
    with pytest.raises(InputError, match="shape of the map"):
        height_map.with_heights(np.zeros((2, 2)))
    with pytest.raises(InputError, match="overflow"):
        HeightMap(np.full((2, 2), 1e30, np.float32), unit="pm", height_unit="km")


def test_filled_pixels_go_along():
    """Which heights were filled in is kept by crops, units and new heights; missing pixels were not filled."""
    filled = np.zeros((3, 4), bool)
    filled[1, 1:3] = True
    height_map = HeightMap(HEIGHTS, 1.0, "mm", filled=filled)
    np.testing.assert_array_equal(height_map.measured, ~filled)
    assert height_map.valid.all()
    assert height_map.crop(1, 1, 3, 2).filled.tolist() == [[True, True, False], [False] * 3]
    assert height_map.to_unit("µm").filled.sum() == height_map.with_heights(2 * HEIGHTS).filled.sum() == 2
    smooth = height_map.derived(2 * HEIGHTS, "doubled", "mm")
    assert (smooth.filled.sum(), smooth.provenance["operations"]) == (2, ["doubled mm"])
    assert height_map.with_mask(np.arange(12).reshape(3, 4) == 5).filled.sum() == 1
    assert HeightMap(HEIGHTS).filled is None
    with pytest.raises(InputError, match="shape"):
        HeightMap(HEIGHTS, filled=[[True]])
