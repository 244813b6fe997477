"""Harmonic coordinates of a disk with four corners, and what they say about conformality.

u solves Laplace's equation with 0 and 1 on two opposite sides and natural conditions on the others, v the other way round.
With Dirichlet energies E_u and E_v, h = √(E_u / E_v) is the side ratio and (u, h v) the map to a rectangle; it is conformal
if and only if E_u · E_v = 1, which is at least 1 for exact solutions of either problem: E_u is the inverse of the extremal
distance of its sides (Ahlfors, *Conformal Invariants*, 1973, chapter 4).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.linalg import splu

from .._errors import require
from ._result import Dilatation
from ._triangles import Loop, Triangles


_FLATTEST = 1e-9  # area of a triangle, as a share of the mean, below which it counts as one of that area


class Harmonic(NamedTuple):
    """Coordinates (u, v) in [0, 1]² of every vertex, and their Dirichlet energies."""

    coordinates: Float[np.ndarray, "n 2"]
    energies: tuple[float, float]

    @property
    def side_ratio(self) -> float:
        """The ratio h = √(E_u / E_v) of the rectangle's sides."""
        return float(np.sqrt(self.energies[0] / self.energies[1]))


def cloud_laplacian(points: Float[np.ndarray, "m 3"], neighbours: int) -> sparse.csc_matrix:
    """The Laplacian of a bare point cloud, positive semi-definite.

    Sharp & Crane, "A Laplacian for nonmanifold triangle meshes", SGP 2020.
    """
    library = require("robust_laplacian", "mesh")
    return library.point_cloud_laplacian(points, n_neighbors=min(neighbours, len(points) - 1))[0]


def mesh_laplacian(points: Float[np.ndarray, "n 3"], triangles: Triangles) -> sparse.csc_matrix:
    """The Laplacian of linear finite elements on a triangle mesh, positive semi-definite (cotangent weights).

    Not the intrinsic Delaunay one: on a ragged boundary its flips would let the solution leak through the sides.
    """
    corners = points[triangles]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    area = 0.5 * np.linalg.norm(np.cross(opposite[:, 0], opposite[:, 1]), axis=1)
    # Entry (a, b) of an element is eₐ · e_b / 4A, with the edges opposite to its corners.
    elements = opposite @ np.swapaxes(opposite, 1, 2) / (4 * np.maximum(area, _FLATTEST * area.mean()))[:, None, None]
    rows, columns = np.repeat(triangles, 3, axis=1).ravel(), np.tile(triangles, (1, 3)).ravel()
    return sparse.csc_matrix((elements.ravel(), (rows, columns)), (len(points), len(points)))


def harmonic_rectangle(laplacian: sparse.csc_matrix, loop: Loop, corners: Int[np.ndarray, "4"]) -> Harmonic:
    """Solve for both coordinates.

    **Arguments:**

    - `laplacian`: (n, n), positive semi-definite.
    - `loop`: vertices of the outer boundary.
    - `corners`: places in the loop of (0, 0), (1, 0), (1, 1), (0, 1).
    """
    ring = np.roll(loop, -corners[0])
    ends = np.append((corners - corners[0]) % len(loop), len(loop))
    ring = np.append(ring, ring[0])
    bottom, right, top, left = (ring[start : stop + 1] for start, stop in zip(ends[:-1], ends[1:], strict=True))
    solved = [_dirichlet(laplacian, zero, one) for zero, one in ((left, right), (bottom, top))]
    energies = [float(values @ (laplacian @ values)) for values in solved]
    return Harmonic(np.stack(solved, axis=1), (energies[0], energies[1]))


def _dirichlet(laplacian: sparse.csc_matrix, zero: Loop, one: Loop) -> Float[np.ndarray, " n"]:
    values = np.zeros(laplacian.shape[0])
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
        values[free] = factor.solve(-(rows @ values))
    return np.clip(values, 0.0, 1.0)


def dilatation(
    points: Float[np.ndarray, "n 3"], triangles: Triangles, plane: Float[np.ndarray, "n 2"]
) -> tuple[Dilatation, float]:
    """Return the dilatation of the map from the plane to a mesh, and the mesh's area.

    The map is linear on each triangle. With its first fundamental form [[E, F], [F, G]], the squares of the singular values
    are the eigenvalues of the form, and the dilatation is √(larger / smaller).
    """
    corners, flat = points[triangles], plane[triangles]
    edges = corners[:, 1:] - corners[:, :1]
    normal = np.cross(edges[:, 0], edges[:, 1])
    area = 0.5 * np.linalg.norm(normal, axis=1)
    (ax, ay), (bx, by) = np.moveaxis(flat[:, 1:] - flat[:, :1], 1, 0).transpose(0, 2, 1)
    double = ax * by - ay * bx
    with np.errstate(divide="ignore", invalid="ignore"):
        along_x = (edges[:, 0] * by[:, None] - edges[:, 1] * ay[:, None]) / double[:, None]
        along_y = (edges[:, 1] * ax[:, None] - edges[:, 0] * bx[:, None]) / double[:, None]
        e, f, g = ((one * two).sum(axis=1) for one, two in ((along_x, along_x), (along_x, along_y), (along_y, along_y)))
        spread = np.sqrt((e - g) ** 2 + 4 * f**2)
        # The smaller eigenvalue as determinant over the larger one: no cancellation.
        ratio = (e + g + spread) / (2 * np.abs(2 * area / double))
    ratio = np.where(np.isfinite(ratio), ratio, np.inf)
    return Dilatation(*_weighted_quantiles(ratio, area, (0.5, 0.95))), float(area.sum())


def _weighted_quantiles(values: np.ndarray, weights: np.ndarray, shares: tuple[float, ...]) -> list[float]:
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    places = np.searchsorted(reached, np.array(shares) * reached[-1])
    return [float(value) for value in values[order][np.minimum(places, len(values) - 1)]]
