"""Nested meshes: uniform ones, each twice as fine as the one before, or adaptive ones that a tolerance has refined."""

from dataclasses import dataclass, replace

import numpy as np

from .._errors import InputError
from ..data import HeightMap
from ..fitting import Marking, StopReason, advance, begin, pose_fit, scaled_lattice, terminate
from ..mesh import TMesh, b_lattice, bisect

_FINEST = 4.0  # pixels: smallest element where the number of levels is not given
_SHORTER = 3  # elements along the shorter side of the first lattice
_LEVELS = 6  # of adaptive meshes, where their number is not given
_FALL = 0.5  # of the tolerance, from one mesh to the next
_RESERVE = 0.8  # of the tolerance, that meshes are refined to: projections have slightly larger errors than the loop


@dataclass(frozen=True, eq=False)
class Spaces:
    """Nested meshes, coarse first; the lattices (M, N) where they are uniform; why refinement stopped, and warnings."""

    meshes: tuple[TMesh, ...]
    lattices: tuple[tuple[int, int], ...] | None
    stop: StopReason | None = None
    warnings: tuple[str, ...] = ()


def first_lattice(height_map: HeightMap, lattice: tuple[int, int] | None) -> tuple[int, int]:
    """The lattice of the first band."""
    if lattice is None:
        return scaled_lattice(height_map.frame, min(_SHORTER, max(1, min(height_map.shape) - 3)))
    if len(lattice) != 2 or any(int(count) != count or count < 1 for count in lattice):
        raise InputError(f"a lattice is two whole numbers of elements (M, N), at least 1; received {lattice!r}")
    return int(lattice[0]), int(lattice[1])


def uniform_spaces(height_map: HeightMap, lattice: tuple[int, int], levels: int | None) -> Spaces:
    """Lattices of twice the elements along both sides, from one to the next."""
    pixels = np.array(height_map.shape[::-1])
    deepest = int(np.floor(np.log2(np.min((pixels - 3) / lattice)) + 1e-9)) + 1 if (pixels > 3).all() else 0
    if deepest < 1:
        raise InputError(
            f"a lattice of {lattice[0]} × {lattice[1]} elements needs three pixels more along either side; received "
            f"{pixels[0]} × {pixels[1]}"
        )
    if levels is None:
        levels = max(1, int(np.floor(np.log2(np.min((pixels - 1) / lattice) / _FINEST) + 1e-9)) + 1)
        levels = min(levels, deepest)
    if levels > deepest:
        raise InputError(
            f"elements cannot be smaller than a pixel: from {lattice[0]} × {lattice[1]} elements this map has "
            f"{deepest} levels at most; received {levels}"
        )
    meshes, lattices = [b_lattice(*lattice)], [lattice]
    for _ in range(levels - 1):
        mesh = meshes[-1]
        for _ in range(2):
            mesh = bisect(mesh, np.ones(mesh.n_elements, bool)).mesh
        meshes.append(mesh)
        lattices.append((2 * lattices[-1][0], 2 * lattices[-1][1]))
    return Spaces(tuple(meshes), tuple(lattices))


def adaptive_spaces(height_map: HeightMap, lattice: tuple[int, int], levels: int | None, tolerance: float) -> Spaces:
    """Meshes of one refinement to a tolerance: of the steps that first met tolerances that fall by half each."""
    count = _LEVELS if levels is None else levels
    problem = pose_fit(height_map, tolerance=_RESERVE * tolerance, lattice=lattice)
    problem = replace(problem, marking=Marking(fall=_FALL, twice=np.inf))
    goals = [_RESERVE * tolerance / _FALL**k for k in range(count - 1)]
    state = begin(problem)
    meshes = [state.mesh.tmesh]
    while goals:
        stop, error = terminate(problem, state), state.history[-1].max_error
        ahead = [goal for goal in goals if error > goal]
        if (stop is not None or len(ahead) < len(goals)) and state.mesh.tmesh.n_elements > meshes[-1].n_elements:
            meshes.append(state.mesh.tmesh)
        if stop is not None:
            break
        goals, state = ahead, advance(problem, state) if ahead else state
    warnings = []
    if len(meshes) < count:
        warnings.append(f"{len(meshes)} of {count} meshes differ: single steps met several of the tolerances at once")
    return Spaces(tuple(meshes), None, terminate(problem, state), tuple(warnings))
