"""Split the edges of a mesh near a few of its vertices, again and again: fine where a solution is singular.

Where two sides meet at another angle than a right one, harmonic coordinates are singular, and linear elements of even
size lose most of their accuracy at these four points. The surface stays the same: parts of a triangle lie in it.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from ._triangles import Loop, Triangles, half_edges

_LEVELS = 6
_RINGS = 6.0  # radius of each level, in edges of that level


def graded(
    points: Float[np.ndarray, "n 3"], triangles: Triangles, loop: Loop, centres: Int[np.ndarray, " c"]
) -> tuple[Float[np.ndarray, "n_more 3"], Triangles, Loop]:
    """Halve edges within six of their lengths of the centres, six times over; new vertices come after the old ones.

    **Arguments:**

    - `points`, `triangles`: the mesh, a disk.
    - `loop`: its boundary.
    - `centres`: vertices to refine around.

    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> len(graded(square, np.array([[0, 1, 2], [0, 2, 3]]), np.arange(4), np.array([0]))[2]) > 4
    True
    """
    edges = half_edges(triangles)
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    middles = points[centres]
    radii = _RINGS * np.array([lengths[(edges == centre).any(axis=1)].max() for centre in centres])
    for level in range(_LEVELS):
        apart = np.linalg.norm(points[:, None] - middles, axis=2)
        near = (apart < radii / 2**level).any(axis=1)
        points, triangles, loop, _ = halved(points, triangles, loop, near)
    return points, triangles, loop


def halved(
    points: Float[np.ndarray, "n 3"], triangles: Triangles, loop: Loop, near: Bool[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "n_more 3"], Triangles, Loop, Int[np.ndarray, "e 2"]]:
    """Halve every edge between two vertices that are near; triangles fall into two, three or four.

    New vertices, at the middles of edges, come after the old ones; the edges' ends are returned, too.
    """
    count = len(points)
    ends = np.sort(half_edges(triangles), axis=1)
    halved = near[ends].all(axis=1)
    keys, which = np.unique(ends[halved] @ np.array([count, 1]), return_inverse=True)
    middle = np.full(len(ends), -1)
    middle[halved] = count + which.ravel()
    corner_pairs = np.stack([keys // count, keys % count], axis=1)
    ring_keys = np.sort(np.stack([loop, np.roll(loop, -1)], axis=1), axis=1) @ np.array([count, 1])
    place = np.minimum(np.searchsorted(keys, ring_keys), max(len(keys) - 1, 0))
    between = np.where(keys[place] == ring_keys, count + place, -1) if len(keys) else np.full(len(loop), -1)
    ring = np.stack([loop, between], axis=1).ravel()
    return (
        np.concatenate([points, points[corner_pairs].mean(axis=1)]),
        _parts(triangles, middle.reshape(-1, 3)),
        ring[ring >= 0],
        corner_pairs,
    )


def _parts(triangles: Triangles, middle: Int[np.ndarray, "k 3"]) -> Triangles:
    """The parts of triangles whose edges (first to second corner, ...) have a middle, or -1."""
    split = middle >= 0
    number = split.sum(axis=1)
    # Turn each triangle until its halved edges come first.
    first = np.where(number == 1, split.argmax(axis=1), np.where(number == 2, (~split).argmax(axis=1) + 1, 0))
    turn = (np.arange(3) + first[:, None]) % 3
    (a, b, c), (p, q, r) = np.take_along_axis(triangles, turn, 1).T, np.take_along_axis(middle, turn, 1).T
    patterns = {
        0: [(a, b, c)],
        1: [(a, p, c), (p, b, c)],
        2: [(p, b, q), (a, p, q), (a, q, c)],
        3: [(a, p, r), (p, b, q), (r, q, c), (p, q, r)],
    }
    return np.concatenate(
        [np.stack(part, axis=1)[number == split_edges] for split_edges, parts in patterns.items() for part in parts]
    )
