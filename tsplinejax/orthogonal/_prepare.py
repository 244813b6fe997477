"""Making a fit ready: what a caller hands in, checked; the parametric start; directions of control points' moves."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..data import Frame, PointCloud, as_data
from ..fitting import blending, default_smoothing, lstsq
from ..space import SplineSpace, pad, resolve_dtype, to_device
from ..surface import TSpline, make_surface, normals
from ._methods import AbstractFreeMethod
from ._problem import FootProblem

LEAST_PADDED = 256
BAND = 1 << 15
REACH = 0.05  # of the parameters of surfaces that slide freely, beyond the square
LEAST_LENGTH = 1 << 12


@dataclass(frozen=True, eq=False)
class Request:
    """Points (m, 3) and parameters (m, 2) to fit, in the data's unit, and the rectangle the parameters stand for."""

    points: Float[np.ndarray, "m 3"]
    parameters: Float[np.ndarray, "m 2"]
    weights: Float[np.ndarray, " m"]
    frame: Frame
    unit: str | None
    dtype: np.dtype
    offset: Float[np.ndarray, " 3"]
    factor: float

    @property
    def scaled(self) -> Float[np.ndarray, "m 3"]:
        """Points about their middle, in units of their size."""
        return (self.points - self.offset) / self.factor


def read_request(
    data: Any,
    parameters: Any,
    *,
    weights: Any = None,
    sides: tuple[float, float] | None = None,
    unit: str | None = None,
    dtype: Any = None,
) -> Request:
    """Check what a caller hands in.

    **Raises:** `InputError`.
    """
    cloud = _cloud(data, unit)
    points = cloud.points.astype(np.float64)
    resolved = resolve_dtype(cloud.points.dtype if dtype is None else dtype)
    if parameters is None:
        samples = cloud.samples(as_surface=True)
        places, frame = samples.parameters.astype(np.float64), cloud.frame
    else:
        places = _places(getattr(parameters, "parameters", parameters), len(points))
        sides = sides if sides is not None else getattr(parameters, "sides", None)
        frame = Frame((0.0, 0.0), _checked_sides(points, sides), cloud.unit)
    offset = (points.min(axis=0) + points.max(axis=0)) / 2
    factor = float(np.linalg.norm(np.ptp(points, axis=0))) / 2
    _refuse_line(points - offset, factor)
    return Request(points, places, _weights(weights, len(points)), frame, cloud.unit, resolved, offset, factor)


def _cloud(data: Any, unit: str | None) -> PointCloud:
    """A point cloud of points or of a height map."""
    data = as_data(data)
    if not isinstance(data, PointCloud):
        if data.unit is None and unit is None and data.spacing == (1.0, 1.0):
            raise InputError(
                "orthogonal distances mix x, y and z, but this map states neither spacing nor unit; give "
                "HeightMap(heights, spacing, unit=), or unit="
            )
        samples = data.samples()
        places = samples.frame.xy_of(samples.parameters)
        points = np.concatenate([places, samples.values], axis=1)
        data = PointCloud(points.astype(samples.values.dtype), data.unit)
    if unit is not None and data.unit is not None and unit != data.unit:
        return data.to_unit(unit)
    return data if unit is None else PointCloud(data.points, unit)


def _places(parameters: Any, m: int) -> Float[np.ndarray, "m 2"]:
    """Parameters (m, 2) in [0, 1]²."""
    try:
        places = np.asarray(parameters, np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"parameters are an (m, 2) array; received {type(parameters).__name__}") from error
    if places.shape != (m, 2):
        raise InputError(f"parameters have one row (s, t) a point, shape ({m}, 2); received {places.shape}")
    if not np.isfinite(places).all() or places.min() < 0 or places.max() > 1:
        raise InputError(
            f"parameters lie in [0, 1]²; received values from {np.nanmin(places):g} to {np.nanmax(places):g}; "
            "normalise them"
        )
    return places


def _checked_sides(points: np.ndarray, sides: Any) -> tuple[float, float]:
    """Side lengths of the rectangle that the parameters stand for; unknown ones are equal."""
    if sides is None:
        return (1.0, 1.0)
    pair = np.asarray(sides, np.float64).ravel()
    if pair.shape != (2,) or not np.isfinite(pair).all() or (pair <= 0).any():
        raise InputError(f"sides are two lengths above zero; received {sides!r}")
    return float(pair[0]), float(pair[1])


def _weights(weights: Any, m: int) -> Float[np.ndarray, " m"]:
    """Weights (m,), not negative, of which some count."""
    if weights is None:
        return np.ones(m)
    array = np.asarray(weights, np.float64)
    if array.shape != (m,) or not np.isfinite(array).all() or (array < 0).any() or not array.any():
        raise InputError(f"weights have shape ({m},), are finite, not negative and not all zero")
    return array


