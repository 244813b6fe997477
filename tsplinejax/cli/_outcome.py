"""What a command returns, and how it is said: a JSON object, or a few lines for people."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..codec._plain import plain
from ..data import HeightMap, PointCloud

MET, STOPPED_EARLIER, REFUSED = 0, 1, 2


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


def quantity(value: float | None, unit: str | None) -> str:
    """A length with its unit, to four digits.

    >>> quantity(0.0123456, "µm")
    '0.01235 µm'
    """
    if value is None or not np.isfinite(value):
        return "unknown"
    return f"{value:.4g} {unit}" if unit else f"{value:.4g}"


def percentage(part: float) -> str:
    """A share in percent; only the whole is 100 %.

    >>> percentage(0.99999), percentage(1.0)
    ('99.9 %', '100 %')
    """
    return "100 %" if part >= 1 else f"{min(100 * part, 99.9):.3g} %"


def described(data: HeightMap | PointCloud) -> str:
    """Data in a few words."""
    unit = f" {data.unit}" if data.unit else ""
    if isinstance(data, PointCloud):
        return f"{len(data.points)} points, diagonal {data.diagonal:.4g}{unit}"
    (rows, columns), (dx, dy) = data.shape, data.spacing
    return (
        f"{rows} rows × {columns} columns, spacing {dx:.4g} × {dy:.4g}{unit}, range {data.range:.4g}{unit}, "
        f"{percentage(float(data.valid.mean()))} valid"
    )
