"""Text files: tables of heights (`.csv`, `.txt`) and of points x, y, z (`.xyz`, or any table of three columns).

Cells are separated by commas, semicolons (then decimal commas are understood), tabs or spaces. `nan`, an empty cell and
`No Data` are missing. Our own `.csv` keeps spacing, unit and origin in comment lines that start with `#`.
"""

import io
import re
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .._errors import InputError
from ..data import HeightMap, PointCloud
from ._raw import RawCloud, RawMap
from ._regular_grid import full_grid

_MAP_TITLE = "tsplinejax height map"
_CLOUD_TITLE = "tsplinejax point cloud"
_LONGEST_REASON = 120


def read_table(file: Path) -> RawMap | RawCloud:
    """Read `.csv` or `.txt`: three columns are points (a full regular grid of them a map), else heights."""
    text = _decoded(file)
    table, header = _table(text), _header(text)
    if header["title"] == _MAP_TITLE:
        return _own_map(table, header)
    if table.shape[1] == 3:
        return _points(table, header.get("unit"))
    return RawMap(table)


def read_xyz(file: Path) -> RawMap | RawCloud:
    """Read `.xyz`: the first three columns are x, y, z; a full regular grid of them is a map."""
    text = _decoded(file)
    table = _table(text)
    if table.shape[1] < 3:
        raise InputError(f"an .xyz table needs the columns x, y, z, but has {table.shape[1]}")
    extra = table.shape[1] - 3
    return _points(table[:, :3], None, (f"{extra} further columns were not read",) if extra else ())


def write_table(stream: BinaryIO, data: HeightMap | PointCloud) -> None:
    """Write a `.csv` that reads back to the same numbers: rows of heights, or lines x, y, z."""
    unit = [f"unit: {data.unit}"] if data.unit else []
    if isinstance(data, HeightMap):
        place = [
            f"spacing: {data.spacing[0]!r}, {data.spacing[1]!r}",
            f"origin: {data.origin[0]!r}, {data.origin[1]!r}",
        ]
        header, values = [_MAP_TITLE, *place, *unit], data.heights
    else:
        header, values = [_CLOUD_TITLE, *unit], data.points
    np.savetxt(stream, values, fmt="%.17g", delimiter=",", header="\n".join(header), encoding="utf-8")


def _decoded(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"it is not text (byte {error.start} is not UTF-8); check that the suffix is right") from error


def _header(text: str) -> dict[str, str]:
    lines = [line[1:].strip() for line in re.findall(r"^#.*$", text[:4096], flags=re.MULTILINE)]
    entries = dict(line.split(":", 1) for line in lines if ":" in line)
    return {"title": lines[0] if lines else "", **{key.strip(): value.strip() for key, value in entries.items()}}


def _own_map(table: np.ndarray, header: dict[str, str]) -> RawMap:
    spacing, origin = (_two_numbers(header.get(key, default)) for key, default in (("spacing", ""), ("origin", "0,0")))
    return RawMap(table, spacing, header.get("unit"), origin or (0.0, 0.0))


def _two_numbers(text: str) -> tuple[float, float] | None:
    if not text:
        return None
    first, second = text.split(",")
    return float(first), float(second)


def _points(table: np.ndarray, unit: str | None, notes: tuple[str, ...] = ()) -> RawMap | RawCloud:
    grid = full_grid(table)
    if grid is None:
        return RawCloud(table, unit, notes=notes)
    return RawMap(grid.heights, grid.spacing, unit, grid.origin, notes)


def _table(text: str) -> np.ndarray:
    lines = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    if lines and _names_columns(lines[0]):
        lines = lines[1:]
    if not lines:
        raise InputError("it holds no numbers; export it again as a table of heights, or of x, y, z")
    delimiter = next((mark for mark in ";,\t" if mark in lines[0]), None)
    body = re.sub(r"(?i)no\s+data|(?<![\w.])-{2,}(?![\w.])", "nan", "\n".join(lines))
    if delimiter == ";":
        body = body.replace(",", ".")
    if delimiter is not None:
        body = _with_empty_cells(body, delimiter)
    try:
        return np.loadtxt(io.StringIO(body), delimiter=delimiter, ndmin=2)
    except ValueError as error:
        raise InputError(
            f"a table holds numbers alone, in rows of one length, below at most a line 'x,y,z' and comments that start "
            f"with #; received {_shortened(str(error))}; take other lines out, or mark them with #"
        ) from error


def _shortened(reason: str) -> str:
    return reason.rstrip(".") if len(reason) <= _LONGEST_REASON else reason[:_LONGEST_REASON] + " ..."


def _names_columns(line: str) -> bool:
    return [word.lower() for word in re.split(r"[\s,;]+", line.strip())][:3] == ["x", "y", "z"]


def _with_empty_cells(body: str, delimiter: str) -> str:
    body = re.sub(rf"{delimiter}[ \r]*$", "", body, flags=re.MULTILINE) if _all_end_with(body, delimiter) else body
    return re.sub(rf"(^|{delimiter})[ \r]*(?={delimiter}|$)", r"\1nan", body, flags=re.MULTILINE)


def _all_end_with(body: str, delimiter: str) -> bool:
    return all(line.rstrip(" \r").endswith(delimiter) for line in body.split("\n"))
