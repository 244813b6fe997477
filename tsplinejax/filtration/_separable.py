"""Smoothing over a regular grid, where all matrices are products of one along y and one along x.

With control points P, rows along y, the surface at the pixels is B_y P B_xᵀ. A smooth one minimises

    Σ_valid (z - B_y P B_xᵀ)² + λ ∫ f_xx² + 2 f_xy² + f_yy² dx dy.

Its normal equations are solved by conjugate gradients. They are preconditioned in the basis in which B_yᵀ B_y and the
bending along y are diagonal, and likewise along x: there the system of a gapless grid is nearly diagonal, with
1 + λ (√μ_y + √μ_x)², so that a handful of iterations does, and without smoothing a single one.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_GAUSS = 4  # points an element: exact for the squares of cubics
_ACCURACY = 1e-11  # of the preconditioned residual
_MOST = 1000


@dataclass(frozen=True, eq=False)
class Axis:
    """The matrices along one direction; lengths are physical.

    **Attributes:**

    - `values`: basis functions at the samples, (samples, n).
    - `mass`, `slope`, `bending`: ∫ b_i b_j, ∫ b_i' b_j' and ∫ b_i'' b_j'', (n, n).
    - `step`: distance of the samples.
    """

    values: "csr_array"
    mass: "csr_array"
    slope: "csr_array"
    bending: "csr_array"
    step: float


@lru_cache(maxsize=16)
def spline_axis(count: int, step: float, elements: int, *, wide: bool = False) -> Axis:
    """Cubic B-splines on equal elements between the first and the last of `count` samples, clamped at both ends.

    With `wide` the two elements at either end are one of twice the size.
    """
    from scipy.interpolate import BSpline
    from scipy.sparse import csr_array, diags_array

    length = (count - 1) * step
    lines = np.linspace(0.0, length, elements + 1)
    if wide:
        lines = np.delete(lines, [1, -2])
    knots = np.concatenate([np.zeros(3), lines, np.full(3, length)])
    nodes, weights = np.polynomial.legendre.leggauss(_GAUSS)
    sizes = np.diff(lines)[:, None]
    places = (lines[:-1, None] + sizes * (nodes + 1) / 2).ravel()
    heavy = (weights * sizes / 2).ravel()
    grams = []
    for order in range(3):
        change = _differentiation(knots, order)
        basis = BSpline.design_matrix(places, knots[order : len(knots) - order], 3 - order) @ change
        grams.append(csr_array(basis.T @ diags_array(heavy) @ basis))
    samples = np.minimum(np.arange(count) * step, length)
    return Axis(csr_array(BSpline.design_matrix(samples, knots, 3)), grams[0], grams[1], grams[2], step)


def _differentiation(knots: np.ndarray, order: int) -> "csr_array":
    """From the coefficients of a cubic spline to those of its derivative, a spline of lower degree (de Boor)."""
    from scipy.sparse import csr_array, diags_array, eye_array

    n = len(knots) - 4
    change = eye_array(n, format="csr")
    for k in range(1, order + 1):
        degree, rows = 4 - k, n - k
        inner = knots[k : len(knots) - k]
        gaps = inner[degree : degree + rows] - inner[:rows]
        factors = degree / gaps
        change = diags_array([-factors, factors], offsets=[0, 1], shape=(rows, rows + 1)).tocsr() @ change  # type: ignore[call-overload]
    return csr_array(change)


def halved_ends(elements: int) -> "csr_array":
    """From control points on a `wide` axis to those on all of its equal elements (Boehm's knot insertion)."""
    from scipy.sparse import csr_array, diags_array, eye_array

    lines = np.delete(np.arange(elements + 1.0), [1, -2])
    change = eye_array(elements + 1, format="csr")
    for line in (1.0, elements - 1.0):
        knots = np.concatenate([np.zeros(3), lines, np.full(3, float(elements))])
        n = len(knots) - 4
        own = np.clip((line - knots[:n]) / np.maximum(knots[3 : n + 3] - knots[:n], 1e-9), 0.0, 1.0)
        change = diags_array([own, 1 - np.append(own[1:], 0.0)], offsets=[0, -1], shape=(n + 1, n)) @ change  # type: ignore[call-overload]
        lines = np.sort(np.append(lines, line))
    return csr_array(change)


def pixel_axis(count: int, step: float, cutoff: float) -> Axis:
    """One function a pixel, and differences for derivatives, in units of ISO 16610-22's α = 1 / 2 sin(πΔ/λc)."""
    from scipy.sparse import csr_array, diags_array, eye_array

    alpha = 1 / (2 * np.sin(np.pi * step / cutoff))
    one = csr_array(eye_array(count))
    first = diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 1, count)).tocsr()  # type: ignore[call-overload]
    second = diags_array([1.0, -2.0, 1.0], offsets=[0, 1, 2], shape=(count - 2, count)).tocsr()  # type: ignore[call-overload]
    return Axis(one, one, alpha**2 * (first.T @ first), alpha**4 * (second.T @ second), 1.0)


