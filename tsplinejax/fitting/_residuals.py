"""Residuals at the samples, block by block: what the loop marks by and what the result reports."""

from dataclasses import dataclass
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..space import Blocks, ElementTables, SortedSamples, SplineSpace, bernstein
from ..surface import bezier_points
from ._moments import TileSamples, gather_pieces, gather_tile


class BlockResiduals(eqx.Module):
    """Residuals v - f of a tile (blocks, 16, d); per block their largest norm and their sums of squares."""

    residuals: Float[Array, "blocks 16 d"]
    largest: Float[Array, " blocks"]
    weighted: Float[Array, " blocks"]
    plain: Float[Array, " blocks"]


@jax.jit
def _tile_residuals(local: TileSamples, pieces: Float[Array, "blocks 4 4 d"]) -> BlockResiduals:
    """Residuals of one tile; `pieces` may carry Σb as a last component, which then divides."""
    d = local.values.shape[-1]
    values = jnp.einsum("tla,tlb,tabd->tld", bernstein(local.u), bernstein(local.v), pieces, precision="highest")
    if pieces.shape[-1] > d:
        values = values[..., :d] / values[..., d:]
    residuals = local.values - values
    squares = jnp.where(local.weights > 0, jnp.sum(residuals**2, axis=-1), 0)
    largest = jnp.sqrt(jnp.max(squares, axis=1))
    return BlockResiduals(residuals, largest, jnp.sum(local.weights * squares, axis=1), jnp.sum(squares, axis=1))


def homogeneous_points(space: SplineSpace, coefficients: Array) -> Float[Array, "capacity 4 4 d"]:
    """Bézier points, with Σb as a last component where the surface is rational."""
    return _points(space.tables, coefficients, space.rational)


@partial(jax.jit, static_argnums=2)
def _points(tables: ElementTables, coefficients: Array, rational: bool) -> Array:
    """Bézier points of the coefficients, and of ones where the surface is rational."""
    if rational:
        coefficients = jnp.concatenate([coefficients, jnp.ones_like(coefficients[:, :1])], axis=1)
    return bezier_points(tables, coefficients)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of all samples.

    **Attributes:**

    - `largest`, `weighted`, `plain`: per block, the largest norm and the sums of squares with and without weights, of
      the samples that count (host arrays).
    - `tiles`, `counts`: every residual, still on the device, and the number of samples of each block.
    """

    largest: np.ndarray
    weighted: np.ndarray
    plain: np.ndarray
    tiles: tuple[Array, ...]
    counts: np.ndarray

    def values(self) -> Float[np.ndarray, "m d"]:
        """Residuals in sorted order, those of outliers included."""
        values = np.concatenate([np.asarray(tile) for tile in self.tiles])[: len(self.counts)]
        return values[np.arange(values.shape[1]) < self.counts[:, None]]


def residuals(
    space: SplineSpace, points: Float[Array, "capacity 4 4 d"], samples: SortedSamples, blocks: Blocks, tile_length: int
) -> Residuals:
    """Residuals of the samples in these blocks; `points` come from `homogeneous_points`."""
    parts = []
    for tile in blocks.tiles(tile_length):
        local = gather_tile(samples, tile, space.tables.corner, space.tables.size)
        parts.append(_tile_residuals(local, gather_pieces(points, tile)))
    n = len(blocks.start)
    host = jax.device_get([(part.largest, part.weighted, part.plain) for part in parts])
    largest, weighted, plain = (np.concatenate(column)[:n] for column in zip(*host, strict=True))
    return Residuals(largest, weighted, plain, tuple(part.residuals for part in parts), blocks.count)
