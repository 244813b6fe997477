"""Simple forms fitted to data: vertical or orthogonal, by least squares, robustly, or to the minimum zone.

Gauss-Newton with step halving on the signed distances d_j and their exact derivatives. Vertical residuals are
r = z - h(x, y); where the form has the unit normal n, ∂r/∂p = (∂d/∂p) / n_z.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import ArrayLike, Float

from .._errors import InputError
from ..data import HeightMap, PointCloud, as_data
from ._minimum_zone import minimum_zone
from ._outward import checked_outward, outward_side
from ._shapes import AbstractShape, PolynomialShape, Quadric
from ._simple_forms import AbstractSimpleForm, simple_form

Distance = Literal["orthogonal", "vertical"]
Criterion = Literal["least squares", "minimum zone"]

_STEPS, _ROBUST_STEPS = 100, 20
_FEW, _STARTS = 4000, 4  # points on which starts are compared, and how many of them are fitted
_HUBER, _TUKEY = 2.0, 6.0  # in units of the residuals' robust scale
_RESTING = 1e-6
_ON_A_LINE = 1e-9
_AT_REST, _NO_GAIN = 1e-13, 1e-13  # a last step, in units of the data's size; a last gain, relative


class Foot(NamedTuple):
    """Where points stand on a form: feet (m, 3), unit normals there (m, 3), signed distances along them (m,)."""

    points: Float[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]
    distances: Float[np.ndarray, " m"]


@dataclass(frozen=True, eq=False, repr=False)
class FittedForm:
    """A simple form with its numbers.

    **Attributes:**

    - `form`: what it is: `Plane()`, `Polynomial(2)`, `Sphere()`, `Cylinder()`.
    - `values`: its numbers by name, in the data's unit: `normal` and `point` of a plane; `centre` and `radius` of a
      sphere; `axis`, `point` on it and `radius` of a cylinder; `coefficients` (k,) of a polynomial, with the
      `exponents` (i, j) of x^i y^j about the `point` (x₀, y₀).
    - `residuals`: (m,), what is left at each valid sample, along the normal or along z; positive outside.
    - `distance`, `criterion`: how it was fitted.
    - `zone`: largest minus smallest residual; `lower_bound`: no such form has a smaller zone (minimum zone only).
    - `converged`: whether the steps came to rest.
    - `unit`: of all lengths, or `None`.
    """

    form: AbstractSimpleForm
    values: Mapping[str, Any]
    residuals: Float[np.ndarray, " m"]
    distance: Distance
    criterion: Criterion
    zone: float
    lower_bound: float | None
    converged: bool
    unit: str | None
    _shape: AbstractShape
    _centre: Float[np.ndarray, " 3"]
    _scale: float

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        radius = f"radius {self.values['radius']:.6g}{unit}, " if "radius" in self.values else ""
        rms = float(np.sqrt(np.mean(self.residuals**2)))
        return (
            f"FittedForm({self.form.name}, {radius}{self.distance}, {self.criterion}, "
            f"rms {rms:.4g}{unit}, zone {self.zone:.4g}{unit})"
        )

    def project(self, points: Float[ArrayLike, "m 3"]) -> Foot:
        """Feet, normals and signed distances of any points.

        >>> x, y = np.meshgrid(np.arange(4.0), np.arange(3.0))
        >>> fitted = fit_form(np.column_stack([x.ravel(), y.ravel(), np.ones(12)]), "plane")
        >>> fitted.project(np.array([[1.0, 1.0, 3.0]])).distances.round(12)
        array([2.])
        """
        scaled = (np.asarray(points, np.float64) - self._centre) / self._scale
        distances, normals, _ = self._shape.contact(scaled)
        feet = scaled - distances[:, None] * normals
        return Foot(feet * self._scale + self._centre, normals, distances * self._scale)


def fit_form(
    data: Any,
    form: AbstractSimpleForm | str,
    *,
    distance: Distance = "orthogonal",
    criterion: Criterion = "least squares",
    robust: bool = False,
    weights: Float[ArrayLike, " m"] | None = None,
    outward: ArrayLike | None = None,
) -> FittedForm:
    """Fit a plane, a polynomial, a sphere or a cylinder.

    **Arguments:**

    - `data`: a `HeightMap`, a `PointCloud`, or plain arrays (see `as_data`); missing pixels are left out.
    - `form`: `Plane()`, `Polynomial(order)`, `Sphere()`, `Cylinder()`, or their names `"plane"`, `"poly2"`, ...
    - `distance`: `"orthogonal"`, along the form's normal, or `"vertical"`, along z.
    - `criterion`: `"least squares"`, or `"minimum zone"`, the form with the smallest largest residual (Chebyshev).
    - `robust`: weigh samples down that stand off (Huber, then Tukey: what is beyond six robust standard
      deviations does not pull).
    - `weights`: (m,), one a valid sample, not negative.
    - `outward`: direction out of the material; by default the side of a mesh's winding, else +z. State it for a mesh
      whose triangles are wound inwards.

    **Returns:** a [`FittedForm`][tsplinejax.FittedForm].

    **Raises:** `InputError` for too few points, points on one line, and options that exclude each other.

    >>> x, y = np.meshgrid(np.linspace(-1, 1, 20), np.linspace(-1, 1, 20))
    >>> fitted = fit_form(np.column_stack([x.ravel(), y.ravel(), np.sqrt(25 - x**2 - y**2).ravel()]), "sphere")
    >>> round(fitted.values["radius"], 9)
    5.0
    """
    data, form = as_data(data), simple_form(form)
    points, scale, centre = _scaled(data, form)
    counts = _checked(distance, criterion, robust, weights, len(points))
    residuals = _vertical if distance == "vertical" else _orthogonal
    shape, converged = _least_squares(_best_start(form, points, residuals), points, counts, residuals)
    if robust:
        shape, converged = _robust(shape, points, counts, residuals)
    lower_bound = None
    if criterion == "minimum zone":
        shape, lower_bound, converged = minimum_zone(shape, lambda shape: residuals(shape, points))
    normals = shape.contact(points).normals
    if outward_side(normals, data, checked_outward(outward)) < 0:
        shape, normals = shape.reversed(), -normals
    left = residuals(shape, points)[0]
    if distance == "vertical":
        left = left * np.where(normals[:, 2] < 0, -1.0, 1.0)
    if not np.isfinite(left).all():
        missed = int((~np.isfinite(left)).sum())
        raise InputError(
            f"a vertical {form.name} must reach above every sample, but misses {missed} of {len(left)}; "
            "use distance='orthogonal'"
        )
    return FittedForm(
        form=form,
        values=_values(shape, centre, scale),
        residuals=left * scale,
        distance=distance,
        criterion=criterion,
        zone=float(np.ptp(left) * scale),
        lower_bound=None if lower_bound is None else 2 * lower_bound * scale,
        converged=converged,
        unit=data.unit,
        _shape=shape,
        _centre=centre,
        _scale=scale,
    )


def _scaled(data: HeightMap | PointCloud, form: AbstractSimpleForm) -> tuple[np.ndarray, float, np.ndarray]:
    """Points centred and of size one, the scale, and the centre.

    **Raises:** `InputError` where there are too few of them, or all lie on one line.
    """
    points = data_points(data)
    if len(points) < form.size:
        raise InputError(f"a {form.name} needs at least {form.size} points; received {len(points)}")
    centre = points.mean(axis=0)
    offsets = points - centre
    scale = float(np.abs(offsets).max())
    lengths = np.linalg.svd(offsets / (scale or 1.0), compute_uv=False)
    if not lengths[1] > _ON_A_LINE * lengths[0]:
        raise InputError(
            f"a {form.name} needs points that are not all on one line or in one place; received {len(points)} that are"
        )
    return offsets / scale, scale, centre


def data_points(data: HeightMap | PointCloud) -> Float[np.ndarray, "m 3"]:
    """The valid samples as points in space, in float64.

    >>> data_points(HeightMap([[5.0, 6.0]], (2.0, 1.0)))
    array([[0., 0., 5.],
           [2., 0., 6.]])
    """
    if isinstance(data, PointCloud):
        return data.points.astype(np.float64)
    rows, columns = np.nonzero(data.valid)
    (x, y), (dx, dy) = data.origin, data.spacing
    return np.column_stack([x + columns * dx, y + rows * dy, data.heights[rows, columns].astype(np.float64)])


def _checked(distance: str, criterion: str, robust: bool, weights: Any, m: int) -> Float[np.ndarray, " m"]:
    """Weights, once the options are known to be sound."""
    if distance not in ("orthogonal", "vertical"):
        raise InputError(f"a distance is 'orthogonal' or 'vertical'; received {distance!r}")
    if criterion not in ("least squares", "minimum zone"):
        raise InputError(f"a criterion is 'least squares' or 'minimum zone'; received {criterion!r}")
    if criterion == "minimum zone" and (robust or weights is not None):
        raise InputError(
            "a minimum zone holds every sample alike, so it takes neither weights nor robust=True; set outliers aside "
            "first (find_outliers), or use criterion='least squares'"
        )
    counts = np.ones(m) if weights is None else np.asarray(weights, np.float64)
    if counts.shape != (m,) or not np.isfinite(counts).all() or (counts < 0).any() or not counts.any():
        raise InputError(f"weights are {m} numbers, finite, not negative, not all 0; received shape {counts.shape}")
    return counts


def _orthogonal(shape: AbstractShape, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distances and their derivatives."""
    contact = shape.contact(points)
    return contact.distances, contact.derivatives


