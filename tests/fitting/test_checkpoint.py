"""Checkpoints: a stopped fit goes on to the same bits; files that are damaged or of another fit are refused."""

import shutil
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax import InputError
from tsplinejax.fitting import FitResult, Step, StopReason, _checkpoint, _run, advance, begin, pose_fit
from tsplinejax.fitting._adaptive import revived
from tsplinejax.fitting._checkpoint import Checkpoint
from tsplinejax.mesh import Dyadic

from .surfaces import bump, random_surface


def holed() -> np.ndarray:
    """Heights with a hole."""
    heights = bump(90, 110)
    heights[30:50, 40:70] = np.nan
    return heights


def sheet() -> np.ndarray:
    """Scattered points on a sheet."""
    x, y = np.random.default_rng(0).random((2, 3000))
    return np.stack([x + 0.05 * np.sin(6 * y), y, np.sin(7 * x * y)], axis=1)


def noisy() -> np.ndarray:
    """Heights with noise."""
    return bump() + 0.02 * np.random.default_rng(0).normal(size=(60, 80))


def stored() -> tsj.StoredMap:
    """Heights that stay where they are, of which one page does not hold all."""
    heights = bump(60, 700)
    heights[20:30, 100:130] = np.nan
    return tsj.StoredMap(heights)


WEIGHTS = np.random.default_rng(1).uniform(0.2, 2, 3000)
PAPER = {"refinement": Dyadic(), "solver": tsj.LocalSolver(ring=0)}
FITS = {
    "local": (bump, {"tolerance": 1e-4}),
    "global": (bump, {"tolerance": 1e-3, "solver": tsj.GlobalSolver(), "first_cut": "t", "lattice": (5, 4)}),
    "hole, spikes": (holed, {"tolerance": 1e-3, "robust": True}),
    "in space": (sheet, {"tolerance": 1e-3, "as_surface": True, "weights": WEIGHTS}),
    "noise": (noisy, {"noise": 0.02}),
    "stored": (stored, {"tolerance": 1e-3, "max_memory": 2e8}),
    "float32": (bump, {"tolerance": 1e-3, "dtype": "float32"}),
    "dyadic": (lambda: random_surface(4)[0], {"tolerance": 0.5, "max_steps": 3, **PAPER}),
    "best not last": (lambda: random_surface(5)[0], {"tolerance": random_surface(5)[1] / 4, "max_steps": 4, **PAPER}),
}


def assert_same(found: FitResult, expected: FitResult) -> None:
    """Two results equal to the bit, times apart."""
    for name in ("stop", "control_points", "max_error", "smoothing", "warnings", "provenance"):
        assert getattr(found, name) == getattr(expected, name)
    np.testing.assert_array_equal(found.surface.control_points, expected.surface.control_points)
    np.testing.assert_array_equal(found.surface.space.mesh.boxes, expected.surface.space.mesh.boxes)
    if expected.at_samples is not None:
        np.testing.assert_array_equal(found.residuals, expected.residuals)
    assert untimed(found.history) == untimed(expected.history)


def untimed(history: tuple[Step, ...]) -> list[Step]:
    """Steps without what is no result: seconds."""
    return [replace(step, seconds=0.0, stages={}) for step in history]


@pytest.fixture
def path(tmp_path) -> Path:
    """Where the checkpoint is kept."""
    return tmp_path / "fit.ckpt"


@pytest.fixture(scope="module")
def kept(tmp_path_factory) -> Path:
    """The checkpoint of `bump()` to 1e-4 after three steps."""
    file = tmp_path_factory.mktemp("kept") / "fit.ckpt"
    tsj.fit(bump(), tolerance=1e-4, max_steps=3, checkpoint=file)
    return file


@pytest.mark.parametrize("case", FITS)
def test_a_stopped_fit_goes_on_to_the_same_bits(case, path, monkeypatch):
    """Stopped after every single step and taken up again, a fit ends as one that was never stopped."""
    make, options = FITS[case]
    whole = tsj.fit(make(), **options)
    last = whole.history[-1].step
    assert last > 1
    tsj.fit(make(), **{**options, "max_steps": 0}, checkpoint=path)
    monkeypatch.setattr(_run, "begin", lambda _: pytest.fail("began anew"))
    for step in range(1, last):
        part = tsj.fit(make(), **{**options, "max_steps": step}, checkpoint=path)
        assert (part.history[-1].step, path.exists()) == (step, True)
    for _ in ("the rest", "the end, once more"):
        assert_same(tsj.fit(make(), **options, checkpoint=path), whole)
        assert path.exists()


