"""Height maps that stay where they are stored: memory-mapped files, zarr and dask arrays, read window by window."""

import mmap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ._frame import Frame, finite_pair
from ._height_map import HeightMap, checked_spacing
from ._units import canonical_unit

_WINDOW = 1 << 22  # pixels of a window of the first pass


@dataclass(frozen=True)
class Statistics:
    """What one pass over a map tells: number of valid pixels, their extremes, and sums of them and of their squares."""

    count: int
    low: float
    high: float
    total: float
    squares: float


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

    def window(self, rows: slice, columns: slice) -> Float[np.ndarray, "rows columns"]:
        """The heights of a window, in memory, as floating-point numbers.

        **Raises:** `InputError` where a height is infinite.
        """
        array = np.array(self.heights[rows, columns])
        _release(self.heights)
        if array.dtype.kind != "f":
            array = array.astype(np.float64)
        if np.isinf(array).any():
            raise InputError(
                "heights must be finite or NaN (missing), but some are infinite in the rows "
                f"{rows.start} to {rows.stop}, columns {columns.start} to {columns.stop}"
            )
        return array

    def bands(self, pixels: int = 1 << 20) -> HeightMap:
        """Some of the rows, in bands of 32 from top to bottom, as a map in memory: enough to judge noise and tilt."""
        rows, columns = self.shape
        band = min(32, rows)
        count = int(np.clip(pixels // (band * columns), 1, rows // band))
        first = np.linspace(0, rows - band, count).astype(int)
        parts = [self.window(slice(row, row + band), slice(0, columns)) for row in first]
        return HeightMap(np.concatenate(parts), self.spacing, self.unit)

    @cached_property
    def statistics(self) -> Statistics:
        """One pass over all heights; sums are taken about the first valid one.

        **Raises:** `InputError` where every height is missing or one is infinite.
        """
        rows, columns = self.shape
        step = max(1, _WINDOW // columns)
        count, low, high, total, squares, shift = 0, np.inf, -np.inf, 0.0, 0.0, None
        for first in range(0, rows, step):
            band = self.window(slice(first, min(first + step, rows)), slice(0, columns))
            valid = band[~np.isnan(band)].astype(np.float64)
            if valid.size == 0:
                continue
            shift = float(valid[0]) if shift is None else shift
            low, high = min(low, float(valid.min())), max(high, float(valid.max()))
            valid -= shift
            count, total, squares = count + valid.size, total + float(valid.sum()), squares + float(valid @ valid)
        if shift is None:
            raise InputError(f"every one of the {rows * columns} heights is missing (NaN): there is nothing to fit")
        return Statistics(count, low, high, total + count * shift, squares + 2 * shift * total + count * shift**2)


def is_stored(data: Any) -> bool:
    """Whether this is an array on disk or in chunks, rather than in memory: a memory map, a zarr or a dask array."""
    return isinstance(data, np.memmap) or (hasattr(data, "chunks") and hasattr(data, "shape"))


def _release(heights: Any) -> None:
    """Let the system have the pages of a memory map back: they would count as memory in use."""
    mapped = getattr(heights, "_mmap", None)
    if isinstance(mapped, mmap.mmap) and hasattr(mapped, "madvise"):
        mapped.madvise(mmap.MADV_DONTNEED)
