"""`tsplinejax plot`: a picture of data or of a model."""

import argparse
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import InputError
from ..codec import ModelHeader, load, load_header
from ..data import HeightMap, PointCloud, Samples, find_outliers
from ..plot import plot_error, plot_height_map, plot_mesh, plot_overview, plot_surface_3d
from ..plot._style import is_wide, new_figure, print_style
from ..surface import TSpline
from ._arguments import add_command, add_data_options, add_output, data_options
from ._files import checked_picture, is_model, read_data, write_picture
from ._outcome import Outcome, described, quantity, table
from ._places import at_places, in_unit_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "plot",
        "draw data, or a model: its T-mesh, its surface, its errors",
        "tsplinejax plot map.tspl --data map.x3p -o map.png",
        run,
    )
    parser.add_argument("file", metavar="FILE", help="data, or a model")
    add_output(parser, "picture to write: .png .pdf .svg", "FILE.png")
    parser.add_argument("--data", metavar="INPUT", help="for a model: draw its errors at these data, too")
    add_data_options(parser, "FILE (or --data)")


@dataclass(frozen=True, eq=False)
class Comparison:
    """A surface against data: what an error map shows."""

    surface: TSpline
    samples: Samples
    residuals: np.ndarray
    outliers: np.ndarray
    tolerance: float | None


def run(arguments: argparse.Namespace) -> Outcome:
    """Read and draw."""
    target = checked_picture(arguments.output, arguments.file, arguments.data, arguments.mask)
    if is_model(arguments.file):
        return _of_model(arguments, target)
    if arguments.data is not None:
        raise InputError("--data goes with a model (.tspl), but FILE is data; leave it out")
    data = read_data(arguments.file, arguments)
    write_picture(target, lambda: plot_height_map(data))
    report = {
        "output": str(target),
        "kind": "data",
        "unit": data.unit,
        "warnings": list(data.provenance.get("notes", ())),
    }
    return Outcome(report, table([("data", described(data)), ("written", str(target))]))


def _of_model(arguments: argparse.Namespace, target: Any) -> Outcome:
    surface = load(arguments.file)
    report: dict[str, Any] = {"output": str(target), "kind": "model", "unit": surface.frame.unit, "warnings": []}
    report |= {"max_error": None, "rms_error": None}
    rows = [("model", f"{surface.control_points.shape[0]} control points")]
    if arguments.data is None:
        if any(value is not None for value in data_options(arguments).values()):
            raise InputError("options that describe data need --data INPUT when FILE is a model")
        write_picture(target, lambda: plot_overview(surface))
    else:
        compared = compare(
            surface, in_unit_of(surface, read_data(arguments.data, arguments)), load_header(arguments.file)
        )
        write_picture(target, lambda: draw_comparison(compared))
        kept = ~compared.outliers
        errors = np.linalg.norm(compared.residuals.reshape(len(kept), -1)[kept], axis=1)
        report |= {"max_error": float(errors.max()), "rms_error": float(np.sqrt(np.mean(errors**2)))}
        rows.append(("largest error", quantity(report["max_error"], surface.frame.unit)))
        rows.append(("rms error", quantity(report["rms_error"], surface.frame.unit)))
    return Outcome(report, table([*rows, ("written", str(target))]))


def compare(surface: TSpline, data: HeightMap | PointCloud, header: ModelHeader) -> Comparison:
    """The errors of a surface at data, at their places (x, y); isolated spikes are set aside where the fit did."""
    samples = (
        data.samples(as_surface=True) if isinstance(data, PointCloud) and not surface.is_height_map else data.samples()
    )
    if not surface.is_height_map and samples.dimension == 1:
        raise InputError(
            "the model is a surface in space, so its errors are drawn at a point cloud, not at a height map"
        )
    x, y = samples.frame.xy_of(samples.parameters).T
    values = at_places(surface, x, y)
    measured = samples.values[:, 0] if surface.is_height_map else samples.values
    residuals = measured - values
    inside = np.isfinite(residuals.reshape(len(residuals), -1)).all(axis=1)
    if not inside.any():
        raise InputError("every sample lies outside the model; check --spacing, --unit and the origin of the data")
    grid_index = None if samples.grid_index is None else samples.grid_index[inside]
    kept = Samples(
        samples.parameters[inside], samples.values[inside], None, samples.frame, samples.grid_shape, grid_index
    )
    robust = bool(header.fit.get("outliers"))
    outliers = find_outliers(kept) if robust else np.zeros(len(kept), bool)
    return Comparison(surface, kept, residuals[inside], outliers, header.fit.get("tolerance"))


def draw_comparison(compared: Comparison) -> "Figure":
    """T-mesh over the data, error map, and the surface in space."""
    maps_height, view_height = _map_row(compared.surface.frame.extent), 3.4
    with print_style():
        figure = new_figure(8.6, maps_height + view_height)
        parts: Any = figure.subfigures(2, 1, height_ratios=[maps_height, view_height])
        plot_mesh(compared, parts[0].add_subplot(1, 2, 1))
        plot_error(compared, parts[0].add_subplot(1, 2, 2))
        plot_surface_3d(compared.surface, parts[1].add_subplot(projection="3d"))
    return figure


def _map_row(extent: tuple[float, float]) -> float:
    """Inches for two maps side by side with labels, whose colour bars stand beside them, or on top of wide ones."""
    width, room = (3.5, 1.5) if is_wide(extent) else (2.9, 0.7)
    return min(max(width * extent[1] / extent[0], 0.3), 3.6) + room
