"""Height maps: z over a grid of pixels.

`heights[i, j]` lies at x = x₀ + j dx, y = y₀ + i dy (pixel centres): rows are y, columns are x, and y increases with
the row index, so a picture with row 0 at the top shows a map the right way round. The extent is (n - 1) times the
spacing. NaN is missing. One unit of length holds for x, y and z.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Real
from numpy.typing import ArrayLike

from .._errors import InputError
from ._arrays import frozen, mask_array, real_array
from ._frame import Frame, finite_pair
from ._provenance import recorded
from ._samples import Samples
from ._units import canonical_unit, parse_length, unit_factor

_ON_EDGE = 1e-9  # a pixel centre this many spacings beyond a crop's edge still counts as on it


@dataclass(frozen=True, init=False, eq=False, repr=False)
class HeightMap:
    """Heights over a grid of pixels, with spacing, unit and missing pixels; immutable.

    **Arguments:**

    - `heights`: (rows, columns), real numbers; NaN is missing. A masked array's masked pixels become missing. float32
      and float64 are kept, integers become float64. The array is copied and read-only.
    - `spacing`: (dx, dy), both above zero, in `unit`; one number serves both directions.
    - `unit`: the unit of x, y and z (`"mm"`, `"µm"`, `"um"`, `"nm"`, ...), or `None` if unknown.
    - `height_unit`: the unit in which `heights` are given, if another; they are converted to `unit`.
    - `origin`: (x, y) of pixel (0, 0), in `unit`.
    - `mask`: (rows, columns); True or non-zero marks further missing pixels, whatever their height.
    - `filled`: (rows, columns); True or non-zero marks heights that were not measured but filled in; areal parameters
      leave them out unless asked. `None` for a map that nobody filled.
    - `provenance`: where the data come from; `name`, `sha256` and `operations` by convention.

    **Raises:** `InputError` for another dimension, an empty map, values that are not real numbers, infinite heights,
    a spacing that is not positive, an unknown unit, a height unit without a unit.

    >>> HeightMap([[0.0, 1.0], [2.0, float("nan")]], spacing=(2.0, 1.0), unit="µm", height_unit="nm")
    HeightMap(2 rows × 2 columns, spacing=(2, 1) µm, range=0.002 µm, 75 % valid, float64)
    """

    heights: Float[np.ndarray, "rows columns"]
    spacing: tuple[float, float]
    unit: str | None
    origin: tuple[float, float]
    provenance: dict[str, Any]
    filled: Bool[np.ndarray, "rows columns"] | None

    def __init__(
        self,
        heights: Real[ArrayLike, "rows columns"],
        spacing: float | Sequence[float] = (1.0, 1.0),
        unit: str | None = None,
        height_unit: str | None = None,
        *,
        origin: Sequence[float] = (0.0, 0.0),
        mask: Bool[ArrayLike, "rows columns"] | None = None,
        provenance: Mapping[str, Any] | None = None,
        filled: Bool[ArrayLike, "rows columns"] | None = None,
    ) -> None:
        array = _height_array(heights)
        if mask is not None:
            array[mask_array(mask, array.shape)] = np.nan
        infinite = int(np.isinf(array).sum())
        if infinite:
            raise InputError(f"heights must be finite or NaN (missing), but {infinite} of {array.size} are infinite")
        unit = canonical_unit(unit)
        _convert_heights(array, unit, canonical_unit(height_unit))
        object.__setattr__(self, "heights", frozen(array))
        object.__setattr__(self, "spacing", checked_spacing(spacing))
        object.__setattr__(self, "unit", unit)
        object.__setattr__(self, "origin", finite_pair(origin, "an origin (x, y)"))
        object.__setattr__(self, "provenance", dict(provenance or {}))
        object.__setattr__(self, "filled", _filled_mask(filled, array))

    def __repr__(self) -> str:
        """Say shape, spacing, unit, range and how much of the map is valid."""
        rows, columns = self.shape
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"HeightMap({rows} rows × {columns} columns, spacing=({self.spacing[0]:g}, {self.spacing[1]:g}){unit}, "
            f"range={self.range:.6g}{unit}, {_percentage(self.valid)} % valid, {self.heights.dtype})"
        )

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns), as numpy has it: pixels along y, pixels along x."""
        return self.heights.shape

    @property
    def valid(self) -> Bool[np.ndarray, "rows columns"]:
        """True where there is a height."""
        return ~np.isnan(self.heights)

    @property
    def measured(self) -> Bool[np.ndarray, "rows columns"]:
        """True where there is a height that was not filled in."""
        return self.valid if self.filled is None else self.valid & ~self.filled

    @property
    def extent(self) -> tuple[float, float]:
        """(Lx, Ly) between the centres of the outermost pixels: (n - 1) times the spacing."""
        rows, columns = self.shape
        return (columns - 1) * self.spacing[0], (rows - 1) * self.spacing[1]

    @property
    def range(self) -> float:
        """Greatest minus smallest valid height; NaN when every pixel is missing."""
        heights = self.heights[self.valid].astype(np.float64)
        return float(np.ptp(heights)) if heights.size else float("nan")

    @property
    def frame(self) -> Frame:
        """Where the parameter square lies: s along x, t along y.

        Raises `InputError` for a map of one row or one column, which has no extent in that direction.
        """
        return Frame(self.origin, self.extent, self.unit)

    def samples(self, weights: ArrayLike | None = None) -> Samples:
        """Return the valid pixels, row by row, as samples at s = j / (columns - 1), t = i / (rows - 1).

        **Arguments:**

        - `weights`: (rows, columns) or one per valid pixel; not negative.

        **Raises:** `InputError` when every pixel is missing, and for a map of a single row or column.

        >>> HeightMap([[0.0, 1.0], [float("nan"), 2.0]]).samples().parameters
        array([[0., 0.],
               [1., 0.],
               [1., 1.]])
        """
        frame = self.frame
        index = np.flatnonzero(self.valid)
        if not index.size:
            raise InputError(f"every one of the {self.heights.size} heights is missing (NaN): there is nothing to fit")
        rows, columns = self.shape
        row, column = np.divmod(index, columns)
        parameters = np.stack([column / (columns - 1), row / (rows - 1)], axis=1)
        chosen = None if weights is None else np.asarray(weights)
        if chosen is not None and chosen.shape == self.shape:
            chosen = chosen.ravel()[index]
        return Samples(parameters, self.heights.ravel()[index], chosen, frame, self.shape, index)

    def crop(self, x0: float | str, y0: float | str, x1: float | str, y1: float | str) -> "HeightMap":
        """Return the pixels whose centres lie in [x0, x1] × [y0, y1].

        **Arguments:**

        - `x0`, `y0`, `x1`, `y1`: positions in the map's unit, its origin included, or text such as `"5µm"`.

        **Raises:** `InputError` when the rectangle is empty or holds no pixel.

        >>> HeightMap([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]).crop(1, 0, 2, 1).heights
        array([[2., 3.],
               [5., 6.]])
        """
        low = parse_length(x0, self.unit), parse_length(y0, self.unit)
        high = parse_length(x1, self.unit), parse_length(y1, self.unit)
        rows, columns = self.shape
        across = _pixels_between(low[0], high[0], self.origin[0], self.spacing[0], columns, "x")
        down = _pixels_between(low[1], high[1], self.origin[1], self.spacing[1], rows, "y")
        origin = (
            self.origin[0] + across.start * self.spacing[0],
            self.origin[1] + down.start * self.spacing[1],
        )
        provenance = recorded(self.provenance, f"crop {low[0]:g},{low[1]:g},{high[0]:g},{high[1]:g}", self.unit)
        filled = None if self.filled is None else self.filled[down, across]
        return replace(self, heights=self.heights[down, across], origin=origin, provenance=provenance, filled=filled)

    def with_mask(self, mask: Bool[ArrayLike, "rows columns"]) -> "HeightMap":
        """Return the map with further pixels missing, where `mask` is True (or not zero).

        >>> HeightMap([[1.0, 2.0]]).with_mask([[True, False]]).heights
        array([[nan,  2.]])
        """
        missing = mask_array(mask, self.shape)
        provenance = recorded(self.provenance, f"mask {int(missing.sum())} pixels")
        return replace(self, heights=np.where(missing, np.nan, self.heights), provenance=provenance)

    def with_heights(self, heights: Real[ArrayLike, "rows columns"]) -> "HeightMap":
        """Return a map of other heights, in the same unit, over the same pixels.

        >>> HeightMap([[1.0, 2.0]], unit="nm").with_heights([[3.0, 4.0]]).unit
        'nm'
        """
        array = _height_array(heights)
        if array.shape != self.shape:
            raise InputError(f"the new heights must have the shape of the map, {self.shape}, but got {array.shape}")
        return replace(self, heights=array)

    def derived(self, heights: Real[ArrayLike, "rows columns"], operation: str, unit: str | None = None) -> "HeightMap":
        """Return what an operation made of this map: missing where this one is, in its precision, marks kept.

        **Arguments:**

        - `heights`: in the map's unit; `operation` goes to the end of the list in `provenance`, and `unit` after it.

        >>> HeightMap([[1.0, np.nan]]).derived([[3.0, 4.0]], "smoothed").provenance
        {'operations': ['smoothed']}
        """
        known = np.where(self.valid, heights, np.nan).astype(self.heights.dtype)
        return replace(self.with_heights(known), provenance=recorded(self.provenance, operation, unit))

    def to_unit(self, unit: str) -> "HeightMap":
        """Return the same surface with spacing, origin and heights in another unit.

        **Raises:** `InputError` for a map whose unit is unknown.

        >>> HeightMap([[1.0, 2.0]], spacing=(3.0, 4.0), unit="mm").to_unit("µm").spacing
        (3000.0, 4000.0)
        """
        if self.unit is None:
            raise InputError(f"a map of unknown unit cannot be converted to {unit!r}; state its unit= (--unit)")
        factor = unit_factor(self.unit, unit)
        return HeightMap(
            self.heights,
            (self.spacing[0] * factor, self.spacing[1] * factor),
            unit,
            self.unit,
            origin=(self.origin[0] * factor, self.origin[1] * factor),
            provenance=self.provenance,
            filled=self.filled,
        )


