"""What a compressed file says about its map: the entries of its header, checked when read."""

from dataclasses import dataclass
from typing import Any, Literal

from .._errors import InputError
from ..data import Frame
from ..io._files import check_count
from ._entries import choice, counts, entry, number, pair

#: A file of n bytes holds at most this many pixels, plus so many for each byte: flat maps take few bytes indeed.
_FREE_PIXELS, _PIXELS_PER_BYTE = 1 << 22, 1 << 15
#: The same for control points, of which each takes a bit and more, and a kilobyte of memory.
_FREE_POINTS, _POINTS_PER_BYTE = 1 << 14, 8
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


def most_control_points(file_bytes: int) -> int:
    """How many control points, or elements, a file of so many bytes may declare.

    >>> most_control_points(1000)
    24384
    """
    return _FREE_POINTS + _POINTS_PER_BYTE * file_bytes


def parse_compressed(entries: dict[str, Any], file_bytes: int) -> CompressedHeader:
    """The header after checking every entry.

    **Raises:** `InputError` for an entry that is missing or makes no sense.
    """
    shape = counts(entries, "shape")
    check_count(shape[0] * shape[1], "pixels", available=most_pixels(file_bytes))
    missing = entry(entries, "missing", int)
    if not 0 <= missing < shape[0] * shape[1]:
        raise InputError(f"its header declares {missing} missing pixels of {shape[0] * shape[1]}")
    mode = choice(entries, "mode", _MODES)
    spacing = pair(entries, "spacing")
    if min(spacing) <= 0:
        raise InputError(f"its header's spacing is {spacing}, where two numbers above zero are expected")
    unit = None if entries.get("unit") is None else entry(entries, "unit", str)
    return CompressedHeader(
        mode=mode,
        shape=shape,
        dtype=choice(entries, "dtype", ("float32", "float64")),
        spacing=spacing,
        origin=pair(entries, "origin"),
        unit=unit,
        missing=missing,
        tolerance=number(entries, "tolerance", least=0.0),
        max_error=number(entries, "max_error", least=0.0),
        offset=number(entries, "offset"),
        step=number(entries, "step", least=0.0),
        model=_model(entries, file_bytes) if mode == "model" else None,
        software=entry(entries, "software", str),
        provenance=entry(entries, "provenance", dict),
    )


def _model(entries: dict[str, Any], file_bytes: int) -> ModelPart:
    part = entry(entries, "model", dict)
    most = most_control_points(file_bytes)
    for name in ("control_points", "elements"):
        check_count(entry(part, name, int), name.replace("_", " "), available=most)
    lattice = counts(part, "lattice")
    if lattice[0] * lattice[1] > part["elements"]:
        raise InputError(f"its header's lattice is {lattice}, of more than its {part['elements']} elements")
    return ModelPart(
        lattice=lattice,
        first_cut=choice(part, "first_cut", ("s", "t")),
        point_step=number(part, "point_step", least=0.0),
        control_points=part["control_points"],
        elements=part["elements"],
        residual=entry(part, "residual", bool),
    )
