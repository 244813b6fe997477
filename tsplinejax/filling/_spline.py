"""Holes filled by bicubic splines on the pixel lattice: least squares at the known pixels, an energy in between.

min_f Σ_known (z - f)² + λ Σ_k C(m, k) ∫ (∂^k_x ∂^(m-k)_y f)² dx dy with one control point a pixel, m the order of the
energy: 1 a membrane, 2 a bent plate, 3 the plate whose curvature is smooth. With `creases` each element's energy e is
weighted by 1 / √(e + ε²), again and again, so that the sum of the roots is made small: curvature gathers in few
elements and edges go on through a hole (iteratively reweighted least squares, as for total variation).

The matrix of a window of h × w pixels couples a control point with those up to three rows and columns away. It is kept
as planes, one a pair of offsets, each of the size of the window: sums over pixels and elements are sums of shifted
arrays. In the order of the rows it has 3 (w + 2) + 3 diagonals, for LAPACK's banded Cholesky factorisation.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import comb

import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded

from ..space import gram
from ._filler import AbstractFiller, Field, Predict, Window

#: A uniform cubic B-spline at the pixels it covers.
_TAPS = np.array([1.0, 4.0, 1.0]) / 6
#: Bernstein coefficients, on one element, of the four uniform cubic B-splines that live there.
_PIECES = np.array([[1, 0, 0, 0], [4, 4, 2, 1], [1, 2, 4, 4], [0, 0, 0, 1]]) / 6
_ROUNDS, _SETTLED = 5, 3e-3
#: Roots of energies well below this share of the heights' scale are not worth a crease.
_CREASE = 0.02
#: Weight of the mean height at every pixel, where nothing else determines the spline.
_TRACE = 1e-12

Planes = dict[tuple[int, int], Float[np.ndarray, "height width"]]


@dataclass(frozen=True)
class SplineFiller(AbstractFiller):
    """A bicubic spline of least energy on the pixel lattice.

    **Arguments:**

    - `order`: of the derivatives in the energy: 1, 2 or 3.
    - `smoothing`: λ, in pixels to the power 2 · order - 2; far below one the known pixels are interpolated.
    - `creases`: whether curvature may gather in creases and edges.

    >>> SplineFiller(2, 1e-3).name
    'plate, λ = 0.001'
    """

    order: int = 2
    smoothing: float = 1e-3
    creases: bool = False

    @property
    def name(self) -> str:
        """Order and λ in words."""
        kind = ("membrane", "plate", "third order")[self.order - 1]
        return f"{kind}{' with creases' if self.creases else ''}, λ = {self.smoothing:g}"

    @property
    def margin(self) -> int:
        """A few pixels, and more the more the known ones are smoothed."""
        return max(6, int(np.ceil(4 + 4 * self.smoothing ** (0.5 / self.order))))

    def prepare(self, field: Field) -> Predict:
        """Nothing is learned from the whole field."""
        return lambda window: self._fill(field, window)

    def _fill(self, field: Field, window: Window) -> Float[np.ndarray, " wanted"]:
        heights = field.heights[window.rows, window.columns]
        known = np.isfinite(heights)
        mean = float(heights[known].mean()) if known.any() else 0.0
        values = np.where(known, (heights - mean) / field.scale, 0.0)
        energy = element_energy(self.order, field.sides) * self.smoothing
        data = _data_planes(known.astype(float) + _TRACE)
        load = _spread(values)
        points = _solved(_with_energy(data, energy, np.ones((len(heights) - 1, heights.shape[1] - 1))), load)
        for _ in range(_ROUNDS if self.creases else 0):
            densities = _element_energies(points, energy / self.smoothing)
            weights = _CREASE / np.sqrt(densities + _CREASE**2)
            before, points = points, _solved(_with_energy(data, energy, weights), load)
            if np.abs(points - before).max() < _SETTLED:
                break
        filled = _evaluate(points) * field.scale + mean
        return filled[window.wanted]


@lru_cache
def element_energy(order: int, sides: tuple[float, float]) -> Float[np.ndarray, "4 4 4 4"]:
    """The energy of one pixel's element as a form of its 4 × 4 control points: [row, column, row, column].

    >>> form = element_energy(2, (1.0, 1.0))
    >>> plane = np.add.outer(np.arange(4.0), 2 * np.arange(4.0))
    >>> round(float(np.einsum("ab,abcd,cd", plane, form, plane)), 12)
    0.0
    """
    width, height = sides
    total = np.zeros((4, 4, 4, 4))
    for k in range(order + 1):
        along, across = (_PIECES @ gram(power) @ _PIECES.T for power in (k, order - k))
        scale = comb(order, k) * width ** (1 - 2 * k) * height ** (1 - 2 * (order - k))
        total += scale * np.einsum("bd,ac->abcd", along, across)
    return total


def _data_planes(weights: Float[np.ndarray, "h w"]) -> Planes:
    """Σ over pixels of the products of the nine B-splines there."""
    h, w = weights.shape
    planes: Planes = {}
    for a, b, c, d in product(range(3), repeat=4):
        offset = (c - a, d - b)
        if offset >= (0, 0):
            plane = planes.setdefault(offset, np.zeros((h + 2, w + 2)))
            plane[a : a + h, b : b + w] += (_TAPS[a] * _TAPS[b] * _TAPS[c] * _TAPS[d]) * weights
    return planes


def _with_energy(data: Planes, energy: Float[np.ndarray, "4 4 4 4"], weights: Float[np.ndarray, "h w"]) -> Planes:
    """The data's planes plus the weighted energies of all elements."""
    h, w = weights.shape
    planes: Planes = {offset: plane.copy() for offset, plane in data.items()}
    for a, b, c, d in product(range(4), repeat=4):
        offset = (c - a, d - b)
        if offset >= (0, 0):
            plane = planes.setdefault(offset, np.zeros((h + 3, w + 3)))
            plane[a : a + h, b : b + w] += energy[c, d, a, b] * weights
    return planes


