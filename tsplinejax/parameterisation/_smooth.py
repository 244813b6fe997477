"""Smooth the positions of points in space, as functions of rough coordinates, so that noise does not count as shape.

Noise makes a triangulated cloud rough: its area grows, and angles on it are not those of the surface. A quadratic in
the coordinates, fitted to each point's neighbours, reproduces a smooth surface to the third order of their spacing, or
better.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

_CHUNK = 1 << 15
_RIDGE = 1e-9
_OUTLYING = 5.0  # standard deviations, and at least
_APART = 0.1  # of the neighbours' reach


def smoothed(
    points: Float[np.ndarray, "m 3"], places: Float[np.ndarray, "m 2"], neighbours: int
) -> Float[np.ndarray, "m 3"]:
    """Return the value at each place of the quadratic that fits its neighbours, outliers left out.

    **Arguments:**

    - `points`: (m, 3), positions in space.
    - `places`: (m, 2), rough coordinates, at a similar scale along both.
    - `neighbours`: how many take part in each fit; the nearest count most.

    >>> places = np.random.default_rng(0).random((100, 2))
    >>> paraboloid = np.column_stack([places, places[:, 0] ** 2])
    >>> bool(np.allclose(smoothed(paraboloid, places, 20), paraboloid, atol=1e-6))
    True
    """
    near = min(neighbours, len(points) - 1)
    distance, index = cKDTree(places).query(places, near + 1)
    trust = np.ones(len(points))
    result = points
    for _ in range(2):
        result = _fitted(points, places, distance, index, trust)
        off = np.linalg.norm(points - result, axis=1)
        reach = np.linalg.norm(result[index[:, -1]] - result, axis=1)
        trust = np.where(off > np.maximum(_OUTLYING * 1.4826 * np.median(off), _APART * reach), 0.0, 1.0)
    return result


def _fitted(
    points: np.ndarray, places: np.ndarray, distance: np.ndarray, index: np.ndarray, trust: np.ndarray
) -> np.ndarray:
    parts = []
    for start in range(0, len(points), _CHUNK):
        part = slice(start, start + _CHUNK)
        near = index[part]
        scale = distance[part, -1:] + 1e-300
        weight = (trust[near] + 1e-6) * (1.0 - 0.99 * (distance[part] / scale) ** 2)
        x, y = np.moveaxis((places[near] - places[part, None]) / scale[:, :, None], 2, 0)
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
        weighted = np.swapaxes(terms * weight[:, :, None], 1, 2)
        moments = weighted @ terms
        moments += _RIDGE * np.trace(moments, axis1=1, axis2=2)[:, None, None] * np.diag([0.0, 1, 1, 1, 1, 1])
        parts.append(np.linalg.solve(moments, weighted @ points[near])[:, 0])
    return np.concatenate(parts)
