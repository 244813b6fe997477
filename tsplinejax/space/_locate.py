"""From parameters to Bézier elements, on the device.

On a dyadic forest: integer arithmetic gives the lattice square and the Z-order code inside it (32 bits), and a binary
search among that square's sorted codes gives the Bézier element. On a mesh given by hand: a table of its index cells.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from ..mesh import DEPTH, TMesh
from ._extraction import BezierElements


class AbstractLocator(eqx.Module):
    """Finds the Bézier element that holds a parameter."""

    @abstractmethod
    def __call__(self, parameters: Float[Array, "m 2"]) -> Int[Array, " m"]:
        """Index of the Bézier element of each parameter; the domain's far ends belong to the last elements."""


class ForestLocator(AbstractLocator):
    """Binary search in the sorted codes of one lattice square."""

    ranges: Int[Array, "capacity 2"]
    codes: UInt32[Array, " capacity"]
    lattice: Int[Array, " 2"]
    s_first: bool = eqx.field(static=True)

    def __call__(self, parameters: Float[Array, "m 2"]) -> Int[Array, " m"]:
        scaled = parameters * (self.lattice << DEPTH).astype(parameters.dtype)
        cell = jnp.clip(scaled.astype(jnp.int32), 0, (self.lattice << DEPTH) - 1)
        square = (cell[:, 0] >> DEPTH) * self.lattice[1] + (cell[:, 1] >> DEPTH)
        s, t = _spread(cell[:, 0]), _spread(cell[:, 1])
        code = (s << 1) | t if self.s_first else (t << 1) | s

        def halve(_: int, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = bounds
            middle = (low + high) >> 1
            right = self.codes[middle] <= code
            return jnp.where(right, middle, low), jnp.where(right, high, middle)

        steps = self.codes.shape[0].bit_length()
        low, high = self.ranges[square, 0], self.ranges[square, 1]
        low, _ = jax.lax.fori_loop(0, steps, halve, (low, high))
        return low


class TableLocator(AbstractLocator):
    """A table of the index cells between the knot lines of a mesh given by hand."""

    lines: tuple[Float[Array, " columns"], Float[Array, " rows"]]

    def __call__(self, parameters: Float[Array, "m 2"]) -> Int[Array, " m"]:
        x, y = (
            jnp.clip(jnp.searchsorted(knots, parameters[:, k], side="right") - 1, 0, len(knots) - 2)
            for k, knots in enumerate(self.lines)
        )
        return x * (len(self.lines[1]) - 1) + y


def _spread(coordinate: Int[Array, " m"]) -> UInt32[Array, " m"]:
    """The lower 16 bits with a zero between any two."""
    bits = coordinate.astype(jnp.uint32) & 0xFFFF
    for shift, mask in ((8, 0x00FF00FF), (4, 0x0F0F0F0F), (2, 0x33333333), (1, 0x55555555)):
        bits = (bits | (bits << shift)) & jnp.uint32(mask)
    return bits


def make_locator(tmesh: TMesh, elements: BezierElements, capacity: int, dtype: np.dtype) -> AbstractLocator:
    """The locator of a T-mesh's Bézier elements."""
    if tmesh.forest is None:
        assert tmesh.lines is not None
        s, t = (jax.device_put(np.asarray(knots, dtype)) for knots in tmesh.lines)
        return TableLocator((s, t))
    forest = tmesh.forest
    assert elements.codes is not None
    columns, rows = forest.lattice
    x, y = (grid.ravel() << DEPTH for grid in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
    first = forest.code(x, y)
    size = 1 << (2 * DEPTH)
    # Squares are padded, too: one compiled search serves every lattice of a capacity.
    ranges = np.zeros((capacity, 2), np.int32)
    ranges[: len(first), 0] = np.searchsorted(elements.codes, first)
    ranges[: len(first), 1] = np.searchsorted(elements.codes, first + size)
    codes = np.full(capacity, size - 1, np.uint32)
    codes[: len(elements)] = elements.codes & (size - 1)
    return ForestLocator(
        jax.device_put(ranges),
        jax.device_put(codes),
        jax.device_put(np.asarray(forest.lattice, np.int32)),
        forest.first_cut == "s",
    )
