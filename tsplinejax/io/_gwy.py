"""Writing Gwyddion's native `.gwy`: a tree of named, typed components, little-endian, lengths in metres."""

import struct
from typing import Any, BinaryIO

import numpy as np

from .._errors import InputError
from ..data import HeightMap, PointCloud


def write_gwy(stream: BinaryIO, data: HeightMap | PointCloud) -> None:
    """Write a height map of known unit as the first channel of a Gwyddion file; missing pixels become its mask."""
    if not isinstance(data, HeightMap):
        raise InputError("a .gwy file holds a height map, not a point cloud; write the cloud as .ply")
    if data.unit is None:
        raise InputError("a .gwy file is in metres, but the map's unit is unknown; state it (unit=..., --unit)")
    metres = data.to_unit("m")
    components = {
        "/0/data": _field(metres, metres.heights.astype(np.float64), "m"),
        "/0/data/title": data.provenance.get("name", "height"),
    }
    missing = ~metres.valid
    if missing.any():
        level = 0.0 if missing.all() else float(np.nanmean(metres.heights, dtype=np.float64))
        components["/0/data"] = _field(metres, np.where(missing, level, metres.heights), "m")
        components["/0/mask"] = _field(metres, missing.astype(np.float64), "")
    stream.write(b"GWYP" + _object("GwyContainer", components))


def _field(metres: HeightMap, values: np.ndarray, unit: str) -> bytes:
    rows, columns = metres.shape
    (dx, dy), (x0, y0) = metres.spacing, metres.origin
    return _object(
        "GwyDataField",
        {
            "xres": columns,
            "yres": rows,
            "xreal": columns * dx,
            "yreal": rows * dy,
            "xoff": x0 - dx / 2,
            "yoff": y0 - dy / 2,
            "si_unit_xy": _object("GwySIUnit", {"unitstr": "m"}),
            "si_unit_z": _object("GwySIUnit", {"unitstr": unit}),
            "data": np.ascontiguousarray(values, "<f8"),
        },
    )


def _object(name: str, components: dict[str, Any]) -> bytes:
    body = b"".join(_text(key) + _component(value) for key, value in components.items())
    return _text(name) + struct.pack("<I", len(body)) + body


def _component(value: Any) -> bytes:
    match value:
        case bytes():
            return b"o" + value
        case str():
            return b"s" + _text(value)
        case int():
            return b"i" + struct.pack("<i", value)
        case float():
            return b"d" + struct.pack("<d", value)
        case _:
            return b"D" + struct.pack("<I", value.size) + value.tobytes()


def _text(value: str) -> bytes:
    return value.replace("\0", " ").encode() + b"\0"
