"""`tsplinejax areal`: the areal parameters of ISO 25178-2."""

import argparse
from typing import Any

import numpy as np

from .._version import __version__
from ..data import HeightMap
from ..plot._style import display_unit
from ._arguments import add_command, add_data_options, add_input
from ._files import read_map
from ._operations import add_operations
from ._outcome import Outcome, described, table


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "areal",
        "measure the areal parameters of ISO 25178-2 of a height map",
        "tsplinejax areal map.x3p --s-filter 2.5um --level plane --l-filter 80um --json",
        run,
    )
    add_input(parser)
    parser.add_argument("--include-filled", action="store_true", help="count heights that were filled in, too")
    add_operations(parser)
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, filter and level, measure."""
    from ..areal import areal_parameters
    from ..characterise import l_filter, level, s_filter

    data = read_map(arguments, "areal parameters are measured of")
    original = data
    for option, operation in (("s_filter", s_filter), ("level", level), ("l_filter", l_filter)):
        value = getattr(arguments, option)
        data = data if value is None else operation(data, value)
    assert isinstance(data, HeightMap)
    measured = areal_parameters(
        data, spacing=data.spacing if arguments.spacing else None, include_filled=arguments.include_filled
    )
    values, units = dict(measured.values), dict(measured.units)
    operations = list(data.provenance.get("operations", ()))
    report = {
        **values,
        "units": units,
        "notes": list(measured.notes),
        "operations": operations,
        "range": data.range,
        "unit": data.unit,
        "warnings": [],
        "provenance": {"software": f"tsplinejax {__version__}", "input": dict(original.provenance)},
    }
    return Outcome(report, _lines(original, values, units, operations))


def _lines(data: HeightMap, values: dict[str, Any], units: dict[str, Any], operations: list[str]) -> tuple[str, ...]:
    rows = [("data", described(data)), ("operations", "; ".join(operations) or "none")]
    rows += [(name, _measure(value, units.get(name), data.unit)) for name, value in values.items()]
    return table(rows)


def _measure(value: float, unit: str | None, length: str | None) -> str:
    """A parameter with its unit; lengths, and volumes per area, in a handy one."""
    if unit is None or length is None or not np.isfinite(value) or unit not in (length, f"{length}³/{length}²"):
        return f"{value:.5g} {unit or ''}".rstrip()
    factor, shown = display_unit(abs(value), length)
    return f"{value * factor:.5g} {unit.replace(length, str(shown))}"
