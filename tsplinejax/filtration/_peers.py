"""Filters of others in the same call style, to compare with: `filter`'s neighbours, not its parts.

The Gaussian filter of ISO 16610-61 is [`s_filter`][tsplinejax.s_filter]. The spline filter of ISO 16610-62 here has one
knot a pixel; missing pixels weigh nothing in both. The filters of scikit-image know no missing pixels and refuse them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from .._errors import InputError
from ..characterise._filters import checked_cutoff
from ..data import HeightMap, PointCloud, as_data, parse_length
from ._separable import Smoother, pixel_axis

Length = float | str


def spline_filter(data: Any, cutoff: Length) -> HeightMap:
    """Take the short waves off by the spline filter of ISO 16610-62, with one knot a pixel.

    (1 + α_x⁴ Q_x + 2 α_x² α_y² P_x P_y + α_y⁴ Q_y) w = z, with P and Q the squares of first and second differences
    without conditions at the border, and α = 1 / (2 sin(π Δ / λc)) (ISO 16610-22).

    **Arguments:**

    - `data`: a height map (see `as_data`) whose spacing is known.
    - `cutoff`: the wavelength of which half is let through, in the map's unit, or with one: `"2.5um"`.

    **Returns:** the filtered map; missing pixels weigh nothing and stay missing.

    **Raises:** `InputError` as [`s_filter`][tsplinejax.s_filter] does.

    >>> waves = np.cos(2 * np.pi * np.arange(401) / 40) * np.ones((9, 1))
    >>> round(float(spline_filter(HeightMap(waves, 0.1, "mm"), "4mm").heights[4, 200]), 3)
    0.5
    """
    height_map, length = checked_cutoff(data, cutoff, "spline filter")
    if length <= 2 * max(height_map.spacing):
        raise InputError(f"the spline filter's cut-off is above two pixels along both axes; received {cutoff!r}")
    (rows, columns), (dx, dy) = height_map.shape, height_map.spacing
    centre = float(np.mean(height_map.heights, where=height_map.valid, dtype=np.float64))
    equations = Smoother(pixel_axis(rows, dy, length), pixel_axis(columns, dx, length), height_map.valid, 1.0)
    heights, _ = equations.solve(height_map.heights.astype(np.float64) - centre)
    operation = f"filter spline ISO 16610-62, cut-off {length:g}"
    return height_map.derived(heights + centre, operation, height_map.unit)


def bilateral_filter(data: Any, *, sigma_length: Length, sigma_height: Length) -> HeightMap:
    """Average over near pixels of like height: scikit-image's bilateral filter (Tomasi and Manduchi, 1998).

    **Arguments:**

    - `data`: a height map (see `as_data`) of square pixels, none of them missing.
    - `sigma_length`: standard deviation of the distance along the surface; `sigma_height`: of the height difference.

    **Raises:** `InputError` for missing pixels, pixels that are not square, and lengths that are not positive.

    >>> bilateral_filter(np.eye(8), sigma_length=1.0, sigma_height=0.1).shape
    (8, 8)
    """
    height_map = _gapless(data)
    length, height = _positive(height_map, sigma_length), _positive(height_map, sigma_height)

    def run(image: np.ndarray, scale: float) -> np.ndarray:
        from skimage.restoration import denoise_bilateral

        pixels = length / height_map.spacing[0]
        return denoise_bilateral(image, sigma_color=height / scale, sigma_spatial=pixels, mode="edge")

    return _scaled(height_map, run, f"filter bilateral, σ {length:g} along the surface, {height:g} in height")


def total_variation_filter(data: Any, *, weight: Length) -> HeightMap:
    """Minimise Σ (z - f)² / 2 + weight · Σ |∇f|: scikit-image's total variation filter (Chambolle, 2004).

    **Arguments:**

    - `data`: a height map (see `as_data`) of square pixels, none of them missing.
    - `weight`: how much variation costs, a height.

    **Raises:** `InputError` as [`bilateral_filter`][tsplinejax.filtration.bilateral_filter] does.

    >>> total_variation_filter(np.eye(8), weight=0.1).shape
    (8, 8)
    """
    height_map = _gapless(data)
    height = _positive(height_map, weight)

    def run(image: np.ndarray, scale: float) -> np.ndarray:
        from skimage.restoration import denoise_tv_chambolle

        return denoise_tv_chambolle(image, weight=height / scale, eps=1e-6, max_num_iter=1000)

    return _scaled(height_map, run, f"filter total variation, weight {height:g}")


def non_local_means_filter(data: Any, *, strength: Length, patch: int = 7, reach: int = 11) -> HeightMap:
    """Average over pixels with like surroundings: scikit-image's non-local means filter (Buades et al., 2005).

    **Arguments:**

    - `data`: a height map (see `as_data`) of square pixels, none of them missing.
    - `strength`: how far patches may differ, a height.
    - `patch`, `reach`: side of a patch and distance of the search, in pixels.

    **Raises:** `InputError` as [`bilateral_filter`][tsplinejax.filtration.bilateral_filter] does.

    >>> non_local_means_filter(np.eye(8), strength=0.1, patch=3, reach=3).shape
    (8, 8)
    """
    height_map = _gapless(data)
    height = _positive(height_map, strength)

    def run(image: np.ndarray, scale: float) -> np.ndarray:
        from skimage.restoration import denoise_nl_means

        return denoise_nl_means(image, patch_size=patch, patch_distance=reach, h=height / scale)

    return _scaled(height_map, run, f"filter non-local means, strength {height:g}")


def _gapless(data: Any) -> HeightMap:
    """A map that scikit-image can filter."""
    height_map = as_data(data)
    if isinstance(height_map, PointCloud):
        raise InputError("this filter works on a height map, but got a point cloud")
    missing = int(np.count_nonzero(~height_map.valid))
    if missing:
        raise InputError(f"this filter knows no missing pixels, but {missing} are; fill them, or use filter")
    dx, dy = height_map.spacing
    if abs(dx - dy) > 1e-6 * dx:
        raise InputError(f"this filter needs square pixels, but the spacing is ({dx:g}, {dy:g}); use filter")
    return height_map


def _positive(height_map: HeightMap, length: Length) -> float:
    value = parse_length(length, height_map.unit)
    if value <= 0:
        raise InputError(f"a filter's lengths and weights are above zero; received {length!r}")
    return value


def _scaled(height_map: HeightMap, run: Callable[[np.ndarray, float], np.ndarray], operation: str) -> HeightMap:
    """Run a filter for images on heights scaled to [0, 1]."""
    lowest, scale = float(height_map.heights.min()), height_map.range or 1.0
    image = (height_map.heights.astype(np.float64) - lowest) / scale
    return height_map.derived(run(image, scale) * scale + lowest, operation, height_map.unit)
