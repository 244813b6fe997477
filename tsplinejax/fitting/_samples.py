"""Samples as the loop sees them: blocks of sixteen lanes, each block inside one Bézier element.

Two kinds of samples hand them over:

- [`ScatteredSamples`][tsplinejax.fitting._samples.ScatteredSamples] are sorted once by the Z-order code of their index
  cell; an element's samples then stay one contiguous range at every refinement, cut into runs of sixteen.
- [`GridSamples`][tsplinejax.fitting._samples.GridSamples] are the pixels of a height map. An element holds a rectangle
  of them, cut into squares of 4 × 4, so nothing is sorted, no parameters are kept, and sums are separable.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, Int

from ..mesh import DEPTH, TMesh
from ..space import BezierElements, pad, to_device
from ._tiles import LANES, SIDE, AbstractDeviceSamples, BlockList, DevicePixels, DevicePoints

TILES = 16  # in a list of blocks


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of the samples of some Bézier elements, in the order of the elements.

    **Attributes:**

    - `fields`: what finds a block's samples, (blocks, 4): first column and row, their numbers (pixels), or first sample
      and number of samples.
    - `slot`: device slot of each block's element.
    - `owner`: place of each block's element in the list of chosen elements.
    """

    fields: Int[np.ndarray, "blocks 4"]
    slot: Int[np.ndarray, " blocks"]
    owner: Int[np.ndarray, " blocks"]

    def reduce(self, operation: np.ufunc, per_block: np.ndarray, result: Float[np.ndarray, " chosen"]) -> None:
        """Reduce a number per block into one per chosen element."""
        if len(self.owner):
            first = np.flatnonzero(np.diff(self.owner, prepend=-1))
            owner = self.owner[first]
            result[owner] = operation(result[owner], operation.reduceat(per_block, first))


class AbstractSamples(ABC):
    """The samples of a fit: how many a block of which element holds, and the tiles that carry them to the device.

    **Attributes:**

    - `tile`: blocks in a tile.
    """

    tile: int

    @abstractmethod
    def parts(
        self, elements: BezierElements, chosen: np.ndarray, slots: np.ndarray
    ) -> Iterator[tuple[AbstractDeviceSamples, Blocks]]:
        """Blocks of the samples in the chosen Bézier elements, whose device slots are `slots`, and what they refer to.

        The parts that follow each other may share elements, not samples.
        """

    def places_in(self, tmesh: TMesh, counts: Int[np.ndarray, " elements"]) -> Int[np.ndarray, " elements"]:
        """Number of different places that hold a sample, per element of the T-mesh; two stands for more.

        `counts` are the numbers of samples of a weight above zero; every pixel is a place of its own.
        """
        return np.minimum(counts, 2)


class AbstractHeldSamples(AbstractSamples):
    """Samples that are all on the device."""

    device: AbstractDeviceSamples

    @abstractmethod
    def blocks(self, elements: BezierElements, chosen: np.ndarray, slots: np.ndarray) -> Blocks:
        """Blocks of the samples in the chosen Bézier elements, whose device slots are `slots`."""

    def parts(
        self, elements: BezierElements, chosen: np.ndarray, slots: np.ndarray
    ) -> Iterator[tuple[AbstractDeviceSamples, Blocks]]:
        """One part."""
        yield self.device, self.blocks(elements, chosen, slots)

    @abstractmethod
    def collect(self, blocks: Blocks, per_lane: np.ndarray) -> np.ndarray:
        """Rows (blocks, 16, d) of the blocks of all samples, put in the order of the data: (m, d)."""

    @abstractmethod
    def with_values(self, values: Float[np.ndarray, "m d"]) -> "AbstractHeldSamples":
        """Other values at the same samples; variances are left out."""


