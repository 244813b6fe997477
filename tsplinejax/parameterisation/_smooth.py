"""Smooth the positions of points in space, as functions of rough coordinates, so that noise does not count as shape.

Noise makes a triangulated cloud rough: its area grows, and angles on it are not those of the surface. A quadratic in
the coordinates, fitted to each place's neighbours, reproduces a smooth surface to the third order of their spacing, or
better.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

_CHUNK = 1 << 15
_RIDGE = 1e-9
_OUTLYING = 5.0  # standard deviations, and at least
_APART = 0.1  # of the neighbours' reach
_BESIDE = 0.5  # of the reach of a place's neighbours: where the nearest is farther off they lie on one side of it


class LocalQuadratic(NamedTuple):
    """A smooth surface through points, outliers left out, as a function of rough coordinates.

    **Attributes:**

    - `points`, `places`: (m, 3), positions in space; (m, 2), their coordinates, at a similar scale along both.
    - `tree`: of the places.
    - `neighbours`: how many take part in each quadratic; the nearest count most.
    - `trust`: (m,), 0 for outliers.
    """

    points: Float[np.ndarray, "m 3"]
    places: Float[np.ndarray, "m 2"]
    tree: cKDTree
    neighbours: int
    trust: Float[np.ndarray, " m"]

    def __call__(
        self, wanted: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2 3"], Bool[np.ndarray, " n"]]:
        """Positions and slopes at any coordinates, and which of them have points on all sides."""
        parts = [self._part(wanted[first : first + _CHUNK]) for first in range(0, max(len(wanted), 1), _CHUNK)]
        positions, slopes, known = (np.concatenate(part) for part in zip(*parts, strict=True))
        return positions, slopes, known

    def _part(self, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        distance, near = self.tree.query(wanted, self.neighbours + 1)
        scale = distance[:, -1:] + 1e-300
        weight = (self.trust[near] + 1e-6) * (1.0 - 0.99 * (distance / scale) ** 2)
        x, y = np.moveaxis((self.places[near] - wanted[:, None]) / scale[:, :, None], 2, 0)
        terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
        weighted = np.swapaxes(terms * weight[:, :, None], 1, 2)
        moments = weighted @ terms
        moments += _RIDGE * np.trace(moments, axis1=1, axis2=2)[:, None, None] * np.diag([0.0, 1, 1, 1, 1, 1])
        found = np.linalg.solve(moments, weighted @ self.points[near])
        return found[:, 0], found[:, 1:3] / scale[:, :, None], distance[:, 0] <= _BESIDE * scale[:, 0]


def surface_through(
    points: Float[np.ndarray, "m 3"], places: Float[np.ndarray, "m 2"], neighbours: int
) -> LocalQuadratic:
    """The surface through points, after those far off a first one are known.

    >>> places = np.random.default_rng(0).random((100, 2))
    >>> paraboloid = np.column_stack([places, places[:, 0] ** 2])
    >>> surface = surface_through(paraboloid, places, 20)
    >>> bool(np.allclose(surface(places)[0], paraboloid, atol=1e-6))
    True
    """
    tree, near = cKDTree(places), min(neighbours, len(points) - 1)
    first = LocalQuadratic(points, places, tree, near, np.ones(len(points)))
    smooth = first(places)[0]
    off = np.linalg.norm(points - smooth, axis=1)
    reach = np.linalg.norm(smooth[tree.query(places, [near + 1])[1][:, 0]] - smooth, axis=1)
    outlying = off > np.maximum(_OUTLYING * 1.4826 * np.median(off), _APART * reach)
    return first._replace(trust=np.where(outlying, 0.0, 1.0))
