"""Meshes and clouds: `.ply`, `.stl`, `.obj`, read through trimesh (extra `mesh`); `.ply` is written here.

Vertices stay as they are in the file, in its order; only STL, which repeats each triangle's corners, is merged.
"""

import re
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .._errors import InputError, require
from ..data import HeightMap, PointCloud, canonical_unit
from ._files import check_count
from ._raw import RawCloud

_ASCII_UNITS = {"µm": "um", "Å": "angstrom"}  # a PLY header is ASCII
_FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def read_mesh(file: Path) -> RawCloud:
    """Read the vertices and triangles of a mesh, or the points of a cloud."""
    suffix = file.suffix.lower()
    declared = _check_ply(file) if suffix == ".ply" else {}
    trimesh = require("trimesh", "mesh")
    options = {"skip_materials": True} if suffix == ".obj" else {}
    loaded = trimesh.load(str(file), process=False, **options)
    if isinstance(loaded, trimesh.Scene):
        if not loaded.geometry:
            raise InputError("it holds no points")
        loaded = loaded.to_mesh()
    if suffix == ".stl":
        loaded.merge_vertices()
    vertices = getattr(loaded, "vertices", None)
    if vertices is None or not len(vertices):
        raise InputError("it holds no points")
    if declared and len(vertices) != declared["vertex"]:
        raise InputError(f"it holds {len(vertices)} of {declared['vertex']} vertices: it is truncated or corrupted")
    faces = np.asarray(getattr(loaded, "faces", ()))
    if len(faces) < declared.get("face", 0):
        raise InputError(f"it holds {len(faces)} of {declared['face']} faces: it is truncated or corrupted")
    return RawCloud(np.array(vertices), declared.get("unit"), faces if len(faces) else None)


def _check_ply(file: Path) -> dict:
    """Return what a PLY header declares, after checking that the file is long enough to hold it."""
    with file.open("rb") as stream:
        head = stream.read(1 << 16)
    end = head.find(b"end_header")
    if not head.startswith(b"ply") or end < 0:
        raise InputError("it has no PLY header: it is of another format, or truncated")
    header = head[:end].decode("ascii", "replace")
    declared = {name: int(count) for name, count in re.findall(r"^element\s+(\w+)\s+(\d+)\s*$", header, re.MULTILINE)}
    available = (file.stat().st_size - end) // 3  # three coordinates of at least one byte each
    check_count(declared.get("vertex", 0), "vertices", available=available)
    if declared.get("face", 0):
        check_count(declared["face"], "faces", available=available)
    unit = re.search(r"^comment unit (\S+)\s*$", header, re.MULTILINE)
    return {**declared, "unit": canonical_unit(unit[1]) if unit else None}


def write_ply(stream: BinaryIO, data: HeightMap | PointCloud) -> None:
    """Write points and triangles as binary PLY; a height map becomes a triangle mesh.

    Three-dimensional coordinates are right-handed, seen from above with y upwards, while rows go downwards: a map's y
    is turned within its extent, so that lettering on it reads the right way round in a mesh viewer, too.
    """
    if isinstance(data, HeightMap):
        points, triangles = _triangulated(data)
    else:
        points, triangles = data.points, data.triangles
    kind, name = ("<f4", "float") if points.dtype == np.float32 else ("<f8", "double")
    lines = ["ply", "format binary_little_endian 1.0"]
    if data.unit:
        lines.append(f"comment unit {_ASCII_UNITS.get(data.unit, data.unit)}")
    lines += [f"element vertex {len(points)}", *(f"property {name} {axis}" for axis in "xyz")]
    if triangles is not None:
        lines += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
    stream.write("\n".join([*lines, "end_header", ""]).encode("ascii"))
    stream.write(points.astype(kind).tobytes())
    if triangles is not None:
        faces = np.empty(len(triangles), _FACE)
        faces["count"], faces["corners"] = 3, triangles
        stream.write(faces.tobytes())


def _triangulated(height_map: HeightMap) -> tuple[np.ndarray, np.ndarray]:
    valid = height_map.valid
    if not valid.any():
        raise InputError("every height is missing: there is nothing to write as a mesh")
    row, column = np.nonzero(valid)
    (x0, y0), (dx, dy) = height_map.origin, height_map.spacing
    turned = height_map.shape[0] - 1 - row
    points = np.stack([x0 + column * dx, y0 + turned * dy, height_map.heights[valid]], axis=1)
    number = np.cumsum(valid).reshape(valid.shape) - 1
    whole = valid[:-1, :-1] & valid[:-1, 1:] & valid[1:, :-1] & valid[1:, 1:]
    upper_left, upper_right = number[:-1, :-1][whole], number[:-1, 1:][whole]
    lower_left, lower_right = number[1:, :-1][whole], number[1:, 1:][whole]
    first = np.stack([upper_left, lower_left, lower_right], axis=1)
    second = np.stack([upper_left, lower_right, upper_right], axis=1)
    return points, np.concatenate([first, second])
