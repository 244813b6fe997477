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
from jax import lax
from jaxtyping import Array, Float, Int

from ..space import to_device
from ._discretisation import Discretisation
from ._samples import AbstractSamples, Blocks, batches
from ._tiles import AbstractDeviceSamples, AbstractTile, BlockList, over_tiles


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
    mesh: Discretisation,
    chosen: Int[np.ndarray, " chosen"],
    boxes: Array,
    lattice: Array,
    sums: Float[Array, "capacity 4 4 1"] | None = None,
) -> tuple[Moments, Counts]:
    """Add the samples of the chosen Bézier elements to the moments, whose arrays are used up.

    `sums` holds the Bézier points of Σb where the surface is rational.
    """
    counts = Counts(np.zeros(len(chosen)), np.zeros(len(chosen)))
    for device, blocks in samples.parts(mesh.elements, chosen, mesh.slots[chosen]):
        moments = add_blocks(moments, counts, device, blocks, samples.tile, boxes, lattice, sums)
    return moments, counts


def add_blocks(
    moments: Moments,
    counts: Counts,
    device: AbstractDeviceSamples,
    blocks: Blocks,
    tile: int,
    boxes: Array,
    lattice: Array,
    sums: Float[Array, "capacity 4 4 1"] | None = None,
) -> Moments:
    """Add one part's blocks to the moments, whose arrays are used up, and to the counts, in place."""
    results = []
    for listed, places in batches(blocks, tile):
        moments, result = _add_batch(moments, device, listed, boxes, lattice, sums)
        results.append((places, result))
    for column, total in zip(on_host(results, len(blocks.slot)), (counts.samples, counts.variance), strict=False):
        blocks.reduce(np.add, column, total)
    return moments


def on_host(results: list[tuple[slice, tuple[Array, ...]]], n: int) -> list[np.ndarray]:
    """Numbers a block, brought to the host: columns of n."""
    columns: list[np.ndarray] = []
    for places, result in results:
        for k, values in enumerate(jax.device_get(result)):
            if k == len(columns):
                columns.append(np.zeros(n))
            columns[k][places] = values[: places.stop - places.start]
    return columns


@partial(jax.jit, donate_argnums=0)
def _add_batch(
    moments: Moments,
    samples: AbstractDeviceSamples,
    listed: BlockList,
    boxes: Array,
    lattice: Array,
    sums: Float[Array, "capacity 4 4 1"] | None,
) -> tuple[Moments, tuple[Array, Array]]:
    """Moments with those of the listed blocks added, and the blocks' counts and variances."""
    dtype = moments.mass.dtype

    def turn(tile: AbstractTile, slot: Array, first: Array, carry: tuple[Moments, Array, Array]):
        total, counts, variances = carry
        weights, values = tile.weights, tile.values
        if sums is not None:
            divisor = jnp.where(weights > 0, tile.evaluate(sums[slot])[..., 0], 1)
            weights, values = weights / divisor**2, values * divisor[..., None]
        mass, load = tile.sums(weights, values)
        variance = jnp.zeros_like(weights) if tile.variance is None else tile.variance
        real = tile.weights > 0
        counts = lax.dynamic_update_slice_in_dim(counts, jnp.sum(real, axis=1, dtype=dtype), first, 0)
        summed = jnp.sum(jnp.where(real, variance, 0), axis=1)
        variances = lax.dynamic_update_slice_in_dim(variances, summed, first, 0)
        return Moments(total.mass.at[slot].add(mass), total.load.at[slot].add(load)), counts, variances

    zeros = jnp.zeros(len(listed.slot), dtype)
    moments, counts, variances = over_tiles(samples, listed, boxes, lattice, turn, (moments, zeros, zeros))
    return moments, (counts, variances)
