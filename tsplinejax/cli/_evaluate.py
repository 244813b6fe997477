"""`tsplinejax evaluate`: heights or points of a model, where they are wanted."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError
from ..codec import load
from ..data import HeightMap, PointCloud
from ..io import WRITABLE, write
from ..io._arrays import load_npy
from ..io._files import MOST_VALUES, existing_file, reading, written_whole
from ..surface import TSpline, parameter_grid
from ._arguments import add_command, add_data_options, add_output, counts, data_options
from ._files import checked_model, checked_output, read_data
from ._outcome import Outcome, percentage, quantity, table
from ._places import at_parameters, at_places, in_unit_of

_CLOUDS = (".npy", ".npz", ".csv", ".ply")


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "evaluate",
        "evaluate a model: heights, or points for a model in space",
        "tsplinejax evaluate map.tspl --shape 480x640 -o fine.npy",
        run,
    )
    parser.add_argument("model", metavar="MODEL.tspl", help="the model")
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--like", metavar="INPUT", help="at the pixels or points of these data; NaN outside the model")
    where.add_argument("--shape", metavar="RxC", type=counts, help="on a grid of R rows and C columns over the model")
    where.add_argument("--parameters", metavar="P.npy", help="at parameters (s, t) in [0, 1]: an array of two columns")
    add_output(
        parser,
        "bare array (.npy), or with spacing and unit: .npz .csv .x3p .gwy (maps), .npz .csv .ply (points)",
        "OUT.npy",
    )
    add_data_options(parser, "--like INPUT")


def run(arguments: argparse.Namespace) -> Outcome:
    """Load, evaluate, write."""
    sources = (arguments.model, arguments.like, arguments.parameters, arguments.mask)
    target = checked_output(arguments.output, WRITABLE, *sources)
    _refuse_data_options(arguments)
    surface = load(checked_model(arguments.model))
    if arguments.like is not None:
        values, data, extra = _like(surface, arguments)
    elif arguments.shape is not None:
        values, data, extra = _on_grid(surface, *arguments.shape)
    else:
        values, data, extra = _at_parameters(surface, arguments.parameters)
    _write(target, values, data)
    return _outcome(surface, target, values, extra)


def _refuse_data_options(arguments: argparse.Namespace) -> None:
    """Options that describe data make sense with data alone."""
    given = [name for name, value in data_options(arguments).items() if value is not None]
    if given and arguments.like is None:
        option = "--" + given[0].strip("_").replace("_", "-")
        raise InputError(f"{option} describes the data of --like, but there are none; leave it out")


Evaluated = tuple[np.ndarray, HeightMap | PointCloud | None, dict[str, Any]]


def _like(surface: TSpline, arguments: argparse.Namespace) -> Evaluated:
    """The model at the places of other data, and for heights how far it is from theirs."""
    data = in_unit_of(surface, read_data(arguments.like, arguments))
    if isinstance(data, HeightMap):
        rows, columns = data.shape
        y, x = np.mgrid[:rows, :columns]
        x, y = data.origin[0] + x * data.spacing[0], data.origin[1] + y * data.spacing[1]
        measured = data.heights
    else:
        (x, y), measured = data.points[:, :2].T, data.points[:, 2]
    values = at_places(surface, x, y)
    outside = float(np.isnan(values).mean())
    extra: dict[str, Any] = {"share_outside": outside}
    if outside == 1:
        raise InputError("every place lies outside the model; check --spacing, --unit and the origin of the data")
    if outside > 0:
        extra["warnings"] = [f"{percentage(outside)} of the places lie outside the model and are NaN"]
    if not surface.is_height_map:
        return values.reshape(-1, 3), None, extra
    errors = (values - measured)[np.isfinite(values) & np.isfinite(measured)]
    if errors.size:
        extra |= {"max_error": float(np.abs(errors).max()), "rms_error": float(np.sqrt(np.mean(errors**2)))}
    if isinstance(data, HeightMap):
        return values, HeightMap(values, data.spacing, data.unit, origin=data.origin), extra
    return values, _cloud(surface, np.column_stack([x, y, values])), extra


def _on_grid(surface: TSpline, rows: int, columns: int) -> Evaluated:
    """The model on a regular grid over its frame."""
    if min(rows, columns) < 2 or rows * columns > MOST_VALUES:
        raise InputError(
            f"a grid has at least 2 rows and 2 columns and at most {MOST_VALUES} places, but got {rows}x{columns}"
        )
    values = at_parameters(surface, parameter_grid(rows, columns))
    if not surface.is_height_map:
        return values, _cloud(surface, values), {}
    frame = surface.frame
    spacing = (frame.extent[0] / (columns - 1), frame.extent[1] / (rows - 1))
    heights = values.reshape(rows, columns)
    return heights, HeightMap(heights, spacing, frame.unit, origin=frame.origin), {}


def _at_parameters(surface: TSpline, path: str) -> Evaluated:
    """The model at given parameters."""
    file = existing_file(path)
    if file.suffix.lower() != ".npy":
        raise InputError(f"parameters are read from .npy, an array of two columns (s, t), but got {file.name!r}")
    with reading(file):
        parameters = load_npy(file)
        if parameters.ndim != 2 or parameters.shape[1] != 2 or parameters.dtype.kind not in "fiu":
            raise InputError(f"parameters are an (m, 2) array of (s, t), but got {parameters.dtype} {parameters.shape}")
        if not ((parameters >= 0) & (parameters <= 1)).all():
            raise InputError("parameters lie in [0, 1]; use --like for places x, y in the data's unit")
    values = at_parameters(surface, parameters)
    if surface.is_height_map:
        places = surface.frame.xy_of(parameters)
        return values, _cloud(surface, np.column_stack([places, values])), {}
    return values, _cloud(surface, values), {}


def _cloud(surface: TSpline, points: np.ndarray) -> PointCloud | None:
    """The points as data; `None` where some lie outside the model."""
    return PointCloud(points, surface.frame.unit) if np.isfinite(points).all() else None


def _write(target: Path, values: np.ndarray, data: HeightMap | PointCloud | None) -> None:
    """Write the bare array, or everything that is known about it."""
    if target.suffix.lower() == ".npy":
        with written_whole(target) as stream:
            np.save(stream, values, allow_pickle=False)
        return
    if data is None:
        raise InputError(f"values with NaN in them are written to .npy only, not to {target.name}")
    if isinstance(data, PointCloud) and target.suffix.lower() not in _CLOUDS:
        raise InputError(f"points cannot be written to {target.name}; use {' '.join(_CLOUDS)}")
    write(target, data)


def _outcome(surface: TSpline, target: Path, values: np.ndarray, extra: dict[str, Any]) -> Outcome:
    unit = surface.frame.unit
    finite = values[np.isfinite(values)] if surface.is_height_map else values[np.isfinite(values).all(axis=1)]
    spread = float(np.linalg.norm(np.ptp(finite, axis=0)))
    report = {
        "output": str(target),
        "kind": "heights" if surface.is_height_map else "points",
        "shape": list(values.shape),
        "range": spread,
        "unit": unit,
        "max_error": None,
        "rms_error": None,
        "warnings": [],
        **extra,
    }
    rows = [("values", f"{report['kind']}, {' × '.join(map(str, values.shape))}"), ("range", quantity(spread, unit))]
    if report["max_error"] is not None:
        rows.append(("largest error", f"{quantity(report['max_error'], unit)} to the heights of --like"))
        rows.append(("rms error", quantity(report["rms_error"], unit)))
    return Outcome(report, table([*rows, ("written", str(target))]))
