"""`tsplinejax fit`: from measured data to a model file."""

import argparse
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError
from ..codec import MODEL_SUFFIX, save
from ..data import HeightMap, PointCloud, StoredMap
from ..fitting import FitResult, GlobalSolver, LocalSolver, fit
from ..mesh import AnalysisSuitable, Dyadic
from ..plot import plot_overview
from ._arguments import (
    Parser,
    add_command,
    add_data_options,
    add_input,
    add_output,
    add_plot,
    add_tolerances,
    lattice,
    weight,
)
from ._files import checked_output, checked_picture, read_data, write_picture
from ._level import levelled
from ._outcome import MET, STOPPED_EARLIER, Outcome, described, quantity, table, written
from ._stored import add_memory_option, described_stored, stored_data

_MODELS = (MODEL_SUFFIX,)


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "fit",
        "fit a T-spline to measured data and write the model",
        "tsplinejax fit map.x3p -o map.tspl --tolerance 5nm --robust --plot map.png",
        run,
    )
    add_input(parser, "height map or point cloud")
    add_output(parser, "the model file to write", "MODEL.tspl")
    add_fit_options(parser)
    add_memory_option(parser)
    add_plot(parser, "draw T-mesh, errors, convergence and surface")
    parser.add_argument(
        "--checkpoint",
        metavar="FILE",
        help="keep the last step in this file, and go on from it where it exists; removed once the criterion is met "
        "and the model written",
    )


def add_fit_options(parser: Parser, what: str = "the input") -> None:
    """Add what says how data are read and fitted."""
    _add_criterion(parser)
    _add_method(parser)
    group = parser.add_argument_group("budgets: where one ends the fit, the model is written and the exit code is 1")
    group.add_argument("--max-steps", metavar="N", type=int, help="steps of refinement")
    group.add_argument("--max-control-points", metavar="N", type=int, help="default: half the valid samples")
    group.add_argument("--max-seconds", metavar="S", type=float, help="seconds")
    add_data_options(parser, what)


def _add_criterion(parser: Parser) -> None:
    group = parser.add_argument_group("criterion (at most one of the first three; none means --noise auto)")
    add_tolerances(
        group,
        "largest error at any sample: 5nm, 0.8um, or in the data's unit",
        noise="stop at the noise: estimated, or of this standard deviation",
    )
    group.add_argument("--robust", action="store_true", help="set isolated spikes aside first")
    group.add_argument(
        "--level", choices=("none", "plane"), default="none", help="take off a plane first (default none)"
    )
    group.add_argument("--as-surface", action="store_true", help="fit a cloud's points in space, not z over (x, y)")


