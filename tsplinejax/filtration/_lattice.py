"""Uniform lattices over height maps: how many elements a spacing makes, and their surfaces."""

import math

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import DTypeLike

from ..data import Frame, HeightMap
from ..mesh import TMesh
from ..space import spline_space
from ..surface import TSpline, make_surface
from ._separable import Smoother, spline_axis

_ROUND = 1e-9


def lattice_of_spacing(height_map: HeightMap, spacing: float, *, finer: bool) -> tuple[int, int]:
    """Elements (M, N) of this size or a little finer (or coarser), never finer than the pixels determine.

    >>> lattice_of_spacing(HeightMap(np.zeros((41, 81))), 6.0, finer=True)
    (14, 7)
    """
    wanted = [length / spacing for length in height_map.extent]
    counts = [math.ceil(count - _ROUND) if finer else math.floor(count + _ROUND) for count in wanted]
    rows, columns = height_map.shape
    return max(1, min(counts[0], columns - 3)), max(1, min(counts[1], rows - 3))


def smoother(height_map: HeightMap, lattice: tuple[int, int], smoothing: float) -> Smoother:
    """The normal equations of a map over a lattice; λ weighs the physical bending energy."""
    (rows, columns), (dx, dy) = height_map.shape, height_map.spacing
    along_y, along_x = spline_axis(rows, dy, lattice[1]), spline_axis(columns, dx, lattice[0])
    return Smoother(along_y, along_x, height_map.valid, smoothing)


def gridded_surface(points: Float[np.ndarray, "rows columns"], tmesh: TMesh, frame: Frame, dtype: DTypeLike) -> TSpline:
    """Control points on a grid, rows along y, as a T-spline over a mesh without T-junctions."""
    row, column = on_grid(tmesh)
    return make_surface(spline_space(tmesh, dtype=dtype, rational=False), points[row, column], frame)


def on_grid(tmesh: TMesh) -> tuple[Int[np.ndarray, " n"], Int[np.ndarray, " n"]]:
    """Row and column of each control point of a mesh without T-junctions."""
    column, row = (np.unique(tmesh.anchors[:, k], return_inverse=True)[1] for k in range(2))
    return row, column
