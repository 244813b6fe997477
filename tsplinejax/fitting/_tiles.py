"""Tiles: samples on their way through the device, sixteen lanes a block, each block inside one Bézier element.

Kernels over samples receive lists of blocks of a fixed length and run over them tile by tile, as many as there are, so
that they compile once. Sums over the lanes are written out: small products that a compiler fuses, where batched matrix
products of this size run slowly.
"""

import operator
from abc import abstractmethod
from collections.abc import Callable, Iterable
from functools import reduce
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..mesh import DEPTH
from ..space import bernstein, bernstein6

SIDE = 4  # pixels along a side of a grid's block
LANES = SIDE * SIDE

Carry = TypeVar("Carry")

barrier = jax.lax.optimization_barrier


def add_up(terms: Iterable[Array]) -> Array:
    """The sum of a few arrays, written out."""
    return reduce(operator.add, terms)


class AbstractTile(eqx.Module):
    """Samples of a fixed number of blocks in local coordinates of their elements; padding has weight zero."""

    values: eqx.AbstractVar[Float[Array, "blocks 16 d"]]
    weights: eqx.AbstractVar[Float[Array, "blocks 16"]]
    variance: eqx.AbstractVar[Float[Array, "blocks 16"] | None]

    @abstractmethod
    def places(self) -> tuple[Float[Array, "blocks 16"], Float[Array, "blocks 16"]]:
        """Local coordinates (u, v) of every lane."""

    @abstractmethod
    def sums(self, weights: Array, values: Array) -> tuple[Float[Array, "blocks 7 7"], Float[Array, "blocks 4 4 d"]]:
        """Σ w B⁶ B⁶ and Σ w B³ B³ v over the lanes of each block."""

    def evaluate(self, pieces: Float[Array, "blocks 4 4 c"]) -> Float[Array, "blocks 16 c"]:
        """Polynomials with these Bézier points at every lane."""
        u, v = self.places()
        along_s, along_t = bernstein(u), bernstein(v)
        columns = []
        for c in range(pieces.shape[-1]):
            total = jnp.zeros_like(u)
            for a in range(4):
                inner = add_up(along_t[..., b] * pieces[:, a, b, c, None] for b in range(4))
                total = total + along_s[..., a] * inner
            columns.append(total)
        return jnp.stack(columns, axis=-1)


class PointTile(AbstractTile):
    """Sixteen consecutive scattered samples a block."""

    u: Float[Array, "blocks 16"]
    v: Float[Array, "blocks 16"]
    values: Float[Array, "blocks 16 d"]
    weights: Float[Array, "blocks 16"]
    variance: Float[Array, "blocks 16"] | None

    def places(self) -> tuple[Array, Array]:
        """Local coordinates of every lane."""
        return self.u, self.v

    def sums(self, weights: Array, values: Array) -> tuple[Array, Array]:
        """Small matrix products, one a block."""
        six_s = jnp.moveaxis(bernstein6(self.u) * weights[..., None], 1, 2)
        mass = jnp.matmul(six_s, bernstein6(self.v), precision="highest")
        cubic_s, cubic_t = jnp.moveaxis(bernstein(self.u), 1, 2), bernstein(self.v)
        loads = [
            jnp.matmul(cubic_s * (weights * values[..., c])[:, None], cubic_t, precision="highest")
            for c in range(values.shape[-1])
        ]
        return mass, jnp.stack(loads, axis=-1)


class PixelTile(AbstractTile):
    """Squares of 4 × 4 pixels: `u` of their columns, `v` of their rows; lanes run along the rows."""

    u: Float[Array, "blocks 4"]
    v: Float[Array, "blocks 4"]
    values: Float[Array, "blocks 16 d"]
    weights: Float[Array, "blocks 16"]
    variance: Float[Array, "blocks 16"] | None

    def places(self) -> tuple[Array, Array]:
        """Local coordinates of every lane."""
        return jnp.tile(self.u, (1, SIDE)), jnp.repeat(self.v, SIDE, axis=1)

    def sums(self, weights: Array, values: Array) -> tuple[Array, Array]:
        """First along the rows, then along the columns."""
        six_s, six_t = (jnp.moveaxis(bernstein6(x), 1, 2) for x in (self.u, self.v))
        cubic_s, cubic_t = (jnp.moveaxis(bernstein(x), 1, 2) for x in (self.u, self.v))
        grid = weights.reshape(-1, SIDE, SIDE)
        loads = [
            _separable(cubic_s, cubic_t, grid * values[..., c].reshape(grid.shape)) for c in range(values.shape[-1])
        ]
        return _separable(six_s, six_t, grid), jnp.stack(loads, axis=-1)


def _separable(
    along_s: Float[Array, "blocks p 4"], along_t: Float[Array, "blocks p 4"], grid: Float[Array, "blocks 4 4"]
) -> Float[Array, "blocks p p"]:
    """Σ over rows i and columns j of along_s[a, j] along_t[b, i] grid[i, j], as plain sums of products."""
    along_s, along_t, grid = barrier((along_s, along_t, grid))
    rows = barrier(add_up(along_s[:, :, j, None] * grid[:, None, :, j] for j in range(SIDE)))  # (blocks, a, i)
    return add_up(rows[:, :, i, None] * along_t[:, None, :, i] for i in range(SIDE))


