"""Conformal parameters of a disk-like surface: angles are kept, lengths scaled by the same factor in all directions.

A triangle mesh is solved once, its holes closed. A bare cloud takes two passes: Delaunay triangles of a layout give
rough coordinates, and the Delaunay triangles of these, which are nearly those of the surface, the final ones. Holes are
closed by the triangles across them.
"""

from typing import Any

import numpy as np
from jaxtyping import Int
from numpy.typing import ArrayLike

from .._errors import InputError
from ._corners import checked_corners, checked_loop
from ._interpolate import interpolated
from ._passes import Solution, Task, of_cloud, of_mesh
from ._points import cloud_of, direction, duplicates
from ._result import Parameterisation

_DOUBTFUL = 0.02


def conformal(
    data: Any,
    *,
    corners: ArrayLike | None = None,
    boundary: ArrayLike | None = None,
    outward: ArrayLike | None = None,
    neighbours: int = 30,
    max_points: int = 200_000,
    merge_duplicates: bool = False,
) -> Parameterisation:
    """Map a disk-like surface conformally to a rectangle, scaled to [0, 1]².

    Four corners make a rectangle of a disk. Where the outline has no corners (a round aperture) the map is infinitely
    distorted at the four points that play the part; everywhere else it is as good.

    **Arguments:**

    - `data`: a `PointCloud`, an (m, 3) array of points, or a `HeightMap`, of which the valid pixels count. Triangles
      are used where there are any. Holes are closed; they need no points.
    - `corners`: four points of the boundary in order: (s, t) = (0, 0), (1, 0), (1, 1), (0, 1). If they run clockwise
      seen from outside, the second and the fourth change places. Default: as `find_corners`.
    - `boundary`: the points of the outer boundary in order; of a mesh, one of its loops. Default: as `find_boundary`,
      or the longest loop of the mesh.
    - `outward`: direction (x, y, z) out of the material. By default the side of a mesh's winding, +z for a cloud.
    - `neighbours`: how many nearest points show a point's surroundings, in a bare cloud.
    - `max_points`: above it, so many are solved for, the others interpolated (and triangles are not used).
    - `merge_duplicates`: let points that are exactly equal share their parameters, instead of raising.

    **Returns:** a `Parameterisation`; s × t is right-handed towards the outward side. Without `corners` s runs as
    nearly as possible along +x.

    **Raises:** `InputError` where the data are not one disk (closed, several pieces, branched, all on one line), for
    equal points, and for corners or a boundary that do not fit.

    Source: two Dirichlet problems and their energies (Ahlfors, *Conformal Invariants*, 1973, chapter 4); linear finite
    elements.

    >>> x, y = np.meshgrid(np.linspace(0, 2, 21), np.linspace(0, 1, 11))
    >>> result = conformal(np.stack([x, y, 0.3 * x * y], axis=-1).reshape(-1, 3))
    >>> result.parameters.shape, round(result.side_ratio, 1), abs(result.certificate - 1) < 0.005
    ((231, 2), 0.5, True)
    """
    cloud, towards = cloud_of(data), None if outward is None else direction(outward)
    if neighbours < 6 or max_points < 100:
        raise InputError(f"neighbours ≥ 6 and max_points ≥ 100 are needed, but got {neighbours} and {max_points}")
    given = cloud.points.astype(np.float64)
    first, inverse = duplicates(given)
    if len(first) < len(given) and not merge_duplicates:
        raise InputError(_equal_points(first, inverse))
    same = first[inverse]  # every point's representative among equal ones
    size = cloud.diagonal
    task = Task(
        (given - given[first].mean(axis=0)) / size,
        first,
        towards,
        None if corners is None else same[checked_corners(corners, given)],
        None if boundary is None else same[checked_loop(boundary, given)],
        neighbours,
    )
    triangles = cloud.triangles
    if triangles is not None and len(triangles) and len(first) <= max_points:
        solution = of_mesh(task, same[triangles])
    else:
        solution = of_cloud(task, max_points)
    return _result(solution, task, same, size, cloud.unit, max_points)


def _equal_points(first: Int[np.ndarray, " n"], inverse: Int[np.ndarray, " m"]) -> str:
    """Name the first two equal points."""
    counts = np.bincount(inverse)
    one, other = np.flatnonzero(inverse == np.argmax(counts > 1))[:2]
    return (
        f"points must differ, but {len(inverse) - len(first)} of {len(inverse)} repeat another (for instance {one} and "
        f"{other} are equal); remove them, or pass merge_duplicates=True"
    )


def _result(
    solution: Solution, task: Task, same: Int[np.ndarray, " m"], size: float, unit: str | None, max_points: int
) -> Parameterisation:
    """Give every point its parameters, and say what is doubtful."""
    warnings = list(solution.warnings)
    parameters = np.full((len(same), 2), np.nan)
    parameters[solution.solved] = solution.parameters
    left = task.distinct[np.isnan(parameters[task.distinct, 0])]
    if len(left):
        known = task.points[solution.solved]
        parameters[left] = interpolated(known, solution.parameters, task.points[left])
        if len(task.distinct) <= max_points:
            warnings.append(
                f"{len(left)} points belong to no triangle of the surface; their parameters are interpolated"
            )
    if abs(solution.certificate - 1) > _DOUBTFUL:
        warnings.append(
            f"the map is not conformal (E_u·E_v = {solution.certificate:.3f}): the points are sparse for their shape, "
            "or the corners or the boundary are not what they seem; see corners= and boundary="
        )
    area = solution.area * size**2
    ratio = solution.side_ratio
    return Parameterisation(
        parameters[same],
        (float(np.sqrt(area / ratio)), float(np.sqrt(area * ratio))),
        "conformal",
        unit,
        solution.corners,
        solution.loop,
        solution.certificate,
        solution.dilatation,
        tuple(warnings),
    )
