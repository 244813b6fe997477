"""What every parameterisation asks of its points, and the conventions they share: outward side, names of axes."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

from .._errors import InputError
from ..data import HeightMap, PointCloud, as_data

_FLAT = 1e-9  # width over length below which points count as collinear
#: s runs along +x as nearly as it can; where x does not tell, +y, then +z.
_PREFERENCE = np.array([1.0, 1e-3, 1e-6])


def cloud_of(data: Any) -> PointCloud:
    """Return data as points in space; of a height map the valid pixels, row by row.

    **Raises:** `InputError` for what is not data, and for points on one line.

    >>> cloud_of(HeightMap([[1.0, 2.0], [np.nan, 4.0]], 0.5)).points[2]
    array([0.5, 0.5, 4. ])
    """
    data = as_data(data)
    if isinstance(data, HeightMap):
        samples = data.samples()
        data = PointCloud(np.column_stack([samples.frame.xy_of(samples.parameters), samples.values]), data.unit)
    points = data.points.astype(np.float64)
    if len(points) < 3:
        raise InputError(f"a surface needs at least three points, but got {len(points)}")
    centred = points - points.mean(axis=0)
    length, width = np.linalg.svd(centred, compute_uv=False)[:2]
    rounding = 2 * np.finfo(data.points.dtype).eps * float(np.abs(points).max()) * len(points) ** 0.5
    if width <= max(_FLAT * length, rounding):
        raise InputError(f"the {len(points)} points lie on one line (or in one point), so they are not a surface")
    return data


def direction(outward: ArrayLike) -> Float[np.ndarray, "3"]:
    """Return a direction as a unit vector.

    **Raises:** `InputError` for anything but three finite numbers that are not all 0.

    >>> direction((0, 0, 2))
    array([0., 0., 1.])
    """
    try:
        vector = np.asarray(outward, dtype=np.float64)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"outward is a direction (x, y, z) that is not 0, but got {outward!r}")
    return vector / length


def faces(normal: Float[np.ndarray, "3"], outward: Float[np.ndarray, "3"]) -> tuple[bool, str | None]:
    """Return whether a mean normal looks outwards, and a warning where that is hard to tell.

    >>> faces(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0]))
    (True, None)
    """
    cosine = float(normal @ outward)
    warning = None
    if abs(cosine) < 0.1:
        angle = np.degrees(np.arccos(min(abs(cosine), 1.0)))
        warning = (
            f"the surface is seen nearly edge-on from outward={tuple(np.round(outward, 3).tolist())} ({angle:.0f}° off "
            "its mean normal), so its outward side is uncertain; state outward="
        )
    return cosine >= 0, warning


def best_turn(points: Float[np.ndarray, "4 3"]) -> int:
    """Return which of four corners, in order around the rectangle, comes first so that s runs along +x.

    >>> best_turn(np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 0]]))
    3
    """
    turned = np.stack([np.roll(points, -k, axis=0) for k in range(4)])
    along_s = turned[:, 1] + turned[:, 2] - turned[:, 0] - turned[:, 3]
    return int(np.argmax(along_s @ _PREFERENCE / np.maximum(np.linalg.norm(along_s, axis=1), 1e-300)))


def smallest_box(places: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "4 2"]:
    """Return the corners of the rectangle of least area around points of the plane, counter-clockwise.

    One of its sides holds an edge of the convex hull (Freeman & Shapira, "Determining the minimum-area encasing
    rectangle for an arbitrary closed curve", Commun. ACM 18, 1975).

    >>> np.ptp(smallest_box(np.array([[0.0, 1], [1, 0], [2, 1], [1, 2]])), axis=0)
    array([2., 2.])
    """
    hull = places[ConvexHull(places).vertices]
    edges = np.roll(hull, -1, axis=0) - hull
    axes = edges / np.maximum(np.linalg.norm(edges, axis=1, keepdims=True), 1e-300)
    across = np.stack([-axes[:, 1], axes[:, 0]], axis=1)
    along, over = hull @ axes.T, hull @ across.T
    best = int(np.argmin(np.ptp(along, axis=0) * np.ptp(over, axis=0)))
    low = np.array([along[:, best].min(), over[:, best].min()])
    high = np.array([along[:, best].max(), over[:, best].max()])
    corners = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    return corners @ np.stack([axes[best], across[best]])


def duplicates(points: Float[np.ndarray, "m 3"]) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " m"]]:
    """Return the first of each set of equal points, and for every point which of these it equals.

    >>> duplicates(np.array([[1.0, 0, 0], [0, 0, 0], [1, 0, 0]]))
    (array([0, 1]), array([0, 1, 0]))
    """
    _, first, inverse = np.unique(points, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return first[order], rank[inverse.ravel()]
