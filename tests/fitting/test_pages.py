"""Fits of maps that stay on disk: page by page, by whoever, they are the fit of the same map in memory."""

import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax import HeightMap, InputError, StoredMap
from tsplinejax.data import laser_textured_disk
from tsplinejax.fitting._pages import most_control_points, page_side

ROOT = Path(__file__).resolve().parents[2]
SPACING = (0.5, 0.25)
BUDGET = 2e8  # pages of 512 pixels: each of the maps has four
MANY = 20_000  # control points: more than that budget allows by itself
KINDS = {
    "complete": {"relative_tolerance": 0.02},
    "missing": {"relative_tolerance": 0.02},
    "coarse": {"relative_tolerance": 0.1},
    "noise": {"noise": 0.3, "smoothing": 1e-9},
    "single": {"relative_tolerance": 0.02, "dtype": "float64"},
    "dyadic": {"relative_tolerance": 0.05, "refinement": tsj.Dyadic()},
}


@cache
def heights_of(kind: str) -> np.ndarray:
    """A map of 700 × 900 pixels with three by three laser bumps."""
    noise = 0.3 if kind == "noise" else 0.0
    heights = laser_textured_disk((700, 900), bumps=3).heights + noise * np.random.default_rng(2).normal(
        size=(700, 900)
    )
    if kind in ("missing", "coarse"):
        v, u = np.mgrid[:700, :900]
        # Scattered pixels, and a hole where four pages meet; small, since within a large one nothing but rounding
        # tells control points apart.
        heights[(np.hypot(v - 512, u - 512) < 12) | ((u + 3 * v) % 11 == 0)] = np.nan
    return heights.astype(np.float32) if kind == "single" else heights


@cache
def in_memory(kind: str) -> tsj.FitResult:
    """The fit that the others are held to."""
    return tsj.fit(HeightMap(heights_of(kind), SPACING, "µm"), **KINDS[kind], max_control_points=MANY)


def stored_as(storage: str, heights: np.ndarray, folder: Path):
    """The same heights somewhere else."""
    if storage == "memmap":
        np.save(folder / "map.npy", heights)
        return np.load(folder / "map.npy", mmap_mode="r")
    if storage == "zarr":
        zarr = pytest.importorskip("zarr")
        array = zarr.create_array(folder / "map.zarr", shape=heights.shape, chunks=(256, 200), dtype=heights.dtype)
        array[:] = heights
        return zarr.open_array(folder / "map.zarr", mode="r")
    if storage == "dask":
        return pytest.importorskip("dask.array").from_array(heights, chunks=(300, 512))
    return heights


def stored_fit(kind: str, storage: str, folder: Path, **options) -> tsj.FitResult:
    """The fit of a stored map."""
    stored = StoredMap(stored_as(storage, heights_of(kind), folder), SPACING, "µm")
    return tsj.fit(stored, **KINDS[kind], max_memory=BUDGET, max_control_points=MANY, **options)


def assert_same(found: tsj.FitResult, expected: tsj.FitResult) -> None:
    """One mesh, one surface, one account."""
    assert found.stop is expected.stop
    assert np.array_equal(found.surface.space.mesh.element_boxes, expected.surface.space.mesh.element_boxes)
    points, others = found.surface.control_points, expected.surface.control_points
    assert np.abs(points - others).max() <= 1e-10 * expected.range
    for name in ("max_error", "rms_error", "snr_db", "snr_db_centred", "range"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-9), name
    for name in ("n_samples", "noise", "smoothing", "unit"):
        assert getattr(found, name) == getattr(expected, name), name
    assert found.surface.frame == expected.surface.frame


CASES = [
    *((kind, "memmap") for kind in KINDS if kind != "coarse"),
    ("coarse", "zarr"),
    ("coarse", "dask"),
    ("coarse", "array"),
]


@pytest.mark.parametrize(("kind", "storage"), CASES)
def test_page_by_page_is_as_in_memory(kind, storage, tmp_path):
    """Whatever the storage and the criterion, with pixels missing and elements across pages: the same result."""
    assert page_side(BUDGET) == 512
    assert_same(stored_fit(kind, storage, tmp_path), in_memory(kind))


def test_plain_arrays_are_recognised(tmp_path):
    """A memory map given as it is stays on disk, too: pixels of spacing one."""
    result = tsj.fit(stored_as("memmap", heights_of("complete"), tmp_path), relative_tolerance=0.1, max_memory=BUDGET)
    assert result.surface.frame.extent == (899.0, 699.0)
    assert result.at_samples is None


