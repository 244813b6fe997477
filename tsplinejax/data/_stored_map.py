"""Height maps that stay where they are stored: memory-mapped files, zarr and dask arrays, read window by window."""

import mmap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ._frame import Frame, finite_pair
from ._height_map import HeightMap, checked_spacing
from ._units import canonical_unit

_WINDOW = 1024  # pixels along a side of a window of the first pass
_BLOCK = 128  # pixels along a side of a block by which the map is judged


@dataclass(frozen=True)
class Statistics:
    """What one pass over heights tells; those of two parts add up.

    **Attributes:**

    - `count`: valid pixels.
    - `low`, `high`, `mean`: of those.
    - `centred`: Σ (v - mean)². Nothing cancels, however high above zero the map lies.

    >>> statistics_of(np.array([1.0, np.nan])) + statistics_of(np.array([3.0]))
    Statistics(count=2, low=1.0, high=3.0, mean=2.0, centred=2.0)
    """

    count: int = 0
    low: float = np.inf
    high: float = -np.inf
    mean: float = 0.0
    centred: float = 0.0

    def __add__(self, other: "Statistics") -> "Statistics":
        """Of both parts together (Chan, Golub and LeVeque 1983)."""
        count = self.count + other.count
        if count == 0:
            return self
        between, share = other.mean - self.mean, other.count / count
        return Statistics(
            count,
            min(self.low, other.low),
            max(self.high, other.high),
            self.mean + between * share,
            self.centred + other.centred + between**2 * self.count * share,
        )


def statistics_of(heights: Float[np.ndarray, "..."]) -> Statistics:
    """Statistics of heights in memory; NaN is missing.

    >>> statistics_of(np.array([np.nan])).count
    0
    """
    valid = heights[~np.isnan(heights)].astype(np.float64)
    if valid.size == 0:
        return Statistics()
    mean = float(valid.mean())
    low, high = float(valid.min()), float(valid.max())
    valid -= mean
    return Statistics(valid.size, low, high, mean, float(valid @ valid))


@dataclass(frozen=True)
class Window:
    """A rectangle of a map's pixels."""

    rows: slice
    columns: slice


