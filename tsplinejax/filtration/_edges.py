"""The filter that keeps edges: a plate over an adaptive T-mesh that may bend for nothing where an edge is.

The T-mesh is refined around features. On it the smoothing spline of the cut-off λc is fitted again and again, with a
weight w_e on the bending energy of each element e at a feature,

    w_e = (1 + κ_e² / T²)⁻²,    κ_e² = ∫_e f_xx² + 2 f_xy² + f_yy² / area,

the reweighting of Geman and McClure's saturating penalty (the weak plate of Blake and Zisserman, Visual Reconstruction,
1987, ch. 2 and 5, begun from the linear filter). T is the curvature of a step as high as the tolerance that is smoothed
by λc. Higher steps bend more, so their bending gets cheaper, they become steeper, and bend still more: the bending
gathers in elements along the edge, and the plates on both sides are smoothed by λc as if there was no edge. Nothing
rings, and noise beside the edge is taken off as elsewhere. Last, weights fall further wherever a residual still
exceeds its limit.
"""

from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ..data import HeightMap
from ..fitting import Problem, StopReason, pose_fit, scaled_lattice, surface_of
from ..fitting._adaptive import State, residuals_of, resumed, with_coefficients
from ..fitting._direct import solve_directly
from ..fitting._energy import element_energy, smoothing_for_cutoff
from ..fitting._run import Run, run
from ..fitting._solve import conjugate_gradients
from ..fitting._stopwatch import Stopwatch
from ..fitting._store import Store, choose_among
from ..fitting._system import System
from ..mesh import DEPTH
from ..space import pad, to_device
from ..surface import TSpline
from ._features import FeatureCriterion, Features, cumulated, standing_out

# Curvature of a smoothed step over its height and λc⁻²: at most 6.4; at half of that an edge begins to form.
_STEP_CURVATURE = 3.2
_ROUNDS, _RELAXING, _SETTLED = 16, 4, 0.25
_CLEARER = 0.95  # of a level, below which a new one is worth another refinement
_GATHER = 3.0  # T falls to its value by this factor a round, from the largest curvature: the highest edges form first
_RELAXED = 0.05  # factor of a weight where a residual exceeds its limit
_ITERATIONS, _ACCURACY = 400, 1e-8
_SPACINGS = 4  # elements of the start lattice to a cut-off


@dataclass(frozen=True, eq=False)
class EdgesKept:
    """A surface, its residuals at the valid pixels, which of them are outliers, and the account."""

    surface: TSpline
    residuals: Float[np.ndarray, " m"]
    outliers: Bool[np.ndarray, " m"]
    edge_share: float
    stop: StopReason


def default_cutoff(height_map: HeightMap) -> float:
    """What is taken for smooth away from edges where no cut-off is asked for: a quarter of the shorter side."""
    return min(height_map.extent) / 4


def keep_edges(
    height_map: HeightMap,
    features: Features,
    tolerance: float,
    cutoff: float,
    finest_spacing: float | None,
    options: dict[str, Any],
) -> EdgesKept:
    """Refine around features, and smooth everything but edges."""
    problem, outcome = _refined(height_map, features, tolerance, cutoff, finest_spacing, options)
    state = outcome.best
    if not state.tally.counts.any():  # an earlier step was the best, and its device rows moved on
        state = resumed(problem, state)
    coefficients, plain = state.coefficients, state.history[-1].max_error
    plate = _plate(problem, cutoff)
    smooth, weights = plate.smoothed(state)
    if smooth.history[-1].max_error > max(tolerance, plain):
        smooth = with_coefficients(problem, smooth, coefficients, Stopwatch(smooth.history[-1]))
        weights = np.zeros(len(weights))
    areas = plate.areas(smooth)
    return EdgesKept(
        surface_of(problem, smooth),
        _residuals(problem, smooth),
        problem.request.outliers,
        float(areas @ (weights < 0.5) / areas.sum()),
        _stop(outcome, smooth.history[-1].max_error <= tolerance),
    )


def _refined(
    height_map: HeightMap,
    features: Features,
    tolerance: float,
    cutoff: float,
    finest_spacing: float | None,
    options: dict[str, Any],
) -> tuple[Problem, Run]:
    """A fit that resolves the features; again, where blurred edges had hidden what stands out."""
    problem = _problem(height_map, features, tolerance, cutoff, finest_spacing, options)
    outcome = run(problem)
    if features.at.any():
        plain = features.plain[height_map.valid] & ~problem.request.outliers
        level = standing_out(_residuals(problem, outcome.best)[plain], tolerance)
        if level < _CLEARER * features.level:
            criterion = replace(problem.criterion, level=level / problem.scaling.factor)  # type: ignore[call-arg]
            problem = replace(problem, criterion=criterion)
            outcome = run(problem)
    return problem, outcome


def _residuals(problem: Problem, state: State) -> Float[np.ndarray, " m"]:
    """Residuals of the samples, in the map's unit."""
    return residuals_of(problem, state).astype(np.float64)[:, 0] * problem.scaling.factor


