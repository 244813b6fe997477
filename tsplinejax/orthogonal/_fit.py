"""`fit_orthogonal`: a surface through points in space, by their distances along its normals."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float
from numpy.typing import DTypeLike

from .._errors import InputError
from ..data import parse_length
from ..fitting import scaled_lattice
from ..mesh import b_lattice
from ..space import SplineSpace, spline_space
from ..surface import make_surface
from ._adaptive import Budget, refined
from ._freedom import degrees_of_freedom
from ._methods import AbstractMethod, AbstractRobust, Joint, Parametric
from ._prepare import Request, read_request, smoothing_weight
from ._result import OrthogonalFit, OrthogonalStep, OrthogonalStop
from ._round import Fitted, begin, improve

DEFAULT_LATTICE = (3, 3)
LOOSE_ITERATIONS = 6  # of a step of the adaptive loop: enough to mark by
NEAR = 4.0  # tolerances within which foot points are trusted


def fit_orthogonal(
    points: Any,
    parameters: Any = None,
    *,
    method: AbstractMethod | None = None,
    space: SplineSpace | None = None,
    lattice: tuple[int, int] | None = None,
    tolerance: float | str | None = None,
    robust: AbstractRobust | None = None,
    smoothing: float | str = "auto",
    weights: Float[ArrayLike, " m"] | None = None,
    max_iterations: int = 60,
    max_steps: int | None = None,
    max_control_points: int | None = None,
    sides: tuple[float, float] | None = None,
    unit: str | None = None,
    dtype: DTypeLike | None = None,
) -> OrthogonalFit:
    """Fit a T-spline in space to points by their orthogonal distances.

    **Arguments:**

    - `points`: a `PointCloud`, a `HeightMap`, or (m, 3).
    - `parameters`: (m, 2) in [0, 1]², or an object with such `parameters` and the `sides` of the rectangle they stand
      for. They are where the search for foot points begins (`Parametric()`: they stay). By default x and y, normalised.
    - `method`: `Joint()` (default), `Normal()` or `Parametric()`.
    - `space`: a polynomial spline space to fit over; or
    - `lattice`: (M, N) elements along s and t; by default 3 × 3. With a tolerance it is where refinement starts.
    - `tolerance`: refine until no point is farther from the surface, in the data's unit, or with one: `"5um"`.
    - `robust`: `Huber()` or `Tukey()` weights for outliers and dust, in units of a robust scale (MAD); none by default.
    - `smoothing`: weight λ of the bending energy; `"auto"` is a trace that only fills gaps.
    - `weights`: one a point, not negative.
    - `max_iterations`: Gauss-Newton steps over one space.
    - `max_steps`, `max_control_points` (default: a third of the points): budgets of refinement.
    - `sides`: side lengths of the rectangle that the parameters stand for; elements are near squares of it.
    - `unit`: of the points, where they do not say.
    - `dtype`: `"float32"` to fit in single precision; by default the data's.

    **Returns:** an [`OrthogonalFit`][tsplinejax.OrthogonalFit]; that it did not settle is said there, not raised.

    **Raises:** `InputError` for points that are not finite or lie on one line, parameters outside [0, 1]², fewer points
    than control points without smoothing, and wrong options.

    >>> x, y = np.meshgrid(np.linspace(-1, 1, 30), np.linspace(-1, 1, 30))
    >>> cap = np.stack([x, y, np.sqrt(9 - x**2 - y**2)], axis=-1).reshape(-1, 3)
    >>> bool(fit_orthogonal(cap).max_error < 1e-3)
    True
    """
    request = read_request(points, parameters, weights=weights, sides=sides, unit=unit, dtype=dtype)
    method = _checked(method, robust, max_iterations)
    limit = None if tolerance is None else _limit(tolerance, request.unit)
    start = _start_space(request, space, lattice, limit)
    weight = smoothing_weight(smoothing, len(request.points))
    if weight == 0 and limit is None and len(request.points) < int(start.n_functions):
        raise InputError(
            f"without smoothing there must be at least as many points as control points; received "
            f"{len(request.points)} points for {int(start.n_functions)}; give smoothing=, or a coarser lattice"
        )
    setting = _Setting(request, method, robust, weight, max_iterations)
    if limit is None:
        return _finish(setting, *_fixed(setting, start), None)
    budget = Budget(max_steps, max_control_points or max(2 * int(start.n_functions), len(request.points) // 3))
    return _finish(setting, *_adaptive(setting, start, limit, budget), limit)


@dataclass(frozen=True, eq=False)
class _Setting:
    """What stays the same over all spaces."""

    request: Request
    method: AbstractMethod
    robust: AbstractRobust | None
    smoothing: float
    max_iterations: int


def _fixed(setting: _Setting, space: SplineSpace) -> tuple[Fitted, OrthogonalStop, tuple[OrthogonalStep, ...]]:
    """The fit over one space."""
    first = begin(setting.request, space, setting.smoothing, setting.robust)
    fitted = improve(first, setting.method, setting.robust, setting.smoothing, setting.max_iterations)
    stop = OrthogonalStop.SETTLED if fitted.settled else OrthogonalStop.MAX_ITERATIONS
    return fitted, stop, (_step(setting, 0, fitted),)


def _adaptive(
    setting: _Setting, space: SplineSpace, limit: float, budget: Budget
) -> tuple[Fitted, OrthogonalStop, tuple[OrthogonalStep, ...]]:
    """Refine where points are farther than the tolerance, carry the surface over exactly, and fit again."""
    scaled = limit / setting.request.factor
    few = min(LOOSE_ITERATIONS, setting.max_iterations)
    fitted = _approached(setting, begin(setting.request, space, setting.smoothing, setting.robust), scaled, few)
    history, stage = [_step(setting, 0, fitted)], np.inf
    while True:
        refinement, stage, stop = refined(fitted, scaled, stage, budget, len(history) - 1)
        if refinement is None and not fitted.settled:
            # Before a mesh is given up, or is the last one, its fit is taken as far as it goes.
            fitted = _improved(setting, fitted, setting.max_iterations)
            history[-1] = _step(setting, len(history) - 1, fitted)
            refinement, stage, stop = refined(fitted, scaled, stage, budget, len(history) - 1)
        if refinement is None:
            assert stop is not None
            return fitted, stop, tuple(history)
        fitted = _approached(setting, fitted.over(refinement), scaled, few)
        history.append(_step(setting, len(history), fitted))


def _approached(setting: _Setting, first: Fitted, limit: float, iterations: int) -> Fitted:
    """A step's fit: over fixed parameters while the surface is far from the points, then by the method.

    Foot points on a surface that is farther away than its radii of curvature crowd together and leave it undetermined.
    """
    if not first.near:
        linear = improve(first, Parametric(), setting.robust, setting.smoothing, 1)
        if linear.worst > NEAR * limit or isinstance(setting.method, Parametric):
            return linear
        first = replace(linear, near=True)
    return _improved(setting, first, iterations)


def _improved(setting: _Setting, first: Fitted, iterations: int) -> Fitted:
    """The fit by the method, from another one."""
    return improve(first, setting.method, setting.robust, setting.smoothing, iterations)


def _step(setting: _Setting, number: int, fitted: Fitted) -> OrthogonalStep:
    """The account of a fit over one space."""
    factor = setting.request.factor
    gaps = fitted.gaps[fitted.counted]
    return OrthogonalStep(
        number,
        int(fitted.surface.space.n_functions),
        float(gaps.max()) * factor,
        float(np.sqrt(np.mean(gaps**2))) * factor,
        tuple((fitted.objective * factor**2).tolist()),
        tuple((fitted.gradient * factor).tolist()),
        fitted.settled,
    )


def _finish(
    setting: _Setting,
    fitted: Fitted,
    stop: OrthogonalStop,
    history: tuple[OrthogonalStep, ...],
    limit: float | None,
) -> OrthogonalFit:
    """The result in the data's unit and place."""
    request = setting.request
    points = np.asarray(fitted.surface.control_points, np.float64) * request.factor + request.offset
    surface = make_surface(fitted.surface.space, points, replace(request.frame, unit=request.unit))
    feet = fitted.feet
    return OrthogonalFit(
        surface=surface,
        parameters=np.asarray(feet.parameters),
        feet=np.asarray(feet.points, np.float64) * request.factor + request.offset,
        normals=np.asarray(feet.normals),
        distances=np.asarray(feet.distances, np.float64) * request.factor,
        beyond=np.asarray(feet.beyond),
        weights=fitted.weights,
        outliers=fitted.outliers,
        method=setting.method,
        stop=stop,
        converged=stop in (OrthogonalStop.SETTLED, OrthogonalStop.TOLERANCE),
        tolerance=limit,
        max_error=history[-1].max_error,
        rms_error=history[-1].rms_error,
        edf=degrees_of_freedom(fitted, setting.method, setting.smoothing),
        smoothing=setting.smoothing,
        history=history,
        unit=request.unit,
    )


