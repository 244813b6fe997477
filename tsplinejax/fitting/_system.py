"""The quadratic form of a fit, one K × K matrix a Bézier element, kept up to date where the mesh changes."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..space import ElementTables, SplineSpace, pad, product_weights, to_device
from ._energy import element_energy
from ._moments import Moments


class System(eqx.Module):
    """Σ_e over Bézier elements: `matrices` (e, K, K), `loads` (e, K, d), and the `functions` (e, K) they belong to."""

    functions: Int[Array, "e K"]
    matrices: Float[Array, "e K K"]
    loads: Float[Array, "e K d"]


def empty_system(space: SplineSpace, dimension: int) -> System:
    """The system of no samples."""
    capacity, k = space.tables.functions.shape
    return System(
        space.tables.functions,
        jnp.zeros((capacity, k, k), space.dtype),
        jnp.zeros((capacity, k, dimension), space.dtype),
    )


@partial(jax.jit, donate_argnums=0)
def _assemble_chunk(
    store: tuple[Array, Array], tables: ElementTables, moments: Moments, smoothing: Array, extent: Array, chosen: Array
) -> tuple[Array, Array]:
    """Fill in the matrices and loads of the chosen elements; negative entries are padding and write nothing."""
    index = jnp.maximum(chosen, 0)
    matrices, loads = element_matrices(
        tables.functions[index],
        tables.along_s[index],
        tables.along_t[index],
        tables.size[index] * extent,
        Moments(moments.mass[index], moments.load[index]),
        smoothing,
    )
    place = jnp.where(chosen >= 0, chosen, len(tables.functions))
    return store[0].at[place].set(matrices, mode="drop"), store[1].at[place].set(loads, mode="drop")


def assemble(
    system: System,
    space: SplineSpace,
    moments: Moments,
    smoothing: float,
    extent: Float[Array, " 2"],
    elements: Int[np.ndarray, " chosen"],
) -> System:
    """The system with the chosen elements' matrices and loads computed anew; the old one's arrays are used up.

    `extent` is the physical extent in units of √(Lx Ly).
    """
    chunk = max(64, len(space.tables.corner) // 32)
    store = (system.matrices, system.loads)
    weight = to_device(smoothing, space.dtype)
    for first in range(0, len(elements), chunk):
        chosen = pad(elements[first : first + chunk].astype(np.int32), chunk, -1)
        store = _assemble_chunk(store, space.tables, moments, weight, extent, to_device(chosen))
    return System(system.functions, *store)


def element_matrices(
    functions: Int[Array, "e K"],
    along_s: Float[Array, "e K 4"],
    along_t: Float[Array, "e K 4"],
    sides: Float[Array, "e 2"],
    moments: Moments,
    smoothing: Float[Array, ""],
) -> tuple[Float[Array, "e K K"], Float[Array, "e K d"]]:
    """Matrices C M Cᵀ + λ K and loads C R of Bézier elements; C holds the functions' sixteen Bernstein coefficients."""
    basis = (along_s[..., :, None] * along_t[..., None, :]).reshape(*functions.shape, 16)
    half = jnp.einsum("eia,eab->eib", basis, bernstein_mass(moments.mass), precision="highest")
    matrices = jnp.einsum("eib,ejb->eij", half, basis, precision="highest")
    matrices = matrices + smoothing * element_energy(along_s, along_t, sides)
    load = moments.load.reshape(len(functions), 16, -1)
    return matrices, jnp.einsum("eia,ead->eid", basis, load, precision="highest")


@jax.jit
def inherit_system(system: System, functions: Array, source: Int[Array, " capacity"]) -> System:
    """The system in a new numbering: each element's old matrix and load, or zeros where `source` is negative."""
    known, source = (source >= 0)[:, None, None], jnp.maximum(source, 0)
    return System(functions, jnp.where(known, system.matrices[source], 0), jnp.where(known, system.loads[source], 0))


@jax.jit
def restrict(system: System, elements: Int[Array, " chosen"]) -> System:
    """The part of the system that belongs to the chosen elements (negative: none)."""
    present, index = (elements >= 0)[:, None, None], jnp.maximum(elements, 0)
    return System(
        system.functions[index],
        jnp.where(present, system.matrices[index], 0),
        jnp.where(present, system.loads[index], 0),
    )


def bernstein_mass(mass: Float[Array, "e 7 7"]) -> Float[Array, "e 16 16"]:
    """Gram matrices of the sixteen products of cubic Bernstein polynomials, from the moments of degree six."""
    weights = jnp.asarray(product_weights(), mass.dtype)
    place = np.add.outer(np.arange(4), np.arange(4))
    full = (
        mass[:, place[:, None, :, None], place[None, :, None, :]] * weights[:, None, :, None] * weights[None, :, None]
    )
    return full.reshape(-1, 16, 16)