@dataclass(frozen=True, init=False, eq=False, repr=False)
class StoredMap:
    """A height map that is not read into memory.

    **Arguments:**

    - `heights`: (rows, columns), anything with a `shape` and slices: `numpy.memmap`, a zarr or a dask array; NaN is
      missing.
    - `spacing`, `unit`, `origin`, `provenance`: as of a `HeightMap`.

    **Raises:** `InputError` for another dimension, fewer than two rows or columns, and a spacing that is not positive.

    >>> StoredMap(np.zeros((300, 200), np.float32), spacing=0.5, unit="µm")
    StoredMap(300 rows × 200 columns, spacing=(0.5, 0.5) µm, float32)
    """

    heights: Any
    spacing: tuple[float, float]
    unit: str | None
    origin: tuple[float, float]
    provenance: dict[str, Any]

    def __init__(
        self,
        heights: Any,
        spacing: float | Sequence[float] = (1.0, 1.0),
        unit: str | None = None,
        *,
        origin: Sequence[float] = (0.0, 0.0),
        provenance: Mapping[str, Any] | None = None,
    ) -> None:
        shape = tuple(getattr(heights, "shape", ()))
        if len(shape) != 2 or min(shape) < 2 or np.dtype(heights.dtype).kind not in "fiu":
            raise InputError(
                "a stored map is a 2-D array of real heights with at least two rows and columns; received "
                f"{type(heights).__name__} of shape {shape}; choose one channel or slice it"
            )
        object.__setattr__(self, "heights", heights)
        object.__setattr__(self, "spacing", checked_spacing(spacing))
        object.__setattr__(self, "unit", canonical_unit(unit))
        object.__setattr__(self, "origin", finite_pair(origin, "an origin (x, y)"))
        object.__setattr__(self, "provenance", dict(provenance or {}))

    def __repr__(self) -> str:
        """Say shape, spacing, unit and number format."""
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"StoredMap({self.shape[0]} rows × {self.shape[1]} columns, "
            f"spacing=({self.spacing[0]:g}, {self.spacing[1]:g}){unit}, {np.dtype(self.heights.dtype)})"
        )

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        rows, columns = self.heights.shape
        return int(rows), int(columns)

    @property
    def frame(self) -> Frame:
        """Where the parameter square lies: s along x, t along y."""
        rows, columns = self.shape
        extent = ((columns - 1) * self.spacing[0], (rows - 1) * self.spacing[1])
        return Frame(self.origin, extent, self.unit)

    @property
    def dtype(self) -> np.dtype:
        """float32 for heights of at most that precision, else float64: what a window of the map has."""
        return _working_dtype(np.dtype(self.heights.dtype))

    @property
    def range(self) -> float:
        """Largest minus smallest valid height; takes one pass over the map, as `statistics`."""
        return self.statistics.high - self.statistics.low

    def window(self, window: Window) -> Float[np.ndarray, "rows columns"]:
        """The heights of a window, in memory, as floating-point numbers.

        **Raises:** `InputError` where a height is infinite.
        """
        heights = checked_heights(np.array(self.heights[window.rows, window.columns]), window)
        _release(self.heights)
        return heights

    def windows(self, side: int = _WINDOW) -> Iterator[Window]:
        """Squares that cover the map, cut at its last row and column."""
        rows, columns = self.shape
        for top in range(0, rows, side):
            for left in range(0, columns, side):
                yield Window(slice(top, min(top + side, rows)), slice(left, min(left + side, columns)))

    def mosaic(self, pixels: int = 1 << 20) -> HeightMap:
        """Blocks from all over the map, side by side as a map in memory: enough to judge noise and tilt.

        A map of at most this many pixels is returned whole.
        """
        rows, columns = self.shape
        if rows * columns <= pixels:
            return HeightMap(self.window(Window(slice(0, rows), slice(0, columns))), self.spacing, self.unit)
        height, width = min(rows, _BLOCK), min(columns, _BLOCK)
        across = int(np.clip(np.sqrt(pixels * columns / rows) // width, 1, columns // width))
        down = int(np.clip(pixels // (across * width * height), 1, rows // height))
        lines = [
            [
                self.window(Window(slice(top, top + height), slice(left, left + width)))
                for left in _spread(columns, width, across)
            ]
            for top in _spread(rows, height, down)
        ]
        return HeightMap(np.block(lines), self.spacing, self.unit)

    @cached_property
    def statistics(self) -> Statistics:
        """One pass over all heights.

        **Raises:** `InputError` where every height is missing or one is infinite.
        """
        return self._some(sum((statistics_of(self.window(window)) for window in self.windows()), Statistics()))

    def with_statistics(self, statistics: Statistics) -> "StoredMap":
        """The same map, whose statistics were found elsewhere.

        **Raises:** `InputError` where every height is missing.
        """
        known = StoredMap(self.heights, self.spacing, self.unit, origin=self.origin, provenance=self.provenance)
        known.__dict__["statistics"] = self._some(statistics)
        return known

    def _some(self, statistics: Statistics) -> Statistics:
        if statistics.count == 0:
            rows, columns = self.shape
            raise InputError(
                f"every one of the {rows * columns} heights is missing (NaN): there is nothing to fit; check the file"
            )
        return statistics

    def __getstate__(self) -> dict[str, Any]:
        """A memory map travels to other processes as the name of its file, never as its pixels."""
        state = dict(self.__dict__)
        if isinstance(self.heights, np.memmap):
            state["heights"] = MappedFile.of(self.heights)
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        heights = state["heights"]
        self.__dict__.update(state, heights=heights.open() if isinstance(heights, MappedFile) else heights)


@dataclass(frozen=True)
class MappedFile:
    """Where the numbers of a memory map lie."""

    filename: str
    dtype: np.dtype
    offset: int
    shape: tuple[int, ...]
    order: Literal["C", "F"]

    @classmethod
    def of(cls, heights: np.memmap) -> "MappedFile":
        """The file behind a memory map.

        **Raises:** `InputError` for a part of one, whose place in the file is not known.
        """
        if heights.filename is None or not isinstance(heights.base, mmap.mmap):
            raise InputError(
                "a memory map is sent to workers as the name of its file, but this is a part of one, or of no file; "
                "pass the whole map, or a dask array"
            )
        order = "C" if heights.flags.c_contiguous else "F"
        return cls(str(heights.filename), heights.dtype, heights.offset, heights.shape, order)

    def open(self) -> np.memmap:
        """Map the file again, to read."""
        return np.memmap(self.filename, self.dtype, "r", self.offset, self.shape, self.order)


def checked_heights(array: np.ndarray, window: Window) -> Float[np.ndarray, "rows columns"]:
    """The numbers of a window of a map, as they are to be fitted.

    **Raises:** `InputError` where a height is infinite.

    >>> checked_heights(np.ones((1, 2), np.int16), Window(slice(0, 1), slice(0, 2)))
    array([[1., 1.]])
    """
    heights = array.astype(_working_dtype(array.dtype), copy=False)
    if np.isinf(heights).any():
        rows, columns = window.rows, window.columns
        raise InputError(
            "heights must be finite or NaN (missing), but some are infinite in the rows "
            f"{rows.start} to {rows.stop}, columns {columns.start} to {columns.stop}; replace them by NaN"
        )
    return heights


def is_stored(data: Any) -> bool:
    """Whether this is a map on disk or in chunks, rather than in memory: a memory map, a zarr or a dask array.

    As for arrays in memory, three columns are points, not heights.

    >>> is_stored(np.zeros((4, 4)))
    False
    """
    shape = getattr(data, "shape", ())
    elsewhere = hasattr(data, "chunks") or getattr(data, "_mmap", None) is not None
    return elsewhere and len(shape) > 0 and not (len(shape) == 2 and shape[1] == 3)


def _working_dtype(stored: np.dtype) -> np.dtype:
    """As for heights in memory: whole numbers become float64, half precision float32."""
    return np.dtype(np.float32 if stored.kind == "f" and stored.itemsize <= 4 else np.float64)


def _spread(length: int, part: int, count: int) -> list[int]:
    """Where `count` parts of a length begin, each in the middle of its share."""
    return [int(first) for first in (np.arange(count) + 0.5) * length / count - part / 2]


def _release(heights: Any) -> None:
    """Let the system have the pages of a memory map back: they would count as memory in use.

    Not those of a copy-on-write map, which may hold changes that are nowhere else.
    """
    mapped = getattr(heights, "_mmap", None)
    if isinstance(mapped, mmap.mmap) and hasattr(mapped, "madvise") and heights.mode != "c":
        mapped.madvise(mmap.MADV_DONTNEED)
