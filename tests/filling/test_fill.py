"""`fill_missing`: what is filled and what is left alone, the choice of fillers, uncertainty, exactness, bounds."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import tsplinejax as tsj
from tsplinejax.data import peaks, structured_with_missing
from tsplinejax.filling import SplineFiller, interpolate

#: Where the choice of fillers is not what is tested.
FEW = (SplineFiller(2), SplineFiller(1))


def rms(values):
    """Root mean square."""
    return float(np.sqrt(np.mean(np.asarray(values) ** 2)))


def rough(shape=(64, 64), seed=0):
    """A filtered noise on waves: what is rough, with a length of its own."""
    from scipy.ndimage import gaussian_filter

    rng = np.random.default_rng(seed)
    i, j = np.indices(shape)
    return np.sin(i / 17) + np.cos(j / 23) + 4 * gaussian_filter(rng.normal(size=shape), 1.5)


def blobs(shape, seed=0, count=14, inner=True):
    """Round holes."""
    rng = np.random.default_rng(seed)
    i, j = np.indices(shape)
    missing = np.zeros(shape, bool)
    for _ in range(count):
        centre = rng.uniform(0.12, 0.88, 2) * shape
        missing |= np.hypot(i - centre[0], j - centre[1]) < rng.uniform(2, 5)
    return missing


def test_measured_pixels_stay_and_filled_ones_are_marked(dtype):
    """Bit for bit, in the data's own precision; the input is left as it was."""
    heights = rough().astype(dtype)
    missing = blobs(heights.shape)
    data = tsj.HeightMap(np.where(missing, np.nan, heights), (0.5, 0.7), "µm")
    filled = tsj.fill_missing(data, fillers=FEW)
    assert filled.map.heights.dtype == dtype
    np.testing.assert_array_equal(filled.map.heights[~missing], heights[~missing])
    np.testing.assert_array_equal(filled.map.filled, missing)
    np.testing.assert_array_equal(filled.map.measured, ~missing)
    assert np.isnan(data.heights[missing]).all()
    assert (filled.n_filled, filled.max_error, filled.unit) == (missing.sum(), 0.0, "µm")
    assert filled.map.provenance["operations"][-1].startswith(f"{missing.sum()} missing pixels filled")


def test_border_holes_are_left_unless_asked():
    """They stay missing and the result says so; border=True fills them."""
    heights = np.add.outer(np.arange(40.0), np.arange(50.0))
    heights[:5, :6] = heights[20:24, 20:25] = np.nan
    filled = tsj.fill_missing(heights, fillers=FEW)
    assert (filled.n_filled, int(filled.left.sum())) == (20, 30)
    assert np.isnan(filled.map.heights[:5, :6]).all()
    assert "border=True" in filled.warnings[0]
    whole = tsj.fill_missing(heights, border=True, fillers=FEW)
    assert whole.map.valid.all()
    np.testing.assert_allclose(whole.map.heights, np.add.outer(np.arange(40.0), np.arange(50.0)), atol=0.05)


def test_areal_parameters_leave_filled_pixels_out():
    """A filled map gives the parameters of what was measured, unless asked for all of it."""
    heights = rough()
    data = tsj.HeightMap(np.where(blobs(heights.shape), np.nan, heights), (1.0, 1.0), "µm")
    filled = tsj.fill_missing(data, fillers=FEW).map
    assert tsj.areal_parameters(filled).Sq == tsj.areal_parameters(data).Sq
    assert tsj.areal_parameters(filled, include_filled=True).Sq != tsj.areal_parameters(data).Sq


def test_nothing_is_missing():
    """A complete map comes back as it is."""
    filled = tsj.fill_missing(rough((20, 20)))
    assert (filled.n_filled, filled.weights, filled.warnings) == (0, {}, ())


@pytest.mark.parametrize("seed", range(2))
def test_mixture_beats_every_filler_and_knows_its_error(seed):
    """On a rough map the error at the holes is about what the hidden patches promise, and no filler alone is better."""
    heights = rough((112, 112), seed)
    missing = blobs(heights.shape, seed, 24)
    filled = tsj.fill_missing(np.where(missing, np.nan, heights), rng=seed)
    errors = filled.map.heights[missing] - heights[missing]
    assert filled.validated_rms <= min(filled.hidden_rms.values()) * 1.001
    assert 0.7 < rms(errors) / filled.validated_rms < 1.4
    covered = np.mean(np.abs(errors) <= 2 * filled.uncertainty[missing])
    assert 0.88 < covered < 0.995


def test_edges_do_not_swing():
    """Pillars of which a fifth is missing: nothing rises above them by more than a twentieth of their height."""
    data = structured_with_missing((96, 96), noise=0.005)
    truth = structured_with_missing((96, 96), missing=0).heights
    filled = tsj.fill_missing(data, edges=True, border=True)
    missing = ~data.valid
    values = filled.map.heights[missing]
    assert values.max() - truth.max() <= 0.05
    assert truth.min() - values.min() <= 0.05
    assert rms(values - truth[missing]) < 0.25


def test_periodic_steps_are_not_overshot():
    """Pillars of which a fifth is missing, by default: the hidden patches show that what swings beyond all measured
    heights errs, and nothing does so.
    """
    data = structured_with_missing((96, 96), noise=0.005)
    filled = tsj.fill_missing(data, border=True)
    values = filled.map.heights[~data.valid]
    assert values.max() <= np.nanmax(data.heights)
    assert values.min() >= np.nanmin(data.heights)


