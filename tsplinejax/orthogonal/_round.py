"""One fit over one space: its start, the rounds of robust weights, and where every point stands after it."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..mesh import TMesh
from ..space import SplineSpace, pad, to_device
from ..surface import Projection, TSpline, make_surface, project, transfer
from ._descent import minimise
from ._methods import AbstractFreeMethod, AbstractMethod, AbstractRobust, Huber
from ._prepare import Request, parametric, pose
from ._problem import FootProblem, Unknowns

START_ROUNDS, ROUNDS = 4, 12  # of robust weights, at the start and at most
ROUND_ITERATIONS = 5
CALM = 1e-3  # change of weights below which they have settled
DEVIATIONS = 1.4826  # of a normal distribution in a median absolute deviation


@dataclass(frozen=True, eq=False)
class Fitted:
    """A surface and the points' feet on it, in the fit's own scale.

    **Attributes:**

    - `surface`, `feet`: the T-spline and the projection of all points.
    - `weights`: the caller's times the robust ones; `outliers`: points set aside.
    - `objective`, `gradient`: at each iterate; `settled`: whether they ended by themselves.
    - `near`: whether the surface has come near enough for foot points to be trusted.
    """

    request: Request
    surface: TSpline
    feet: Projection
    weights: Float[np.ndarray, " m"]
    outliers: Bool[np.ndarray, " m"]
    objective: Float[np.ndarray, " iterations"]
    gradient: Float[np.ndarray, " iterations"]
    settled: bool
    near: bool = False

    @property
    def counted(self) -> Bool[np.ndarray, " m"]:
        """Points that are neither outliers nor without weight."""
        return ~self.outliers & (self.request.weights > 0)

    @property
    def gaps(self) -> Float[np.ndarray, " m"]:
        """Distances between points and feet."""
        return np.linalg.norm(self.request.scaled - np.asarray(self.feet.points, np.float64), axis=1)

    @property
    def worst(self) -> float:
        """The largest distance that counts."""
        return float(self.gaps[self.counted].max())

    def over(self, tmesh: TMesh) -> "Fitted":
        """The same surface over a refined mesh, not yet fitted there."""
        return replace(self, surface=transfer(self.surface, tmesh), settled=False)


def begin(request: Request, space: SplineSpace, smoothing: float, robust: AbstractRobust | None) -> Fitted:
    """The parametric fit, with robust weights by a few rounds of their own."""
    weights, outliers = request.weights, np.zeros(len(request.points), bool)
    rounds = 1 if robust is None else START_ROUNDS
    empty = np.zeros(0)
    fitted = None
    for _ in range(rounds):
        surface = parametric(space, request, request.parameters, weights, smoothing)
        feet = _feet(surface, request, request.parameters)
        fitted = Fitted(request, surface, feet, weights, outliers, empty, empty, True)
        if robust is not None:
            # Huber's weights have one minimum: they find the start, from which others go on.
            weights, _ = reweighed(fitted, Huber())
    assert fitted is not None
    return replace(fitted, weights=weights)


def improve(
    first: Fitted, method: AbstractMethod, robust: AbstractRobust | None, smoothing: float, iterations: int
) -> Fitted:
    """Fit by a method from where another fit ended, until it settles or for so many iterations."""
    if robust is None:
        return _improved(first, method, smoothing, iterations)
    fitted = first
    for _ in range(ROUNDS):
        weights, outliers = reweighed(fitted, robust)
        change = np.abs(weights - fitted.weights).max() / fitted.request.weights.max()
        fitted = _improved(
            replace(fitted, weights=weights, outliers=outliers), method, smoothing, min(ROUND_ITERATIONS, iterations)
        )
        if change < CALM:
            break
    return _improved(fitted, method, smoothing, iterations)


def _improved(first: Fitted, method: AbstractMethod, smoothing: float, iterations: int) -> Fitted:
    """The same for given weights."""
    request = first.request
    if not isinstance(method, AbstractFreeMethod):
        surface = parametric(first.surface.space, request, request.parameters, first.weights, smoothing)
        feet = _feet(surface, request, np.asarray(first.feet.parameters))
        half = 0.5 * float(np.sum(first.weights * np.sum((request.scaled - np.asarray(feet.points)) ** 2, axis=1)))
        return replace(first, surface=surface, feet=feet, objective=np.array([half]), gradient=np.zeros(1))
    problem = pose(
        first.surface,
        request.scaled,
        first.weights,
        np.asarray(first.feet.parameters),
        method,
        smoothing,
        request.frame.extent,
    )
    start = beginning(problem, np.asarray(first.feet.parameters))
    unknowns, trace, settled = minimise(problem, start, method.steps_by, iterations)
    n = int(first.surface.space.n_functions)
    surface = make_surface(first.surface.space, problem.control_points(unknowns.moves)[:n])
    places = np.clip(np.asarray(unknowns.parameters)[: len(request.points)], 0, 1)
    feet = _feet(surface, request, places)
    count = min(int(trace.count), len(trace.objective))
    objective, gradient = (np.asarray(part, np.float64)[:count] for part in (trace.objective, trace.gradient))
    return replace(first, surface=surface, feet=feet, objective=objective, gradient=gradient, settled=settled)


def beginning(problem: FootProblem, parameters: np.ndarray) -> Unknowns:
    """No moves yet; padded points have the first one's place, and settle with it."""
    padded = pad(parameters, len(problem.points), parameters[0])
    return Unknowns(jnp.zeros_like(problem.hold), to_device(padded, np.dtype(problem.points.dtype)))


def _feet(surface: TSpline, request: Request, parameters: np.ndarray) -> Projection:
    """Foot points of all points, from where they are known to be near."""
    return project(surface, request.scaled, initial=parameters)


def reweighed(fitted: Fitted, robust: AbstractRobust) -> tuple[Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """The caller's weights times the robust ones, and which points are outliers."""
    gaps, own = fitted.gaps, fitted.request.weights
    scale = DEVIATIONS * float(np.median(gaps[own > 0]))
    if scale <= np.finfo(np.float64).eps:
        return own, np.zeros(len(own), bool)
    ratios = gaps / scale
    return own * robust.weights(ratios), ratios > robust.limit
