"""Noise that grows with the slope of the surface: σ(g) = floor + coefficient · g.

Lateral jitter, vibration and the loss of light on steep flanks all make noise grow with the slope. Pixels are sorted
into classes of slope; in each, the median of the fourth and of the sixth differences at lag 1 gives a level. Only
classes count where both agree (on the curvature of a surface they do not) and where the signs of pixels side by side
across the difference agree no more often than on the rest of the map (along an edge they do).
"""

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from ._differences import difference, windows

_SMOOTHING = 2.0
_CLASSES = 12
_AGREE = 1.15
_COHERENT = 0.15


def slopes(heights: Float[np.ndarray, "rows cols"], spacing: tuple[float, float]) -> Float[np.ndarray, "rows cols"]:
    """Slope of the surface smoothed by a Gaussian of two pixels; missing pixels take no part, and get NaN.

    >>> slope = slopes(np.add.outer(np.zeros(9), 3.0 * np.arange(20)), (1.0, 1.0))
    >>> round(float(slope[4, 10]), 6)
    3.0
    """
    valid = np.isfinite(heights)
    if not valid.any():
        return np.full(heights.shape, np.nan)
    offset = heights[valid].mean(dtype=np.float64)
    weight = ndimage.gaussian_filter(valid.astype(np.float64), _SMOOTHING, mode="nearest")
    smooth = ndimage.gaussian_filter(np.where(valid, heights - offset, 0.0), _SMOOTHING, mode="nearest")
    smooth = smooth / np.maximum(weight, 1e-6)
    squares = [
        (np.gradient(smooth, step, axis=axis) if smooth.shape[axis] > 1 else np.zeros_like(smooth)) ** 2
        for axis, step in ((1, spacing[0]), (0, spacing[1]))
    ]
    return np.where(valid, np.sqrt(squares[0] + squares[1]), np.nan)


def slope_dependence(
    heights: Float[np.ndarray, "rows cols"], spacing: tuple[float, float], extra: float = 0.0
) -> tuple[float, float, float] | None:
    """Fit σ(g) = floor + coefficient · g, if noise clearly grows with the slope g.

    **Arguments:**

    - `heights`: (rows, cols), NaN where missing.
    - `spacing`: (dx, dy), so that slopes are physical.
    - `extra`: variance that was added to the heights and does not count.

    **Returns:** floor, coefficient, and the root mean square of σ(g) over the map; `None` if noise does not grow.
    """
    parts = windows(heights)
    slope = [slopes(part, spacing) for part in parts]
    table = _classes(parts, slope, extra)
    if len(table) < _CLASSES // 2:
        return None
    g, sigma, weight = table.T
    design = np.stack([np.ones_like(g), g], axis=1) * weight[:, None]
    floor, coefficient = np.linalg.lstsq(design, sigma * weight, rcond=None)[0]
    span = coefficient * (g.max() - g.min())
    floor = max(floor, 0.0)
    if span < 0.4 * max(floor, sigma.min()) or np.corrcoef(g, sigma)[0, 1] < 0.85:
        return None
    every = np.concatenate([part[np.isfinite(part)] for part in slope])
    return float(floor), float(coefficient), float(np.sqrt(np.mean((floor + coefficient * every) ** 2)))


def _classes(parts: list[np.ndarray], slope: list[np.ndarray], extra: float) -> Float[np.ndarray, "classes 3"]:
    """Rows of slope, noise and weight for the classes of slope in which differences look like noise."""
    pieces = [
        _pixels(part, of_part, axis)
        for part, of_part in zip(parts, slope, strict=True)
        for axis in (0, 1)
        if part.shape[axis] > 8 and part.shape[1 - axis] > 1
    ]
    columns = np.concatenate(pieces, axis=1) if pieces else np.zeros((4, 0))
    fourth, sixth, coherent, steep = columns[:, np.isfinite(columns).all(axis=0)]
    if len(steep) < 100 * _CLASSES:
        return np.zeros((0, 3))
    edges = np.unique(np.quantile(steep, [*np.linspace(0, 0.9, _CLASSES - 2), 0.95, 0.98, 1.0]))
    which = np.clip(np.searchsorted(edges, steep, side="right") - 1, 0, len(edges) - 2)
    classes = [inside for k in range(len(edges) - 1) if np.count_nonzero(inside := which == k) >= 50]
    usual = min((coherent[inside].mean() for inside in classes), default=0.0)
    rows = []
    for inside in classes:
        low, high = sorted(np.median(values[inside]) / 0.6745 for values in (fourth, sixth))
        if high <= _AGREE * low and coherent[inside].mean() <= usual + _COHERENT:
            rows.append((steep[inside].mean(), np.sqrt(max(low * high - extra, 0.0)), np.sqrt(inside.mean())))
    return np.array(rows).reshape(-1, 3)


def _pixels(part: np.ndarray, slope: np.ndarray, axis: int) -> Float[np.ndarray, "4 m"]:
    """Fourth and sixth difference along an axis, agreement of sign with the pixel beside it across it, and slope."""
    across = 1 - axis
    sixth = difference(part, 6, 1, axis)
    fourth = np.take(difference(part, 4, 1, axis), np.arange(1, part.shape[axis] - 5), axis=axis)
    steep = np.take(slope, np.arange(3, part.shape[axis] - 3), axis=axis)
    beside = np.sign(sixth) * np.sign(np.roll(sixth, 1, axis=across))
    return np.stack([np.abs(fourth).ravel(), np.abs(sixth).ravel(), beside.ravel(), steep.ravel()])
