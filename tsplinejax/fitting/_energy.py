"""Bending energy ∫ |f_xx|² + 2 |f_xy|² + |f_yy|² dx dy, exact on every Bézier element.

Lengths are physical and counted in units of √(Lx Ly), so that the energy (in the values' unit squared) and the
smoothing weight λ do not depend on the unit of length. A linear smoothing of weight λ on m evenly spread samples
transmits a wave of length L with 1 / (1 + (λc / L)⁴), where λ = m (λc / 2π)⁴ and λc is in the same unit of length.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..space import gram


def element_energy(
    along_s: Float[Array, "e K 4"], along_t: Float[Array, "e K 4"], sides: Float[Array, "e 2"]
) -> Float[Array, "e K K"]:
    """Energy matrices of Bézier elements with physical sides, closed Bernstein integrals."""
    grams = [jnp.asarray(gram(order), along_s.dtype) for order in range(3)]
    s, t = (
        [jnp.einsum("eia,ab,ejb->eij", along, matrix, along, precision="highest") for matrix in grams]
        for along in (along_s, along_t)
    )
    width, height = sides[:, 0, None, None], sides[:, 1, None, None]
    return s[2] * t[0] * height / width**3 + 2 * s[1] * t[1] / (width * height) + s[0] * t[2] * width / height**3


def piece_energies(points: Float[Array, "e 4 4 d"], sides: Float[Array, "e 2"]) -> Float[Array, " e"]:
    """The energy of each polynomial piece with these Bézier points, on an element with these physical sides."""
    total = jnp.zeros(len(points), points.dtype)
    for order_s, order_t, factor in ((2, 0, 1), (1, 1, 2), (0, 2, 1)):
        gram_s, gram_t = (np.asarray(gram(order)).tolist() for order in (order_s, order_t))
        half = [sum(gram_s[a][c] * points[:, c] for c in range(4)) for a in range(4)]
        full = [[sum(gram_t[b][f] * half[a][:, f] for f in range(4)) for b in range(4)] for a in range(4)]
        pieces = sum(jnp.sum(full[a][b] * points[:, a, b], axis=-1) for a in range(4) for b in range(4))
        total += factor * pieces * sides[:, 0] ** (1 - 2 * order_s) * sides[:, 1] ** (1 - 2 * order_t)
    return total


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
