"""`tsplinejax fill`: a height map with its holes filled."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._errors import InputError
from ..codec import MODEL_SUFFIX, save
from ..data import HeightMap
from ..io import WRITABLE, write
from ..plot import plot_filling
from ._arguments import add_command, add_data_options, add_input, add_output, add_plot, add_tolerances
from ._files import checked_output, checked_picture, read_map, write_picture
from ._outcome import MET, STOPPED_EARLIER, Outcome, described, percentage, quantity, table, written

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
        run,
    )
    add_input(parser)
    add_output(
        parser,
        f"file to write: {' '.join(WRITABLE)}; .npz also says which pixels were filled",
        "OUT",
    )
    group = parser.add_argument_group("what is filled, and how (default: interior holes; measured pixels stay)")
    group.add_argument("--border", action="store_true", help="fill holes that touch the border of the map, too")
    group.add_argument(
        "--edges", action="store_true", help="steps go on through holes; nothing beyond the heights at a hole's rim"
    )
    group.add_argument("--exact", action="store_true", help="make the T-spline through every pixel (see --model)")
    group.add_argument("--smooth-all", action="store_true", help="take every height from a T-spline fitted to the map")
    add_tolerances(
        group,
        "of that fit: 5nm, 0.8um, or in the data's unit",
        noise="stop that fit at this noise; auto estimates it (default)",
    )
    group.add_argument("--model", metavar="FILE.tspl", help="write the T-spline of --exact or --smooth-all")
    add_plot(group, "draw the map before and after, and the uncertainty")
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, fill, write."""
    from ..filling import fill_missing

    target, model, picture = _checked_paths(arguments)
    data = read_map(arguments, "holes are filled in")
    filled = fill_missing(data, **{name: getattr(arguments, name) for name in (*_FLAGS, *_CRITERIA)})
    write(target, filled.map)
    if model is not None:
        assert filled.surface is not None
        save(model, filled.surface)
    write_picture(picture, lambda: plot_filling(data, filled))
    warnings = list(filled.warnings)
    if target.suffix.lower() != ".npz" and filled.n_filled:
        warnings.append(f"{target.name} does not say which pixels were filled; .npz does")
    options = {name: getattr(arguments, name) for name in (*_FLAGS, *_CRITERIA)}
    report = {
        **written(output=target, model=model, plot=picture),
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
    picture = checked_picture(arguments.plot, *inputs)
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
