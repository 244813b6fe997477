"""Nested spaces: over uniform lattices, each twice as fine as the one before, or meshes that a tolerance has refined.

Clamped splines are freer at the border than inside: three functions more than elements. Over coarse lattices they use
that to follow waves there that are too short for them. So in every lattice but the finest the two elements at a border
are one of twice the size: one function more than elements. Such spaces are nested as well as those over the whole
lattices, hold the same polynomials, and their surfaces are surfaces over the whole lattices.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .._errors import InputError
from ..data import HeightMap
from ..filtration._lattice import on_grid
from ..filtration._separable import halved_ends
from ..fitting import Marking, StopReason, advance, begin, pose_fit, scaled_lattice, terminate
from ..mesh import TMesh, b_lattice, bisect

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_FINEST = 4.0  # pixels: smallest element where the number of levels is not given
_SHORTER = 3  # elements along the shorter side of the first lattice
_WIDE = 6  # elements along a side, from which on the border's may be wide: a coarser lattice would lose all it adds
_LEVELS = 6  # of adaptive meshes, where their number is not given
_FALL = 0.5  # of the tolerance, from one mesh to the next
_RESERVE = 0.8  # of the tolerance, that meshes are refined to: projections have slightly larger errors than the loop


@dataclass(frozen=True, eq=False)
class Level:
    """One of the spaces.

    **Attributes:**

    - `tmesh`: its mesh.
    - `lattice`: its elements (M, N) where it is uniform, else `None`.
    - `wide`: whether the elements at either end are one of twice the size, along x and along y.
    """

    tmesh: TMesh
    lattice: tuple[int, int] | None = None
    wide: tuple[bool, bool] = (False, False)

    def insertions(self) -> "tuple[csr_array, csr_array]":
        """Along x and along y, from the control points of the space to those over all of the lattice."""
        from scipy.sparse import csr_array, eye_array

        assert self.lattice is not None
        along_x, along_y = (
            halved_ends(elements) if wide else csr_array(eye_array(elements + 3))
            for elements, wide in zip(self.lattice, self.wide, strict=True)
        )
        return along_x, along_y

    def change(self) -> "csr_array":
        """From the control points of the space to those of the mesh."""
        from scipy.sparse import csr_array, eye_array, kron

        if self.lattice is None:
            return csr_array(eye_array(self.tmesh.n_anchors))
        along_x, along_y = self.insertions()
        row, column = on_grid(self.tmesh)
        places = row * (self.lattice[0] + 3) + column
        return csr_array(csr_array(kron(along_y, along_x))[places])


@dataclass(frozen=True, eq=False)
class Spaces:
    """Nested spaces, coarse first; why refinement stopped, and warnings."""

    levels: tuple[Level, ...]
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
    mesh, spaces = b_lattice(*lattice), []
    for _ in range(levels - 1):
        spaces.append(Level(mesh, lattice, (lattice[0] >= _WIDE, lattice[1] >= _WIDE)))
        for _ in range(2):
            mesh = bisect(mesh, np.ones(mesh.n_elements, bool)).mesh
        lattice = (2 * lattice[0], 2 * lattice[1])
    return Spaces((*spaces, Level(mesh, lattice)))


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
        warnings.append(
            f"{len(meshes)} bands instead of {count}: single steps of refinement met several of the tolerances at "
            "once; for more give a smaller tolerance or a coarser lattice"
        )
    return Spaces(tuple(Level(mesh) for mesh in meshes), terminate(problem, state), tuple(warnings))
