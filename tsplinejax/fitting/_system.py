"""The quadratic form of a fit: one K × K matrix a Bézier element."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..space import product_weights
from ._energy import bernstein_energy
from ._moments import Moments


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
    """Matrices C (M + λ K) Cᵀ and loads C R; the rows of C are the functions' sixteen Bernstein coefficients."""
    basis = (along_s[..., :, None] * along_t[..., None, :]).reshape(*functions.shape, 16)
    form = bernstein_mass(moments.mass) + smoothing * bernstein_energy(sides)
    half = jnp.matmul(basis, form, precision="highest")
    matrices = jnp.matmul(half, jnp.swapaxes(basis, 1, 2), precision="highest")
    load = moments.load.reshape(len(functions), 16, -1)
    return matrices, jnp.matmul(basis, load, precision="highest")


def bernstein_mass(mass: Float[Array, "e 7 7"]) -> Float[Array, "e 16 16"]:
    """Gram matrices of the sixteen products of cubic Bernstein polynomials, from the moments of degree six."""
    weights = jnp.asarray(product_weights(), mass.dtype)
    place = np.add.outer(np.arange(4), np.arange(4))
    full = (
        mass[:, place[:, None, :, None], place[None, :, None, :]] * weights[:, None, :, None] * weights[None, :, None]
    )
    return full.reshape(-1, 16, 16)
