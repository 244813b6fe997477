"""Shapes with few numbers, as their signed distances, and how these change with the numbers.

Plane, sphere and cylinder are one shape: a place on it, its unit normal n there, and a curvature κ. With y from the
place to a point, and y⊥ the part of y that bends (all of it for a sphere, what is across the axis for a cylinder),

    g = κ |y⊥|² + 2 n·y,    d = g / (1 + √(1 + κ g))

is the signed distance, exact and well conditioned however flat the shape is (Lukács, Martin, Marshall 1998, "Faithful
least-squares fitting of spheres, cylinders, cones and tori"). κ > 0 bends away from n (a dome), κ < 0 towards it (a
bowl), and a plane is κ = 0. A polynomial is z = Σ c_k φ_k(x, y); its distances come from Newton's iteration for feet.

All lengths are in the scaled coordinates of a fit. Steps of a shape are small moves of all its numbers at once.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

_FEET = 40  # Newton's steps for the feet on a polynomial; a few suffice near it
_FIRST = np.array([1.0, 0.0, 0.0])
_AT_REST = 1e-10  # a step of a foot, in units of the data's size: the error after it is about its square
_CHUNK = 1 << 16  # points at a time


class Contact(NamedTuple):
    """How m points stand to a shape.

    `distances` (m,) are signed, along the unit `normals` (m, 3) at the points' feet, which are the distances' gradient;
    `derivatives` (m, k) are the distances' change with the k steps of the shape.
    """

    distances: Float[np.ndarray, " m"]
    normals: Float[np.ndarray, "m 3"]
    derivatives: Float[np.ndarray, "m k"]


class AbstractShape(ABC):
    """A surface known by its signed distance d(x), positive on the side of its normals."""

    @abstractmethod
    def contact(self, points: Float[np.ndarray, "m 3"]) -> Contact:
        """Distances, normals and derivatives at points."""

    @abstractmethod
    def above(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """The points of the shape at the same x and y; z is NaN where the shape does not reach."""

    @abstractmethod
    def moved(self, step: Float[np.ndarray, " k"]) -> "AbstractShape":
        """The shape after a step."""

    @abstractmethod
    def reversed(self) -> "AbstractShape":
        """The same surface with its normals on the other side."""


@dataclass(frozen=True, eq=False)
class Quadric(AbstractShape):
    """A plane, a sphere or a cylinder.

    **Arguments:**

    - `place`: (3,), a point on it.
    - `frame`: (3, 3), columns n (the normal at the place), t and b = t × n; t is a cylinder's axis.
    - `curvature`: κ, 0 for a plane.
    - `axial`: bends only across t.
    - `flat`: stays a plane; its curvature is no free number.
    """

    place: Float[np.ndarray, " 3"]
    frame: Float[np.ndarray, "3 3"]
    curvature: float = 0.0
    axial: bool = False
    flat: bool = False

    def contact(self, points: Float[np.ndarray, "m 3"]) -> Contact:
        local = (points - self.place) @ self.frame
        along, axis, across = local.T
        squared = along**2 + across**2 + (0.0 if self.axial else axis**2)
        g = self.curvature * squared + 2 * along
        root = np.sqrt(np.maximum(1 + self.curvature * g, 0.0))
        distances = g / (1 + root)
        # On the axis every direction is as near; that of the place is taken.
        inverse = 1 / np.where(root > 0, root, 1.0)
        bending = self.curvature * local * (1.0, 0.0 if self.axial else 1.0, 1.0)
        normals = np.where(root[:, None] > 0, (bending + _FIRST) * inverse[:, None], _FIRST)
        steps = [-2 - 2 * self.curvature * along, 2 * across, -2 * axis]
        if self.axial:
            steps[2] = steps[2] * (1 + self.curvature * along)
        if not self.flat:
            steps.append(squared - distances**2)
        if self.axial:
            steps.append(2 * self.curvature * axis * across)
        return Contact(distances, normals @ self.frame.T, np.stack(steps, axis=1) * (inverse / 2)[:, None])

    def above(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        # κ |y⊥ + h e⊥|² + 2 n·(y + h e) = 0 with e along z: the root that stays finite for κ = 0.
        local = (points - self.place) @ self.frame
        up = self.frame[2]
        bends = np.array([1.0, 0.0 if self.axial else 1.0, 1.0])
        squared = local**2 @ bends
        a = self.curvature * float((up**2 * bends).sum())
        b = 2 * (self.curvature * local @ (up * bends) + up[0])
        c = self.curvature * squared + 2 * local[:, 0]
        with np.errstate(invalid="ignore", divide="ignore"):
            rise = -2 * c / (b + np.where(up[0] < 0, -1.0, 1.0) * np.sqrt(b**2 - 4 * a * c))
        return np.column_stack([points[:, :2], points[:, 2] + np.where(c == 0, 0.0, rise)])

    def moved(self, step: Float[np.ndarray, " k"]) -> "Quadric":
        n, t, b = self.frame.T
        turn = step[1] * t + step[2] * b
        if self.axial:
            turn = turn + step[4] * n
        turned = Rotation.from_rotvec(turn).as_matrix() @ self.frame
        bend = 0.0 if self.flat else step[3]
        return replace(self, place=self.place + step[0] * n, frame=turned, curvature=self.curvature + bend)

    def reversed(self) -> "Quadric":
        frame = self.frame * (-1.0, 1.0, -1.0)
        return replace(self, frame=frame, curvature=-self.curvature)


@dataclass(frozen=True, eq=False)
class PolynomialShape(AbstractShape):
    """z = Σ c_k x^i y^j over the exponents (i, j) with i + j ≤ order, in products of Legendre polynomials.

    `side` is 1 for normals that point up, -1 for normals that point down.
    """

    coefficients: Float[np.ndarray, " k"]
    exponents: tuple[tuple[int, int], ...]
    side: float = 1.0

    @property
    def order(self) -> int:
        """The highest i + j."""
        return max(i + j for i, j in self.exponents)

    def basis(self, x: np.ndarray, y: np.ndarray) -> Float[np.ndarray, "m k"]:
        """The products at places."""
        along, across = (np.polynomial.legendre.legvander(values, self.order).T for values in (x, y))
        return np.stack([along[i] * across[j] for i, j in self.exponents]).T

    def partials(self, places: Float[np.ndarray, "m 2"], orders: Sequence[tuple[int, int]]) -> Iterator[np.ndarray]:
        """Partial derivatives (m,) of the heights at places, of orders (in x, in y)."""
        along, across = (np.polynomial.legendre.legvander(values, self.order).T for values in places.T)
        whole = np.zeros((self.order + 1, self.order + 1))
        whole[tuple(np.transpose(self.exponents))] = self.coefficients
        for times in orders:
            table = whole
            for axis in range(2):
                table = np.polynomial.legendre.legder(table, times[axis], axis=axis)
            rows, columns = table.shape
            yield np.einsum("jm,jm->m", table.T @ along[:rows], across[:columns])

    def _feet(self, points: np.ndarray) -> Float[np.ndarray, "m 2"]:
        """Where the feet are in the plane, by Newton's iteration from the points below; those that rest drop out."""
        feet = points[:, :2].copy()
        moving = np.arange(len(points))
        for _ in range(_FEET):
            step = self._newton(points[moving], feet[moving])
            feet[moving] -= step
            moving = moving[np.abs(step).max(axis=1) > _AT_REST]
            if not len(moving):
                break
        return feet

    def _newton(self, points: np.ndarray, feet: np.ndarray) -> Float[np.ndarray, "m 2"]:
        """Newton's step of the squared distance; Gauss-Newton's where that is not convex."""
        z, zx, zy, zxx, zxy, zyy = self.partials(feet, ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)))
        off = z - points[:, 2]
        gx, gy = (feet - points[:, :2]).T + off * np.stack([zx, zy])
        hxx, hyy, hxy = 1 + zx**2 + off * zxx, 1 + zy**2 + off * zyy, zx * zy + off * zxy
        convex = (hxx * hyy - hxy**2 > 0.1) & (hxx > 0.1)
        hxx, hyy, hxy = np.where(convex, (hxx, hyy, hxy), (1 + zx**2, 1 + zy**2, zx * zy))
        return np.stack([hyy * gx - hxy * gy, hxx * gy - hxy * gx], axis=1) / (hxx * hyy - hxy**2)[:, None]

    def contact(self, points: Float[np.ndarray, "m 3"]) -> Contact:
        parts = [self._contact(points[first : first + _CHUNK]) for first in range(0, max(len(points), 1), _CHUNK)]
        distances, normals, feet = (np.concatenate(part) for part in zip(*parts, strict=True))
        return Contact(distances, normals, self.basis(*feet.T) * -normals[:, 2:])

    def _contact(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances, normals and places of the feet of some points."""
        feet = self._feet(points)
        z, zx, zy = self.partials(feet, ((0, 0), (1, 0), (0, 1)))
        direction = np.stack([-zx, -zy, np.ones_like(z)], axis=1)
        normals = self.side * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        off = np.column_stack([points[:, :2] - feet, points[:, 2] - z])
        return np.einsum("mi,mi->m", off, normals), normals, feet

    def above(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        (heights,) = self.partials(points[:, :2], ((0, 0),))
        return np.column_stack([points[:, :2], heights])

    def moved(self, step: Float[np.ndarray, " k"]) -> "PolynomialShape":
        return replace(self, coefficients=self.coefficients + step)

    def reversed(self) -> "PolynomialShape":
        return replace(self, side=-self.side)
