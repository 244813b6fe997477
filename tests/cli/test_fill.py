"""`fill`: what is written, the report, and that measured pixels stay."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.data import peaks

KEYS = {
    "filled",
    "left",
    "weights",
    "validated_rms",
    "hidden_rms",
    "uncertainty_rms",
    "max_error",
    "rms_error",
    "tolerance",
    "stop",
    "control_points",
    "range",
    "unit",
    "shape",
    "seconds",
    "warnings",
    "provenance",
}


@pytest.fixture
def holed(tmp_path) -> tsj.HeightMap:
    """Peaks in µm with two holes inside and one at the border, written as `holed.npz`."""
    heights = peaks((48, 60)).heights.copy()
    heights[10:15, 20:27] = heights[30:34, 40:44] = heights[:4, :5] = np.nan
    height_map = tsj.HeightMap(heights, (0.1, 0.12), "µm")
    tsj.write(tmp_path / "holed.npz", height_map)
    return height_map


def test_heights_and_filled_are_written(report, holed, tmp_path):
    """The map with its holes filled, a mask of them, every key, and the same as Python."""
    said = report("fill", "holed.npz", "-o", "out.npz", "--plot", "out.png")
    assert set(said) >= KEYS
    with np.load("out.npz") as arrays:
        heights, filled = arrays["heights"], arrays["filled"]
    np.testing.assert_array_equal(heights[holed.valid], holed.heights[holed.valid])
    assert (said["filled"], said["left"]) == (filled.sum(), 20) == (51, 20)
    assert np.isnan(heights[:4, :5]).all()
    np.testing.assert_array_equal(heights, tsj.fill_missing(holed).map.heights)
    assert "--border" in said["warnings"][0]
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")


def test_areal_reads_which_pixels_were_filled(report, holed):
    """`areal` leaves the filled pixels of a filled file out, unless asked."""
    report("fill", "holed.npz", "-o", "out.npz", "--border")
    before = report("areal", "holed.npz")["Sq"]
    assert report("areal", "out.npz")["Sq"] == pytest.approx(before, rel=1e-12)
    assert report("areal", "out.npz", "--include-filled")["Sq"] != pytest.approx(before, rel=1e-6)


def test_exact_writes_a_model(report, holed):
    """A T-spline through every pixel; the pixels that stay missing stay so in the map."""
    said = report("fill", "holed.npz", "-o", "out.npy", "--exact", "--model", "out.tspl")
    assert said["control_points"] == 50 * 62 == len(tsj.load("out.tspl").control_points)
    assert np.isnan(np.load("out.npy")[:4, :5]).all()
    assert any(".npz does" in warning for warning in said["warnings"])


def test_smooth_all_may_miss_its_tolerance(command, report, holed):
    """Every height comes from the fit, whose tolerance and errors are reported; a lost one gives exit code 1."""
    said = report("fill", "holed.npz", "-o", "out.npz", "--smooth-all", "--relative-tolerance", "1%", "--border")
    assert 0 < said["max_error"] <= 1.05 * said["tolerance"]
    assert said["stop"] == "tolerance"


def test_summary_for_people(command, holed):
    """Without `--json` a few lines say how much, by what, how well and where it went."""
    code, out, err = command("fill", "holed.npz", "-o", "out.npz", "--edges")
    assert code == 0
    assert "51 pixels" in out
    assert "rms at" in out
    assert "left" in out
    assert "border" in err


BAD = {
    "model": (("fill", "holed.npz", "-o", "o.npz", "--model", "m.tspl"), "--exact or --smooth-all"),
    "tolerance": (("fill", "holed.npz", "-o", "o.npz", "--tolerance", "1nm"), "smooth_all=True"),
    "both": (("fill", "holed.npz", "-o", "o.npz", "--exact", "--smooth-all"), "give one of the two"),
    "cloud": (("fill", "cloud.npy", "-o", "o.npz"), "--as map"),
    "suffix": (("fill", "holed.npz", "-o", "o.tspl"), "use one of the suffixes"),
    "itself": (("fill", "holed.npz", "-o", "holed.npz"), "would be lost"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_use(command, holed, tmp_path, case):
    """Exit code 2, one line on standard error, nothing on standard output, nothing written."""
    np.save(tmp_path / "cloud.npy", np.random.default_rng(0).normal(size=(30, 3)))
    words, message = BAD[case]
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert message in err
    assert not (tmp_path / "o.npz").exists()
