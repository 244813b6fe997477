"""The adaptive loop: mark, refine, transfer, accumulate, solve, measure.

`begin` fits the start lattice, `advance` does one step, `terminate` says why to stop: a notebook can drive them by
hand, and [`fit`][tsplinejax.fit] is the loop around them.
"""

import time
from dataclasses import dataclass, replace

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from .._errors import InputError
from ..mesh import MAX_LEVEL, Refinement
from ..space import pad, to_device
from ..surface import beside_anchors
from ._criteria import NoiseCriterion, explained_squares
from ._direct import solve_directly
from ._discretisation import Change, Discretisation, change, discretise
from ._distributed import measure_samples, sum_samples
from ._problem import Problem
from ._residuals import all_residuals
from ._result import Step, StopReason
from ._samples import AbstractHeldSamples
from ._solve import LocalSolver, conjugate_gradients
from ._stages import ROOM, SMALLEST, bisect_worst, mark_in_stages
from ._stopwatch import Stopwatch
from ._store import (
    Chosen,
    Store,
    choose,
    choose_among,
    clear,
    fresh_store,
    grow,
    renew_points,
    renew_system,
    transfer,
    with_mesh,
)
from ._tally import Tally, empty_tally

LONG_SOLVE = 400  # iterations of the solves at the start and the end
# Where a step's solve and the last one may end: moves of the control points, in thresholds of the criterion.
LOOSE, FINE = 0.1, 0.02
# Relative gradients: where a long solve stops for certain, and above which it needs help.
TIGHT, ACCEPTABLE = 1e-13, 1e-5


@dataclass(frozen=True, eq=False)
class State:
    """A step of the loop: mesh, device store, coefficients, and how each element fares.

    Its device rows move on into the state that `advance` makes of it; what stays valid afterwards is the mesh, the
    coefficients, the tally and the history.

    **Attributes:**

    - `mesh`, `store`: topology on the host, rows of its Bézier elements on the device.
    - `coefficients`: control points in the fit's own scale, (capacity, d), in the order of the mesh's anchors.
    - `tally`: samples and residuals of each Bézier element.
    - `excess`: each element's measure as a multiple of the criterion's threshold.
    - `stage`: the multiple that elements are marked against.
    - `polished`: whether the coefficients come from a long solve.
    - `history`: the steps so far; `started`: the clock's reading when the loop began.
    - `exhausted`: whether any further refinement would exceed the control-point budget.
    """

    mesh: Discretisation
    store: Store
    coefficients: Float[Array, "capacity d"]
    tally: Tally
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

    @property
    def alive(self) -> bool:
        """Whether the device rows are still this state's own."""
        return not any(part.is_deleted() for part in jax.tree.leaves(self.store))


def begin(problem: Problem) -> State:
    """Fit the start lattice."""
    watch, started = Stopwatch(), time.perf_counter()
    mesh = discretise(problem.start, problem.least_capacity)
    watch.lap("topology")
    store = _fresh_store(problem, mesh)
    watch.lap("functions", store)
    coefficients = to_device(np.zeros((mesh.capacity, problem.dimension)), problem.dtype)
    store, tally = _accumulate(problem, mesh, store, coefficients, empty_tally(len(mesh.slots)), mesh.slots)
    watch.lap("moments", store)
    store = _assemble(problem, store, _every(mesh))
    coefficients = _solve_long(problem, mesh, store, coefficients, 0.0)
    watch.lap("solve", coefficients)
    state = State(mesh, store, coefficients, tally, np.zeros(0), np.inf, True, (), started)
    return _measured(problem, state, mesh.slots, watch)


