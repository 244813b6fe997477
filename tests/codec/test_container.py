"""Model files: what is saved is loaded, and nothing else is."""

import json
import subprocess
import sys
import zipfile

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import tsplinejax as tsj
from tsplinejax._errors import InputError
from tsplinejax.codec import load, load_header, save
from tsplinejax.codec._archive import write_archive
from tsplinejax.data import Frame

RECTANGLES = [[0, 0, 0.3, 1], [0.3, 0, 1, 0.6], [0.3, 0.6, 0.7, 1], [0.7, 0.6, 1, 1]]
PARAMETERS = np.random.default_rng(5).uniform(size=(200, 2))


def _mesh(kind):
    if kind == "by hand":
        return tsj.from_rectangles(RECTANGLES)
    mesh = tsj.b_lattice(4, 3, first_cut="t" if kind == "t first" else "s")
    refinement = tsj.Dyadic() if kind == "dyadic" else tsj.AnalysisSuitable()
    for _ in range(4):
        mesh = tsj.refine(mesh, (mesh.element_boxes[:, :2] < 0.2).all(axis=1), refinement).mesh
    return mesh


def _surface(kind="s first", dtype="float64", dimension=1):
    space = tsj.spline_space(_mesh(kind), dtype=dtype)
    shape = (int(space.n_functions), 3)[: 1 + (dimension == 3)]
    points = np.random.default_rng(1).normal(size=shape).astype(dtype)
    return tsj.make_surface(space, points, Frame((-1.5, 2.0), (3.0, 0.1), "mm"))


@pytest.fixture(scope="module")
def result():
    """A small fit to a tolerance."""
    x, y = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 30))
    heights = tsj.HeightMap(np.exp(-20 * ((x - 0.5) ** 2 + y**2)), (0.5, 0.5), "µm", provenance={"name": "bump.npy"})
    return tsj.fit(heights, tolerance="2nm")


@pytest.mark.parametrize("kind", ["s first", "t first", "dyadic", "by hand"])
@pytest.mark.parametrize("dimension", [1, 3])
def test_round_trip_is_exact(tmp_path, kind, dimension, dtype):
    """Values, frame, unit, precision and form come back to the last bit."""
    surface = _surface(kind, dtype, dimension)
    loaded = load(save(tmp_path / "model.tspl", surface))
    assert loaded.frame == surface.frame
    assert repr(loaded) == repr(surface)
    np.testing.assert_array_equal(loaded.control_points, surface.control_points)
    np.testing.assert_array_equal(loaded(PARAMETERS), surface(PARAMETERS))


def test_equal_models_give_equal_bytes(tmp_path, result):
    """Neither time nor file name is in the file, and what was loaded is saved as it was."""
    first, second = save(tmp_path / "a.tspl", result), save(tmp_path / "b.tspl", result)
    assert first.read_bytes() == second.read_bytes()
    again = save(tmp_path / "c.tspl", load(first))
    assert save(tmp_path / "d.tspl", result.surface).read_bytes() == again.read_bytes()


def test_header_tells_the_fit(tmp_path, result):
    """Provenance and the figures of the fit are in the file, infinities as null."""
    header = load_header(save(tmp_path / "a.tspl", result))
    assert (header.kind, header.frame.unit, header.dtype) == ("heights", "µm", "float64")
    assert header.control_points == result.control_points
    assert header.fit["max_error"] == result.max_error
    assert (header.fit["stop"], header.fit["tolerance"], header.fit["noise"]) == ("tolerance", 0.002, None)
    assert header.provenance["input"]["name"] == "bump.npy"


def test_other_precision(tmp_path):
    """`dtype` reads a model in the precision asked for."""
    loaded = load(save(tmp_path / "a.tspl", _surface()), dtype="float32")
    assert loaded.control_points.dtype == np.float32


