"""Images as height maps: values as they are, no height scale, colour refused."""

import numpy as np
import pytest
import tifffile
from PIL import Image

from tsplinejax._errors import InputError
from tsplinejax.io import read

GREY = np.arange(12).reshape(3, 4)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_grey_values_are_heights(tmp_path, dtype, suffix):
    """8 and 16 bits are read as they are, first line first, with the note that they carry no height scale."""
    file = tmp_path / f"map{suffix}"
    Image.fromarray(GREY.astype(dtype) * (1000 if dtype == np.uint16 else 1)).save(file)
    height_map = read(file)
    np.testing.assert_array_equal(height_map.heights, GREY * (1000 if dtype == np.uint16 else 1))
    assert height_map.heights.dtype == np.float64
    assert height_map.provenance["notes"][0].startswith("no height scale")
    assert "notes" not in read(file, unit="mm", height_unit="nm", spacing=1.0).provenance


def test_float_tiff_keeps_missing_pixels(tmp_path):
    """A float TIFF's NaN are missing pixels; float32 stays."""
    values = np.where(GREY == 5, np.nan, GREY).astype(np.float32)
    tifffile.imwrite(tmp_path / "map.tiff", values)
    back = read(tmp_path / "map.tiff").heights
    np.testing.assert_array_equal(back, values)
    assert back.dtype == np.float32


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "LA", "P", "1"])
def test_grey_in_other_modes(tmp_path, mode):
    """Grey stored as colour, with alpha, as a palette or as bits is grey all the same."""
    image = Image.fromarray((GREY > 5).astype(np.uint8) * 255).convert(mode)
    image.save(tmp_path / "map.png")
    np.testing.assert_array_equal(read(tmp_path / "map.png").heights > 0, GREY > 5)


def test_colour_is_refused(tmp_path):
    """A colour screenshot has no heights."""
    colour = np.zeros((4, 4, 3), np.uint8)
    colour[..., 0] = 200
    for suffix in ("png", "tif"):
        Image.fromarray(colour).save(tmp_path / f"shot.{suffix}")
        with pytest.raises(InputError, match="colour image"):
            read(tmp_path / f"shot.{suffix}")


def test_several_pages_are_refused(tmp_path):
    """A stack is not a map."""
    tifffile.imwrite(tmp_path / "stack.tif", np.zeros((3, 8, 8), np.uint8), photometric="minisblack")
    with pytest.raises(InputError, match="3 pages"):
        read(tmp_path / "stack.tif")


def test_masks_may_be_images(tmp_path):
    """A white pixel of a mask is missing."""
    Image.fromarray((GREY == 5).astype(np.uint8) * 255).save(tmp_path / "mask.png")
    Image.fromarray(GREY.astype(np.uint8)).save(tmp_path / "map.png")
    height_map = read(tmp_path / "map.png", mask=tmp_path / "mask.png")
    np.testing.assert_array_equal(height_map.valid, GREY != 5)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_broken_images_are_refused(tmp_path, suffix):
    """Half an image is an error of one line."""
    file = tmp_path / f"map{suffix}"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64), np.uint8)).save(file)
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(InputError, match=f"map{suffix}") as caught:
        read(file)
    assert "\n" not in str(caught.value)