def advance(problem: Problem, state: State) -> State:
    """One step: mark, refine, transfer, and solve for as much as the solver wants.

    The device rows of `state` are used up.

    **Raises:** `InputError` for a state that was advanced before.
    """
    if not state.alive:
        raise InputError("a state is advanced once: its device arrays moved on into the next one; advance that instead")
    watch = Stopwatch()
    refinement, stage = _refine(problem, state)
    if refinement is None:
        return replace(state, exhausted=True)
    step = change(state.mesh, refinement, problem.least_capacity)
    mesh = step.mesh
    watch.lap("topology")
    if state.store.capacity < mesh.capacity:
        state = replace(
            state, store=grow(state.store, mesh.capacity), coefficients=grow(state.coefficients, mesh.capacity)
        )
    coefficients = _transferred(problem, state, step)
    if problem.rational:  # Σb changes weights and values of every altered neighbourhood: all of it is summed anew
        store, changed, touched = _fresh_store(problem, mesh), mesh.slots, mesh.slots
        tally = empty_tally(len(mesh.slots))
    else:
        changed, touched = mesh.slots[step.changed], mesh.slots[step.touched]
        store, tally = with_mesh(state.store, mesh, touched), state.tally.extended(len(mesh.slots))
    watch.lap("functions", (store, coefficients))
    store, tally = _accumulate(problem, mesh, store, coefficients, tally, changed)
    watch.lap("moments", store)
    store = _assemble(problem, store, choose(touched, mesh.capacity))
    least_move = LOOSE * max(1.0, stage) * problem.criterion.resolution(tally)
    coefficients, affected = _solve_step(problem, mesh, store, coefficients, step.kept < 0, least_move)
    watch.lap("solve", coefficients)
    after = replace(state, mesh=mesh, store=store, coefficients=coefficients, tally=tally, stage=stage, polished=False)
    return _measured(problem, after, mesh.slots if problem.rational else affected, watch)


def polish(problem: Problem, state: State) -> State:
    """The same step after a long solve for all control points."""
    watch = Stopwatch(state.history[-1])
    least_move = FINE * problem.criterion.resolution(state.tally)
    coefficients = _solve_long(problem, state.mesh, state.store, state.coefficients, least_move)
    watch.lap("solve", coefficients)
    return with_coefficients(problem, replace(state, polished=True), coefficients, watch)


def taken_back(problem: Problem, polished: State, state: State) -> State:
    """The state before it was polished, on the device rows that moved on into the polished one."""
    every = _every(state.mesh)
    store, _ = renew_points(polished.store, state.coefficients, problem.extent, problem.lattice, every)
    return replace(state, store=store)


def with_coefficients(problem: Problem, state: State, coefficients: Array, watch: Stopwatch) -> State:
    """The same step with other coefficients, measured anew."""
    after = replace(state, coefficients=coefficients, history=state.history[:-1])
    return _measured(problem, after, state.mesh.slots, watch)


def revived(problem: Problem, state: State) -> State:
    """A state whose device rows moved on, with rows of its own again; without moments and normal matrices."""
    if state.alive:
        return state
    slots = np.arange(len(state.mesh.slots))
    mesh = replace(state.mesh, slots=slots)
    again = replace(state, mesh=mesh, store=_fresh_store(problem, mesh), tally=empty_tally(len(slots)))
    return with_coefficients(problem, again, state.coefficients, Stopwatch(state.history[-1]))


def resumed(problem: Problem, state: State) -> State:
    """A state whose device rows moved on, ready to advance: its rows, moments and normal matrices made again."""
    mesh, watch = state.mesh, Stopwatch(state.history[-1])
    store, tally = _accumulate(
        problem, mesh, _fresh_store(problem, mesh), state.coefficients, empty_tally(len(mesh.slots)), mesh.slots
    )
    again = replace(state, store=_assemble(problem, store, _every(mesh)), tally=tally)
    return replace(with_coefficients(problem, again, state.coefficients, watch), history=state.history)


def remeasure(problem: Problem, state: State) -> State:
    """The same mesh for a problem with another smoothing: assembled and solved anew."""
    return polish(problem, replace(state, store=_assemble(problem, state.store, _every(state.mesh))))