def test_single_precision_meets_its_tolerance(tmp_path):
    """A float32 map is fitted in float32, and the error that is promised holds at every pixel."""
    heights = heights_of("single")
    result = tsj.fit(StoredMap(stored_as("memmap", heights, tmp_path)), relative_tolerance=0.02, max_memory=BUDGET)
    assert result.provenance["options"]["dtype"] == "float32"
    grid = np.meshgrid(np.linspace(0, 1, 900), np.linspace(0, 1, 700))
    values = np.asarray(result.surface(np.stack([part.ravel() for part in grid], axis=1)))
    largest = np.abs(heights.ravel() - values).max()
    assert result.converged
    assert largest == pytest.approx(result.max_error, rel=1e-3)
    assert largest <= 0.02 * np.ptp(heights) * (1 + 1e-4)


def test_the_result_says_what_is_not_kept(tmp_path):
    """A stored map's result has a readable line, goes to a file and back, and refuses samples with the remedy."""
    result = stored_fit("complete", "memmap", tmp_path, max_steps=1)
    assert "630000 samples" in repr(result)
    assert "largest error left" in result.warnings[-1]
    for name in ("samples", "residuals", "outliers"):
        with pytest.raises(InputError, match=r"not kept in memory; .* result\.surface\.at"):
            getattr(result, name)
    tsj.save(tmp_path / "map.tspl", result)
    loaded = tsj.load(tmp_path / "map.tspl")
    np.testing.assert_array_equal(loaded.control_points, result.surface.control_points)


def test_the_place_of_the_largest_error_is_its_element(tmp_path):
    """What is said of the error left leads to a pixel of about that error."""
    result = stored_fit("complete", "memmap", tmp_path, max_steps=2)
    x, y = (float(part) for part in result.warnings[-1].split("(x, y) = (")[1].rstrip(")").split(", "))
    rows, columns = np.mgrid[:700, :900]
    near = np.hypot(columns * SPACING[0] - x, rows * SPACING[1] - y) < 30
    places = np.stack([columns[near] * SPACING[0], rows[near] * SPACING[1]], axis=1)
    rest = np.abs(heights_of("complete")[near] - np.asarray(result.surface.at(*places.T)))
    assert rest.max() == pytest.approx(result.max_error, rel=1e-6)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"weights": np.ones((40, 50))}, "need data in memory"),
        ({"robust": True}, "need data in memory"),
        ({"as_surface": True}, "need data in memory"),
        ({"max_memory": 1e6}, "at least 2e8; received 1000000"),
        ({"max_memory": np.nan}, "at least 2e8"),
        ({"tolerance": 0.1, "noise": 0.1}, "at most one of"),
        ({"engine": "dask"}, r"DaskEngine\(client\) or DevicesEngine\(\); received str"),
        ({"tolerance": "5nm"}, "data have none"),
    ],
)
def test_misuse_is_said(options, words):
    """Options that a stored map cannot have, and budgets that hold no page."""
    with pytest.raises(InputError, match=words):
        tsj.fit(StoredMap(np.random.default_rng(0).normal(size=(40, 50))), **options)


def test_bad_maps_are_refused(tmp_path):
    """Three dimensions, infinite heights, nothing but NaN, a constant with a relative tolerance."""
    heights = np.ones((40, 50))
    for bad, words in [
        (np.ones((4, 5, 6)), "2-D array of real heights"),
        (np.where(np.eye(40, 50) > 0, np.inf, 1.0), "infinite"),
        (np.full((40, 50), np.nan), "is missing"),
        (heights, "constant"),
    ]:
        with pytest.raises(InputError, match=words):
            tsj.fit(stored_as("memmap", bad, tmp_path), relative_tolerance=0.01)


def test_noise_of_what_is_missing_cannot_be_judged():
    """A single valid corner of a large map: no block that is looked at has a pixel, and a criterion must be given."""
    heights = np.full((2000, 2000), np.nan, np.float32)
    heights[:8, :8] = np.add.outer(np.arange(8), np.arange(8))
    with pytest.raises(InputError, match="give noise= as a number"):
        tsj.fit(StoredMap(heights))
    assert tsj.fit(StoredMap(heights), tolerance=0.5, max_memory=BUDGET).converged


def test_engines_are_for_stored_maps():
    """Data in memory are fitted in this process; the remedy is said."""
    with pytest.raises(InputError, match="pass a StoredMap"):
        tsj.fit(np.ones((20, 20)), tolerance=1.0, engine=tsj.DevicesEngine())


