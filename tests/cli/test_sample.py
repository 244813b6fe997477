"""`tsplinejax sample` and `reconstruct`: arrays, reports, the way back to a map, misuse."""

import hashlib
from pathlib import Path

import numpy as np
import pytest

import tsplinejax as tsj

KEYS = {
    "output",
    "plot",
    "strategy",
    "samples",
    "control_points",
    "tolerance",
    "max_error",
    "rms_error",
    "range",
    "unit",
    "warnings",
    "provenance",
}


@pytest.fixture
def model(height_map) -> tsj.TSpline:
    """A model of the map, written as `model.tspl`."""
    surface = tsj.fit(height_map, relative_tolerance=0.01).surface
    tsj.save("model.tspl", surface)
    return surface


def test_a_map_is_sampled_with_a_model_and_recovered(report, command, height_map, model):
    """The arrays are those of Python, and the map comes back on its own pixels."""
    n = model.control_points.shape[0]
    words = ("sample", "map.npz", "-o", "samples.npz", "--model", "model.tspl", "--size", 2 * n, "--plot", "s.png")
    result = report(*words)
    assert set(result) >= KEYS
    assert (result["samples"], result["control_points"], result["unit"]) == (2 * n, n, "µm")
    expected = tsj.sample(height_map, model=model, size=2 * n)
    with np.load("samples.npz") as held:
        np.testing.assert_array_equal(held["parameters"], expected.parameters)
        np.testing.assert_array_equal(held["values"], expected.values)
        np.testing.assert_array_equal(held["index"], expected.index)
        assert tuple(held["shape"]) == height_map.shape
    back = report("reconstruct", "samples.npz", "--model", "model.tspl", "-o", "back.npz", "--plot", "r.png")
    assert set(back) >= KEYS - {"strategy"}
    surface = tsj.read("back.npz")
    assert (surface.shape, surface.spacing, surface.unit, surface.origin) == (
        height_map.shape,
        pytest.approx(height_map.spacing),
        "µm",
        height_map.origin,
    )
    errors = np.abs(surface.heights - height_map.heights)[height_map.valid]
    assert errors.max() == pytest.approx(result["max_error"], rel=1e-6)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(result["rms_error"], rel=1e-6)
    assert errors.max() < 0.1 * height_map.range
    code, out, _ = command("sample", "map.npz", "-o", "samples.npz", "--model", "model.tspl")
    assert code == 0
    assert f"{n} by greville, 1 a control point" in out


def test_a_model_is_sampled_and_comes_back_exactly(report, model):
    """Sampling a model needs nothing else; the reconstruction is the model."""
    result = report("sample", "model.tspl", "-o", "samples.npz")
    assert result["rms_error"] < 1e-9 * result["range"]
    told = report("reconstruct", "samples.npz", "--model", "model.tspl", "-o", "back.tspl")["provenance"]["input"]
    digests = [hashlib.sha256(Path(name).read_bytes()).hexdigest() for name in ("samples.npz", "model.tspl")]
    assert [told["sha256"], told["model"]["sha256"]] == digests
    np.testing.assert_allclose(tsj.load("back.tspl").control_points, model.control_points, atol=1e-9)
    report("reconstruct", "samples.npz", "--model", "model.tspl", "-o", "back.npy", "--shape", "20x30")
    assert np.load("back.npy").shape == (20, 30)


def test_without_a_model_the_input_is_fitted_first(report, height_map):
    """With the criterion that is given, and a seed that decides over random places."""
    words = ("--strategy", "random", "--size", 300, "--relative-tolerance", "2%")
    result = report("sample", "map.npz", "-o", "a.npz", *words, "--seed", 5)
    fitted = tsj.fit(height_map, relative_tolerance=0.02)
    assert result["control_points"] == fitted.control_points
    report("sample", "map.npz", "-o", "b.npz", *words, "--seed", 6, "--save-model", "fitted.tspl")
    np.testing.assert_array_equal(tsj.load("fitted.tspl").control_points, fitted.surface.control_points)
    with np.load("a.npz") as a, np.load("b.npz") as b:
        expected = tsj.sample(height_map, model=fitted, strategy="random", size=300, rng=5)
        np.testing.assert_array_equal(a["parameters"], expected.parameters)
        assert not np.array_equal(a["index"], b["index"])