def _vertical(shape: AbstractShape, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights above the shape and their derivatives."""
    above = shape.above(points)
    reached = np.isfinite(above[:, 2])
    known = np.where(reached[:, None], above, points)
    _, normals, derivatives = shape.contact(known)
    steepness = normals[:, 2:]
    derivatives = derivatives / np.where(steepness == 0, 1.0, steepness)
    return points[:, 2] - above[:, 2], np.where(reached[:, None], derivatives, 0.0)


def _best_start(form: AbstractSimpleForm, points: np.ndarray, residuals: Any) -> AbstractShape:
    """The start that leads to the smallest sum of squares on a few of the points."""
    few = points[:: max(1, len(points) // _FEW)]
    starts = list(form.starts(few))
    starts.sort(key=lambda shape: _cost(residuals(shape, few)[0], np.ones(len(few))))
    fitted = [_least_squares(shape, few, np.ones(len(few)), residuals)[0] for shape in starts[:_STARTS]]
    return min(fitted, key=lambda shape: _cost(residuals(shape, few)[0], np.ones(len(few))))


def _cost(residuals: np.ndarray, weights: np.ndarray) -> float:
    """The weighted sum of squares; infinite where the shape does not reach a point that counts."""
    cost = float(np.sum(weights * residuals**2, where=weights > 0))
    return cost if np.isfinite(cost) else np.inf


def _least_squares(
    shape: AbstractShape, points: np.ndarray, weights: np.ndarray, residuals: Any
) -> tuple[AbstractShape, bool]:
    """Gauss-Newton with step halving, until steps are rounding."""
    left, derivatives = residuals(shape, points)
    cost = _cost(left, weights)
    for _ in range(_STEPS):
        weighted = derivatives * weights[:, None]
        known = np.where(np.isfinite(left), left, 0.0)
        normal = weighted.T @ derivatives
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        step = -np.linalg.lstsq(normal / np.outer(size, size), weighted.T @ known / size, rcond=1e-13)[0] / size
        for halvings in range(30):
            trial = shape.moved(step * 0.5**halvings)
            left_then, derivatives_then = residuals(trial, points)
            cost_then = _cost(left_then, weights)
            if cost_then <= cost * (1 + _NO_GAIN):
                break
        else:
            return shape, True
        small = np.abs(step).max() <= _AT_REST or cost - cost_then <= _NO_GAIN * cost_then
        shape, left, derivatives, cost = trial, left_then, derivatives_then, cost_then
        if small:
            return shape, True
    return shape, False


def _robust(
    shape: AbstractShape, points: np.ndarray, weights: np.ndarray, residuals: Any
) -> tuple[AbstractShape, bool]:
    """Huber's weights, then Tukey's, each renewed until the residuals' scale (1.4826 × median magnitude) rests."""
    converged = False
    for weigh in (_huber, _tukey):
        scale = np.inf
        for _ in range(_ROBUST_STEPS):
            left = np.abs(residuals(shape, points)[0])
            left = np.where(np.isfinite(left), left, np.nanmax(left, initial=0.0))
            before, scale = scale, max(1.4826 * float(np.median(left)), 1e-15)
            if abs(before - scale) <= _RESTING * scale:
                break
            shape, converged = _least_squares(shape, points, weights * weigh(left / scale), residuals)
    return shape, converged


def _huber(ratio: np.ndarray) -> np.ndarray:
    return np.minimum(1, _HUBER / np.maximum(ratio, _HUBER))


def _tukey(ratio: np.ndarray) -> np.ndarray:
    return np.maximum(1 - (ratio / _TUKEY) ** 2, 0) ** 2


def _values(shape: AbstractShape, centre: np.ndarray, scale: float) -> dict[str, Any]:
    """The numbers of a shape in the data's unit."""
    if isinstance(shape, PolynomialShape):
        return _monomials(shape, centre, scale)
    assert isinstance(shape, Quadric)
    place, (n, t, _) = shape.place * scale + centre, shape.frame.T
    if shape.flat:
        return {"normal": n, "point": place}
    bend = shape.curvature / scale
    inner = place - n / bend if bend else np.full(3, np.inf)
    radius = abs(1 / bend) if bend else np.inf
    return (
        {"axis": t, "point": inner, "radius": float(radius)}
        if shape.axial
        else {"centre": inner, "radius": float(radius)}
    )


def _monomials(shape: PolynomialShape, centre: np.ndarray, scale: float) -> dict[str, Any]:
    """Coefficients of x^i y^j about the centre's (x, y)."""
    order = max(i + j for i, j in shape.exponents)
    table = np.zeros((order + 1, order + 1))
    for (i, j), coefficient in zip(shape.exponents, shape.coefficients, strict=True):
        powers = (np.polynomial.legendre.leg2poly(np.eye(order + 1)[degree, : degree + 1]) for degree in (i, j))
        product = coefficient * np.outer(*powers)
        table[: product.shape[0], : product.shape[1]] += product
    coefficients = np.array([table[i, j] * scale ** (1 - i - j) for i, j in shape.exponents])
    coefficients[shape.exponents.index((0, 0))] += centre[2]
    return {"coefficients": coefficients, "exponents": shape.exponents, "point": centre[:2]}