def residuals_of(problem: Problem, state: State) -> Float[np.ndarray, "m d"]:
    """The residual of every sample, in the fit's own scale and the order of the data."""
    assert isinstance(problem.samples, AbstractHeldSamples)
    return all_residuals(problem.samples, state.mesh, state.store.points, state.store.boxes, problem.lattice)


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
    tmesh = state.mesh.tmesh
    places = problem.samples.places_in(tmesh, state.mesh.per_element(np.add, state.tally.counts))
    assert tmesh.forest is not None
    areas = 0.5**tmesh.levels / np.prod(tmesh.forest.lattice)
    single = (places == 1) & (areas * problem.source.n_samples > SMALLEST)
    return ((places > 1) | single) & (tmesh.levels < MAX_LEVEL)


def _refine(problem: Problem, state: State) -> tuple[Refinement | None, float]:
    """Bisect what is marked, or the worst part that the control-point budget allows; `None` where it allows none."""
    tmesh, excess, marking = state.mesh.tmesh, state.excess, problem.marking
    marked, stage = mark_in_stages(excess, splittable(problem, state), state.stage, marking.fall)
    limit = problem.budget.max_control_points
    found = bisect_worst(tmesh, marked, excess, problem.refinement, limit)
    far = marked & (excess > marking.twice) & (tmesh.levels < MAX_LEVEL - 1)
    far &= state.mesh.per_element(np.add, state.tally.counts) >= ROOM
    if found is None or not far.any():
        return found, stage
    halves = (far & found.bisected)[found.parent]
    again = bisect_worst(found.mesh, halves, excess[found.parent], problem.refinement, limit)
    return found if again is None else found.then(again), stage


def _every(mesh: Discretisation) -> Chosen:
    """All device rows of a mesh."""
    return choose(mesh.slots, mesh.capacity)


def _fresh_store(problem: Problem, mesh: Discretisation) -> Store:
    """A store of this mesh alone, without samples."""
    return fresh_store(mesh, problem.dimension, rational=problem.rational, dtype=problem.dtype)


def _accumulate(
    problem: Problem, mesh: Discretisation, store: Store, coefficients: Array, tally: Tally, changed: np.ndarray
) -> tuple[Store, Tally]:
    """Sum the samples of the changed elements (device rows) anew."""
    sums = None
    if problem.rational:
        store, _ = renew_points(store, coefficients, problem.extent, problem.lattice, _every(mesh))
        sums = store.points[..., -1:]
    moments = clear(store.moments, choose(changed, mesh.capacity))
    places = mesh.places_of(changed)
    moments, counts = sum_samples(moments, problem.samples, mesh, places, store.boxes, problem.lattice, sums)
    return replace(store, moments=moments), tally.with_counts(changed, counts)


def _assemble(problem: Problem, store: Store, chosen: Chosen) -> Store:
    """Matrices and loads of the chosen elements."""
    return renew_system(store, problem.smoothing, problem.extent, problem.lattice, chosen)


def _transferred(problem: Problem, state: State, step: Change) -> Array:
    """Coefficients of the old surface in the new space; functions that did not change keep theirs to the bit."""
    mesh, old = step.mesh, state.mesh
    altered = np.flatnonzero(step.kept < 0)
    element, knots = beside_anchors(old.tmesh, old.elements, mesh.tmesh, altered)
    return transfer(
        state.coefficients,
        state.store.points,
        to_device(pad(step.kept.astype(np.int32), mesh.capacity, -1)),
        choose(altered, mesh.capacity),
        to_device(pad(old.slots[element].astype(np.int32), mesh.capacity, 0)),
        to_device(pad(knots, mesh.capacity, 0), problem.dtype),
    )


