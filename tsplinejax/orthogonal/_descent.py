"""A descent for optimistix that eliminates the 2 × 2 block of every point, and the loop that uses it.

optimistix composes a Gauss-Newton method of a descent (which step) and a search (how far, and whether to accept it).
Its own descents hand the Jacobian to a linear solver as an opaque operator; this one knows its structure.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._errors import InputError
from ._problem import FootProblem, Unknowns, residuals
from ._solve import falling_trace, solve
from ._system import NormalSystem, assemble, bend_of_path, follow, settle

MOST_STEPS = 256  # that a history holds
MOST_BEND = 0.4  # of a step, as a share of its straight part
LARGE, LARGEST = 1e6, 1e12  # sizes of a guarded step: one over its damping


class Trace(eqx.Module):
    """Objective and length of the reduced gradient (relative to the mass seen) at each accepted iterate, padded."""

    objective: Float[Array, " steps"]
    gradient: Float[Array, " steps"]
    count: Int[Array, ""]

    @property
    def last(self) -> Array:
        """The objective at the last iterate noted."""
        return self.objective[jnp.clip(self.count, 1, MOST_STEPS) - 1]

    def noted(self, objective: Array, gradient: Array) -> "Trace":
        """One iterate more."""
        k = jnp.minimum(self.count, MOST_STEPS - 1)
        return Trace(self.objective.at[k].set(objective), self.gradient.at[k].set(gradient), self.count + 1)


class Prepared(eqx.Module):
    """What the next steps from an iterate need."""

    unknowns: Unknowns
    system: NormalSystem
    trace: Trace


class Elimination(eqx.Module):
    """optimistix's `AbstractDescent` for orthogonal distance fitting: Gauss-Newton steps, damped where too far.

    Damping acts on the control points only, in proportion to the points each of them sees: damped parameters would no
    longer leave n nᵀ behind. A damped step of size σ has the damping 1/σ; a trace of it makes steps shortest where
    control points may slide freely and the matrix is singular. There the way to the solution is a narrow, bent valley:
    `curved` steps follow it to second order (geodesic acceleration; M. K. Transtrum and J. P. Sethna,
    arXiv:1201.5885, 2012).
    """

    problem: FootProblem
    damped: bool = eqx.field(static=True)
    curved: bool = eqx.field(static=True)

    def init(self, y: Unknowns, f_info_struct: Any) -> Prepared:
        """A state of the right shape."""
        blank = jnp.zeros(MOST_STEPS, y.moves.dtype)
        trace = Trace(blank, blank, jnp.zeros((), jnp.int32))
        shape = eqx.filter_eval_shape(assemble, self.problem, y)
        return Prepared(y, jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shape), trace)

    def query(self, y: Unknowns, f_info: Any, state: Prepared) -> Prepared:
        """Normal equations at an accepted iterate."""
        system = assemble(self.problem, y)
        size = jnp.max(jnp.abs(system.gradient) / _mass(self.problem))
        return Prepared(y, system, state.trace.noted(f_info.as_min(), size))

    def step(self, step_size: Array, state: Prepared) -> tuple[Unknowns, Any]:
        """The step of this size, control points first."""
        import optimistix

        problem = self.problem
        damping = falling_trace(np.dtype(problem.points.dtype), 2 * state.trace.last / jnp.sum(problem.weights))
        if self.damped:
            damping = damping + 1 / jnp.maximum(step_size, jnp.finfo(problem.points.dtype).eps)
        hold = problem.hold + damping * _mass(problem)
        moves = -solve(state.system, hold, state.system.gradient)
        change = follow(problem, state.unknowns, moves)
        if self.curved:
            bend = -0.5 * solve(state.system, hold, bend_of_path(problem, state.unknowns, moves, change))
            near = jnp.linalg.norm(bend) <= MOST_BEND * jnp.linalg.norm(moves)
            moves = moves + jnp.where(near, bend, 0)
            change = follow(problem, state.unknowns, moves)
        feet = settle(problem, state.unknowns.moves + moves, state.unknowns.parameters + change)
        return Unknowns(moves, feet - state.unknowns.parameters), optimistix.RESULTS.successful


class Guard(eqx.Module):
    """optimistix's `AbstractSearch` that accepts no step that raises the objective.

    Steps are all but whole at first. One that raises the objective is tried again at a tenth of its size, with ten
    times the damping; after one that does not the size grows as much. Rounding does not count as a rise.
    """

    def init(self, y: Unknowns, f_info_struct: Any) -> Array:
        """The first step is all but whole."""
        return jnp.full((), LARGE, y.moves.dtype)

    def step(
        self, first_step: Array, y: Unknowns, y_eval: Unknowns, f_info: Any, f_eval_info: Any, state: Array
    ) -> tuple[Array, Array, Any, Array]:
        """The size of the next step, and whether to accept the last one."""
        import optimistix

        rounding = 1 + 1e3 * jnp.finfo(state.dtype).eps
        accept = first_step | (f_eval_info.as_min() <= rounding * f_info.as_min())
        size = jnp.where(first_step, state, jnp.where(accept, jnp.minimum(10 * state, LARGEST), 0.1 * state))
        return size, accept, optimistix.RESULTS.successful, size


def _mass(problem: FootProblem) -> Float[Array, "n 1"]:
    """The weight of the points each control point sees, or a little where it sees next to nothing."""
    return jnp.maximum(problem.mass, 1e-6 * jnp.mean(problem.mass))[:, None]


def eliminating(solver: Any, problem: FootProblem) -> Any:
    """An optimistix solver whose descent is replaced; by default Gauss-Newton with a guard.

    **Raises:** `InputError` for anything but `GaussNewton` and `LevenbergMarquardt`.
    """
    import optimistix as optx

    guarded = solver is None
    if solver is None:
        tolerance = 1e-7 if problem.points.dtype == np.float64 else 1e-4
        solver = optx.GaussNewton(rtol=tolerance, atol=tolerance)
    if not isinstance(solver, optx.GaussNewton | optx.LevenbergMarquardt):
        raise InputError(
            "a solver is optimistix.GaussNewton(rtol, atol) or optimistix.LevenbergMarquardt(rtol, atol); received "
            f"{type(solver).__name__}; leave it out for Gauss-Newton"
        )
    slides = bool((problem.hold == 0).all()) and problem.hold.shape[1] > 1
    descent = Elimination(problem, guarded or isinstance(solver, optx.LevenbergMarquardt), guarded and slides)
    parts: tuple[Any, ...] = (descent,)
    if guarded:
        parts = (*parts, Guard())
        return eqx.tree_at(lambda one: (one.descent, one.search), solver, parts)
    return eqx.tree_at(lambda one: (one.descent,), solver, parts)


def minimise(problem: FootProblem, start: Unknowns, solver: Any, max_iterations: int) -> tuple[Unknowns, Trace, bool]:
    """Fit from a start: the unknowns, the trace, and whether it settled."""
    unknowns, trace, settled = _iterate(eliminating(solver, problem), problem, start, jnp.int32(max_iterations))
    return unknowns, trace, bool(settled)


@eqx.filter_jit
def _iterate(solver: Any, problem: FootProblem, start: Unknowns, most: Array) -> tuple[Unknowns, Trace, Array]:
    """optimistix's own loop, but with a number of steps that is known only when it runs: one compilation for all."""

    def fn(y: Unknowns, args: FootProblem) -> tuple[tuple[Array, ...], None]:
        return residuals(y, args), None

    shapes = jax.eval_shape(lambda: fn(start, problem)[0])
    state = solver.init(fn, start, problem, {}, shapes, None, frozenset())
    moving, fixed = eqx.partition(state, eqx.is_array)

    def unfinished(carry: tuple[Unknowns, Any, Array]) -> Array:
        y, moving, k = carry
        done, _ = solver.terminate(fn, y, problem, {}, eqx.combine(moving, fixed), frozenset())
        return ~done & (k < most)

    def once(carry: tuple[Unknowns, Any, Array]) -> tuple[Unknowns, Any, Array]:
        y, moving, k = carry
        y, state, _ = solver.step(fn, y, problem, {}, eqx.combine(moving, fixed), frozenset())
        return y, eqx.filter(state, eqx.is_array), k + 1

    y, moving, _ = jax.lax.while_loop(unfinished, once, (start, moving, jnp.int32(0)))
    state = eqx.combine(moving, fixed)
    done, _ = solver.terminate(fn, y, problem, {}, state, frozenset())
    return y, state.descent_state.trace, done
