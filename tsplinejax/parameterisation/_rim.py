"""Lay a nearly closed cloud out flat by its rim: what no view shows whole and no unrolling opens.

The rim is where a point's neighbours, seen in its tangent plane, leave up to half the directions empty. It goes to the
unit circle, and every other point to the mean of its neighbours: Tutte's embedding ("How to draw a graph", 1963) of a
graph of near points.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

from ._triangles import Loop

_AROUND, _NEAR = 30, 8  # neighbours that show gaps, and those that a point is the mean of
_GAP = np.radians(120)
_FEWEST = 12
_CHUNK = 1 << 15


def laid_by_rim(
    points: Float[np.ndarray, "m 3"], graph: sparse.csr_matrix, boundary: Loop | None = None
) -> Float[np.ndarray, "m 2"] | None:
    """Places in the unit disk, or nothing where the points have no rim.

    **Arguments:**

    - `points`: (m, 3), one connected piece.
    - `graph`: of near points, weighted by distance.
    - `boundary`: the rim in order, where it is known.

    >>> rim, ring = (np.exp(2j * np.pi * np.arange(n) / n) for n in (24, 8))
    >>> plane = np.concatenate([rim, 0.6 * ring, [0]])
    >>> points = np.column_stack([plane.real, plane.imag, np.zeros(33)])
    >>> laid_by_rim(points, sparse.csr_matrix((33, 33)), np.arange(24))[32].round(12) + 0.0
    array([0., 0.])
    """
    if boundary is not None:
        rim, circle = boundary, _by_length(points[boundary])
    else:
        rim = _largest(graph, _gaps(points) > _GAP)
        if len(rim) < _FEWEST:
            return None
        circle = _by_distance(graph[rim][:, rim])
    return _means(points, rim, circle)


def _gaps(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """The widest angle without a neighbour in each point's tangent plane."""
    near = cKDTree(points).query(points, min(_AROUND, len(points) - 1) + 1)[1][:, 1:]
    widest = np.empty(len(points))
    for first in range(0, len(points), _CHUNK):
        rows = slice(first, first + _CHUNK)
        offsets = points[near[rows]] - points[rows, None]
        axes = np.linalg.eigh(np.swapaxes(offsets, 1, 2) @ offsets)[1][:, :, 1:]
        flat = offsets @ axes
        angle = np.sort(np.arctan2(flat[:, :, 1], flat[:, :, 0]), axis=1)
        widest[rows] = np.diff(angle, axis=1, append=angle[:, :1] + 2 * np.pi).max(axis=1)
    return widest


def _largest(graph: sparse.csr_matrix, chosen: Bool[np.ndarray, " m"]) -> Int[np.ndarray, " r"]:
    """The largest connected part of the chosen points."""
    index = np.flatnonzero(chosen)
    if not len(index):
        return index
    label = connected_components(graph[index][:, index], directed=False)[1]
    return index[label == np.bincount(label).argmax()]


def _by_length(ring: Float[np.ndarray, "r 3"]) -> Float[np.ndarray, "r 2"]:
    """Places on the unit circle by length along a loop."""
    steps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    angle = 2 * np.pi * np.append(0.0, np.cumsum(steps)[:-1]) / max(steps.sum(), 1e-300)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _by_distance(graph: sparse.csr_matrix) -> Float[np.ndarray, "r 2"]:
    """Places on the unit circle by distances along a rim without an order, from its ends and its sides.

    Round a circle the difference of the distances from two opposite points falls and rises evenly, and that from two
    points halfway between them a quarter later.
    """

    def distances(start: int) -> np.ndarray:
        return dijkstra(graph, directed=False, indices=start)

    one = distances(0)
    other = distances(int(one.argmax()))
    side = distances(int(np.minimum(one, other).argmax()))
    across = distances(int(side.argmax()))
    angle = np.arctan2(across - side, other - one)
    return np.column_stack([np.cos(angle), np.sin(angle)])


def _means(
    points: Float[np.ndarray, "m 3"], rim: Int[np.ndarray, " r"], circle: Float[np.ndarray, "r 2"]
) -> Float[np.ndarray, "m 2"] | None:
    """Every point at the mean of its neighbours, the rim on its circle; nothing where some hang together apart."""
    count = len(points)
    near = cKDTree(points).query(points, min(_NEAR, count - 1) + 1)[1][:, 1:]
    rows = np.repeat(np.arange(count), near.shape[1])
    joined = sparse.csr_matrix((np.ones(near.size), (rows, near.ravel())), (count, count))
    joined = joined.maximum(joined.T).tocsr()
    free = np.ones(count, bool)
    free[rim] = False
    label = connected_components(joined, directed=False)[1]
    if not np.isin(label, label[rim]).all():
        return None
    places = np.zeros((count, 2))
    places[rim] = circle
    if free.any():
        laplacian = sparse.diags(np.asarray(joined.sum(axis=1)).ravel()) - joined
        loads = -(laplacian[free] @ places)
        factor = splu(
            laplacian[free][:, free].tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        places[free] = factor.solve(loads)
    return places
