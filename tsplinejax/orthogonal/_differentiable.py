"""The converged joint fit as a differentiable function of arrays, by the implicit function theorem.

At the fit the gradient of the objective vanishes, so its unknowns move by -H⁻¹ d(gradient). H is the full Hessian: the
2 × 2 blocks carry the surface's second derivatives, D = Jᵀ J + r · S_uu, and the blocks between control points and
parameters the derivatives of the blending functions, C = b J + ∇b r. The parameters are eliminated point by point and
the Schur complement is factorised densely.
"""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._errors import InputError
from ..fitting import element_energy
from ..space import SplineSpace, bernstein
from ..surface import held, invert_two, make_surface, multiply_two
from ._descent import minimise
from ._methods import Joint
from ._prepare import directions_of, masses
from ._problem import FootProblem, Unknowns, residuals
from ._solve import trace_of_damping

MOST_UNKNOWNS = 3000


def fit_points(
    space: SplineSpace,
    points: Float[ArrayLike, "m 3"],
    control_points: Float[ArrayLike, "n 3"],
    parameters: Float[ArrayLike, "m 2"],
    *,
    weights: Float[ArrayLike, " m"] | None = None,
    method: Joint | None = None,
    smoothing: float = 0.0,
    max_iterations: int = 200,
) -> tuple[Float[Array, "n 3"], Float[Array, "m 2"]]:
    """Control points and foot points' parameters of the joint fit over a fixed space, differentiable.

    **Arguments:**

    - `space`: a polynomial spline space with n blending functions.
    - `points`: (m, 3); derivatives are with respect to these.
    - `control_points`, `parameters`: the start. Slip is held to the start's control points; no derivative with respect
      to the start.
    - `weights`: one a point; constant.
    - `method`: `Joint()`; its slip must be above zero, as control points that slide freely have no derivative.
    - `smoothing`: weight λ of the bending energy.
    - `max_iterations`: Gauss-Newton steps at most.

    **Returns:** control points (n, 3) and parameters (m, 2). `grad`, `jacfwd` and `vjp` work on both; a second
    derivative does not.

    **Raises:** `InputError` under `jit` (the fit runs on its own), for shapes that do not fit together, and for more
    than 1000 control points.

    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> space, places = spline_space(b_lattice(1, 1)), np.random.default_rng(0).random((50, 2))
    >>> points = np.column_stack([places, np.sin(places[:, 0])])
    >>> from tsplinejax import lstsq
    >>> control_points, feet = fit_points(space, points, lstsq(space, places, points), places)
    >>> control_points.shape, feet.shape
    ((16, 3), (50, 2))
    """
    method = Joint() if method is None else method
    array = points if isinstance(points, jax.Array) else jnp.asarray(np.asarray(points), space.dtype)
    constant = jax.lax.stop_gradient((array, jnp.asarray(control_points), jnp.asarray(parameters)))
    _check(space, *constant, method)
    shares = np.ones(len(array)) if weights is None else np.asarray(weights, np.float64)
    problem = _problem(space, *constant, shares, method, smoothing)
    start = Unknowns(jnp.zeros_like(problem.hold), jnp.asarray(constant[2], space.dtype))
    found, _, _ = minimise(problem, start, method.steps_by or _tight(space), max_iterations)
    factor = _factorise(problem, found)
    moving = eqx.tree_at(lambda one: one.points, problem, array)
    step = _newton(moving, found, factor)
    still = jax.lax.stop_gradient(step)
    # The value is the fit's; only the derivative of the step counts.
    moves = found.moves - (step.moves - still.moves)
    places = found.parameters - (step.parameters - still.parameters)
    return problem.control_points(moves), places


def _tight(space: SplineSpace) -> Any:
    """Gauss-Newton to round-off: the implicit function theorem holds at the minimum only."""
    import optimistix as optx

    tolerance = 1e-12 if space.dtype == np.float64 else 1e-5
    return optx.GaussNewton(rtol=tolerance, atol=tolerance)


def _check(space: SplineSpace, points: Array, control_points: Array, parameters: Array, method: Joint) -> None:
    n, m = int(space.n_functions), len(points)
    if any(isinstance(part, Tracer) for part in (points, control_points, parameters)):
        raise InputError("fit_points finds its fit outside transformations; use grad or jacfwd on it, without jit")
    if points.shape != (m, 3) or control_points.shape != (n, 3) or parameters.shape != (m, 2):
        raise InputError(
            f"fit_points takes points (m, 3), control points ({n}, 3) and parameters (m, 2); received {points.shape}, "
            f"{control_points.shape} and {parameters.shape}"
        )
    if 3 * n > MOST_UNKNOWNS:
        raise InputError(
            f"fit_points takes up to {MOST_UNKNOWNS // 3} control points; received {n}; use fit_orthogonal"
        )
    if not isinstance(method, Joint) or method.slip <= 0:
        raise InputError(f"fit_points needs Joint(slip=) above zero; received {method!r}; try Joint()")


