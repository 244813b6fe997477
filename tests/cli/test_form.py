"""`tsplinejax form`: arrays, the JSON object, options, exit codes, and that nothing is written on failure."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.data import saddle_with_texture

KEYS = {
    "sq_texture",
    "sa_texture",
    "max_error",
    "control_points",
    "edf",
    "conformality",
    "outliers",
    "normal",
    "cutoff_estimate",
    "absorbed_share",
    "operations",
    "seconds",
    "tolerance",
    "rms_error",
    "range",
    "unit",
    "warnings",
    "provenance",
}


@pytest.fixture
def dome(tmp_path) -> tsj.HeightMap:
    """A dome of radius 20 µm with fine waves, unequal spacing and missing corners, written as `dome.npz`."""
    x, y = np.meshgrid((np.arange(60) - 30) * 0.1, (np.arange(50) - 25) * 0.12)
    heights = np.sqrt(400 - x**2 - y**2) + 0.01 * np.cos(9 * x)
    heights[np.hypot(x, y) > 3.2] = np.nan
    height_map = tsj.HeightMap(heights, (0.1, 0.12), "µm")
    tsj.write(tmp_path / "dome.npz", height_map)
    return height_map


@pytest.fixture
def saddle(tmp_path) -> tsj.PointCloud:
    """A textured saddle, written as `saddle.npy`."""
    cloud = saddle_with_texture((30, 30))
    np.save(tmp_path / "saddle.npy", cloud.points)
    return cloud


def test_a_map_gives_arrays_report_and_model(command, report, dome, tmp_path):
    """Arrays in the order of valid samples, a map on the input's own pixels, every key, and the same as Python."""
    result = report("form", "dome.npz", "-o", "out.npz", "--method", "normal", "--model", "form.tspl")
    assert set(result) >= KEYS
    with np.load("out.npz") as arrays:
        held = dict(arrays)
    m = int(dome.valid.sum())
    shapes = {name: array.shape for name, array in held.items()}
    assert shapes == {
        "points": (m, 3),
        "parameters": (m, 2),
        "form_points": (m, 3),
        "texture": (m,),
        "texture_map": dome.shape,
    }
    np.testing.assert_array_equal(held["texture_map"][dome.valid], held["texture"])
    assert np.isnan(held["texture_map"][~dome.valid]).all()
    np.testing.assert_allclose(held["points"][:, 2], dome.heights[dome.valid])
    removal = tsj.remove_form(dome, method="normal")
    np.testing.assert_allclose(removal.texture, held["texture"], atol=1e-12)
    assert result["sq_texture"] == pytest.approx(removal.sq_texture)
    assert (result["control_points"], result["unit"], result["outliers"]) == (36, "µm", 0)
    assert tsj.load("form.tspl").control_points.shape == (36, 3)


def test_a_cloud_has_no_map(report, saddle):
    """A cloud gives its arrays alone; the normal is the side that was asked for."""
    words = ("form", "saddle.npy", "-o", "out.npz", "--lattice", "4x3", "--method", "parametric")
    result = report(*words, "--outward", "0,0,-1")
    with np.load("out.npz") as arrays:
        assert set(arrays) == {"points", "parameters", "form_points", "texture"}
        np.testing.assert_array_equal(arrays["points"], saddle.points)
        off = arrays["points"] - arrays["form_points"]
        assert abs(np.corrcoef(np.linalg.norm(off, axis=1), np.abs(arrays["texture"]))[0, 1]) > 0.5
    assert result["control_points"] == 42
    assert result["normal"][2] < -0.9
    assert result["conformality"] is None


def test_round_apertures(report, dome, tmp_path):
    """A map with missing corners and a round cloud, by the default method: the waves are what is left."""
    points = dome.samples().frame.xy_of(dome.samples().parameters)
    np.save(tmp_path / "round.npy", np.column_stack([points, dome.samples().values]))
    for name in ("dome.npz", "round.npy"):
        result = report("form", name, "-o", "out.npz")
        assert result["sq_texture"] == pytest.approx(0.01 / np.sqrt(2), rel=0.08)
        assert result["max_error"] < 0.03


def test_operations_in_order(report, dome):
    """S-filter, levelling, form and L-filter are listed in this order, with their numbers."""
    words = ("--s-filter", "0.4um", "--level", "sphere", "--l-filter", "3um", "--method", "height")
    result = report("form", "dome.npz", "-o", "out.npz", *words)
    starts = [line.split(",")[0].split(" 16610")[0] for line in result["operations"]]
    assert starts[0] == "S-filter Gaussian ISO"
    assert starts[1].startswith("F-operation sphere")
    assert starts[2] == "F-operation T-spline"
    assert starts[3] == "L-filter Gaussian ISO"


def test_simple_forms_and_picture(command, report, dome, tmp_path):
    """A sphere as the form, with a picture; a model of it there is not."""
    result = report("form", "dome.npz", "-o", "out.npz", "--form", "sphere", "--plot", "form.png")
    assert (tmp_path / "form.png").read_bytes().startswith(b"\x89PNG")
    assert (result["control_points"], result["edf"], result["cutoff_estimate"]) == (None, 4, None)
    code, out, err = command("form", "dome.npz", "-o", "o.npz", "--form", "sphere", "--model", "m.tspl")
    assert (code, out) == (2, "")
    assert "a model holds a T-spline" in err


def test_a_tolerance_that_is_not_met(command, dome, tmp_path):
    """Arrays are written, `converged` is false and the exit code is 1; one that is met gives 0."""
    words = ("form", "dome.npz", "-o", "out.npz", "--method", "height", "--robust")
    assert command(*words, "--tolerance", "40nm")[0] == 0
    heights = dome.heights.copy()
    heights[::7, ::5] += 0.3
    tsj.write(tmp_path / "rough.npz", dome.with_heights(heights))
    code, out, _ = command("form", "rough.npz", "-o", "rough_out.npz", "--method", "height", "--tolerance", "1e-6")
    assert code == 1
    assert "not met" in out
    assert (tmp_path / "rough_out.npz").exists()


def test_summary_for_people(command, dome):
    """Without `--json` a few lines say form, texture and where it went."""
    code, out, _ = command("form", "dome.npz", "-o", "out.npz", "--form", "sphere")
    assert code == 0
    assert "radius 20" in out
    assert "texture" in out
    assert "out.npz" in out


BAD = {
    "bare": (("form", "bare.npy", "-o", "o.npz"), "--spacing, --unit"),
    "suffix": (("form", "dome.npz", "-o", "o.npy"), "use one of the suffixes .npz"),
    "method": (("form", "dome.npz", "-o", "o.npz", "--method", "guess"), "--method"),
    "both": (("form", "dome.npz", "-o", "o.npz", "--tolerance", "1", "--lattice", "3x3"), "not allowed with"),
    "level": (("form", "dome.npz", "-o", "o.npz", "--level", "cone"), "polyN"),
    "outward": (("form", "dome.npz", "-o", "o.npz", "--outward", "up"), "a direction of three numbers"),
    "cloud filter": (("form", "saddle.npy", "-o", "o.npz", "--s-filter", "1"), "works on a height map"),
    "input": (("form", "none.npy", "-o", "o.npz"), "none.npy"),
    "itself": (("form", "dome.npz", "-o", "dome.npz"), "would be lost"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_use(command, dome, saddle, tmp_path, case):
    """Exit code 2, one line on standard error, nothing on standard output, nothing written."""
    np.save(tmp_path / "bare.npy", np.random.default_rng(0).normal(size=(30, 20)))
    words, message = BAD[case]
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert message in err
    assert not (tmp_path / "o.npz").exists()
