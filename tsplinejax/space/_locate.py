"""From parameters to Bézier elements, on the device.

On a dyadic forest: integer arithmetic gives the lattice square and the Z-order code inside it (32 bits), and a tree of
tables gives the Bézier element. The root is one table over all cells of a level K; a cell that Bézier elements cut
further points to a table of the 2^f cells that are f levels deeper, and so on. K and f are chosen so that the fewest
tables are read while their length stays a small multiple of the number of elements, however deep the finest one is.
On a mesh given by hand: a table of its index cells.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, UInt32

from ..mesh import DEPTH, TMesh
from ._extraction import BezierElements

# Bits of a code inside its lattice square, and entries of the tables for each element (at most).
BITS = 2 * DEPTH
ENTRIES = 4
WIDEST = 6


class AbstractLocator(eqx.Module):
    """Finds the Bézier element that holds a parameter."""

    @abstractmethod
    def __call__(self, parameters: Float[Array, "m 2"]) -> Int[Array, " m"]:
        """Index of the Bézier element of each parameter; the domain's far ends belong to the last elements."""


class ForestLocator(AbstractLocator):
    """A tree of tables over the codes of all lattice squares.

    **Attributes:**

    - `table`: all tables one after the other, the root first; an element's index, or minus the place of the next table.
    - `root_level`, `fan_out`, `steps`: K, f, and how many tables follow the root at most.
    - `lattice`: columns and rows of lattice squares.
    """

    table: Int[Array, " entries"]
    root_level: Int[Array, ""]
    fan_out: Int[Array, ""]
    steps: Int[Array, ""]
    lattice: Int[Array, " 2"]
    s_first: bool = eqx.field(static=True)

    def __call__(self, parameters: Float[Array, "m 2"]) -> Int[Array, " m"]:
        scaled = parameters * (self.lattice << DEPTH).astype(parameters.dtype)
        cell = jnp.clip(scaled.astype(jnp.int32), 0, (self.lattice << DEPTH) - 1)
        square = (cell[:, 0] >> DEPTH) * self.lattice[1] + (cell[:, 1] >> DEPTH)
        s, t = _spread(cell[:, 0]), _spread(cell[:, 1])
        code = (s << 1) | t if self.s_first else (t << 1) | s
        mask = (1 << self.fan_out) - 1

        def descend(step: Array, entry: Array) -> Array:
            shift = BITS - self.root_level - self.fan_out * (step + 1)
            place = ((code >> shift.astype(jnp.uint32)).astype(jnp.int32) & mask) - entry
            return jnp.where(entry < 0, self.table[jnp.where(entry < 0, place, 0)], entry)

        # Shifting by all 32 bits at once, for a root of level zero, is undefined.
        top = (code >> 1) >> (BITS - 1 - self.root_level).astype(jnp.uint32)
        root = self.table[(square << self.root_level) + top.astype(jnp.int32)]
        return jax.lax.fori_loop(0, self.steps, descend, root)


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
    assert elements.codes is not None
    assert elements.levels is not None
    columns, rows = tmesh.forest.lattice
    square = (elements.boxes[:, 0] >> DEPTH) * rows + (elements.boxes[:, 1] >> DEPTH)
    order = np.argsort(square, kind="stable")
    codes, levels = elements.codes[order] & ((1 << BITS) - 1), elements.levels[order]
    root_level, fan_out, steps = _choose(codes, levels, columns * rows)
    # One length for all meshes of a capacity: the search is compiled once.
    table = np.zeros(ENTRIES * capacity, np.int32)
    entries = _tables(order, codes, levels, root_level, fan_out)
    table[: len(entries)] = entries
    return ForestLocator(
        jax.device_put(table),
        jax.device_put(np.int32(root_level)),
        jax.device_put(np.int32(fan_out)),
        jax.device_put(np.int32(steps)),
        jax.device_put(np.asarray(tmesh.forest.lattice, np.int32)),
        tmesh.forest.first_cut == "s",
    )


def _choose(codes: np.ndarray, levels: np.ndarray, squares: int) -> tuple[int, int, int]:
    """Level of the root, fan-out and number of further tables: the fewest steps, then the fewest entries, that fit.

    A binary tree over the bare lattice has at most two entries an element, so there is always one that fits.
    """
    deepest = int(levels.max())
    cut = _cut_cells(codes, levels)
    best = (BITS, 2 * len(codes), 0, 1)
    for root_level in range(min(deepest, BITS - 1) + 1):
        for fan_out in range(1, WIDEST + 1):
            steps = -(-(deepest - root_level) // fan_out)
            places = slice(root_level, root_level + steps * fan_out, fan_out)
            entries = (squares << root_level) + (int(cut[places].sum()) << fan_out)
            if root_level + steps * fan_out <= BITS and entries <= ENTRIES * len(codes):
                best = min(best, (steps, entries, root_level, fan_out))
    steps, _, root_level, fan_out = best
    return root_level, fan_out, steps


def _cut_cells(codes: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """For each level, how many of its cells are cut further: those that begin with an element of a deeper level."""
    lowest = np.bitwise_and(codes, -codes)
    # Codes have at most 32 bits, so that float64 gives the exact place of the lowest one; zero begins every cell.
    begins = np.where(codes == 0, 0, BITS - np.log2(np.maximum(lowest, 1)).astype(np.int64))
    return np.cumsum(np.bincount(begins, minlength=BITS + 1) - np.bincount(levels, minlength=BITS + 1))


def _tables(order: np.ndarray, codes: np.ndarray, levels: np.ndarray, level: int, fan_out: int) -> np.ndarray:
    """The root and all further tables; `order` says which element each code and level belongs to."""
    tables, length = [], 0
    inside = np.arange(len(codes))
    while True:
        # An element covers its cells of this level; a cell that is cut is named by the element at its beginning.
        depth = levels[inside]
        begins = (codes[inside] & ((1 << (BITS - level)) - 1)) == 0
        named = np.repeat(inside, np.where(depth <= level, 1 << np.maximum(level - depth, 0), begins))
        cut = np.flatnonzero(levels[named] > level)
        entries = order[named]
        length += len(entries)
        entries[cut] = -(length + (np.arange(len(cut)) << fan_out))
        tables.append(entries)
        if not len(cut):
            return np.concatenate(tables)
        inside = inside[depth > level]
        level += fan_out
