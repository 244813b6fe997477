"""Samples of a map that is not in memory: pixels come page by page, and only pages that hold a chosen element."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from ..data import StoredMap
from ..mesh import TMesh
from ..space import BezierElements, pad, to_device
from ._samples import AbstractSamples, Blocks, grid_lines, pixel_blocks, rectangles
from ._tiles import AbstractDeviceSamples, DevicePixels

PAGE_BYTES = 600  # of memory that working on a page takes, a pixel
ROW_BYTES = 4300  # of a Bézier element's rows on the device
LEAST_SIDE, LARGEST_SIDE = 256, 4096


@dataclass(frozen=True, eq=False)
class PagedSamples(AbstractSamples):
    """The pixels of a stored map, read in square pages.

    **Attributes:**

    - `source`: the map; `offset`, `factor`: fitted values are (height - offset) / factor.
    - `columns`, `rows`: index coordinate (in the mesh) of each pixel column and row.
    - `complete`: whether no pixel is missing.
    - `variance`: the noise's, in fitted values; `None` for a fit to a tolerance.
    - `side`: pixels along a page's side.
    """

    source: StoredMap
    offset: float
    factor: float
    columns: Int[np.ndarray, " columns"]
    rows: Int[np.ndarray, " rows"]
    complete: bool
    variance: float | None
    side: int
    dtype: np.dtype
    tile: int

    def parts(
        self, elements: BezierElements, chosen: np.ndarray, slots: np.ndarray
    ) -> Iterator[tuple[AbstractDeviceSamples, Blocks]]:
        """A part a page."""
        first, counts = rectangles(self.columns, self.rows, elements.boxes[chosen])
        last = first + counts
        for top in range(0, len(self.rows), self.side):
            for left in range(0, len(self.columns), self.side):
                low = np.array([left, top])
                start, stop = np.maximum(first, low), np.minimum(last, low + self.side)
                inside = np.flatnonzero((stop > start).all(axis=1))
                if len(inside):
                    found = pixel_blocks(start[inside], stop[inside] - start[inside], slots[inside])
                    yield self._page(left, top), Blocks(found.fields, found.slot, inside[found.owner])

    def places_in(self, tmesh: TMesh, counts: np.ndarray) -> np.ndarray:
        """Every pixel is a place of its own."""
        return np.minimum(counts, 2)

    def _page(self, left: int, top: int) -> DevicePixels:
        """Scaled heights of a page on the device; missing ones have weight zero."""
        rows, columns = slice(top, min(top + self.side, len(self.rows))), slice(left, left + self.side)
        heights = self.source.window(rows, slice(left, min(columns.stop, len(self.columns))))
        values = ((heights.astype(np.float64) - self.offset) / self.factor).astype(self.dtype).ravel()
        length, weights = self.side**2, None
        if not self.complete:
            missing = np.isnan(values)
            values[missing] = 0
            weights = to_device(pad((~missing).astype(self.dtype), length, 0))
        variance = None if self.variance is None else to_device(np.full(length, self.variance, self.dtype))
        return DevicePixels(
            shape=to_device(np.array([len(self.columns), len(self.rows)], np.int32)),
            origin=to_device(np.array([left, top], np.int32)),
            stride=to_device(heights.shape[1], np.int32),
            values=to_device(pad(values[:, None], length, 0)),
            weights=weights,
            variance=variance,
        )


def page_side(max_memory: float) -> int:
    """Pixels along a page's side, a power of two, for a budget of memory in bytes.

    >>> page_side(4e9)
    2048
    """
    side = 2 ** int(np.floor(np.log2(np.sqrt(max_memory / PAGE_BYTES))))
    return int(np.clip(side, LEAST_SIDE, LARGEST_SIDE))


def most_control_points(max_memory: float) -> int:
    """Control points for which rows on the device, old and new while they grow, stay within half the budget.

    >>> most_control_points(4e9) > 100_000
    True
    """
    capacity = 2 ** int(np.floor(np.log2(max(max_memory / 2 / (1.5 * ROW_BYTES), 1024))))
    return int(capacity / 1.3)


def paged_samples(
    tmesh: TMesh,
    source: StoredMap,
    offset: float,
    factor: float,
    variance: float | None,
    *,
    side: int,
    dtype: np.dtype,
    tile: int,
) -> PagedSamples:
    """The pixels of a stored map over a mesh's lattice."""
    assert tmesh.forest is not None
    rows, columns = source.shape
    lattice = tmesh.forest.lattice
    return PagedSamples(
        source=source,
        offset=offset,
        factor=factor,
        columns=grid_lines(columns, lattice[0]),
        rows=grid_lines(rows, lattice[1]),
        complete=source.statistics.count == rows * columns,
        variance=variance,
        side=min(side, 1 << (max(rows, columns) - 1).bit_length()),
        dtype=dtype,
        tile=tile,
    )
