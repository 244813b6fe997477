"""Residuals at the samples, block by block: what the loop marks by and what the result reports."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..space import Blocks, ElementTables, SortedSamples, SplineSpace, Tile, bernstein
from ..surface import bezier_points
from ._moments import gather_tile


class BlockResiduals(eqx.Module):
    """Residuals v - f of a tile: `residuals` (blocks, 16, d), their largest norm and weighted sum of squares."""

    residuals: Float[Array, "blocks 16 d"]
    largest: Float[Array, " blocks"]
    squares: Float[Array, " blocks"]


@jax.jit
def _tile_residuals(points: Array, samples: SortedSamples, tile: Tile, corner: Array, size: Array) -> BlockResiduals:
    """Residuals of one tile; `points` may carry Σb as a last component, which then divides."""
    local = gather_tile(samples, tile, corner, size)
    d = local.values.shape[-1]
    values = jnp.einsum(
        "tla,tlb,tabd->tld", bernstein(local.u), bernstein(local.v), points[tile.element], precision="highest"
    )
    if points.shape[-1] > d:
        values = values[..., :d] / values[..., d:]
    counted = local.weights > 0
    residuals = jnp.where(counted[..., None], local.values - values, 0)
    squares = jnp.sum(residuals**2, axis=-1)
    return BlockResiduals(residuals, jnp.sqrt(jnp.max(squares, axis=1)), jnp.sum(local.weights * squares, axis=1))


def homogeneous_points(space: SplineSpace, coefficients: Array) -> Float[Array, "capacity 4 4 d"]:
    """Bézier points, with Σb as a last component where the surface is rational."""
    return _points(space.tables, coefficients, space.rational)


@partial(jax.jit, static_argnums=2)
def _points(tables: ElementTables, coefficients: Array, rational: bool) -> Array:
    """Bézier points of the coefficients, and of ones where the surface is rational."""
    if rational:
        coefficients = jnp.concatenate([coefficients, jnp.ones_like(coefficients[:, :1])], axis=1)
    return bezier_points(tables, coefficients)


class Residuals(eqx.Module):
    """Residuals of all samples, in sorted order (m, d), and per block `largest` and weighted `squares`."""

    values: np.ndarray
    largest: np.ndarray
    squares: np.ndarray


def residuals(
    space: SplineSpace, coefficients: Array, samples: SortedSamples, blocks: Blocks, tile_length: int
) -> Residuals:
    """Residuals of the samples in these blocks (host arrays)."""
    points = homogeneous_points(space, coefficients)
    tiles = [_tile_residuals(points, samples, tile, space.tables.corner, space.tables.size) for tile in blocks.tiles(tile_length)]
    n = len(blocks.start)
    columns = [np.concatenate([np.asarray(getattr(t, name)) for t in tiles])[:n] for name in ("largest", "squares")]
    values = np.concatenate([np.asarray(tile.residuals) for tile in tiles])[:n]
    real = np.arange(values.shape[1]) < blocks.count[:, None]
    return Residuals(values[real], *columns)
