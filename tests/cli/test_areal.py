"""`tsplinejax areal`: ISO names, units, operations, and refusals."""

import numpy as np
import pytest

import tsplinejax as tsj

NAMES = [
    "Sq",
    "Sa",
    "Sz",
    "Sp",
    "Sv",
    "Ssk",
    "Sku",
    "Sdq",
    "Sdr",
    "Sal",
    "Str",
    "Std",
    "Sk",
    "Spk",
    "Svk",
    "Vmp",
    "Vmc",
    "Vvc",
    "Vvv",
]


@pytest.fixture
def waves(tmp_path) -> tsj.HeightMap:
    """Tilted waves 1 µm high and 4 µm long, with missing pixels, written as `waves.npz`."""
    x, y = np.meshgrid(np.arange(120) * 0.2, np.arange(90) * 0.25)
    heights = np.cos(2 * np.pi * x / 4) + 0.5 * x - 0.2 * y
    heights[10:20, 30:34] = np.nan
    height_map = tsj.HeightMap(heights, (0.2, 0.25), "µm")
    tsj.write(tmp_path / "waves.npz", height_map)
    return height_map


def test_keys_are_the_iso_names(report, waves):
    """Every parameter at top level, its unit in `units`, the same values as in Python."""
    result = report("areal", "waves.npz", "--level", "plane")
    assert set(NAMES) <= set(result)
    assert set(result["units"]) >= set(NAMES)
    assert result["units"]["Sq"] == "µm"
    assert result["Sq"] == pytest.approx(1 / np.sqrt(2), rel=5e-3)
    expected = tsj.areal_parameters(tsj.level(waves)).as_dict()
    assert result["Sq"] == pytest.approx(expected["Sq"])
    assert result["operations"][0].startswith("F-operation plane")


def test_operations(report, waves):
    """A wave at the S-filter's cut-off keeps half its height, and the L-filter comes last."""
    plain = report("areal", "waves.npz", "--level", "plane")
    filtered = report("areal", "waves.npz", "--s-filter", "4um", "--level", "plane", "--l-filter", "20um")
    assert filtered["Sq"] / plain["Sq"] == pytest.approx(0.5, rel=0.05)
    assert [line.split()[0] for line in filtered["operations"]] == ["S-filter", "F-operation", "L-filter"]


def test_summary_for_people(command, waves):
    """A line a parameter, with its unit."""
    code, out, _ = command("areal", "waves.npz")
    assert code == 0
    assert any(line.split()[0] == "Sq" and line.endswith("µm") for line in out.splitlines())


def test_refusals(command, waves, cloud, tmp_path):
    """Bare arrays name the options, clouds the way to a map."""
    np.save(tmp_path / "bare.npy", waves.heights)
    for name, message in (("bare.npy", "--spacing"), ("cloud.npy", "form off first")):
        code, out, err = command("areal", name)
        assert (code, out) == (2, "")
        assert message in err
