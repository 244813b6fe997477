"""Bands: they add up, lie in nested spaces, are orthogonal, and hold the waves they say; holes and adaptive meshes."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import tsplinejax as tsj
from tsplinejax.data import peaks
from tsplinejax.filtration._separable import halved_ends, spline_axis


def holed(data: tsj.HeightMap) -> tsj.HeightMap:
    """The map with a hole and with single pixels missing."""
    mask = np.random.default_rng(5).random(data.shape) < 0.05
    mask[20:36, 30:44] = True
    return data.with_mask(mask)


MAPS = {
    "gapless": lambda: peaks((90, 100), noise=0.02),
    "oblong": lambda: tsj.HeightMap(peaks((70, 120), noise=0.02).heights + 50.0, (0.5, 0.8), "µm"),
    "holes": lambda: holed(peaks((90, 100), noise=0.02)),
}
WAYS = {"uniform": {"levels": 4}, "adaptive": {"relative_tolerance": 0.08, "levels": 4}}


@pytest.fixture(scope="module", params=[(name, way) for name in MAPS for way in WAYS], ids="-".join)
def analysis(request) -> tuple[tsj.HeightMap, tsj.Multiresolution]:
    """A map and its bands, uniform and adaptive."""
    name, way = request.param
    data = MAPS[name]()
    return data, tsj.mra(data, **WAYS[way])


def test_bands_add_up(analysis):
    """The sum of the bands is the fitted surface to 1e-12 of the range; the remainder is kept apart."""
    data, found = analysis
    assert found.heights.shape == (len(found), *data.shape)
    off = found.heights.sum(axis=0) - found.fitted.heights
    assert np.nanmax(np.abs(off)) <= 1e-12 * data.range
    np.testing.assert_allclose(found.fitted.heights + found.remainder.heights, data.heights, atol=1e-12 * data.range)
    assert np.array_equal(found.fitted.valid, data.valid)


def test_spaces_are_nested(analysis):
    """Every band is a T-spline whose transfer to the next band's mesh is the same surface to 1e-12."""
    data, found = analysis
    places = np.random.default_rng(0).random((500, 2))
    for band, finer in zip(found.bands, found.bands[1:], strict=False):
        moved = tsj.transfer(band.surface, finer.surface.space.mesh)
        assert np.abs(moved(places) - band.surface(places)).max() <= 1e-12 * max(data.range, np.nanmax(data.heights))
        assert finer.spacing <= band.spacing


def test_bands_are_orthogonal_on_the_samples(analysis):
    """Mean squares add up, and each pair of bands is orthogonal, on the valid pixels."""
    _, found = analysis
    assert found.leak <= 1e-8
    assert abs(found.sq_fitted**2 - sum(band.sq**2 for band in found.bands)) <= 1e-8 * found.sq_fitted**2
    rows = [band.heights.heights[found.fitted.valid] for band in found.bands]
    rows = np.array([row - row.mean() for row in rows])
    products = rows @ rows.T / rows.shape[1]
    assert np.abs(products - np.diag(np.diag(products))).max() <= 1e-8 * found.sq_fitted**2


def test_the_finest_space_is_fitted_by_least_squares(analysis):
    """The remainder is orthogonal to the fitted surface, so that their mean squares are the data's."""
    data, found = analysis
    whole = np.var(data.heights[data.valid])
    assert found.sq_fitted**2 + found.sq_remainder**2 == pytest.approx(whole, rel=1e-8)


def test_two_sines_part():
    """Of a long and a short sine at least 95 % of the energy is in the bands whose wavelengths hold theirs."""
    y, x = np.mgrid[0:256, 0:256] * 1.0
    lengths = (255.0, 8.0)
    waves = [np.sin(2 * np.pi * x / lengths[0] + 0.3), 0.2 * np.sin(2 * np.pi * y / lengths[1] + 1.1)]
    found = tsj.mra(tsj.HeightMap(waves[0] + waves[1], 1.0, "µm"), levels=6)
    own = [next(k for k, band in enumerate(found.bands) if band.shortest < length < band.longest) for length in lengths]
    assert own == [0, 5]
    for wave, k in zip(waves, own, strict=True):
        centred = wave - wave.mean()
        share = np.vdot(found.heights[k], centred) / np.vdot(centred, centred)
        assert share >= 0.95
        alone = tsj.mra(tsj.HeightMap(wave, 1.0, "µm"), levels=6)
        assert alone.bands[k].sq ** 2 >= 0.95 * np.var(wave)