@dataclass(frozen=True, eq=False)
class Smoother:
    """The normal equations over a grid of which some pixels are missing."""

    y: Axis
    x: Axis
    valid: Bool[np.ndarray, "rows columns"]
    smoothing: float

    def values(self, points: Float[np.ndarray, "ny nx"]) -> Float[np.ndarray, "rows columns"]:
        """The surface at all pixels."""
        return _both(self.y.values, points, self.x.values)

    def load(self, heights: Float[np.ndarray, "rows columns"]) -> Float[np.ndarray, "ny nx"]:
        """The right-hand side of heights; those of missing pixels do not count."""
        known = np.where(self.valid, heights, 0.0)
        return _both(self.y.values.T, known, self.x.values.T)

    def solve(self, heights: Float[np.ndarray, "rows columns"]) -> tuple[Float[np.ndarray, "ny nx"], float]:
        """Control points, and the relative residual that is left."""
        share = float(self.valid.mean())
        basis_y, frequency_y = _diagonalised(self.y)
        basis_x, frequency_x = _diagonalised(self.x)
        frequencies = np.sqrt(self.x.step) * frequency_y[:, None] + np.sqrt(self.y.step) * frequency_x
        diagonal = share + self.smoothing * frequencies**2

        def precondition(residual: np.ndarray) -> np.ndarray:
            return basis_y @ ((basis_y.T @ residual @ basis_x) / diagonal) @ basis_x.T

        return conjugate_gradients(self._apply(), precondition, self.load(heights))

    def _apply(self) -> Callable[[np.ndarray], np.ndarray]:
        """The normal matrix as a function."""
        y, x, weight = self.y, self.x, self.smoothing
        gapless = bool(self.valid.all())
        gram_y, gram_x = y.values.T @ y.values, x.values.T @ x.values

        def apply(points: np.ndarray) -> np.ndarray:
            product = _both(gram_y, points, gram_x) if gapless else self.load(self.values(points))
            if weight > 0:
                bending = _both(y.bending, points, x.mass) + _both(y.mass, points, x.bending)
                product = product + weight * (bending + 2 * _both(y.slope, points, x.slope))
            return product

        return apply


def _both(left: "csr_array", points: np.ndarray, right: "csr_array") -> np.ndarray:
    """left · points · rightᵀ."""
    return (right @ (left @ points).T).T


@lru_cache(maxsize=16)
def _diagonalised(axis: Axis) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"]]:
    """A basis in which Bᵀ B is one and the bending diagonal, and the roots of that diagonal."""
    from scipy.linalg import eigh

    gram = (axis.values.T @ axis.values).toarray()
    squares, basis = eigh(axis.bending.toarray(), gram)
    return basis, np.sqrt(np.maximum(squares, 0.0))


def conjugate_gradients(
    apply: Callable[[np.ndarray], np.ndarray], precondition: Callable[[np.ndarray], np.ndarray], load: np.ndarray
) -> tuple[np.ndarray, float]:
    """The solution of a positive system, and the relative residual that is left, in the preconditioner's norm."""
    solution, residual = np.zeros_like(load), load.copy()
    direction = precondition(residual)
    energy = first = float(np.vdot(residual, direction))
    for _ in range(_MOST):
        if energy <= _ACCURACY**2 * first:
            break
        image = apply(direction)
        step = energy / float(np.vdot(direction, image))
        solution += step * direction
        residual -= step * image
        moved = precondition(residual)
        after = float(np.vdot(residual, moved))
        direction = moved + after / energy * direction
        energy = after
    return solution, float(np.sqrt(max(energy, 0.0) / first)) if first > 0 else 0.0
