"""`tsplinejax info`: what is in a file of data, and what tolerances would cost; or what a model is."""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError
from ..codec import load, load_header
from ..codec._decompress import is_compressed
from ..data import HeightMap, PointCloud, estimate_noise, find_outliers, is_spiked, robust_span
from ..fitting import ToleranceStudy, tolerance_study
from ..io._files import existing_file
from ..plot import plot_tolerance_study
from ._arguments import add_command, add_data_options, add_plot
from ._compress import about_compressed
from ._files import checked_picture, is_model, read_data, write_picture
from ._level import plane_of
from ._outcome import Outcome, pair, percentage, quantity, table

_TILTED = 0.9
_SAID = ("the range", "a plane")


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "info",
        "tell what a file holds, and which tolerances suit it",
        "tsplinejax info map.x3p",
        run,
    )
    parser.add_argument("file", metavar="FILE", help="data, or a model")
    parser.add_argument(
        "--max-seconds",
        metavar="S",
        type=float,
        default=30.0,
        help="limit of the trial fit behind the suggested tolerances (default 30); 0 leaves it out",
    )
    add_plot(parser, "draw control points against tolerance")
    add_data_options(parser, "FILE")


def run(arguments: argparse.Namespace) -> Outcome:
    """Tell about data or a model."""
    if is_model(arguments.file):
        if arguments.plot is not None:
            raise InputError("--plot draws what tolerances cost, of data; a model is drawn by: tsplinejax plot")
        if is_compressed(existing_file(arguments.file)):
            return about_compressed(arguments.file)
        return _about_model(arguments.file)
    picture = checked_picture(arguments.plot, arguments.file)
    data = read_data(arguments.file, arguments)
    report = _of_data(data)
    study = _study(data, arguments.max_seconds, report)
    if picture is not None:
        if study is None:
            raise InputError("there is no tolerance study to draw: " + "; ".join(report["warnings"] or ["left out"]))
        write_picture(picture, lambda: plot_tolerance_study(study))
        report["plot"] = str(picture)
    return Outcome(report, _data_lines(report))


def _of_data(data: HeightMap | PointCloud) -> dict[str, Any]:
    """What can be said without a fit."""
    is_map = isinstance(data, HeightMap)
    heights = data.heights[data.valid] if isinstance(data, HeightMap) else data.points[:, 2]
    heights = heights.astype(np.float64)
    report: dict[str, Any] = {
        "kind": "height map" if is_map else "point cloud",
        "name": data.provenance.get("name"),
        "sha256": data.provenance.get("sha256"),
        "shape": list(data.shape) if isinstance(data, HeightMap) else [len(data.points), 3],
        "spacing": list(data.spacing) if isinstance(data, HeightMap) else None,
        "unit": data.unit,
        "share_valid": float(data.valid.mean()) if isinstance(data, HeightMap) else 1.0,
        "range": float(np.ptp(heights)) if heights.size else None,
        "robust_span": robust_span(heights) if heights.size else None,
        "dtype": str(data.heights.dtype if isinstance(data, HeightMap) else data.points.dtype),
        "operations": list(data.provenance.get("operations", ())),
        "warnings": list(data.provenance.get("notes", ())),
        "plot": None,
    }
    report |= {"tilt": None, "noise": None, "spikes": None}
    try:
        report["tilt"] = _tilt(data, heights)
        estimate = estimate_noise(data)
        report["noise"] = estimate.sigma
        report["spikes"] = int(np.count_nonzero(find_outliers(data)))
    except InputError as error:
        report["warnings"].append(str(error))
    return report


def _tilt(data: HeightMap | PointCloud, heights: np.ndarray) -> dict[str, float]:
    """The least-squares plane: its slopes, and the share of the variance that it explains."""
    slopes, plane = plane_of(data)
    variance = float(heights.var())
    share = float(plane.var()) / variance if variance > 0 else 0.0
    return {"share_of_variance": share, "slope_x": float(slopes[0]), "slope_y": float(slopes[1])}


def _data_warnings(report: dict[str, Any]) -> list[str]:
    """What makes a tolerance relative to the range mean something else than intended."""
    warnings = []
    if report["range"] and is_spiked(report["range"], report["robust_span"]):
        warnings.append("the range is more than three times the 0.1-99.9 % span: spikes: use --robust")
    if report["tilt"] and report["tilt"]["share_of_variance"] > _TILTED:
        warnings.append("a plane explains over 90 % of the variance: tilt: use --level plane")
    return warnings