def test_summits_may_rise_above_what_was_measured():
    """A dome whose top is missing gets its top, for patches hidden at its rim show that heights go on rising."""
    y, x = np.mgrid[-1:1:80j, -1:1:80j]
    heights = 2 - x**2 - y**2
    holed = np.where(np.hypot(x - 0.05, y) < 0.2, np.nan, heights)
    filled = tsj.fill_missing(holed)
    np.testing.assert_allclose(filled.map.heights, heights, atol=1e-3)
    assert filled.map.heights.max() > np.nanmax(holed) + 0.02


def test_exact_interpolates_every_pixel():
    """The surface passes through every measured and every filled pixel to 1e-9 of the range, on unequal spacing."""
    data = peaks((60, 45))
    holed = data.with_mask(blobs(data.shape, 3, 5))
    filled = tsj.fill_missing(holed, exact=True, fillers=FEW)
    assert filled.surface is not None
    assert filled.control_points == 62 * 47
    samples = filled.map.samples()
    errors = np.asarray(filled.surface(samples.parameters)) - samples.values[:, 0]
    assert np.abs(errors).max() <= 1e-9 * data.range


@settings(max_examples=10)
@given(st.integers(2, 9), st.integers(2, 9), st.integers(0, 1000))
def test_interpolation_of_any_shape(rows, columns, seed):
    """Maps of any size, down to two pixels a side, are interpolated."""
    heights = np.random.default_rng(seed).normal(size=(rows, columns))
    data = tsj.HeightMap(heights, (0.3, 2.0))
    samples = data.samples()
    np.testing.assert_allclose(interpolate(data)(samples.parameters), samples.values[:, 0], atol=1e-9)


def test_smooth_all_takes_every_height_from_the_surface():
    """Noise is smoothed away everywhere, and the holes are no trouble to the fit."""
    clean, noisy = peaks((80, 80)), peaks((80, 80), noise=0.01)
    missing = blobs(clean.shape, 1, 8)
    filled = tsj.fill_missing(noisy.with_mask(missing), smooth_all=True, fillers=FEW)
    assert filled.stop == "noise"
    assert rms(filled.map.heights - clean.heights) < 0.7 * rms(noisy.heights - clean.heights)
    assert rms((filled.map.heights - clean.heights)[missing]) < 0.01 * clean.range


@pytest.mark.parametrize("factor", [1e-9, 1e6])
def test_units_do_not_matter(factor):
    """Heights and spacing in another unit give the same map in that unit; an offset is carried along."""
    heights = np.where(blobs((64, 64)), np.nan, rough((64, 64)))
    one = tsj.fill_missing(tsj.HeightMap(heights, (1.0, 1.5)))
    other = tsj.fill_missing(tsj.HeightMap((heights + 50) * factor, (factor, 1.5 * factor)))
    np.testing.assert_allclose(other.map.heights / factor - 50, one.map.heights, atol=1e-4)


def test_fillers_of_ones_own():
    """A single filler gets all the weight; its name is in the result."""
    heights = np.where(blobs((64, 64)), np.nan, rough((64, 64)))
    filled = tsj.fill_missing(heights, fillers=[SplineFiller(1)])
    assert filled.weights == {"membrane, λ = 0.001": 1.0}


def test_small_maps_without_room_to_judge():
    """Where no patch can be hidden the map is filled all the same, and the result says what it does not know."""
    heights = np.ones((8, 8))
    heights[2:6, 2:6] = np.nan
    filled = tsj.fill_missing(heights)
    np.testing.assert_allclose(filled.map.heights, 1.0, atol=1e-6)
    assert np.isnan(filled.uncertainty).all()
    assert "no patch" in filled.warnings[0]


def test_holes_unlike_all_else_are_said_to_be():
    """Where the only steep place is the one that is missing, the result says that its errors will be larger."""
    heights = 0.01 * rough()
    heights[:, 28:36] += np.linspace(0, 5, 8)
    heights[:, 36:] += 5
    heights[3:-3, 29:35] = np.nan
    filled = tsj.fill_missing(heights, fillers=FEW)
    assert any("times as uneven" in warning for warning in filled.warnings)
    assert not any(
        "times as uneven" in warning
        for warning in tsj.fill_missing(np.where(blobs((64, 64)), np.nan, rough()), fillers=FEW).warnings
    )


BAD = {
    "cloud": (np.random.default_rng(0).normal(size=(30, 3)), {}, "point cloud"),
    "nothing": (np.full((5, 5), np.nan), {}, "nothing to fill from"),
    "both": (np.ones((5, 5)), {"exact": True, "smooth_all": True}, "one of the two"),
    "tolerance": (np.ones((5, 5)), {"tolerance": 1.0}, "smooth_all"),
}


@pytest.mark.parametrize("case", BAD)
def test_misuse(case):
    """The rule, and the remedy."""
    data, options, message = BAD[case]
    with pytest.raises(tsj.InputError, match=message):
        tsj.fill_missing(data, **options)


def test_interpolation_needs_a_complete_map():
    """Missing pixels are refused."""
    with pytest.raises(tsj.InputError, match="complete map"):
        interpolate(tsj.HeightMap([[1.0, np.nan], [0.0, 1.0]]))
