"""Residuals at the samples, block by block: what the loop marks by and what the result reports."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._moments import gather_pieces
from ._samples import AbstractSamples, Blocks
from ._tiles import AbstractTile


class TileResiduals(eqx.Module):
    """Residuals v - f of a tile; per block their largest norm and their sums of squares, with weights and without."""

    residuals: Float[Array, "blocks 16 d"]
    largest: Float[Array, " blocks"]
    weighted: Float[Array, " blocks"]
    plain: Float[Array, " blocks"]


@jax.jit
def _tile_residuals(tile: AbstractTile, pieces: Float[Array, "blocks 4 4 c"]) -> TileResiduals:
    """Residuals of one tile; `pieces` may carry Σb as a last component, which then divides."""
    d = tile.values.shape[-1]
    values = tile.evaluate(pieces)
    if pieces.shape[-1] > d:
        values = values[..., :d] / values[..., d:]
    residuals = tile.values - values
    squares = jnp.where(tile.weights > 0, jnp.sum(residuals**2, axis=-1), 0)
    largest = jnp.sqrt(jnp.max(squares, axis=1))
    return TileResiduals(residuals, largest, jnp.sum(tile.weights * squares, axis=1), jnp.sum(squares, axis=1))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Largest norm and sums of squares of the residuals of each chosen element's samples of a weight above zero."""

    largest: Float[np.ndarray, " chosen"]
    weighted: Float[np.ndarray, " chosen"]
    plain: Float[np.ndarray, " chosen"]


def residuals(
    samples: AbstractSamples,
    blocks: Blocks,
    points: Float[Array, "capacity 4 4 c"],
    boxes: Array,
    lattice: Array,
    n_chosen: int,
) -> Residuals:
    """Residuals of the samples in these blocks of `n_chosen` elements, whose Bézier points lie in `points`."""
    parts = []
    for tile, slot in samples.tiles(blocks, boxes, lattice):
        part = _tile_residuals(tile, gather_pieces(points, slot))
        parts.append((part.largest, part.weighted, part.plain))
    n = len(blocks.slot)
    host = jax.device_get(parts)
    columns = [np.concatenate(column)[:n] for column in zip(*host, strict=True)] if host else [np.zeros(0)] * 3
    operations = (np.maximum, np.add, np.add)
    return Residuals(*(blocks.reduce(f, column, n_chosen) for f, column in zip(operations, columns, strict=True)))


def all_residuals(
    samples: AbstractSamples, blocks: Blocks, points: Float[Array, "capacity 4 4 c"], boxes: Array, lattice: Array
) -> Float[np.ndarray, "m d"]:
    """The residual of every sample, in the order of the data; `blocks` are those of all elements."""
    tiles = [
        _tile_residuals(tile, gather_pieces(points, slot)).residuals
        for tile, slot in samples.tiles(blocks, boxes, lattice)
    ]
    per_lane = np.concatenate([np.asarray(tile) for tile in tiles])[: len(blocks.slot)]
    return samples.collect(blocks, per_lane)
