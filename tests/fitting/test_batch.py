"""Many maps: one factorisation equals as many separate fits, and a batch goes on, in order, without compiling anew."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy.interpolate import BSpline

import tsplinejax as tsj
from tsplinejax import HeightMap, InputError, fit_batch, fit_shared, lstsq
from tsplinejax.data import peaks, plate_with_particles
from tsplinejax.fitting import StopReason, _batch, _design, _shared
from tsplinejax.mesh import Dyadic, b_lattice, refine
from tsplinejax.space import spline_space

from .surfaces import bump
from .test_traces import LEAST_CAPACITY, counted_compilations

ROWS, COLUMNS = 37, 45
WIDTHS = (0.08, 0.1, 0.12, 0.15, 0.2, 0.3, 0.09)


def adapted(rule=None) -> tsj.SplineSpace:
    """A space over a mesh with three random refinements."""
    generator, tmesh = np.random.default_rng(1), b_lattice(4, 3)
    for _ in range(3):
        tmesh = refine(tmesh, generator.random(tmesh.n_elements) < 0.25, rule).mesh
    return spline_space(tmesh)


def stack() -> np.ndarray:
    """Seven maps of differing content."""
    offsets = np.random.default_rng(2).normal(size=(len(WIDTHS), 1, 1))
    return np.stack([bump(ROWS, COLUMNS, width) for width in WIDTHS]) * (1 + offsets) + offsets


def places(valid: np.ndarray) -> np.ndarray:
    """Parameters of the pixels where a map is valid."""
    row, column = np.nonzero(valid)
    return np.stack([column / (valid.shape[1] - 1), row / (valid.shape[0] - 1)], axis=1)


EVERYWHERE = places(np.ones((ROWS, COLUMNS), bool))


@pytest.mark.parametrize("rule", [None, Dyadic()], ids=["polynomial", "rational"])
@pytest.mark.parametrize("smoothing", [0.0, 1e-6])
def test_a_shared_fit_is_that_of_each_map_alone(rule, smoothing):
    """Control points equal `lstsq`'s for every map to 1e-10, with and without smoothing."""
    space, maps = adapted(rule), stack()
    assert space.rational == (rule is not None)
    shared = fit_shared(maps, space, smoothing=smoothing)
    extent = (COLUMNS - 1.0, ROWS - 1.0)
    alone = [lstsq(space, EVERYWHERE, heights.ravel(), smoothing=smoothing, extent=extent) for heights in maps]
    assert shared.control_points.shape == (len(maps), int(space.n_functions))
    np.testing.assert_allclose(shared.control_points, np.stack(alone), atol=1e-10)
    assert (shared.factorisations, shared.warnings) == (1, ())


def test_a_lattice_against_scipy():
    """Over a plain lattice the errors are those of the tensor product of two one-dimensional least-squares fits."""
    maps = stack()
    shared = fit_shared(maps, spline_space(b_lattice(6, 5)), smoothing=0)
    projections = []
    for count, elements in ((ROWS, 5), (COLUMNS, 6)):
        knots = np.concatenate([[0.0] * 3, np.linspace(0, 1, elements + 1), [1.0] * 3])
        basis = BSpline.design_matrix(np.linspace(0, 1, count), knots, 3).toarray()
        projections.append(basis @ np.linalg.pinv(basis))
    errors = projections[0] @ maps @ projections[1] - maps
    np.testing.assert_allclose(shared.max_errors, np.abs(errors).max(axis=(1, 2)), atol=1e-11)
    np.testing.assert_allclose(shared.rms_errors, np.sqrt((errors**2).mean(axis=(1, 2))), atol=1e-11)


def test_errors_are_those_of_the_surfaces():
    """The errors told for each map are what its surface, evaluated at the map's own places, is off by."""
    maps = [HeightMap(heights, (0.5, 0.25), "µm", origin=(3.0, -2.0)) for heights in stack()]
    shared = fit_shared(maps, adapted())
    x, y = np.meshgrid(3.0 + 0.5 * np.arange(COLUMNS), -2.0 + 0.25 * np.arange(ROWS))
    for index, height_map in enumerate(maps):
        errors = np.asarray(shared.surface(index).at(x, y)) - height_map.heights
        assert shared.max_errors[index] == pytest.approx(np.abs(errors).max(), rel=1e-9)
        assert shared.rms_errors[index] == pytest.approx(np.sqrt((errors**2).mean()), rel=1e-9)
    assert shared.surface(-1).unit == "µm"
    assert "7 maps" in repr(shared)
    assert len(shared) == len(maps)


