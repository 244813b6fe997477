"""The adaptive loop: mark, refine, transfer, accumulate, solve, measure.

`begin` fits the start lattice, `advance` does one step, `terminate` says why to stop: a notebook can drive them by
hand, and [`fit`][tsplinejax.fit] is the loop around them. Elements are marked against a threshold that falls in stages
to the criterion's own: marking for the final tolerance at once refines many elements for errors that their neighbours
cause.
"""

import time
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..mesh import MAX_LEVEL, Refinement, bisect
from ..space import capacity_for, make_blocks, pad, to_device
from ..surface import beside_anchors, blossom
from ._direct import solve_directly
from ._discretisation import Discretisation, discretise, grow, same_elements, unaltered_functions
from ._energy import bending_energy
from ._moments import Moments, add_samples, empty_moments, inherit_moments
from ._problem import Problem
from ._residuals import Residuals, homogeneous_points, residuals
from ._result import Step, StopReason
from ._solve import LocalSolver, conjugate_gradients
from ._system import System, assemble, empty_system, inherit_system, restrict

LONG_SOLVE = 400  # iterations of the solves at the start and the end
SMALLEST = 0.25  # area of an element of one sample that is still cut, in mean areas of a sample
# Relative gradients: where the start's and a later long solve stop, and above which it needs help.
TIGHT, ENOUGH, ACCEPTABLE = 1e-13, 1e-10, 1e-5


@dataclass(frozen=True, eq=False)
class State:
    """A step of the loop: mesh, moments, system, coefficients, residuals, and how each element fares.

    **Attributes:**

    - `excess`: each element's measure as a multiple of the criterion's threshold.
    - `stage`: the multiple that elements are marked against.
    - `polished`: whether the coefficients come from a long solve.
    - `history`: the steps so far; `started`: the clock's reading when the loop began.
    - `exhausted`: whether any further refinement would exceed the control-point budget.
    """

    mesh: Discretisation
    moments: Moments
    system: System
    coefficients: Float[Array, "capacity d"]
    residuals: Residuals
    excess: Float[np.ndarray, " elements"]
    stage: float
    polished: bool
    history: tuple[Step, ...]
    started: float
    exhausted: bool = False

    @property
    def worst(self) -> float:
        """Largest excess of any element: at most one where the criterion is met."""
        return float(self.excess.max())


def begin(problem: Problem) -> State:
    """Fit the start lattice."""
    started = time.perf_counter()
    mesh = discretise(
        problem.start,
        problem.order,
        dtype=problem.dtype,
        rational=problem.rational,
        least_capacity=problem.least_capacity,
    )
    d = problem.data.dimension
    moments = empty_moments(mesh.space, d)
    moments = add_samples(moments, mesh.space, problem.samples, mesh.blocks, problem.tile_length)
    system = _update(problem, mesh, moments, empty_system(mesh.space, d), np.arange(len(mesh.elements)))
    zeros = to_device(np.zeros((mesh.capacity, d)), problem.dtype)
    coefficients = _solve_long(problem, mesh, system, zeros, TIGHT)
    return _measure(problem, mesh, moments, system, coefficients, np.inf, True, (), started)


def advance(problem: Problem, state: State) -> State:
    """One step: mark, refine, transfer, and solve for as much as the solver wants."""
    started = time.perf_counter()
    refinement, stage = _refine(problem, state)
    if refinement is None:
        return replace(state, exhausted=True)
    mesh = discretise(
        refinement.mesh,
        problem.order,
        dtype=problem.dtype,
        rational=problem.rational,
        least_capacity=problem.least_capacity,
    )
    kept = unaltered_functions(state.mesh.tmesh, mesh.tmesh)
    coefficients = _transfer(problem, state, mesh, kept)
    source = same_elements(state.mesh.elements, mesh.elements)
    if problem.rational:  # Σb changes weights and values of every altered neighbourhood: sum all of it again
        source = np.full_like(source, -1)
    changed = np.flatnonzero(source < 0)
    device_source = to_device(pad(source.astype(np.int32), mesh.capacity, -1))
    moments = inherit_moments(state.moments, device_source)
    blocks = make_blocks(mesh.ranges, changed)
    moments = add_samples(moments, mesh.space, problem.samples, blocks, problem.tile_length)
    altered_elements = _touched(mesh, kept < 0) | (source < 0)
    inherited = empty_system(mesh.space, problem.data.dimension)
    if state.system.matrices.shape[1] == inherited.matrices.shape[1]:
        inherited = inherit_system(state.system, mesh.space.tables.functions, device_source)
    else:
        altered_elements[:] = True
    system = _update(problem, mesh, moments, inherited, np.flatnonzero(altered_elements))
    coefficients = _solve_step(problem, mesh, system, coefficients, kept < 0)
    return _measure(problem, mesh, moments, system, coefficients, stage, False, state.history, started, state)


