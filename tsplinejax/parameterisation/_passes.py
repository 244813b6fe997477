"""From points, or a mesh, to harmonic coordinates: one pass over a mesh, two over a bare cloud."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from .._errors import InputError
from ._boundary import outline, outside_left
from ._corners import corners_of, placed_corners
from ._delaunay import delaunay
from ._graded import graded
from ._harmonic import areas, cloud_laplacian, dilatation, harmonic_rectangle, mesh_laplacian
from ._layout import Neighbourhood, lay_out, main_piece, neighbourhood, refuse_torn
from ._result import Dilatation
from ._sheet import sheet_of
from ._thin import thinned
from ._triangles import Loop, Triangles, boundary_loops, half_edges

_FEWEST = 12


class Task(NamedTuple):
    """What is to be mapped: all points, equal ones too, at unit size; the indices of different ones; what was given."""

    points: Float[np.ndarray, "m 3"]
    distinct: Int[np.ndarray, " n"]
    outward: Float[np.ndarray, "3"]
    corners: Int[np.ndarray, "4"] | None
    boundary: Loop | None
    neighbours: int


class Solution(NamedTuple):
    """Parameters of some of the points, and what is known about the map; `loop` starts at the first corner."""

    solved: Int[np.ndarray, " n"]
    parameters: Float[np.ndarray, "n 2"]
    loop: Loop
    corners: Int[np.ndarray, "4"]
    side_ratio: float
    certificate: float
    dilatation: Dilatation
    area: float
    warnings: tuple[str, ...]


def of_mesh(task: Task, triangles: Triangles) -> Solution:
    """Solve on a mesh's own triangles, which name points of `task.distinct` only; holes are closed."""
    sheet = sheet_of(task.points, triangles, task.boundary)
    ring = sheet.original[sheet.loop]
    if task.corners is not None:
        corners = placed_corners(task.corners, ring, task.points)
    else:
        corners = corners_of(sheet.vertices[sheet.loop], _mesh_layout(sheet.vertices, sheet.triangles)[sheet.loop])
    warnings = () if not sheet.holes else (f"{sheet.holes} hole{'s' * (sheet.holes > 1)} of the mesh closed",)
    solution = _on_mesh(sheet.vertices, sheet.triangles, sheet.loop, sheet.loop[corners])
    own = len(sheet.original)
    return Solution(
        sheet.original, solution[0][:own], np.roll(ring, -corners[0]), ring[corners], *solution[1:], warnings
    )


def _mesh_layout(vertices: Float[np.ndarray, "n 3"], triangles: Triangles) -> Float[np.ndarray, "n 2"]:
    edges = half_edges(triangles)
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    graph = sparse.csr_matrix((lengths, (edges[:, 0], edges[:, 1])), (len(vertices), len(vertices)))
    graph = graph.maximum(graph.T).tocsr()
    return lay_out(vertices, Neighbourhood(graph, 2 * graph.max(axis=1).toarray().ravel()))


def of_cloud(task: Task, max_points: int) -> Solution:
    """Solve for a bare cloud: rough coordinates first, then on the triangles that they give."""
    if len(task.distinct) < _FEWEST:
        raise InputError(
            f"a cloud without triangles needs at least {_FEWEST} different points, but got {len(task.distinct)}"
        )
    names = _kept(task, max_points)
    near = neighbourhood(task.points[names], task.neighbours)
    piece = main_piece(near.graph)
    warnings = [f"{len(task.distinct)} points thinned out to {len(names)}"] if len(names) < len(task.distinct) else []
    if not piece.all():
        warnings.append(f"{int((~piece).sum())} points lie apart from the surface; their parameters are interpolated")
        near = Neighbourhood(near.graph[piece][:, piece], near.reach[piece])
        names = names[piece]
    points = task.points[names]
    loop, corners, warning = _frame_of_cloud(task, names, points, near)
    warnings += [warning] if warning else []
    rough = harmonic_rectangle(cloud_laplacian(points, task.neighbours), loop, corners)
    plane = rough.coordinates * [1.0, rough.side_ratio]
    refuse_torn(points, plane, near.reach)
    triangles = delaunay(plane)
    used = np.zeros(len(plane), bool)
    used[triangles] = True
    number = np.cumsum(used) - 1
    ring = max(boundary_loops(number[triangles]), key=len)
    solution = _on_mesh(points[used], number[triangles], ring, number[loop[corners]])
    boundary = names[np.roll(loop, -corners[0])]
    return Solution(names[used], *solution[:1], boundary, names[loop[corners]], *solution[1:], tuple(warnings))


def _kept(task: Task, max_points: int) -> Int[np.ndarray, " k"]:
    """The points solved for: all, or so many; those that were given as boundary or corners always."""
    names = task.distinct
    if len(names) <= max_points:
        return names
    chosen = names[thinned(task.points[names], max_points)]
    given = [part for part in (task.boundary, task.corners) if part is not None]
    return np.unique(np.concatenate([chosen, *given]))


def _frame_of_cloud(
    task: Task, names: Int[np.ndarray, " n"], points: Float[np.ndarray, "n 3"], near: Neighbourhood
) -> tuple[Loop, Int[np.ndarray, "4"], str | None]:
    """The loop, in indices of `points`, counter-clockwise seen from outside, and the corners' places in it."""
    known = task.boundary is not None and task.corners is not None
    places = np.zeros((len(points), 2)) if known else lay_out(points, near)
    if task.boundary is None:
        refuse_torn(points, places, near.reach)
        loop = outline(points, places, near.reach)
    else:
        place = np.full(len(task.points), -1)
        place[names] = np.arange(len(names))
        loop = place[task.boundary]
        if (loop < 0).any():
            raise InputError("the boundary must lie on the largest connected piece of the cloud")
    loop, warning = outside_left(points, loop, task.outward)
    if task.corners is None:
        return loop, corners_of(points[loop], places[loop]), warning
    return loop, placed_corners(task.corners, names[loop], task.points), warning


def _on_mesh(
    vertices: Float[np.ndarray, "n 3"], triangles: Triangles, ring: Loop, corners: Int[np.ndarray, "4"]
) -> tuple[Float[np.ndarray, "n 2"], float, float, Dilatation, float]:
    """Coordinates of a mesh's vertices; side ratio, certificate, dilatation and area."""
    finer, parts, whole = graded(vertices, triangles, ring, corners)
    places = np.argmax(whole == corners[:, None], axis=1)
    found = harmonic_rectangle(mesh_laplacian(finer, parts), whole, places)
    coordinates = found.coordinates[: len(vertices)]
    spread = dilatation(vertices, triangles, coordinates * [1.0, found.side_ratio])
    certificate = found.energies[0] * found.energies[1]
    return coordinates, found.side_ratio, certificate, spread, float(areas(vertices, triangles).sum())
