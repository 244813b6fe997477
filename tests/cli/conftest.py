"""What the command line's tests share: small inputs, and a way to run a command in this process."""

import json
import signal
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.cli import main
from tsplinejax.data import peaks


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    """Commands run in a folder of their own, and leave the user's cache alone."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TSPLINEJAX_CACHE", "off")


@pytest.fixture
def interruptible():
    """Ctrl-C interrupts, as in a terminal, where the tests run in the background and would not hear it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def command(capsys) -> Callable[..., tuple[int, str, str]]:
    """Run a command: its exit code, standard output and standard error."""

    def run(*words: object) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main([str(word) for word in words])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture
def report(command) -> Callable[..., dict[str, Any]]:
    """Run a command with `--json` that meets its criterion: the one object on standard output."""

    def run(*words: object) -> dict[str, Any]:
        code, out, err = command(*words, "--json")
        assert code == 0, err
        return json.loads(out)

    return run


@pytest.fixture(scope="session")
def surfaces() -> tuple[tsj.HeightMap, tsj.PointCloud]:
    """A map in micrometres with unequal spacing and a hole, and a cloud of points on a wavy sheet."""
    heights = peaks((40, 50)).heights.copy()
    heights[10:14, 20:23] = np.nan
    plane = np.random.default_rng(3).uniform(size=(800, 2)) * (3.0, 2.0)
    sheet = np.column_stack([plane, np.sin(2 * plane[:, 0])])
    return tsj.HeightMap(heights, (0.5, 0.25), "µm", origin=(3.0, -2.0)), tsj.PointCloud(sheet)


@pytest.fixture
def height_map(surfaces, tmp_path) -> tsj.HeightMap:
    """The map, written as `map.npz`."""
    tsj.write(tmp_path / "map.npz", surfaces[0])
    return surfaces[0]


@pytest.fixture
def cloud(surfaces, tmp_path) -> tsj.PointCloud:
    """The cloud, written as `cloud.npy`."""
    np.save(tmp_path / "cloud.npy", surfaces[1].points)
    return surfaces[1]