def test_a_cloud_over_conformal_parameters(report, command, cloud):
    """Points in space; a model in space comes back as a model alone."""
    result = report("sample", "cloud.npy", "-o", "s.npz", "--parameters", "conformal", "--relative-tolerance", "1%")
    with np.load("s.npz") as held:
        assert held["values"].shape == (result["samples"], 3)
        np.testing.assert_array_equal(held["values"], cloud.points[held["index"]])
    place = tsj.conformal(cloud)
    surface = tsj.fit(tsj.Samples(place.parameters, cloud.points, None, place.frame), relative_tolerance=0.01).surface
    tsj.save("space.tspl", surface)
    report("reconstruct", "s.npz", "--model", "space.tspl", "-o", "back.tspl")
    code, _, err = command("reconstruct", "s.npz", "--model", "space.tspl", "-o", "back.npz")
    assert (code, "points in space" in err) == (2, True)


MISUSE = [
    ("sample map.npz", "required: -o/--output"),
    ("sample map.npz -o s.npy", "use one of the suffixes .npz"),
    ("sample map.npz -o map.npz", "is the input, too"),
    ("sample map.npz -o s.npz --save-model m.npz", "use one of the suffixes .tspl"),
    ("sample map.npz -o s.npz --strategy sobol", "a sampling strategy is one of greville"),
    ("sample map.npz -o s.npz --model model.tspl --size 0", "at least 1"),
    ("sample map.npz -o s.npz --model model.tspl --size 100000", "were measured"),
    ("sample map.npz -o s.npz --model map.npz", "ends in .tspl"),
    ("sample map.npz -o s.npz --model model.tspl --tolerance 5nm", "--tolerance is of a fit"),
    ("sample model.tspl -o s.npz --model model.tspl", "sampled by its own T-mesh"),
    ("sample model.tspl -o s.npz --unit nm", "sampled by its own T-mesh"),
    ("sample map.npz -o s.npz --parameters conformal", "its own x and y"),
    ("sample none.npz -o s.npz", "does not exist"),
    ("reconstruct s.npz -o m.npz", "required: --model"),
    ("reconstruct none.npz --model model.tspl -o m.npz", "does not exist"),
    ("reconstruct map.npz --model model.tspl -o m.npz", "no array named 'parameters'"),
    ("reconstruct few.npz --model model.tspl -o m.npz --smoothing 0", "do not determine"),
    ("reconstruct few.npz --model model.tspl -o m.tspl --shape 5x5", "--shape is of a map"),
    ("reconstruct few.npz --model model.tspl -o m.npz --shape 1x5", "at least 2 rows"),
    ("reconstruct space.npz --model model.tspl -o m.npz", "dimension 3"),
    ("reconstruct unit.npz --model model.tspl -o m.npz", "in nm, the model is in µm"),
    ("reconstruct place.npz --model model.tspl -o m.npz", "another rectangle"),
    ("reconstruct outside.npz --model model.tspl -o m.npz", "in [0, 1]"),
    ("reconstruct few.npz --model model.tspl -o m.doc", "use one of the suffixes"),
]


@pytest.mark.parametrize(("line", "message"), MISUSE, ids=[line for line, _ in MISUSE])
def test_misuse_is_one_clear_line(command, tmp_path, model, line, message):
    """Exit code 2, one line, nothing written."""
    places, values = np.random.default_rng(0).random((9, 2)), np.arange(9.0)
    np.savez("few.npz", parameters=places, values=values)
    np.savez("space.npz", parameters=places, values=np.zeros((9, 3)))
    np.savez("unit.npz", parameters=places, values=values, unit="nm")
    np.savez("place.npz", parameters=places, values=values, origin=[0.0, 0.0], extent=[1.0, 1.0])
    np.savez("outside.npz", parameters=2 * places, values=values)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    code, out, err = command(*line.split())
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert message in err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
