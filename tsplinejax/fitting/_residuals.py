"""Residuals at the samples, block by block: what the loop marks by and what the result reports."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ._moments import gather_parts
from ._samples import AbstractSamples, Blocks
from ._tiles import LANES, AbstractDeviceSamples, AbstractTile, BlockList, over_tiles


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
    for batch in samples.batches(blocks):
        _, sums = _batch_residuals(batch.samples, batch.listed, boxes, lattice, points)
        parts.append((batch.places, sums))
    columns = gather_parts(parts, len(blocks.slot), 3)
    operations = (np.maximum, np.add, np.add)
    return Residuals(*(blocks.reduce(f, column, n_chosen) for f, column in zip(operations, columns, strict=True)))


def all_residuals(
    samples: AbstractSamples, blocks: Blocks, points: Float[Array, "capacity 4 4 c"], boxes: Array, lattice: Array
) -> Float[np.ndarray, "m d"]:
    """The residual of every sample, in the order of the data; `blocks` are those of all elements."""
    parts = [
        np.asarray(_batch_residuals(batch.samples, batch.listed, boxes, lattice, points)[0])[
            : batch.places.stop - batch.places.start
        ]
        for batch in samples.batches(blocks)
    ]
    return samples.collect(blocks, np.concatenate(parts))


@jax.jit
def _batch_residuals(
    samples: AbstractDeviceSamples,
    listed: BlockList,
    boxes: Array,
    lattice: Array,
    points: Float[Array, "capacity 4 4 c"],
) -> tuple[Float[Array, "blocks 16 d"], tuple[Array, Array, Array]]:
    """Residuals v - f of the listed blocks; per block their largest norm and sums of squares, with and without weights.

    `points` may carry Σb as a last component, which then divides.
    """

    put = lax.dynamic_update_slice_in_dim

    def turn(tile: AbstractTile, slot: Array, first: Array, carry: tuple[Array, tuple[Array, Array, Array]]):
        d = tile.values.shape[-1]
        values = tile.evaluate(points[slot])
        if points.shape[-1] > d:
            values = values[..., :d] / values[..., d:]
        residuals = tile.values - values
        squares = jnp.where(tile.weights > 0, jnp.sum(residuals**2, axis=-1), 0)
        largest = jnp.sqrt(jnp.max(squares, axis=1))
        sums = (largest, jnp.sum(tile.weights * squares, axis=1), jnp.sum(squares, axis=1))
        return jax.tree.map(lambda whole, part: put(whole, part, first, 0), carry, (residuals, sums))

    length, d = len(listed.slot), samples.values.shape[-1]
    zeros = jnp.zeros(length, points.dtype)
    empty = jnp.zeros((length, LANES, d), points.dtype)
    return over_tiles(samples, listed, boxes, lattice, turn, (empty, (zeros, zeros, zeros)))
