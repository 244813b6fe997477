"""`tsplinejax reconstruct`: a surface from few samples, over a known T-mesh."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import InputError
from .._version import __version__
from ..codec import MODEL_SUFFIX, load, save
from ..data import Frame, HeightMap, Samples
from ..io import WRITABLE, write
from ..io._arrays import load_npz
from ..io._files import existing_file, reading
from ..plot import plot_samples
from ..surface import TSpline, heights_on_grid
from ._arguments import add_command, add_output, add_plot, counts, weight
from ._files import checked_model, checked_output, checked_picture, named, write_picture
from ._outcome import Outcome, quantity, table, written

if TYPE_CHECKING:
    from ..sampling import Reconstruction

_LONGER_SIDE = 512


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "reconstruct",
        "recover a surface from few samples",
        "tsplinejax reconstruct samples.npz --model nominal.tspl -o map.npz",
        run,
    )
    parser.add_argument("samples", metavar="SAMPLES.npz", help="arrays parameters (m, 2) and values (m, d)")
    parser.add_argument(
        "--model", metavar="M.tspl", required=True, help="model whose T-mesh the surface is known to have"
    )
    add_output(
        parser,
        f"model ({MODEL_SUFFIX}), or map to write: {' '.join(WRITABLE)}",
        "OUT",
    )
    parser.add_argument(
        "--smoothing", metavar="auto|X", type=weight, default="auto", help="weight of the bending energy (default auto)"
    )
    parser.add_argument(
        "--shape",
        metavar="RxC",
        type=counts,
        help=f"rows and columns of a map (default: those of the map the samples come from, or {_LONGER_SIDE} "
        "along the longer side)",
    )
    add_plot(parser, "draw the surface with its T-mesh and the samples")


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, solve, write."""
    from ..sampling import reconstruct

    inputs = (arguments.samples, arguments.model)
    target = checked_output(arguments.output, (MODEL_SUFFIX, *WRITABLE), *inputs)
    picture = checked_picture(arguments.plot, *inputs)
    model = load(checked_model(arguments.model))
    samples, shape = read_samples(arguments.samples, model)
    if target.suffix.lower() == MODEL_SUFFIX and arguments.shape is not None:
        raise InputError("--shape is of a map, but the output is a model; leave one of them out")
    if target.suffix.lower() != MODEL_SUFFIX and not model.is_height_map:
        raise InputError(f"the model has points in space, so the output is a model: name a file *{MODEL_SUFFIX}")
    result = reconstruct(samples, model, smoothing=arguments.smoothing)
    if target.suffix.lower() == MODEL_SUFFIX:
        save(target, result.surface)
    else:
        write(target, _map(result.surface, arguments.shape or shape))
    write_picture(picture, lambda: plot_samples(samples.parameters, result.surface))
    report = _report(arguments, target, picture, samples, result)
    return Outcome(report, _lines(report))


def read_samples(path: str, model: TSpline) -> tuple[Samples, tuple[int, int] | None]:
    """The samples of a file on a model's parameter square, and the shape of the map they come from."""
    file = existing_file(path)
    if file.suffix.lower() != ".npz":
        raise InputError(f"samples are read from .npz, as sample writes them, but got {file.name!r}")
    with reading(file):
        held = load_npz(file)
        missing = [name for name in ("parameters", "values") if name not in held]
        if missing:
            raise InputError(f"it holds {', '.join(sorted(held)) or 'nothing'}, but no array named {missing[0]!r}")
        samples = Samples(held["parameters"], held["values"], None, model.frame)
        if samples.dimension != (1 if model.is_height_map else 3):
            raise InputError(f"its values have dimension {samples.dimension}, those of the model another")
        _check_place(held, model)
        shape = held.get("shape")
    return samples, None if shape is None else (int(shape[0]), int(shape[1]))


def _check_place(held: dict[str, np.ndarray], model: TSpline) -> None:
    """Samples that say where and in what unit they are must be of the model's place and unit."""
    unit = str(held["unit"]) if "unit" in held else ""
    if unit and model.unit and unit != model.unit:
        raise InputError(f"its values are in {unit}, the model is in {model.unit}; sample with this model")
    if model.is_height_map and "origin" in held and "extent" in held:
        frame = Frame(tuple(held["origin"]), tuple(held["extent"]), unit or None)
        scale = max(model.frame.extent)
        apart = np.abs(np.subtract([*frame.origin, *frame.extent], [*model.frame.origin, *model.frame.extent])).max()
        if apart > 1e-6 * scale:
            raise InputError("its samples lie over another rectangle than the model; sample with this model")


def _map(surface: TSpline, shape: tuple[int, int] | None) -> HeightMap:
    """The surface on a grid from border to border."""
    frame = surface.frame
    if shape is None:
        width, height = frame.extent
        step = max(width, height) / (_LONGER_SIDE - 1)
        shape = (max(2, round(height / step) + 1), max(2, round(width / step) + 1))
    if min(shape) < 2:
        raise InputError(f"a map has at least 2 rows and 2 columns; received {shape[0]}x{shape[1]}")
    spacing = (frame.extent[0] / (shape[1] - 1), frame.extent[1] / (shape[0] - 1))
    return HeightMap(heights_on_grid(surface, shape), spacing, frame.unit, origin=frame.origin)


def _report(
    arguments: argparse.Namespace, target: Path, picture: Path | None, samples: Samples, result: "Reconstruction"
) -> dict[str, Any]:
    return {
        **written(output=target, plot=picture),
        "samples": result.n_samples,
        "control_points": result.surface.control_points.shape[0],
        "smoothing": result.smoothing,
        "noise_gain": result.noise_gain,
        "tolerance": None,
        "max_error": result.max_error,
        "rms_error": result.rms_error,
        "range": float(np.linalg.norm(np.ptp(samples.values, axis=0))),
        "unit": result.unit,
        "warnings": list(result.warnings),
        "provenance": {
            "software": f"tsplinejax {__version__}",
            "input": {**named(arguments.samples), "model": named(arguments.model)},
            "options": {"smoothing": arguments.smoothing},
        },
    }


def _lines(report: dict[str, Any]) -> tuple[str, ...]:
    unit = report["unit"]
    return table(
        [
            ("samples", f"{report['samples']} for {report['control_points']} control points"),
            ("largest error", f"{quantity(report['max_error'], unit)} at the samples"),
            ("rms error", f"{quantity(report['rms_error'], unit)} at the samples"),
            ("noise gain", f"{report['noise_gain']:.3g}"),
            ("smoothing", f"{report['smoothing']:.3g}"),
            ("written", ", ".join(name for name in (report["output"], report["plot"]) if name)),
        ]
    )
