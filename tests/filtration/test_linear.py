"""The linear filter: its transmission, missing pixels, borders, spacing, and what it returns."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.data import peaks
from tsplinejax.filtration import spline_filter
from tsplinejax.surface import heights_on_grid

CUTOFF = 16.0


def definition(wavelength):
    """ISO 16610-62: one half at the cut-off."""
    return 1 / (1 + (CUTOFF / wavelength) ** 4)


@pytest.mark.parametrize("spacing", [(1.0, 1.0), (1.0, 1.7)])
def test_transmission_is_the_definition(spacing):
    """From a quarter to four times the cut-off, in four directions and eight phases, also over oblong pixels."""
    lengths = CUTOFF * np.array([0.25, 0.4, 0.5, 0.7, 1.0, 1.5, 2.5, 4.0])
    curve = tsj.transmission(
        lambda data: tsj.filter(data, cutoff=CUTOFF),
        lengths,
        spacing=spacing,
        directions=(0, 17, 45, 90),
        phases=8,
        margin=2 * CUTOFF,
    )
    assert curve.ratios.shape == (1, 8, 4, 8)
    off = np.abs(curve.ratios[0] - definition(lengths)[:, None, None])
    assert off.max() < 0.02


def test_the_map_is_the_surface():
    """The filtered heights are those of the T-spline, residual and filtered map are the data, and statistics agree."""
    data = peaks((50, 70), noise=0.02)
    data = tsj.HeightMap(data.heights, (0.5, 0.8), "µm", origin=(3.0, -2.0))
    filtered = tsj.filter(data, cutoff="8um")
    np.testing.assert_allclose(heights_on_grid(filtered.surface, data.shape), filtered.filtered.heights, atol=1e-10)
    np.testing.assert_allclose(filtered.filtered.heights + filtered.residual.heights, data.heights, atol=1e-12)
    assert filtered.sq_removed == pytest.approx(np.std(filtered.residual.heights))
    assert filtered.max_error == pytest.approx(np.abs(filtered.residual.heights).max())
    assert (filtered.filtered.spacing, filtered.filtered.unit, filtered.filtered.origin) == ((0.5, 0.8), "µm", (3, -2))
    assert filtered.operations == ("filter smoothing T-spline, cut-off 8 µm",)
    assert filtered.filtered.provenance["operations"] == list(filtered.operations)
    assert (filtered.converged, filtered.stop, filtered.tolerance) == (True, None, None)


def test_units_do_not_matter():
    """A map in metres, far from zero, is filtered as the same in nanometres."""
    heights = peaks((40, 50), noise=0.02).heights
    small = tsj.filter(tsj.HeightMap(heights, 500.0, "nm"), cutoff="5um")
    large = tsj.filter(tsj.HeightMap(1e-9 * heights + 1e-3, 5e-7, "m"), cutoff="5um")
    np.testing.assert_allclose(1e9 * (large.filtered.heights - 1e-3), small.filtered.heights, atol=2e-6)


def test_planes_pass():
    """Bending costs, tilt does not: a plane passes unchanged, at the border and around holes, too."""
    y, x = np.mgrid[0:40, 0:60]
    heights = 3.0 + 0.2 * x - 0.1 * y
    heights[10:20, 30:40] = np.nan
    filtered = tsj.filter((heights, 1.0, 2.0), cutoff=30.0)
    np.testing.assert_allclose(filtered.filtered.heights, heights, atol=1e-7)


def test_missing_pixels_weigh_nothing():
    """A hole stays missing, and what is far from it does not feel it; wild heights under the mask change nothing."""
    data = tsj.HeightMap(peaks((80, 90), noise=0.05).heights, 1.0, "µm")
    mask = np.zeros(data.shape, bool)
    mask[30:40, 35:50] = True
    whole, holed = tsj.filter(data, cutoff=8.0), tsj.filter(data.with_mask(mask), cutoff=8.0)
    assert np.array_equal(np.isnan(holed.filtered.heights), mask)
    far = np.ones(data.shape, bool)
    far[14:56, 19:66] = False
    np.testing.assert_allclose(holed.filtered.heights[far], whole.filtered.heights[far], atol=2e-3 * data.range)
    assert np.isfinite(heights_on_grid(holed.surface, data.shape)).all()


def test_a_small_problem_against_a_dense_solve():
    """Conjugate gradients give the minimum that a dense solve gives, holes and oblong pixels included."""
    from tsplinejax.filtration._lattice import smoother

    data = peaks((14, 17), noise=0.1).heights.copy()
    data[3:6, 4:9] = np.nan
    height_map = tsj.HeightMap(data, (0.7, 1.1), "mm")
    equations = smoother(height_map, (5, 4), 0.3)
    points, rest = equations.solve(np.nan_to_num(data))
    assert rest < 1e-10
    y, x = equations.y, equations.x
    design = np.kron(y.values.toarray(), x.values.toarray())[height_map.valid.ravel()]
    energy = np.kron(y.bending.toarray(), x.mass.toarray()) + np.kron(y.mass.toarray(), x.bending.toarray())
    energy += 2 * np.kron(y.slope.toarray(), x.slope.toarray())
    dense = np.linalg.solve(design.T @ design + 0.3 * energy, design.T @ data[height_map.valid])
    np.testing.assert_allclose(points.ravel(), dense, atol=1e-8)


def test_finest_spacing_limits_the_lattice():
    """Elements are no smaller than asked for; with a cut-off they are its lattice, and too coarse ones are refused."""
    data = tsj.HeightMap(peaks((60, 81)).heights, 1.0, "µm")
    filtered = tsj.filter(data, finest_spacing=9.0)
    boxes = filtered.surface.space.mesh.element_boxes
    sizes = (boxes[:, 2:] - boxes[:, :2]) * data.extent
    assert sizes.min() >= 9.0
    assert filtered.cutoff is None
    both = tsj.filter(data, cutoff=40.0, finest_spacing=9.0)
    assert both.control_points == filtered.control_points
    with pytest.raises(tsj.InputError, match="a quarter of it"):
        tsj.filter(data, cutoff=20.0, finest_spacing=9.0)


def test_pixel_knots_agree():
    """The spline with a knot a pixel and ours are the same filter, away from the border, to 1 % of the range."""
    data = tsj.HeightMap(peaks((90, 100), noise=0.05).heights, (1.0, 1.2), "µm")
    ours, theirs = tsj.filter(data, cutoff=12.0).filtered.heights, spline_filter(data, 12.0).heights
    inside = (slice(15, -15), slice(15, -15))
    assert np.abs(ours - theirs)[inside].max() < 0.01 * data.range


def test_single_precision():
    """float32 data stay float32."""
    data = tsj.HeightMap(peaks((40, 40)).heights.astype(np.float32), 1.0, "µm")
    filtered = tsj.filter(data, cutoff=10.0)
    assert filtered.filtered.heights.dtype == filtered.residual.heights.dtype == np.float32
    double = tsj.filter(data.with_heights(data.heights.astype(float)), cutoff=10.0)
    np.testing.assert_allclose(filtered.filtered.heights, double.filtered.heights, atol=1e-5)


BAD = {
    "cloud": (np.ones((9, 3)), {"tolerance": 1.0}, "works on a height map"),
    "bare": (np.ones((20, 20)), {"cutoff": 5.0}, "--spacing, --unit"),
    "bare spacing": (np.ones((20, 20)), {"finest_spacing": 5.0}, "--spacing, --unit"),
    "short": ((np.ones((20, 20)), 0.5, 0.5), {"cutoff": 0.5}, "between two pixels and the map"),
    "fine": ((np.ones((20, 20)), 0.5, 0.5), {"finest_spacing": 0.1}, "between a pixel and the map"),
    "both": (np.ones((20, 20)), {"tolerance": 1.0, "relative_tolerance": 0.1}, "at most one"),
    "zero": (np.eye(20), {"tolerance": 0.0}, "above zero"),
    "flat": (np.ones((20, 20)), {"relative_tolerance": 0.1}, "surface is constant"),
    "missing": (np.full((20, 20), np.nan), {"tolerance": 1.0}, "missing"),
    "no noise": (np.ones((20, 20)), {}, "give a tolerance"),
}


@pytest.mark.parametrize("case", BAD)
def test_refusals(case):
    """What cannot be filtered, or not so, is refused with the rule and the remedy."""
    data, options, message = BAD[case]
    with pytest.raises(tsj.InputError, match=message):
        tsj.filter(data, **options)


def test_filled_pixels_stay_marked():
    """What was filled in before filtering is no measured height after it."""
    filled = np.zeros((40, 48), bool)
    filled[5:9, 7:12] = True
    data = tsj.HeightMap(peaks((40, 48)).heights, 1.0, "µm", filled=filled)
    filtered = tsj.filter(data, cutoff=CUTOFF)
    for made in (filtered.filtered, filtered.residual, spline_filter(data, CUTOFF), tsj.mra(data, levels=2).fitted):
        np.testing.assert_array_equal(made.filled, filled)
