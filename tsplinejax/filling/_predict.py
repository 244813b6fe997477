"""One filler's prediction for a whole map: window after window, deep holes from coarse to fine.

A pixel far from everything known is told by the coarse shape of what surrounds it. So pixels deeper than a limit are
filled first on a map of half the resolution (and those deep even there on a quarter, and so on); at full resolution
they then count as known.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.ndimage import binary_dilation, map_coordinates
from threadpoolctl import threadpool_limits

from ._filler import AbstractFiller, Field
from ._holes import depth_of, windows

#: Holes deeper than the first are begun on a coarser map; pixels deeper than the second are taken from it.
_DEEP, _PINNED = 18.0, 12.0


def predict(
    filler: AbstractFiller, field: Field, wanted: Bool[np.ndarray, "rows columns"]
) -> Float[np.ndarray, "rows columns"]:
    """The field's heights with the wanted pixels filled; others that are missing stay so."""
    depth = depth_of(np.isnan(field.heights))
    deep = wanted & (depth > _PINNED)
    heights = field.heights.copy()
    every = wanted
    if deep.any() and depth[wanted].max() > _DEEP and min(heights.shape) >= 8:
        heights[deep] = _from_coarser(filler, field, deep)
        field, wanted = replace(field, heights=heights.copy()), wanted & ~deep
        depth = depth_of(np.isnan(heights))
    fill = filler.prepare(field)
    parts = list(windows(wanted, depth, filler.margin))
    # The factorisations are small: BLAS threads within each only wait for one another.
    with threadpool_limits(1, "blas"), ThreadPoolExecutor(os.cpu_count()) as pool:
        for window, values in zip(parts, pool.map(fill, parts), strict=True):
            heights[window.rows, window.columns][window.wanted] = values
    if field.low is not None and field.high is not None:
        heights[every] = np.clip(heights[every], field.low[every], field.high[every])
    return heights


def _from_coarser(
    filler: AbstractFiller, field: Field, deep: Bool[np.ndarray, "rows columns"]
) -> Float[np.ndarray, " deep"]:
    """Heights of the deep pixels, predicted on a map of half the resolution."""

    coarse = halved(field.heights)
    wanted = np.isnan(coarse) & binary_dilation(halved(np.where(deep, 1.0, np.nan), 1) == 1, iterations=2)
    if np.isnan(coarse).all():
        return np.full(int(deep.sum()), np.nanmean(field.heights))
    filled = predict(filler, replace(field, heights=coarse, low=None, high=None), wanted)
    filled[np.isnan(filled)] = np.nanmean(coarse)
    places = (np.argwhere(deep).T - 0.5) / 2
    return map_coordinates(filled, places, order=1, mode="nearest")


def halved(heights: Float[np.ndarray, "rows columns"], least: int = 4) -> Float[np.ndarray, "half_rows half_columns"]:
    """Means of blocks of 2 × 2 pixels; missing where fewer than `least` of them are known: the mean of some of them is
    that of another place, and what bends least through a rim feels it far into the hole.

    >>> halved(np.array([[1.0, 3.0], [np.nan, 2.0]], float), 3)
    array([[2.]])
    """
    rows, columns = heights.shape
    padded = np.pad(heights, ((0, rows % 2), (0, columns % 2)), constant_values=np.nan)
    blocks = padded.reshape(len(padded) // 2, 2, -1, 2).swapaxes(1, 2).reshape(len(padded) // 2, -1, 4)
    known = np.isfinite(blocks)
    counts = known.sum(axis=-1)
    sums = np.where(known, blocks, 0).sum(axis=-1)
    return np.where(counts >= least, sums / np.maximum(counts, 1), np.nan)
