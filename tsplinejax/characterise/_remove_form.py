"""`remove_form`: from measured data to form and texture."""

import time
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import ArrayLike, Float

from .._errors import InputError
from .._version import __version__
from ..data import HeightMap, PointCloud, as_data, find_outliers, parse_length
from ..orthogonal import Joint, Normal, Parametric
from ..surface import TSpline
from ._absorbed import absorbed_share
from ._filters import l_filter as filtered_long, level as levelled, require_scale, s_filter as filtered_short
from ._fit_form import FittedForm, data_points
from ._methods import METHODS, Formed, Task, given_form, in_height, orthogonal, simple
from ._outward import checked_outward, outward_side
from ._placing import Placed, placed
from ._removal import Distortion, FormRemoval
from ._simple_forms import AbstractSimpleForm, simple_form
from ._texture_map import distortion_of, sample_areas, texture_map_of, without_long_waves

_DISTORTED = 0.05


def remove_form(
    data: Any,
    *,
    method: Any = "joint",
    form: AbstractSimpleForm | TSpline | str | None = None,
    tolerance: float | str | None = None,
    lattice: tuple[int, int] | None = None,
    parameters: Any = "planar",
    outward: ArrayLike | None = None,
    robust: bool = False,
    smoothing: float | Literal["auto"] = "auto",
    s_filter: float | str | None = None,
    level: AbstractSimpleForm | str | None = None,
    l_filter: float | str | None = None,
) -> FormRemoval:
    """Separate a measured surface into form and texture.

    Without `form`, `tolerance` and `lattice` the form is a T-spline of 3 × 3 elements, 6 × 6 control points. Operations
    follow the order of ISO 25178: S-filter, levelling, form, L-filter.

    **Arguments:**

    - `data`: a `HeightMap`, a `PointCloud`, or plain arrays (see `as_data`), x, y and z in one unit.
    - `method`: `"joint"` (control points and parameters together), `"normal"`, `"parametric"`, or the strategies
      `Joint(...)`, `Normal()`, `Parametric()`: texture along the form's normals. `"height"`: z over (x, y), vertical.
    - `form`: a simple form instead of a T-spline: `Plane()`, `Polynomial(2)`, `Sphere()`, `Cylinder()` or their names;
      or a `TSpline` that is the nominal form.
    - `tolerance`: refine until no sample is farther from the form than this, in the data's unit, or with one: `"5um"`.
    - `lattice`: (M, N) elements along s and t, kept as they are unless there is a tolerance.
    - `parameters`: `"planar"`, `"conformal"`, an (m, 2) array, or a `Parameterisation`.
    - `outward`: direction out of the material; by default the side of a mesh's winding, else +z. State it for a mesh
      whose triangles are wound inwards.
    - `robust`: set spikes and dust aside, and let what is left far off pull less.
    - `smoothing`: weight λ of the bending energy, or `"auto"`.
    - `s_filter`, `l_filter`: cut-offs, in the data's unit, or with one; an S-filter needs a height map.
    - `level`: `"plane"`, `"polyN"`, `"sphere"`, `"cylinder"`: taken off along z before the form.

    **Returns:** a [`FormRemoval`][tsplinejax.FormRemoval].

    **Raises:** `InputError` for bad data or options, and for a height map of unknown spacing and unit, unless the
    method is `"height"`.

    >>> x, y = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 50))
    >>> dome = HeightMap(np.sqrt(9 - x**2 - y**2) + 0.01 * np.cos(40 * x), (2 / 59, 2 / 49), "mm")
    >>> removal = remove_form(dome, form="sphere")
    >>> round(removal.form.values["radius"], 1), round(removal.sq_texture, 3)
    (3.0, 0.007)
    """
    started = time.perf_counter()
    data, side = as_data(data), checked_outward(outward)
    _check_method(method)
    data = _prepared(data, s_filter, level)
    if method != "height":
        require_scale(data, "an orthogonal form")
    points = data_points(data)
    kept = ~_set_aside(data) if robust else np.ones(len(points), bool)
    limit = None if tolerance is None else _checked_tolerance(tolerance, data)
    task = Task(data, points, kept, method, limit, _checked_lattice(lattice), robust, smoothing)
    place, formed = _formed(task, form, parameters, side)
    facing = outward_side(formed.normals, data, side)
    formed = formed._replace(normals=facing * formed.normals)
    if not isinstance(formed.form, FittedForm):
        formed = formed._replace(distances=facing * formed.distances)
    return _removal(task, place, formed, l_filter, started)


def _formed(task: Task, form: Any, parameters: Any, outward: Float[np.ndarray, " 3"] | None) -> tuple[Placed, Formed]:
    """Parameters of the samples, and the form."""
    if isinstance(form, TSpline):
        if task.tolerance is not None or task.lattice is not None:
            raise InputError("a given form is not fitted, so it has neither tolerance nor lattice; leave them out")
        formed = given_form(task, form)
        return placed(task.data, task.points, task.kept, formed.parameters, outward), formed
    if task.method == "height" and form is None:
        formed = in_height(task)
        return Placed(formed.parameters, task.data.frame.extent, None, ()), formed
    place = placed(task.data, task.points, task.kept, parameters, outward)
    if form is not None:
        return place, simple(task, simple_form(form), place, outward)
    return place, orthogonal(task, place)


