"""Halve the edges of a mesh: linear elements err by the size of triangles beside the bends of surface and outline.

The parts of a mesh's own triangles lie in them. A cloud's triangles stand for a smooth surface: there the middles of
edges are lifted onto it, but for those across holes, where nothing is known.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ._graded import halved
from ._smooth import LocalQuadratic
from ._triangles import Loop, Triangles


class Mesh(NamedTuple):
    """A disk of triangles and its boundary; of a cloud also rough coordinates, and the surface as a function of them."""

    vertices: Float[np.ndarray, "n 3"]
    triangles: Triangles
    loop: Loop
    places: Float[np.ndarray, "n 2"] | None = None
    surface: LocalQuadratic | None = None

    def finer(self) -> "Mesh":
        """All edges halved, new vertices after the old ones.

        >>> square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        >>> len(Mesh(square, np.array([[0, 1, 2], [0, 2, 3]]), np.arange(4)).finer().triangles)
        8
        """
        count = len(self.vertices)
        everywhere = np.ones(count, bool)
        if self.places is None or self.surface is None:
            return Mesh(*halved(self.vertices, self.triangles, self.loop, everywhere))
        columns = np.hstack([self.vertices, self.places])
        columns, triangles, loop = halved(columns, self.triangles, self.loop, everywhere)
        vertices, places = np.split(columns, [3], axis=1)
        lifted, known = self.surface(places[count:])
        vertices[count:] = np.where(known[:, None], lifted, vertices[count:])
        return Mesh(vertices, triangles, loop, places, self.surface)
