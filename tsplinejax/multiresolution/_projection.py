"""Least squares of a map over a space, solved to round-off: the orthogonal projection on the samples.

Over the uniform lattice of a gapless map the normal matrix is a product of one along y and one along x. Elsewhere it is
factorised once, with a trace of bending energy added, and preconditions conjugate gradients without it: what the
samples determine is solved to round-off, and what none determines stays as flat as the trace leaves it.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import DTypeLike

from ..data import HeightMap
from ..filtration._lattice import gridded_surface, smoother
from ..filtration._separable import conjugate_gradients
from ..fitting import default_smoothing
from ..fitting._design import Design, energy_matrix, factorise
from ..mesh import TMesh
from ..space import spline_space
from ..surface import TSpline, make_surface

_PASSES = 2


class AbstractProjection(ABC):
    """A space, ready to project maps on."""

    @abstractmethod
    def of(self, heights: Float[np.ndarray, "rows columns"]) -> TSpline:
        """The surface in the space with the least squares at the valid pixels; heights at others do not count."""


@dataclass(frozen=True, eq=False)
class LatticeProjection(AbstractProjection):
    """Onto a mesh that is a uniform lattice of (M, N) elements, of a map without missing pixels."""

    height_map: HeightMap
    tmesh: TMesh
    lattice: tuple[int, int]
    dtype: DTypeLike

    def of(self, heights: Float[np.ndarray, "rows columns"]) -> TSpline:
        """Solve, and once more for what rounding left."""
        equations = smoother(self.height_map, self.lattice, 0.0)
        points, _ = equations.solve(heights)
        points = points + equations.solve(heights - equations.values(points))[0]
        return gridded_surface(points, self.tmesh, self.height_map.frame, self.dtype)


class MeshProjection(AbstractProjection):
    """Onto any mesh, of a map with or without missing pixels."""

    def __init__(self, height_map: HeightMap, tmesh: TMesh, dtype: DTypeLike) -> None:
        samples = height_map.samples()
        self.frame, self.index = height_map.frame, samples.grid_index
        self.space = spline_space(tmesh, dtype=dtype, rational=False)
        self.design = Design(self.space, samples.parameters)
        energy = energy_matrix(self.space, self.frame)
        self.factor = factorise(self.design, energy, default_smoothing(len(samples)), "the map")

    def of(self, heights: Float[np.ndarray, "rows columns"]) -> TSpline:
        """Solve, and again for what rounding left."""
        values = heights.ravel()[self.index].astype(np.float64)
        points = np.zeros(int(self.space.n_functions))
        for _ in range(_PASSES):
            points = points + conjugate_gradients(self._normal, self._precondition, self._load(values))[0]
            values = heights.ravel()[self.index] - self._values(points)
        return make_surface(self.space, points, self.frame)

    def _values(self, points: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
        """B p."""
        return np.concatenate([band @ points for _, band in self.design])

    def _load(self, values: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
        """Bᵀ v."""
        return np.sum([band.T @ values[taken] for taken, band in self.design], axis=0)

    def _normal(self, points: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Bᵀ B p."""
        return np.sum([band.T @ (band @ points) for _, band in self.design], axis=0)

    def _precondition(self, residual: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """(Bᵀ B + λ K)⁻¹ r."""
        return self.factor.solve(residual[:, None])[:, 0]
