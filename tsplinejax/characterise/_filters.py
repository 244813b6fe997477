"""Operations on height maps in the order of ISO 25178: S-filter, F-operation (levelling), L-filter.

The filters are Gaussian (ISO 16610-61): s(x, y) = exp(-π (x² + y²) / (α λc)²) / (α λc)², α = √(ln 2 / π), which lets
50 % of a wave of length λc through. Missing pixels and what is beyond the border weigh nothing: the sum of the weights
that are left divides the weighted sum. Missing pixels stay missing. Every operation records itself in the data's
`provenance["operations"]`.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.signal import oaconvolve

from .._errors import InputError
from ..data import HeightMap, PointCloud, as_data, parse_length
from ..data._provenance import recorded
from ._fit_form import fit_form
from ._simple_forms import AbstractSimpleForm

_REACH = 1.0  # the kernel's half width in cut-offs; less than 1e-6 of its weight lies beyond


def s_filter(data: Any, cutoff: float | str) -> HeightMap:
    """Take the short waves off a height map: the Gaussian filter's mean surface.

    **Arguments:**

    - `data`: a height map (see `as_data`) whose spacing is known.
    - `cutoff`: the wavelength of which half is let through, in the map's unit, or with one: `"2.5um"`.

    **Returns:** the filtered map; missing pixels stay missing.

    **Raises:** `InputError` for a point cloud, for a bare array, whose spacing is unknown, and for a cut-off below
    two pixels or above the map.

    >>> waves = np.cos(2 * np.pi * np.arange(400) / 40) * np.ones((50, 1))
    >>> round(float(s_filter(HeightMap(waves, 0.1, "mm"), "4mm").heights[25, 200]), 3)
    0.5
    """
    height_map, length = checked_cutoff(data, cutoff, "S-filter")
    heights = gaussian_mean(height_map.heights, height_map.spacing, length)
    return height_map.derived(heights, f"S-filter Gaussian ISO 16610-61, cut-off {length:g}", height_map.unit)


def l_filter(data: Any, cutoff: float | str) -> HeightMap:
    """Take the long waves off a height map: the map minus the Gaussian filter's mean surface.

    Arguments, result and errors are those of [`s_filter`][tsplinejax.s_filter].

    >>> waves = np.cos(2 * np.pi * np.arange(400) / 40) * np.ones((50, 1))
    >>> round(float(l_filter(HeightMap(waves, 0.1, "mm"), "4mm").heights[25, 200]), 3)
    0.5
    """
    height_map, length = checked_cutoff(data, cutoff, "L-filter")
    mean = gaussian_mean(height_map.heights, height_map.spacing, length)
    operation = f"L-filter Gaussian ISO 16610-61, cut-off {length:g}"
    return height_map.derived(height_map.heights - mean, operation, height_map.unit)


def level(data: Any, form: AbstractSimpleForm | str = "plane") -> HeightMap | PointCloud:
    """Take a simple form off the heights: the least-squares F-operation, along z.

    **Arguments:**

    - `data`: a height map or point cloud (see `as_data`).
    - `form`: `"plane"`, `"polyN"`, `"sphere"`, `"cylinder"`, or the forms themselves, as `Polynomial(2)`.

    **Returns:** the data with the form's height subtracted from z.

    **Raises:** `InputError` as for [`fit_form`][tsplinejax.fit_form]; for a sphere or cylinder on a bare array, too,
    whose spacing is unknown.

    >>> x = np.arange(5.0)
    >>> level(HeightMap(np.add.outer(2 * x, 3 * x))).range < 1e-12
    True
    """
    data = as_data(data)
    fitted = fit_form(data, form, distance="vertical")
    if "radius" in fitted.values:
        require_scale(data, f"a {fitted.form.name}")
    operation = f"F-operation {fitted.form.name}, least squares along z: {_numbers(fitted.values)}"
    if isinstance(data, PointCloud):
        points = np.column_stack([data.points[:, :2], fitted.residuals]).astype(data.points.dtype)
        provenance = recorded(data.provenance, operation)
        return PointCloud(points, data.unit, triangles=data.triangles, provenance=provenance)
    heights = np.full(data.shape, np.nan, data.heights.dtype)
    heights[data.valid] = fitted.residuals
    return data.derived(heights, operation, data.unit)


def require_scale(data: HeightMap | PointCloud, what: str) -> None:
    """Refuse a bare array: its spacing is no length, so it cannot be mixed with heights.

    **Raises:** `InputError`, naming the options.
    """
    if isinstance(data, HeightMap) and data.unit is None and data.spacing == (1.0, 1.0):
        raise InputError(
            f"{what} mixes x, y and z or is a length, but this map's spacing and unit are unknown; state them: "
            "HeightMap(heights, spacing, unit) (--spacing, --unit)"
        )


def gaussian_mean(
    heights: Float[np.ndarray, "rows columns"], spacing: tuple[float, float], cutoff: float
) -> Float[np.ndarray, "rows columns"]:
    """The weighted mean around every pixel, in the heights' precision; NaN where the pixel is missing."""
    valid = ~np.isnan(heights)
    centre = float(np.mean(heights, where=valid)) if valid.any() else 0.0
    total = np.where(valid, heights.astype(np.float64) - centre, 0.0)
    weight = valid.astype(np.float64)
    for axis, step in ((1, spacing[0]), (0, spacing[1])):
        kernel = _kernel(cutoff / step, heights.shape[axis])
        shape = (-1, 1) if axis == 0 else (1, -1)
        total, weight = (
            oaconvolve(part, kernel.reshape(shape), mode="same", axes=axis) if len(kernel) > 1 else part
            for part in (total, weight)
        )
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(valid, total / weight + centre, np.nan).astype(heights.dtype)


def _kernel(cutoff: float, count: int) -> Float[np.ndarray, " k"]:
    """The Gaussian's weights along one direction, for a cut-off in pixels; no longer than reaches across the map."""
    half = min(math.ceil(_REACH * cutoff), count - 1)
    alpha = math.sqrt(math.log(2) / math.pi)
    weights = np.exp(-math.pi * (np.arange(-half, half + 1) / (alpha * cutoff)) ** 2)
    return weights / weights.sum()


def checked_cutoff(data: Any, cutoff: float | str, what: str) -> tuple[HeightMap, float]:
    """A height map of known spacing, and the cut-off in its unit; `what` is the filter that is asked for.

    **Raises:** `InputError` for a point cloud, a map of unknown spacing, and a cut-off that says nothing on this map.
    """
    height_map = as_data(data)
    if isinstance(height_map, PointCloud):
        raise InputError(
            f"an {what} works on a height map, but got a point cloud; take its texture_map (remove_form), or leave the "
            "filter out"
        )
    require_scale(height_map, "a cut-off")
    length = parse_length(cutoff, height_map.unit)
    finest, longest = 2 * min(height_map.spacing), max(height_map.extent)
    if not finest <= length <= longest:
        unit = height_map.unit or ""
        raise InputError(
            f"a cut-off lies between two pixels and the map's longer side, {finest:g} to {longest:g} {unit}; "
            f"received {length:g} {unit}".rstrip()
        )
    return height_map, length


def _numbers(values: Mapping[str, Any]) -> str:
    """A form's numbers on one line, to ten digits."""
    shown = ((name, np.asarray(value)) for name, value in values.items() if name != "exponents")
    return ", ".join(f"{name} {np.array2string(value, precision=10, max_line_width=10**6)}" for name, value in shown)