def test_maps_with_equal_masks_share_and_others_do_not():
    """Three masks that alternate take three factorisations, said in a warning, and each map has its own answer."""
    maps, space = stack(), adapted()
    maps[1::3, 5:8, 30:33] = np.nan
    maps[2::3, 20, :] = np.nan
    shared = fit_shared(maps, space, smoothing=0)
    assert shared.factorisations == 3
    assert "3 different masks" in shared.warnings[0]
    for heights, points, error in zip(maps, shared.control_points, shared.max_errors, strict=True):
        valid = np.isfinite(heights)
        alone = lstsq(space, places(valid), heights[valid])
        np.testing.assert_allclose(points, alone, atol=1e-10)
        fitted = np.asarray(tsj.make_surface(space, alone)(places(valid)))
        assert error == pytest.approx(np.abs(fitted - heights[valid]).max(), abs=1e-10)


def test_the_size_of_bands_and_chunks_changes_nothing(monkeypatch):
    """Pixels in small bands, kept or made again, and maps two at a time give the same numbers."""
    maps, space = stack(), adapted()
    maps[3, 4:9, 10:30] = np.nan
    expected = fit_shared(maps, space)
    monkeypatch.setattr(_design, "PLACES_A_BAND", 128)
    monkeypatch.setattr(_shared, "MAPS_AT_A_TIME", 2)
    for kept in (0, 32):
        monkeypatch.setattr(_design, "BANDS_KEPT", kept)
        found = fit_shared(maps, space)
        np.testing.assert_allclose(found.control_points, expected.control_points, atol=1e-10)
        np.testing.assert_allclose(found.max_errors, expected.max_errors, atol=1e-10)
        np.testing.assert_allclose(found.rms_errors, expected.rms_errors, atol=1e-10)


def test_kinds_of_stacks(tmp_path):
    """An array, one mapped from a file, masked arrays and height maps of the same pixels give the same numbers."""
    maps, space = stack(), adapted()
    maps[:, 3, 4] = np.nan
    expected = fit_shared(maps, space).control_points
    np.save(tmp_path / "maps.npy", maps)
    masked = np.ma.masked_invalid(maps)
    for kind in (np.load(tmp_path / "maps.npy", mmap_mode="r"), masked, list(masked), list(map(HeightMap, maps))):
        np.testing.assert_array_equal(fit_shared(kind, space).control_points, expected)


def test_holes_are_filled_smoothly():
    """Pixels missing over many elements are filled with the least bending: a plane goes on as the plane."""
    y, x = np.mgrid[0:ROWS, 0:COLUMNS]
    planes = np.stack([x + 2.0 * y, 30.0 - x])
    maps = planes.copy()
    maps[:, 12:25, 15:30] = np.nan
    shared = fit_shared(maps, spline_space(b_lattice(24, 20)))
    for index, plane in enumerate(planes):
        np.testing.assert_allclose(shared.surface(index)(EVERYWHERE), plane.ravel(), atol=1e-4)


def test_single_precision():
    """A float32 space gives float32 control points near the float64 ones."""
    maps, space = stack(), adapted()
    single = fit_shared(maps.astype(np.float32), spline_space(space.mesh, dtype="float32"))
    assert single.control_points.dtype == np.float32
    np.testing.assert_allclose(single.control_points, fit_shared(maps, space).control_points, atol=1e-4)


def test_further_shared_fits_compile_nothing():
    """Other maps over as many pixels, and over another mesh of the same capacity, run the same kernels."""
    maps = stack()
    fit_shared(maps, adapted())
    with counted_compilations() as events:
        fit_shared(maps[::-1] + 1, adapted())
        fit_shared(maps[:2], spline_space(b_lattice(7, 5)))
    assert not events


