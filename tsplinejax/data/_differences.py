"""Levels of differences of a grid of heights: how rough it is at each order, lag and direction.

The p-th difference at lag h of white noise has variance C(2p, p) σ². Divided by that root, differences of all orders
and lags agree on noise, while those of a smooth surface fall with the order and grow as h^p. A level is what is common
to most of the undisturbed map: the median of |difference| in each block of 256 pixels, and of the blocks' medians
the densest value (half-sample mode of the logarithms), so that neither spikes nor edges nor bumps over half of the map
count.

For noise of correlation ρ along the direction, level² = σ² Σ_k c_k ρ(k h), c_k = (−1)^k C(2p, p + k) / C(2p, p) for k
from −p to p: linear in ρ, so levels at short lags give the correlation once those at long lags have given σ.
"""

from math import comb

import numpy as np
from jaxtyping import Float
from scipy.optimize import lsq_linear

ORDERS = (3, 4, 6)
LAGS = (1, 2, 3, 4, 6, 8)
_BLOCK = 16
_WINDOW = 256
_WINDOWS = 8
_LONGEST = 7


def difference(heights: np.ndarray, order: int, lag: int, axis: int) -> np.ndarray:
    """Return the difference of an order at a lag, scaled to keep the standard deviation of white noise.

    >>> difference(np.array([[0.0, 1.0, 4.0, 9.0]]), 2, 1, axis=1) * np.sqrt(6)
    array([[2., 2.]])
    """
    heights = np.moveaxis(heights, axis, -1)
    for _ in range(order):
        heights = heights[..., lag:] - heights[..., :-lag] if heights.shape[-1] > lag else heights[..., :0]
    return np.moveaxis(heights, -1, axis) / np.sqrt(comb(2 * order, order))


def windows(heights: Float[np.ndarray, "rows cols"]) -> list[np.ndarray]:
    """The map itself, or of a large one about eight windows spread evenly over it.

    >>> len(windows(np.zeros((4000, 3000))))
    9
    """
    if heights.size <= _WINDOWS * _WINDOW**2:
        return [heights]
    down = int(np.clip(round(np.sqrt(_WINDOWS * heights.shape[0] / heights.shape[1])), 1, _WINDOWS))
    tops = _spread(heights.shape[0], down)
    lefts = _spread(heights.shape[1], -(-_WINDOWS // down))
    return [heights[i : i + _WINDOW, j : j + _WINDOW] for i in tops for j in lefts]


def _spread(size: int, count: int) -> list[int]:
    """Starts of `count` windows over a length, each in the middle of its share; fewer where they would overlap."""
    count = max(1, min(count, size // _WINDOW))
    return [max(0, round((k + 0.5) * size / count - _WINDOW / 2)) for k in range(count)]


def block_medians(values: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, " blocks"]:
    """Medians over blocks of about 256 pixels; NaN for a block that is more than half missing.

    >>> block_medians(np.ones((32, 40))).shape
    (4,)
    """
    high = min(_BLOCK, values.shape[0])
    wide = min(_BLOCK * _BLOCK // max(high, 1), values.shape[1])
    if high == 0 or wide == 0:
        return np.zeros(0)
    down, across = values.shape[0] // high, values.shape[1] // wide
    blocks = values[: down * high, : across * wide].reshape(down, high, across, wide)
    blocks = blocks.swapaxes(1, 2).reshape(down * across, high * wide)
    ordered = np.sort(blocks, axis=1)
    count = np.count_nonzero(np.isfinite(ordered), axis=1)
    index = np.arange(len(ordered))
    medians = (
        ordered[index, np.maximum(count - 1, 0) // 2] + ordered[index, np.minimum(count // 2, high * wide - 1)]
    ) / 2
    return np.where(2 * count > high * wide, medians, np.nan)


def dense_level(values: Float[np.ndarray, " n"]) -> float:
    """The densest value of positive numbers that range over decades: half-sample mode, then a mean around it.

    Zero if most of them are zero, NaN if there are none.

    >>> round(dense_level(np.array([1.0, 1.01, 0.99, 1.02, 7.0, 30.0, 200.0])), 2)
    1.0
    """
    values = values[np.isfinite(values)]
    if len(values) == 0:
        return float("nan")
    positive = np.sort(np.log(values[values > 0]))
    if 2 * len(positive) < len(values):
        return 0.0
    part = positive
    while len(part) > 3:
        half = (len(part) + 1) // 2
        first = int((part[half - 1 :] - part[: len(part) - half + 1]).argmin())
        part = part[first : first + half]
    mode = part.mean()
    for _ in range(6):
        mode = positive[np.abs(positive - mode) <= max(0.2, np.abs(positive - mode).min())].mean()
    return float(np.exp(mode))


def levels(
    heights: Float[np.ndarray, "rows cols"], scale: Float[np.ndarray, "rows cols"] | None = None
) -> Float[np.ndarray, "2 orders lags"]:
    """The level of every difference: direction (0: along x, 1: along y) by `ORDERS` by `LAGS`; NaN where none fits.

    **Arguments:**

    - `heights`: (rows, cols), NaN where missing.
    - `scale`: what each difference is divided by, at its middle, for noise that varies from place to place.

    >>> noise = np.random.default_rng(0).normal(size=(128, 128))
    >>> bool(np.all(np.abs(levels(noise) - 1) < 0.2))
    True
    """
    parts = windows(heights)
    scales = [None] * len(parts) if scale is None else windows(scale)
    result = np.full((2, len(ORDERS), len(LAGS)), np.nan)
    for direction, axis in enumerate((1, 0)):
        for i, order in enumerate(ORDERS):
            for j, lag in enumerate(LAGS):
                blocks = [
                    block_medians(_scaled(np.abs(difference(part, order, lag, axis)), of_part, axis))
                    for part, of_part in zip(parts, scales, strict=True)
                ]
                result[direction, i, j] = dense_level(np.concatenate(blocks)) / 0.6745
    return result


def _scaled(values: np.ndarray, scale: np.ndarray | None, axis: int) -> np.ndarray:
    """Values over the scale at the middle of the differences they come from."""
    if scale is None:
        return values
    start = (scale.shape[axis] - values.shape[axis]) // 2
    return values / np.take(scale, np.arange(start, start + values.shape[axis]), axis=axis)


def correlation_of(squares: Float[np.ndarray, "orders lags"], far: float) -> Float[np.ndarray, " seven"]:
    """Autocorrelation at lags 1 to 7 pixels from levels² over σ², `far` being the correlation at longer lags.

    >>> np.round(correlation_of(np.ones((3, 6)), 0.0), 6) + 0.0
    array([0., 0., 0., 0., 0., 0., 0.])
    """
    rows, right = [], []
    for order, of_order in zip(ORDERS, squares, strict=True):
        for lag, square in zip(LAGS, of_order, strict=True):
            row, rest = np.zeros(_LONGEST), 1.0
            for k in range(1, order + 1):
                weight = 2 * (-1) ** k * comb(2 * order, order + k) / comb(2 * order, order)
                if k * lag <= _LONGEST:
                    row[k * lag - 1] += weight
                else:
                    rest += weight * far
            if np.isfinite(square):
                rows.append(row)
                right.append(square - rest)
    if not rows:
        return np.zeros(_LONGEST)
    bounds = (-0.5, 1.0)
    return lsq_linear(np.array(rows), np.array(right), bounds).x