def test_float64_model_without_x64_names_the_remedy(tmp_path):
    """Where x64 mode is off a float64 model is refused with the line that fixes it, and float32 is accepted."""
    path = save(tmp_path / "a.tspl", _surface())
    code = f"""
import tsplinejax as tsj
print(tsj.load({str(path)!r}, dtype="float32").control_points.dtype)
try: tsj.load({str(path)!r})
except tsj.InputError as error: print(error)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    kind, message = run.stdout.splitlines()
    assert kind == "float32"
    assert message.startswith("a.tspl: ")
    assert "jax.config.update('jax_enable_x64', True)" in message


def test_what_cannot_be_saved(tmp_path, result):
    """Wrong suffix, missing folder, no model, NaN: refused, and nothing is written."""
    surface = _surface()
    broken = tsj.make_surface(surface.space, np.full(surface.control_points.shape, np.nan))
    for path, model, message in [
        ("a.npy", surface, "ends in .tspl"),
        ("none/a.tspl", surface, "does not exist"),
        ("a.tspl", np.zeros(3), "but got ndarray"),
        ("a.tspl", broken, "finite"),
    ]:
        with pytest.raises(InputError, match=message):
            save(tmp_path / path, model)
    assert not list(tmp_path.iterdir())


def _edited(tmp_path, kind="s first", *, header=None, arrays=None):
    """A model file with other header entries or arrays, checksums and all."""
    path = save(tmp_path / "model.tspl", _surface(kind))
    with zipfile.ZipFile(path) as archive:
        entries = json.loads(archive.read("header.json"))
        kept = {name[:-4]: np.load(archive.open(name)) for name in archive.namelist() if name.endswith(".npy")}
    entries |= header or {}
    kept |= {name: change(kept.get(name)) for name, change in (arrays or {}).items()}
    with path.open("wb") as stream:
        write_archive(stream, entries, {name: array for name, array in kept.items() if array is not None})
    return path


def _with(array, index, value):
    array = array.copy()
    array[index] = value
    return array


WRONG = [
    ("s first", {"header": {"format": "other"}}, "no model file"),
    ("s first", {"header": {"version": 2}}, "version 2 .* reads up to 1; update"),
    ("s first", {"header": {"version": True}}, "'version' is True"),
    ("s first", {"header": {"kind": "colours"}}, "'kind' is 'colours'"),
    ("s first", {"header": {"kind": "points"}}, "'control_points' has the shape"),
    ("s first", {"header": {"dtype": "float16"}}, "'dtype' is 'float16'"),
    ("s first", {"header": {"unit": "volt"}}, "not a unit of length"),
    ("s first", {"header": {"origin": [1]}}, "pair of numbers"),
    ("s first", {"header": {"extent": [0, 1]}}, "positive extent"),
    ("s first", {"header": {"lattice": [0, 3]}}, "two counts"),
    ("s first", {"header": {"lattice": [10**9, 10**9]}}, "elements|lattice|order"),
    ("s first", {"header": {"lattice": [3, 4]}}, "elements|lattice|order"),
    ("s first", {"header": {"first_cut": "t"}}, "elements|lattice|order"),
    ("s first", {"header": {"lattice": None}}, "no array 'lines_s'|unknown member"),
    ("s first", {"header": {"control_points": 5}}, "has the shape"),
    ("s first", {"header": {"elements": 10**12}}, "more than"),
    ("s first", {"header": {"provenance": "me"}}, "'provenance' is 'me'"),
    ("s first", {"arrays": {"boxes": lambda b: b[::-1]}}, "order"),
    ("s first", {"arrays": {"boxes": lambda b: b + (1 << 16)}}, "elements|lattice|order"),
    ("s first", {"arrays": {"boxes": lambda b: np.repeat(b[:1], len(b), axis=0)}}, "elements|lattice|order"),
    ("s first", {"arrays": {"boxes": lambda b: _with(b, (0, 0), 1)}}, "elements|lattice|order"),
    ("s first", {"arrays": {"control_points": lambda p: _with(p, 3, np.nan)}}, "NaN or infinity"),
    ("s first", {"arrays": {"control_points": lambda p: None}}, "no array 'control_points'"),
    ("s first", {"arrays": {"lines_s": lambda p: np.zeros(2)}}, "unknown member"),
    ("by hand", {"arrays": {"lines_s": lambda p: p[::-1].copy()}}, "do not rise"),
    ("by hand", {"arrays": {"lines_t": lambda p: _with(p, 1, np.nan)}}, "NaN or infinity"),
    ("by hand", {"arrays": {"boxes": lambda b: b + 5}}, "outside its knot lines"),
    ("by hand", {"arrays": {"boxes": lambda b: np.repeat(b[:1], len(b), axis=0)}}, "fills|overlap"),
]


@pytest.mark.parametrize(
    ("kind", "change", "message"),
    WRONG,
    ids=[f"{k}-{next(iter(next(iter(case[1].values()))))}" for k, case in enumerate(WRONG)],
)
def test_wrong_contents_are_refused(tmp_path, kind, change, message):
    """Files whose checksums are right but whose contents are not: one line that names the file."""
    path = _edited(tmp_path, kind, **change)
    with pytest.raises(InputError, match=message) as caught:
        load(path)
    assert str(caught.value).startswith("model.tspl")
    assert "\n" not in str(caught.value)


def _uneven_mesh():
    """A large element beside very small ones: the functions of these would cut it into millions of Bézier elements."""
    mesh = tsj.b_lattice(2, 1)
    for _ in range(22):
        mesh = tsj.refine(mesh, mesh.element_boxes[:, 0] == 0.5, tsj.Dyadic()).mesh
    return mesh


def test_meshes_that_take_any_memory_are_refused(tmp_path):
    """Small files whose meshes ask for gigabytes of tables; they are told before these are made."""
    mesh, many = _uneven_mesh(), np.linspace(0, 1, 3000)
    header = {"lattice": [2, 1], "elements": mesh.n_elements, "control_points": mesh.n_anchors}
    arrays = {"boxes": mesh.boxes.astype(np.int32), "control_points": np.zeros(mesh.n_anchors)}
    with pytest.raises(InputError, match="Bézier elements"):
        load(_edited(tmp_path, header=header, arrays={name: lambda _, new=new: new for name, new in arrays.items()}))
    with pytest.raises(InputError, match="index cells"):
        load(_edited(tmp_path, "by hand", arrays={"lines_s": lambda _: many, "lines_t": lambda _: many}))


@pytest.fixture(scope="module")
def bytes_of(tmp_path_factory):
    """The bytes of a model file."""
    path = save(tmp_path_factory.mktemp("model") / "model.tspl", _surface())
    return path.read_bytes()


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(share=st.floats(0, 1, exclude_max=True))
def test_truncated_files_are_refused(tmp_path, bytes_of, share):
    """A file cut off anywhere is one clear line."""
    path = tmp_path / "model.tspl"
    path.write_bytes(bytes_of[: int(share * len(bytes_of))])
    with pytest.raises(InputError, match=r"model\.tspl"):
        load(path)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_flipped_bits_are_found_or_harmless(tmp_path, bytes_of, place, bit):
    """After any flipped bit the file is refused with one line, or holds the same model (time stamps do not matter)."""
    content = bytearray(bytes_of)
    content[int(place * len(content))] ^= 1 << bit
    path = tmp_path / "model.tspl"
    path.write_bytes(content)
    message = _message(load, path)
    if message is None:
        np.testing.assert_array_equal(load(path).control_points, _surface().control_points)
    else:
        assert "model.tspl" in message
        assert "\n" not in message


def _message(verb, *arguments):
    """The text of the `InputError` that a call raises, if any."""
    try:
        verb(*arguments)
    except InputError as error:
        return str(error)
    return None
