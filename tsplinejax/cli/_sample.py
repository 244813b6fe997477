"""`tsplinejax sample`: the few samples from which a surface is recovered."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import InputError
from .._version import __version__
from ..codec import MODEL_SUFFIX, load, save
from ..data import HeightMap, PointCloud, Samples
from ..fitting import fit
from ..io._files import written_whole
from ..plot import plot_samples
from ..surface import TSpline
from ._arguments import add_command, add_data_options, add_input, add_output, add_plot, add_tolerances, data_options
from ._files import checked_model, checked_output, checked_picture, is_model, named, read_data, write_picture
from ._outcome import Outcome, described, quantity, table, written
from ._places import in_unit_of

if TYPE_CHECKING:
    from ..sampling import SampleSet

_ARRAYS = (".npz",)
_CRITERIA = ("tolerance", "relative_tolerance", "noise")


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "sample",
        "choose the few samples from which a surface is recovered",
        "tsplinejax sample map.x3p -o samples.npz --model nominal.tspl --strategy greville --size 2000",
        run,
    )
    add_input(parser, "height map or point cloud, or a model to be sampled itself")
    add_output(
        parser,
        "arrays to write: parameters (m, 2), values (m, d); with the place of the parameter square (origin, "
        "extent, unit), and of measured data which of them were chosen (index)",
        "SAMPLES.npz",
    )
    group = parser.add_argument_group("where")
    group.add_argument(
        "--strategy",
        metavar="NAME",
        default="greville",
        help="greville (default), greville-centres, greville-refined, t-patch, t-patch-random, adaptive, element-area, "
        "element-curvature, curvature, uniform, random, halton, latin-hypercube",
    )
    group.add_argument("--size", metavar="N", type=int, help="how many samples (default: the strategy's own number)")
    group.add_argument("--seed", metavar="N", type=int, default=0, help="of the strategies with randomness (default 0)")
    group.add_argument(
        "--model", metavar="M.tspl", help="model whose T-mesh says where: of the nominal surface, or of an earlier part"
    )
    group.add_argument(
        "--parameters", choices=("planar", "conformal"), default="planar", help="of a cloud (default planar)"
    )
    group.add_argument(
        "--save-model",
        metavar="M.tspl",
        help="write the model whose T-mesh the samples belong to: what reconstruct needs, where none was given or "
        "the strategy refined it (greville-refined, adaptive)",
    )
    add_plot(group, "draw the places over the T-mesh")
    group = parser.add_argument_group("without --model the input is fitted first (none of these means --noise auto)")
    add_tolerances(
        group,
        "largest error of the fit: 5nm, 0.8um, or in the data's unit",
        noise="stop at the noise: estimated, or of this standard deviation",
    )
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, choose, write, and see what the samples are worth."""
    from ..sampling._names import strategy_of
    from ..sampling._sample import checked_size, drawn, site_of
    from ..sampling._study import errors_of, range_of, true_samples

    target, kept, picture = _checked_paths(arguments)
    data, surface, warnings = _given(arguments)
    model = None if isinstance(data, TSpline) else surface
    strategy = strategy_of(arguments.strategy)
    site, index = site_of(data, model, "planar")
    size = checked_size(site, strategy, arguments.size)
    samples = drawn(site, index, strategy, size, np.random.default_rng(arguments.seed))
    truth = true_samples(site)
    rms, largest = errors_of(samples, truth)
    with written_whole(target) as stream:
        np.savez(stream, allow_pickle=False, **arrays(samples))
    if kept is not None:
        save(kept, samples.model)
    write_picture(picture, lambda: plot_samples(samples.parameters, samples.model))
    options = {name: getattr(arguments, name) for name in ("strategy", "size", "seed", "parameters", *_CRITERIA)}
    provenance: dict[str, Any] = dict(getattr(data, "provenance", None) or named(arguments.input))
    if arguments.model is not None:
        provenance["model"] = named(arguments.model)
    report = {
        **written(output=target, model=kept, plot=picture),
        "strategy": arguments.strategy,
        "samples": len(samples),
        "control_points": site.control_points,
        "tolerance": None,
        "max_error": largest,
        "rms_error": rms,
        "range": range_of(truth),
        "unit": site.model.unit,
        "warnings": [*warnings, *samples.warnings],
        "provenance": {"software": f"tsplinejax {__version__}", "input": provenance, "options": options},
    }
    return Outcome(report, _lines(data, report))


