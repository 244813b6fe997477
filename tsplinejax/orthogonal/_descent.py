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
from ._solve import solve, trace_of_damping
from ._system import NormalSystem, assemble, follow

MOST_STEPS = 256  # that a history holds


class Trace(eqx.Module):
    """Objective and length of the reduced gradient (relative to the mass seen) at each accepted iterate, padded."""

    objective: Float[Array, " steps"]
    gradient: Float[Array, " steps"]
    count: Int[Array, ""]

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
    """optimistix's `AbstractDescent` for orthogonal distance fitting: Gauss-Newton steps, or Levenberg-Marquardt ones.

    The damping of Levenberg-Marquardt, one over the step size, acts on the control points only, in proportion to the
    points each of them sees: damped parameters would no longer leave n nᵀ behind.
    """

    problem: FootProblem
    damped: bool = eqx.field(static=True)

    def init(self, y: Unknowns, f_info_struct: Any) -> Prepared:
        """A state of the right shape."""
        blank = jnp.zeros(MOST_STEPS, y.moves.dtype)
        trace = Trace(blank, blank, jnp.zeros((), jnp.int32))
        shape = eqx.filter_eval_shape(assemble, self.problem, y)
        return Prepared(y, jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), shape), trace)

    def query(self, y: Unknowns, f_info: Any, state: Prepared) -> Prepared:
        """Normal equations at an accepted iterate."""
        system = assemble(self.problem, y)
        size = jnp.max(jnp.abs(system.gradient) / jnp.maximum(self.problem.mass, _least(self.problem))[:, None])
        return Prepared(y, system, state.trace.noted(f_info.as_min(), size))

    def step(self, step_size: Array, state: Prepared) -> tuple[Unknowns, Any]:
        """The step of this size, control points first."""
        import optimistix

        problem = self.problem
        damping = trace_of_damping(np.dtype(problem.points.dtype))
        length = 1.0
        if self.damped:
            damping = damping + 1 / jnp.maximum(step_size, jnp.finfo(problem.points.dtype).eps)
        else:
            length = step_size
        mass = jnp.maximum(problem.mass, _least(problem))[:, None]
        moves = -length * solve(state.system, problem.hold + damping * mass, state.system.gradient)
        return Unknowns(moves, follow(problem, state.unknowns, moves)), optimistix.RESULTS.successful


def _least(problem: FootProblem) -> Array:
    """Mass of control points that see next to nothing."""
    return 1e-6 * jnp.mean(problem.mass)


def eliminating(solver: Any, problem: FootProblem) -> Any:
    """An optimistix solver whose descent is replaced; by default Gauss-Newton.

    **Raises:** `InputError` for anything but `GaussNewton` and `LevenbergMarquardt`.
    """
    import optimistix as optx

    if solver is None:
        tolerance = 1e-9 if problem.points.dtype == np.float64 else 1e-5
        solver = optx.GaussNewton(rtol=tolerance, atol=tolerance)
    if not isinstance(solver, optx.GaussNewton | optx.LevenbergMarquardt):
        raise InputError(
            "a solver is optimistix.GaussNewton(rtol, atol) or optimistix.LevenbergMarquardt(rtol, atol); received "
            f"{type(solver).__name__}; leave it out for Gauss-Newton"
        )
    descent = Elimination(problem, isinstance(solver, optx.LevenbergMarquardt))
    return eqx.tree_at(lambda one: one.descent, solver, descent, is_leaf=lambda leaf: leaf is solver.descent)


def minimise(
    problem: FootProblem, start: Unknowns, solver: Any, max_iterations: int
) -> tuple[Unknowns, Trace, bool]:
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
