"""Lay a point cloud out flat, roughly: enough to see its outline.

The view from outside or the least-squares plane serves where the points project onto it without folds; else classical
scaling of geodesic distances from a few landmarks (de Silva & Tenenbaum, "Sparse multidimensional scaling using
landmark points", 2004), which unrolls what is bent; else the rim goes to a circle, which opens what is nearly closed. A
layout is judged by its tears: places whose neighbours there are far off in space.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

from .._errors import InputError
from ._rim import laid_by_rim
from ._triangles import Loop

_LANDMARKS = 32
_NEAREST = 6
_FAR = 2.5
_REACH = 16
_TORN = 0.05
_STEEP, _STEEP_SHARE = 0.25, 0.05
_DEBRIS = 0.02


class Neighbourhood(NamedTuple):
    """The graph of near points, weighted by distance, and each point's reach: how far its sixteenth neighbour lies."""

    graph: sparse.csr_matrix
    reach: Float[np.ndarray, " m"]


def neighbourhood(points: Float[np.ndarray, "m 3"], neighbours: int) -> Neighbourhood:
    """Join every point with its nearest neighbours; its reach is the distance of the sixteenth, or of the last.

    >>> neighbourhood(np.eye(3) * [1, 1, 0], 1).reach
    array([1., 1., 1.])
    """
    count = len(points)
    near = min(neighbours, count - 1)
    distances, indices = cKDTree(points).query(points, near + 1)
    rows = np.repeat(np.arange(count), near)
    graph = sparse.csr_matrix((distances[:, 1:].ravel(), (rows, indices[:, 1:].ravel())), (count, count))
    return Neighbourhood(graph.maximum(graph.T).tocsr(), distances[:, min(near, _REACH)])


class Layout(NamedTuple):
    """The points of the largest connected piece, by index; their places in the plane, and their reach."""

    kept: Int[np.ndarray, " k"]
    places: Float[np.ndarray, "k 2"]
    reach: Float[np.ndarray, " k"]


def flattened(
    points: Float[np.ndarray, "m 3"], neighbours: int, outward: Float[np.ndarray, "3"], boundary: Loop | None = None
) -> Layout:
    """Lay the largest connected piece of a cloud out flat; `boundary` are its points in order, where they are known.

    **Raises:** `InputError` where other pieces hold more than 2 % of the points, and where neighbours tear apart.
    """
    near = neighbourhood(points, neighbours)
    count, label = connected_components(near.graph, directed=False)
    sizes = np.bincount(label)
    refuse_pieces(sizes, "points")
    kept = np.flatnonzero(label == int(np.argmax(sizes)))
    if count > 1:
        near = Neighbourhood(near.graph[kept][:, kept], near.reach[kept])
    places = lay_out(points[kept], near, outward)
    if torn_share(points[kept], places, near.reach) >= _TORN:
        number = np.full(len(points), -1)
        number[kept] = np.arange(len(kept))
        rim = None if boundary is None or (number[boundary] < 0).any() else number[boundary]
        by_rim = laid_by_rim(points[kept], near.graph, rim)
        places = places if by_rim is None else by_rim
        refuse_torn(points[kept], places, near.reach)
    return Layout(kept, places, near.reach)


def refuse_pieces(sizes: Int[np.ndarray, " n"], what: str) -> None:
    """Raise `InputError` unless one piece holds nearly everything."""
    ordered = np.sort(sizes)[::-1]
    if ordered[1:].sum() <= _DEBRIS * ordered.sum():
        return
    counts = ", ".join(str(size) for size in ordered[:4]) + (", ..." if len(ordered) > 4 else "")
    raise InputError(
        f"one connected surface is needed, but the data fall into {len(ordered)} pieces of {counts} {what}; "
        "take one piece at a time"
    )


def lay_out(
    points: Float[np.ndarray, "m 3"], near: Neighbourhood, outward: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "m 2"]:
    """Return places in the plane, in the unit of the points, that keep neighbours together where that can be done.

    Tried in turn: the view from outside, the least-squares plane, geodesic distances.
    """
    centred = points - points.mean(axis=0)
    for normal in (outward, np.linalg.svd(centred, full_matrices=False)[2][2]):
        plane = centred @ np.linalg.svd(normal[None])[2][1:].T
        if _lies_open(centred, plane, near):
            return plane
    return _scaled(_landmark_distances(centred, near.graph))


def _lies_open(points: Float[np.ndarray, "m 3"], plane: Float[np.ndarray, "m 2"], near: Neighbourhood) -> bool:
    """Whether a projection is steep almost nowhere, and lays nothing on top of something else."""
    graph = near.graph.tocoo()
    shrunk = np.linalg.norm(plane[graph.row] - plane[graph.col], axis=1) / np.maximum(graph.data, 1e-300)
    least = np.ones(len(points))
    np.minimum.at(least, graph.row, shrunk)
    return bool(np.quantile(least, _STEEP_SHARE) > _STEEP) and torn_share(points, plane, near.reach) < _TORN


def refuse_torn(
    points: Float[np.ndarray, "m 3"], places: Float[np.ndarray, "m 2"], reach: Float[np.ndarray, " m"]
) -> None:
    """Raise `InputError` where a layout tears the points apart: they are not a disk."""
    torn = torn_share(points, places, reach)
    if torn >= _TORN:
        raise InputError(
            f"a surface like a bent sheet is needed, but {torn:.0%} of the points tear off their neighbours when laid "
            "flat: the cloud is closed, or branched; cut out a patch with one edge, or give triangles, as in "
            "PointCloud(points, triangles=...)"
        )


def torn_share(
    points: Float[np.ndarray, "m 3"], places: Float[np.ndarray, "m 2"], reach: Float[np.ndarray, " m"]
) -> float:
    """Return the share of points most of whose nearest places belong to points far off in space.

    >>> torn_share(np.eye(3), np.eye(3)[:, :2], np.full(3, 1.5))
    0.0
    """
    near = min(_NEAREST, len(points) - 1)
    indices = cKDTree(places).query(places, near + 1)[1][:, 1:]
    distances = np.linalg.norm(points[indices] - points[:, None], axis=2)
    return float(((distances > _FAR * reach[:, None]).sum(axis=1) > near / 2).mean())


def _landmark_distances(centred: Float[np.ndarray, "m 3"], graph: sparse.csr_matrix) -> Float[np.ndarray, "l m"]:
    """Geodesic distances from landmarks, each the farthest point from those before, with theirs in front."""
    landmark = int(np.argmax((centred**2).sum(axis=1)))
    rows, nearest = [], np.full(len(centred), np.inf)
    chosen = []
    for _ in range(min(_LANDMARKS, len(centred))):
        chosen.append(landmark)
        rows.append(dijkstra(graph, directed=False, indices=landmark))
        nearest = np.minimum(nearest, rows[-1])
        landmark = int(np.argmax(nearest))
    distances = np.stack(rows)
    return np.concatenate([distances[:, chosen], distances], axis=1)


def _scaled(distances: Float[np.ndarray, "l lm"]) -> Float[np.ndarray, "m 2"]:
    """Classical scaling of the landmarks, and the places of all points by distance to them."""
    squared = distances**2
    among, to_all = np.split(squared, [len(squared)], axis=1)
    mean = among.mean(axis=1, keepdims=True)
    values, vectors = np.linalg.eigh(-0.5 * (among - mean - mean.T + among.mean()))
    first = vectors[:, :-3:-1] / np.sqrt(np.maximum(values[:-3:-1], 1e-300))
    return -0.5 * (to_all - mean).T @ first
