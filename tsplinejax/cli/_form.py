"""`tsplinejax form`: from measured data to form and texture."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import InputError
from ..codec import MODEL_SUFFIX, save
from ..data import HeightMap
from ..io._files import written_whole
from ..plot import plot_form_removal
from ..surface import TSpline
from ._arguments import add_command, add_data_options, add_input, add_output, add_plot, counts
from ._files import checked_output, checked_picture, read_data, write_picture
from ._operations import add_operations, simple_form_name
from ._outcome import MET, STOPPED_EARLIER, Outcome, described, percentage, quantity, table, written

if TYPE_CHECKING:
    from ..characterise import FormRemoval

_ARRAYS, _MODELS = (".npz",), (MODEL_SUFFIX,)


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    parser = add_command(
        subparsers,
        "form",
        "separate measured data into form and texture",
        "tsplinejax form scan.ply -o texture.npz --parameters conformal --robust --model form.tspl --plot form.png",
        run,
    )
    add_input(parser, "height map or point cloud")
    add_output(
        parser,
        "arrays to write, one row a valid sample: points, parameters, form_points, texture; of a height map also "
        "texture_map",
        "OUT.npz",
    )
    group = parser.add_argument_group("form (default: a T-spline of 3x3 elements, 6 × 6 control points)")
    group.add_argument(
        "--form",
        metavar="spline|plane|polyN|sphere|cylinder",
        type=lambda text: None if text == "spline" else simple_form_name(text),
        help="a simple form instead of a T-spline",
    )
    group.add_argument(
        "--method",
        choices=("joint", "normal", "parametric", "height"),
        default="joint",
        help="texture along the form's normals, or along z with height (default joint)",
    )
    one = group.add_mutually_exclusive_group()
    one.add_argument("--tolerance", metavar="X", help="refine until no sample is farther off: 5nm, 0.8um")
    one.add_argument("--lattice", metavar="MxN", type=counts, help="elements along s and t")
    group.add_argument(
        "--parameters", choices=("planar", "conformal"), default="planar", help="of the samples (default planar)"
    )
    group.add_argument(
        "--outward",
        metavar="X,Y,Z",
        type=_direction,
        help="direction out of the material (default: the side of a mesh's winding, else +z)",
    )
    group.add_argument("--robust", action="store_true", help="set spikes and dust aside")
    group.add_argument("--model", metavar="FORM.tspl", help="write the form as a model")
    add_plot(group, "draw form and texture")
    add_operations(parser)
    add_data_options(parser)


def run(arguments: argparse.Namespace) -> Outcome:
    """Read, separate, write."""
    from ..characterise import remove_form

    target, model, picture = _checked_paths(arguments)
    data = read_data(arguments.input, arguments)
    names = ("method", "form", "tolerance", "lattice", "parameters", "outward", "robust")
    operations = ("s_filter", "level", "l_filter")
    removal = remove_form(data, **{name: getattr(arguments, name) for name in (*names, *operations)})
    with written_whole(target) as stream:
        np.savez(stream, allow_pickle=False, **arrays(removal))
    if model is not None:
        save(model, removal.form)  # pyright: ignore[reportArgumentType] -- a T-spline, as checked above
    write_picture(picture, lambda: plot_form_removal(removal))
    report = {**written(output=target, model=model, plot=picture), **removal.report}
    report["provenance"] = {**report["provenance"], "options": _options(arguments, (*names, *operations))}
    code = MET if removal.converged else STOPPED_EARLIER
    return Outcome(report, _lines(described(data), removal, report), code)


def arrays(removal: "FormRemoval") -> dict[str, np.ndarray]:
    """What the output holds, by name."""
    names = ("points", "parameters", "form_points", "texture")
    held = {name: getattr(removal, name) for name in names}
    if isinstance(removal.data, HeightMap) and removal.texture_map is not None:
        held["texture_map"] = removal.texture_map.heights
    return held


def _checked_paths(arguments: argparse.Namespace) -> tuple[Path, Path | None, Path | None]:
    """Paths of arrays, model and picture, all different."""
    inputs = (arguments.input, arguments.mask)
    target = checked_output(arguments.output, _ARRAYS, *inputs)
    if arguments.model is not None and arguments.form is not None:
        raise InputError(f"a model holds a T-spline, but the form is a {arguments.form}; leave --model or --form out")
    model = None if arguments.model is None else checked_output(arguments.model, _MODELS, *inputs)
    picture = checked_picture(arguments.plot, *inputs)
    return target, model, picture


def _direction(text: str) -> tuple[float, ...]:
    """Three numbers written `0,0,1`.

    >>> _direction("0,0,-1")
    (0.0, 0.0, -1.0)
    """
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) != 3:
        raise argparse.ArgumentTypeError(f"a direction of three numbers such as 0,0,1 is needed, but got {text!r}")
    return numbers


def _options(arguments: argparse.Namespace, names: tuple[str, ...]) -> dict[str, Any]:
    return {name: getattr(arguments, name) for name in names}


def _lines(data: str, removal: "FormRemoval", report: dict[str, Any]) -> tuple[str, ...]:
    unit, form = removal.unit, removal.form
    kind = f"{removal.control_points} control points, {removal.method}" if isinstance(form, TSpline) else repr(form)
    rows = [
        ("data", data),
        ("form", f"{kind}, {removal.edf:.4g} effective degrees of freedom"),
        ("texture", f"Sq {quantity(removal.sq_texture, unit)}, Sa {quantity(removal.sa_texture, unit)}"),
        ("largest", f"{quantity(removal.max_error, unit)}{_criterion(removal)}"),
        (
            "absorbed",
            f"{percentage(removal.absorbed_share)} of the texture's mean square went into the form (estimate)",
        ),
        ("operations", "; ".join(removal.operations)),
        ("written", ", ".join(name for name in (report["output"], report["model"], report["plot"]) if name)),
    ]
    if report["outliers"]:
        rows.insert(2, ("set aside", f"{report['outliers']} of {report['samples']} samples"))
    if removal.conformality is not None:
        rows.insert(1, ("conformality", f"E_u·E_v = {removal.conformality:.4f}"))
    return table(rows)


def _criterion(removal: "FormRemoval") -> str:
    if removal.tolerance is None:
        return ""
    met = "met" if removal.converged else "not met"
    return f" (tolerance {quantity(removal.tolerance, removal.unit)}: {met})"
