"""`evaluate`, `info`, `convert`, `plot` and `demo`: what they write and what they say."""

import json

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.cli import _demo
from tsplinejax.data import peaks

TOLERANCE = 0.05


@pytest.fixture(scope="module")
def fitted(surfaces):
    """A fit of the map, and one of the cloud in space."""
    height_map, cloud = surfaces
    return tsj.fit(height_map, tolerance=TOLERANCE), tsj.fit(cloud, relative_tolerance=0.02, as_surface=True)


@pytest.fixture
def model(height_map, fitted, tmp_path):
    """A model of the map, saved as `model.tspl`."""
    tsj.save(tmp_path / "model.tspl", fitted[0])
    return fitted[0]


@pytest.fixture
def model_in_space(cloud, fitted, tmp_path):
    """A model of the cloud in space, saved as `space.tspl`."""
    tsj.save(tmp_path / "space.tspl", fitted[1])
    return fitted[1]


def test_evaluate_like_the_input_meets_the_tolerance(report, model, height_map):
    """On the input's pixels, holes included: within the tolerance of every valid one."""
    result = report("evaluate", "model.tspl", "--like", "map.npz", "-o", "out.npy")
    heights = np.load("out.npy")
    assert heights.shape == height_map.shape
    assert np.isfinite(heights).all()
    assert np.abs(heights - height_map.heights)[height_map.valid].max() <= TOLERANCE
    assert result["max_error"] == pytest.approx(model.max_error, rel=1e-6)
    assert result["rms_error"] == pytest.approx(model.rms_error, rel=1e-6)


def test_evaluate_beyond_the_model_is_missing(report, model, height_map, tmp_path):
    """Pixels outside the domain are NaN, and a warning says how many."""
    tsj.write(tmp_path / "other.npz", tsj.HeightMap(np.zeros((5, 60)), (500.0, 250.0), "nm", origin=(3000.0, -2000.0)))
    result = report("evaluate", "model.tspl", "--like", "other.npz", "-o", "out.npy")
    outside = np.isnan(np.load("out.npy"))
    assert outside[:, 50:].all()
    assert not outside[:, :50].any()
    assert "outside" in result["warnings"][0]


def test_evaluate_on_a_grid(report, model):
    """R rows and C columns over the model; formats with a header keep its spacing and unit."""
    report("evaluate", "model.tspl", "--shape", "30x20", "-o", "out.npy")
    assert np.load("out.npy").shape == (30, 20)
    report("evaluate", "model.tspl", "--shape", "40x50", "-o", "out.npz")
    again = tsj.read("out.npz")
    assert again.unit == "µm"
    assert again.origin == (3.0, -2.0)
    np.testing.assert_allclose(again.spacing, (0.5, 0.25), rtol=1e-12)


def test_evaluate_at_parameters(report, model, model_in_space, tmp_path):
    """Heights (m,) of a height map, points (m, 3) of a model in space, at given (s, t)."""
    parameters = np.random.default_rng(0).uniform(size=(1500, 2))
    np.save(tmp_path / "p.npy", parameters)
    for name, fitted in (("model.tspl", model), ("space.tspl", model_in_space)):
        report("evaluate", name, "--parameters", "p.npy", "-o", "out.npy")
        np.testing.assert_allclose(np.load("out.npy"), fitted.surface(parameters), rtol=1e-12, atol=1e-12)


def test_evaluate_a_model_in_space(report, model_in_space):
    """Points on a grid, as an array or as a cloud."""
    report("evaluate", "space.tspl", "--shape", "6x5", "-o", "out.npy")
    assert np.load("out.npy").shape == (30, 3)
    report("evaluate", "space.tspl", "--like", "cloud.npy", "-o", "like.npy")
    assert np.load("like.npy").shape == (800, 3)


def test_evaluate_needs_the_unit_of_the_data(command, model, tmp_path):
    """A bare array is not taken to be in the model's unit."""
    np.save(tmp_path / "bare.npy", np.zeros((40, 50)))
    code, out, err = command("evaluate", "model.tspl", "--like", "bare.npy", "-o", "out.npy")
    assert (code, out) == (2, "")
    assert "give --unit" in err


def test_info_of_data(report, height_map):
    """Everything that helps to pick a tolerance."""
    result = report("info", "map.npz")
    assert (result["kind"], result["shape"], result["unit"]) == ("height map", [40, 50], "µm")
    assert result["spacing"] == [0.5, 0.25]
    assert result["share_valid"] == pytest.approx(height_map.valid.mean())
    assert result["range"] == pytest.approx(height_map.range)
    assert 0 < result["robust_span"] <= result["range"]
    assert set(result["tilt"]) == {"share_of_variance", "slope_x", "slope_y"}
    assert result["noise"] >= 0
    assert result["spikes"] == 0
    assert [entry["name"] for entry in result["suggested_tolerances"]] == ["coarse", "medium", "fine"]
    assert all(entry["control_points"] > 0 for entry in result["suggested_tolerances"])