def _solve_step(
    problem: Problem,
    mesh: Discretisation,
    store: Store,
    start: Array,
    altered: Bool[np.ndarray, " n"],
    least_move: float,
) -> tuple[Array, np.ndarray]:
    """The step's own solve, a few iterations for all control points or the altered ones and their rings.

    Also returns the device rows of the elements on which it acts.
    """
    solver = problem.solver
    free, affected = np.ones(len(altered), bool), mesh.slots
    if isinstance(solver, LocalSolver):
        free = altered
        for _ in range(solver.ring):
            free = mesh.with_neighbours(free)
        affected = np.sort(mesh.slots[mesh.touched_by(free)])  # rows in the order of memory
    solution = conjugate_gradients(
        store.system,
        choose_among(affected, len(mesh.slots), mesh.capacity),
        start,
        to_device(pad(free, mesh.capacity, False)),
        to_device(solver.iterations, np.int32),
        to_device(TIGHT, problem.dtype),
        to_device(least_move, problem.dtype),
    )
    return solution.coefficients, affected


def _solve_long(problem: Problem, mesh: Discretisation, store: Store, start: Array, least_move: float) -> Array:
    """Solve for all control points to the end; a sparse factorisation helps where iterations do not get there."""
    n = mesh.tmesh.n_anchors
    tight = max(TIGHT, 10 * float(np.finfo(problem.dtype).eps))
    solution = conjugate_gradients(
        store.system,
        choose_among(mesh.slots, len(mesh.slots), mesh.capacity),
        start,
        to_device(np.arange(mesh.capacity) < n),
        to_device(LONG_SOLVE, np.int32),
        to_device(tight, problem.dtype),
        to_device(least_move, problem.dtype),
    )
    if int(solution.iterations) == LONG_SOLVE and float(solution.error) > ACCEPTABLE:
        exact = solve_directly(store.system, solution.coefficients, n)
        return solution.coefficients if exact is None else exact
    return solution.coefficients


def _measured(problem: Problem, state: State, affected: np.ndarray, watch: Stopwatch) -> State:
    """The state with residuals of the affected elements (device rows), every excess, and its line in the history."""
    mesh, tally, chosen = state.mesh, state.tally, choose(affected, state.mesh.capacity)
    store, energy = renew_points(state.store, state.coefficients, problem.extent, problem.lattice, chosen)
    places = mesh.places_of(affected)
    rest = measure_samples(problem.samples, mesh, places, store.points, store.boxes, problem.lattice)
    tally = tally.with_residuals(affected, rest, np.asarray(energy)[: len(affected)])
    if isinstance(problem.criterion, NoiseCriterion):
        explained = np.asarray(explained_squares(store.moments, store.points, chosen))
        tally = tally.with_explained(affected, explained[: len(affected)])
    excess = problem.criterion.excess(mesh, tally, problem.dimension)
    after = replace(state, store=store, tally=tally, excess=excess)
    watch.lap("residuals")
    return replace(after, history=(*state.history, _entry(problem, after, watch)))


def _entry(problem: Problem, state: State, watch: Stopwatch) -> Step:
    """The step's line in the history, in the data's unit."""
    factor, tally = problem.scaling.factor, state.tally
    error = float(tally.plain.sum())
    objective = float(tally.weighted.sum()) + problem.smoothing * float(tally.energy.sum())
    signal, centred = problem.source.signal
    return Step(
        step=len(state.history),
        control_points=state.mesh.tmesh.n_anchors,
        elements=state.mesh.tmesh.n_elements,
        max_error=float(tally.largest.max()) * factor,
        rms_error=float(np.sqrt(error / problem.source.n_counted)) * factor,
        snr_db=_decibel(signal, error * factor**2),
        snr_db_centred=_decibel(centred, error * factor**2),
        objective=objective * factor**2,
        tolerance=problem.criterion.stage_tolerance(max(1.0, state.stage), factor),
        seconds=watch.seconds,
        stages=watch.stages,
    )


def _decibel(signal: float, error: float) -> float:
    """10 lg(signal / error): infinite for an exact fit, NaN for no signal."""
    if error == 0:
        return float("inf") if signal > 0 else float("nan")
    return float(10 * np.log10(signal / error)) if signal > 0 else float("nan")
