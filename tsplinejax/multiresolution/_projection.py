"""Least squares of a map over a space: the orthogonal projection on the samples.

Over the uniform lattice of a gapless map the normal matrix is a product of one along y and one along x. Elsewhere it is
factorised with a little bending energy added, and solved again for what that left: control points that the samples
determine come out as without it. Others, at the rim of a hole, may be seen by the samples in a last tail alone: without
it they would follow that tail's noise to thousands of times its height.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import DTypeLike

from .._errors import InputError
from ..data import HeightMap
from ..filtration._lattice import gridded_surface
from ..filtration._separable import Smoother, spline_axis
from ..fitting._design import Design, energy_matrix, factorised
from ..space import spline_space
from ..surface import TSpline, make_surface
from ._spaces import Level

_PASSES = 3
_CUTOFF = 0.5  # of the smoothing in each pass, in elements: of a wave two elements long a pass leaves 1 / 257


class AbstractProjection(ABC):
    """A space, ready to project maps on."""

    @abstractmethod
    def of(self, heights: Float[np.ndarray, "rows columns"]) -> TSpline:
        """The surface in the space with the least squares at the valid pixels; heights at others do not count."""


@dataclass(frozen=True, eq=False)
class LatticeProjection(AbstractProjection):
    """Onto a uniform lattice, of a map without missing pixels."""

    height_map: HeightMap
    level: Level
    dtype: DTypeLike

    def of(self, heights: Float[np.ndarray, "rows columns"]) -> TSpline:
        """Solve, and once more for what rounding left."""
        (rows, columns), (dx, dy) = self.height_map.shape, self.height_map.spacing
        assert self.level.lattice is not None
        (elements_x, elements_y), (wide_x, wide_y) = self.level.lattice, self.level.wide
        along_y = spline_axis(rows, dy, elements_y, wide=wide_y)
        along_x = spline_axis(columns, dx, elements_x, wide=wide_x)
        equations = Smoother(along_y, along_x, self.height_map.valid, 0.0)
        points, _ = equations.solve(heights)
        points = points + equations.solve(heights - equations.values(points))[0]
        to_x, to_y = self.level.insertions()
        return gridded_surface(to_y @ points @ to_x.T, self.level.tmesh, self.height_map.frame, self.dtype)


class MeshProjection(AbstractProjection):
    """Onto any of the spaces, of a map with or without missing pixels."""

    def __init__(self, height_map: HeightMap, level: Level, dtype: DTypeLike) -> None:
        samples = height_map.samples()
        self.frame, self.index = height_map.frame, samples.grid_index
        self.space = spline_space(level.tmesh, dtype=dtype, rational=False)
        self.design, self.change = Design(self.space, samples.parameters), level.change()
        matrix = height_map.heights.size * energy_matrix(self.space, self.frame, _CUTOFF)
        for _, band in self.design:
            matrix = matrix + band.T @ band
        refusal = InputError("the valid pixels do not determine the bands; give fewer levels or a coarser lattice")
        self.factor = factorised((self.change.T @ matrix @ self.change).tocsc(), refusal)

    def of(self, heights: Float[np.ndarray, "rows columns"]) -> TSpline:
        """Solve, and again for what the bending energy left."""
        values = heights.ravel()[self.index].astype(np.float64)
        points = np.zeros(int(self.space.n_functions))
        for _ in range(_PASSES):
            rest = values - np.concatenate([band @ points for _, band in self.design])
            load = np.sum([band.T @ rest[taken] for taken, band in self.design], axis=0)
            points = points + self.change @ self.factor.solve((self.change.T @ load)[:, None])[:, 0]
        return make_surface(self.space, points, self.frame)
