"""Tables of text: separators, missing cells, regular grids, clouds."""

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import HeightMap, PointCloud
from tsplinejax.io import read


def _read(tmp_path, name, text, **options):
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    return read(file, **options)


@pytest.mark.parametrize(
    "text",
    [
        "1,2,nan,4\n5,6,7,8.5\n",
        "1;2;;4\n5;6;7;8,5\n",
        "1\t2\t\t4\n5\t6\t7\t8.5\n",
        "# a comment\n1 2 nan 4\n\n5 6 7 8.5\n",
        "1,2,,4,\n5,6,7,8.5,\n",
        "\ufeff1, 2, , 4\r\n5, 6, 7, 8.5\r\n",
        "1 2 -- 4\n5 6 7 8.5",
    ],
)
@pytest.mark.parametrize("name", ["map.csv", "map.txt"])
def test_separators_and_missing_cells(tmp_path, name, text):
    """Commas, semicolons with decimal commas, tabs, spaces; empty cells and nan are missing."""
    heights = _read(tmp_path, name, text).heights
    np.testing.assert_array_equal(heights, [[1, 2, np.nan, 4], [5, 6, 7, 8.5]])


def _grid_text(points):
    return "\n".join(f"{x!r} {y!r} {z!r}" for x, y, z in points.tolist())


@pytest.fixture
def grid():
    """Points of a 4 x 3 grid (columns x rows) with spacing (0.5, 0.25), in random order, one height missing."""
    y, x = np.meshgrid(1 + 0.25 * np.arange(3), 2 + 0.5 * np.arange(4), indexing="ij")
    points = np.stack([x, y, 10 * y + x], axis=-1).reshape(-1, 3)
    points[5, 2] = np.nan
    return np.random.default_rng(0).permutation(points)


@pytest.mark.parametrize("name", ["grid.xyz", "grid.txt"])
def test_a_full_regular_grid_is_a_map(tmp_path, grid, name):
    """Shuffled points of a full grid are a height map: rows y, columns x, spacing and origin as in the file."""
    height_map = _read(tmp_path, name, "x y z\n" + _grid_text(grid))
    assert isinstance(height_map, HeightMap)
    assert height_map.spacing == pytest.approx((0.5, 0.25), rel=1e-12)
    assert height_map.origin == (2.0, 1.0)
    y, x = np.meshgrid(1 + 0.25 * np.arange(3), 2 + 0.5 * np.arange(4), indexing="ij")
    np.testing.assert_allclose(height_map.heights[height_map.valid], (10 * y + x)[height_map.valid])
    assert (~height_map.valid).sum() == 1


def test_anything_else_is_a_cloud(tmp_path, grid):
    """A point absent, twice, or off the grid makes a cloud."""
    complete = grid[~np.isnan(grid[:, 2])]
    moved = np.nan_to_num(grid)
    moved[3, 0] += 0.1
    twice = np.nan_to_num(grid)
    twice[3] = twice[4]
    for points in (complete, moved, twice):
        assert isinstance(_read(tmp_path, "cloud.xyz", _grid_text(points)), PointCloud)


def test_the_kind_can_be_overridden(tmp_path, grid):
    """`as_` reads a grid as a cloud, and a grid with absent points as a map with holes."""
    complete = grid[~np.isnan(grid[:, 2])]
    cloud = _read(tmp_path, "grid.xyz", _grid_text(grid), as_="cloud")
    assert len(cloud) == 11
    np.testing.assert_allclose(np.sort(cloud.points[:, 2]), np.sort(complete[:, 2]))
    height_map = _read(tmp_path, "grid.xyz", _grid_text(complete), as_="map")
    assert height_map.shape == (3, 4)
    assert height_map.valid.sum() == 11
    with pytest.raises(InputError, match="not lie on a regular grid"):
        _read(tmp_path, "grid.xyz", _grid_text(np.random.default_rng(0).random((50, 3))), as_="map")
    with pytest.raises(InputError, match="'map' or 'cloud'"):
        _read(tmp_path, "grid.xyz", _grid_text(grid), as_="mesh")


def test_rounded_coordinates_are_still_a_grid(tmp_path):
    """Coordinates written to a few digits lie on their lines within the rounding."""
    y, x = np.meshgrid(np.round(np.arange(5) / 3, 4), np.round(np.arange(7) / 3, 4), indexing="ij")
    points = np.stack([x, y, x * y], axis=-1).reshape(-1, 3)
    assert _read(tmp_path, "grid.xyz", _grid_text(points)).spacing == pytest.approx((1 / 3, 1 / 3), rel=1e-3)


def test_further_columns_are_left(tmp_path):
    """An .xyz with intensities is read by its first three columns, and says so."""
    cloud = _read(tmp_path, "cloud.xyz", "0 0 1 9\n1 0 2 9\n0.3 1 3 9\n")
    assert cloud.points.shape == (3, 3)
    assert cloud.provenance["notes"] == ["1 further columns were not read"]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("map.csv", "1,2\n3\n", "columns"),
        ("map.csv", "one,two,three,four\n1,2,3,4\n", "could not convert"),
        ("map.csv", "# only a comment\n", "holds no numbers"),
        ("map.csv", "1,inf\n2,3\n", "infinite"),
        ("map.csv", "# tsplinejax height map\n# spacing: wide\n1,2\n3,4\n", "cannot be read"),
        ("cloud.xyz", "1 2\n3 4\n", "x, y, z"),
        ("cloud.xyz", "1 2 nan\n3 5 6\n7 7 7", "1 of 3 hold NaN"),
        ("cloud.xyz", "nan 2 1\n3 5 6\n7 7 7", "1 of 3 hold NaN"),
    ],
)
def test_bad_tables_are_refused(tmp_path, name, text, message):
    """Ragged, wordy, empty and infinite tables are refused, in one line with the file's name."""
    with pytest.raises(InputError, match=message) as caught:
        _read(tmp_path, name, text)
    assert str(caught.value).startswith(name)
    assert "\n" not in str(caught.value)