@dataclass(frozen=True, eq=False)
class ScatteredSamples(AbstractHeldSamples):
    """Samples at any parameters, sorted by the codes of a dyadic forest.

    **Attributes:**

    - `codes`, `permutation`: the sorted codes and the permutation that sorted them.
    - `device`: the sorted samples.
    """

    codes: Int[np.ndarray, " m"]
    permutation: Int[np.ndarray, " m"]
    device: DevicePoints
    tile: int

    def _ranges(self, codes: np.ndarray) -> np.ndarray:
        """First sample of each cell of a sorted forest and, last, the number of samples."""
        return np.append(np.searchsorted(self.codes, codes), len(self.codes))

    def blocks(self, elements: BezierElements, chosen: np.ndarray, slots: np.ndarray) -> Blocks:
        """Runs of at most sixteen samples."""
        assert elements.codes is not None
        ranges = self._ranges(elements.codes)
        first, counts = ranges[chosen], ranges[chosen + 1] - ranges[chosen]
        owner, place = _expand(-(-counts // LANES))
        start = first[owner] + place * LANES
        count = np.minimum(counts[owner] - place * LANES, LANES)
        fields = np.stack([start, count, start, count], axis=1).astype(np.int32)
        return Blocks(fields, slots[owner].astype(np.int32), owner)

    def places_in(self, tmesh: TMesh, counts: np.ndarray) -> np.ndarray:
        """Two where the first and the last sample of an element differ in their code."""
        assert tmesh.forest is not None
        ranges = self._ranges(tmesh.forest.codes)
        places = np.minimum(np.diff(ranges), 2)
        several = places == 2
        places[several] = 1 + (self.codes[ranges[:-1][several]] != self.codes[ranges[1:][several] - 1])
        return places

    def collect(self, blocks: Blocks, per_lane: np.ndarray) -> np.ndarray:
        """Undo the sorting."""
        rows = per_lane[np.arange(LANES) < blocks.fields[:, 1, None]]
        result = np.empty_like(rows)
        result[self.permutation] = rows
        return result

    def with_values(self, values: np.ndarray) -> "ScatteredSamples":
        """Sorted and padded like the first ones."""
        held = self.device.values
        column = to_device(pad(values[self.permutation].astype(held.dtype), len(held), 0))
        return replace(self, device=_with_values(self.device, column))


@dataclass(frozen=True, eq=False)
class GridSamples(AbstractHeldSamples):
    """The pixels of a height map; missing ones have weight zero.

    **Attributes:**

    - `columns`, `rows`: index coordinate (in the mesh) of each pixel column and row, ascending.
    - `index`: places of the samples in the flattened grid; `None` where every pixel is one.
    - `device`: the pixels, row by row.
    """

    columns: Int[np.ndarray, " columns"]
    rows: Int[np.ndarray, " rows"]
    index: Int[np.ndarray, " m"] | None
    device: DevicePixels
    tile: int

    def blocks(self, elements: BezierElements, chosen: np.ndarray, slots: np.ndarray) -> Blocks:
        """Squares of at most 4 × 4 pixels."""
        return pixel_blocks(*rectangles(self.columns, self.rows, elements.boxes[chosen]), slots)

    def collect(self, blocks: Blocks, per_lane: np.ndarray) -> np.ndarray:
        """Pixel by pixel, the missing ones left out."""
        lanes = np.arange(SIDE)
        column, row = (blocks.fields[:, k, None] + lanes for k in range(2))
        inside = (lanes < blocks.fields[:, 3, None])[:, :, None] & (lanes < blocks.fields[:, 2, None])[:, None]
        place = (row[:, :, None] * len(self.columns) + column[:, None])[inside]
        grid = np.empty((len(self.rows) * len(self.columns), per_lane.shape[2]), per_lane.dtype)
        grid[place] = per_lane.reshape(-1, SIDE, SIDE, per_lane.shape[2])[inside]
        return grid if self.index is None else grid[self.index]

    def with_values(self, values: np.ndarray) -> "GridSamples":
        """Spread over the grid like the first ones."""
        held = self.device.values
        column = _spread(values, self.index, len(held), np.dtype(held.dtype))
        return replace(self, device=_with_values(self.device, column))


def rectangles(
    columns: Int[np.ndarray, " columns"], rows: Int[np.ndarray, " rows"], boxes: Int[np.ndarray, "boxes 4"]
) -> tuple[Int[np.ndarray, "boxes 2"], Int[np.ndarray, "boxes 2"]]:
    """First pixel column and row of index boxes, and the numbers of columns and rows."""
    lines = (columns, rows)
    first, last = (
        np.stack([np.searchsorted(line, boxes[:, k + at]) for k, line in enumerate(lines)], axis=1) for at in (0, 2)
    )
    return first, last - first


def pixel_blocks(first: Int[np.ndarray, "n 2"], counts: Int[np.ndarray, "n 2"], slots: np.ndarray) -> Blocks:
    """Rectangles of pixels cut into squares of at most 4 × 4."""
    across = -(-counts // SIDE)
    owner, place = _expand(across[:, 0] * across[:, 1])
    row, column = np.divmod(place, across[owner, 0])
    offset = SIDE * np.stack([column, row], axis=1)
    size = np.minimum(counts[owner] - offset, SIDE)
    fields = np.concatenate([first[owner] + offset, size], axis=1).astype(np.int32)
    return Blocks(fields, slots[owner].astype(np.int32), owner)


DeviceKind = TypeVar("DeviceKind", bound=AbstractDeviceSamples)


def _with_values(samples: DeviceKind, values: Array) -> DeviceKind:
    """Other values at the same samples, without variances."""
    return eqx.tree_at(lambda s: (s.values, s.variance), samples, (values, None), is_leaf=lambda leaf: leaf is None)


def batches(blocks: Blocks, tile: int) -> Iterator[tuple[BlockList, slice]]:
    """The blocks on the device, in lists of `TILES` tiles, and each list's places among all blocks."""
    length = TILES * tile
    for first in range(0, len(blocks.slot), length):
        places = slice(first, min(first + length, len(blocks.slot)))
        parts = (pad(part[places], length, 0) for part in (blocks.fields, blocks.slot))
        count = to_device(places.stop - first, np.int32)
        fields, slot = (to_device(part) for part in parts)
        yield BlockList(fields, slot, count, tile), places


def _expand(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each of Σ counts entries: whose it is, and its place there."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def _spread(part: np.ndarray, index: np.ndarray | None, length: int, dtype: np.dtype) -> Array:
    """Rows of samples at their places in a flattened grid, zero elsewhere, on the device."""
    if index is None:
        return to_device(pad(part.astype(dtype), length, 0))
    grid = np.zeros((length, *part.shape[1:]), dtype)
    grid[index] = part
    return to_device(grid)


def sample_order(tmesh: TMesh, parameters: Float[np.ndarray, "m 2"]) -> tuple[np.ndarray, np.ndarray]:
    """Sorted codes of samples in a dyadic forest, and the permutation that sorts them; valid for every refinement."""
    assert tmesh.forest is not None
    scale = np.array(tmesh.forest.lattice) << DEPTH
    cells = np.clip((parameters * scale).astype(np.int64), 0, scale - 1)
    codes = tmesh.forest.code(cells[:, 0], cells[:, 1])
    permutation = np.argsort(codes, kind="stable")
    return codes[permutation], permutation


def grid_lines(n_pixels: int, n_squares: int) -> Int[np.ndarray, " pixels"]:
    """Index coordinates of pixel lines over a lattice of this many squares."""
    scale = n_squares << DEPTH
    places = np.arange(n_pixels) / max(n_pixels - 1, 1)
    return np.clip((places * scale).astype(np.int64), 0, scale - 1)


def padded_length(count: int) -> int:
    """The power of two that holds a count: kernels rarely see a new one."""
    return 1 << max(0, int(count - 1).bit_length())


def scattered_samples(
    tmesh: TMesh,
    parameters: np.ndarray,
    values: np.ndarray,
    weights: np.ndarray | None,
    variance: np.ndarray | None,
    *,
    dtype: np.dtype,
    tile: int,
) -> ScatteredSamples:
    """Sort scattered samples and put them on the device."""
    codes, permutation = sample_order(tmesh, parameters)
    length = padded_length(len(values) + LANES)

    def put(part: np.ndarray) -> Array:
        return to_device(pad(part[permutation].astype(dtype), length, 0))

    device = DevicePoints(
        parameters=put(parameters),
        values=put(values),
        weights=None if weights is None else put(weights),
        variance=None if variance is None else put(variance),
    )
    return ScatteredSamples(codes, permutation, device, tile)


def grid_samples(
    tmesh: TMesh,
    shape: tuple[int, int],
    index: np.ndarray | None,
    values: np.ndarray,
    weights: np.ndarray | None,
    variance: np.ndarray | None,
    *,
    dtype: np.dtype,
    tile: int,
) -> GridSamples:
    """Put the pixels of a height map on the device; `index` names those that are samples, if not all are."""
    assert tmesh.forest is not None
    length = padded_length(shape[0] * shape[1])
    if index is not None and weights is None:
        weights = np.ones(len(values))

    def put(part: np.ndarray) -> Array:
        return _spread(part, index, length, dtype)

    device = DevicePixels(
        shape=to_device(np.array([shape[1], shape[0]], np.int32)),
        origin=to_device(np.zeros(2, np.int32)),
        stride=to_device(shape[1], np.int32),
        values=put(values),
        weights=None if weights is None else put(weights),
        variance=None if variance is None else put(variance),
    )
    columns = grid_lines(shape[1], tmesh.forest.lattice[0])
    return GridSamples(columns, grid_lines(shape[0], tmesh.forest.lattice[1]), index, device, tile)
