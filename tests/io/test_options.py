"""Reading options: spacing, units, masks, crops, and what they refuse."""

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import HeightMap, PointCloud
from tsplinejax.io import read, write

HEIGHTS = np.arange(12.0).reshape(3, 4)


@pytest.fixture
def bare(tmp_path):
    """A file that states nothing but heights."""
    return write(tmp_path / "bare.npy", HEIGHTS)


@pytest.fixture
def stated(tmp_path):
    """A file that states spacing and unit."""
    return write(tmp_path / "stated.npz", HeightMap(HEIGHTS, (0.5, 0.25), "mm", origin=(3.0, 4.0)))


def test_a_bare_array_gets_spacing_and_units(bare):
    """Lengths as text or numbers, heights converted to the one unit."""
    height_map = read(bare, spacing=("500nm", 0.25), unit="um", height_unit="nm")
    assert height_map.spacing == pytest.approx((0.5, 0.25), rel=1e-15)
    np.testing.assert_allclose(height_map.heights, HEIGHTS / 1000)
    assert read(bare, spacing="0.5,0.25").spacing == (0.5, 0.25)
    assert read(bare, spacing=2).spacing == (2.0, 2.0)
    assert height_map.provenance["operations"] == []


def test_a_stated_unit_is_kept_or_converted(stated):
    """`unit` converts a file that states its own; a new spacing in its place is recorded."""
    assert read(stated).unit == "mm"
    height_map = read(stated, unit="um")
    assert height_map.spacing == pytest.approx((500.0, 250.0))
    np.testing.assert_allclose(height_map.heights, HEIGHTS * 1000)
    assert read(stated, spacing=1.0).provenance["operations"] == ["spacing 1,1 in place of the file's"]


def test_masks_then_crops(tmp_path, bare):
    """A mask (array or file) marks missing pixels of the whole map; the crop follows; both are recorded."""
    mask = HEIGHTS == 5
    np.save(tmp_path / "mask.npy", mask)
    np.savetxt(tmp_path / "mask.csv", mask, delimiter=",")
    for given in (mask, tmp_path / "mask.npy", str(tmp_path / "mask.csv")):
        height_map = read(bare, mask=given, crop="1,1,3,2")
        np.testing.assert_array_equal(height_map.heights, [[np.nan, 6, 7], [9, 10, 11]])
        assert height_map.provenance["operations"] == ["mask 1 pixels", "crop 1,1,3,2"]


def test_clouds_take_a_unit_and_a_crop(tmp_path):
    """Spacing, masks and height units are for maps."""
    file = write(tmp_path / "cloud.npy", np.random.default_rng(0).random((20, 3)))
    cloud = read(file, unit="mm", crop=(0, 0, 0.5, "500um"))
    assert isinstance(cloud, PointCloud)
    assert cloud.points[:, :2].max() <= 0.5
    for option in ({"spacing": 1.0}, {"height_unit": "mm"}, {"mask": np.zeros(20)}):
        with pytest.raises(InputError, match="is for height maps"):
            read(file, **option)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"spacing": 0}, "positive"),
        ({"spacing": "1,2,3"}, "DX or DX,DY"),
        ({"spacing": "wide"}, "a number with an optional unit"),
        ({"spacing": "1um"}, "the data have none"),
        ({"unit": "volt"}, "not a unit of length"),
        ({"height_unit": "nm"}, "unit of the spacing"),
        ({"crop": "1,2,3"}, "X0,Y0,X1,Y1"),
        ({"crop": (8, 8, 9, 9)}, "holds no pixel"),
        ({"mask": np.zeros((2, 2))}, "shape"),
        ({"mask": "absent.npy"}, "does not exist"),
        ({"mask": "bare.xyz"}, "does not exist"),
    ],
)
def test_bad_options_are_refused(bare, options, message):
    """Each with the file's name in front."""
    with pytest.raises(InputError, match=message) as caught:
        read(bare, **options)
    assert "\n" not in str(caught.value)


def test_a_stated_unit_admits_no_height_unit(stated):
    """Heights of a file that states its unit are in that unit."""
    with pytest.raises(InputError, match="states its unit, mm"):
        read(stated, height_unit="nm")


def test_a_unit_without_spacing_is_incomplete(tmp_path):
    """A file that states a unit but no spacing needs one."""
    np.savez(tmp_path / "map.npz", heights=HEIGHTS, unit="mm")
    with pytest.raises(InputError, match="no pixel spacing"):
        read(tmp_path / "map.npz")
    assert read(tmp_path / "map.npz", spacing="1um").spacing == (0.001, 0.001)


def test_a_map_may_be_read_as_a_cloud(stated):
    """Its valid pixels, at their places."""
    cloud = read(stated, as_="cloud")
    assert len(cloud) == 12
    np.testing.assert_allclose(cloud.points[5], [3.5, 4.25, 5.0], rtol=1e-15)
    assert cloud.unit == "mm"
