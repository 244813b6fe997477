"""The conventions a metrologist relies on: invariances, exact reproduction, awkward maps, and physical places."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax import HeightMap, InputError, PointCloud
from tsplinejax.fitting import StopReason

SHAPE, SPACING = (72, 96), (1.5, 1.0)


def _surface(kind: str) -> np.ndarray:
    """Three structures: a smooth bump, a ring rim around a dimple, and a crease across a waviness."""
    t, s = np.meshgrid(np.linspace(0, 1, SHAPE[0]), np.linspace(0, 1, SHAPE[1]), indexing="ij")
    if kind == "bump":
        return np.exp(-((s - 0.31) ** 2 + (t - 0.57) ** 2) / 0.013) + 0.1 * np.sin(5 * s + t)
    if kind == "rim":
        r = np.hypot(s - 0.43, 0.7 * (t - 0.37))
        return np.exp(-(((r - 0.2) / 0.06) ** 2)) - 0.4 * np.exp(-((r / 0.07) ** 2))
    return np.sqrt((s + 0.6 * t - 0.71) ** 2 + 1e-3) + 0.05 * np.cos(6 * t)


KINDS = pytest.mark.parametrize("kind", ["bump", "rim", "crease"])
OPTIONS = {"relative_tolerance": 5e-3, "lattice": (12, 6)}


def fitted(heights: np.ndarray, spacing=SPACING, unit: str | None = None, **options) -> tsj.FitResult:
    """A fit with this module's options."""
    result = tsj.fit(HeightMap(heights, spacing, unit), **{**OPTIONS, **options})
    assert result.converged
    return result


def boxes(result: tsj.FitResult) -> set[tuple[float, ...]]:
    """The elements of a result's mesh, in parameters."""
    return {tuple(np.round(box, 9)) for box in result.surface.space.mesh.element_boxes}


def surface_map(result: tsj.FitResult) -> np.ndarray:
    """The fitted heights at the pixels."""
    return result.samples.scatter(np.asarray(result.surface(result.samples.parameters)))


@KINDS
def test_mirrored(kind):
    """A map mirrored in x, or in y, gives the mirrored mesh and the mirrored surface."""
    heights = _surface(kind)
    plain = fitted(heights)
    for axis, swap in (
        (1, lambda b: (1 - b[2], b[1], 1 - b[0], b[3])),
        (0, lambda b: (b[0], 1 - b[3], b[2], 1 - b[1])),
    ):
        mirrored = fitted(np.flip(heights, axis))
        assert {tuple(np.round(swap(box), 9)) for box in boxes(mirrored)} == boxes(plain)
        np.testing.assert_allclose(np.flip(surface_map(mirrored), axis), surface_map(plain), atol=1e-7)


@KINDS
def test_transposed(kind):
    """A transposed map, with the other direction cut first, gives the transposed mesh and surface."""
    heights = _surface(kind)
    plain = fitted(heights)
    turned = fitted(heights.T, SPACING[::-1], lattice=(6, 12), first_cut="t")
    assert {(b[1], b[0], b[3], b[2]) for b in boxes(turned)} == boxes(plain)
    np.testing.assert_allclose(surface_map(turned).T, surface_map(plain), atol=1e-7)


@KINDS
def test_units(kind):
    """In nanometres instead of metres: the same mesh, and heights a thousand million times as large."""
    heights = _surface(kind) * 1e-6
    metres = fitted(heights, (1.5e-6, 1e-6), "m")
    nanometres = fitted(heights * 1e9, (1.5e3, 1e3), "nm")
    assert boxes(metres) == boxes(nanometres)
    np.testing.assert_allclose(surface_map(metres) * 1e9, surface_map(nanometres), atol=1e-7 * nanometres.range)
    assert metres.max_error * 1e9 == pytest.approx(nanometres.max_error, rel=1e-6)
    assert metres.smoothing == pytest.approx(nanometres.smoothing)


@KINDS
def test_scaled_heights(kind):
    """Heights alone times a factor: the same mesh and the scaled surface."""
    plain, scaled = fitted(_surface(kind)), fitted(1e5 * _surface(kind))
    assert boxes(plain) == boxes(scaled)
    np.testing.assert_allclose(surface_map(scaled), 1e5 * surface_map(plain), atol=1e-3)


@KINDS
def test_offset(kind):
    """A datum of a million times the range changes the surface by that datum alone."""
    plain, offset = fitted(_surface(kind)), fitted(_surface(kind) + 1e6)
    assert boxes(plain) == boxes(offset)
    np.testing.assert_allclose(surface_map(offset) - 1e6, surface_map(plain), atol=1e-7)


@KINDS
def test_precision(kind):
    """float32 metres give nearly the float64 mesh, meet the same tolerance, and stay in float32."""
    heights = _surface(kind) * 1e-6
    double = fitted(heights, (1.5e-6, 1e-6), "m")
    single = fitted(heights.astype(np.float32), (1.5e-6, 1e-6), "m")
    assert single.surface.space.dtype == np.float32
    assert single.control_points == pytest.approx(double.control_points, rel=0.02)
    assert single.max_error <= single.tolerance
    np.testing.assert_allclose(surface_map(single), surface_map(double), atol=1e-2 * double.range)


