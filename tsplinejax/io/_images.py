"""Grey images: PNG and TIFF. Their values are taken as heights as they are; they carry no height scale.

Row 0 is the image's first line, so that the map shows the right way round with rows going down.
"""

from pathlib import Path

import numpy as np

from .._errors import InputError
from ._files import check_count
from ._raw import RawMap

_NO_SCALE = "no height scale: an image's values are not lengths"


def read_image(file: Path) -> RawMap:
    """Read a grey image of 8, 16 or 32 bits or of floats; a colour image is refused."""
    return RawMap(load_image(file), notes=(_NO_SCALE,))


def load_image(file: Path) -> np.ndarray:
    """Return a grey image's values (rows, columns) in their own type; booleans become 0 and 1."""
    values = _load_tiff(file) if file.suffix.lower() in (".tif", ".tiff") else _load_png(file)
    values = _grey(values)
    return values.astype(np.uint8) if values.dtype == bool else values


def _load_png(file: Path) -> np.ndarray:
    from PIL import Image

    with Image.open(file, formats=("PNG",)) as image:
        check_count(image.width * image.height, "pixels")
        if image.mode == "P":
            image = image.convert("RGBA" if "transparency" in image.info else "RGB")
        return np.asarray(image)


def _load_tiff(file: Path) -> np.ndarray:
    import tifffile

    with tifffile.TiffFile(file) as tiff:
        if len(tiff.pages) != 1:
            raise InputError(
                f"it holds {len(tiff.pages)} pages; a height map is one page: export the one that is meant"
            )
        page = tiff.pages[0]
        check_count(int(np.prod(page.shape, dtype=object)), "pixels")
        return page.asarray()


def _grey(values: np.ndarray) -> np.ndarray:
    if values.ndim == 2:
        return values
    if values.ndim != 3 or values.shape[2] not in (2, 3, 4):
        raise InputError(f"a height map is one grey plane, but the image has the shape {values.shape}")
    colours = values[..., :1] if values.shape[2] == 2 else values[..., :3]
    if (colours != colours[..., :1]).any():
        raise InputError("it is a colour image: colours are no heights; export the height data or a grey image")
    return np.ascontiguousarray(colours[..., 0])
