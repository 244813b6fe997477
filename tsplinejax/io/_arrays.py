"""numpy's own files: `.npy` (one array) and `.npz` (heights or points with spacing, unit, origin). Never pickles."""

import json
import zipfile
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.lib import format as npy_format

from .._errors import InputError
from ..data import HeightMap, PointCloud
from ._files import check_count
from ._raw import RawCloud, RawMap


def read_npy(file: Path) -> RawMap | RawCloud:
    """Read `.npy`: an array of three columns is a point cloud, any other 2-D array a height map."""
    return _bare(load_npy(file))


def load_npy(file: Path) -> np.ndarray:
    """Load one array after checking that the file holds what its header declares."""
    with file.open("rb") as stream:
        _check_array(stream, file.stat().st_size)
        stream.seek(0)
        return np.load(stream, allow_pickle=False)


def load_npz(file: Path) -> dict[str, np.ndarray]:
    """Load every array of an archive after checking that the file holds what their headers declare."""
    with zipfile.ZipFile(file) as archive:
        for member in archive.infolist():
            with archive.open(member) as stream:
                _check_array(stream, member.file_size)
    with np.load(file, allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def read_npz(file: Path) -> RawMap | RawCloud:
    """Read `.npz`: `heights` (with `spacing`, `unit`, `origin`, `filled`), `points` (`unit`, `triangles`), or one."""
    entries = load_npz(file)
    unit = str(entries["unit"]) if "unit" in entries else None
    notes = tuple(json.loads(str(entries["notes"]))) if "notes" in entries else ()
    if "heights" in entries:
        origin = entries.get("origin", np.zeros(2))
        spacing = entries.get("spacing")
        steps = None if spacing is None else tuple(spacing)
        return RawMap(entries["heights"], steps, unit or None, tuple(origin), notes, entries.get("filled"))
    if "points" in entries:
        return RawCloud(entries["points"], unit or None, entries.get("triangles"), notes)
    if len(entries) == 1:
        return _bare(next(iter(entries.values())))
    raise InputError(f"it holds the arrays {', '.join(sorted(entries))}; one must be named 'heights' or 'points'")


def write_npy(stream: BinaryIO, data: HeightMap | PointCloud) -> None:
    """Write the bare heights (or points); `.npz` keeps spacing and unit, too."""
    np.save(stream, data.heights if isinstance(data, HeightMap) else data.points, allow_pickle=False)


def write_npz(stream: BinaryIO, data: HeightMap | PointCloud) -> None:
    """Write everything but the history: heights, spacing, origin, unit; or points, triangles, unit."""
    entries = {"unit": np.array(data.unit or "")}
    notes = data.provenance.get("notes")
    if notes:
        entries["notes"] = np.array(json.dumps(list(notes)))
    if isinstance(data, HeightMap):
        entries |= {"heights": data.heights, "spacing": np.array(data.spacing), "origin": np.array(data.origin)}
        if data.filled is not None:
            entries["filled"] = data.filled
    else:
        entries["points"] = data.points
        if data.triangles is not None:
            entries["triangles"] = data.triangles
    np.savez_compressed(stream, allow_pickle=False, **entries)


def _bare(array: np.ndarray) -> RawMap | RawCloud:
    if array.ndim != 2:
        raise InputError(f"heights are a 2-D array (rows, columns) and points (m, 3), but the shape is {array.shape}")
    return RawCloud(array) if array.shape[1] == 3 else RawMap(array)


def _check_array(stream, size: int) -> None:
    version = npy_format.read_magic(stream)
    header = npy_format.read_array_header_1_0 if version == (1, 0) else npy_format.read_array_header_2_0
    shape, _, dtype = header(stream)
    if dtype.hasobject:
        raise InputError("it holds Python objects, which are never unpickled; save an array of numbers")
    count = int(np.prod([int(length) for length in shape], dtype=object)) if shape else 1
    check_count(count, "numbers", available=(size - stream.tell()) // max(dtype.itemsize, 1))
