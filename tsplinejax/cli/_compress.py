"""`tsplinejax compress` and `decompress`: a height map as few bytes, every valid pixel within a bound, and back."""

import argparse
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..codec import MODEL_SUFFIX, CompressedHeader, compress, compressed_header, decompress
from ..codec._drift import drift
from ..data import HeightMap, is_spiked, quick_noise, robust_span, tolerance_cautions
from ..io import WRITABLE, write
from ..io._files import written_whole
from ..plot import plot_error, plot_height_map
from ..plot._style import new_figure, print_style
from ._arguments import Parser, add_command, add_data_options, add_input, add_output, add_plot, counts, share
from ._files import checked_output, checked_picture, read_map, write_picture
from ._outcome import Outcome, described, percentage, quantity, table, written

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The paper keeps a control point in three numbers of eight bytes.
_PAPER_BYTES = 24


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add both commands to the parser."""
    parser = add_command(
        subparsers,
        "compress",
        "compress a height map, every valid pixel within a bound",
        "tsplinejax compress map.x3p -o map.tspl --tolerance 1nm",
        run_compress,
    )
    add_input(parser)
    add_output(parser, "the compressed file to write", "FILE.tspl")
    _add_bound(parser)
    add_plot(parser, "draw what the file decodes to, and its errors")
    add_data_options(parser)

    parser = add_command(
        subparsers,
        "decompress",
        "turn a compressed file into a height map",
        "tsplinejax decompress map.tspl -o map.npz",
        run_decompress,
    )
    add_input(parser, "the compressed file", "FILE.tspl")
    add_output(parser, f"file to write: {' '.join(WRITABLE)}")
    parser.add_argument(
        "--shape", metavar="RxC", type=counts, help="another grid of R rows and C columns over the same extent"
    )
    add_plot(parser, "draw the map")


def _add_bound(parser: Parser) -> None:
    group = parser.add_argument_group("bound (one of the two) and way")
    one = group.add_mutually_exclusive_group(required=True)
    one.add_argument(
        "--tolerance",
        "--max-error",
        metavar="X",
        dest="max_error",
        help="largest error of any valid pixel: 5nm, 0.8um, or in the data's unit; 0 keeps every bit",
    )
    one.add_argument(
        "--relative-tolerance",
        "--relative-max-error",
        metavar="X",
        dest="relative_max_error",
        type=share,
        help="the same as a share of the range: 0.01 or 1%%",
    )
    group.add_argument("--dtype", choices=("float64", "float32"), help="of the decoded heights (default: the data's)")
    group.add_argument(
        "--mode",
        choices=("smallest", "grid", "model", "lossless"),
        default="smallest",
        help="smallest tries all (default); grid leaves out the fit of a T-spline, which takes most of the time; model "
        "insists on one that keeps the bound alone; lossless keeps every bit",
    )


def run_compress(arguments: argparse.Namespace) -> Outcome:
    """Read, compress, write, and compare what comes back."""
    target = checked_output(arguments.output, (MODEL_SUFFIX,), arguments.input, arguments.mask)
    picture = checked_picture(arguments.plot, arguments.input, arguments.mask)
    data = read_map(arguments, "what is compressed is")
    names = ("max_error", "relative_max_error", "dtype", "mode")
    content = compress(data, **{name: getattr(arguments, name) for name in names})
    with written_whole(target) as stream:
        stream.write(content)
    header, decoded = compressed_header(content), decompress(content)
    write_picture(picture, lambda: _drawn(data, decoded, header.tolerance))
    report = {
        **written(output=target, plot=picture),
        **_report(data, decoded, header, len(content)),
        "warnings": _warnings(data, header, arguments.relative_max_error is not None),
    }
    return Outcome(report, _lines(data, report))


def _report(data: HeightMap, decoded: HeightMap, header: CompressedHeader, size: int) -> dict[str, Any]:
    """What the file is worth."""
    errors = (decoded.heights.astype(np.float64) - data.heights)[data.valid]
    points = None if header.model is None else header.model.control_points
    return {
        "mode": header.mode,
        "bytes": size,
        "ratio": data.heights.nbytes / size,
        "control_points": points,
        "paper_bytes": None if points is None else _PAPER_BYTES * points,
        "corrected": header.model is not None and header.model.residual,
        "tolerance": header.tolerance,
        "max_error": float(np.abs(errors).max()),
        "rms_error": float(np.sqrt(np.mean(errors**2))),
        **drift(data, decoded),
        "range": data.range,
        "unit": data.unit,
        "shape": list(data.shape),
        "missing": header.missing,
        "dtype": header.dtype,
        "provenance": header.provenance,
    }


def _warnings(data: HeightMap, header: CompressedHeader, relative: bool) -> list[str]:
    """What the user should know about the bound."""
    cautions = tolerance_cautions(
        header.tolerance,
        data.range,
        quick_noise(data),
        result="the file",
        remedy="most bytes describe it",
        name="bound",
    )
    if relative and is_spiked(data.range, robust_span(data.heights[data.valid])):
        cautions.append("spikes stretch the range that the bound is a share of; give the bound as a length")
    return [*data.provenance.get("notes", ()), *cautions]


def _lines(data: HeightMap, report: dict[str, Any]) -> tuple[str, ...]:
    unit = data.unit
    rows = [
        ("data", described(data)),
        ("bound", quantity(report["tolerance"], unit)),
        ("largest error", quantity(report["max_error"], unit)),
        ("rms error", quantity(report["rms_error"], unit)),
        ("way", _way(report)),
        ("size", f"{report['bytes']} bytes, {report['ratio']:.4g} times smaller than {report['dtype']} heights"),
        ("written", ", ".join(name for name in (report["output"], report["plot"]) if name)),
    ]
    changes = [f"{name} {100 * report[key]:+.2g} %" for name, key in _DRIFTS if report[key] is not None]
    if changes:
        rows.insert(4, ("drift", ", ".join(changes)))
    return table(rows)


def _way(report: dict[str, Any]) -> str:
    """How the map is coded, in words."""
    if report["mode"] != "model":
        return {"grid": "predicted pixels", "lossless": "every bit"}[report["mode"]]
    return f"T-spline of {report['control_points']} control points"


_DRIFTS = (("Sq", "sq_drift"), ("Sdq", "sdq_drift"))


def _drawn(data: HeightMap, decoded: HeightMap, bound: float) -> "Figure":
    """The decoded map beside its errors, the bound marked."""
    samples = data.samples()
    errors = (data.heights.astype(np.float64) - decoded.heights)[data.valid]
    result = SimpleNamespace(samples=samples, residuals=errors, outliers=None, tolerance=bound or None)
    with print_style():
        height = min(max(2.9 * data.extent[1] / data.extent[0], 0.5), 3.6) + 0.7
        figure = new_figure(8.6, height)
        plot_height_map(decoded, figure.add_subplot(1, 2, 1))
        plot_error(result, figure.add_subplot(1, 2, 2))
    return figure


def about_compressed(path: str) -> Outcome:
    """What `info` says of a compressed file."""
    header = compressed_header(path)
    report = {
        "file": path,
        "kind": "compressed height map",
        "mode": header.mode,
        "bytes": Path(path).stat().st_size,
        "shape": list(header.shape),
        "spacing": list(header.spacing),
        "origin": list(header.origin),
        "unit": header.unit,
        "dtype": header.dtype,
        "missing": header.missing,
        "control_points": None if header.model is None else header.model.control_points,
        "elements": None if header.model is None else header.model.elements,
        "tolerance": header.tolerance,
        "max_error": header.max_error,
        "rms_error": None,
        "range": None,
        "software": header.software,
        "provenance": header.provenance,
        "warnings": [],
    }
    rows = [
        ("file", f"{path}: compressed height map ({_way(report)}), {header.dtype}, by {header.software}"),
        ("size", f"{report['bytes']} bytes, {header.shape[0]} rows × {header.shape[1]} columns"),
        ("missing", f"{header.missing} pixels"),
        ("bound", quantity(header.tolerance, header.unit)),
        ("largest error", quantity(header.max_error, header.unit)),
    ]
    return Outcome(report, table(rows))


def run_decompress(arguments: argparse.Namespace) -> Outcome:
    """Read and write."""
    target = checked_output(arguments.output, WRITABLE, arguments.input)
    picture = checked_picture(arguments.plot, arguments.input)
    header = compressed_header(arguments.input)
    data = decompress(arguments.input, shape=arguments.shape)
    write(target, data)
    write_picture(picture, lambda: plot_height_map(data))
    warnings = []
    if target.suffix.lower() == ".npy":
        warnings.append(f"{target.name} holds the bare numbers: spacing and unit are not in it; .npz keeps them")
    report = {
        **written(output=target, plot=picture),
        "mode": header.mode,
        "shape": list(data.shape),
        "spacing": list(data.spacing),
        "unit": data.unit,
        "range": data.range,
        "share_valid": float(data.valid.mean()),
        "dtype": header.dtype,
        "control_points": None if header.model is None else header.model.control_points,
        "tolerance": header.tolerance,
        "max_error": header.max_error if arguments.shape is None else None,
        "rms_error": None,
        "provenance": header.provenance,
        "warnings": warnings,
    }
    rows = [
        ("data", described(data)),
        ("bound", f"{quantity(header.tolerance, data.unit)}, on its own grid of {header.shape[0]} × {header.shape[1]}"),
        ("valid", percentage(report["share_valid"])),
        ("written", str(target)),
    ]
    return Outcome(report, table(rows))