def _with(index: tuple, value: float) -> np.ndarray:
    maps = stack()
    maps[index] = value
    return maps


#: A half-plane and one pixel beyond it: samples enough, but not where they are needed.
LOPSIDED = _with(np.s_[:, :, 20:], np.nan)
LOPSIDED[:, 18, 40] = 1.0

BAD_STACKS = {
    "one map": (HeightMap(np.eye(9)), {}, "put it in a list"),
    "a number": (3, {}, "sequence of maps"),
    "none": ([], {}, "at least one map"),
    "an empty array": (np.zeros((0, 5, 5)), {}, "real numbers"),
    "complex": (stack() * 1j, {}, "real numbers"),
    "a cloud": ([np.random.default_rng(0).random((9, 3))], {}, "point cloud"),
    "shapes that differ": ([np.eye(9), np.eye(8)], {}, "over the same pixels"),
    "spacings that differ": ([HeightMap(np.eye(9)), HeightMap(np.eye(9), 2.0)], {}, "over the same pixels"),
    "units that differ": (
        [HeightMap(np.eye(9), 1.0, "nm"), HeightMap(np.eye(9), 1.0, "µm")],
        {},
        "over the same pixels",
    ),
    "infinity": (_with((2, 3, 4), np.inf), {}, "map 2 holds infinite"),
    "nothing valid": (_with((4,), np.nan), {}, "map 4 is missing"),
    "a word for λ": (stack(), {"smoothing": "much"}, "'auto' or a number"),
    "a negative λ": (stack(), {"smoothing": -1.0}, "at least zero"),
    "too few samples": (np.ones((2, 4, 4)), {"smoothing": 0}, "maps 0, 1 do not determine"),
    "samples in the wrong places": (LOPSIDED, {"smoothing": 0}, "do not determine the 99 control points"),
}


@pytest.mark.parametrize("name", BAD_STACKS)
def test_bad_stacks(name):
    """Each misuse of `fit_shared` is refused with the rule that it breaks."""
    maps, options, message = BAD_STACKS[name]
    with pytest.raises(InputError, match=message):
        fit_shared(maps, spline_space(b_lattice(8, 6)), **options)


def test_a_batch_compiles_for_its_first_maps_alone():
    """Six maps of one shape and differing content: nothing is compiled after the first two."""
    jax.clear_caches()
    maps = [bump(48, 56, width) + np.roll(bump(48, 56), 5 * k, axis=1) for k, width in enumerate(WIDTHS[:6])]
    outcomes = fit_batch(maps, tolerance=0.02)
    results = [next(outcomes).result for _ in range(2)]
    with counted_compilations() as events:
        results += [item.result for item in outcomes]
    assert len({result.control_points for result in results}) > 2
    assert not events


def test_a_batch_has_room_for_larger_meshes_than_its_first():
    """A first mesh that nearly fills the least padded length, then larger ones: nothing is compiled after the first."""
    jax.clear_caches()
    maps = [plate_with_particles((96, 96), particles=count, seed=count) for count in (3, 7, 4)]
    outcomes = fit_batch(maps, relative_tolerance=0.01)
    first = next(outcomes).result
    with counted_compilations() as events:
        others = [item.result for item in outcomes]
    assert first.surface.space.capacity == LEAST_CAPACITY < others[0].surface.space.capacity
    assert not events


def test_a_batch_gives_what_separate_fits_give():
    """Results come in the order of the items and to the last bit those of `fit`, whatever an item's kind."""
    items = [peaks((30, 40)), bump(), (bump(), 0.5, 0.25), tsj.PointCloud(np.random.default_rng(0).random((200, 3)))]
    outcomes = list(fit_batch(items, relative_tolerance=0.02, max_steps=2))
    assert [item.index for item in outcomes] == [0, 1, 2, 3]
    for item, source in zip(outcomes, items, strict=True):
        expected = tsj.fit(source, relative_tolerance=0.02, max_steps=2)
        assert (item.error, item.path, item.result.stop) == (None, None, expected.stop)
        np.testing.assert_array_equal(item.result.surface.control_points, expected.surface.control_points)


