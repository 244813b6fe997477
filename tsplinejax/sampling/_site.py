"""Where samples are wanted: a spline space, what is known of the surface, and where it can be measured."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ..data import Samples
from ..fitting._design import Design
from ..mesh import TMesh
from ..space import SplineSpace
from ..surface import TSpline, curvatures

#: Three Gauss points along each side integrate polynomials of degree five.
_NODES = 0.5 + np.sqrt(0.15) * np.array([-1.0, 0.0, 1.0])
_SHARES = np.outer([5.0, 8.0, 5.0], [5.0, 8.0, 5.0]).ravel() / 324
_AT_A_TIME = 1 << 17


@dataclass(frozen=True, eq=False)
class Site:
    """A model of the surface, whose space is to be recovered.

    **Attributes:**

    - `model`: the T-spline: its space and frame say where samples belong, its shape what they may show.
    - `candidates`: the measured samples among which places are chosen; `None` where the model itself is sampled.
    - `left_out`: how many measured samples lie beyond the model.
    """

    model: TSpline
    candidates: Samples | None = None
    left_out: int = 0

    @property
    def space(self) -> SplineSpace:
        """The space to be recovered."""
        return self.model.space

    @property
    def control_points(self) -> int:
        """Its number of blending functions."""
        return int(self.space.n_functions)

    @cached_property
    def tmesh(self) -> TMesh:
        """Its T-mesh."""
        return self.space.mesh

    @property
    def sides(self) -> Float[np.ndarray, " 2"]:
        """Physical lengths (Lx, Ly) of the parameter square."""
        return np.asarray(self.model.frame.extent)

    @cached_property
    def elements(self) -> Float[np.ndarray, "e 4"]:
        """Elements of the T-mesh as s0, t0, s1, t1."""
        return self.tmesh.element_boxes

    @cached_property
    def pieces(self) -> Float[np.ndarray, "b 4"]:
        """Bézier elements as s0, t0, s1, t1."""
        count = int(self.space.n_elements)
        corner, size = (
            np.asarray(part, np.float64)[:count] for part in (self.space.tables.corner, self.space.tables.size)
        )
        return np.concatenate([corner, corner + size], axis=1)

    @cached_property
    def everywhere(self) -> tuple[Design, Float[np.ndarray, " k"]]:
        """The blending functions at nine Gauss points in each Bézier element, and the share of the domain of each."""
        sizes = np.prod(self.pieces[:, 2:] - self.pieces[:, :2], axis=1)
        return Design(self.space, gauss_points(self.pieces)), np.outer(sizes, _SHARES).ravel()

    def values(self, places: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m d"]:
        """The model at places."""
        return np.asarray(self.model(places)).reshape(len(places), -1)

    def integrals(self, boxes: Float[np.ndarray, "e 4"], *, of_curvature: bool) -> Float[np.ndarray, " e"]:
        """The surface's area over each box, or the integral of its curvedness √(k₁² + k₂²) over that area."""
        places = gauss_points(boxes)
        density = np.concatenate(
            [
                self._density(places[first : first + _AT_A_TIME], of_curvature)
                for first in range(0, len(places), _AT_A_TIME)
            ]
        )
        sizes = np.prod(boxes[:, 2:] - boxes[:, :2], axis=1)
        return sizes * (density.reshape(-1, 9) @ _SHARES)

    def _density(self, places: Float[np.ndarray, "m 2"], of_curvature: bool) -> Float[np.ndarray, " m"]:
        """Area per unit of parameters, times the curvedness where asked for; zero where the surface is degenerate."""
        along_s, along_t = (np.asarray(self.model.derivative(places, order), np.float64) for order in ((1, 0), (0, 1)))
        if self.model.is_height_map:
            width, height = self.sides
            area = width * height * np.sqrt(1 + (along_s / width) ** 2 + (along_t / height) ** 2)
        else:
            area = np.linalg.norm(np.cross(along_s, along_t), axis=1)
        if not of_curvature:
            return area
        bent = curvatures(self.model, places)
        mean, gaussian = (np.asarray(part, np.float64) for part in (bent.mean, bent.gaussian))
        return np.nan_to_num(area * np.sqrt(np.maximum(4 * mean**2 - 2 * gaussian, 0)))


def gauss_points(boxes: Float[np.ndarray, "e 4"]) -> Float[np.ndarray, "k 2"]:
    """Three by three Gauss points of each box.

    >>> gauss_points(np.array([[0.0, 0.0, 1.0, 1.0]]))[4].tolist()
    [0.5, 0.5]
    """
    local = np.stack(np.meshgrid(_NODES, _NODES, indexing="ij"), axis=-1).reshape(-1, 2)
    return (boxes[:, None, :2] + local * (boxes[:, None, 2:] - boxes[:, None, :2])).reshape(-1, 2)