@KINDS
def test_the_default_lattice_is_physical(kind):
    """Without a lattice given, elements are near square in space, whatever the spacing."""
    for spacing in ((1.0, 1.0), (4.0, 1.0), (1.0, 3.0)):
        data = HeightMap(_surface(kind), spacing)
        lattice = tsj.fit(data, relative_tolerance=0.1).surface.space.mesh.forest.lattice
        sides = np.array(data.extent) / lattice
        assert 0.66 < sides[0] / sides[1] < 1.5


POLYNOMIALS = {
    "constant": lambda s, t: np.full_like(s, 3.7),
    "plane": lambda s, t: 2 * s - 3 * t + 1,
    "quadratic": lambda s, t: s**2 - 0.7 * s * t + 0.3 * t**2 + s,
}


@pytest.mark.parametrize("name", POLYNOMIALS)
@pytest.mark.parametrize("hole", [False, True])
def test_polynomials_are_reproduced(name, hole):
    """Constants, planes and quadratics come out to 1e-10 up to the border, with missing pixels, too."""
    t, s = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 57), indexing="ij")
    heights = POLYNOMIALS[name](s, t)
    if hole:
        heights = np.where(np.hypot(s - 0.4, t - 0.6) < 0.15, np.nan, heights)
    result = tsj.fit(heights, tolerance=1e-11, smoothing=0.0)
    edge = np.linspace(0, 1, 33)
    rim = np.concatenate(
        [np.stack(np.broadcast_arrays(*pair), 1) for k in (0.0, 1.0) for pair in ((edge, k), (k, edge))]
    )
    np.testing.assert_allclose(result.surface(rim), POLYNOMIALS[name](*rim.T), atol=1e-10)
    assert np.abs(result.residuals).max() < 1e-10


@pytest.mark.parametrize("name", POLYNOMIALS)
def test_polynomials_with_the_default_smoothing(name):
    """The default trace of smoothing leaves constants and planes to 1e-10, and every tolerance reachable."""
    t, s = np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 57), indexing="ij")
    result = tsj.fit(POLYNOMIALS[name](s, t), tolerance=1e-8)
    assert result.converged
    if name != "quadratic":
        assert np.abs(result.residuals).max() < 1e-10


def test_axes():
    """Row index is y, column index is x: heights at pixel centres come back at x = j dx, y = i dy."""
    heights = _surface("rim")
    result = tsj.fit(HeightMap(heights, (1.5, 1.0), "µm", origin=(100.0, -50.0)), relative_tolerance=1e-3)
    for i, j in ((0, 0), (10, 70), (71, 95), (40, 3)):
        value = float(result.surface.at(100 + 1.5 * j, -50 + 1.0 * i))
        assert abs(value - heights[i, j]) <= result.tolerance * (1 + 1e-9)
    assert np.isnan(result.surface.at(99.9, -50.0))


def test_one_missing_row():
    """A row of NaN is bridged, not filled with anything in the data: residuals are those of the measured pixels."""
    heights = _surface("bump")
    gap = heights.copy()
    gap[30] = np.nan
    result = tsj.fit(gap, tolerance=2e-3)
    assert result.converged
    assert len(result.residuals) == gap.size - gap.shape[1]
    assert np.isnan(result.samples.scatter(result.residuals)[30]).all()
    t, s = 30 / 71, np.linspace(0, 1, 96)
    bridged = np.asarray(result.surface(np.stack([s, np.full(96, t)], axis=1)))
    assert np.abs(bridged - heights[30]).max() < 0.02


def test_almost_everything_missing():
    """With one pixel in a hundred left, the fit meets the tolerance there and stays within the heights' reach.

    The default budget of half the samples is kept and told; a larger one must be asked for.
    """
    heights = _surface("bump")
    sparse = np.where(np.random.default_rng(0).random(heights.shape) < 0.01, heights, np.nan)
    guarded = tsj.fit(sparse, tolerance=5e-3)
    assert guarded.stop is StopReason.MAX_CONTROL_POINTS
    assert "max_control_points" in guarded.warnings[-1]
    result = tsj.fit(sparse, tolerance=5e-3, max_control_points=2000)
    assert result.converged
    everywhere = np.asarray(result.surface(tsj.HeightMap(heights).samples().parameters))
    low, high = np.nanmin(sparse), np.nanmax(sparse)
    assert low - (high - low) < everywhere.min()
    assert everywhere.max() < high + (high - low)


