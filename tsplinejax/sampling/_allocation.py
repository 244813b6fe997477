"""How many samples each element gets, and where in it they stand."""

import numpy as np
from jaxtyping import Float, Int

_GOLDEN = 0.6180339887498949


def apportioned(weights: Float[np.ndarray, " e"], size: int) -> Int[np.ndarray, " e"]:
    """How many of `size` samples each element gets: one each, and every further one where a sample stands for most.

    An element of weight w with k samples is k pieces of w / k; the next sample goes to the largest piece (the method of
    highest averages). Fewer samples than elements go to those of the largest weight. Equal elements take turns all over
    the mesh, not from one corner on.

    >>> apportioned(np.array([1.0, 4.0, 1.0]), 6).tolist()
    [1, 4, 1]
    """
    e = len(weights)
    turns = 1 + 1e-9 * (np.arange(e) * _GOLDEN % 1)
    scale = float(weights.max()) or 1.0
    shares = np.maximum(weights / scale, 1e-12) * turns
    if size <= e:
        counts = np.zeros(e, np.int64)
        counts[np.argsort(-shares)[:size]] = 1
        return counts
    low, high = shares.sum() / size / 2, 2.0
    while np.floor(shares / low).sum() <= size - e:
        low /= 2
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if np.floor(shares / middle).sum() > size - e else (low, middle)
    counts = 1 + np.floor(shares / high).astype(np.int64)
    counts[np.argsort(-shares / counts)[: size - counts.sum()]] += 1
    return counts


def in_rows(
    counts: Int[np.ndarray, " e"], shapes: Float[np.ndarray, " e"], *, to_border: bool = False
) -> tuple[Int[np.ndarray, " m"], Float[np.ndarray, "m 2"]]:
    """Samples in even rows in each of several rectangles.

    **Arguments:**

    - `counts`: how many samples each rectangle holds.
    - `shapes`: height over width of each; rows are as far apart as samples in them.
    - `to_border`: the outermost samples lie on the border instead of half a spacing inside.

    **Returns:** the rectangle of each sample, (m,), and its place in it, (m, 2) in [0, 1]².

    >>> in_rows(np.array([4]), np.array([1.0]))[1].tolist()
    [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]]
    """
    owner = np.repeat(np.arange(len(counts)), counts)
    k = counts[owner]
    number = np.arange(len(owner)) - (np.cumsum(counts) - counts)[owner]
    rows = np.clip(np.rint(np.sqrt(k * shapes[owner])).astype(np.int64), 1, k)
    row = number * rows // k
    first, following = -(-row * k // rows), -(-(row + 1) * k // rows)
    return owner, np.stack(
        [_spread(number - first, following - first, to_border), _spread(row, rows, to_border)], axis=1
    )


def _spread(number: np.ndarray, count: np.ndarray, to_border: bool) -> np.ndarray:
    """Places 0 ... count - 1 of [0, 1]; a single one is in the middle."""
    if not to_border:
        return (number + 0.5) / count
    return np.where(count > 1, number / np.maximum(count - 1, 1), 0.5)
