"""Halve the edges of a mesh: linear elements err by the size of triangles beside the bends of surface and outline.

The parts of a mesh's own triangles lie in them. A cloud's triangles stand for a smooth surface: there the middle of an
edge lies on the cubic that leaves its ends along the surface.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ._graded import halved
from ._smooth import LocalQuadratic
from ._triangles import Loop, Triangles


class Smooth(NamedTuple):
    """What is known of a cloud's surface at the vertices of a mesh: rough coordinates, and slopes over these."""

    surface: LocalQuadratic
    places: Float[np.ndarray, "n 2"]
    slopes: Float[np.ndarray, "n 2 3"]


class Mesh(NamedTuple):
    """A disk of triangles, its boundary, and the smooth surface that it stands for, if it does."""

    vertices: Float[np.ndarray, "n 3"]
    triangles: Triangles
    loop: Loop
    smooth: Smooth | None = None

    def finer(self) -> "Mesh":
        """All edges halved, new vertices after the old ones.

        >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        >>> len(Mesh(square, np.array([[0, 1, 2], [0, 2, 3]]), np.arange(4)).finer().triangles)
        8
        """
        count = len(self.vertices)
        vertices, triangles, loop, ends = halved(self.vertices, self.triangles, self.loop, np.ones(count, bool))
        if self.smooth is None:
            return Mesh(vertices, triangles, loop)
        surface, places, slopes = self.smooth
        start, end = ends.T
        # Hermite: the middle of the cubic with ends p, q and tangents u, v is (p + q) / 2 + (u - v) / 8.
        bend = np.einsum("nk,nkc->nc", places[end] - places[start], slopes[start] - slopes[end])
        vertices[count:] += bend / 8
        middles = (places[start] + places[end]) / 2
        _, found, known = surface(middles)
        # Across a hole nothing is known.
        between = np.where(known[:, None, None], found, (slopes[start] + slopes[end]) / 2)
        smooth = Smooth(surface, np.concatenate([places, middles]), np.concatenate([slopes, between]))
        return Mesh(vertices, triangles, loop, smooth)


def cloud_mesh(surface: LocalQuadratic, places: Float[np.ndarray, "n 2"], triangles: Triangles, loop: Loop) -> Mesh:
    """The mesh of a cloud's smooth surface over triangles between coordinates."""
    vertices, slopes, _ = surface(places)
    return Mesh(vertices, triangles, loop, Smooth(surface, places, slopes))
