"""A sparse factorisation on the host, for systems on which conjugate gradients stall (large holes, heavy smoothing)."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._system import System

MOST_UNKNOWNS = 60_000


def solve_directly(
    system: System, start: Float[Array, "capacity d"], n_functions: int
) -> Float[Array, "capacity d"] | None:
    """Solve the whole system by a sparse LU; `None` where it is too large, singular, or the result is not finite.

    Functions without samples and energy keep their value in `start`.
    """
    if n_functions > MOST_UNKNOWNS:
        return None
    from scipy.sparse import coo_array, diags_array
    from scipy.sparse.linalg import splu

    functions, matrices, loads = (np.asarray(part) for part in (system.functions, system.matrices, system.loads))
    functions = np.maximum(functions, 0)  # padded rows hold zeros
    k = functions.shape[1]
    rows = np.repeat(functions, k, axis=1).ravel()
    columns = np.tile(functions, (1, k)).ravel()
    matrix = coo_array((matrices.ravel(), (rows, columns)), shape=(n_functions, n_functions)).tocsc()
    load = np.zeros((n_functions, loads.shape[2]))
    np.add.at(load, functions.ravel(), loads.reshape(-1, loads.shape[2]))
    before = np.asarray(start, np.float64)[:n_functions]
    empty = matrix.diagonal() <= 0
    matrix = (matrix + diags_array(empty.astype(float))).tocsc()
    load[empty] = before[empty]
    try:
        options = {"SymmetricMode": True}
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options)
        solution = factor.solve(load)
        solution += factor.solve(load - matrix @ solution)
    except RuntimeError:  # exactly singular
        return None
    if not np.isfinite(solution).all():
        return None
    return jnp.zeros_like(start).at[:n_functions].set(jnp.asarray(solution, start.dtype))
