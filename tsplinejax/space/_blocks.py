"""Samples in blocks: every block holds at most sixteen samples of one Bézier element.

Samples are sorted once, by the Z-order code of their index cell. An element's samples then stay one contiguous range at
every refinement, and a step only needs the ranges' ends. Ranges are cut into blocks of fixed length, and blocks are
handed to the device in tiles of a fixed number, so kernels never see a new shape.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Array, Float, Int

from ..mesh import DEPTH, TMesh

BLOCK = 16


class SortedSamples(eqx.Module):
    """Samples on the device, in the order of their codes, with one block of padding of weight zero at the end."""

    parameters: Float[Array, "padded 2"]
    values: Float[Array, "padded d"]
    weights: Float[Array, " padded"]


@dataclass(frozen=True, eq=False)
class Order:
    """The samples' sorted codes (on the host) and the permutation that sorted them."""

    codes: Int[np.ndarray, " m"]
    permutation: Int[np.ndarray, " m"]


class Tile(eqx.Module):
    """A fixed number of blocks: first sample, number of samples (zero where padded), and element of each."""

    start: Int[Array, " blocks"]
    count: Int[Array, " blocks"]
    element: Int[Array, " blocks"]


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of the samples of some elements, in the order of the samples."""

    start: Int[np.ndarray, " blocks"]
    count: Int[np.ndarray, " blocks"]
    element: Int[np.ndarray, " blocks"]

    def tiles(self, length: int) -> Iterator[Tile]:
        """The blocks in tiles of a fixed number, the last one padded."""
        for first in range(0, len(self.start), length):
            rows = [part[first : first + length] for part in (self.start, self.count, self.element)]
            padded = [np.concatenate([row, np.zeros(length - len(row), np.int32)]) for row in rows]
            yield Tile(*jax.device_put(padded))


def sort_samples(tmesh: TMesh, parameters: Float[np.ndarray, "m 2"]) -> Order:
    """Sort samples by the codes of a dyadic forest; valid for every refinement of it."""
    assert tmesh.forest is not None
    scale = np.array(tmesh.forest.lattice) << DEPTH
    cells = np.clip((parameters * scale).astype(np.int64), 0, scale - 1)
    codes = tmesh.forest.code(cells[:, 0], cells[:, 1])
    permutation = np.argsort(codes, kind="stable")
    return Order(codes[permutation], permutation)


def sample_ranges(order: Order, codes: np.ndarray) -> np.ndarray:
    """First sample of each cell of a sorted forest and, last, the number of samples: (cells + 1,)."""
    return np.append(np.searchsorted(order.codes, codes), len(order.codes))


def make_blocks(ranges: Int[np.ndarray, " cells_1"], elements: Int[np.ndarray, " chosen"]) -> Blocks:
    """Cut the sample ranges of the chosen elements into blocks."""
    first, counts = ranges[elements], ranges[elements + 1] - ranges[elements]
    blocks = -(-counts // BLOCK)
    owner = np.repeat(np.arange(len(elements)), blocks)
    place = np.arange(len(owner)) - np.repeat(np.cumsum(blocks) - blocks, blocks)
    start = first[owner] + place * BLOCK
    count = np.minimum(counts[owner] - place * BLOCK, BLOCK)
    return Blocks(start.astype(np.int32), count.astype(np.int32), elements[owner].astype(np.int32))
