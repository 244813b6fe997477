"""`tsplinejax fit`: the model, the JSON object, exit codes, and that nothing is written on failure."""

import json
import os
import signal

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.cli import _fit
from tsplinejax.fitting import StopReason, _run

KEYS = {
    "control_points",
    "elements",
    "steps",
    "converged",
    "stop",
    "tolerance",
    "max_error",
    "rms_error",
    "snr_db",
    "snr_db_centred",
    "range",
    "unit",
    "noise",
    "outliers",
    "seconds",
    "warnings",
    "history",
}
STEP_KEYS = {"control_points", "max_error", "rms_error", "objective", "seconds"}


def test_json_has_every_key(report, height_map):
    """The object tells what was asked, what came out, and how."""
    result = report("fit", "map.npz", "-o", "model.tspl", "--tolerance", "50nm")
    assert set(result) >= KEYS
    assert all(set(step) >= STEP_KEYS for step in result["history"])
    assert (result["tolerance"], result["unit"], result["stop"]) == (0.05, "µm", "tolerance")
    assert result["max_error"] <= 0.05
    assert result["samples"] == int(height_map.valid.sum())
    assert result["steps"] == len(result["history"]) - 1
    assert result["provenance"]["input"]["name"] == "map.npz"
    assert len(result["provenance"]["input"]["sha256"]) == 64


def test_model_is_that_of_python(report, height_map):
    """The command line and the library give the same bits."""
    report("fit", "map.npz", "-o", "model.tspl", "--tolerance", "0.05", "--lattice", "6x4", "--first-cut", "t")
    result = tsj.fit(height_map, tolerance=0.05, lattice=(6, 4), first_cut="t")
    loaded = tsj.load("model.tspl")
    np.testing.assert_array_equal(loaded.control_points, result.surface.control_points)
    assert loaded.frame == height_map.frame


def test_same_input_gives_same_bytes(report, height_map, tmp_path):
    """Fitting twice writes the same file."""
    for name in ("a.tspl", "b.tspl"):
        report("fit", "map.npz", "-o", name, "--relative-tolerance", "1%")
    assert (tmp_path / "a.tspl").read_bytes() == (tmp_path / "b.tspl").read_bytes()


def test_summary_for_people(command, height_map):
    """Without `--json` a few lines say the resolved tolerance with its unit, and where the model is."""
    code, out, err = command("fit", "map.npz", "-o", "model.tspl", "--tolerance", "50nm")
    assert (code, err) == (0, "")
    assert "tolerance 50 nm: met" in out
    assert "model.tspl" in out


def test_stopping_earlier_is_exit_code_1(command, height_map, tmp_path):
    """The model is written, `converged` is false, and the warning names the error left."""
    code, out, err = command("fit", "map.npz", "-o", "m.tspl", "--tolerance", "1e-6", "--max-steps", "1", "--json")
    result = json.loads(out)
    assert (code, result["converged"], result["stop"]) == (1, False, "max_steps")
    assert (tmp_path / "m.tspl").exists()
    assert "max_steps" in err
    assert err.count("\n") == len(result["warnings"])


def test_infinity_is_null(report, tmp_path):
    """A surface reproduced to the last bit has an infinite SNR, which JSON does not know."""
    np.save(tmp_path / "flat.npy", np.zeros((20, 30)))
    text = json.dumps(report("fit", "flat.npy", "-o", "flat.tspl", "--tolerance", "1"))
    assert "Infinity" not in text
    assert "NaN" not in text


def test_robust_and_level(report, height_map, tmp_path):
    """A tilted map with spikes: the plane is taken off, said in the operations, and the spikes are counted."""
    tilted = height_map.heights + 3.0 * np.arange(50)
    tilted[[5, 30], [7, 40]] += 500
    tsj.write(tmp_path / "tilted.npz", height_map.with_heights(tilted))
    options = ("--robust", "--level", "plane", "--tolerance", "0.1")
    result = report("fit", "tilted.npz", "-o", "model.tspl", *options)
    assert result["outliers"] == 2
    assert result["range"] < 60
    assert "level plane: slopes 6" in result["provenance"]["input"]["operations"][0]


