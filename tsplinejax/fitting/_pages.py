"""Samples of a map that is not in memory: pixels come page by page, and only pages that hold a chosen element."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from ..data import StoredMap, Window
from ..mesh import TMesh
from ..space import BezierElements, pad, to_device
from ._engines import AbstractEngine
from ._samples import AbstractSamples, Blocks, grid_lines, pixel_blocks, rectangles
from ._tiles import AbstractDeviceSamples, DevicePixels

PAGE_BYTES = 600  # of memory that working on a page takes, a pixel
ROW_BYTES = 4300  # of a Bézier element's rows on the device
LEAST_SIDE, LARGEST_SIDE = 256, 4096


@dataclass(frozen=True, eq=False)
class PageFormat:
    """How heights become a page on the device.

    **Attributes:**

    - `shape`: of the map, (rows, columns).
    - `offset`, `factor`: fitted values are (height - offset) / factor.
    - `complete`: whether no pixel is missing.
    - `variance`: the noise's, in fitted values; `None` for a fit to a tolerance.
    - `side`: pixels along a page's side.
    """

    shape: tuple[int, int]
    offset: float
    factor: float
    complete: bool
    variance: float | None
    side: int
    dtype: np.dtype
    tile: int


@dataclass(frozen=True, eq=False)
class Page:
    """A page, without its heights: small enough to be sent to whoever works on it.

    **Attributes:**

    - `window`: which pixels.
    - `columns`, `rows`: index coordinate (in the mesh) of each of its pixel columns and rows.
    """

    form: PageFormat
    window: Window
    columns: Int[np.ndarray, " columns"]
    rows: Int[np.ndarray, " rows"]

    @property
    def corner(self) -> Int[np.ndarray, " 2"]:
        """First column and row."""
        return np.array([self.window.columns.start, self.window.rows.start])

    def holds(self, boxes: Int[np.ndarray, "n 4"]) -> Int[np.ndarray, " some"]:
        """Which of the index boxes have a pixel here."""
        return np.flatnonzero((rectangles(self.columns, self.rows, boxes)[1] > 0).all(axis=1))

    def blocks(self, boxes: Int[np.ndarray, "n 4"], slots: Int[np.ndarray, " n"]) -> Blocks:
        """Squares of at most 4 × 4 of its pixels, in these index boxes."""
        first, counts = rectangles(self.columns, self.rows, boxes)
        return pixel_blocks(first + self.corner, counts, slots)

    def on_device(self, heights: Float[np.ndarray, "rows columns"]) -> DevicePixels:
        """Scaled heights on the device; missing ones have weight zero."""
        form = self.form
        values = ((heights.astype(np.float64) - form.offset) / form.factor).astype(form.dtype).ravel()
        length, weights = form.side**2, None
        if not form.complete:
            missing = np.isnan(values)
            values[missing] = 0
            weights = to_device(pad((~missing).astype(form.dtype), length, 0))
        variance = None if form.variance is None else to_device(np.full(length, form.variance, form.dtype))
        return DevicePixels(
            shape=to_device(np.array(form.shape[::-1], np.int32)),
            origin=to_device(self.corner.astype(np.int32)),
            stride=to_device(heights.shape[1], np.int32),
            values=to_device(pad(values[:, None], length, 0)),
            weights=weights,
            variance=variance,
        )


@dataclass(frozen=True, eq=False)
class PagedSamples(AbstractSamples):
    """The pixels of a stored map, read in square pages.

    **Attributes:**

    - `source`: the map; `form`: what makes pages of it.
    - `columns`, `rows`: index coordinate (in the mesh) of each pixel column and row.
    - `engine`: who works on the pages; `None` for this process, one page after the other.
    """

    source: StoredMap
    form: PageFormat
    columns: Int[np.ndarray, " columns"]
    rows: Int[np.ndarray, " rows"]
    engine: AbstractEngine | None

    @property
    def tile(self) -> int:
        """The pages'."""
        return self.form.tile

    def pages(self, boxes: Int[np.ndarray, "n 4"]) -> Iterator[tuple[Page, Int[np.ndarray, " inside"]]]:
        """Pages with pixels in any of the index boxes, and which boxes those are."""
        for window in self.source.windows(self.form.side):
            page = Page(self.form, window, self.columns[window.columns], self.rows[window.rows])
            inside = page.holds(boxes)
            if len(inside):
                yield page, inside

    def parts(
        self, elements: BezierElements, chosen: np.ndarray, slots: np.ndarray
    ) -> Iterator[tuple[AbstractDeviceSamples, Blocks]]:
        """A part a page."""
        boxes = elements.boxes[chosen]
        for page, inside in self.pages(boxes):
            found = page.blocks(boxes[inside], slots[inside])
            heights = self.source.window(page.window)
            yield page.on_device(heights), Blocks(found.fields, found.slot, inside[found.owner])


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
    engine: AbstractEngine | None = None,
) -> PagedSamples:
    """The pixels of a stored map over a mesh's lattice."""
    assert tmesh.forest is not None
    rows, columns = source.shape
    lattice = tmesh.forest.lattice
    complete = source.statistics.count == rows * columns
    side = min(side, 1 << (max(rows, columns) - 1).bit_length())
    form = PageFormat((rows, columns), offset, factor, complete, variance, side, dtype, tile)
    return PagedSamples(source, form, grid_lines(columns, lattice[0]), grid_lines(rows, lattice[1]), engine)
