"""Instrument formats, read through SurfaceTopography (extra `formats`, imported only here, and only when needed).

Its axis 0 is x; ours is y: heights are transposed. Drawn with row 0 at the top the maps then show as the
instrument's own software shows them.
"""

import struct
import warnings
from pathlib import Path
from types import ModuleType

import numpy as np

from .._errors import InputError, require
from ._files import check_count
from ._raw import RawMap

#: The reader for each suffix, by SurfaceTopography's name; suffixes shared by two formats have two.
FORMATS: dict[str, tuple[str, ...]] = {
    ".sdf": ("sdf",),
    ".asc": ("asc",),
    ".dat": ("metropro", "asc"),
    ".spm": ("di",),
    ".mat": ("mat",),
    ".mdt": ("mdt",),
    ".opd": ("opd",),
    ".opdx": ("opdx",),
    ".x3p": ("x3p",),
    ".ibw": ("ibw",),
    ".mi": ("mi",),
    ".nc": ("nc",),
    ".datx": ("datx",),
    ".h5": ("h5",),
    ".sur": ("sur",),
    ".tmd": ("tmd",),
    ".vk3": ("vk",),
    ".vk4": ("vk",),
    ".vk6": ("vk",),
    ".vk7": ("vk",),
    ".zmg": ("zmg",),
    ".zon": ("zon",),
    ".os3d": ("os3d",),
    ".al3d": ("al3d",),
    ".ezd": ("ezd",),
    ".nid": ("ezd",),
    ".bcr": ("bcr",),
    ".bcrf": ("bcr",),
    ".gwy": ("gwy",),
    ".plu": ("plu",),
    ".apx": ("plu",),
    ".plux": ("plux",),
    ".frt": ("frt",),
    ".lext": ("lext",),
    ".oir": ("oir",),
    ".poir": ("poir",),
    ".stp": ("wsxm",),
    ".top": ("wsxm",),
    ".jpk": ("jpk",),
    ".mnt": ("mnt",),
    ".qep": ("qep",),
    ".nms": ("nms",),
    ".hgt": ("hgt",),
}

_MOST_PER_BYTE = 10_000  # pixels that one byte of a (compressed) file may stand for
_STEEPEST = 1e6  # heights over extent beyond which a header must be corrupted


def read_instrument(file: Path) -> RawMap:
    """Read the height channel of an instrument's file, with spacing and unit as the file states them."""
    _check_complete(file)
    package = _surface_topography()
    failure: Exception | None = None
    for name in FORMATS[file.suffix.lower()]:
        try:
            reader = package.open_topography(str(file), format=name)
            return _raw_map(reader, file.stat().st_size)
        except InputError:
            raise
        except Exception as error:  # any exception: the next format that shares the suffix may read it
            failure = failure or error
    raise failure or InputError("no format is known for its suffix")


def _surface_topography() -> ModuleType:
    with warnings.catch_warnings():
        # It says on import that it runs on one process when mpi4py is absent, which is how it is used here.
        warnings.filterwarnings("ignore", "Could not import mpi4py", ImportWarning)
        return require("SurfaceTopography", "formats")


def _raw_map(reader, file_size: int) -> RawMap:
    channel = reader.default_channel
    if channel.dim != 2:
        raise InputError("it holds a profile (one line), not a height map")
    columns, rows = (int(count) for count in channel.nb_grid_pts)
    check_count(columns * rows, "pixels", available=_MOST_PER_BYTE * file_size)
    sizes_known = channel.physical_sizes is not None
    topography = reader.topography(**({} if sizes_known else {"physical_sizes": (columns, rows)}))
    if not topography.is_uniform:
        raise InputError("its pixels are not evenly spaced, so it is no height map")
    heights = topography.heights()
    if heights.shape != (columns, rows):
        raise InputError(
            f"its header declares {columns} × {rows} pixels, but it holds {heights.shape}: it is corrupted"
        )
    heights = np.ma.filled(heights.astype(np.float64), np.nan).T
    dx, dy = (float(step) for step in topography.pixel_size)
    spacing = (dx, dy) if sizes_known else None
    _check_plausible(heights, spacing)
    others = [other.name for other in reader.channels if other.index != channel.index]
    notes = (f"channel {channel.name!r} was read; others: {', '.join(map(str, others))}",) if others else ()
    return RawMap(heights, spacing, topography.unit, notes=notes)


def _check_plausible(heights: np.ndarray, spacing: tuple[float, float] | None) -> None:
    if np.isinf(heights).any():
        raise InputError(f"{int(np.isinf(heights).sum())} heights are infinite: it is corrupted")
    if spacing is None or np.isnan(heights).all():
        return
    if not all(np.isfinite(step) and step > 0 for step in spacing):
        raise InputError(f"its pixel spacing {spacing} is not positive: it is corrupted")
    extent = max(spacing[0] * heights.shape[1], spacing[1] * heights.shape[0])
    if np.nanmax(np.abs(heights)) > _STEEPEST * extent:
        raise InputError(
            f"its heights reach {np.nanmax(np.abs(heights)):g} over an extent of {extent:g}: it is corrupted"
        )


def _check_complete(file: Path) -> None:
    """Refuse an FRT file that ends before its last block, which the reader would not notice."""
    if file.suffix.lower() != ".frt":
        return
    size = file.stat().st_size
    with file.open("rb") as stream:
        prefix = stream.read(18)
        if len(prefix) < 18 or prefix[:12] != b"FRTM_GLIDERV":
            return
        block = struct.Struct("<HI" if prefix[12:16] == b"1.00" else "<HQ")
        for number in range(struct.unpack("<H", prefix[16:])[0]):
            head = stream.read(block.size)
            length = block.unpack(head)[1] if len(head) == block.size else size
            if stream.tell() + length > size:
                raise InputError(f"it ends at byte {size}, within block {number + 1}: it is truncated; copy it again")
            stream.seek(length, 1)