def test_the_best_step_is_kept_beside_the_last(path):
    """Where a later step is worse, the file holds both, and the result is the better one."""
    make, options = FITS["best not last"]
    result = tsj.fit(make(), **options, checkpoint=path)
    errors = [step.max_error for step in result.history]
    assert result.max_error == min(errors) < errors[-1]
    with np.load(path) as arrays:
        assert len(arrays["best_coefficients"]) == result.control_points
        assert len(arrays["last_coefficients"]) == result.history[-1].control_points > result.control_points
    assert_same(tsj.fit(make(), **options, checkpoint=path), result)


@pytest.mark.parametrize("raised", [KeyboardInterrupt, RuntimeError])
def test_an_interrupted_fit_goes_on(raised, path, monkeypatch):
    """Ctrl-C and exceptions, in the middle of a step and with writing long put off, leave the last whole step."""
    whole = tsj.fit(bump(), tolerance=1e-4)

    def failing(problem, state, _advance=advance):
        after = _advance(problem, state)  # the device rows of `state` are used up
        if after.history[-1].step == 4:
            raise raised
        return after

    with monkeypatch.context() as patched:
        patched.setattr(_checkpoint, "SHARE", 1e-9)
        patched.setattr(_run, "advance", failing)
        if raised is KeyboardInterrupt:
            assert tsj.fit(bump(), tolerance=1e-4, checkpoint=path).stop is StopReason.INTERRUPTED
        else:
            with pytest.raises(RuntimeError):
                tsj.fit(bump(), tolerance=1e-4, checkpoint=path)
    problem = pose_fit(bump(), tolerance=1e-4)
    states = Checkpoint(path, problem).restored()
    assert states is not None
    assert untimed(states[0].history) == untimed(whole.history[:4])
    assert_same(tsj.fit(bump(), tolerance=1e-4, checkpoint=path), whole)


def test_time_counts_on(kept):
    """A resumed run has the seconds before the interruption behind it, and the budget of seconds sees them."""
    problem = pose_fit(bump(), tolerance=1e-4)
    checkpoint = Checkpoint(kept, problem)
    states = checkpoint.restored()
    assert states is not None
    taken = sum(step.seconds for step in states[0].history)
    assert checkpoint.seconds >= taken > 0
    result = tsj.fit(bump(), tolerance=1e-4, max_seconds=taken, checkpoint=kept)
    assert (result.stop, len(result.history)) == (StopReason.MAX_SECONDS, 4)
    assert result.seconds > taken


def test_a_state_without_rows_is_revived(kept):
    """The best state of a file, whose rows nobody needs until the end, measures as the one that was kept."""
    problem = pose_fit(bump(), tolerance=1e-4)
    early = begin(problem)
    again = revived(problem, early)
    late = advance(problem, early)
    with Checkpoint(kept.with_name("two.ckpt"), problem) as checkpoint:
        checkpoint.keep(late, early)
    states = Checkpoint(kept.with_name("two.ckpt"), problem).restored()
    assert states is not None
    assert states[0].alive
    assert not states[1].alive
    assert states[1].worst == again.worst
    best = revived(problem, states[1])
    np.testing.assert_array_equal(best.excess, again.excess)
    assert untimed(best.history) == untimed(again.history)


OTHERS = {
    "values": {"data": bump() + 1e-12},
    "start lattice": {"lattice": (7, 8)},
    "first cut": {"first_cut": "t"},
    "tolerance": {"tolerance": 2e-4},
    "smoothing": {"smoothing": 1e-3},
    "solver": {"solver": tsj.LocalSolver(ring=2)},
    "refinement": {"refinement": Dyadic(), "smoothing": None},
    "weights": {"weights": np.full((60, 80), 2.0)},
    "frame": {"data": tsj.HeightMap(bump(), (1.0, 2.0))},
    "grid": {"data": replace(tsj.HeightMap(bump()).samples(), grid_shape=None, grid_index=None)},
    "parameters": {"data": replace(tsj.HeightMap(bump()).samples(), parameters=np.full((4800, 2), 0.5))},
    "dtype": {"dtype": "float32"},
}