def test_info_warns_of_tilt_and_spikes(report, height_map, tmp_path):
    """Both make a relative tolerance mean something else than intended."""
    tilted = height_map.heights + 3.0 * np.arange(50)
    tsj.write(tmp_path / "tilted.npz", height_map.with_heights(tilted))
    tilted = height_map.heights.copy()
    tilted[7, 9] = 1000
    tsj.write(tmp_path / "spiky.npz", height_map.with_heights(tilted))
    tilt, spike = report("info", "tilted.npz", "--max-seconds", 0), report("info", "spiky.npz", "--max-seconds", 0)
    assert tilt["tilt"]["slope_x"] == pytest.approx(6.0, rel=0.05)
    assert any("--level" in warning for warning in tilt["warnings"])
    assert spike["spikes"] == 1
    assert any("--robust" in warning for warning in spike["warnings"])


def test_info_of_data_that_cannot_be_fitted(report, tmp_path):
    """A single row, a constant, a map without any height: the rest is told all the same."""
    for heights in (np.zeros((1, 30)), np.ones((20, 30)), np.full((20, 30), np.nan)):
        np.save(tmp_path / "map.npy", heights)
        result = report("info", "map.npy")
        assert result["shape"] == list(heights.shape)
        assert result["suggested_tolerances"] == []
        assert result["warnings"]


def test_info_of_a_cloud(report, cloud):
    """How a file is read is said; `--as` overrides it."""
    assert report("info", "cloud.npy", "--max-seconds", 0)["kind"] == "point cloud"


def test_info_of_a_model(report, command, model):
    """What the model is, its figures, and where it comes from."""
    result = report("info", "model.tspl")
    assert (result["kind"], result["values"], result["unit"]) == ("model", "heights", "µm")
    assert result["control_points"] == model.control_points
    assert (result["tolerance"], result["max_error"]) == (TOLERANCE, model.max_error)
    assert "control points" in command("info", "model.tspl")[1]


@pytest.mark.parametrize("suffix", [".npz", ".csv", ".x3p", ".gwy"])
def test_convert_keeps_everything(report, height_map, suffix):
    """Unit, spacing, holes and orientation survive a format and back."""
    report("convert", "map.npz", f"other{suffix}")
    again = tsj.read(f"other{suffix}", unit="um")
    np.testing.assert_allclose(again.heights, height_map.heights, rtol=1e-6)
    np.testing.assert_allclose(again.spacing, height_map.spacing, rtol=1e-12)


def test_convert_warns_where_something_is_lost(report, height_map):
    """A bare array has neither spacing nor unit."""
    assert "spacing and unit" in report("convert", "map.npz", "bare.npy")["warnings"][0]


@pytest.mark.parametrize("words", [["model.tspl"], ["model.tspl", "--data", "map.npz"], ["cloud.npy"]])
def test_plot(report, model, cloud, words, tmp_path):
    """A model, a model against data, and a cloud are drawn."""
    report("plot", *words, "-o", "a.png")
    content = (tmp_path / "a.png").read_bytes()
    assert content.startswith(b"\x89PNG")
    assert len(content) > 5000


@pytest.mark.parametrize("suffix", [".png", ".pdf", ".svg"])
def test_equal_input_gives_an_equal_picture(report, height_map, suffix, tmp_path):
    """No picture holds a date or a random name."""
    for name in ("a", "b"):
        report("plot", "map.npz", "-o", name + suffix)
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_plot_against_data_tells_the_error(report, model):
    """The error map's largest value is the fit's."""
    result = report("plot", "model.tspl", "--data", "map.npz", "-o", "a.png")
    assert result["max_error"] == pytest.approx(model.max_error, rel=1e-6)


def test_demo(report, command, monkeypatch, tmp_path):
    """Each example leaves a picture, a model and its data; the table tells the error of the model as written."""
    example = _demo.Example("peaks", "Peaks", lambda: peaks((30, 40)), {"tolerance": 0.1})
    monkeypatch.setattr(_demo, "EXAMPLES", (example,))
    result = report("demo", "-o", "deep/er")
    assert {path.name for path in (tmp_path / "deep" / "er").iterdir()} == {"peaks.png", "peaks.tspl", "peaks.npz"}
    assert result["examples"][0]["max_error"] <= 0.1
    code, out, err = command("demo", "-o", "deep/er")
    assert code == 0
    assert "peaks" in out
    assert "Peaks: 30 rows" in err


def test_demo_surfaces_come_with_dependencies():
    """Both real maps are read without a network: one full, one with missing values."""
    fault, motorcycle = (example.read() for example in _demo.EXAMPLES)
    assert fault.unit == "m"
    assert fault.valid.all()
    assert fault.spacing[0] < fault.spacing[1] < 100
    assert 0.9 < motorcycle.valid.mean() < 0.95


def test_json_stands_alone(command, model):
    """Standard output is one JSON object and nothing else, for every command."""
    for words in (
        ("evaluate", "model.tspl", "--shape", "4x5", "-o", "e.npy"),
        ("info", "map.npz"),
        ("convert", "map.npz", "m.csv"),
        ("plot", "map.npz", "-o", "m.png"),
    ):
        out = command(*words, "--json")[1]
        assert out.count("\n") == 1
        assert isinstance(json.loads(out)["warnings"], list)
