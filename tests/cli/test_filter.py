"""`tsplinejax filter`: what is written, the JSON object, options, exit codes, and nothing written on failure."""

import numpy as np
import pytest

import tsplinejax as tsj

KEYS = {
    "output",
    "residual",
    "model",
    "plot",
    "cutoff",
    "tolerance",
    "finest_spacing",
    "sq_removed",
    "sa_removed",
    "max_error",
    "rms_error",
    "range",
    "unit",
    "control_points",
    "stop",
    "converged",
    "operations",
    "warnings",
    "provenance",
    "seconds",
}


def test_a_cutoff(report, height_map, tmp_path):
    """The written map is the one that Python gives; residual, model and picture are written, too."""
    words = ("--cutoff", "4um", "--residual", "rest.npz", "--model", "smooth.tspl", "--plot", "both.png")
    result = report("filter", "map.npz", "-o", "out.npz", *words)
    assert set(result) >= KEYS
    filtered = tsj.filter(height_map, cutoff=4.0)
    written, rest = tsj.read("out.npz"), tsj.read("rest.npz")
    np.testing.assert_allclose(written.heights, filtered.filtered.heights, atol=1e-12)
    np.testing.assert_allclose(written.heights + rest.heights, height_map.heights, atol=1e-12)
    assert (written.spacing, written.unit, written.origin) == (height_map.spacing, "µm", height_map.origin)
    assert result["sq_removed"] == pytest.approx(filtered.sq_removed)
    assert (result["cutoff"], result["tolerance"], result["converged"]) == (4.0, None, True)
    assert result["provenance"]["options"]["cutoff"] == "4um"
    assert tsj.load("smooth.tspl").control_points.shape == (result["control_points"],)
    assert (tmp_path / "both.png").read_bytes().startswith(b"\x89PNG")


def test_a_tolerance(report, command, height_map):
    """The largest error keeps the tolerance; lines for people say so."""
    result = report("filter", "map.npz", "-o", "out.npz", "--relative-tolerance", "10%")
    assert result["max_error"] <= result["tolerance"] == pytest.approx(0.1 * height_map.range)
    assert result["stop"] == "tolerance"
    code, out, _ = command("filter", "map.npz", "-o", "out.npz", "--relative-tolerance", "10%")
    assert code == 0
    assert "met" in out
    assert "edges" in out


def test_a_tolerance_that_is_not_met(command, height_map, tmp_path):
    """The map is written, and the exit code is 1."""
    words = ("filter", "map.npz", "-o", "out.npz", "--tolerance", "1pm", "--max-control-points", "200")
    code, out, _ = command(*words)
    assert code == 1
    assert "not met" in out
    assert (tmp_path / "out.npz").exists()


def test_a_bare_array(report, command, tmp_path):
    """Heights alone can be filtered by height; a length along the surface needs the spacing."""
    np.save(tmp_path / "bare.npy", np.random.default_rng(0).normal(size=(30, 40)))
    assert report("filter", "bare.npy", "-o", "out.npy", "--tolerance", "5")["unit"] is None
    result = report("filter", "bare.npy", "-o", "out.npy", "--cutoff", "8um", "--spacing", "1um", "--unit", "um")
    assert "without spacing" in result["warnings"][-1]


BAD = {
    "bare": (("filter", "bare.npy", "-o", "o.npz", "--cutoff", "8"), "--spacing, --unit"),
    "suffix": (("filter", "map.npz", "-o", "o.png"), "use one of the suffixes"),
    "both": (
        ("filter", "map.npz", "-o", "o.npz", "--tolerance", "1", "--relative-tolerance", "1%"),
        "not allowed with",
    ),
    "cloud": (("filter", "cloud.npy", "-o", "o.npz", "--tolerance", "1"), "point cloud"),
    "cutoff": (("filter", "map.npz", "-o", "o.npz", "--cutoff", "1m"), "between two pixels and the map"),
    "same": (("filter", "map.npz", "-o", "o.npz", "--residual", "o.npz"), "are the same"),
    "itself": (("filter", "map.npz", "-o", "map.npz"), "would be lost"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_use(command, height_map, cloud, tmp_path, case):
    """Exit code 2, one line on standard error, nothing on standard output, nothing written."""
    np.save(tmp_path / "bare.npy", np.random.default_rng(0).normal(size=(30, 20)))
    words, message = BAD[case]
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert message in err
    assert not (tmp_path / "o.npz").exists()
