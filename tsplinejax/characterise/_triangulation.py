"""Scattered samples over the parameter rectangle: the area that each stands for, and their values on a regular grid.

Points are triangulated in the parameter rectangle scaled to its mean side lengths (Delaunay). Triangles that bridge a
hole or run along a hollow border have an edge several times as long as the points lie apart; they are left out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import Delaunay, QhullError, cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled

_BRIDGE = 3.0  # times the usual distance of neighbours that an edge may be long
_NEIGHBOURS = 7  # the point itself and six others
_MOST_PIXELS = 4_000_000


@dataclass(frozen=True, eq=False)
class Triangulation:
    """Triangles between the places of samples in the plane.

    **Attributes:**

    - `places`: (m, 2).
    - `delaunay`: all triangles.
    - `kept`: (k,), those that do not bridge a gap.
    """

    places: Float[np.ndarray, "m 2"]
    delaunay: Delaunay
    kept: Bool[np.ndarray, " k"]

    def areas(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """The area that each sample stands for: a third of the triangles around it, with corners at `points` (m, 3)."""
        corners = self.delaunay.simplices[self.kept]
        a, b, c = (points[corners[:, k]] for k in range(3))
        thirds = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
        return np.bincount(corners.ravel(), np.repeat(thirds, 3), minlength=len(points))

    def on_grid(
        self, values: Float[np.ndarray, " m"], origin: Float[np.ndarray, " 2"], step: float, shape: tuple[int, int]
    ) -> Float[np.ndarray, "rows columns"]:
        """Linear interpolation on a grid of square pixels; NaN where no triangle is."""
        grid = np.full(shape, np.nan)
        x = origin[0] + step * np.arange(shape[1])
        for row in range(0, shape[0], max(1, 200_000 // shape[1])):
            rows = slice(row, row + max(1, 200_000 // shape[1]))
            y = origin[1] + step * np.arange(shape[0])[rows]
            places = np.stack(np.broadcast_arrays(x[None], y[:, None]), axis=-1).reshape(-1, 2)
            grid[rows] = self._interpolated(values, places).reshape(len(y), -1)
        return grid

    def _interpolated(self, values: np.ndarray, places: np.ndarray) -> np.ndarray:
        found = self.delaunay.find_simplex(places)
        inside = found >= 0
        inside[inside] = self.kept[found[inside]]
        transform = self.delaunay.transform[found[inside]]
        first = np.einsum("mij,mj->mi", transform[:, :2], places[inside] - transform[:, 2])
        shares = np.column_stack([first, 1 - first.sum(axis=1)])
        result = np.full(len(places), np.nan)
        result[inside] = (shares * values[self.delaunay.simplices[found[inside]]]).sum(axis=1)
        return result


def triangulate(places: Float[np.ndarray, "m 2"]) -> Triangulation | None:
    """Triangulate places in the plane; nothing where they span no area.

    >>> found = triangulate(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]))
    >>> len(found.delaunay.simplices)
    2
    """
    try:
        delaunay = Delaunay(places)
    except (QhullError, ValueError):
        return None
    corners = places[delaunay.simplices]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    count = min(_NEIGHBOURS, len(places))
    apart = cKDTree(places).query(places, k=[count], workers=-1)[0][:, 0]
    usual = np.maximum(apart[delaunay.simplices].min(axis=1), float(np.median(longest)))
    return Triangulation(places, delaunay, longest <= _BRIDGE * usual)


def grid_for(places: Float[np.ndarray, "m 2"]) -> tuple[Float[np.ndarray, " 2"], float, tuple[int, int]]:
    """Origin, pixel size and (rows, columns) of a grid as dense as the samples are on the whole."""
    low, extent = places.min(axis=0), np.ptp(places, axis=0)
    wanted = min(len(places), _MOST_PIXELS)
    step = float(np.sqrt(extent[0] * extent[1] / wanted))
    columns, rows = (max(2, int(np.floor(length / step + 1e-9)) + 1) for length in extent)
    return low, step, (rows, columns)


def nearest_of(places: Float[np.ndarray, "m d"], others: Float[np.ndarray, "n d"]) -> Int[np.ndarray, " n"]:
    """The index of the nearest place for each of the others."""
    return cKDTree(places).query(others, workers=-1)[1]
