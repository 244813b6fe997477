"""From points, or a mesh, to harmonic coordinates: one pass over a mesh, two over a bare cloud."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

from .._errors import InputError
from ._boundary import outlined, outside_left
from ._corners import corners_of, placed_corners
from ._delaunay import delaunay
from ._finer import Mesh, cloud_mesh
from ._graded import graded
from ._harmonic import areas, dilatation, harmonic_rectangle, mesh_laplacian
from ._layout import Neighbourhood, flattened, lay_out, refuse_torn
from ._result import Dilatation
from ._sheet import Sheet, sheet_of
from ._smooth import surface_through
from ._thin import thinned
from ._triangles import Loop, Triangles, boundary_loops, half_edges, used_vertices, vector_area

UP = np.array([0.0, 0.0, 1.0])
_FEWEST = 12
_MESH_REACH = 2.0  # in a vertex's longest edge
_ENOUGH, _MOST = 5000, 60_000  # vertices that are solved for: at least, and at most for the sake of the certificate
_CERTAIN = 0.003


class Task(NamedTuple):
    """What is to be mapped: all points, equal ones too, at unit size; the indices of different ones; what was given."""

    points: Float[np.ndarray, "m 3"]
    distinct: Int[np.ndarray, " n"]
    outward: Float[np.ndarray, "3"] | None
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
    warnings = [] if not sheet.holes else [f"{sheet.holes} hole{'s' * (sheet.holes > 1)} of the mesh closed"]
    if task.outward is not None:
        loop, warning = outside_left(sheet.vertices, sheet.loop, task.outward)
        sheet = sheet._replace(loop=loop)
        warnings += [warning] if warning else []
    ring = sheet.original[sheet.loop]
    if task.corners is not None:
        corners = placed_corners(task.corners, ring, task.points)
    else:
        corners = corners_of(sheet.vertices[sheet.loop], _mesh_layout(sheet)[sheet.loop])
    solution = _solved(Mesh(sheet.vertices, sheet.triangles, sheet.loop), sheet.loop[corners])
    own = len(sheet.original)
    return Solution(
        sheet.original, solution[0][:own], np.roll(ring, -corners[0]), ring[corners], *solution[1:], tuple(warnings)
    )


def _mesh_layout(sheet: Sheet) -> Float[np.ndarray, "n 2"]:
    count = len(sheet.vertices)
    start, end = half_edges(sheet.triangles).T
    lengths = np.linalg.norm(sheet.vertices[start] - sheet.vertices[end], axis=1)
    graph = sparse.csr_matrix((lengths, (start, end)), (count, count))
    graph = graph.maximum(graph.T).tocsr()
    near = Neighbourhood(graph, _MESH_REACH * graph.max(axis=1).toarray().ravel())
    return lay_out(sheet.vertices, near, vector_area(sheet.vertices, sheet.loop))


def of_cloud(task: Task, max_points: int) -> Solution:
    """Solve for a bare cloud: rough coordinates first, then on the triangles that they give."""
    if len(task.distinct) < _FEWEST:
        raise InputError(
            f"a cloud without triangles needs at least {_FEWEST} different points, but got {len(task.distinct)}"
        )
    names = _kept(task, max_points)
    warnings = [f"{len(task.distinct)} points thinned out to {len(names)}"] if len(names) < len(task.distinct) else []
    outward = UP if task.outward is None else task.outward
    flat = flattened(task.points[names], task.neighbours, outward, _numbered(task, names))
    names = names[flat.kept]
    outline = outlined(task.points[names], flat.places, flat.reach)
    names, places = names[outline.original], flat.places[outline.original]
    points = task.points[names]
    loop, warning = outside_left(points, _given_loop(task, names, outline.loop), outward)
    warnings += [warning] if warning else []
    if task.corners is None:
        corners = corners_of(points[loop], places[loop])
    else:
        corners = placed_corners(task.corners, names[loop], task.points)
    surface = surface_through(points, places, task.neighbours)(places)[0]
    rough = harmonic_rectangle(mesh_laplacian(surface, outline.triangles), loop, corners)
    plane = rough.coordinates * [1.0, rough.side_ratio]
    refuse_torn(points, plane, flat.reach[outline.original])
    triangles = delaunay(plane)
    used = used_vertices(triangles, len(plane))
    number = np.cumsum(used) - 1
    ring = max(boundary_loops(number[triangles]), key=len)
    through = surface_through(points, plane, task.neighbours)
    mesh = cloud_mesh(through, plane[used], number[triangles], ring)
    solution = _solved(mesh, number[loop[corners]])
    boundary = names[np.roll(loop, -corners[0])]
    own = int(used.sum())
    return Solution(names[used], solution[0][:own], boundary, names[loop[corners]], *solution[1:], tuple(warnings))


def _kept(task: Task, max_points: int) -> Int[np.ndarray, " k"]:
    """The points solved for: all, or so many; those that were given as boundary or corners always."""
    names = task.distinct
    if len(names) <= max_points:
        return names
    chosen = names[thinned(task.points[names], max_points)]
    given = [part for part in (task.boundary, task.corners) if part is not None]
    return np.unique(np.concatenate([chosen, *given]))


def _numbered(task: Task, names: Int[np.ndarray, " n"]) -> Loop | None:
    """The boundary that was given, as places in a list of points, or -1."""
    if task.boundary is None:
        return None
    place = np.full(len(task.points), -1)
    place[names] = np.arange(len(names))
    return place[task.boundary]


def _given_loop(task: Task, names: Int[np.ndarray, " n"], found: Loop) -> Loop:
    """The boundary that was given, as vertices, or the one that was found."""
    loop = _numbered(task, names)
    if loop is None or task.boundary is None:
        return found
    if (loop < 0).any():
        apart = task.boundary[loop < 0][0]
        raise InputError(f"the boundary must lie on the surface, but its point {apart} lies apart from all others")
    return loop


def _solved(
    mesh: Mesh, corners: Int[np.ndarray, "4"]
) -> tuple[Float[np.ndarray, "n 2"], float, float, Dilatation, float]:
    """Coordinates of a mesh's vertices, its own first; side ratio, certificate, dilatation and area.

    Sparse triangles are halved first, and all where the certificate says that they are too coarse for the outline.
    """
    while len(mesh.vertices) < _ENOUGH:
        mesh = mesh.finer()
    while True:
        solution = _on_mesh(*mesh[:3], corners)
        if abs(solution[2] - 1) <= _CERTAIN or 4 * len(mesh.vertices) > _MOST:
            return solution
        mesh = mesh.finer()


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