def _start_space(
    request: Request, space: SplineSpace | None, lattice: tuple[int, int] | None, limit: float | None
) -> SplineSpace:
    """The space that the fit starts with."""
    if space is None:
        if lattice is None:
            lattice = DEFAULT_LATTICE if limit is None else scaled_lattice(request.frame, DEFAULT_LATTICE[0])
        if not isinstance(lattice, tuple | list) or len(lattice) != 2:
            raise InputError(f"a lattice is two whole numbers (M, N); received {lattice!r}")
        return spline_space(b_lattice(*lattice), dtype=request.dtype, rational=False)
    if lattice is not None:
        raise InputError("give a space or a lattice, not both")
    if space.rational:
        raise InputError("orthogonal fits need a polynomial space; refine with AnalysisSuitable(), not Dyadic()")
    if space.dtype != request.dtype:
        raise InputError(
            f"the space is {space.dtype}, the data are {request.dtype}; pass dtype={str(space.dtype)!r}, or make the "
            f"space with spline_space(mesh, dtype={str(request.dtype)!r})"
        )
    return space


def _checked(method: AbstractMethod | None, robust: AbstractRobust | None, max_iterations: int) -> AbstractMethod:
    """The method, and options of the right kind."""
    method = Joint() if method is None else method
    if not isinstance(method, AbstractMethod):
        raise InputError(f"a method is Joint(), Normal() or Parametric(); received {method!r}")
    if robust is not None and not isinstance(robust, AbstractRobust):
        raise InputError(f"robust is Huber(), Tukey() or None; received {robust!r}")
    if max_iterations < 1:
        raise InputError(f"max_iterations is at least 1; received {max_iterations!r}")
    return method


def _limit(tolerance: float | str, unit: str | None) -> float:
    """The tolerance in the data's unit."""
    limit = parse_length(tolerance, unit)
    if not np.isfinite(limit) or limit <= 0:
        raise InputError(f"a tolerance is a finite length above zero; received {tolerance!r}")
    return limit
