"""Thin a cloud out evenly, whatever the order and the pose of its points."""

import numpy as np
from jaxtyping import Float, Int

_BITS = 16


def thinned(points: Float[np.ndarray, "m 3"], count: int) -> Int[np.ndarray, " count"]:
    """Return `count` points spread over the cloud, ascending: every so-many-th along a space-filling curve.

    The curve is Morton's in the principal axes, each pointing to the side of the longer tail.

    >>> thinned(np.arange(12.0).reshape(4, 3) ** 2, 2)
    array([0, 2])
    """
    centred = points - points.mean(axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    along = centred @ axes.T
    along *= np.where((along**3).sum(axis=0) < 0, -1.0, 1.0)
    low = along.min(axis=0)
    cells = ((along - low) * ((2**_BITS - 1) / max(float((along.max(axis=0) - low).max()), 1e-300))).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(_BITS):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    order = np.lexsort((*along.T, code))
    return np.sort(order[np.linspace(0, len(points), count, endpoint=False).astype(int)])
