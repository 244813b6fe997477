"""Measured surfaces: every file is read, the right way round, with spacing and unit as the instrument states them."""

import contextlib

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from tsplinejax._errors import InputError
from tsplinejax.data import HeightMap, PointCloud
from tsplinejax.io import read

# Shape (rows, columns), spacing (dx, dy), unit, share of valid pixels, range.
MAPS = {
    "mnt-2.mnt": ((960, 1280), (95.84664367139341 / 1280, 71.88498275354506 / 960), "µm", 0.963, 3.724),
    "frt-1.frt": ((500, 500), (0.012 / 500, 0.012 / 500), "m", 0.694, 3.05214e-4),
    "tmd-1.tmd": ((300, 300), (18.956600189208984 / 300, 18.956600189208984 / 300), "mm", 1.0, 0.350987),
    "x3p-2.x3p": ((650, 650), (1.27656509837346e-7, 3.14582113527746e-7), "m", 1.0, 5.54336e-7),
    "sur-2.sur": ((484, 563), (0.0034840002190321684, 0.0034840002190321684), "mm", 0.999, 1.476e-3),
    "opd-1.opd": ((480, 640), (0.1259091403335333 / 640, 0.09443185525014997 / 480), "mm", 0.999, 1.29154e-4),
    "SainteHelens.dem": ((466, 327), (30.0, 30.0), "m", 0.977, 1861.0),
}

CLOUDS = {"face_fran_cut.ply": (2205, 4224), "turbineblade.ply": (99519, 199034), "samp11-utm.pcd": (38010, None)}

# Glyphs of the coin's lettering, five columns by seven rows.
LETTER_E = "##### ##... ##... ####. ##... ##... #####"
LETTER_N = "##..# ##..# #.#.# #.#.# #.#.# #..## #..##"


@pytest.mark.parametrize("name", MAPS)
def test_height_maps(shared_data, name):
    """Shape, spacing (to 1e-12), unit, missing pixels and range of each map."""
    shape, spacing, unit, valid, extent = MAPS[name]
    height_map = read(shared_data / name)
    assert isinstance(height_map, HeightMap)
    assert (height_map.shape, height_map.unit) == (shape, unit)
    assert height_map.spacing == pytest.approx(spacing, rel=1e-12)
    assert height_map.valid.mean() == pytest.approx(valid, abs=1e-3)
    assert height_map.range == pytest.approx(extent, rel=1e-3)
    assert height_map.provenance["name"] == name
    assert len(height_map.provenance["sha256"]) == 64


@pytest.mark.parametrize("name", CLOUDS)
def test_clouds(shared_data, name):
    """Points and triangles of each cloud; a unit can be stated."""
    points, triangles = CLOUDS[name]
    cloud = read(shared_data / name, unit="mm")
    assert isinstance(cloud, PointCloud)
    assert (len(cloud), cloud.unit) == (points, "mm")
    assert (None if cloud.triangles is None else len(cloud.triangles)) == triangles
    assert len(cloud.samples()) == points


def test_the_coin_reads_one_dime(shared_data):
    """With row 0 at the top, the E and the N of ONE match their glyphs, and no mirror image or turned one does."""
    heights = read(shared_data / "tmd-1.tmd").heights
    e, n = _letter(heights, (123, 252), (20, 24), 0.35), _letter(heights, (94, 241), (22, 20), 0.5)
    assert _likeness(e, LETTER_E) > 0.8
    assert _likeness(e[:, ::-1], LETTER_E) < 0.2
    assert _likeness(n, LETTER_N) > 0.7
    assert _likeness(n[:, ::-1], LETTER_N) < 0.4
    assert _likeness(n[::-1], LETTER_N) < 0.4


def _letter(heights, centre, size, angle):
    """The heights in an upright box around one letter of the inscription, less their slope down the rows."""
    v, u = np.mgrid[-0.5:0.5:28j, -0.5:0.5:20j] * np.reshape(size[::-1], (2, 1, 1))
    cosine, sine = np.cos(angle), np.sin(angle)
    picture = map_coordinates(heights, [centre[1] + sine * u + cosine * v, centre[0] + cosine * u - sine * v], order=1)
    rows = np.arange(28)
    return picture - np.polyval(np.polyfit(rows, picture.mean(axis=1), 1), rows)[:, None]


def _likeness(picture, glyph):
    pixels = np.array([[mark == "#" for mark in row] for row in glyph.split()], dtype=float)
    return np.corrcoef(picture.ravel(), np.kron(pixels, np.ones((4, 4))).ravel())[0, 1]


def test_the_crater_opens_to_the_north(shared_data):
    """The elevation model has north at the top: the rim is breached on that side of the crater floor."""
    heights = read(shared_data / "SainteHelens.dem").heights
    floor = (185, 160)
    north, south = heights[floor[0] - 40, floor[1]], heights[floor[0] + 30, floor[1]]
    assert south - north > 300


@pytest.mark.parametrize("name", [*MAPS, *CLOUDS])
@pytest.mark.parametrize("share", [0.999, 0.9, 0.5, 0.01])
def test_truncated_files_are_refused(shared_data, tmp_path, name, share):
    """A file that was cut is an `InputError` of one line that names it, whatever its format."""
    content = (shared_data / name).read_bytes()
    file = tmp_path / name
    file.write_bytes(content[: int(len(content) * share)])
    if name == "SainteHelens.dem" and share == 0.999:
        file.write_bytes(content[:-2049])  # the last record is a summary, the one before it padded
    if name == "samp11-utm.pcd" and share == 0.999:
        file.write_bytes(content[:-5_000])  # what follows the points is padding
    with pytest.raises(InputError, match=name) as caught:
        read(file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [*MAPS, *CLOUDS])
def test_corrupted_headers_do_not_surprise(shared_data, tmp_path, name):
    """Random bytes in the first 600 either leave data that can be used, or raise `InputError` and nothing else."""
    content = (shared_data / name).read_bytes()
    generator = np.random.default_rng(0)
    file = tmp_path / name
    for _ in range(6):
        changed = np.frombuffer(content, np.uint8).copy()
        changed[generator.integers(0, 600, 20)] = generator.integers(0, 256, 20)
        file.write_bytes(changed.tobytes())
        with contextlib.suppress(InputError):
            assert isinstance(read(file), HeightMap | PointCloud)
