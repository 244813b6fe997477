"""Harmonic coordinates of a disk with four corners, and what they say about conformality.

u solves Laplace's equation with 0 and 1 on two opposite sides and natural conditions on the others, v the other way
round. With Dirichlet energies E_u and E_v, h = √(E_u / E_v) is the side ratio and (u, h v) the map to a rectangle. Of
the exact solutions E_u · E_v = 1 (each energy is the inverse of the extremal distance between its sides: Ahlfors,
*Conformal Invariants*, 1973, chapter 4). Finite elements overestimate either: the product tells how far they are off.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.linalg import splu

from ._result import Dilatation
from ._triangles import Loop, Triangles

_INSIDE = 1e-6
_FLATTEST = 1e-9  # area of a triangle, as a share of the mean, below which it counts as one of that area


class Harmonic(NamedTuple):
    """Coordinates (u, v) in [0, 1]² of every vertex, and their Dirichlet energies."""

    coordinates: Float[np.ndarray, "n 2"]
    energies: tuple[float, float]

    @property
    def side_ratio(self) -> float:
        """The ratio h = √(E_u / E_v) of the rectangle's sides."""
        return float(np.sqrt(self.energies[0] / self.energies[1]))


def _elements(points: Float[np.ndarray, "n 3"], triangles: Triangles) -> Float[np.ndarray, "k 3 3"]:
    """Dirichlet energies of pairs of linear hat functions on each triangle: eₐ · e_b / 4A with the opposite edges."""
    corners = points[triangles]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    area = areas(points, triangles)
    return opposite @ np.swapaxes(opposite, 1, 2) / (4 * np.maximum(area, _FLATTEST * area.mean()))[:, None, None]


def areas(points: Float[np.ndarray, "n 3"], triangles: Triangles) -> Float[np.ndarray, " k"]:
    """Return the areas of triangles in space.

    >>> areas(np.array([[0.0, 0, 1], [1, 0, 1], [0, 1, 1]]), np.array([[0, 1, 2]]))
    array([0.5])
    """
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def mesh_laplacian(points: Float[np.ndarray, "n 3"], triangles: Triangles) -> sparse.csc_matrix:
    """The Laplacian of linear finite elements on a triangle mesh, positive semi-definite (cotangent weights).

    Not those of intrinsic Delaunay triangles: on a ragged boundary their flips let the solution leak through the sides.
    """
    rows, columns = np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, (1, 3)).ravel()
    values = _elements(points, triangles).ravel()
    return sparse.csc_matrix((values, (rows, columns)), (len(points), len(points)))


def harmonic_rectangle(laplacian: sparse.csc_matrix, loop: Loop, corners: Int[np.ndarray, "4"]) -> Harmonic:
    """Solve for both coordinates.

    **Arguments:**

    - `laplacian`: (n, n), symmetric and positive semi-definite.
    - `loop`: vertices of the outer boundary.
    - `corners`: places in the loop of (0, 0), (1, 0), (1, 1), (0, 1).
    """
    ring = np.roll(loop, -corners[0])
    ends = np.append((corners - corners[0]) % len(loop), len(loop))
    ring = np.append(ring, ring[0])
    bottom, right, top, left = (ring[start : stop + 1] for start, stop in pairwise(ends))
    solved = [_dirichlet(laplacian, zero, one) for zero, one in ((left, right), (bottom, top))]
    energies = [float(values @ (laplacian @ values)) for values in solved]
    return Harmonic(np.stack(solved, axis=1), (energies[0], energies[1]))


def _dirichlet(laplacian: sparse.csc_matrix, zero: Loop, one: Loop) -> Float[np.ndarray, " n"]:
    values = np.zeros(len(laplacian.indptr) - 1)
    values[one] = 1.0
    free = np.ones(len(values), bool)
    free[zero] = free[one] = False
    if free.any():
        rows = laplacian[free]
        factor = splu(
            rows[:, free].tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        # Obtuse triangles may overshoot; what is not on a side must not fall on it.
        values[free] = np.clip(factor.solve(-(rows @ values)), _INSIDE, 1.0 - _INSIDE)
    return values


def dilatation(points: Float[np.ndarray, "n 3"], triangles: Triangles, plane: Float[np.ndarray, "n 2"]) -> Dilatation:
    """Return how far the map from a plane to a mesh is from a similarity.

    At every vertex the products ∇x · ∇x, ∇x · ∇y, ∇y · ∇y of the plane's coordinates, averaged over the area of the
    triangles around it; the dilatation is the ratio of the map's singular values there. (A single triangle would show
    how the scale changes across it, too, as if that were a distortion.)

    **Arguments:**

    - `points`: (n, 3), vertices in space.
    - `triangles`: (k, 3).
    - `plane`: (n, 2), their places in the plane.

    >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> dilatation(square, np.array([[0, 1, 2], [0, 2, 3]]), square[:, :2] * [1.0, 3.0]).median
    3.0
    """
    values = plane[triangles]
    products = np.swapaxes(values, 1, 2) @ _elements(points, triangles) @ values

    def around(of_triangles: np.ndarray) -> np.ndarray:
        return np.bincount(triangles.ravel(), np.repeat(of_triangles, 3), len(points))

    area = around(areas(points, triangles))
    xx, xy, yy = around(products[:, 0, 0]), around(products[:, 0, 1]), around(products[:, 1, 1])
    larger = 0.5 * (xx + yy + np.sqrt((xx - yy) ** 2 + 4 * xy**2))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = larger / np.sqrt(np.maximum(xx * yy - xy**2, 0.0))
    return Dilatation(*_weighted_quantiles(np.where(np.isnan(ratio), np.inf, ratio), area, (0.5, 0.95)))


def _weighted_quantiles(values: np.ndarray, weights: np.ndarray, shares: tuple[float, ...]) -> list[float]:
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    places = np.searchsorted(reached, np.array(shares) * reached[-1])
    return [float(value) for value in values[order][np.minimum(places, len(values) - 1)]]