def _problem(
    space: SplineSpace,
    points: Array,
    control_points: Array,
    parameters: Array,
    weights: np.ndarray,
    method: Joint,
    smoothing: float,
) -> FootProblem:
    """The problem in the points' own scale; its directions come from the start."""
    dtype = space.dtype
    mass = masses(space, np.asarray(parameters), weights)
    hold = np.zeros((len(mass), 3))
    hold[:, 1:] = method.hold * np.maximum(mass, 1e-6 * mass.mean())[:, None]
    directions = directions_of(make_surface(space, control_points), 3)
    arrays = (points, weights, control_points, directions, mass, hold, smoothing, np.ones(2), 0.0)
    return FootProblem(space, *(jnp.asarray(part, dtype) for part in arrays))


class _Factor(eqx.Module):
    """What solves with the full Hessian: blocks between control points and parameters, 2 × 2 inverses, a factor."""

    functions: Array
    across: Float[Array, "m 16 r 2"]
    inverse: Float[Array, "m 3"]
    cholesky: Float[Array, "nr nr"]


@eqx.filter_jit
def _factorise(problem: FootProblem, found: Unknowns) -> _Factor:
    """The full Hessian at the fit, its parameters eliminated."""
    space, tables = problem.space, problem.space.tables
    control = problem.control_points(found.moves)
    element = space.locator(found.parameters)
    size = tables.size[element]
    local = (found.parameters - tables.corner[element]) / size
    along = [
        [jnp.einsum("mka,ma->mk", part[element], bernstein(local[:, k], n)) / size[:, k, None] ** n for n in range(3)]
        for k, part in enumerate((tables.along_s, tables.along_t))
    ]
    functions = tables.functions[element]
    nearby = control[functions]
    orders = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
    values = {(a, b): along[0][a] * along[1][b] for a, b in orders}
    S, S_s, S_t, S_ss, S_st, S_tt = (jnp.einsum("mk,mkc->mc", values[order], nearby) for order in orders)
    r = S - problem.points
    gradient = jnp.stack([jnp.sum(r * part, axis=1) for part in (S_s, S_t)], axis=1)
    pairs = ((S_s, S_s, S_ss), (S_s, S_t, S_st), (S_t, S_t, S_tt))
    form = jnp.stack([jnp.sum(a * b + r * c, axis=1) for a, b, c in pairs], axis=1)
    inverse = invert_two(form, held(found.parameters, gradient))
    directions = problem.directions[functions]
    b = values[0, 0][..., None]
    columns = [
        b * tangent[:, None] + values[order][..., None] * r[:, None]
        for tangent, order in ((S_s, (1, 0)), (S_t, (0, 1)))
    ]
    across = jnp.stack([jnp.einsum("mkcr,mkc->mkr", directions, column) for column in columns], axis=-1)
    across = across * jnp.sqrt(problem.weights)[:, None, None, None]
    n, width = problem.hold.shape
    unknown = (functions[:, :, None] * width + jnp.arange(width)).reshape(len(functions), -1)
    own = (values[0, 0][:, :, None, None] * directions).transpose(0, 2, 1, 3).reshape(len(functions), 3, -1)
    own = own * jnp.sqrt(problem.weights)[:, None, None]
    flat = across.reshape(len(functions), -1, 2)
    reduced = multiply_two(inverse[:, None], flat)
    blocks = jnp.einsum("mca,mcb->mab", own, own) - jnp.einsum("mau,mbu->mab", flat, reduced)
    matrix = jnp.zeros((n * width, n * width), b.dtype).at[unknown[:, :, None], unknown[:, None]].add(blocks)
    energy = problem.smoothing * element_energy(tables.along_s, tables.along_t, tables.size * problem.sides)
    places = problem.directions[tables.functions]
    bending = jnp.einsum("eik,eica,ekcb->eiakb", energy, places, places)
    local_unknown = (tables.functions[:, :, None] * width + jnp.arange(width)).reshape(len(energy), -1)
    matrix = matrix.at[local_unknown[:, :, None], local_unknown[:, None]].add(
        bending.reshape(len(energy), 16 * width, 16 * width)
    )
    damping = trace_of_damping(np.dtype(b.dtype)) * jnp.maximum(problem.mass, 1e-6 * problem.mass.mean())
    matrix = matrix + jnp.diag((problem.hold + damping[:, None]).ravel())
    return _Factor(functions, across, inverse, jnp.linalg.cholesky(matrix))


@eqx.filter_jit
def _newton(problem: FootProblem, found: Unknowns, factor: _Factor) -> Unknowns:
    """H⁻¹ times the objective's gradient at the fit, as a function of the points."""

    def objective(unknowns: Unknowns) -> Array:
        return 0.5 * sum((jnp.sum(part**2) for part in residuals(unknowns, problem)), jnp.zeros(()))

    gradient = jax.grad(objective)(found)
    root = jnp.sqrt(problem.weights)
    safe = jnp.where(problem.weights > 0, problem.weights, 1)[:, None]
    pushed = multiply_two(factor.inverse, gradient.parameters / safe)  # D⁻¹ g_u, weights apart
    spread = jnp.einsum("mkru,mu->mkr", factor.across, pushed) * root[:, None, None]
    load = gradient.moves.at[factor.functions].add(-spread)
    solve = jax.scipy.linalg.cho_solve
    moves = solve((factor.cholesky, True), load.ravel()).reshape(load.shape)
    back = jnp.einsum("mkru,mkr->mu", factor.across, moves[factor.functions]) / jnp.sqrt(safe)
    return Unknowns(moves, pushed - multiply_two(factor.inverse, back))