def _removal(task: Task, place: Placed, formed: Formed, l_filter: float | str | None, started: float) -> FormRemoval:
    """The result: areas, maps, figures."""
    inliers = ~formed.outliers
    texture = formed.distances
    largest = float(np.abs(texture[inliers]).max())
    areas, triangulation = sample_areas(task.data, formed, place.sides)
    texture_map = texture_map_of(task.data, texture, formed.outliers, triangulation)
    operations = [*task.data.provenance.get("operations", ()), _form_line(task, formed)]
    if l_filter is not None:
        if texture_map is None:
            raise InputError("an L-filter needs samples that cover an area; these lie on too few lines; leave it out")
        smooth = filtered_long(texture_map, l_filter)
        texture = without_long_waves(task.data, texture, texture_map, smooth, formed.parameters * place.sides)
        texture_map, operations = smooth, [*operations, smooth.provenance["operations"][-1]]
    weights = areas / areas.sum()
    centred = texture - weights @ texture
    square = float(weights @ centred**2)
    normal = weights @ formed.normals
    distortion = distortion_of(task.data, formed, place.sides, inliers)
    return FormRemoval(
        form=formed.form,
        data=task.data,
        points=task.points,
        parameters=formed.parameters,
        form_points=formed.feet,
        texture=texture,
        normals=formed.normals,
        outliers=formed.outliers,
        weights=areas,
        texture_map=texture_map,
        distortion=distortion,
        sq_texture=float(np.sqrt(square)),
        sa_texture=float(weights @ np.abs(centred)),
        max_error=largest,
        control_points=formed.control_points,
        edf=formed.edf,
        conformality=place.conformality,
        normal=normal / (np.linalg.norm(normal) or 1.0),
        cutoff_estimate=_cutoff(formed.form, place.sides),
        absorbed_share=absorbed_share(texture, formed.parameters, weights, formed.edf, place.sides[0] / place.sides[1]),
        tolerance=task.tolerance,
        converged=formed.converged and (task.tolerance is None or largest <= task.tolerance),
        method=_method_name(task, formed),
        unit=task.data.unit,
        seconds=time.perf_counter() - started,
        warnings=(*place.warnings, *formed.warnings, *_distorted(distortion)),
        operations=tuple(operations),
        provenance={"software": f"tsplinejax {__version__}", "input": dict(task.data.provenance)},
    )


def _check_method(method: Any) -> None:
    if isinstance(method, Joint | Normal | Parametric) or (isinstance(method, str) and method in METHODS):
        return
    raise InputError(
        f"a method is one of {', '.join(METHODS)}, or Joint(...), Normal(), Parametric(); received {method!r}"
    )


def _prepared(data: HeightMap | PointCloud, s_filter: float | str | None, level: Any) -> HeightMap | PointCloud:
    """The data after S-filter and levelling."""
    if s_filter is not None:
        data = filtered_short(data, s_filter)
    return data if level is None or level == "none" else levelled(data, level)


def _set_aside(data: HeightMap | PointCloud) -> np.ndarray:
    """Spikes and dust among the valid samples, judged by their neighbourhood."""
    if isinstance(data, HeightMap):
        return find_outliers(data)[data.valid]
    return find_outliers(data, as_surface=True)


def _checked_tolerance(tolerance: float | str, data: HeightMap | PointCloud) -> float:
    length = parse_length(tolerance, data.unit)
    if length <= 0:
        raise InputError(f"a tolerance is above zero; received {tolerance!r}")
    return length


def _checked_lattice(lattice: Sequence[int] | None) -> tuple[int, int] | None:
    if lattice is None:
        return None
    if len(lattice) != 2 or any(int(count) != count or count < 1 for count in lattice):
        raise InputError(f"a lattice is two whole numbers of elements (M, N), at least 1; received {lattice!r}")
    return int(lattice[0]), int(lattice[1])


def _cutoff(form: TSpline | FittedForm, sides: tuple[float, float]) -> float | None:
    """Twice the mean element size; a simple form has no elements."""
    if isinstance(form, FittedForm):
        return None
    return 2 * float(np.sqrt(sides[0] * sides[1] / form.space.mesh.n_elements))


def _method_name(task: Task, formed: Formed) -> str:
    if isinstance(formed.form, FittedForm):
        return formed.form.distance
    return task.method if isinstance(task.method, str) else type(task.method).__name__.lower()


def _form_line(task: Task, formed: Formed) -> str:
    """The F-operation in a line."""
    if isinstance(formed.form, FittedForm):
        return f"F-operation {formed.form!r}"
    if formed.edf == 0:
        return f"F-operation given T-spline, {formed.control_points} control points"
    return (
        f"F-operation T-spline, {_method_name(task, formed)}, {formed.control_points} control points, "
        f"edf {formed.edf:.4g}"
    )


def _distorted(distortion: Distortion) -> tuple[str, ...]:
    """A warning where the texture map's lengths or areas are off by more than 5 %."""
    if max(distortion.area, distortion.length) <= _DISTORTED:
        return ()
    return (
        f"the texture map is distorted: areas by {100 * distortion.area:.0f} %, lengths by "
        f"{100 * distortion.length:.0f} % (95 % of the places are less); heights and Sq are not affected, spacings are",
    )
