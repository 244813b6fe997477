"""Maps that stay on disk: windows and statistics are those of the numbers in memory, and misuse is said."""

import pickle

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tsplinejax import HeightMap, InputError, StoredMap
from tsplinejax.data import Statistics, Window, is_stored, statistics_of


def _heights(shape=(50, 70), *, missing: float = 0.1, level: float = 0.0) -> np.ndarray:
    generator = np.random.default_rng(5)
    heights = level + generator.normal(size=shape)
    heights[generator.random(shape) < missing] = np.nan
    return heights


def _whole(stored: StoredMap) -> Window:
    return Window(slice(0, stored.shape[0]), slice(0, stored.shape[1]))


@pytest.mark.parametrize("kind", ["<f4", ">f4", "<f8", ">f8", "<f2", "<i2", "<u1"])
def test_a_window_has_the_numbers_of_a_height_map(kind, tmp_path):
    """Any real format becomes what a map in memory makes of it, native float32 or float64."""
    numbers = np.arange(60).reshape(6, 10).astype(kind)
    np.save(tmp_path / "map.npy", numbers)
    stored = StoredMap(np.load(tmp_path / "map.npy", mmap_mode="r"))
    expected = HeightMap(numbers).heights
    found = stored.window(Window(slice(2, 5), slice(1, 9)))
    assert (found.dtype, stored.dtype) == (expected.dtype, expected.dtype)
    assert found.dtype.isnative
    np.testing.assert_array_equal(found, expected[2:5, 1:9])


@pytest.mark.parametrize("level", [0.0, 1e9])
def test_statistics_are_numpy_s(level):
    """One pass over windows gives what numpy finds at once; a level far above zero does not cancel."""
    heights = _heights(level=level)
    found, valid = StoredMap(heights).statistics, heights[~np.isnan(heights)]
    assert (found.count, found.low, found.high) == (valid.size, valid.min(), valid.max())
    assert found.mean == pytest.approx(valid.mean(), rel=1e-14)
    assert found.centred == pytest.approx(np.sum((valid - valid.mean()) ** 2), rel=1e-9)


@given(cuts=st.lists(st.integers(0, 200), max_size=6), seed=st.integers(0, 99))
def test_statistics_add_up(cuts, seed):
    """However heights are cut into parts, empty and missing ones among them, the sum is that of the whole."""
    heights = np.random.default_rng(seed).normal(size=200) * 3 + 7
    heights[::3] = np.nan
    total = sum((statistics_of(part) for part in np.split(heights, sorted(cuts))), Statistics())
    whole = statistics_of(heights)
    assert (total.count, total.low, total.high) == (whole.count, whole.low, whole.high)
    assert (total.mean, total.centred) == pytest.approx((whole.mean, whole.centred), rel=1e-12)


def test_windows_cover_the_map_once():
    """Squares of any side meet without gap or overlap."""
    stored = StoredMap(np.zeros((50, 70)))
    seen = np.zeros(stored.shape, int)
    for window in stored.windows(32):
        seen[window.rows, window.columns] += 1
    assert (seen == 1).all()


def test_a_small_map_is_judged_whole_and_a_large_one_all_over():
    """The mosaic of a small map is the map; that of a large one has blocks from its middle, too, and few pixels."""
    heights = _heights()
    np.testing.assert_array_equal(StoredMap(heights).mosaic().heights, heights)
    disk = np.where(np.hypot(*np.ogrid[-600:600, -600:600]) < 500, 1.0, np.nan)
    mosaic = StoredMap(disk, 2.0, "µm").mosaic(1 << 18)
    assert mosaic.heights.size <= 1 << 18
    assert mosaic.valid.mean() == pytest.approx(np.isfinite(disk).mean(), abs=0.1)
    assert (mosaic.spacing, mosaic.unit) == ((2.0, 2.0), "µm")