def _problem(
    height_map: HeightMap,
    features: Features,
    tolerance: float,
    cutoff: float,
    finest_spacing: float | None,
    options: dict[str, Any],
) -> Problem:
    """A fit whose criterion resolves the features."""
    frame = height_map.frame
    shorter, least = min(frame.extent), finest_spacing or 0.0
    count = int(np.ceil(shorter * _SPACINGS / cutoff - 1e-9))
    if finest_spacing is not None:
        count = min(count, int(shorter / finest_spacing + 1e-9))
    count = max(1, min(count, min(height_map.shape) - 3))
    most = options.get("max_control_points") or np.inf
    while count > 1 and np.prod(np.add(scaled_lattice(frame, count), 3)) > most:
        count -= 1
    lattice = scaled_lattice(frame, count)
    problem = pose_fit(height_map, tolerance=tolerance, lattice=lattice, **options)
    factor = problem.scaling.factor
    criterion = FeatureCriterion(
        tolerance / factor,
        features.level / factor,
        cumulated(features.at),
        (least / frame.extent[0], least / frame.extent[1]),
    )
    return replace(problem, criterion=criterion)


def _stop(outcome: Run, met: bool) -> StopReason:
    """Why refinement stopped; elements that may not be smaller do not ask for it."""
    if met:
        return StopReason.TOLERANCE
    return StopReason.FINEST if outcome.stop is StopReason.TOLERANCE else outcome.stop


def _plate(problem: Problem, cutoff: float) -> "_Plate":
    """λ and T in the scale of the fit: lengths in √(Lx Ly), heights in units of the range."""
    frame = problem.source.frame
    samples = problem.request.samples
    assert samples.grid_shape is not None
    assert isinstance(problem.criterion, FeatureCriterion)
    rows, columns = samples.grid_shape
    length = cutoff / float(np.sqrt(np.prod(frame.extent)))
    return _Plate(
        problem,
        smoothing_for_cutoff(length, (rows - 1) * (columns - 1)),
        _STEP_CURVATURE * problem.criterion.level / length**2,
    )


@dataclass(frozen=True, eq=False)
class _Plate:
    """The reweighted smoothing of a fit.

    **Attributes:**

    - `problem`: the fit.
    - `smoothing`: λ where bending is not relaxed.
    - `curvature`: T.
    """

    problem: Problem
    smoothing: float
    curvature: float

    def smoothed(self, state: State) -> tuple[State, Float[np.ndarray, " bezier"]]:
        """The smooth surface on a state's mesh, and the weights of the elements (by slot)."""
        criterion, owner = self.problem.criterion, state.mesh.elements.owner
        assert isinstance(criterion, FeatureCriterion)
        at_features = state.mesh.by_slot(criterion.at_features(state.mesh.tmesh)[owner])
        areas = self.areas(state)
        weights, relaxed, limit = np.ones(len(owner)), np.ones(len(owner)), np.inf
        left = _RELAXING
        for _ in range(_ROUNDS):
            before = state.coefficients
            state = self._solved(state, weights)
            moved = float(jnp.max(jnp.abs(state.coefficients - before)))
            exceeding = state.mesh.by_slot(state.excess[owner]) > 1
            settled = limit == self.curvature and moved < _SETTLED * criterion.level
            if settled and (left == 0 or not exceeding.any()):
                break
            if settled:
                left -= 1
                relaxed = np.where(exceeding, _RELAXED * relaxed, relaxed)
            squares = state.tally.energy / areas
            if np.isinf(limit):
                limit = np.sqrt(np.max(squares, where=at_features, initial=0.0))
            limit = max(self.curvature, limit / _GATHER)
            weights = relaxed * np.where(at_features, (1 + squares / limit**2) ** -2.0, 1.0)
        return state, weights

    def areas(self, state: State) -> Float[np.ndarray, " bezier"]:
        """Areas of the Bézier elements, by slot."""
        sides = np.diff(state.mesh.by_slot(state.mesh.elements.boxes).reshape(-1, 2, 2), axis=1)[:, 0]
        return np.prod(sides / (np.asarray(self.problem.lattice) << DEPTH), axis=1)

    def _solved(self, state: State, weights: Float[np.ndarray, " bezier"]) -> State:
        """The state with the solution for these weights."""
        problem, mesh, store, n = self.problem, state.mesh, state.store, state.mesh.tmesh.n_anchors
        padded = to_device(pad(self.smoothing * weights, mesh.capacity, 0.0), problem.dtype)
        matrices = _with_bending(store, padded, problem.extent, problem.lattice)
        system = System(store.functions, matrices, store.loads)
        coefficients = solve_directly(system, state.coefficients, n)
        if coefficients is None:  # too large: iterations, from the surface before
            coefficients = conjugate_gradients(
                system,
                choose_among(mesh.slots, len(mesh.slots), mesh.capacity),
                state.coefficients,
                to_device(np.arange(mesh.capacity) < n),
                to_device(_ITERATIONS, np.int32),
                to_device(_ACCURACY, problem.dtype),
                to_device(0.0, problem.dtype),
            ).coefficients
        return with_coefficients(problem, state, coefficients, Stopwatch(state.history[-1]))


@jax.jit
def _with_bending(
    store: Store, weights: Float[Array, " capacity"], extent: Float[Array, " 2"], lattice: Int[Array, " 2"]
) -> Float[Array, "capacity K K"]:
    """The normal matrices with each element's bending energy added by its own weight."""
    sizes = (store.boxes[:, 2:] - store.boxes[:, :2]).astype(extent.dtype) / (lattice << DEPTH).astype(extent.dtype)
    sides = jnp.where(sizes > 0, sizes * extent, 1)
    return store.matrices + weights[:, None, None] * element_energy(store.along_s, store.along_t, sides)
