"""Moments: all that least squares needs to know of the samples in a Bézier element.

A product of two cubic Bernstein polynomials is a multiple of one of degree six, so the normal matrix of an element
follows from 7 × 7 numbers, Σ_j w_j B⁶_a(u_j) B⁶_b(v_j), and its right-hand side from 4 × 4 × d, Σ_j w_j B³_a(u_j)
B³_b(v_j) v_j.

For rational surfaces, Σ_j w_j |v_j - b P / Σb|² is the polynomial problem with weights w_j / (Σb)² and values v_j Σb.
"""

from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..space import to_device
from ._samples import AbstractSamples, Blocks
from ._tiles import AbstractTile


class Moments(eqx.Module):
    """Moments of the samples of every Bézier element: `mass` (capacity, 7, 7), `load` (capacity, 4, 4, d)."""

    mass: Float[Array, "capacity 7 7"]
    load: Float[Array, "capacity 4 4 d"]


@dataclass(frozen=True, eq=False)
class Counts:
    """How many samples of a weight above zero each chosen element holds, and the sum of their noise variances."""

    samples: Float[np.ndarray, " chosen"]
    variance: Float[np.ndarray, " chosen"]


def empty_moments(capacity: int, dimension: int, dtype: np.dtype) -> Moments:
    """Moments of no samples."""
    shapes = ((capacity, 7, 7), (capacity, 4, 4, dimension))
    return Moments(*(to_device(np.zeros(shape, dtype)) for shape in shapes))


def add_samples(
    moments: Moments,
    samples: AbstractSamples,
    blocks: Blocks,
    boxes: Array,
    lattice: Array,
    n_chosen: int,
    sums: Float[Array, "capacity 4 4 1"] | None = None,
) -> tuple[Moments, Counts]:
    """Add the samples of these blocks of `n_chosen` elements to the moments, whose arrays are used up.

    `sums` holds the Bézier points of Σb where the surface is rational.
    """
    parts = []
    for tile, slot in samples.tiles(blocks, boxes, lattice):
        part, counts = _tile_moments(tile, None if sums is None else gather_pieces(sums, slot))
        moments = _add_blocks(moments, part, slot)
        parts.append(counts)
    n = len(blocks.slot)
    host = jax.device_get(parts)
    columns = [np.concatenate(column)[:n] for column in zip(*host, strict=True)] if host else [np.zeros(0)] * 2
    return moments, Counts(*(blocks.reduce(np.add, column.astype(np.float64), n_chosen) for column in columns))


@jax.jit
def _tile_moments(tile: AbstractTile, sums: Array | None) -> tuple[Moments, tuple[Array, Array]]:
    """Moments, counts and variances of every block of a tile.

    Shapes are the tile's, whatever the mesh: the larger kernels compile once.
    """
    weights, values = tile.weights, tile.values
    if sums is not None:
        total = jnp.where(weights > 0, tile.evaluate(sums)[..., 0], 1)
        weights, values = weights / total**2, values * total[..., None]
    variance = jnp.zeros_like(weights) if tile.variance is None else tile.variance
    real = tile.weights > 0
    counts = (jnp.sum(real, axis=1).astype(jnp.int32), jnp.sum(jnp.where(real, variance, 0), axis=1))
    return Moments(*tile.sums(weights, values)), counts


@jax.jit
def gather_pieces(points: Float[Array, "capacity 4 4 c"], slot: Array) -> Float[Array, "blocks 4 4 c"]:
    """Bézier points of the elements of a tile's blocks."""
    return points[slot]


@partial(jax.jit, donate_argnums=0)
def _add_blocks(moments: Moments, blocks: Moments, slot: Array) -> Moments:
    """Add the moments of blocks to those of their elements."""
    return Moments(moments.mass.at[slot].add(blocks.mass), moments.load.at[slot].add(blocks.load))