def _add_method(parser: Parser) -> None:
    group = parser.add_argument_group("method")
    group.add_argument(
        "--refinement",
        choices=("analysis-suitable", "dyadic"),
        default="analysis-suitable",
        help="dyadic is the paper's (default analysis-suitable)",
    )
    group.add_argument(
        "--solver",
        choices=("local", "global"),
        default="local",
        help="which control points a step updates (default local); dyadic with local updates the altered ones alone, "
        "which is the paper's algorithm",
    )
    group.add_argument(
        "--lattice", metavar="auto|MxN", type=lattice, help="start lattice, M along x; auto tries a few, in more time"
    )
    group.add_argument("--first-cut", choices=("s", "t"), default="s", help="direction of the first cut (default s)")
    group.add_argument(
        "--smoothing", metavar="auto|X", type=weight, default="auto", help="weight of the bending energy (default auto)"
    )
    group.add_argument("--dtype", choices=("float64", "float32"), help="precision (default: the data's)")


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, fit, write."""
    target = checked_output(arguments.output, _MODELS, arguments.input, arguments.mask)
    picture = checked_picture(arguments.plot, arguments.input, arguments.mask)
    options, checkpoint = fit_options(arguments), _checked_checkpoint(arguments)
    if arguments.max_memory is None:
        data = prepared_data(arguments.input, arguments)
    else:
        data, options["max_memory"] = stored_data(arguments), arguments.max_memory
    result = fit(data, checkpoint=checkpoint, **options)
    save(target, result)
    write_picture(picture, lambda: plot_overview(result))
    report = {
        **written(model=target, plot=picture),
        **report_of(result),
    }
    if checkpoint is not None:
        if result.converged:  # the model is safe, and there is nothing left to go on from
            checkpoint.unlink(missing_ok=True)
        report["checkpoint"] = str(checkpoint) if checkpoint.exists() else None
    return Outcome(report, _lines(data, result, report), MET if result.converged else STOPPED_EARLIER)


def _checked_checkpoint(arguments: argparse.Namespace) -> Path | None:
    """The path of the checkpoint, if there is to be one; no other file may lose its place to it."""
    if arguments.checkpoint is None:
        return None
    path = Path(arguments.checkpoint)
    others = (arguments.input, arguments.output, arguments.plot, arguments.mask)
    if any(other is not None and Path(other).resolve() == path.resolve() for other in others):
        raise InputError(f"the checkpoint {path} is the input or an output, too; name a file of its own")
    return path


def prepared_data(path: str, arguments: argparse.Namespace) -> HeightMap | PointCloud:
    """The data of a file as they are to be fitted."""
    data = read_data(path, arguments)
    return levelled(data) if arguments.level == "plane" else data


def fit_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """The options of `fit` in Python's words."""
    dyadic, local = arguments.refinement == "dyadic", arguments.solver == "local"
    solver = LocalSolver(ring=0) if dyadic and local else LocalSolver() if local else GlobalSolver()
    names = (
        "tolerance",
        "relative_tolerance",
        "noise",
        "robust",
        "as_surface",
        "lattice",
        "first_cut",
        "smoothing",
        "dtype",
        "max_steps",
        "max_control_points",
        "max_seconds",
    )
    return {
        **{name: getattr(arguments, name) for name in names},
        "refinement": Dyadic() if dyadic else AnalysisSuitable(),
        "solver": solver,
        "progress": sys.stderr.isatty(),
    }


def report_of(result: FitResult) -> dict[str, Any]:
    """A fit's figures, under the names that all commands use."""
    names = (
        "control_points",
        "elements",
        "converged",
        "tolerance",
        "max_error",
        "rms_error",
        "snr_db",
        "snr_db_centred",
        "range",
        "unit",
        "noise",
        "smoothing",
        "seconds",
        "warnings",
        "provenance",
    )
    return {
        **{name: getattr(result, name) for name in names},
        "stop": str(result.stop),
        "stop_message": result.stop.message,
        "steps": len(result.history) - 1,
        "samples": result.n_samples,
        "outliers": 0 if result.at_samples is None else int(np.count_nonzero(result.outliers)),
        "history": [asdict(step) for step in result.history],
    }


def _lines(data: HeightMap | PointCloud | StoredMap, result: FitResult, report: dict[str, Any]) -> tuple[str, ...]:
    unit = result.unit
    if result.tolerance is not None:
        criterion = f"tolerance {quantity(result.tolerance, unit)}"
    else:
        criterion = f"noise of standard deviation {quantity(result.noise, unit)}"
    rows = [
        ("data", described_stored(data) if isinstance(data, StoredMap) else described(data)),
        ("criterion", f"{criterion}: {'met' if result.converged else f'not met ({result.stop})'}"),
        ("model", f"{result.control_points} control points, {result.elements} elements"),
        ("largest error", quantity(result.max_error, unit)),
        ("rms error", f"{quantity(result.rms_error, unit)} (SNR {result.snr_db_centred:.3g} dB, mean removed)"),
        ("time", f"{result.seconds:.1f} s, {report['steps']} steps"),
        ("written", ", ".join(name for name in (report["model"], report["plot"]) if name)),
    ]
    if report.get("checkpoint"):
        rows.append(("checkpoint", f"{report['checkpoint']}: the next fit goes on from it"))
    if report["outliers"]:
        rows.insert(3, ("set aside", f"{report['outliers']} of {report['samples']} samples"))
    return table(rows)
