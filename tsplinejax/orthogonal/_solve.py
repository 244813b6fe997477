"""Solving the reduced normal equations: a dense Cholesky factor where they are small, else conjugate gradients.

Without held slip the matrix is all but singular: control points may slide along the surface. A trace of damping then
makes the step the shortest one, up to the trace. The trace falls with the mean squared distance: one that stays makes
the last steps linear, one that vanishes so leaves them quadratic (Yamashita & Fukushima, "On the rate of convergence of
the Levenberg-Marquardt method", Computing Suppl. 15, 2001).
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._system import NormalSystem, blocks_of, dense, multiply

MOST_DENSE = 1600
ITERATIONS = 500


def trace_of_damping(dtype: np.dtype) -> float:
    """Damping relative to the mass that a control point sees, above the rounding of the sums."""
    return 1e-10 if dtype == np.float64 else 1e-5


def falling_trace(dtype: np.dtype, mean_square: Float[Array, ""]) -> Float[Array, ""]:
    """The same for a mean squared distance in the fit's own scale: no more than that, and above rounding."""
    most = trace_of_damping(dtype)
    return jnp.clip(mean_square, most / 1000 if dtype == np.float64 else most, most)


def solve(
    system: NormalSystem, hold: Float[Array, "n r"], load: Float[Array, "n r"] | Float[Array, "n r c"]
) -> Float[Array, "n r"] | Float[Array, "n r c"]:
    """Solve for moves; `hold` is added to the diagonal. Control points that nothing determines do not move."""
    held = jnp.where(system.diagonal + hold > 0, hold, 1)
    if hold.size <= MOST_DENSE:
        return _by_factor(system, held, load)
    if load.ndim == 2:
        return _by_gradients(system, held, load)
    return jax.lax.map(lambda column: _by_gradients(system, held, column), jnp.moveaxis(load, -1, 0)).transpose(1, 2, 0)


def _by_factor(system: NormalSystem, hold: Array, load: Array) -> Array:
    matrix = dense(system, hold)
    scale = 1 / jnp.sqrt(jnp.diagonal(matrix))
    factor = jax.scipy.linalg.cho_factor(matrix * scale[:, None] * scale, lower=True)
    flat = load.reshape(len(scale), -1)
    solution = jax.scipy.linalg.cho_solve(factor, flat * scale[:, None]) * scale[:, None]
    return solution.reshape(load.shape)


def _by_gradients(system: NormalSystem, hold: Array, load: Array) -> Array:
    inverses = jnp.linalg.inv(blocks_of(system, hold))

    def precondition(x: Array) -> Array:
        return jnp.einsum("nab,nb->na", inverses, x, precision="highest")

    tolerance = 1e-10 if load.dtype == np.float64 else 1e-5
    return jax.scipy.sparse.linalg.cg(
        lambda x: multiply(system, hold, x), load, tol=tolerance, maxiter=ITERATIONS, M=precondition
    )[0]