def _height_array(heights: ArrayLike) -> np.ndarray:
    array = real_array(heights, "heights")
    if array.ndim != 2:
        raise InputError(f"heights are a 2-D array (rows, columns), but got {array.ndim}-D of shape {array.shape}")
    if not array.size:
        raise InputError(f"heights must hold at least one pixel, but the array is empty, of shape {array.shape}")
    return array


def _filled_mask(filled: ArrayLike | None, heights: np.ndarray) -> np.ndarray | None:
    """Which heights were filled in; missing ones were not."""
    if filled is None:
        return None
    return frozen(mask_array(filled, heights.shape) & ~np.isnan(heights))


def checked_spacing(spacing: float | Sequence[float]) -> tuple[float, float]:
    pair = (spacing, spacing) if np.ndim(spacing) == 0 else spacing
    dx, dy = finite_pair(pair, "a spacing (dx, dy)")
    if dx <= 0 or dy <= 0:
        raise InputError(f"a spacing (dx, dy) must be positive, but got ({dx:g}, {dy:g})")
    return dx, dy


def _convert_heights(array: np.ndarray, unit: str | None, height_unit: str | None) -> None:
    if height_unit is None or height_unit == unit:
        return
    if unit is None:
        raise InputError(
            f"heights in {height_unit} need the unit of the spacing, too, because one unit serves x, y and z; "
            "give unit= (--unit)"
        )
    with np.errstate(over="ignore"):
        array *= unit_factor(height_unit, unit)
    if np.isinf(array).any():
        raise InputError(f"heights overflow {array.dtype} when converted from {height_unit} to {unit}; use float64")


def _pixels_between(low: float, high: float, start: float, step: float, count: int, name: str) -> slice:
    if low > high:
        raise InputError(f"a crop X0,Y0,X1,Y1 needs {name}0 ≤ {name}1, but got {low:g} and {high:g}")
    first = max(int(np.ceil((low - start) / step - _ON_EDGE)), 0)
    last = min(int(np.floor((high - start) / step + _ON_EDGE)), count - 1)
    if first > last:
        raise InputError(
            f"the crop from {name} = {low:g} to {high:g} holds no pixel: "
            f"the map runs from {start:g} to {start + (count - 1) * step:g}"
        )
    return slice(first, last + 1)


def _percentage(valid: np.ndarray) -> str:
    share = 100.0 * float(valid.mean())
    return "100" if share == 100.0 else f"{min(share, 99.9):.3g}"
