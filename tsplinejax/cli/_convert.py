"""`tsplinejax convert`: data from one format to another."""

import argparse

from ..data import HeightMap
from ..io import WRITABLE, write
from ._arguments import add_command, add_data_options, add_input
from ._files import checked_output, read_data
from ._outcome import Outcome, described, table


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "convert",
        "convert data to another format",
        "tsplinejax convert map.npy map.x3p --spacing 0.5 --unit um --height-unit nm",
        run,
    )
    add_input(parser, "height map or point cloud", "IN")
    parser.add_argument("output", metavar="OUT", help=f"file to write: {' '.join(WRITABLE)}")
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read and write."""
    target = checked_output(arguments.output, WRITABLE, arguments.input, arguments.mask)
    data = read_data(arguments.input, arguments)
    write(target, data)
    is_map = isinstance(data, HeightMap)
    warnings = list(data.provenance.get("notes", ()))
    if target.suffix.lower() == ".npy" and (data.unit is not None or (is_map and data.spacing != (1.0, 1.0))):
        warnings.append(f"{target.name} holds the bare numbers: spacing and unit are not in it; .npz keeps them")
    report = {
        "output": str(target),
        "kind": "height map" if is_map else "point cloud",
        "shape": list(data.shape) if isinstance(data, HeightMap) else [len(data.points), 3],
        "spacing": list(data.spacing) if isinstance(data, HeightMap) else None,
        "unit": data.unit,
        "range": data.range if isinstance(data, HeightMap) else data.diagonal,
        "provenance": data.provenance,
        "warnings": warnings,
    }
    return Outcome(report, table([("data", described(data)), ("written", str(target))]))