def polish(problem: Problem, state: State) -> State:
    """The same step after a long solve for all control points."""
    started = time.perf_counter() - state.history[-1].seconds
    coefficients = _solve_long(problem, state.mesh, state.system, state.coefficients, ENOUGH)
    return _measure(
        problem,
        state.mesh,
        state.moments,
        state.system,
        coefficients,
        state.stage,
        True,
        state.history[:-1],
        started,
        state,
    )


def remeasure(problem: Problem, state: State) -> State:
    """The same mesh for a problem with another smoothing: assembled and solved anew."""
    system = empty_system(state.mesh.space, problem.data.dimension)
    every = np.arange(len(state.mesh.elements))
    system = _update(problem, state.mesh, state.moments, system, every)
    return polish(problem, replace(state, system=system))


def terminate(problem: Problem, state: State) -> StopReason | None:
    """Why the loop should stop, or `None`."""
    budget, last = problem.budget, state.history[-1]
    if state.worst <= 1:
        return problem.criterion.met
    if budget.max_steps is not None and last.step >= budget.max_steps:
        return StopReason.MAX_STEPS
    if budget.max_seconds is not None and time.perf_counter() - state.started >= budget.max_seconds:
        return StopReason.MAX_SECONDS
    if state.exhausted:
        return StopReason.MAX_CONTROL_POINTS
    if not (splittable(problem, state) & (state.excess > 1)).any():
        return StopReason.FINEST
    return None


def splittable(problem: Problem, state: State) -> Bool[np.ndarray, " elements"]:
    """Elements that hold samples of several places, or of one and are not yet small beside the samples' mean distance.

    A single sample is still worth a few cuts: the functions around it need narrower supports to follow it alone.
    """
    codes, tmesh = problem.order.codes, state.mesh.tmesh
    first = state.mesh.ranges[state.mesh.owner_starts]
    last = np.append(first[1:], len(codes)) - 1
    several = last > first
    several[several] = codes[first[several]] != codes[last[several]]
    assert tmesh.forest is not None
    areas = 0.5**tmesh.levels / np.prod(tmesh.forest.lattice)
    single = (last == first) & (areas * problem.n_samples > SMALLEST)
    return (several | single) & (tmesh.levels < MAX_LEVEL)


def mark(problem: Problem, state: State) -> tuple[Bool[np.ndarray, " elements"], float]:
    """Elements to bisect and the stage they were marked against: the first that marks any."""
    can = splittable(problem, state)
    worst = float(state.excess[can].max())
    stage = max(1.0, worst * problem.stage_factor) if np.isinf(state.stage) else state.stage
    while stage > 1 and worst <= stage:
        stage = max(1.0, stage * problem.stage_factor)
    return can & (state.excess > stage), stage