def test_the_budget_bounds_page_and_mesh():
    """Twice the budget is at most twice the pixels and twice the control points, and neither falls."""
    budgets = 2e8 * 1.3 ** np.arange(20)
    for bound, share in ((lambda b: page_side(b) ** 2, 600), (most_control_points, 4300)):
        sizes = np.array([bound(budget) for budget in budgets])
        assert (np.diff(sizes) >= 0).all()
        assert (sizes * share <= budgets).all()


PEAK = """
import re, sys
import numpy as np
import tsplinejax as tsj

stored = tsj.StoredMap(np.load(sys.argv[1], mmap_mode="r"))
tsj.fit(stored, relative_tolerance=0.1, max_memory=2e8, lattice=(12, 12), smoothing=1e-9)
# Not ru_maxrss: that of a child begins with its parent's.
print(int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1]) / 1024)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is read as Linux counts it")
def test_memory_does_not_grow_with_the_map(tmp_path):
    """A map of 25 million pixels takes no more than one of 2: not even the 90 MB that its file has more."""
    peaks = []
    for side in (1500, 5000):
        mapped = np.lib.format.open_memmap(tmp_path / "map.npy", "w+", np.float32, (side, side))
        across = np.linspace(0, 1, side, dtype=np.float32)
        for first in range(0, side, 250):
            mapped[first : first + 250] = np.sin(4 * across) * np.cos(3 * across[first : first + 250, None])
        mapped.flush()
        words = [sys.executable, "-c", PEAK, str(tmp_path / "map.npy")]
        run = subprocess.run(words, capture_output=True, text=True, check=True, cwd=ROOT)
        peaks.append(float(run.stdout))
    assert peaks[1] - peaks[0] < 40


@pytest.mark.parametrize(
    ("processes", "storages"),
    [(False, ("dask", "zarr")), pytest.param(True, ("memmap", "dask"), marks=pytest.mark.slow)],
)
def test_dask_is_as_in_memory(processes, storages, tmp_path):
    """Workers in threads or in processes of their own, which read what they work on: the same result."""
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "processes": processes, "dashboard_address": ":0"}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        for storage in storages:
            result = stored_fit("coarse", storage, tmp_path, engine=tsj.DaskEngine(client))
            assert_same(result, in_memory("coarse"))
        infinite = np.where(np.eye(40, 50) > 0, np.inf, 1.0)
        with pytest.raises(InputError, match="infinite in the rows"):
            tsj.fit(StoredMap(infinite), tolerance=0.1, engine=tsj.DaskEngine(client))


def test_devices_take_turns(tmp_path):
    """Engines are given every page once, also where the surface is rational; results are as in memory."""
    assert_same(stored_fit("dyadic", "memmap", tmp_path, engine=tsj.DevicesEngine()), in_memory("dyadic"))


SEVERAL_DEVICES = """
import sys
import jax
import numpy as np
import tsplinejax as tsj
from tsplinejax.fitting._pages import Page

jax.config.update("jax_enable_x64", True)
used, on_device = set(), Page.on_device

def watched(page, heights):
    pixels = on_device(page, heights)
    used.update(pixels.values.devices())
    return pixels

Page.on_device = watched
engine = tsj.DevicesEngine()
mapped = np.load(sys.argv[1], mmap_mode="r")
result = tsj.fit(tsj.StoredMap(mapped, (0.5, 0.25), "µm"), relative_tolerance=0.1, max_memory=8e8, engine=engine)
assert used == set(jax.devices()) and len(used) == 4, used
np.save(sys.argv[2], result.surface.control_points)
"""


def test_several_devices_are_as_in_memory(tmp_path):
    """Four devices, each with pages of its own, give the control points of one."""
    np.save(tmp_path / "map.npy", heights_of("coarse"))
    words = [sys.executable, "-c", SEVERAL_DEVICES, str(tmp_path / "map.npy"), str(tmp_path / "points.npy")]
    environment = {**os.environ, "XLA_FLAGS": "--xla_force_host_platform_device_count=4"}
    run = subprocess.run(words, capture_output=True, text=True, check=False, cwd=ROOT, env=environment)
    assert run.returncode == 0, run.stderr
    expected = in_memory("coarse")
    difference = np.load(tmp_path / "points.npy") - expected.surface.control_points
    assert np.abs(difference).max() <= 1e-10 * expected.range