@pytest.mark.parametrize("name", OTHERS)
def test_another_fit_is_refused(name, kept):
    """Other data or options are named, with the remedy, and the file stays as it is."""
    before = kept.read_bytes()
    options = {"data": bump(), "tolerance": 1e-4, **OTHERS[name]}
    if name == "refinement":  # alone: by default it brings another smoothing
        options["smoothing"] = pose_fit(bump(), tolerance=1e-4).smoothing
    with pytest.raises(InputError, match=rf"its {name} (is|are) .*; give the same data and options"):
        tsj.fit(options.pop("data"), **options, checkpoint=kept)
    assert kept.read_bytes() == before


def test_outliers_and_noise_belong_to_the_fit(path):
    """Samples set aside make another fit of the same values, and so does another noise."""
    heights = bump()
    heights[20, 30] += 5
    tsj.fit(heights, tolerance=1e-3, max_steps=1, checkpoint=path)
    with pytest.raises(InputError, match="its outliers are others"):
        tsj.fit(heights, tolerance=1e-3, robust=True, checkpoint=path)
    path.unlink()
    tsj.fit(heights, noise=0.01, max_steps=1, checkpoint=path)
    with pytest.raises(InputError, match=r"its noise is .*sigma=0\.01.*, here .*sigma=0\.02"):
        tsj.fit(heights, noise=0.02, checkpoint=path)


def test_stored_maps_are_told_apart(path, monkeypatch):
    """A stored map is known by its heights, however many bands they are read in, and is not the same map in memory."""
    monkeypatch.setattr(_checkpoint, "BAND", 7 * 700)
    options = {"tolerance": 1e-3, "max_steps": 1, "checkpoint": path}
    tsj.fit(stored(), **options)
    assert len(tsj.fit(stored(), **options).history) == 2
    other = stored()
    other.heights[57, 3] += 1e-9
    for data in (other, tsj.HeightMap(stored().heights)):
        with pytest.raises(InputError, match="its values are others"):
            tsj.fit(data, **options)


def test_budgets_may_differ(kept, path):
    """More control points are allowed the second time."""
    shutil.copy(kept, path)
    more = tsj.fit(bump(), tolerance=1e-4, max_control_points=400, checkpoint=path)
    assert more.stop is StopReason.MAX_CONTROL_POINTS
    assert tsj.fit(bump(), tolerance=1e-4, max_control_points=2000, checkpoint=path).converged


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.9, 0.999])
def test_truncated_files_are_refused(share, kept, path):
    """A file cut anywhere is named with the remedy, and is not touched."""
    part = kept.read_bytes()[: int(share * kept.stat().st_size)]
    path.write_bytes(part)
    with pytest.raises(InputError, match=r"fit\.ckpt cannot be read as a checkpoint: .*delete it to begin anew"):
        tsj.fit(bump(), tolerance=1e-4, checkpoint=path)
    assert path.read_bytes() == part


def test_altered_bytes_are_refused_or_harmless(kept, path):
    """Wherever a byte of the file is altered, the state is refused or the very one that was kept."""
    problem, sound = pose_fit(bump(), tolerance=1e-4), kept.read_bytes()
    expected = Checkpoint(kept, problem).restored()
    assert expected is not None
    refused = 0
    for place in np.linspace(0, len(sound) - 1, 200).astype(int):
        damaged = bytearray(sound)
        damaged[place] ^= 0x41
        path.write_bytes(damaged)
        try:
            states = Checkpoint(path, problem).restored()
        except InputError:
            refused += 1
            continue
        assert states is not None
        np.testing.assert_array_equal(states[0].coefficients, expected[0].coefficients)
        assert states[0].history == expected[0].history
    assert refused > 150


def _altered(kept: Path, path: Path, **entries: object) -> None:
    """The file with other arrays in it: `None` takes one out."""
    with np.load(kept) as arrays:
        parts = {**arrays, **entries}
    with path.open("wb") as stream:
        np.savez(stream, **{name: part for name, part in parts.items() if part is not None})


