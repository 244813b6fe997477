"""Moments: all that least squares needs to know of the samples in a Bézier element.

A product of two cubic Bernstein polynomials is a multiple of one of degree six, so the normal matrix of an element
follows from 7 × 7 numbers, Σ_j w_j B⁶_a(u_j) B⁶_b(v_j), and its right-hand side from 4 × 4 × d, Σ_j w_j B³_a(u_j)
B³_b(v_j) v_j.

For rational surfaces, Σ_j w_j |v_j - b P / Σb|² is the polynomial problem with weights w_j / (Σb)² and values v_j Σb.
"""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..space import BLOCK, Blocks, ElementTables, SortedSamples, SplineSpace, Tile, bernstein, bernstein6


class Moments(eqx.Module):
    """Moments of the samples of every Bézier element: `mass` (capacity, 7, 7), `load` (capacity, 4, 4, d)."""

    mass: Float[Array, "capacity 7 7"]
    load: Float[Array, "capacity 4 4 d"]


class TileSamples(eqx.Module):
    """The samples of one tile of blocks, in local coordinates of their elements; padding has weight zero."""

    u: Float[Array, "blocks 16"]
    v: Float[Array, "blocks 16"]
    values: Float[Array, "blocks 16 d"]
    weights: Float[Array, "blocks 16"]


@jax.jit
def gather_tile(samples: SortedSamples, tile: Tile, corner: Array, size: Array) -> TileSamples:
    """Fetch a tile's samples."""
    index = tile.start[:, None] + jnp.arange(BLOCK)
    real = jnp.arange(BLOCK) < tile.count[:, None]
    local = (samples.parameters[index] - corner[tile.element][:, None]) / size[tile.element][:, None]
    local = jnp.where(real[..., None], local, 0)
    weights = jnp.where(real, samples.weights[index], 0)
    return TileSamples(local[..., 0], local[..., 1], samples.values[index], weights)


@jax.jit
def gather_pieces(points: Float[Array, "capacity 4 4 d"], tile: Tile) -> Float[Array, "blocks 4 4 d"]:
    """Bézier points of the elements of a tile's blocks."""
    return points[tile.element]


@jax.jit
def _tile_moments(local: TileSamples, sums: Array | None) -> Moments:
    """Moments of every block of a tile; `sums` holds the Bézier points of Σb where the surface is rational.

    Its shape is the tile's, whatever the mesh: the larger kernels compile once.
    """
    weights, values = local.weights, local.values
    cubic_s, cubic_t = bernstein(local.u), bernstein(local.v)
    if sums is not None:
        total = jnp.einsum("tla,tlb,tab->tl", cubic_s, cubic_t, sums[..., 0])
        weights, values = weights / total**2, values * total[..., None]
    mass = jnp.einsum(
        "tla,tlb->tab", bernstein6(local.u) * weights[..., None], bernstein6(local.v), precision="highest"
    )
    weighted = values * weights[..., None]
    load = jnp.einsum("tlad,tlb->tabd", cubic_s[..., None] * weighted[:, :, None], cubic_t, precision="highest")
    return Moments(mass, load)


@partial(jax.jit, donate_argnums=0)
def _add_blocks(moments: Moments, blocks: Moments, element: Array) -> Moments:
    """Add the moments of blocks to those of their elements."""
    return Moments(moments.mass.at[element].add(blocks.mass), moments.load.at[element].add(blocks.load))


def empty_moments(space: SplineSpace, dimension: int) -> Moments:
    """Moments of no samples."""
    capacity = space.capacity
    return Moments(jnp.zeros((capacity, 7, 7), space.dtype), jnp.zeros((capacity, 4, 4, dimension), space.dtype))


@jax.jit
def inherit_moments(moments: Moments, source: Array) -> Moments:
    """Moments moved to a new numbering: those of the old element `source`, or none where it is negative."""
    known = (source >= 0)[:, None, None]
    source = jnp.maximum(source, 0)
    return Moments(jnp.where(known, moments.mass[source], 0), jnp.where(known[..., None], moments.load[source], 0))


def add_samples(
    moments: Moments, space: SplineSpace, samples: SortedSamples, blocks: Blocks, tile_length: int
) -> Moments:
    """Add the samples of these blocks to the moments."""
    sums = sum_points(space.tables)[..., None] if space.rational else None
    for tile in blocks.tiles(tile_length):
        local = gather_tile(samples, tile, space.tables.corner, space.tables.size)
        part = _tile_moments(local, None if sums is None else gather_pieces(sums, tile))
        moments = _add_blocks(moments, part, tile.element)
    return moments


@jax.jit
def sum_points(tables: ElementTables) -> Float[Array, "capacity 4 4"]:
    """Bézier points of the sum of the blending functions."""
    return jnp.einsum("eka,ekb->eab", tables.along_s, tables.along_t, precision="highest")
