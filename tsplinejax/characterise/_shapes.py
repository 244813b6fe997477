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
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

_FEET = 40  # Newton's steps for the feet on a polynomial; a few suffice near it
_FIRST = np.array([1.0, 0.0, 0.0])
_AT_REST = 1e-13  # in units of the data's size


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

    def basis(self, x: np.ndarray, y: np.ndarray) -> Float[np.ndarray, "m k"]:
        """The products at places."""
        order = max(i + j for i, j in self.exponents)
        along, across = (np.polynomial.legendre.legvander(values, order) for values in (x, y))
        return np.stack([along[:, i] * across[:, j] for i, j in self.exponents], axis=1)

    def heights(self, x: np.ndarray, y: np.ndarray, dx: int = 0, dy: int = 0) -> Float[np.ndarray, " m"]:
        """Heights at places, or their partial derivatives."""
        order = max(i + j for i, j in self.exponents)
        table = np.zeros((order + 1, order + 1))
        table[tuple(np.transpose(self.exponents))] = self.coefficients
        for axis, times in ((0, dx), (1, dy)):
            table = np.polynomial.legendre.legder(table, times, axis=axis)
        return np.polynomial.legendre.legval2d(x, y, table)

    def _feet(self, points: np.ndarray) -> np.ndarray:
        """Feet by Newton's iteration in the plane, from the points below; damped to where the problem is convex."""
        x, y = points[:, 0].copy(), points[:, 1].copy()
        for _ in range(_FEET):
            zx, zy = self.heights(x, y, 1), self.heights(x, y, 0, 1)
            off = self.heights(x, y) - points[:, 2]
            gx, gy = x - points[:, 0] + off * zx, y - points[:, 1] + off * zy
            hxx, hyy = 1 + zx**2 + off * self.heights(x, y, 2), 1 + zy**2 + off * self.heights(x, y, 0, 2)
            hxy = zx * zy + off * self.heights(x, y, 1, 1)
            convex = (hxx * hyy - hxy**2 > 0.1) & (hxx > 0.1)
            hxx, hyy = np.where(convex, hxx, 1 + zx**2), np.where(convex, hyy, 1 + zy**2)
            hxy = np.where(convex, hxy, zx * zy)
            determinant = hxx * hyy - hxy**2
            step_x, step_y = (hyy * gx - hxy * gy) / determinant, (hxx * gy - hxy * gx) / determinant
            x, y = x - step_x, y - step_y
            if max(np.abs(step_x).max(), np.abs(step_y).max()) <= _AT_REST:
                break
        return np.column_stack([x, y, self.heights(x, y)])

    def contact(self, points: Float[np.ndarray, "m 3"]) -> Contact:
        feet = self._feet(points)
        x, y, _ = feet.T
        direction = np.column_stack([-self.heights(x, y, 1), -self.heights(x, y, 0, 1), np.ones(len(feet))])
        normals = self.side * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        distances = np.einsum("mi,mi->m", points - feet, normals)
        return Contact(distances, normals, -self.basis(x, y) * normals[:, 2:])

    def above(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        return np.column_stack([points[:, :2], self.heights(points[:, 0], points[:, 1])])

    def moved(self, step: Float[np.ndarray, " k"]) -> "PolynomialShape":
        return replace(self, coefficients=self.coefficients + step)

    def reversed(self) -> "PolynomialShape":
        return replace(self, side=-self.side)