def test_place_and_words():
    """Frame, unit and a readable line are those of a map in memory."""
    arguments = (np.zeros((5, 9)), (2.0, 3.0), "um")
    stored, held = StoredMap(*arguments, origin=(1, 2)), HeightMap(*arguments, origin=(1, 2))
    assert stored.frame == held.samples().frame
    assert repr(stored) == "StoredMap(5 rows × 9 columns, spacing=(2, 3) µm, float64)"


@pytest.mark.parametrize(
    ("heights", "words"),
    [
        (np.zeros((4, 4, 3)), "2-D array of real heights"),
        (np.zeros(9), "2-D array of real heights"),
        (np.zeros((1, 9)), "at least two rows"),
        (np.zeros((4, 4), complex), "real heights"),
        (np.zeros((4, 4), bool), "real heights"),
        ([[1.0, 2.0], [3.0, 4.0]], "received list"),
    ],
)
def test_what_is_no_map_is_refused(heights, words):
    """The rule, and what was received."""
    with pytest.raises(InputError, match=words):
        StoredMap(heights)


def test_infinite_heights_are_refused_with_their_place():
    """The rows and columns of the window say where to look."""
    heights = np.zeros((50, 70))
    heights[40, 60] = np.inf
    with pytest.raises(InputError, match=r"infinite in the rows 32 to 50, columns 32 to 64; replace them"):
        [StoredMap(heights).window(window) for window in StoredMap(heights).windows(32)]
    with pytest.raises(InputError, match="infinite"):
        _ = StoredMap(heights).statistics


def test_a_map_without_a_height_is_refused():
    """Nothing but NaN: there is no range to speak of."""
    with pytest.raises(InputError, match="every one of the 200 heights is missing"):
        _ = StoredMap(np.full((10, 20), np.nan)).range


def test_what_counts_as_stored(tmp_path):
    """Memory maps and chunked arrays; not what is in memory, and, as everywhere, not three columns of points."""
    np.save(tmp_path / "map.npy", np.zeros((20, 30)))
    np.save(tmp_path / "points.npy", np.zeros((20, 3)))
    mapped = np.load(tmp_path / "map.npy", mmap_mode="r")
    assert is_stored(mapped)
    assert is_stored(mapped[2:, ::2])
    assert not is_stored(mapped + 1)
    assert not is_stored(np.zeros((20, 30)))
    assert not is_stored(np.load(tmp_path / "points.npy", mmap_mode="r"))
    assert not is_stored(HeightMap(np.zeros((4, 4))))


@pytest.mark.parametrize("order", ["C", "F"])
def test_a_memory_map_travels_as_the_name_of_its_file(order, tmp_path):
    """Pickled, it is a few hundred bytes, and reads the same numbers where it arrives."""
    heights = np.asarray(_heights((300, 200)), order=order)
    np.save(tmp_path / "map.npy", heights)
    stored = StoredMap(np.load(tmp_path / "map.npy", mmap_mode="r"), 0.5, "µm", provenance={"name": "map"})
    packed = pickle.dumps(stored)
    assert len(packed) < 2000
    arrived = pickle.loads(packed)
    assert (arrived.spacing, arrived.unit, arrived.provenance) == ((0.5, 0.5), "µm", {"name": "map"})
    np.testing.assert_array_equal(arrived.window(_whole(arrived)), heights)


def test_a_part_of_a_memory_map_does_not_travel(tmp_path):
    """Its place in the file is not known: pixels are not sent by accident, nor wrong ones read."""
    np.save(tmp_path / "map.npy", np.zeros((30, 20)))
    with pytest.raises(InputError, match="pass the whole map"):
        pickle.dumps(StoredMap(np.load(tmp_path / "map.npy", mmap_mode="r")[5:]))


def test_changes_of_a_copy_on_write_map_are_kept(tmp_path):
    """Pages that the file does not know are never given back to the system."""
    np.save(tmp_path / "map.npy", np.zeros((300, 200)))
    heights = np.load(tmp_path / "map.npy", mmap_mode="c")
    heights[:] = 7.0
    stored = StoredMap(heights)
    assert stored.statistics.low == 7.0
    assert (stored.window(_whole(stored)) == 7.0).all()
