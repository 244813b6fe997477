"""Delaunay triangles of places in the plane, without those at the rim that are none."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import Delaunay  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

_FLAT = 1e-4  # height of a triangle over its longest side

Triangles = Int[np.ndarray, "k 3"]


def delaunay(
    places: Float[np.ndarray, "m 2"], unwanted: Callable[[Triangles], Bool[np.ndarray, " k"]] | None = None
) -> Triangles:
    """Return Delaunay triangles, counter-clockwise, peeled from outside.

    Along a straight side of the hull rounding makes triangles of three points nearly in a line, which carry nothing but
    rounding errors; these are peeled off, and with them what is unwanted. What is reached only through triangles that stay, stays.

    >>> delaunay(np.array([[0.0, 0], [1, 0], [2, 0], [1, 1]])).tolist()
    [[3, 1, 2], [1, 3, 0]]
    """
    mesh = Delaunay(places)
    triangles = mesh.simplices.astype(np.int64)
    a, b, c = np.moveaxis(places[triangles], 1, 0)
    (ax, ay), (bx, by) = (b - a).T, (c - a).T
    double = ax * by - ay * bx
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    triangles = np.where((double < 0)[:, None], triangles[:, [1, 0, 2]], triangles)
    peelable = np.abs(double) <= _FLAT * longest
    if unwanted is not None:
        peelable |= unwanted(triangles)
    return triangles[~_peeled(mesh.neighbors, peelable)]


def _peeled(neighbours: Int[np.ndarray, "k 3"], peelable: Bool[np.ndarray, " k"]) -> Bool[np.ndarray, " k"]:
    """Triangles that are joined with the outside by peelable triangles, themselves peelable."""
    count = len(neighbours)
    triangle = np.repeat(np.arange(count), 3)
    other = neighbours.ravel()
    joins = peelable[triangle] & ((other < 0) | peelable[other])
    other = np.where(other < 0, count, other)
    graph = sparse.coo_matrix((np.ones(joins.sum(), bool), (triangle[joins], other[joins])), (count + 1, count + 1))
    label = connected_components(graph, directed=False)[1]
    return label[:-1] == label[-1]
