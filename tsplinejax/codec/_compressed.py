"""What a compressed file says about its map: the entries of its header, checked when read."""

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from .._errors import InputError
from ..data import Frame
from ..io._files import check_count

#: A file of n bytes holds at most this many pixels, plus so many for each byte: flat maps take few bytes indeed.
_FREE_PIXELS, _PIXELS_PER_BYTE = 1 << 22, 1 << 15
_MODES = ("grid", "model", "lossless")

Mode = Literal["grid", "model", "lossless"]


@dataclass(frozen=True)
class ModelPart:
    """The T-spline of a compressed map.

    **Attributes:**

    - `lattice`, `first_cut`: what its mesh starts from.
    - `point_step`: control points are multiples of this above the offset, in the map's unit.
    - `control_points`, `elements`: size of its mesh.
    - `residual`: whether corrections of single pixels follow.
    """

    lattice: tuple[int, int]
    first_cut: Literal["s", "t"]
    point_step: float
    control_points: int
    elements: int
    residual: bool


@dataclass(frozen=True)
class CompressedHeader:
    """What a compressed file says about its map.

    **Attributes:**

    - `mode`: `"grid"`, predicted pixels; `"model"`, a T-spline; `"lossless"`, every bit.
    - `shape`, `dtype`, `spacing`, `origin`, `unit`: of the map.
    - `missing`: how many pixels are missing.
    - `tolerance`: the bound that every valid pixel keeps; `max_error`: the largest error found.
    - `offset`, `step`: heights are decoded as offset + step · whole numbers / 64.
    - `model`: the T-spline, or `None`.
    - `software`, `provenance`: what wrote the file, and where the map comes from.
    """

    mode: Mode
    shape: tuple[int, int]
    dtype: str
    spacing: tuple[float, float]
    origin: tuple[float, float]
    unit: str | None
    missing: int
    tolerance: float
    max_error: float
    offset: float
    step: float
    model: ModelPart | None
    software: str
    provenance: dict[str, Any]

    @property
    def frame(self) -> Frame:
        """Where the map lies."""
        rows, columns = self.shape
        extent = ((columns - 1) * self.spacing[0], (rows - 1) * self.spacing[1])
        return Frame(self.origin, extent, self.unit)


def most_pixels(file_bytes: int) -> int:
    """How many pixels a file of so many bytes may declare: no reader takes memory for more.

    >>> most_pixels(0)
    4194304
    """
    return _FREE_PIXELS + _PIXELS_PER_BYTE * file_bytes


def parse_compressed(entries: dict[str, Any], file_bytes: int) -> CompressedHeader:
    """The header after checking every entry.

    **Raises:** `InputError` for an entry that is missing or makes no sense.
    """
    shape = _counts(entries, "shape")
    check_count(shape[0] * shape[1], "pixels", available=most_pixels(file_bytes))
    missing = _entry(entries, "missing", int)
    if not 0 <= missing < shape[0] * shape[1]:
        raise InputError(f"its header declares {missing} missing pixels of {shape[0] * shape[1]}")
    mode = _choice(entries, "mode", _MODES)
    spacing = _pair(entries, "spacing")
    if min(spacing) <= 0:
        raise InputError(f"its header's spacing is {spacing}, where two numbers above zero are expected")
    unit = entries.get("unit")
    if unit is not None and not isinstance(unit, str):
        raise InputError(f"its header's entry 'unit' is {unit!r}, where text is expected")
    return CompressedHeader(
        mode=mode,
        shape=shape,
        dtype=_choice(entries, "dtype", ("float32", "float64")),
        spacing=spacing,
        origin=_pair(entries, "origin"),
        unit=unit,
        missing=missing,
        tolerance=_number(entries, "tolerance", least=0.0),
        max_error=_number(entries, "max_error", least=0.0),
        offset=_number(entries, "offset"),
        step=_number(entries, "step", least=0.0),
        model=_model(entries, file_bytes) if mode == "model" else None,
        software=_entry(entries, "software", str),
        provenance=_entry(entries, "provenance", dict),
    )


def _model(entries: dict[str, Any], file_bytes: int) -> ModelPart:
    part = _entry(entries, "model", dict)
    most = most_pixels(file_bytes)
    for name in ("control_points", "elements"):
        check_count(_entry(part, name, int), name.replace("_", " "), available=most)
    lattice = _counts(part, "lattice")
    if lattice[0] * lattice[1] > part["elements"]:
        raise InputError(f"its header's lattice is {lattice}, of more than its {part['elements']} elements")
    return ModelPart(
        lattice=lattice,
        first_cut=_choice(part, "first_cut", ("s", "t")),
        point_step=_number(part, "point_step", least=0.0),
        control_points=part["control_points"],
        elements=part["elements"],
        residual=_entry(part, "residual", bool),
    )


def _entry(entries: dict[str, Any], name: str, kind: type) -> Any:
    value = entries.get(name)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise InputError(f"its header's entry {name!r} is {str(value)[:80]}, where {kind.__name__} is expected")
    return value


def _choice(entries: dict[str, Any], name: str, choices: tuple[str, ...]) -> Any:
    value = entries.get(name)
    if not isinstance(value, str) or value not in choices:
        raise InputError(
            f"its header's entry {name!r} is {str(value)[:80]}, where one of {', '.join(choices)} is expected"
        )
    return value


def _number(entries: dict[str, Any], name: str, *, least: float = -math.inf) -> float:
    value = entries.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > np.finfo(float).max:
        raise InputError(f"its header's entry {name!r} is {str(value)[:80]}, where a number is expected")
    if value < least:
        raise InputError(f"its header's entry {name!r} is {value}, where at least {least} is expected")
    return float(value)


def _pair(entries: dict[str, Any], name: str) -> tuple[float, float]:
    values = _entry(entries, name, list)
    if len(values) != 2:
        raise InputError(f"its header's entry {name!r} has {len(values)} numbers, where two are expected")
    first, second = (_number({name: value}, name) for value in values)
    return first, second


def _counts(entries: dict[str, Any], name: str) -> tuple[int, int]:
    values = _entry(entries, name, list)
    if len(values) != 2 or not all(type(value) is int and 0 < value <= 1 << 30 for value in values):
        raise InputError(f"its header's entry {name!r} is {str(values)[:80]}, where two counts are expected")
    return values[0], values[1]
