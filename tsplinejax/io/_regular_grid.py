"""Is a table of points x, y, z a regular grid? Then it is a height map."""

import numpy as np

from .._errors import InputError
from ._raw import RawMap

_JITTER = 1e-3  # how far, in spacings, rounded coordinates may lie off their line
_SPARSEST = 100  # a grid asked for may have this many pixels per point


def full_grid(points: np.ndarray) -> RawMap | None:
    """Return the height map of points that fill a regular grid, each pixel once; `None` if they do not.

    **Arguments:**

    - `points`: (m, 3), in any order; z may be NaN (missing).

    >>> full_grid(np.array([[0, 0, 1.0], [2, 0, 2.0], [0, 1, 3.0], [2, 1, 4.0]])).spacing
    (2.0, 1.0)
    """
    if not np.isfinite(points[:, :2]).all():
        return None
    columns, rows = (len(np.unique(points[:, axis])) for axis in (0, 1))
    if columns < 2 or rows < 2 or columns * rows != len(points):
        return None
    return _filled(points, (rows, columns))


def sparse_grid(points: np.ndarray) -> RawMap:
    """Return the height map of points on a regular grid of which some may be absent (missing pixels).

    **Raises:** `InputError` when they are scattered, or two share a pixel.

    >>> sparse_grid(np.array([[0, 0, 1.0], [1, 0, 2.0], [0, 1, 3.0]])).heights
    array([[ 1.,  2.],
           [ 3., nan]])
    """
    scattered = InputError(
        f"the {len(points)} points do not lie on a regular grid, so they are no height map; read them as a cloud"
    )
    if not np.isfinite(points[:, :2]).all():
        raise scattered
    counts = []
    for axis in (0, 1):
        lines = np.unique(points[:, axis])
        if len(lines) < 2:
            raise scattered
        counts.append(int(np.rint((lines[-1] - lines[0]) / np.diff(lines).min())) + 1)
    if counts[0] * counts[1] > _SPARSEST * len(points):
        raise scattered
    grid = _filled(points, (counts[1], counts[0]))
    if grid is None:
        raise scattered
    return grid


def _filled(points: np.ndarray, shape: tuple[int, int]) -> RawMap | None:
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    spacing = (high - low) / (np.array(shape[::-1]) - 1)
    place = (points[:, :2] - low) / spacing
    nearest = np.rint(place)
    if np.abs(place - nearest).max() > _JITTER:
        return None
    column, row = nearest.astype(np.int64).T
    index = row * shape[1] + column
    if len(np.unique(index)) != len(points):
        return None
    heights = np.full(shape, np.nan)
    heights.ravel()[index] = points[:, 2]
    return RawMap(heights, (float(spacing[0]), float(spacing[1])), origin=(float(low[0]), float(low[1])))
