"""Make one sheet, a disk with its holes closed, of the triangles of a measured mesh; or say why it is none."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from .._errors import InputError
from ._layout import refuse_pieces
from ._triangles import (
    Loop,
    Triangles,
    boundary_loops,
    euler_characteristic,
    length_of,
    pieces,
    unpinched,
    with_holes_closed,
    wound_alike,
)


class Sheet(NamedTuple):
    """A disk of triangles: vertices, triangles, outer loop, and the point that each vertex of the mesh stands for.

    Vertices beyond `original` were added to close holes.
    """

    vertices: Float[np.ndarray, "n 3"]
    triangles: Triangles
    loop: Loop
    original: Int[np.ndarray, " v"]
    holes: int


def sheet_of(points: Float[np.ndarray, "m 3"], triangles: Triangles, boundary: Loop | None = None) -> Sheet:
    """Return the sheet, its triangles wound alike.

    **Arguments:**

    - `points`: (m, 3), all different.
    - `triangles`: (k, 3); those with a vertex twice are left out.
    - `boundary`: points of the loop that is the outer one; else the longest is.

    **Raises:** `InputError` for meshes that are closed, branched, in pieces, one-sided or with handles.

    >>> sheet_of(np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])).loop
    array([0, 1, 2, 3])
    """
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    triangles = triangles[distinct]
    if not len(triangles):
        raise InputError("the mesh holds no triangle with three different points")
    label = pieces(triangles)
    refuse_pieces(np.bincount(label), "triangles")
    triangles, original = unpinched(wound_alike(triangles[label == 0]))
    loops = boundary_loops(triangles)
    if not loops:
        raise InputError(
            "a surface with a boundary is needed, but the mesh is closed; cut out a patch, for instance with crop"
        )
    vertices = points[original]
    lengths = [length_of(vertices, loop) for loop in loops]
    outer = int(np.argmax(lengths)) if boundary is None else _loop_of(boundary, [original[loop] for loop in loops])
    holes = [loop for k, loop in enumerate(loops) if k != outer]
    vertices, triangles = with_holes_closed(vertices, triangles, holes)
    if euler_characteristic(triangles) != 1:
        raise InputError("a sheet is needed, but the mesh has handles (as a mug has); cut it open")
    return Sheet(vertices, triangles, loops[outer], original, len(holes))


def _loop_of(boundary: Loop, loops: list[Loop]) -> int:
    """Which loop holds just the points of a boundary that was given."""
    for k, loop in enumerate(loops):
        if np.array_equal(np.unique(loop), np.sort(boundary)):
            return k
    raise InputError(
        f"the boundary of a mesh is one of its {len(loops)} loops of free edges, but the {len(boundary)} points given "
        "are none; drop the triangles beyond them, or pass the points without triangles"
    )
