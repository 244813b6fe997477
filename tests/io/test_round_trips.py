"""What is written reads back: heights, holes, spacing, unit, orientation."""

import hashlib
import zipfile

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import HeightMap, PointCloud
from tsplinejax.io import WRITABLE, read, write

# Not symmetric in any way, with two holes, wider than high, dx != dy.
HEIGHTS = np.random.default_rng(0).normal(size=(5, 7)).cumsum(axis=1)
HEIGHTS[0, 1] = HEIGHTS[3, 6] = np.nan
TRIANGLES = [[0, 1, 2], [0, 2, 3]]
POINTS = np.random.default_rng(1).normal(size=(6, 3))


def _height_map(dtype=np.float64):
    return HeightMap(HEIGHTS.astype(dtype), (0.1, 1 / 3), "µm", origin=(2.5, -0.75))


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_npz_keeps_everything(tmp_path, dtype):
    """Heights bit by bit, spacing, unit, origin, dtype."""
    height_map = _height_map(dtype)
    back = read(write(tmp_path / "map.npz", height_map))
    np.testing.assert_array_equal(back.heights, height_map.heights)
    assert back.heights.dtype == dtype
    assert (back.spacing, back.unit, back.origin) == (height_map.spacing, "µm", height_map.origin)


def test_csv_keeps_spacing_and_unit(tmp_path):
    """Numbers are written so that they read back exactly."""
    back = read(write(tmp_path / "map.csv", _height_map()))
    np.testing.assert_array_equal(back.heights, HEIGHTS)
    assert (back.spacing, back.unit, back.origin) == ((0.1, 1 / 3), "µm", (2.5, -0.75))


def test_csv_of_three_columns_stays_a_map(tmp_path):
    """The comment says that it is a map, although three columns would be points."""
    assert read(write(tmp_path / "map.csv", HeightMap(HEIGHTS[:, 2:5]))).shape == (5, 3)


def test_npy_is_the_bare_array(tmp_path):
    """Heights only: spacing 1 and no unit come back."""
    back = read(write(tmp_path / "map.npy", _height_map()))
    np.testing.assert_array_equal(back.heights, HEIGHTS)
    assert (back.spacing, back.unit) == ((1.0, 1.0), None)


@pytest.mark.parametrize("suffix", [".x3p", ".gwy"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_instrument_formats_reopen(tmp_path, suffix, dtype):
    """Through an independent reader: metres, spacing to 1e-12, holes and orientation exact."""
    height_map = _height_map(dtype)
    back = read(write(tmp_path / f"map{suffix}", height_map))
    assert back.unit == "m"
    assert back.spacing == pytest.approx((0.1e-6, 1e-6 / 3), rel=1e-12)
    np.testing.assert_array_equal(back.valid, height_map.valid)
    np.testing.assert_allclose(back.heights, height_map.heights * 1e-6, rtol=1e-14 if dtype == np.float64 else 1e-6)
    np.testing.assert_allclose(read(tmp_path / f"map{suffix}", unit="µm").heights, height_map.heights, rtol=1e-6)


def test_x3p_is_sealed_and_reproducible(tmp_path):
    """The checksums of the standard hold, and equal maps give equal bytes."""
    first, second = (write(tmp_path / name, _height_map()) for name in ("a.x3p", "b.x3p"))
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as archive:
        index, points = archive.read("main.xml"), archive.read("bindata/data.bin")
        seal = archive.read("md5checksum.hex").decode()
    assert seal.split() == [hashlib.md5(index).hexdigest(), "*main.xml"]
    assert hashlib.md5(points).hexdigest().upper() in index.decode()


def test_metres_and_a_full_map_in_gwy(tmp_path):
    """A map without holes has no mask; metres stay as they are, bit by bit."""
    height_map = HeightMap(np.arange(6.0).reshape(2, 3), 0.5, "m")
    np.testing.assert_array_equal(read(write(tmp_path / "map.gwy", height_map)).heights, height_map.heights)


@pytest.mark.parametrize("suffix", [".npz", ".ply", ".npy", ".csv"])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_clouds(tmp_path, suffix, dtype):
    """Points exactly; `.npz` and `.ply` keep triangles and unit."""
    cloud = PointCloud(POINTS.astype(dtype), "µm", triangles=TRIANGLES)
    back = read(write(tmp_path / f"cloud{suffix}", cloud))
    np.testing.assert_array_equal(back.points, cloud.points)
    assert back.unit == (None if suffix == ".npy" else "µm")
    if suffix in (".npz", ".ply"):
        np.testing.assert_array_equal(back.triangles, TRIANGLES)


def test_a_cloud_without_triangles_in_ply(tmp_path):
    """Bare points are a valid PLY, too."""
    back = read(write(tmp_path / "cloud.ply", PointCloud(POINTS)))
    np.testing.assert_array_equal(back.points, POINTS)
    assert back.triangles is None


def test_a_height_map_becomes_a_right_handed_mesh(tmp_path):
    """Rows go down, y in space goes up: the mesh is turned within its extent, faces up, and holes stay open."""
    height_map = _height_map()
    mesh = read(write(tmp_path / "map.ply", height_map))
    assert len(mesh) == height_map.valid.sum()
    corners = mesh.points[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() / 2 == pytest.approx((24 - 4) * 0.1 / 3)
    np.testing.assert_allclose(mesh.points[0], [2.5, -0.75 + 4 / 3, HEIGHTS[0, 0]], rtol=1e-12)
    np.testing.assert_allclose(mesh.points[:, 1].min(), -0.75, rtol=1e-12)


@pytest.mark.parametrize("suffix", WRITABLE)
def test_an_unknown_folder_is_refused(tmp_path, suffix):
    """A missing output folder is named."""
    with pytest.raises(InputError, match=r"nowhere does not exist"):
        write(tmp_path / "nowhere" / f"map{suffix}", _height_map())


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("map.bmp", HEIGHTS, "cannot be written"),
        ("map", HEIGHTS, "cannot be written"),
        ("map.x3p", HeightMap(HEIGHTS), "unit is unknown"),
        ("map.gwy", HeightMap(HEIGHTS), "unit is unknown"),
        ("map.x3p", PointCloud(POINTS, "mm"), "not a point cloud"),
        ("map.gwy", PointCloud(POINTS, "mm"), "not a point cloud"),
        ("map.ply", HeightMap(np.full((2, 2), np.nan)), "every height is missing"),
        ("map.npz", "text", "data are a HeightMap"),
    ],
)
def test_a_failed_write_leaves_nothing(tmp_path, name, data, message):
    """Whatever cannot be written is refused, an existing file stays, and no partial file is left."""
    (tmp_path / name).write_text("before")
    with pytest.raises(InputError, match=message):
        write(tmp_path / name, data)
    assert [file.name for file in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "before"


def test_a_folder_is_no_file(tmp_path):
    """Writing onto a folder is refused."""
    (tmp_path / "map.npy").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write(tmp_path / "map.npy", HEIGHTS)


def test_npz_says_which_pixels_were_filled(tmp_path):
    """The marks of filled pixels are written and read; a mask of another shape is refused."""
    filled = np.eye(3, 4) > 0
    path = write(tmp_path / "map.npz", HeightMap(np.ones((3, 4)), filled=filled))
    np.testing.assert_array_equal(read(path).filled, filled)
    assert read(write(path, HeightMap(np.ones((3, 4))))).filled is None
    np.savez(path, heights=np.ones((3, 4)), filled=np.ones(3, bool))
    with pytest.raises(InputError, match="shape"):
        read(path)
