"""USGS digital elevation models: profiles from south to north in records of 1024 bytes of text.

The header (record A) states units, resolution and the number of profiles; each profile (records B) its place and its
elevations. Row 0 of the map is the northern edge, as on a printed map, so y grows to the south.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from .._errors import InputError
from ._files import check_count
from ._raw import RawMap

_RECORD = 1024
_USED = 1020  # the last four bytes of a record are padding
_PROFILE_HEADER = 144
_VOID = -32767
_UNITS = {1: "foot", 2: "m"}


class _Profile(NamedTuple):
    easting: float
    northing: float
    elevations: np.ndarray


def read_dem(file: Path) -> RawMap:
    """Read a USGS `.dem` in metres or feet; what no profile covers is missing."""
    content = file.read_bytes()
    if len(content) < 2 * _RECORD:
        raise InputError(f"a USGS elevation model has at least {2 * _RECORD} bytes, but this file {len(content)}")
    ground, height = _integer(content, 528), _integer(content, 534)
    if ground not in _UNITS or height not in _UNITS:
        raise InputError(
            f"only metres and feet are read, but its unit codes are {ground} (ground) and {height} (height)"
        )
    step_x, step_y, step_z = (_number(content, 816 + 12 * k, 12) for k in range(3))
    if not (step_x > 0 and step_y > 0 and step_z > 0):
        raise InputError(f"its resolution {step_x}, {step_y}, {step_z} is not positive")
    count = _integer(content, 858)
    check_count(count, "profiles", available=len(content) // _RECORD - 1)
    profiles = _profiles(content, count, step_z)
    factor = 0.3048 if ground == 2 and height == 1 else 1 / 0.3048 if ground == 1 and height == 2 else 1.0
    heights, west, north = _raster(profiles, step_x, step_y)
    notes = (f"row 0 is north; pixel (0, 0) lies at easting {west:.3f}, northing {north:.3f} {_UNITS[ground]}",)
    return RawMap(heights * factor, (step_x, step_y), _UNITS[ground], notes=notes)


def _profiles(content: bytes, count: int, step_z: float) -> list[_Profile]:
    profiles, position = [], _RECORD
    for number in range(1, count + 1):
        if position + _PROFILE_HEADER > len(content):
            raise InputError(f"it ends at byte {len(content)}, before profile {number} of {count}: it is truncated")
        points = _integer(content, position + 12)
        check_count(points, f"elevations in profile {number}", available=(len(content) - position) // 6)
        easting, northing, datum = (_number(content, position + 24 + 24 * k, 24) for k in range(3))
        records = 1 + max(0, -(-(points - (_USED - _PROFILE_HEADER) // 6) // (_USED // 6)))
        text = b"".join(content[position + k * _RECORD :][:_USED] for k in range(records))
        text = text[_PROFILE_HEADER : _PROFILE_HEADER + 6 * points]
        if len(text) != 6 * points:
            raise InputError(f"it ends within profile {number} of {count}, at byte {len(content)}: it is truncated")
        stored = np.frombuffer(text, "S6").astype(np.int64)
        elevations = np.where(stored == _VOID, np.nan, stored * step_z + datum)
        profiles.append(_Profile(easting, northing, elevations))
        position += records * _RECORD
    return profiles


def _raster(profiles: list[_Profile], step_x: float, step_y: float) -> tuple[np.ndarray, float, float]:
    west = min(profile.easting for profile in profiles)
    south = min(profile.northing for profile in profiles)
    places = [
        (round((profile.easting - west) / step_x), round((profile.northing - south) / step_y)) for profile in profiles
    ]
    columns = 1 + max(column for column, _ in places)
    rows = max(row + len(profile.elevations) for (_, row), profile in zip(places, profiles, strict=True))
    check_count(rows * columns, "pixels")
    heights = np.full((rows, columns), np.nan)
    for (column, row), profile in zip(places, profiles, strict=True):
        heights[row : row + len(profile.elevations), column] = profile.elevations
    return heights[::-1], west, south + (rows - 1) * step_y


def _integer(content: bytes, start: int) -> int:
    return int(_number(content, start, 6))


def _number(content: bytes, start: int, width: int) -> float:
    field = content[start : start + width].decode("ascii", "replace").strip()
    try:
        value = float(field.replace("D", "E"))
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(f"byte {start} should start a number, but reads {field!r}: it is no USGS elevation model")
    return value