def arrays(samples: "SampleSet") -> dict[str, np.ndarray]:
    """What the output holds, by name."""
    frame, shape = samples.samples.frame, samples.samples.grid_shape
    held = {
        "parameters": samples.parameters,
        "values": samples.values,
        "origin": np.array(frame.origin),
        "extent": np.array(frame.extent),
        "unit": np.array(samples.unit or ""),
    }
    if samples.index is not None:
        held["index"] = samples.index
    return held if shape is None else {**held, "shape": np.array(shape)}


def _checked_paths(arguments: argparse.Namespace) -> tuple[Path, Path | None, Path | None]:
    """Paths of arrays, model and picture to write; options that go together."""
    from ..sampling._names import strategy_of

    strategy_of(arguments.strategy)
    inputs = (arguments.input, arguments.mask, arguments.model)
    target = checked_output(arguments.output, _ARRAYS, *inputs)
    kept = None if arguments.save_model is None else checked_output(arguments.save_model, (MODEL_SUFFIX,), *inputs)
    if arguments.model is not None:
        checked_model(arguments.model)
    picture = checked_picture(arguments.plot, *inputs)
    given = [name for name in _CRITERIA if getattr(arguments, name) is not None]
    if given and (arguments.model is not None or is_model(arguments.input)):
        raise InputError(f"--{given[0].replace('_', '-')} is of a fit, but the model is given; leave one of them out")
    if is_model(arguments.input):
        described_too = [name for name, value in data_options(arguments).items() if value is not None]
        if arguments.model is not None or described_too or arguments.parameters != "planar":
            raise InputError(
                f"{arguments.input} is a model and is sampled by its own T-mesh; leave --model and the options that "
                "describe data out"
            )
    return target, kept, picture


def _given(arguments: argparse.Namespace) -> tuple[Any, TSpline, list[str]]:
    """What is sampled, the model that says where, and what there is to say about both."""
    if is_model(arguments.input):
        surface = load(arguments.input)
        return surface, surface, []
    data: HeightMap | PointCloud | Samples = read_data(arguments.input, arguments)
    surface = None if arguments.model is None else load(arguments.model)
    if surface is not None:
        data = in_unit_of(surface, data)
    warnings: list[str] = []
    if arguments.parameters == "conformal":
        data, warnings = _unrolled(data)
    if surface is None:
        result = fit(data, **{name: getattr(arguments, name) for name in _CRITERIA})
        surface, warnings = result.surface, [*warnings, *result.warnings]
    return data, surface, warnings


def _unrolled(data: HeightMap | PointCloud) -> tuple[Samples, list[str]]:
    """Points in space over conformal parameters."""
    from ..parameterisation import conformal

    if isinstance(data, HeightMap):
        raise InputError("a height map's parameters are its own x and y; leave --parameters out")
    place = conformal(data)
    return Samples(place.parameters, data.points, None, place.frame), list(place.warnings)


def _lines(data: Any, report: dict[str, Any]) -> tuple[str, ...]:
    unit, n = report["unit"], report["control_points"]
    rows = [
        ("model", f"{n} control points"),
        ("samples", f"{report['samples']} by {report['strategy']}, {report['samples'] / n:.3g} a control point"),
        ("rms error", f"{quantity(report['rms_error'], unit)} of the surface reconstructed from them"),
        ("largest error", quantity(report["max_error"], unit)),
        ("written", ", ".join(name for name in (report["output"], report["model"], report["plot"]) if name)),
    ]
    if isinstance(data, HeightMap | PointCloud):
        rows.insert(0, ("data", described(data)))
    return table(rows)