def test_shared_options(report, height_map, tmp_path):
    """Spacing, units, mask and crop reach the fit and are listed as operations."""
    np.save(tmp_path / "bare.npy", height_map.heights * 1000)
    np.save(tmp_path / "mask.npy", np.eye(40, 50))
    options = ("--spacing", "0.5,0.25", "--unit", "um", "--height-unit", "nm", "--mask", "mask.npy")
    result = report("fit", "bare.npy", "-o", "m.tspl", *options, "--crop", "1,1,20,9", "--tolerance", "0.1")
    assert result["unit"] == "µm"
    assert len(result["provenance"]["input"]["operations"]) == 2
    frame = tsj.load("m.tspl").frame
    assert (frame.origin, frame.extent) == ((1.0, 1.0), (19.0, 8.0))


def test_clouds(report, cloud):
    """A cloud is fitted as z over (x, y), or in space when asked."""
    heights = report("fit", "cloud.npy", "-o", "h.tspl", "--relative-tolerance", "0.02")
    points = report("fit", "cloud.npy", "-o", "p.tspl", "--relative-tolerance", "0.02", "--as-surface")
    assert tsj.load("h.tspl").is_height_map
    assert not tsj.load("p.tspl").is_height_map
    assert points["range"] == pytest.approx(cloud.diagonal)
    assert heights["range"] == pytest.approx(np.ptp(cloud.points[:, 2]))


def test_methods(report, height_map):
    """Refinement, solver and precision reach the fit; dyadic with local is the paper's algorithm."""
    words = ("--refinement", "dyadic", "--solver", "local", "--dtype", "float32", "--smoothing", "1e-9")
    options = report("fit", "map.npz", "-o", "m.tspl", "--tolerance", "0.3", *words)["provenance"]["options"]
    assert options["refinement"].startswith("Dyadic")
    assert options["solver"].startswith("LocalSolver(ring=0")
    assert (options["dtype"], options["smoothing"]) == ("float32", 1e-9)


def test_picture(report, height_map, tmp_path):
    """`--plot` draws the overview."""
    result = report("fit", "map.npz", "-o", "m.tspl", "--tolerance", "0.3", "--plot", "m.png")
    assert result["plot"] == "m.png"
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("interruptible")
def test_interrupting_writes_the_best_model(command, height_map, monkeypatch, tmp_path):
    """Ctrl-C ends the fit with the best step so far: the model is written and the exit code is 1."""
    steps = []

    def interrupting(*arguments, _advance=_run.advance):
        steps.append(1)
        if len(steps) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return _advance(*arguments)

    monkeypatch.setattr(_run, "advance", interrupting)
    code, out, _ = command("fit", "map.npz", "-o", "m.tspl", "--tolerance", "1e-4", "--json")
    assert (code, json.loads(out)["stop"]) == (1, "interrupted")
    assert (tmp_path / "m.tspl").exists()


def test_nothing_is_fitted_for_an_output_that_cannot_be_written(command, height_map, monkeypatch):
    """Missing folders are refused before the fit, not after it."""
    monkeypatch.setattr(_fit, "fit", lambda *_, **__: pytest.fail("fitted all the same"))
    for words in (("-o", "none/m.tspl"), ("-o", "m.tspl", "--plot", "none/m.png")):
        code, out, err = command("fit", "map.npz", *words)
        assert (code, out) == (2, "")
        assert "does not exist; create it first" in err


def test_stop_reasons_are_words():
    """The words of `stop` are those of the conventions."""
    words = {"tolerance", "noise", "finest", "max_steps", "max_control_points", "max_seconds", "interrupted"}
    assert {str(reason) for reason in StopReason} == words
