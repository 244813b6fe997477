"""Residuals at the samples, block by block: what the loop marks by and what the result reports."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from ._discretisation import Discretisation
from ._moments import on_host
from ._samples import AbstractHeldSamples, AbstractSamples, Blocks, batches
from ._tiles import LANES, AbstractDeviceSamples, AbstractTile, BlockList, over_tiles


@dataclass(frozen=True, eq=False)
class Residuals:
    """Largest norm and sums of squares of the residuals of each chosen element's samples of a weight above zero."""

    largest: Float[np.ndarray, " chosen"]
    weighted: Float[np.ndarray, " chosen"]
    plain: Float[np.ndarray, " chosen"]


def residuals(
    samples: AbstractSamples,
    mesh: Discretisation,
    chosen: Int[np.ndarray, " chosen"],
    points: Float[Array, "capacity 4 4 c"],
    boxes: Array,
    lattice: Array,
) -> Residuals:
    """Residuals of the samples in the chosen Bézier elements, whose Bézier points lie in `points`."""
    found = Residuals(*(np.zeros(len(chosen)) for _ in range(3)))
    for device, blocks in samples.parts(mesh.elements, chosen, mesh.slots[chosen]):
        measure_blocks(found, device, blocks, samples.tile, points, boxes, lattice)
    return found


def measure_blocks(
    found: Residuals,
    device: AbstractDeviceSamples,
    blocks: Blocks,
    tile: int,
    points: Float[Array, "capacity 4 4 c"],
    boxes: Array,
    lattice: Array,
) -> None:
    """Add the residuals of one part's blocks to what was found, in place."""
    results = [
        (places, _batch_residuals(device, listed, boxes, lattice, points)[1])
        for listed, places in batches(blocks, tile)
    ]
    columns = on_host(results, len(blocks.slot))
    totals = (found.largest, found.weighted, found.plain)
    for operation, column, total in zip((np.maximum, np.add, np.add), columns, totals, strict=False):
        blocks.reduce(operation, column, total)


def all_residuals(
    samples: AbstractHeldSamples,
    mesh: Discretisation,
    points: Float[Array, "capacity 4 4 c"],
    boxes: Array,
    lattice: Array,
) -> Float[np.ndarray, "m d"]:
    """The residual of every sample, in the order of the data."""
    blocks = samples.blocks(mesh.elements, np.arange(len(mesh.slots)), mesh.slots)
    parts = []
    for listed, places in batches(blocks, samples.tile):
        values, _ = _batch_residuals(samples.device, listed, boxes, lattice, points)
        parts.append(np.asarray(values)[: places.stop - places.start])
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