def _refuse_line(centred: np.ndarray, factor: float) -> None:
    """Points of one line have no surface through them."""
    if factor > 0:
        spread = np.linalg.svd(centred / factor, compute_uv=False, full_matrices=False)
        if len(spread) > 1 and spread[1] > 1e-9 * spread[0]:
            return
    raise InputError(f"the {len(centred)} points lie on one line or in one place; a surface needs points around it")


def smoothing_weight(smoothing: float | str, m: int) -> float:
    """λ as a number; by default a trace that only fills gaps."""
    if isinstance(smoothing, str):
        if smoothing != "auto":
            raise InputError(f"smoothing is 'auto' or a number λ of at least zero; received {smoothing!r}")
        return default_smoothing(m)
    if not np.isfinite(smoothing) or smoothing < 0:
        raise InputError(f"smoothing λ is finite and at least zero; received {smoothing!r}; try 'auto'")
    return float(smoothing)


def parametric(
    space: SplineSpace, request: Request, parameters: np.ndarray, weights: np.ndarray, smoothing: float
) -> TSpline:
    """The linear fit over fixed parameters, in the fit's own scale."""
    length = padded_length(len(parameters))
    padded = (pad(part, length, 0) for part in (parameters, request.scaled, weights))
    points = lstsq(space, *padded, smoothing=smoothing, extent=request.frame.extent)
    return make_surface(space, points)


def greville(space: SplineSpace) -> Float[np.ndarray, "n 2"]:
    """Where each control point has its place: the mean of the three inner knots in each direction."""
    mesh = space.mesh
    columns = [mesh.parameters(axis, mesh.local_knots[:, axis, 1:4]).mean(axis=1) for axis in range(2)]
    return np.clip(np.stack(columns, axis=1), 0, 1)


def directions_of(surface: TSpline, components: int) -> Float[np.ndarray, "n 3 r"]:
    """Unit columns for each control point: the surface's normal at its place, then two along the surface."""
    normal = np.asarray(normals(surface, greville(surface.space)), np.float64)
    lost = ~np.isfinite(normal).all(axis=1)
    if lost.any():  # a degenerate corner takes the mean direction
        normal[lost] = normal[~lost].mean(axis=0) if not lost.all() else (0.0, 0.0, 1.0)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([normal, first, np.cross(normal, first)], axis=-1)[..., :components]


def padded_count(n: int, capacity: int) -> int:
    """Control points are padded to twice and twice again, up to the space's capacity."""
    count = LEAST_PADDED
    while count < n:
        count *= 2
    return min(count, max(capacity, n))


def pose(
    surface: TSpline,
    points: np.ndarray,
    weights: np.ndarray,
    parameters: np.ndarray,
    method: AbstractFreeMethod,
    smoothing: float,
    extent: tuple[float, float],
) -> FootProblem:
    """The problem of a fit that starts from a surface, all in the fit's own scale; points are padded without weight."""
    space, dtype = surface.space, surface.space.dtype
    n, r = int(space.n_functions), method.components
    count = padded_count(n, space.capacity)
    reference = np.zeros((count, 3))
    reference[:n] = np.asarray(surface.control_points)
    directions = np.zeros((count, 3, r))
    directions[:n] = directions_of(surface, r)
    mass = np.zeros(count)
    mass[:n] = masses(space, parameters, weights)
    hold = np.zeros((count, r))
    hold[:, 1:] = method.hold * np.maximum(mass, 1e-6 * mass.mean())[:, None]
    sides = np.asarray(extent) / np.sqrt(np.prod(extent))
    length = padded_length(len(points))
    rows = pad(points, length, points[0]), pad(weights, length, 0)
    reach = REACH if r > 1 and method.hold == 0 else 0.0
    arrays = (*rows, reference, directions, mass, hold, np.asarray(smoothing), sides, reach)
    return FootProblem(space, *(to_device(array, dtype) for array in arrays))


def padded_length(m: int) -> int:
    """Points are padded by a quarter at most, so that clouds of about one size share their kernels.

    >>> padded_length(100), padded_length(10_000)
    (4096, 12288)
    """
    step = max(LEAST_LENGTH, 1 << max(m.bit_length() - 3, 0))
    return -(-m // step) * step


def masses(space: SplineSpace, parameters: np.ndarray, weights: np.ndarray) -> Float[np.ndarray, " n"]:
    """Σ_j w_j b_i(u_j)."""
    totals = np.zeros(int(space.n_functions))
    length = min(BAND, 1 << (len(parameters) - 1).bit_length())
    for first in range(0, len(parameters), length):
        rows = slice(first, first + length)
        band, counted = pad(parameters[rows], length, 0), pad(weights[rows], length, 0)
        functions, values = (np.asarray(part) for part in blending(space, to_device(band, space.dtype)))
        totals += np.bincount(functions.ravel(), (values * counted[:, None]).ravel(), len(totals))
    return totals
