"""`compress` and `decompress`: the file, the report, and the way back."""

from pathlib import Path

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.codec._drift import heights_and_slopes


def test_there_and_back(report, height_map):
    """Every valid pixel within the bound; the report says what the file is worth."""
    said = report("compress", "map.npz", "-o", "map.tspl", "--relative-tolerance", "1%")
    back = report("decompress", "map.tspl", "-o", "back.npz")
    decoded = tsj.read("back.npz")
    errors = np.abs(decoded.heights - height_map.heights)[height_map.valid]
    bound = 0.01 * height_map.range
    assert said["tolerance"] == back["tolerance"] == pytest.approx(bound)
    assert errors.max() <= bound
    assert said["max_error"] == back["max_error"] == pytest.approx(errors.max(), rel=1e-12)
    assert said["bytes"] == Path("map.tspl").stat().st_size
    assert said["ratio"] == pytest.approx(height_map.heights.nbytes / said["bytes"])
    assert (decoded.unit, decoded.spacing, decoded.origin) == (height_map.unit, height_map.spacing, height_map.origin)
    np.testing.assert_array_equal(decoded.valid, height_map.valid)


def test_drift_is_that_of_the_decoded_map(report, height_map):
    """Sq and Sdq before and after, as shares of themselves."""
    said = report("compress", "map.npz", "-o", "map.tspl", "--max-error", "100nm", "--mode", "grid")
    report("decompress", "map.tspl", "-o", "back.npz")
    before, after = heights_and_slopes(height_map), heights_and_slopes(tsj.read("back.npz"))
    assert said["sq"] == pytest.approx(before[0])
    assert said["sq_drift"] == pytest.approx(after[0] / before[0] - 1)
    assert said["sdq_drift"] == pytest.approx(after[1] / before[1] - 1)


def test_model_is_opened_as_one(report, height_map):
    """With `--mode model` the other commands read the file as a T-spline; a control point would take 24 bytes plain."""
    said = report(
        "compress", "map.npz", "-o", "map.tspl", "--tolerance", "50nm", "--mode", "model", "--plot", "map.png"
    )
    assert said["mode"] == "model"
    assert said["paper_bytes"] == 24 * said["control_points"]
    like = report("evaluate", "map.tspl", "--like", "map.npz", "-o", "out.npy")
    assert like["max_error"] <= 0.05
    assert report("info", "map.tspl")["control_points"] == said["control_points"]


def test_other_grid(report, command, height_map):
    """`--shape` gives rows and columns over the same extent."""
    command("compress", "map.npz", "-o", "map.tspl", "--tolerance", "0.1", "--mode", "grid")
    said = report("decompress", "map.tspl", "-o", "fine.npz", "--shape", "79x99", "--plot", "fine.png")
    assert said["shape"] == [79, 99]
    assert said["max_error"] is None
    assert tsj.read("fine.npz").extent == pytest.approx(height_map.extent)


def test_info_tells_about_pixels(report, height_map):
    """A file without a T-spline is told about, too."""
    said = report("compress", "map.npz", "-o", "map.tspl", "--tolerance", "0")
    told = report("info", "map.tspl")
    assert said["mode"] == told["mode"] == "lossless"
    assert said["max_error"] == 0
    assert told["missing"] == 12


MISUSE = [
    (["compress", "map.npz", "-o", "map.tspl"], "--tolerance"),
    (["compress", "map.npz", "-o", "map.npz", "--tolerance", "1"], "suffix"),
    (["compress", "none.npz", "-o", "map.tspl", "--tolerance", "1"], "does not exist"),
    (["compress", "cloud.npy", "-o", "map.tspl", "--tolerance", "1"], "point cloud"),
    (["compress", "map.npz", "-o", "map.tspl", "--tolerance", "1", "--relative-tolerance", "1%"], "not allowed"),
    (["decompress", "map.npz", "-o", "out.npz"], "compressed"),
]


@pytest.mark.parametrize(("words", "message"), MISUSE, ids=[message for _, message in MISUSE])
def test_misuse_is_one_line(command, height_map, cloud, words, message):
    """Exit code 2, one line on standard error, nothing written."""
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1


def test_bound_that_says_little_warns(report, height_map):
    """Above half the range hardly anything is left of the surface."""
    said = report("compress", "map.npz", "-o", "map.tspl", "--relative-tolerance", "0.6")
    assert "half the range" in said["warnings"][0]
