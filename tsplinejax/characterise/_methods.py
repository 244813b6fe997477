"""The ways to a form: a T-spline fitted in z or orthogonally, a T-spline that is given, a simple form."""

from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from ..data import HeightMap, PointCloud, find_outliers
from ..fitting import fit
from ..orthogonal import Joint, Normal, Parametric, Tukey, fit_orthogonal
from ..surface import TSpline, normals, project
from ._fit_form import FittedForm, fit_form
from ._placing import Placed
from ._simple_forms import AbstractSimpleForm

_LATTICE = (3, 3)

METHODS = ("joint", "normal", "parametric", "height")


class Task(NamedTuple):
    """What a form is fitted to, and how."""

    data: HeightMap | PointCloud
    points: Float[np.ndarray, "m 3"]
    kept: Bool[np.ndarray, " m"]
    method: Any
    tolerance: float | None
    lattice: tuple[int, int] | None
    robust: bool
    smoothing: float | Literal["auto"]


class Formed(NamedTuple):
    """A form, and where the samples stand on it."""

    form: TSpline | FittedForm
    parameters: Float[np.ndarray, "m 2"]
    feet: Float[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]
    distances: Float[np.ndarray, " m"]
    outliers: Bool[np.ndarray, " m"]
    edf: float
    control_points: int | None
    converged: bool
    warnings: tuple[str, ...] = ()


def given_form(task: Task, form: TSpline) -> Formed:
    """Stand the samples on a surface that is known."""
    found = project(form, task.points)
    warnings = []
    if not found.converged.all():
        warnings.append(f"the feet of {int((~found.converged).sum())} points were not found to the last digit")
    beyond = int(np.count_nonzero(found.beyond))
    if beyond:
        warnings.append(f"{beyond} points lie past the border of the form; their feet are on it")
    return Formed(
        form=form,
        parameters=np.asarray(found.parameters, np.float64),
        feet=np.asarray(found.points, np.float64),
        normals=np.asarray(found.normals, np.float64),
        distances=np.asarray(found.distances, np.float64),
        outliers=~task.kept,
        edf=0.0,
        control_points=form.control_points.shape[0],
        converged=bool(found.converged.all()),
        warnings=tuple(warnings),
    )


def simple(task: Task, form: AbstractSimpleForm, place: Placed, outward: Any) -> Formed:
    """Fit a plane, polynomial, sphere or cylinder: along z for the method "height", else along normals."""
    if task.tolerance is not None or task.lattice is not None:
        raise InputError("a simple form has neither tolerance nor lattice; leave them out, or leave form= out")
    distance = "vertical" if task.method == "height" else "orthogonal"
    fitted = fit_form(
        task.data, form, distance=distance, robust=task.robust, weights=task.kept.astype(float), outward=outward
    )
    if distance == "vertical":
        side = np.where(fitted.project(task.points[:1]).normals[:, 2] < 0, -1.0, 1.0)
        feet = task.points - (side * fitted.residuals)[:, None] * (0.0, 0.0, 1.0)
        directions = fitted.project(feet).normals
    else:
        feet, directions, _ = fitted.project(task.points)
    return Formed(
        fitted, place.parameters, feet, directions, fitted.residuals, ~task.kept, form.size, None, fitted.converged
    )


def in_height(task: Task) -> Formed:
    """Fit z over (x, y), and leave vertical residuals."""
    data, kept = task.data, task.kept
    if not kept.all():
        data = data.with_mask(_on_map(data, ~kept)) if isinstance(data, HeightMap) else _subset(data, kept)
    if task.tolerance is None:
        span = float(np.ptp(task.points[kept, 2])) or 1.0
        options: dict[str, Any] = {"tolerance": 2 * span, "lattice": task.lattice or _LATTICE, "max_steps": 0}
    else:
        options = {"tolerance": task.tolerance, "lattice": task.lattice}
    result = fit(data, smoothing=task.smoothing, **options)
    frame = result.surface.frame
    parameters = frame.parameters_of(task.points[:, 0], task.points[:, 1]).clip(0.0, 1.0)
    heights = np.asarray(result.surface(parameters), np.float64)
    return Formed(
        form=result.surface,
        parameters=parameters,
        feet=np.column_stack([task.points[:, :2], heights]),
        normals=np.asarray(normals(result.surface, parameters), np.float64),
        distances=task.points[:, 2] - heights,
        outliers=~kept,
        edf=float(result.control_points),
        control_points=result.control_points,
        converged=result.converged,
        warnings=() if task.tolerance is None else result.warnings,
    )


def orthogonal(task: Task, place: Placed) -> Formed:
    """Fit a T-spline in space along its normals."""
    kept = task.kept
    dtype = "float64" if jax.config.jax_enable_x64 else None  # pyright: ignore[reportAttributeAccessIssue]
    points = task.points if dtype else task.points.astype(_dtype(task.data))
    result = fit_orthogonal(
        points[kept],
        place.parameters[kept],
        method=_method(task.method),
        lattice=task.lattice or (_LATTICE if task.tolerance is None else None),
        tolerance=task.tolerance,
        robust=Tukey() if task.robust else None,
        smoothing=task.smoothing,
        sides=place.sides,
        unit=task.data.unit,
    )
    parameters, outliers = place.parameters.copy(), ~kept
    parameters[kept] = np.asarray(result.parameters)
    distances, directions = np.empty(len(points)), np.empty((len(points), 3))
    distances[kept], directions[kept] = np.asarray(result.distances), np.asarray(result.normals)
    outliers[kept] = np.asarray(result.outliers)
    if task.robust:
        # Off a flat texture stands what was hidden by the form's slopes.
        flat = np.column_stack([parameters[kept] * place.sides, distances[kept]])
        outliers[kept] |= find_outliers(PointCloud(flat))
    if not kept.all():
        others = project(result.surface, points[~kept])
        parameters[~kept] = np.asarray(others.parameters)
        distances[~kept], directions[~kept] = np.asarray(others.distances), np.asarray(others.normals)
    return Formed(
        form=result.surface,
        parameters=parameters,
        feet=np.asarray(result.surface(parameters), np.float64),
        normals=directions,
        distances=distances,
        outliers=outliers,
        edf=float(result.edf),
        control_points=int(result.surface.control_points.shape[0]),
        converged=bool(result.converged),
        warnings=tuple(getattr(result, "warnings", ())),
    )


def _method(method: Any) -> Any:
    """The strategy that a name stands for."""
    named = {"joint": Joint(), "normal": Normal(), "parametric": Parametric()}
    return named.get(method, method) if isinstance(method, str) else method


def _dtype(data: HeightMap | PointCloud) -> np.dtype:
    return data.points.dtype if isinstance(data, PointCloud) else data.heights.dtype


def _on_map(data: HeightMap, chosen: np.ndarray) -> np.ndarray:
    """A mask of the map's shape from one of its valid samples."""
    mask = np.zeros(data.shape, bool)
    mask[data.valid] = chosen
    return mask


def _subset(cloud: PointCloud, kept: np.ndarray) -> PointCloud:
    return PointCloud(cloud.points[kept], cloud.unit, provenance=cloud.provenance)
