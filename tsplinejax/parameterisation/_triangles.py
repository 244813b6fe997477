"""The topology of triangle meshes: pieces, winding, loops, holes.

Triangles are (k, 3) indices of vertices; the half-edge at place j of triangle i runs from its corner j to the next one
and has number 3 i + j. Everything is array work: connected components of sparse graphs stand where one would walk.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from .._errors import InputError

Triangles = Int[np.ndarray, "k 3"]
Loop = Int[np.ndarray, " b"]


def half_edges(triangles: Triangles) -> Int[np.ndarray, "h 2"]:
    """Return start and end of every half-edge.

    >>> half_edges(np.array([[4, 5, 6]]))
    array([[4, 5],
           [5, 6],
           [6, 4]])
    """
    return np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)


def _pairs(triangles: Triangles) -> Int[np.ndarray, "p 2"]:
    """The two half-edges of every inner edge.

    **Raises:** `InputError` for an edge that more than two triangles share.
    """
    ends = np.sort(half_edges(triangles), axis=1)
    order = np.lexsort(ends.T)
    ends = ends[order]
    same = (ends[1:] == ends[:-1]).all(axis=1)
    if len(same) > 1 and (same[1:] & same[:-1]).any():
        first, second = ends[1:-1][same[1:] & same[:-1]][0]
        raise InputError(
            "a surface needs edges with one or two triangles, but more meet at the edge between points "
            f"{first} and {second}: the mesh branches there, or has triangles twice; cut it there"
        )
    at = np.flatnonzero(same)
    return np.stack([order[at], order[at + 1]], axis=1)


def _components(count: int, pairs: Int[np.ndarray, "p 2"]) -> Int[np.ndarray, " n"]:
    graph = sparse.coo_matrix((np.ones(len(pairs), bool), (pairs[:, 0], pairs[:, 1])), (count, count))
    return connected_components(graph, directed=False)[1]


def pieces(triangles: Triangles) -> Int[np.ndarray, " k"]:
    """Number the pieces of a mesh, each joined by edges; the largest is 0.

    >>> pieces(np.array([[7, 8, 9], [0, 1, 2], [2, 1, 3]]))
    array([1, 0, 0])
    """
    label = _components(len(triangles), _pairs(triangles) // 3)
    rank = np.argsort(np.argsort(-np.bincount(label), kind="stable"), kind="stable")
    return rank[label]


def wound_alike(triangles: Triangles) -> Triangles:
    """Turn triangles round until neighbours agree; the side that most triangles had is kept. For one piece.

    A triangle as it is and turned round are two nodes of a graph; neighbours that agree join like nodes, others unlike
    ones. A band with one side joins everything.

    **Raises:** `InputError` for a surface with one side only.

    >>> wound_alike(np.array([[0, 1, 2], [1, 2, 3]]))
    array([[0, 1, 2],
           [2, 1, 3]])
    """
    edges, pairs, count = half_edges(triangles), _pairs(triangles), len(triangles)
    agree = edges[pairs[:, 0], 0] != edges[pairs[:, 1], 0]
    one, other = (pairs // 3).T
    partner = np.where(agree, other, other + count)
    mirrored = np.where(agree, other + count, other)
    label = _components(2 * count, np.concatenate([np.stack([one, partner], 1), np.stack([one + count, mirrored], 1)]))
    if (label[:count] == label[count:]).any():
        raise InputError("a surface needs two sides, but the mesh has only one (as a Möbius band); cut it open")
    turned = label[:count] != label[0]
    if 2 * turned.sum() > count:
        turned = ~turned
    return np.where(turned[:, None], triangles[:, [1, 0, 2]], triangles)


def unpinched(triangles: Triangles) -> tuple[Triangles, Int[np.ndarray, " n"]]:
    """Give every fan of triangles around a vertex a vertex of its own, and number vertices without gaps.

    Two fans that touch at one vertex only would make the boundary cross itself there.

    **Returns:** the triangles, and for each of their vertices the vertex it stands for.

    >>> unpinched(np.array([[0, 1, 2], [2, 3, 4]]))[1]
    array([0, 1, 2, 2, 3, 4])
    """
    pairs = _pairs(triangles)
    start = half_edges(triangles)[:, 0]
    # A half-edge's number is that of its start among all corners; its end is the next corner of the triangle.
    after = pairs // 3 * 3 + (pairs + 1) % 3
    alike = (start[pairs[:, 0]] == start[pairs[:, 1]])[:, None]
    one = np.where(alike, pairs, np.stack([pairs[:, 0], after[:, 1]], 1))
    two = np.where(alike, after, np.stack([after[:, 0], pairs[:, 1]], 1))
    label = _components(triangles.size, np.concatenate([one, two]))
    original = np.empty(label.max() + 1, np.int64)
    original[label] = triangles.ravel()
    order = np.argsort(original, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank[label].reshape(-1, 3), original[order]


def boundary_loops(triangles: Triangles) -> list[Loop]:
    """Return the loops of edges with one triangle, each in the direction of that triangle's winding.

    For a mesh whose triangles are wound alike and that is not pinched.

    >>> boundary_loops(np.array([[0, 1, 2], [2, 1, 3]]))
    [array([0, 1, 3, 2])]
    """
    edges = half_edges(triangles)
    single = np.ones(len(edges), bool)
    single[_pairs(triangles).ravel()] = False
    names, ends = np.unique(edges[single], return_inverse=True)
    if not len(names):
        return []
    ends = ends.reshape(-1, 2)
    successor = sparse.csr_matrix((np.ones(len(ends), bool), (ends[:, 0], ends[:, 1])), (len(names), len(names)))
    label = connected_components(successor, directed=False)[1]
    starts = np.unique(label, return_index=True)[1]
    walks = (breadth_first_order(successor, start, return_predecessors=False) for start in starts)
    return [names[walk] for walk in walks]


def with_holes_closed(
    points: Float[np.ndarray, "n 3"], triangles: Triangles, holes: list[Loop]
) -> tuple[Float[np.ndarray, "n_more 3"], Triangles]:
    """Close each hole by a fan of triangles around a new vertex, the mean of the loop's.

    The fan need not be pretty: what is solved on it uses intrinsic Delaunay triangles.

    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> with_holes_closed(square, np.zeros((0, 3), int), [np.array([3, 2, 1, 0])])[1]
    array([[2, 3, 4],
           [1, 2, 4],
           [0, 1, 4],
           [3, 0, 4]])
    """
    if not holes:
        return points, triangles
    fans = [
        np.stack([np.roll(loop, -1), loop, np.full(len(loop), len(points) + k)], axis=1) for k, loop in enumerate(holes)
    ]
    middles = np.stack([points[loop].mean(axis=0) for loop in holes])
    return np.concatenate([points, middles]), np.concatenate([triangles, *fans])


def euler_characteristic(triangles: Triangles) -> int:
    """Return vertices - edges + triangles: 1 for a disk.

    >>> euler_characteristic(np.array([[0, 1, 2]]))
    1
    """
    n_edges = len(half_edges(triangles)) - len(_pairs(triangles))
    return len(np.unique(triangles)) - n_edges + len(triangles)


def length_of(points: Float[np.ndarray, "n d"], loop: Loop) -> float:
    """Return the length of a closed loop.

    >>> length_of(np.array([[0.0, 0], [3, 0], [3, 4]]), np.arange(3))
    12.0
    """
    ring = points[loop]
    return float(np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum())


def vector_area(points: Float[np.ndarray, "n 3"], loop: Loop) -> Float[np.ndarray, "3"]:
    """Return the vector area ½ Σ pᵢ × pᵢ₊₁ of a loop: the mean normal times the area of any surface that it bounds.

    >>> vector_area(np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0]]), np.arange(3))
    array([0., 0., 1.])
    """
    ring = points[loop] - points[loop].mean(axis=0)
    return 0.5 * np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)


def used_vertices(triangles: Triangles, count: int) -> Bool[np.ndarray, " n"]:
    """Return which vertices some triangle has.

    >>> used_vertices(np.array([[0, 1, 3]]), 4)
    array([ True,  True, False,  True])
    """
    used = np.zeros(count, bool)
    used[triangles] = True
    return used