def _spread(values: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h+2 w+2"]:
    """Σ over pixels of their value times the nine B-splines there."""
    h, w = values.shape
    load = np.zeros((h + 2, w + 2))
    for a, b in product(range(3), repeat=2):
        load[a : a + h, b : b + w] += (_TAPS[a] * _TAPS[b]) * values
    return load


def _solved(planes: Planes, load: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h w"]:
    """Solve by banded Cholesky factorisation, along the shorter side first."""

    h, w = load.shape
    if h < w:
        turned = {}
        for (down, across), plane in planes.items():
            # The entry between (i, j) and (i + down, j + across) moves to the other end where its offset turns round.
            if (across, down) >= (0, 0):
                turned[across, down] = plane.T
            else:
                turned[-across, -down] = np.roll(plane, (down, across), (0, 1)).T
        return _solved(turned, load.T).T
    bands = np.zeros((3 * w + 4, h * w))
    for (down, across), plane in planes.items():
        bands[down * w + across] = plane.ravel()
    return solveh_banded(bands, load.ravel(), overwrite_ab=True, lower=True, check_finite=False).reshape(h, w)


def _element_energies(
    points: Float[np.ndarray, "h w"], energy: Float[np.ndarray, "4 4 4 4"]
) -> Float[np.ndarray, "h-3 w-3"]:
    """The energy of each element."""
    local = np.lib.stride_tricks.sliding_window_view(points, (4, 4)).reshape(-1, 16)
    energies = np.einsum("ei,ei->e", local @ energy.reshape(16, 16), local)
    return np.maximum(energies, 0).reshape(points.shape[0] - 3, points.shape[1] - 3)


def _evaluate(points: Float[np.ndarray, "h w"]) -> Float[np.ndarray, "h-2 w-2"]:
    """The spline at the pixels."""
    rows = _TAPS[0] * points[:-2] + _TAPS[1] * points[1:-1] + _TAPS[2] * points[2:]
    return _TAPS[0] * rows[:, :-2] + _TAPS[1] * rows[:, 1:-1] + _TAPS[2] * rows[:, 2:]