@pytest.mark.parametrize("name", ["last_boxes", "last_slots", "last_coefficients", "header"])
@pytest.mark.parametrize("kind", ["missing", "short", "objects", "of words", "zero", "huge"])
def test_sound_archives_with_wrong_parts_are_refused(name, kind, kept, path):
    """Every array is checked for its type, its size and its sense."""
    with np.load(kept) as arrays:
        part = arrays[name]
    zero = np.full_like(part, np.nan) if part.dtype.kind == "f" else part * 0
    others = {
        "missing": None,
        "short": part[:-1],
        "objects": np.array([print, 1], object),
        "of words": np.array(["a", "b"]),
        "zero": zero,
        "huge": np.full_like(part, np.inf if part.dtype.kind == "f" else np.iinfo(part.dtype).max),
    }
    _altered(kept, path, **{name: others[kind]})
    with pytest.raises(InputError, match="cannot be read as a checkpoint"):
        tsj.fit(bump(), tolerance=1e-4, checkpoint=path)


def test_declared_sizes_are_not_trusted(kept, path):
    """A small archive that unpacks to much, or declares much, is refused before memory is taken."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("header.npy", bytes(1 << 22))
    with pytest.raises(InputError, match="compressed"):
        tsj.fit(bump(), tolerance=1e-4, checkpoint=path)
    with zipfile.ZipFile(kept) as archive, zipfile.ZipFile(path, "w") as other:
        for name in archive.namelist():
            other.writestr(name, archive.read(name).replace(b"'shape': (", b"'shape': (9"))
    with pytest.raises(InputError, match="does not hold the numbers"):
        tsj.fit(bump(), tolerance=1e-4, checkpoint=path)


def test_other_files_are_left_alone(path):
    """A map, or a text, under the checkpoint's name is neither read, nor overwritten, nor removed."""
    other = path.with_suffix(".npz")
    for write in (lambda: tsj.write(other, bump()), lambda: other.write_text("a")):
        write()
        before = other.read_bytes()
        with pytest.raises(InputError, match="another file"):
            tsj.fit(bump(), tolerance=1e-2, checkpoint=other)
        assert other.read_bytes() == before


def test_misuse(path):
    """A missing folder, several runs with one checkpoint, and batches are refused before anything is fitted."""
    for wrong in (path / "none" / "fit.ckpt", path.parent):
        with pytest.raises(InputError, match="a checkpoint is a file in a folder"):
            tsj.fit(bump(), checkpoint=wrong)
    with pytest.raises(InputError, match="lattice='auto' makes several"):
        tsj.fit(bump(), lattice="auto", checkpoint=path)
    with pytest.raises(InputError, match="fit_batch makes many"):
        tsj.fit_batch([bump()], checkpoint=path)
    assert not path.exists()


def test_writing_takes_a_tenth_of_the_time(path, monkeypatch):
    """By a clock on which writing takes 9 s and a step 1 s, nine tenths of the time are left to the steps."""
    clock, writes = [0.0], []
    problem = pose_fit(bump(), tolerance=1e-4)
    state = begin(problem)

    def slow(*_, **__):
        clock[0] += 9
        writes.append(clock[0])

    monkeypatch.setattr(_checkpoint, "time", SimpleNamespace(perf_counter=lambda: clock[0]))
    monkeypatch.setattr(np, "savez", slow)
    checkpoint = Checkpoint(path, problem)
    with checkpoint:
        for _ in range(1000):
            clock[0] += 1
            checkpoint.keep(state, state)
    assert 9 * len(writes) <= 0.1 * clock[0] + 18
    assert len(writes) >= 0.9 * 0.1 * clock[0] / 9
    assert writes[-1] == clock[0]  # the last step, on leaving


def test_a_full_disk_does_not_cost_the_fit(path, monkeypatch):
    """A checkpoint that cannot be written is warned of; the fit goes on, and nothing is left behind."""

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    with pytest.warns(RuntimeWarning, match="no checkpoint was written.*No space left"):
        result = tsj.fit(bump(), tolerance=1e-3, checkpoint=path)
    assert result.converged
    assert not list(path.parent.iterdir())
