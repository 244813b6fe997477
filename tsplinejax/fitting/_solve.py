"""Least squares over a spline space by preconditioned conjugate gradients.

The objective Σ_j w_j |v_j - f(s_j, t_j)|² + λ E(f) is a quadratic form in the control points. Conjugate gradients
start from the surface of the step before, exactly transferred, so every iteration lowers the objective.
[`LocalSolver`][tsplinejax.LocalSolver] frees only the control points near a change (Eqs 5-6),
[`GlobalSolver`][tsplinejax.GlobalSolver] all of them (Eq. 4).
"""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ._store import Chosen, Consecutive, Members, over, rows_at
from ._system import System
from ._tiles import add_up


class AbstractSolver:
    """How much of the surface a step solves for, in how many conjugate-gradient `iterations`."""

    iterations: int


@dataclass(frozen=True)
class GlobalSolver(AbstractSolver):
    """All control points, in every step (Eq. 4).

    **Arguments:**

    - `iterations`: conjugate-gradient iterations of a step; a loose solve is enough to mark by.

    >>> GlobalSolver()
    GlobalSolver(iterations=10)
    """

    iterations: int = 10


@dataclass(frozen=True)
class LocalSolver(AbstractSolver):
    """Control points whose blending functions are new or altered, and rings of neighbours; the rest stays (Eqs 5-6).

    **Arguments:**

    - `ring`: how many rings of neighbours are freed too; 0 is the paper's own choice.
    - `iterations`: conjugate-gradient iterations of a step at most; a loose solve is enough to mark by.

    >>> LocalSolver(ring=0)
    LocalSolver(ring=0, iterations=10)
    """

    ring: int = 1
    iterations: int = 10


class Solution(eqx.Module):
    """Coefficients (capacity, d), iterations used, and the last residual relative to the load, preconditioned."""

    coefficients: Float[Array, "capacity d"]
    iterations: Int[Array, ""]
    error: Float[Array, ""]


@jax.jit
def conjugate_gradients(
    system: System,
    chosen: Chosen | Members,
    start: Float[Array, "capacity d"],
    free: Bool[Array, " capacity"],
    iterations: Int[Array, ""],
    tolerance: Float[Array, ""],
    least_move: Float[Array, ""],
) -> Solution:
    """Lower the objective from `start` by conjugate gradients with diagonal scaling, over the free coefficients.

    `chosen` lists the Bézier elements on which any of them lives. Stops after `iterations`, where the scaled gradient
    has fallen below `tolerance` of the scaled load, or where no coefficient moves by more than `least_move`.
    """
    diagonal, load, product = _first_pass(system, chosen, start)
    movable = free & (diagonal > 0)
    scale = jnp.where(movable, 1 / jnp.where(movable, diagonal, 1), 0)[:, None]

    def apply(x: Array) -> Array:
        return jnp.where(movable[:, None], _multiply(system, chosen, x), 0)

    load_norm = jnp.sum(load * scale * load, axis=0)
    gradient = jnp.where(movable[:, None], load - product, 0)
    x, k, energy = descend(apply, start, gradient, scale, tolerance**2 * load_norm, iterations, least_move)
    error = jnp.sqrt(jnp.max(energy / jnp.where(load_norm > 0, load_norm, 1)))
    return Solution(x, k, error)


def _multiply(system: System, chosen: Chosen | Members, x: Float[Array, "capacity d"]) -> Float[Array, "capacity d"]:
    """Σ_e A_e x over the chosen elements."""

    def turn(rows: Array | Consecutive, real: Array, total: Array) -> Array:
        functions = jnp.maximum(rows_at(system.functions, rows), 0)
        return total.at[functions].add(_products(system.matrices, rows, real, x[functions]))

    return over(chosen, turn, jnp.zeros_like(x))


def _products(
    matrices: Float[Array, "e K K"],
    rows: Array | Consecutive,
    real: Bool[Array, " chunk"],
    local: Float[Array, "chunk K d"],
) -> Float[Array, "chunk K d"]:
    """A_e x for a chunk of elements; the matrices are symmetric, so their rows serve as columns."""
    local = jnp.where(real[:, None, None], local, 0)
    if isinstance(rows, Consecutive):
        chunk = rows_at(matrices, rows)
        return add_up(chunk[:, j, :, None] * local[:, j, None] for j in range(local.shape[1]))
    return add_up(matrices[rows, j][..., None] * local[:, j, None] for j in range(local.shape[1]))


def _first_pass(system: System, chosen: Chosen | Members, x: Array) -> tuple[Array, Array, Array]:
    """Diagonal, right-hand side, and matrix times x, of the chosen elements."""

    def turn(rows: Array | Consecutive, real: Array, carry: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        functions = jnp.maximum(rows_at(system.functions, rows), 0)
        squares = jnp.where(real[:, None], jnp.diagonal(rows_at(system.matrices, rows), axis1=1, axis2=2), 0)
        loads = jnp.where(real[:, None, None], rows_at(system.loads, rows), 0)
        products = _products(system.matrices, rows, real, x[functions])
        diagonal, load, product = carry
        return diagonal.at[functions].add(squares), load.at[functions].add(loads), product.at[functions].add(products)

    return over(chosen, turn, (jnp.zeros(len(x), x.dtype), jnp.zeros_like(x), jnp.zeros_like(x)))


def descend(
    apply: Callable[[Array], Array],
    start: Float[Array, "n d"],
    gradient: Float[Array, "n d"],
    scale: Float[Array, "n 1"],
    limit: Float[Array, " d"],
    iterations: Int[Array, ""],
    least_move: Float[Array, ""] | float = 0.0,
) -> tuple[Float[Array, "n d"], Int[Array, ""], Float[Array, " d"]]:
    """Conjugate gradients with diagonal scaling; every column is a system of its own.

    **Arguments:**

    - `apply`: the symmetric positive matrix.
    - `start`, `gradient`: where to begin, and load minus matrix times it.
    - `scale`: one over the diagonal.
    - `limit`: the loop ends where no column's scaled squared gradient exceeds it, or after `iterations`,
    - `least_move`: or where an iteration moves nothing by more than this.

    **Returns:** the solution, the iterations used, and the last scaled squared gradients.
    """

    def unfinished(state: tuple[Array, ...]) -> Array:
        *_, energy, k, moved = state
        return (k < iterations) & jnp.any(energy > limit) & (moved > least_move)

    def iterate(state: tuple[Array, ...]) -> tuple[Array, ...]:
        x, r, p, energy, k, _ = state
        q = apply(p)
        curvature = jnp.sum(p * q, axis=0)
        step = jnp.where(curvature > 0, energy / jnp.where(curvature > 0, curvature, 1), 0)
        x, r = x + step * p, r - step * q
        new = jnp.sum(r * scale * r, axis=0)
        moved = jnp.max(jnp.abs(step * p))
        p = scale * r + jnp.where(energy > 0, new / jnp.where(energy > 0, energy, 1), 0) * p
        return x, r, p, new, k + 1, moved

    z = scale * gradient
    far = jnp.full((), jnp.inf, start.dtype)
    first = (start, gradient, z, jnp.sum(gradient * z, axis=0), jnp.zeros((), jnp.int32), far)
    x, _, _, energy, k, _ = jax.lax.while_loop(unfinished, iterate, first)
    return x, k, energy