def test_one_bad_item_does_not_stop_the_others(tmp_path):
    """Files that are missing or bad and maps that cannot be fitted leave their error behind, the rest is fitted."""
    (tmp_path / "junk.x3p").write_bytes(b"junk")
    good = tsj.write(tmp_path / "good.npz", peaks((30, 40)))
    items = [good, tmp_path / "none.npy", np.full((9, 9), np.nan), str(tmp_path / "junk.x3p"), "a", peaks((20, 25))]
    outcomes = list(fit_batch(items, tolerance=0.5))
    assert [item.result is None for item in outcomes] == [False, True, True, True, True, False]
    assert all(isinstance(item.error, InputError) for item in outcomes[1:5])
    assert outcomes[0].result.provenance["input"]["name"] == "good.npz"
    assert (outcomes[0].path, outcomes[2].path) == (good, None)
    assert "does not exist" in repr(outcomes[1])
    assert "FitResult" in repr(outcomes[5])


def test_an_unexpected_error_is_the_items_own():
    """Even a defect in the caller's reader stops only the item that met it."""

    def read(path):
        if path.name == "b":
            raise RuntimeError("defect")
        return peaks((20, 25))

    outcomes = list(fit_batch(["a", "b", "c"], read=read, tolerance=0.5))
    assert [type(item.error) for item in outcomes] == [type(None), RuntimeError, type(None)]


def test_items_wait_for_their_turn():
    """An item is read when its result is asked for: memory holds one at a time."""
    seen = []
    outcomes = fit_batch((seen.append(k) or peaks((20, 25)) for k in range(5)), tolerance=0.5)
    assert seen == []
    next(outcomes)
    assert seen == [0]


def test_an_interrupted_batch_ends(monkeypatch):
    """After a fit that Ctrl-C ended, whose best step is still handed out, no further item is begun."""
    result = tsj.fit(peaks((20, 25)), tolerance=0.5)
    stops = iter([result.stop, StopReason.INTERRUPTED, result.stop])
    monkeypatch.setattr(_batch, "finished", lambda *_, **__: replace(result, stop=next(stops)))
    outcomes = list(fit_batch([peaks((20, 25))] * 3, tolerance=0.5))
    assert [item.result.stop for item in outcomes] == [result.stop, StopReason.INTERRUPTED]


@pytest.mark.parametrize("ended", ["out of memory", "interrupted"])
def test_making_ready_costs_no_result(ended, monkeypatch):
    """Where room for larger meshes cannot be made, results are there all the same; Ctrl-C then ends the batch."""
    rooms, fitted = [], _batch.finished

    def finished(problem, *arguments, **options):
        rooms.append(problem.room)
        if problem.room and ended == "out of memory":
            raise MemoryError
        result = fitted(problem, *arguments, **options)
        return replace(result, stop=StopReason.INTERRUPTED) if problem.room else result

    monkeypatch.setattr(_batch, "finished", finished)
    outcomes = list(fit_batch([plate_with_particles((96, 96), particles=3, seed=3)] * 2, relative_tolerance=0.01))
    assert all(item.result.converged for item in outcomes)
    assert rooms == ([0, 4 * LEAST_CAPACITY, 0] if ended == "out of memory" else [0, 4 * LEAST_CAPACITY])


def test_progress_is_shown_on_standard_error(capsys):
    """A bar counts the items; without it nothing is printed."""
    list(fit_batch([peaks((20, 25))] * 3, tolerance=0.5))
    assert capsys.readouterr() == ("", "")
    list(fit_batch([peaks((20, 25))] * 3, tolerance=0.5, progress=True))
    assert "/3 [" in capsys.readouterr().err


@pytest.mark.parametrize("items", ["map.npy", np.eye(9), HeightMap(np.eye(9)), 3], ids=repr)
def test_one_item_is_no_batch(items):
    """A single map in place of several is refused at once, with what to do."""
    with pytest.raises(InputError, match="put it in a list"):
        fit_batch(items)


def test_unknown_options_are_refused_at_once():
    """A misspelt option is not one error an item."""
    with pytest.raises(InputError, match="tolerence"):
        fit_batch([], tolerence=1.0)
