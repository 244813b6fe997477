"""`tsplinejax demo`: two real surfaces that come with dependencies, fitted, drawn and written."""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError, require
from ..codec import load, save
from ..data import HeightMap
from ..fitting import FitResult, fit
from ..io import write
from ..plot import plot_overview
from ._arguments import add_command
from ._files import checked_picture, named, write_picture
from ._outcome import Outcome, described, quantity
from ._places import at_places

_METRES_A_DEGREE = 111_200.0


@dataclass(frozen=True)
class Example:
    """A surface of the demo, and how it is fitted."""

    name: str
    title: str
    read: Callable[[], HeightMap]
    options: dict[str, Any] = field(default_factory=dict)


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers, "demo", "fit two real surfaces and write pictures and models", "tsplinejax demo -o demo-output", run
    )
    parser.add_argument("-o", "--output", metavar="DIR", default="tsplinejax-demo", help="folder (default %(default)s)")


def run(arguments: argparse.Namespace) -> Outcome:
    """Fit every example."""
    folder = Path(arguments.output)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be made: {error.strerror}; name another with -o") from error
    rows = [_row(example, folder) for example in EXAMPLES]
    report = {
        "output": str(folder),
        "examples": rows,
        "warnings": [f"{row['name']}: {warning}" for row in rows for warning in row["warnings"]],
    }
    return Outcome(report, _lines(rows, folder))


def _row(example: Example, folder: Path) -> dict[str, Any]:
    """Fit one example, write its picture and its model, and check the model as it was written."""
    picture = checked_picture(str(folder / f"{example.name}.png"))
    data = example.read()
    print(f"{example.title}: {described(data)}", file=sys.stderr)
    result = fit(data, progress=sys.stderr.isatty(), **example.options)
    write_picture(picture, lambda: plot_overview(result))
    model = save(folder / f"{example.name}.tspl", result)
    source = write(folder / f"{example.name}.npz", data)
    return {
        "name": example.name,
        "title": example.title,
        "shape": list(data.shape),
        "samples": len(result.samples),
        "control_points": result.control_points,
        "tolerance": result.tolerance,
        "max_error": _error_of_file(model, data, result),
        "rms_error": result.rms_error,
        "unit": result.unit,
        "converged": result.converged,
        "stop": str(result.stop),
        "seconds": result.seconds,
        "data": str(source),
        "model": str(model),
        "picture": str(picture),
        "warnings": list(result.warnings),
    }


def _error_of_file(model: Path, data: HeightMap, result: FitResult) -> float:
    """The largest error of the model as written, at every sample that was not set aside."""
    x, y = result.samples.frame.xy_of(result.samples.parameters).T
    errors = np.abs(at_places(load(model), x, y) - result.samples.values[:, 0])
    return float(errors[~result.outliers].max())


def _lines(rows: list[dict[str, Any]], folder: Path) -> tuple[str, ...]:
    heads = ("surface", "samples", "control points", "tolerance", "largest error", "rms error", "time", "stop")
    cells = [
        (
            row["name"],
            str(row["samples"]),
            str(row["control_points"]),
            quantity(row["tolerance"], row["unit"]),
            quantity(row["max_error"], row["unit"]),
            quantity(row["rms_error"], row["unit"]),
            f"{row['seconds']:.1f} s",
            row["stop"],
        )
        for row in rows
    ]
    widths = [max(len(line[k]) for line in [heads, *cells]) for k in range(len(heads))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in [heads, *cells]
    ]
    names = ", ".join(f"{row['name']}.png .tspl .npz" for row in rows)
    first = folder / rows[0]["name"]
    return (
        *lines,
        f"pictures, models and data are in {folder}: {names}",
        f"go on with: tsplinejax info {first}.npz; tsplinejax evaluate {first}.tspl --shape 700x800 -o fine.npy",
    )


def _fault() -> HeightMap:
    """Elevation over the Jacksboro fault in Tennessee (radar, from space), which ships with matplotlib."""
    path = Path(require("matplotlib.cbook", "plot").get_sample_data("jacksboro_fault_dem.npz", asfileobj=False))
    with np.load(path, allow_pickle=False) as grid:
        latitude = np.radians((grid["ymin"] + grid["ymax"]) / 2)
        dx, dy = grid["dx"] * _METRES_A_DEGREE * np.cos(latitude), grid["dy"] * _METRES_A_DEGREE
        return HeightMap(grid["elevation"], (float(dx), float(dy)), "m", provenance=_provenance(path))


def _motorcycle() -> HeightMap:
    """Disparity of two photographs of a motorcycle (Middlebury stereo), in pixels, which ships with scikit-image."""
    path = Path(str(files("skimage") / "data" / "motorcycle_disp.npz"))
    with np.load(path, allow_pickle=False) as arrays:
        disparity = arrays["arr_0"]
    # No disparity was found where it says infinity.
    return HeightMap(np.where(np.isfinite(disparity), disparity, np.nan), provenance=_provenance(path))


def _provenance(path: Path) -> dict[str, Any]:
    return {**named(path), "operations": []}


EXAMPLES = (
    Example("jacksboro-fault", "Jacksboro fault, elevation", _fault, {"relative_tolerance": 0.05}),
    Example("motorcycle", "Motorcycle, stereo disparity", _motorcycle, {"relative_tolerance": 0.4, "robust": True}),
)