def _study(data: HeightMap | PointCloud, max_seconds: float, report: dict[str, Any]) -> ToleranceStudy | None:
    """Try out tolerances; what prevents it is a warning, since the rest is worth telling."""
    report["warnings"] += _data_warnings(report)
    report |= {"suggested_tolerances": [], "tolerances": []}
    if max_seconds <= 0 or report["tilt"] is None:
        return None
    try:
        study = tolerance_study(data, max_seconds=max_seconds)
    except InputError as error:
        report["warnings"].append(f"no tolerances are suggested: {error}")
        return None
    report["suggested_tolerances"] = [
        {
            "name": entry.name,
            "tolerance": entry.tolerance,
            "control_points": entry.control_points,
            "reason": entry.reason,
        }
        for entry in study.suggested
    ]
    report["tolerances"] = [
        {"tolerance": tolerance, "control_points": count}
        for tolerance, count in zip(study.tolerances, study.control_points, strict=True)
    ]
    # The study says in the library's words what was said already.
    report["warnings"] += [warning for warning in study.warnings if not warning.startswith(_SAID)]
    return study


def _data_lines(report: dict[str, Any]) -> tuple[str, ...]:
    unit = report["unit"]
    rows = [("file", f"{report['name']}: {report['kind']}, {report['dtype']}")]
    if report["spacing"] is not None:
        shape = "{} rows × {} columns".format(*report["shape"])
        dx, dy = report["spacing"]
        rows.append(("shape", f"{shape}, spacing {pair(dx, dy, unit)}"))
    else:
        rows.append(("shape", f"{report['shape'][0]} points"))
    rows += [
        ("unit", unit or "unknown (state it with --unit)"),
        ("valid", percentage(report["share_valid"])),
    ]
    if report["range"] is not None:
        span = quantity(report["robust_span"], unit)
        rows.append(("range", f"{quantity(report['range'], unit)}; 99.8 % of the samples within {span}"))
    if report["tilt"] is not None:
        tilt = report["tilt"]
        explained = percentage(tilt["share_of_variance"])
        rows.append(("tilt", f"slopes {tilt['slope_x']:.3g}, {tilt['slope_y']:.3g}; {explained} of the variance"))
    rows += [
        ("noise", f"{quantity(report['noise'], unit)} (standard deviation, estimated)"),
        ("spikes", "unknown" if report["spikes"] is None else f"{report['spikes']} isolated samples"),
    ]
    for entry in report["suggested_tolerances"]:
        cost = f"about {entry['control_points']} control points"
        rows.append(
            (f"{entry['name']} fit", f"tolerance {quantity(entry['tolerance'], unit)}: {cost}; {entry['reason']}")
        )
    return table(rows)


def _about_model(path: str) -> Outcome:
    header, surface = load_header(path), load(path)
    report = {
        "kind": "model",
        "values": header.kind,
        "name": Path(path).name,
        "control_points": header.control_points,
        "elements": header.elements,
        "lattice": header.lattice,
        "first_cut": header.first_cut,
        "border": header.border,
        "rational": header.rational,
        "dtype": header.dtype,
        "origin": header.frame.origin,
        "extent": header.frame.extent,
        "unit": header.frame.unit,
        "software": header.software,
        "bytes": Path(path).stat().st_size,
        **{
            name: header.fit.get(name) for name in ("tolerance", "max_error", "rms_error", "range", "converged", "stop")
        },
        "fit": header.fit,
        "provenance": header.provenance,
        "warnings": [],
    }
    unit = header.frame.unit
    x0, y0 = header.frame.origin
    form = "rational" if header.rational else "polynomial"
    lattice = "mesh given by hand" if header.lattice is None else "lattice {} × {}".format(*header.lattice)
    level = int(surface.space.mesh.levels.max())
    rows = [
        ("file", f"{report['name']}: T-spline of {header.kind}, {form}, {header.dtype}, by {header.software}"),
        ("size", f"{header.control_points} control points, {header.elements} elements, {lattice}, level {level}"),
        ("extent", f"{pair(*header.frame.extent, unit)}, from ({x0:g}, {y0:g})"),
    ]
    if header.fit:
        rows.append(
            ("largest error", f"{quantity(header.fit.get('max_error'), unit)} (stop: {header.fit.get('stop')})")
        )
        rows.append(("rms error", quantity(header.fit.get("rms_error"), unit)))
    source = header.provenance.get("input")
    if isinstance(source, dict) and source.get("name"):
        rows.append(("fitted to", str(source["name"])))
        rows += [("operation", str(operation)) for operation in source.get("operations", ())]
    return Outcome(report, table(rows))