class AbstractDeviceSamples(eqx.Module):
    """Values, weights and noise variances (times weights) on the device, padded; `None` stands for all one, or none."""

    values: eqx.AbstractVar[Float[Array, "padded d"]]
    weights: eqx.AbstractVar[Float[Array, " padded"] | None]
    variance: eqx.AbstractVar[Float[Array, " padded"] | None]

    @abstractmethod
    def tile(
        self, fields: Int[Array, "blocks 4"], slot: Int[Array, " blocks"], boxes: Array, lattice: Array
    ) -> AbstractTile:
        """The samples of these blocks, whose elements' index boxes are `boxes[slot]` over a lattice of squares."""

    def lanes(self, index: Array, real: Array) -> tuple[Array, Array, Array | None]:
        """Values, weights (zero where not real) and variances at these places."""
        weights = real.astype(self.values.dtype)
        if self.weights is not None:
            weights = jnp.where(real, self.weights[index], 0)
        variance = None if self.variance is None else jnp.where(real, self.variance[index], 0)
        return self.values[index], weights, variance


class DevicePoints(AbstractDeviceSamples):
    """Scattered samples; a block's fields are its first sample and their number."""

    parameters: Float[Array, "padded 2"]
    values: Float[Array, "padded d"]
    weights: Float[Array, " padded"] | None
    variance: Float[Array, " padded"] | None

    def tile(self, fields: Array, slot: Array, boxes: Array, lattice: Array) -> PointTile:
        """Runs of samples."""
        lanes = jnp.arange(LANES)
        index, real = fields[:, 0, None] + lanes, lanes < fields[:, 1, None]
        places = self.parameters[index]
        u, v = (jnp.where(real, _local(places[..., k], slot, boxes, lattice, k), 0) for k in range(2))
        values, weights, variance = self.lanes(index, real)
        return PointTile(u=u, v=v, values=values, weights=weights, variance=variance)


class DevicePixels(AbstractDeviceSamples):
    """Pixels; a block's fields are its first column and row, and their numbers.

    `shape` is that of the whole map (columns, rows), `origin` the first column and row that are here, and `stride` the
    number of columns that are.
    """

    shape: Int[Array, " 2"]
    origin: Int[Array, " 2"]
    stride: Int[Array, ""]
    values: Float[Array, "padded d"]
    weights: Float[Array, " padded"] | None
    variance: Float[Array, " padded"] | None

    def tile(self, fields: Array, slot: Array, boxes: Array, lattice: Array) -> PixelTile:
        """Squares of pixels; lanes beyond a square's edge repeat its last one."""
        lanes = jnp.arange(SIDE)
        sizes = [jnp.maximum(fields[:, k + 2, None] - 1, 0) for k in (0, 1)]
        column, row = (fields[:, k, None] + jnp.clip(lanes, 0, size) for k, size in enumerate(sizes))
        inside = (lanes < fields[:, 3, None])[:, :, None] & (lanes < fields[:, 2, None])[:, None]
        index = (row - self.origin[1])[:, :, None] * self.stride + (column - self.origin[0])[:, None]
        last = jnp.maximum(self.shape - 1, 1).astype(self.values.dtype)
        u, v = (
            _local(place.astype(self.values.dtype) / last[k], slot, boxes, lattice, k)
            for k, place in enumerate((column, row))
        )
        values, weights, variance = self.lanes(index.reshape(-1, LANES), inside.reshape(-1, LANES))
        return PixelTile(u=u, v=v, values=values, weights=weights, variance=variance)


def _local(places: Array, slot: Array, boxes: Array, lattice: Array, axis: int) -> Array:
    """Parameters in the coordinates of their blocks' elements."""
    scale = (lattice[axis] << DEPTH).astype(places.dtype)
    low = boxes[slot, axis].astype(places.dtype) / scale
    size = (boxes[slot, axis + 2] - boxes[slot, axis]).astype(places.dtype) / scale
    return (places - low[:, None]) / jnp.where(size > 0, size, 1)[:, None]


class BlockList(eqx.Module):
    """Blocks on the device: fields and element slots, padded, and how many are real; kernels take `tile` at a time."""

    fields: Int[Array, "padded 4"]
    slot: Int[Array, " padded"]
    count: Int[Array, ""]
    tile: int = eqx.field(static=True)


def in_turns(count: Array, length: int, turn: Callable[[Array, Carry], Carry], carry: Carry) -> Carry:
    """Run `turn(first, carry)` for first = 0, `length`, ... below a count that is known only on the device."""
    return jax.lax.fori_loop(0, (count + length - 1) // length, lambda k, carry: turn(k * length, carry), carry)


def over_tiles(
    samples: AbstractDeviceSamples,
    listed: BlockList,
    boxes: Array,
    lattice: Array,
    turn: Callable[[AbstractTile, Array, Array, Carry], Carry],
    carry: Carry,
) -> Carry:
    """Run `turn(tile, slot, first, carry)` over the listed blocks; `first` is the place of the tile's first block."""

    def body(first: Array, carry: Carry) -> Carry:
        fields, slot = (jax.lax.dynamic_slice_in_dim(part, first, listed.tile) for part in (listed.fields, listed.slot))
        return turn(samples.tile(fields, slot, boxes, lattice), slot, first, carry)

    return in_turns(listed.count, listed.tile, body, carry)
