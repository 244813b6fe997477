"""`tsplinejax mra`: arrays, the JSON object, the picture, and that nothing is written on failure."""

import numpy as np
import pytest

import tsplinejax as tsj

KEYS = {
    "output",
    "bands",
    "levels",
    "leak",
    "sq_fitted",
    "sq_remainder",
    "tolerance",
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
}


def test_bands_and_report(report, height_map, tmp_path):
    """Bands add up to what was fitted, with the remainder to the data; every key; the same as Python."""
    result = report("mra", "map.npz", "-o", "bands.npz", "--levels", "3", "--plot", "bands.png")
    assert set(result) >= KEYS
    with np.load("bands.npz") as arrays:
        held = dict(arrays)
    assert held["bands"].shape == (3, *height_map.shape)
    np.testing.assert_allclose(held["bands"].sum(axis=0), held["fitted"], atol=1e-12 * height_map.range)
    np.testing.assert_allclose(held["fitted"] + held["remainder"], height_map.heights, atol=1e-12 * height_map.range)
    analysis = tsj.mra(height_map, levels=3)
    assert [band["sq"] for band in result["bands"]] == pytest.approx([band.sq for band in analysis.bands])
    assert held["wavelengths"].tolist() == [[band.shortest, band.longest] for band in analysis.bands]
    assert result["bands"][0]["longest"] is None
    assert result["leak"] <= 1e-8
    assert (tmp_path / "bands.png").read_bytes().startswith(b"\x89PNG")


def test_adaptive_bands(command, height_map):
    """A tolerance refines where it is needed; lines for people name every band."""
    code, out, _ = command("mra", "map.npz", "-o", "bands.npz", "--relative-tolerance", "5%", "--levels", "3")
    assert code in (0, 1)
    assert "band 0" in out
    assert "remainder" in out


BAD = {
    "suffix": (("mra", "map.npz", "-o", "o.npy"), "use one of the suffixes .npz"),
    "levels": (("mra", "map.npz", "-o", "o.npz", "--levels", "20"), "smaller than a pixel"),
    "cloud": (("mra", "cloud.npy", "-o", "o.npz"), "point cloud"),
    "itself": (("mra", "map.npz", "-o", "map.npz"), "would be lost"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_use(command, height_map, cloud, tmp_path, case):
    """Exit code 2, one line on standard error, nothing on standard output, nothing written."""
    words, message = BAD[case]
    code, out, err = command(*words)
    assert (code, out) == (2, "")
    assert message in err
    assert not (tmp_path / "o.npz").exists()