def _refine(problem: Problem, state: State) -> tuple[Refinement | None, float]:
    """Bisect what is marked, or the worst part that the control-point budget allows; `None` where it allows none."""
    tmesh, limit = state.mesh.tmesh, problem.budget.max_control_points
    marked, stage = mark(problem, state)
    while marked.any():
        refinement = bisect(tmesh, problem.refinement.complete(tmesh, marked))
        if limit is None or refinement.mesh.n_anchors <= limit:
            return refinement, stage
        worst_first = np.argsort(np.where(marked, -state.excess, np.inf), kind="stable")
        half = worst_first[: int(marked.sum()) // 2]
        marked = np.zeros_like(marked)
        marked[half] = True
    return None, stage


def _touched(mesh: Discretisation, chosen: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " bezier"]:
    """Bézier elements on which a chosen function lives."""
    functions = mesh.elements.functions
    return np.any(chosen[np.maximum(functions, 0)] & (functions >= 0), axis=1)


def _update(problem: Problem, mesh: Discretisation, moments: Moments, system: System, elements: np.ndarray) -> System:
    """Assemble the matrices of these elements anew."""
    return assemble(system, mesh.space, moments, problem.smoothing, problem.extent, elements)


def _transfer(problem: Problem, state: State, mesh: Discretisation, kept: np.ndarray) -> Array:
    """Coefficients of the old surface in the new space; functions that did not change keep theirs to the bit."""
    points = homogeneous_points(state.mesh.space, state.coefficients)
    places = beside_anchors(state.mesh.tmesh, state.mesh.elements, mesh.tmesh, mesh.capacity)
    moved = blossom(points, *places)
    source = to_device(pad(kept.astype(np.int32), mesh.capacity, -1))
    return _keep(moved, state.coefficients, source)


@jax.jit
def _keep(moved: Array, old: Array, source: Array) -> Array:
    """Old coefficients where `source` names one, else the moved ones, divided by their Σb where they carry it."""
    d = old.shape[1]
    if moved.shape[1] > d:
        moved = moved[:, :d] / jnp.where(moved[:, d:] > 0, moved[:, d:], 1)
    return jnp.where((source >= 0)[:, None], old[jnp.maximum(source, 0)], moved)


def _solve_step(
    problem: Problem, mesh: Discretisation, system: System, start: Array, altered: Bool[np.ndarray, " n"]
) -> Array:
    """The step's own solve: a few iterations for all control points, or the altered ones and their rings."""
    solver = problem.solver
    free = np.ones(len(altered), bool)
    if isinstance(solver, LocalSolver):
        free = altered
        for _ in range(solver.ring):
            free = grow(mesh.elements.functions, free)
        affected = np.flatnonzero(_touched(mesh, free))
        length = capacity_for(len(affected), problem.least_capacity)
        system = restrict(system, to_device(pad(affected.astype(np.int32), length, -1)))
    iterations = to_device(solver.iterations, np.int32)
    solution = conjugate_gradients(system, start, _device_mask(mesh, free), iterations, to_device(TIGHT, problem.dtype))
    return solution.coefficients


def _solve_long(problem: Problem, mesh: Discretisation, system: System, start: Array, tolerance: float) -> Array:
    """Solve for all control points to the end; a sparse factorisation helps where iterations do not get there."""
    free = _device_mask(mesh, np.ones(mesh.tmesh.n_anchors, bool))
    tight = max(tolerance, 10 * float(np.finfo(problem.dtype).eps))
    solution = conjugate_gradients(
        system, start, free, to_device(LONG_SOLVE, np.int32), to_device(tight, problem.dtype)
    )
    if float(solution.error) > max(ACCEPTABLE, tight):
        exact = solve_directly(system, solution.coefficients, mesh.tmesh.n_anchors)
        return solution.coefficients if exact is None else exact
    return solution.coefficients


def _device_mask(mesh: Discretisation, free: Bool[np.ndarray, " n"]) -> Array:
    return to_device(pad(free, mesh.capacity, False))


def _measure(
    problem: Problem,
    mesh: Discretisation,
    moments: Moments,
    system: System,
    coefficients: Array,
    stage: float,
    polished: bool,
    history: tuple[Step, ...],
    started: float,
    before: State | None = None,
) -> State:
    """Residuals, excess and the step's entry in the history."""
    points = homogeneous_points(mesh.space, coefficients)
    rest = residuals(mesh.space, points, problem.samples, mesh.blocks, problem.tile_length)
    polynomial = points[..., : problem.data.dimension] if problem.rational else points
    excess = problem.criterion.excess(mesh, moments, polynomial, rest)
    energy = float(bending_energy(polynomial, mesh.space.tables.size, problem.extent))
    clock = started if before is None else before.started
    state = State(mesh, moments, system, coefficients, rest, excess, stage, polished, history, clock)
    return replace(state, history=(*history, _entry(problem, state, energy, started)))


def _entry(problem: Problem, state: State, energy: float, started: float) -> Step:
    """The step's line in the history, in the data's unit."""
    factor, rest = problem.scaling.factor, state.residuals
    error = float(rest.plain.sum(dtype=np.float64))
    objective = float(rest.weighted.sum(dtype=np.float64)) + problem.smoothing * energy
    signal, centred = problem.signal
    return Step(
        step=len(state.history),
        control_points=state.mesh.tmesh.n_anchors,
        elements=state.mesh.tmesh.n_elements,
        max_error=float(rest.largest.max()) * factor,
        rms_error=float(np.sqrt(error / problem.n_counted)) * factor,
        snr_db=_decibel(signal, error * factor**2),
        snr_db_centred=_decibel(centred, error * factor**2),
        objective=objective * factor**2,
        tolerance=problem.criterion.stage_tolerance(max(1.0, state.stage), factor),
        seconds=time.perf_counter() - started,
    )


def _decibel(signal: float, error: float) -> float:
    """10 lg(signal / error): infinite for an exact fit, NaN for no signal."""
    if error == 0:
        return float("inf") if signal > 0 else float("nan")
    return float(10 * np.log10(signal / error)) if signal > 0 else float("nan")
