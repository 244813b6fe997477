"""The quadratic form of a fit: one K × K matrix a Bézier element."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..space import product_weights
from ._energy import bernstein_energy
from ._moments import Moments
from ._tiles import add_up, barrier


class System(eqx.Module):
    """Σ_e over Bézier elements: `matrices` (e, K, K), `loads` (e, K, d), and the `functions` (e, K) they belong to."""

    functions: Int[Array, "e K"]
    matrices: Float[Array, "e K K"]
    loads: Float[Array, "e K d"]


def element_matrices(
    functions: Int[Array, "e K"],
    along_s: Float[Array, "e K 4"],
    along_t: Float[Array, "e K 4"],
    sides: Float[Array, "e 2"],
    moments: Moments,
    smoothing: Float[Array, ""],
) -> tuple[Float[Array, "e K K"], Float[Array, "e K d"]]:
    """Matrices C (M + λ K) Cᵀ and loads C R; the rows of C are the functions' sixteen Bernstein coefficients.

    The products are sums written out, one outer product a Bernstein polynomial.
    """
    e, width = functions.shape
    turned_s, turned_t = jnp.swapaxes(along_s, 1, 2), jnp.swapaxes(along_t, 1, 2)
    basis = barrier((turned_s[:, :, None] * turned_t[:, None]).reshape(e, 16, width))  # Cᵀ
    form = barrier(bernstein_mass(moments.mass) + smoothing * bernstein_energy(sides))
    half = barrier(add_up(form[:, :, m, None] * basis[:, m, None] for m in range(16)))
    matrices = add_up(half[:, m, :, None] * basis[:, m, None] for m in range(16))
    load = moments.load.reshape(e, 16, -1)
    return matrices, add_up(basis[:, m, :, None] * load[:, m, None] for m in range(16))


def bernstein_mass(mass: Float[Array, "e 7 7"]) -> Float[Array, "e 16 16"]:
    """Gram matrices of the sixteen products of cubic Bernstein polynomials, from the moments of degree six."""
    weights = jnp.asarray(product_weights(), mass.dtype)
    place = np.add.outer(np.arange(4), np.arange(4))
    full = (
        mass[:, place[:, None, :, None], place[None, :, None, :]] * weights[:, None, :, None] * weights[None, :, None]
    )
    return full.reshape(-1, 16, 16)
