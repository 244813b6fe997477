"""The outer boundary of a point cloud, as a loop of points.

A layout in the plane is triangulated (Delaunay). Triangles that are too long in space, for the density of points there,
are peeled off from outside; long triangles further in close holes and stay. What is left has the outline as outer loop.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike

from .._errors import InputError
from ._delaunay import delaunay
from ._layout import flattened, refuse_pieces
from ._points import cloud_of, direction, duplicates, faces
from ._triangles import Loop, Triangles, boundary_loops, length_of, pieces, unpinched, vector_area

_LONG = 1.8  # reaches


def find_boundary(data: Any, *, outward: ArrayLike = (0.0, 0.0, 1.0), neighbours: int = 30) -> Int[np.ndarray, " b"]:
    """Find the outer boundary of a cloud of points in space; holes are not part of it.

    Triangles, if the data have any, are not used: a mesh's boundary is what its edges say.

    **Arguments:**

    - `data`: a `PointCloud`, an (m, 3) array of points, or a `HeightMap`, of which the valid pixels count.
    - `outward`: direction (x, y, z) out of the material.
    - `neighbours`: how many nearest points show a point's surroundings. Gaps narrower than their reach, three to four
      times the spacing of points, are not seen as boundary.

    **Returns:** (b,) indices of points, counter-clockwise seen from outside.

    **Raises:** `InputError` where the points are not one disk: several pieces, closed, branched.

    >>> grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0), 0.0), axis=-1).reshape(-1, 3)
    >>> len(find_boundary(grid))
    14
    """
    points = cloud_of(data).points.astype(np.float64)
    towards = direction(outward)
    first = duplicates(points)[0]
    flat = flattened(points[first], neighbours, towards)
    own = first[flat.kept]
    outline = outlined(points[own], flat.places, flat.reach)
    return outside_left(points, own[outline.original[outline.loop]], towards)[0]


def outside_left(
    points: Float[np.ndarray, "m 3"], loop: Loop, outward: Float[np.ndarray, "3"]
) -> tuple[Loop, str | None]:
    """Return a loop counter-clockwise seen from outside, and a warning where the outward side is uncertain."""
    area = vector_area(points, loop)
    left, warning = faces(area / max(float(np.linalg.norm(area)), 1e-300), outward)
    return (loop if left else loop[::-1]), warning


class Outline(NamedTuple):
    """The triangles of a layout; the point that each of their vertices stands for; the outer loop of vertices."""

    triangles: Triangles
    original: Int[np.ndarray, " n"]
    loop: Loop


def outlined(
    points: Float[np.ndarray, "m 3"], places: Float[np.ndarray, "m 2"], reach: Float[np.ndarray, " m"]
) -> Outline:
    """Return the triangles between points laid out flat, without those outside, and their outer loop.

    **Raises:** `InputError` where what is left after peeling falls into pieces.
    """
    triangles = delaunay(places, lambda triangles: _too_long(points, triangles, reach))
    if not len(triangles):
        raise InputError("the points are too sparse and uneven to show a surface; give its triangles")
    label = pieces(triangles)
    refuse_pieces(np.bincount(label), "triangles")
    triangles, original = unpinched(triangles[label == 0])
    loop = max(boundary_loops(triangles), key=lambda loop: length_of(places[original], loop))
    return Outline(triangles, original, loop)


def _too_long(
    points: Float[np.ndarray, "m 3"], triangles: Int[np.ndarray, "k 3"], reach: Float[np.ndarray, " m"]
) -> Bool[np.ndarray, " k"]:
    """Triangles with an edge that the density of points at either end does not explain."""
    ends = np.roll(triangles, -1, axis=1)
    lengths = np.linalg.norm(points[triangles] - points[ends], axis=2)
    return (lengths > _LONG * np.minimum(reach[triangles], reach[ends])).any(axis=1)
