"""The simple forms that users expect, as strategies: what they are, and where a fit of them starts.

Points are in the scaled coordinates of a fit: centred, of size about one.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ._shapes import AbstractShape, PolynomialShape, Quadric

_DIRECTIONS = 48  # axes that are tried for a cylinder, spread over the half sphere
_HIGHEST_ORDER = 20


class AbstractSimpleForm(ABC):
    """A form with few numbers."""

    @property
    @abstractmethod
    def name(self) -> str:
        """The form's name in reports: `plane`, `poly2`, `sphere`, `cylinder`."""

    @property
    @abstractmethod
    def size(self) -> int:
        """How many free numbers it has."""

    @abstractmethod
    def starts(self, points: Float[np.ndarray, "m 3"]) -> Iterator[AbstractShape]:
        """Shapes from which a fit may start."""


@dataclass(frozen=True)
class Plane(AbstractSimpleForm):
    """A plane.

    >>> Plane().size
    3
    """

    @property
    def name(self) -> str:
        return "plane"

    @property
    def size(self) -> int:
        return 3

    def starts(self, points: Float[np.ndarray, "m 3"]) -> Iterator[AbstractShape]:
        yield Quadric(points.mean(axis=0), _principal_frame(points), flat=True)


@dataclass(frozen=True)
class Polynomial(AbstractSimpleForm):
    """A polynomial z = Σ c_ij x^i y^j with i + j ≤ `order`.

    **Raises:** `InputError` for an order that is not a whole number from 0 to 20.

    >>> Polynomial(2).size
    6
    """

    order: int = 2

    def __post_init__(self) -> None:
        if self.order not in range(_HIGHEST_ORDER + 1):
            raise InputError(
                f"a polynomial's order is a whole number from 0 to {_HIGHEST_ORDER}; received {self.order!r}; for more "
                "freedom take a T-spline as the form"
            )

    @property
    def name(self) -> str:
        return f"poly{self.order}"

    @property
    def size(self) -> int:
        return (self.order + 1) * (self.order + 2) // 2

    def starts(self, points: Float[np.ndarray, "m 3"]) -> Iterator[AbstractShape]:
        exponents = tuple((i, j) for i in range(self.order + 1) for j in range(self.order + 1 - i))
        empty = PolynomialShape(np.zeros(len(exponents)), exponents)
        yield empty.moved(np.linalg.lstsq(empty.basis(points[:, 0], points[:, 1]), points[:, 2], rcond=None)[0])


@dataclass(frozen=True)
class Sphere(AbstractSimpleForm):
    """A sphere.

    >>> Sphere().size
    4
    """

    @property
    def name(self) -> str:
        return "sphere"

    @property
    def size(self) -> int:
        return 4

    def starts(self, points: Float[np.ndarray, "m 3"]) -> Iterator[AbstractShape]:
        frame = _principal_frame(points)
        yield Quadric(points.mean(axis=0), frame, float(-_bending(points, frame)[0].mean()))
        # |x|² = 2 c·x + (R² - |c|²) is linear in the unknowns: exact for points of a sphere, however much of it.
        columns = np.column_stack([2 * points, np.ones(len(points))])
        *centre, rest = np.linalg.lstsq(columns, (points**2).sum(axis=1), rcond=None)[0]
        radius = np.sqrt(max(rest + np.dot(centre, centre), 1e-300))
        outside = -np.asarray(centre)
        n = outside / np.linalg.norm(outside) if np.linalg.norm(outside) > 1e-9 * radius else np.array([0.0, 0.0, 1.0])
        yield Quadric(centre + radius * n, _frame(n), 1 / radius)


@dataclass(frozen=True)
class Cylinder(AbstractSimpleForm):
    """A circular cylinder without ends.

    >>> Cylinder().size
    5
    """

    @property
    def name(self) -> str:
        return "cylinder"

    @property
    def size(self) -> int:
        return 5

    def starts(self, points: Float[np.ndarray, "m 3"]) -> Iterator[AbstractShape]:
        frame = _principal_frame(points)
        bends, directions = _bending(points, frame)
        for axis in (0, 1):
            turned = _frame(frame[:, 0], frame[:, 1:] @ directions[:, axis])
            yield Quadric(points.mean(axis=0), turned, float(-bends[1 - axis]), axial=True)
        axes = np.vstack([np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2], _half_sphere()])
        for axis in axes:
            yield _cylinder_about(points, axis)


def simple_form(form: AbstractSimpleForm | str) -> AbstractSimpleForm:
    """A simple form, or the one that a name stands for.

    **Raises:** `InputError` for anything else.

    >>> simple_form("poly3")
    Polynomial(order=3)
    """
    if isinstance(form, AbstractSimpleForm):
        return form
    named = {"plane": Plane(), "sphere": Sphere(), "cylinder": Cylinder()}
    if isinstance(form, str) and form in named:
        return named[form]
    if isinstance(form, str) and form.startswith("poly") and form[4:].isdecimal():
        return Polynomial(int(form[4:]))
    raise InputError(f"a simple form is plane, polyN (poly2 for order 2), sphere or cylinder; received {form!r}")


def _principal_frame(points: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """n, t, b: the direction of least extent, of greatest, and the third."""
    directions = np.linalg.eigh(np.cov(points.T))[1]
    return _frame(directions[:, 0], directions[:, 2])


def _frame(n: np.ndarray, t: np.ndarray | None = None) -> Float[np.ndarray, "3 3"]:
    """n, t and b = t × n as columns; t is any direction across n where none is given."""
    if t is None:
        t = np.cross(n, np.eye(3)[np.argmin(np.abs(n))])
        t = t / np.linalg.norm(t)
    return np.column_stack([n, t, np.cross(t, n)])


def _bending(points: np.ndarray, frame: np.ndarray) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, "2 2"]]:
    """Principal curvatures of the quadratic surface over a frame's plane, towards n, and their directions in (t, b)."""
    w, u, v = ((points - points.mean(axis=0)) @ frame).T
    columns = np.column_stack([np.ones(len(u)), u, v, u * u / 2, u * v, v * v / 2])
    *_, uu, uv, vv = np.linalg.lstsq(columns, w, rcond=None)[0]
    return np.linalg.eigh(np.array([[uu, uv], [uv, vv]]))


def _cylinder_about(points: np.ndarray, axis: np.ndarray) -> Quadric:
    """The cylinder of a given direction: a circle through the points seen along it, by linear least squares."""
    across, along = np.split(np.linalg.svd(axis[None])[2], [1])
    flat = points @ along.T
    columns = np.column_stack([2 * flat, np.ones(len(flat))])
    *centre, rest = np.linalg.lstsq(columns, (flat**2).sum(axis=1), rcond=None)[0]
    radius = np.sqrt(max(rest + np.dot(centre, centre), 1e-300))
    outside = flat.mean(axis=0) - centre
    size = np.linalg.norm(outside)
    n = (outside / size if size > 1e-9 * radius else np.array([1.0, 0.0])) @ along
    return Quadric(centre @ along + radius * n, _frame(n, across[0]), 1 / radius, axial=True)


def _half_sphere() -> Float[np.ndarray, "k 3"]:
    """Directions spread evenly over the half sphere, by the golden angle."""
    z = (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS
    angle = np.pi * (3 - np.sqrt(5)) * np.arange(_DIRECTIONS)
    return np.column_stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z])
