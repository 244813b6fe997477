"""Bending energy ∫ |f_xx|² + 2 |f_xy|² + |f_yy|² dx dy, exact on every Bézier element.

Lengths are physical and counted in units of √(Lx Ly), so that the energy (in the values' unit squared) and the
smoothing weight λ do not depend on the unit of length. A linear smoothing of weight λ on m evenly spread samples
transmits a wave of length L with 1 / (1 + (λc / L)⁴), where λ = m (λc / 2π)⁴ and λc is in the same unit of length.
"""

from functools import lru_cache

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..space import gram


@lru_cache
def energy_grams() -> Float[np.ndarray, "3 16 16"]:
    """∫ f_uu², 2 ∫ f_uv² and ∫ f_vv² of sixteen Bernstein products over the unit square, as quadratic forms."""
    terms = ((2, 0, 1), (1, 1, 2), (0, 2, 1))
    return np.stack([factor * np.kron(gram(order_s), gram(order_t)) for order_s, order_t, factor in terms])


def energy_scales(sides: Float[Array, "e 2"]) -> Float[Array, "e 3"]:
    """What the three terms become on elements with physical sides."""
    width, height = sides[:, 0], sides[:, 1]
    return jnp.stack([height / width**3, 1 / (width * height), width / height**3], axis=1)


def bernstein_energy(sides: Float[Array, "e 2"]) -> Float[Array, "e 16 16"]:
    """Energy matrices of the sixteen Bernstein products on elements with physical sides, closed integrals."""
    return jnp.einsum(
        "ek,kij->eij", energy_scales(sides), jnp.asarray(energy_grams(), sides.dtype), precision="highest"
    )


def element_energy(
    along_s: Float[Array, "e K 4"], along_t: Float[Array, "e K 4"], sides: Float[Array, "e 2"]
) -> Float[Array, "e K K"]:
    """Energy matrices of the blending functions on elements with physical sides."""
    basis = (along_s[..., :, None] * along_t[..., None, :]).reshape(*along_s.shape[:2], 16)
    half = jnp.matmul(basis, bernstein_energy(sides), precision="highest")
    return jnp.matmul(half, jnp.swapaxes(basis, 1, 2), precision="highest")


def piece_energies(points: Float[Array, "e 4 4 d"], sides: Float[Array, "e 2"]) -> Float[Array, " e"]:
    """The energy of each polynomial piece with these Bézier points, on an element with these physical sides."""
    flat = points.reshape(len(points), 16, -1)
    scales, grams = energy_scales(sides), jnp.asarray(energy_grams(), points.dtype)
    terms = [jnp.sum(flat * jnp.einsum("ij,ejd->eid", form, flat, precision="highest"), axis=(1, 2)) for form in grams]
    return terms[0] * scales[:, 0] + terms[1] * scales[:, 1] + terms[2] * scales[:, 2]


def default_smoothing(n_samples: int) -> float:
    """The weight that only fills what the samples leave open: its cut-off is a third of their mean distance.

    >>> 0 < default_smoothing(10_000) < 1e-8
    True
    """
    return smoothing_for_cutoff(0.3 / np.sqrt(n_samples), n_samples)


def smoothing_for_cutoff(cutoff: float, density: float) -> float:
    """λ of a cut-off length, both in units of √(Lx Ly), for a number of samples per unit of area.

    >>> round(smoothing_for_cutoff(2 * np.pi, 3.0), 12)
    3.0
    """
    return float(density * (cutoff / (2 * np.pi)) ** 4)
