"""Neighbourhoods of samples, on a grid and scattered, and the gap that sets a few of their heights apart.

Neighbourhoods are rows of a matrix, (m, k), NaN where a place is missing, so that grids and clouds share one kernel.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

_HALF = 3
_LARGEST_CLUSTER = 16
_FEWEST_OTHERS = 8


class Gap(NamedTuple):
    """Where sorted neighbourhoods split: highest height below the gap, size of the gap, size over spread; (m,) each."""

    level: Float[np.ndarray, " m"]
    size: Float[np.ndarray, " m"]
    contrast: Float[np.ndarray, " m"]


def upper_gap(
    neighbourhoods: Float[np.ndarray, "m k"], values: Float[np.ndarray, " m"], floor: float, *, share: float = 0.25
) -> Gap:
    """Find the gap that best sets each value, and at most a few neighbours with it, above the rest.

    With heights sorted downwards, h_1 ≥ h_2 ≥ ..., a split after the r-th is judged by
    (h_r − h_(r+1)) / max(spread of the rest, floor). The lowest tenth does not count in the spread: a dip nearby must
    not hide a spike.

    **Arguments:**

    - `neighbourhoods`: (m, k), heights around each value and the value itself, NaN where missing.
    - `values`: (m,), the heights judged.
    - `floor`: the least spread, what rounding alone may do.
    - `share`: the largest part of a neighbourhood that may stand above the gap (and never more than sixteen heights).

    **Returns:** `Gap`; its contrast is 0 where the neighbourhood is too small to judge.

    >>> upper_gap(np.array([[9.0, 0, 0, 1, 0, 1, 0, 0, 1, 0, 1, 0]]), np.array([9.0]), 0.1).contrast
    array([8.])
    """
    ordered = -np.sort(-neighbourhoods, axis=1)
    count = np.count_nonzero(np.isfinite(ordered), axis=1)
    allowed = np.minimum(np.minimum(_LARGEST_CLUSTER, (count * share).astype(int)), count - _FEWEST_OTHERS)
    most = max(int(allowed.max(initial=0)), 1)
    lowest = np.take_along_axis(ordered, np.maximum(count - 1 - count // 10, 0)[:, None], axis=1)
    upper, lower = ordered[:, :most], ordered[:, 1 : most + 1]
    with np.errstate(invalid="ignore"):
        contrast = (upper - lower) / np.maximum(lower - lowest, floor)
        usable = (upper <= values[:, None]) & (np.arange(1, most + 1) <= allowed[:, None])
    contrast = np.where(usable & np.isfinite(contrast), contrast, 0.0)
    best = contrast.argmax(axis=1)[:, None]
    level, top, best_contrast = (np.take_along_axis(part, best, axis=1)[:, 0] for part in (lower, upper, contrast))
    return Gap(level, top - level, best_contrast)


def pixel_half_widths(shape: tuple[int, int]) -> tuple[int, int]:
    """Half widths (rows, columns) of a pixel's neighbourhood: 7 × 7, or about 49 pixels along a narrow map.

    >>> pixel_half_widths((500, 400)), pixel_half_widths((1, 400))
    ((3, 3), (0, 24))
    """
    rows, cols = shape
    if min(rows, cols) > 2 * _HALF or max(rows, cols) <= 4 * _HALF:
        return _HALF, _HALF
    narrow = min(rows, cols) - 1
    long = max(_HALF, 24 // (2 * narrow + 1))
    return (narrow, long) if rows <= cols else (long, narrow)


def pixel_neighbourhoods(
    padded: Float[np.ndarray, "padded_rows padded_cols"], pixels: Int[np.ndarray, "2 m"], half: tuple[int, int]
) -> Float[np.ndarray, "m k"]:
    """Gather the windows around pixels of a map that has been padded by `half` on each side.

    **Arguments:**

    - `padded`: the map with `half` rows and columns of NaN around it.
    - `pixels`: (2, m), rows and columns in the map itself.
    - `half`: half widths of the window, rows and columns.

    >>> pixel_neighbourhoods(np.arange(9.0).reshape(3, 3), np.array([[0], [0]]), (1, 1))
    array([[0., 1., 2., 3., 4., 5., 6., 7., 8.]])
    """
    rows = np.arange(2 * half[0] + 1)[:, None]
    offsets = (rows * padded.shape[1] + np.arange(2 * half[1] + 1)).ravel()
    corners = pixels[0] * padded.shape[1] + pixels[1]
    return padded.ravel()[corners[:, None] + offsets]


def sliding_extreme(array: np.ndarray, width: int, axis: int, extreme: np.ufunc) -> np.ndarray:
    """Reduce every run of `width` entries along an axis with `np.minimum` or `np.maximum`; the axis shrinks by width-1.

    Doubling: runs of 2, 4, ... are combined, so the cost grows with the logarithm of the width.

    >>> sliding_extreme(np.array([3, 1, 2, 5]), 3, 0, np.minimum)
    array([1, 1])
    """
    array = np.moveaxis(array, axis, 0)
    run = 1
    while run < width:
        shift = min(run, width - run)
        array = extreme(array[shift:], array[:-shift])
        run += shift
    return np.moveaxis(array, 0, axis)


def top_hat(
    heights: Float[np.ndarray, "rows cols"], valid: Bool[np.ndarray, "rows cols"], width: int = 5
) -> Float[np.ndarray, "rows cols"]:
    """Height above the opening: how far a pixel stands above every `width` × `width` square that holds it.

    A square counts only if more than half of its pixels are valid, so that a cluster of fewer never supports itself;
    a pixel in no such square gets +∞. Zero on a plane. Missing pixels get NaN.

    >>> top_hat(np.pad([[7.0]], 4), np.ones((9, 9), bool)).max()
    np.float64(7.0)
    """
    pad = width - 1
    lifted = np.pad(np.where(valid, heights, np.inf), pad, constant_values=np.inf)
    eroded = _both(lifted, width, np.minimum)
    if not valid.all() or min(valid.shape) < width:
        full = np.cumsum(np.pad(valid, ((pad + 1, pad), (pad + 1, pad))), axis=0, dtype=np.int32).cumsum(axis=1)
        count = full[width:, width:] - full[:-width, width:] - full[width:, :-width] + full[:-width, :-width]
        eroded = np.where(count > width * width // 2, eroded, -np.inf)
    else:
        # Squares that reach over the border hold few pixels: at most `width // 2` of their rows may lie outside.
        eroded = _without_far_squares(eroded, width)
    return np.where(valid, heights - _both(eroded, width, np.maximum), np.nan)


def _both(array: np.ndarray, width: int, extreme: np.ufunc) -> np.ndarray:
    return sliding_extreme(sliding_extreme(array, width, 0, extreme), width, 1, extreme)


def _without_far_squares(eroded: np.ndarray, width: int) -> np.ndarray:
    inside = np.full(eroded.shape, -np.inf, eroded.dtype)
    edge = width - 1
    inside[edge:-edge, edge:-edge] = eroded[edge:-edge, edge:-edge]
    return inside
