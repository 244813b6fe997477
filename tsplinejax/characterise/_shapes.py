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

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

_FEET = 40  # Newton's steps for the feet on a polynomial; a few suffice near it


class AbstractShape(ABC):
    """A surface known by its signed distance d(x), positive on the side of its normals."""

    @abstractmethod
    def distances(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        """Signed distances of points, along the normals at their feet."""

    @abstractmethod
    def normals(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Unit normals at the feet of points: the gradient of the distance."""

    @abstractmethod
    def derivatives(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m k"]:
        """Change of the distances with the k steps of the shape."""

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

    def _parts(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Offsets in the frame (m, 3), the squared length of their bending part, and S = √(1 + κ g)."""
        local = (points - self.place) @ self.frame
        squared = local[:, 0] ** 2 + local[:, 2] ** 2 + (0.0 if self.axial else local[:, 1] ** 2)
        g = self.curvature * squared + 2 * local[:, 0]
        return local, squared, np.sqrt(np.maximum(1 + self.curvature * g, 0.0))

    def distances(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        local, squared, root = self._parts(points)
        return (self.curvature * squared + 2 * local[:, 0]) / (1 + root)

    def normals(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        local, _, root = self._parts(points)
        bending = local * (1.0, 0.0 if self.axial else 1.0, 1.0)
        # On the axis every direction is as near; that of the place is taken.
        gradient = (self.curvature * bending + (1.0, 0.0, 0.0)) / np.where(root > 0, root, 1.0)[:, None]
        return np.where(root[:, None] > 0, gradient, (1.0, 0.0, 0.0)) @ self.frame.T

    def derivatives(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m k"]:
        local, squared, root = self._parts(points)
        along, axis, across = local.T
        steps = [-2 - 2 * self.curvature * along, 2 * across, -2 * axis]
        if self.axial:
            steps[2] = steps[2] * (1 + self.curvature * along)
        if not self.flat:
            d = (self.curvature * squared + 2 * along) / (1 + root)
            steps.append(squared - d**2)
        if self.axial:
            steps.append(2 * self.curvature * axis * across)
        return np.stack(steps, axis=1) / (2 * np.where(root > 0, root, 1.0))[:, None]

    def above(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        # κ |y⊥ + h e⊥|² + 2 n·(y + h e) = 0 with e along z: the root that stays finite for κ = 0.
        local, squared, _ = self._parts(points)
        up = self.frame[2]
        bends = np.array([1.0, 0.0 if self.axial else 1.0, 1.0])
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

    def basis(self, x: np.ndarray, y: np.ndarray, dx: int = 0, dy: int = 0) -> Float[np.ndarray, "m k"]:
        """The products at places, or their partial derivatives."""
        order = max(i + j for i, j in self.exponents)
        along = [_legendre(values, order, times) for values, times in ((x, dx), (y, dy))]
        return np.stack([along[0][:, i] * along[1][:, j] for i, j in self.exponents], axis=1)

    def heights(self, x: np.ndarray, y: np.ndarray, dx: int = 0, dy: int = 0) -> Float[np.ndarray, " m"]:
        """Heights at places, or their partial derivatives."""
        return self.basis(x, y, dx, dy) @ self.coefficients

    def _feet(self, points: np.ndarray) -> np.ndarray:
        """Feet by Newton's iteration in the plane, from the points below; damped to where the problem is convex."""
        x, y = points[:, 0].copy(), points[:, 1].copy()
        reach = np.ptp(points, axis=0).max()
        for _ in range(_FEET):
            z, zx, zy = self.heights(x, y), self.heights(x, y, 1), self.heights(x, y, 0, 1)
            off = z - points[:, 2]
            gx, gy = x - points[:, 0] + off * zx, y - points[:, 1] + off * zy
            hxx, hyy = 1 + zx**2 + off * self.heights(x, y, 2), 1 + zy**2 + off * self.heights(x, y, 0, 2)
            hxy = zx * zy + off * self.heights(x, y, 1, 1)
            determinant = hxx * hyy - hxy**2
            convex = (determinant > 0.1) & (hxx > 0.1)
            hxx, hyy = np.where(convex, hxx, 1 + zx**2), np.where(convex, hyy, 1 + zy**2)
            hxy = np.where(convex, hxy, zx * zy)
            determinant = hxx * hyy - hxy**2
            sx, sy = (hyy * gx - hxy * gy) / determinant, (hxx * gy - hxy * gx) / determinant
            x, y = x - sx, y - sy
            if max(np.abs(sx).max(), np.abs(sy).max()) <= 1e-15 * reach:
                break
        return np.column_stack([x, y, self.heights(x, y)])

    def _normals_at(self, feet: np.ndarray) -> np.ndarray:
        slopes = [-self.heights(feet[:, 0], feet[:, 1], *order) for order in ((1, 0), (0, 1))]
        direction = np.column_stack([*slopes, np.ones(len(feet))])
        return self.side * direction / np.linalg.norm(direction, axis=1, keepdims=True)

    def distances(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
        feet = self._feet(points)
        return np.einsum("mi,mi->m", points - feet, self._normals_at(feet))

    def normals(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        return self._normals_at(self._feet(points))

    def derivatives(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m k"]:
        feet = self._feet(points)
        return -self.basis(feet[:, 0], feet[:, 1]) * self._normals_at(feet)[:, 2:]

    def above(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        return np.column_stack([points[:, :2], self.heights(points[:, 0], points[:, 1])])

    def moved(self, step: Float[np.ndarray, " k"]) -> "PolynomialShape":
        return replace(self, coefficients=self.coefficients + step)

    def reversed(self) -> "PolynomialShape":
        return replace(self, side=-self.side)


def _legendre(values: np.ndarray, order: int, times: int) -> Float[np.ndarray, "m n"]:
    """Legendre polynomials of degree 0 to `order`, differentiated so many times, as columns."""
    columns = [np.polynomial.Legendre.basis(degree).deriv(times)(values) for degree in range(order + 1)]
    return np.stack(np.broadcast_arrays(*columns), axis=1)