@pytest.mark.parametrize("phase", [0.3, 1.1, 2.6])
@pytest.mark.parametrize(("elements", "least"), [(24, 0.9), (48, 0.95)])
def test_borders_take_little_of_a_short_wave(elements, least, phase):
    """A band in the middle holds a wave of its own nearly up to the borders, whatever its phase."""
    periods = elements / 2.83
    wave = np.sin(2 * np.pi * periods * np.arange(256) / 255 + phase)
    found = tsj.mra(tsj.HeightMap(wave * np.ones((64, 1)), 1 / 255, "mm"), levels=6, lattice=(3, 1))
    own = next(k for k, band in enumerate(found.bands) if len(band.surface.control_points) > elements * elements // 3)
    assert np.var(found.heights[own][0]) >= least * np.var(wave)


def test_wide_ends_are_a_part_of_the_whole_lattice():
    """A spline whose end elements are twice as wide is the one that knot insertion makes of it."""
    equal, wide = spline_axis(65, 0.5, 12), spline_axis(65, 0.5, 12, wide=True)
    change = halved_ends(12)
    assert change.shape == (15, 13)
    np.testing.assert_allclose((equal.values @ change).toarray(), wide.values.toarray(), atol=1e-14)
    np.testing.assert_allclose((change.T @ equal.bending @ change).toarray(), wide.bending.toarray(), atol=1e-12)


@pytest.mark.parametrize("seed", [3, 4])
def test_bands_stay_low_in_holes(seed):
    """No band leaves the range where pixels are missing, though samples see the last tails of functions there."""
    rng = np.random.default_rng(seed)
    texture = gaussian_filter(rng.normal(size=(100, 120)), 5)
    data = peaks((100, 120), noise=0.02).with_mask(texture > np.quantile(texture, 0.6))
    found = tsj.mra(data)
    places = rng.random((5000, 2))
    for band in found.bands:
        assert np.abs(band.surface(places)).max() <= 2 * data.range


@pytest.mark.parametrize("periods", [20, 24, 27, 32])
def test_energy_splits_where_it_is_said(periods):
    """What bands down to elements of size h take of a wave is what cubic splines on an endless lattice take.

    That is B(f)² / Σ B(f + k)² with B = sinc⁴ and f = h / λ: one half at λ = 2 h; borders add a little.
    """
    wave = np.sin(2 * np.pi * periods * np.arange(256) / 255 + 0.7)
    found = tsj.mra(tsj.HeightMap(wave * np.ones((256, 1)), 1 / 255, "mm"), levels=5)
    frequency = found.bands[-1].spacing * periods
    assert frequency == pytest.approx(periods / 48)
    aliases = np.sinc(frequency + np.arange(-4, 5)) ** 8
    share = sum(band.sq**2 for band in found.bands) / np.var(wave)
    assert share == pytest.approx(aliases[4] / aliases.sum(), abs=0.08)


def test_adaptive_bands_meet_the_tolerance():
    """Meshes are refined until the remainder is within the tolerance, with fewer control points than uniform ones."""
    data = tsj.data.sparse_bumps((96, 96))
    found = tsj.mra(data, relative_tolerance=0.05)
    assert found.max_error <= found.tolerance * 1.5
    sizes = [len(band.surface.control_points) for band in found.bands]
    assert sizes == sorted(sizes)
    assert found.bands[0].longest == np.inf


def test_levels_and_lattice():
    """As many bands as asked for, from the lattice asked for; by default down to elements of four pixels."""
    data = peaks((65, 97))
    assert len(tsj.mra(data, levels=1)) == 1
    found = tsj.mra(data, levels=2, lattice=(4, 2))
    assert [len(band.surface.control_points) for band in found.bands] == [7 * 5, 11 * 7]
    finest = tsj.mra(data).bands[-1]
    pixels = min(np.array(data.extent) / (np.array(data.shape[::-1]) - 1))
    assert 4 * pixels <= finest.spacing < 9 * pixels


BAD = {
    "cloud": (np.ones((9, 3)), {}, "bands are of a height map"),
    "levels": (np.ones((30, 30)), {"levels": 0}, "at least 1"),
    "too many": (np.ones((30, 30)), {"levels": 9}, "smaller than a pixel"),
    "both": (np.ones((30, 30)), {"tolerance": 1, "relative_tolerance": 1}, "at most one"),
    "lattice": (np.ones((30, 30)), {"lattice": (0, 3)}, "two whole numbers"),
    "missing": (np.full((30, 30), np.nan), {}, "nothing to analyse"),
}


@pytest.mark.parametrize("case", BAD)
def test_refusals(case):
    """What cannot be taken apart is refused with the rule and the remedy."""
    data, options, message = BAD[case]
    with pytest.raises(tsj.InputError, match=message):
        tsj.mra(data, **options)
