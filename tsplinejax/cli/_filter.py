"""`tsplinejax filter`: from a height map to its filtered version, and what was taken off."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._errors import InputError
from ..codec import MODEL_SUFFIX, save
from ..data import HeightMap
from ..io import WRITABLE, write
from ..plot import plot_filtered
from ._arguments import add_command, add_data_options, add_input, add_output, add_plot, add_tolerances
from ._files import checked_output, checked_picture, read_map, write_picture
from ._outcome import MET, STOPPED_EARLIER, Outcome, described, percentage, quantity, table

if TYPE_CHECKING:
    from ..filtration import Filtered

_MODELS = (MODEL_SUFFIX,)
_OPTIONS = (
    "tolerance",
    "relative_tolerance",
    "cutoff",
    "finest_spacing",
    "robust",
    "max_control_points",
    "max_seconds",
)


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "filter",
        "filter a height map: by a cut-off, or by a tolerance with edges kept",
        "tsplinejax filter map.x3p -o smooth.x3p --cutoff 8um --tolerance 50nm --residual rough.x3p --plot both.png",
        run,
    )
    add_input(parser)
    add_output(parser, f"file to write: {' '.join(WRITABLE)}")
    group = parser.add_argument_group("filter (none of these: a tolerance of five standard deviations of the noise)")
    add_tolerances(group, "keep edges higher than this, and stay within it of every pixel: 5nm, 0.8um")
    group.add_argument(
        "--cutoff", metavar="LENGTH", help="wavelength of which half passes: 1 / (1 + (cutoff / wavelength)^4)"
    )
    group.add_argument(
        "--finest-spacing", metavar="LENGTH", help="smallest element of the mesh; no sharp limit of wavelengths"
    )
    group.add_argument("--robust", action="store_true", help="set isolated spikes aside first")
    group = parser.add_argument_group(
        "budgets: where one ends the refinement, the map is written and the exit code is 1"
    )
    group.add_argument("--max-control-points", metavar="N", type=int, help="default: half the valid pixels")
    group.add_argument("--max-seconds", metavar="S", type=float, help="seconds")
    group = parser.add_argument_group("what else to write")
    group.add_argument("--residual", metavar="OUT", help="what was taken off, as a map")
    group.add_argument("--model", metavar="FILE.tspl", help="the filtered surface as a model")
    add_plot(group, "draw the filtered map and what was taken off")
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, filter, write."""
    from ..filtration import filter

    paths = _checked_paths(arguments)
    data = read_map(arguments, "what is filtered is")
    filtered = filter(data, **{name: getattr(arguments, name) for name in _OPTIONS})
    written: list[tuple[str, Any]] = [("output", filtered.filtered), ("residual", filtered.residual)]
    for name, height_map in written:
        if name in paths:
            write(paths[name], height_map)
    if "model" in paths:
        save(paths["model"], filtered.surface)
    write_picture(paths.get("plot"), lambda: plot_filtered(filtered))
    report = {
        **{name: str(paths[name]) if name in paths else None for name in ("output", "residual", "model", "plot")},
        **filtered.report,
    }
    report["provenance"] = {
        **report["provenance"],
        "options": {name: getattr(arguments, name) for name in _OPTIONS},
        "stop": report["stop"],
    }
    report["warnings"] = [*data.provenance.get("notes", ()), *report["warnings"], *_bare(paths, data)]
    return Outcome(report, _lines(data, filtered, paths), MET if filtered.converged else STOPPED_EARLIER)


def _checked_paths(arguments: argparse.Namespace) -> dict[str, Path]:
    """Every file to write, by name, all different."""
    inputs = (arguments.input, arguments.mask)
    suffixes = {"output": WRITABLE, "residual": WRITABLE, "model": _MODELS}
    paths = {
        name: checked_output(getattr(arguments, name), allowed, *inputs)
        for name, allowed in suffixes.items()
        if getattr(arguments, name) is not None
    }
    picture = checked_picture(arguments.plot, *inputs)
    if picture is not None:
        paths["plot"] = picture
    if len({path.resolve() for path in paths.values()}) < len(paths):
        raise InputError("two of the files to write are the same; name a file for each")
    return paths


def _bare(paths: dict[str, Path], data: HeightMap) -> list[str]:
    """A warning where a file cannot hold what is known."""
    known = data.unit is not None or data.spacing != (1.0, 1.0)
    names = [path.name for path in paths.values() if path.suffix.lower() == ".npy"]
    if not (known and names):
        return []
    return [f"{' and '.join(names)}: the bare numbers alone, without spacing and unit; .npz keeps them"]


def _lines(data: HeightMap, filtered: "Filtered", paths: dict[str, Path]) -> tuple[str, ...]:
    unit = filtered.unit
    rows = [
        ("data", described(data)),
        ("filter", filtered.operations[-1].removeprefix("filter ")),
        ("taken off", f"Sq {quantity(filtered.sq_removed, unit)}, Sa {quantity(filtered.sa_removed, unit)}"),
        ("largest", f"{quantity(filtered.max_error, unit)}{_criterion(filtered)}"),
        ("surface", f"{filtered.control_points} control points"),
        ("time", f"{filtered.seconds:.1f} s"),
        ("written", ", ".join(str(path) for path in paths.values())),
    ]
    if filtered.tolerance is not None:
        rows.insert(4, ("edges", f"kept on {percentage(filtered.edge_share)} of the area"))
    if filtered.outliers:
        rows.insert(2, ("set aside", f"{filtered.outliers} pixels"))
    return table(rows)


def _criterion(filtered: "Filtered") -> str:
    if filtered.tolerance is None:
        return ""
    met = "met" if filtered.converged else f"not met ({filtered.stop})"
    return f" (tolerance {quantity(filtered.tolerance, filtered.unit)}: {met})"
