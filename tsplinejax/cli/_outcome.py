"""What a command returns, and how it is said: a JSON object, or a few lines for people."""

import json
import os
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError
from ..codec._plain import plain
from ..data import HeightMap, PointCloud
from ..plot._style import display_unit

MET, STOPPED_EARLIER, REFUSED = 0, 1, 2

#: Set to anything to see where an unexpected error comes from.
TRACEBACK_VARIABLE = "TSPLINEJAX_TRACEBACK"


@dataclass(frozen=True)
class Outcome:
    """A command's result.

    **Attributes:**

    - `report`: the JSON object; `warnings` among it go to standard error, too.
    - `lines`: the same for people.
    - `code`: exit code.
    """

    report: Mapping[str, Any]
    lines: tuple[str, ...]
    code: int = MET


def as_json(report: Mapping[str, Any]) -> str:
    """The report as one JSON object; infinity and NaN are null.

    >>> as_json({"snr_db": float("inf"), "unit": "mm"})
    '{"snr_db": null, "unit": "mm"}'
    """
    return json.dumps(plain(report), allow_nan=False)


def table(rows: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    """Lines of names and what they name, in two columns.

    >>> table([("range", "5 nm"), ("unit", "nm")])
    ('range  5 nm', 'unit   nm')
    """
    listed = list(rows)
    width = max(len(name) for name, _ in listed)
    return tuple(f"{name:{width}}  {value}" for name, value in listed)


def written(**paths: Path | None) -> dict[str, str | None]:
    """Files of a report by what they hold; null where none was asked for.

    >>> written(output=Path("a.npz"), plot=None)
    {'output': 'a.npz', 'plot': None}
    """
    return {name: None if path is None else str(path) for name, path in paths.items()}


def one_line(text: object) -> str:
    """A text without line breaks: what people and programs read line by line.

    >>> one_line("first\\n  second")
    'first second'
    """
    return " ".join(str(text).split())


def reason(error: Exception) -> str:
    """What went wrong, in one line; of an unexpected error the traceback is printed where it was asked for.

    >>> reason(InputError("a tolerance is above zero; received 0"))
    'a tolerance is above zero; received 0'
    """
    if isinstance(error, InputError):
        return one_line(error)
    if isinstance(error, MemoryError):
        return "the machine has too little memory for this; use --crop, or --dtype float32"
    if os.environ.get(TRACEBACK_VARIABLE):
        traceback.print_exception(error)
    kind = type(error).__name__
    return one_line(f"unexpected {kind}: {error}; please report it, with what {TRACEBACK_VARIABLE}=1 shows")


def quantity(value: float | None, unit: str | None) -> str:
    """A length with its unit, to four digits; in a handier unit where the data's own would take many zeros.

    >>> quantity(1.23456, "µm"), quantity(2.5e-7, "m"), quantity(None, "m")
    ('1.235 µm', '250 nm', 'unknown')
    """
    if value is None or not np.isfinite(value):
        return "unknown"
    factor, shown = display_unit(abs(value), unit)
    return f"{value * factor:.4g} {shown}" if shown else f"{value:.4g}"


def pair(first: float, second: float, unit: str | None) -> str:
    """Two lengths in one unit: a spacing or an extent.

    >>> pair(2e-7, 4e-7, "m")
    '200 × 400 nm'
    """
    factor, shown = display_unit(max(abs(first), abs(second)), unit)
    numbers = f"{first * factor:.4g} × {second * factor:.4g}"
    return f"{numbers} {shown}" if shown else numbers


def percentage(part: float) -> str:
    """A share in percent; only the whole is 100 %.

    >>> percentage(0.99999), percentage(1.0)
    ('99.9 %', '100 %')
    """
    return "100 %" if part >= 1 else f"{min(100 * part, 99.9):.3g} %"


def described(data: HeightMap | PointCloud) -> str:
    """Data in a few words."""
    if isinstance(data, PointCloud):
        return f"{len(data.points)} points, diagonal {quantity(data.diagonal, data.unit)}"
    rows, columns = data.shape
    return (
        f"{rows} rows × {columns} columns, spacing {pair(*data.spacing, data.unit)}, "
        f"range {quantity(data.range, data.unit)}, {percentage(float(data.valid.mean()))} valid"
    )
