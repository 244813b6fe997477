"""`tsplinejax fill`: a height map with its holes filled."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._errors import InputError
from ..codec import MODEL_SUFFIX, save
from ..data import HeightMap
from ..io import WRITABLE, write
from ..io._files import existing_file
from ..plot import plot_filling
from ._arguments import add_command, add_data_options, share
from ._files import checked_output, checked_picture, read_data, write_picture
from ._outcome import MET, STOPPED_EARLIER, Outcome, described, percentage, quantity, table

if TYPE_CHECKING:
    from ..filling import Filled

_FLAGS = ("exact", "edges", "border", "smooth_all")
_CRITERIA = ("tolerance", "relative_tolerance", "noise")


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "fill",
        "fill missing pixels of a height map, and say how uncertain they are",
        "tsplinejax fill map.x3p -o filled.npz --plot filled.png",
    )
    parser.set_defaults(run=run)
    parser.add_argument("input", metavar="INPUT", help="height map")
    parser.add_argument(
        "-o",
        "--output",
        metavar="OUT",
        required=True,
        help=f"file to write: {' '.join(WRITABLE)}; .npz also says which pixels were filled",
    )
    group = parser.add_argument_group("what is filled, and how (default: interior holes; measured pixels stay)")
    group.add_argument("--border", action="store_true", help="fill holes that touch the border of the map, too")
    group.add_argument(
        "--edges", action="store_true", help="steps go on through holes; nothing beyond the heights at a hole's rim"
    )
    group.add_argument("--exact", action="store_true", help="make the T-spline through every pixel (see --model)")
    group.add_argument("--smooth-all", action="store_true", help="take every height from a T-spline fitted to the map")
    one = group.add_mutually_exclusive_group()
    one.add_argument("--tolerance", metavar="X", help="of that fit: 5nm, 0.8um, or in the data's unit")
    one.add_argument("--relative-tolerance", metavar="X", type=share, help="the same as a share of the range: 1%%")
    one.add_argument("--noise", metavar="X", help="stop that fit at this noise; auto estimates it (default)")
    group.add_argument("--model", metavar="FILE.tspl", help="write the T-spline of --exact or --smooth-all")
    group.add_argument("--plot", metavar="FILE.png", help="draw the map before and after, and the uncertainty")
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, fill, write."""
    from ..filling import fill_missing

    target, model, picture = _checked_paths(arguments)
    existing_file(arguments.input)
    data = read_data(arguments.input, arguments)
    if not isinstance(data, HeightMap):
        raise InputError("holes are filled in height maps, but this is a point cloud; read it with --as map")
    filled = fill_missing(data, **{name: getattr(arguments, name) for name in (*_FLAGS, *_CRITERIA)})
    write(target, filled.map)
    if model is not None:
        assert filled.surface is not None
        save(model, filled.surface)
    if picture is not None:
        write_picture(picture, lambda: plot_filling(data, filled))
    warnings = list(filled.warnings)
    if target.suffix.lower() != ".npz" and filled.n_filled:
        warnings.append(f"{target.name} does not say which pixels were filled; .npz does")
    written = {"output": target, "model": model, "plot": picture}
    options = {name: getattr(arguments, name) for name in (*_FLAGS, *_CRITERIA)}
    report = {
        **{name: None if path is None else str(path) for name, path in written.items()},
        **filled.report,
        "warnings": warnings,
        "provenance": {**filled.provenance, "options": options},
    }
    return Outcome(report, _lines(data, filled, report), MET if filled.converged else STOPPED_EARLIER)


def _checked_paths(arguments: argparse.Namespace) -> tuple[Path, Path | None, Path | None]:
    """Paths of map, model and picture."""
    inputs = (arguments.input, arguments.mask)
    target = checked_output(arguments.output, WRITABLE, *inputs)
    if arguments.model is not None and not (arguments.exact or arguments.smooth_all):
        raise InputError("a model is written of the T-spline that --exact or --smooth-all makes; give one of them")
    model = None if arguments.model is None else checked_output(arguments.model, (MODEL_SUFFIX,), *inputs)
    picture = None if arguments.plot is None else checked_picture(arguments.plot, *inputs)
    return target, model, picture


def _lines(data: HeightMap, filled: "Filled", report: dict[str, Any]) -> tuple[str, ...]:
    rows = [
        ("data", described(data)),
        ("filled", f"{filled.n_filled} pixels, {percentage(filled.n_filled / data.heights.size)} of the map"),
    ]
    if filled.left.any():
        rows.append(("left", f"{int(filled.left.sum())} pixels of holes that touch the border"))
    if filled.weights:
        mixture = sorted(filled.weights.items(), key=lambda item: -item[1])
        rows.append(("filler", ", ".join(f"{percentage(weight)} {name}" for name, weight in mixture)))
    if filled.hidden:
        error = quantity(filled.validated_rms, filled.unit)
        rows.append(("error", f"{error} rms at {filled.hidden} known pixels that were hidden"))
    if filled.control_points is not None:
        rows.append(("surface", f"T-spline of {filled.control_points} control points"))
    rows.append(("written", ", ".join(name for name in (report["output"], report["model"], report["plot"]) if name)))
    return table(rows)