def test_two_islands():
    """Two islands of data far apart are both fitted; what lies between stays smooth and bounded."""
    heights = _surface("rim")
    islands = np.full_like(heights, np.nan)
    islands[:25, :30], islands[-20:, -35:] = heights[:25, :30], heights[-20:, -35:] + 2
    result = tsj.fit(islands, tolerance=5e-3)
    assert result.converged
    everywhere = np.asarray(result.surface(tsj.HeightMap(heights).samples().parameters))
    assert np.isfinite(everywhere).all()
    spread = np.nanmax(islands) - np.nanmin(islands)
    assert np.ptp(everywhere) < 3 * spread


def test_a_single_row_is_refused():
    """A 1 × N map has no extent along y: refused, naming the direction."""
    with pytest.raises(InputError, match="along y"):
        tsj.fit(np.ones((1, 40)), tolerance=0.1)


def test_a_long_narrow_map():
    """2000 × 40 pixels: elements stay near square, the tolerance is met."""
    t, s = np.meshgrid(np.linspace(0, 50, 2000), np.linspace(0, 1, 40), indexing="ij")
    heights = np.sin(0.7 * t) * (1 + 0.3 * s) + 0.1 * s
    result = tsj.fit(heights, tolerance=1e-2)
    assert result.converged
    columns, rows = result.surface.space.mesh.forest.lattice
    assert rows > 30 * columns
    assert result.control_points < 0.1 * heights.size


def test_masked_arrays_and_masks():
    """A masked array, NaN, and a mask mean the same missing pixels."""
    heights = _surface("bump")
    mask = np.hypot(*np.mgrid[-30:42, -40:56]) < 12
    as_nan = tsj.fit(np.where(mask, np.nan, heights), tolerance=5e-3)
    masked = tsj.fit(np.ma.masked_array(np.where(mask, 99.0, heights), mask), tolerance=5e-3)
    by_mask = tsj.fit(HeightMap(heights, mask=mask), tolerance=5e-3)
    for other in (masked, by_mask):
        np.testing.assert_array_equal(other.residuals, as_nan.residuals)


def test_shuffled_points():
    """The order of a cloud's points does not matter."""
    generator = np.random.default_rng(0)
    x, y = generator.random((2, 2000))
    points = np.stack([3 * x, y, np.sin(4 * x) * np.cos(3 * y)], axis=1)
    order = generator.permutation(2000)
    first, second = (tsj.fit(PointCloud(p), tolerance=2e-3) for p in (points, points[order]))
    assert boxes(first) == boxes(second)
    np.testing.assert_allclose(first.residuals[order], second.residuals, atol=1e-9)


def test_a_map_and_its_points_agree():
    """A height map and the cloud of its pixels give the same surface."""
    heights = _surface("crease")
    y, x = np.mgrid[0 : SHAPE[0], 0 : SHAPE[1]] * np.array([1.0, 1.5])[:, None, None]
    cloud = tsj.fit(np.stack([x.ravel(), y.ravel(), heights.ravel()], axis=1), **OPTIONS)
    np.testing.assert_allclose(
        np.asarray(cloud.surface(cloud.samples.parameters)), surface_map(fitted(heights)).ravel(), atol=1e-8
    )


def test_the_same_input_gives_the_same_model():
    """Two runs agree to the last bit."""
    first, second = (fitted(_surface("rim")) for _ in range(2))
    np.testing.assert_array_equal(first.surface.control_points, second.surface.control_points)
    assert [s.objective for s in first.history] == [s.objective for s in second.history]


def test_signal_to_noise_ratios():
    """Eq. 7 depends on the datum; the centred one does not."""
    plain, offset = fitted(_surface("bump")), fitted(_surface("bump") + 1000.0)
    assert offset.snr_db > plain.snr_db + 30
    assert offset.snr_db_centred == pytest.approx(plain.snr_db_centred, abs=1e-3)


def test_warnings_of_tolerances():
    """A tolerance above half the range, tilt, and spikes are pointed out."""
    heights = _surface("bump")
    t, s = np.meshgrid(np.linspace(0, 1, SHAPE[0]), np.linspace(0, 1, SHAPE[1]), indexing="ij")
    assert any("half the range" in w for w in tsj.fit(heights, tolerance=0.8).warnings)
    assert any("level" in w for w in tsj.fit(heights + 50 * s - 20 * t, tolerance=0.1).warnings)
    spiked = heights.copy()
    spiked[3, 4] = 40
    assert any("robust" in w for w in tsj.fit(spiked, tolerance=0.5, max_steps=1).warnings)


def test_a_tolerance_below_the_noise_is_pointed_out():
    """A tolerance below the estimated noise warns."""
    noisy = _surface("bump") + 0.05 * np.random.default_rng(0).normal(size=SHAPE)
    result = tsj.fit(noisy, tolerance=0.01, max_steps=2)
    assert any("noise" in warning for warning in result.warnings)


def test_stop_reasons_are_the_seven_words():
    """The reasons to stop, as the command line prints them, each with a sentence."""
    words = ["tolerance", "noise", "finest", "max_steps", "max_control_points", "max_seconds", "interrupted"]
    assert [str(reason) for reason in StopReason] == words
    assert all(len(reason.message) > 10 for reason in StopReason)
