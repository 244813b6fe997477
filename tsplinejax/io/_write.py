"""Writing measured surfaces: the format follows from the suffix; a file appears whole or not at all."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO

from .._errors import InputError
from ..data import HeightMap, PointCloud, as_data
from ._arrays import write_npy, write_npz
from ._files import written_whole
from ._gwy import write_gwy
from ._meshes import write_ply
from ._text import write_table
from ._x3p import write_x3p

_WRITERS: dict[str, Callable[[BinaryIO, HeightMap | PointCloud], None]] = {
    ".npy": write_npy,
    ".npz": write_npz,
    ".csv": write_table,
    ".x3p": write_x3p,
    ".gwy": write_gwy,
    ".ply": write_ply,
}

#: Every suffix that `write` understands.
WRITABLE: tuple[str, ...] = tuple(_WRITERS)


def write(path: str | os.PathLike, data: Any) -> Path:
    """Write a height map or a point cloud to a file.

    `.npz` and `.csv` keep spacing, unit and origin; `.x3p` and `.gwy` are in metres and need a known unit; `.ply` holds
    points and triangles (a height map becomes a mesh); `.npy` is the bare array.

    **Arguments:**

    - `path`: the file; its suffix names the format. An existing file is replaced.
    - `data`: anything `tsplinejax.data.as_data` accepts.

    **Returns:** the path.

    **Raises:** `InputError` for an unknown suffix, a missing folder, or data that the format cannot hold; then nothing
    is written.

    >>> write(getfixture("tmp_path") / "map.csv", [[1.0, 2.0], [3.0, 4.0]]).name
    'map.csv'
    """
    target = Path(path)
    writer = _WRITERS.get(target.suffix.lower())
    if writer is None:
        raise InputError(f"{target.name}: the suffix {target.suffix!r} cannot be written; use {' '.join(WRITABLE)}")
    surface = as_data(data)
    with written_whole(target) as stream:
        writer(stream, surface)
    return target
