"""Foot points: for every point in space the nearest place of a surface, and the signed distance along its normal.

A foot point minimises |x - S(s, t)|² over the parameter square. It is searched from the nearest of a grid of samples of
the surface by Newton's method with the full second derivatives, damped point by point (Levenberg-Marquardt) so that the
distance never grows; where a minimiser lies outside the square, the foot is on the border. All points of a chunk move
together on the device; those that have not settled after a few steps go on by themselves.

Derivatives come from the implicit function theorem: at a foot point g = S_uᵀ (S - x) = 0, so du = -(∂g/∂u)⁻¹ dg.
"""

from collections.abc import Callable
from functools import partial
from math import ceil, sqrt
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Bool, Float

from .._errors import InputError
from ..data import PointCloud
from ..space import SplineSpace, capacity_for, pad, to_device
from ._evaluate import bezier_points, jet
from ._parameters import check_parameters, real_array
from ._tspline import TSpline
from ._two import held, invert_two, multiply_two

CHUNK = 1 << 15
LEAST = 1 << 12  # rows of a padded chunk: few lengths, few compilations
FIRST_STEPS = 6  # enough for nearly all points of a chunk
SAMPLES, LEAST_A_SIDE = 4000, 3  # of the surface, where the search begins: in all at least, and along an element's side
TRACED_SIDE = 64
ORDERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


class Projection(eqx.Module):
    """Foot points of m points on a surface.

    **Attributes:**

    - `parameters`: of the feet, (m, 2).
    - `points`: the feet themselves, (m, 3).
    - `normals`: unit normals q_s × q_t there, (m, 3).
    - `distances`: (point - foot) · normal, (m,): positive on the side that the normal points to.
    - `beyond`: feet on the border of points that lie past it, (m,): their connecting line is not normal.
    - `converged`: whether the search settled, (m,).
    """

    parameters: Float[Array, "m 2"]
    points: Float[Array, "m 3"]
    normals: Float[Array, "m 3"]
    distances: Float[Array, " m"]
    beyond: Bool[Array, " m"]
    converged: Bool[Array, " m"]

    @property
    def converged_fraction(self) -> float:
        """Share of the points whose search settled."""
        return float(jnp.mean(self.converged)) if self.converged.size else 1.0

    def __repr__(self) -> str:
        return f"Projection({self.converged.shape[0]} points)"


class Placed(eqx.Module):
    """A surface as kernels take it: Bézier points about an offset, and for heights the plane they stand on."""

    space: SplineSpace
    points: Float[Array, "elements 4 4 d"]
    plane: tuple[Float[Array, " 2"], Float[Array, " 2"]] | None

    def jet(self, parameters: Float[Array, "m 2"]) -> list[Float[Array, "m 3"]]:
        """S, S_s, S_t, S_ss, S_st and S_tt."""
        values = jet(self.space, self.points, parameters, ORDERS)
        if self.plane is None:
            return values
        origin, extent = self.plane
        flat = [jnp.zeros((len(parameters), 2), parameters.dtype)] * 6
        flat[0] = origin + parameters * extent
        flat[1], flat[2] = (flat[0] * 0 + extent * unit for unit in (np.array([1.0, 0.0]), np.array([0.0, 1.0])))
        return [
            jnp.concatenate([a, b.reshape(-1, 1)], axis=1).astype(parameters.dtype)
            for a, b in zip(flat, values, strict=True)
        ]


def project(
    surface: TSpline,
    points: PointCloud | Float[ArrayLike, "m 3"],
    *,
    initial: Float[ArrayLike, "m 2"] | None = None,
    tolerance: float = 1e-10,
    max_iterations: int = 50,
) -> Projection:
    """Foot points and signed normal distances of points to a surface.

    **Arguments:**

    - `surface`: any T-spline; one of heights is the surface (x, y, f) over its frame.
    - `points`: a `PointCloud` or (m, 3), in the surface's unit.
    - `initial`: parameters (m, 2) to start from; by default those of the nearest of a grid of samples of the surface.
    - `tolerance`: length of the last step, relative to the points' and the surface's size; in float32 at least 1e-6.
    - `max_iterations`: steps of a point at most.

    **Returns:** a [`Projection`][tsplinejax.surface.Projection]. Its arrays are differentiable with respect to points
    and control points. Under `jit` the whole set is one expression, best with `initial`.

    **Raises:** `InputError` for points that are not (m, 3) finite numbers, and for wrong options.

    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> from tsplinejax.surface import make_surface
    >>> flat = make_surface(spline_space(b_lattice(2, 2)), np.ones(25))
    >>> project(flat, [[0.3, 0.4, 3.0]]).distances.tolist()
    [2.0]
    """
    array = _checked_points(points)
    if not tolerance > 0 or max_iterations < 1:
        raise InputError(
            f"a projection's tolerance is above zero and its max_iterations at least 1; received {tolerance!r} and "
            f"{max_iterations!r}"
        )
    dtype = surface.space.dtype
    tolerance = max(float(tolerance), 8 * float(np.finfo(dtype).eps))
    start = None if initial is None else _checked_start(initial, len(array), dtype)
    fixed = (_without_gradient(surface), *jax.lax.stop_gradient((array, start)))
    # Only what is being transformed is traced now: under `grad` alone the search still runs on the host.
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(fixed)):
        parameters, converged = _search_traced(*fixed, tolerance, max_iterations)
    else:
        with jax.ensure_compile_time_eval():
            parameters, converged = _search(*fixed, tolerance, max_iterations)
    return _at_feet(surface, array, parameters, converged)


def _without_gradient(surface: TSpline) -> TSpline:
    """The surface as a constant."""
    parts = jax.lax.stop_gradient((surface.control_points, surface.origin, surface.extent))
    return TSpline(surface.space, *parts, surface.unit)


def _checked_points(points: Any) -> Any:
    """Points (m, 3), finite where they are known."""
    array = real_array(points.points if isinstance(points, PointCloud) else points, "points")
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"points have shape (m, 3); received {array.shape}; give one row x, y, z a point")
    if not isinstance(array, Tracer) and not np.isfinite(np.asarray(array)).all():
        bad = int((~np.isfinite(np.asarray(array)).all(axis=1)).sum())
        raise InputError(f"points must be finite; received {bad} of {len(array)} with NaN or infinity; leave them out")
    return array


def _checked_start(initial: Any, m: int, dtype: np.dtype) -> Array:
    start = check_parameters(initial, dtype)
    if start.shape != (m, 2):
        raise InputError(f"initial parameters have shape ({m}, 2), one row a point; received {start.shape}")
    return start


def _placed(surface: TSpline, offset: Any) -> Placed:
    """The surface about an offset (3,), which keeps digits in single precision."""
    space = surface.space
    if surface.is_height_map:
        coefficients = (surface.control_points - offset[2])[:, None]
        plane = ((surface.origin - offset[:2]).astype(space.dtype), surface.extent)
    else:
        coefficients, plane = surface.control_points - offset, None
    coefficients = coefficients.astype(space.dtype)
    if space.rational:
        coefficients = jnp.concatenate([coefficients, jnp.ones_like(coefficients[:, :1])], axis=1)
    padded = jnp.zeros((space.capacity, coefficients.shape[1]), space.dtype).at[: len(coefficients)].set(coefficients)
    return Placed(space, bezier_points(space.tables, padded), plane)


def _search(
    surface: TSpline, points: Any, start: Array | None, tolerance: float, max_iterations: int
) -> tuple[Array, Array]:
    """Parameters of the feet of concrete points, chunk by chunk."""
    dtype, host = surface.space.dtype, np.asarray(points, np.float64)
    if not len(host):
        return jnp.zeros((0, 2), dtype), jnp.zeros(0, bool)
    offset = host.mean(axis=0)
    places, known = sample_places(surface.space), None
    if start is None or surface.is_height_map:
        known = np.asarray(points_of(surface, places), np.float64)
    size = _size(host, surface, known)
    parameters = places[_nearest(known, host)].astype(dtype) if start is None else np.array(start)
    placed = _placed(surface, offset)
    local = (host - offset).astype(dtype)
    converged = np.zeros(len(host), bool)
    rest = np.arange(len(host))
    for steps in (min(FIRST_STEPS, max_iterations), max_iterations - FIRST_STEPS):
        if steps > 0 and len(rest):
            limits = np.asarray(tolerance * size, dtype), np.int32(steps)
            kernel = partial(_settle, placed, limits)
            parameters[rest], converged[rest] = _of_chunks(kernel, local[rest], parameters[rest])
            rest = np.flatnonzero(~converged)
    return to_device(parameters), to_device(converged)


def _of_chunks(
    kernel: Callable[[np.ndarray, np.ndarray], tuple[Array, ...]], points: np.ndarray, parameters: np.ndarray
) -> list[np.ndarray]:
    """The same kernel for every chunk of rows; a short one is padded to a capacity."""
    parts = []
    for first in range(0, max(len(points), 1), CHUNK):
        rows = slice(first, first + CHUNK)
        m = len(points[rows])
        length = min(CHUNK, capacity_for(m, LEAST))
        # Padding repeats the first row, which settles with the others.
        chunk, begin = (pad(array[rows], length, array[first] if m else 0) for array in (points, parameters))
        parts.append([np.asarray(part)[:m] for part in kernel(chunk, begin)])
    return [np.concatenate(columns) for columns in zip(*parts, strict=True)]


def _search_traced(
    surface: TSpline, points: Array, start: Array | None, tolerance: float, max_iterations: int
) -> tuple[Array, Array]:
    """The same as one expression; without a start every point is compared with every sample."""
    dtype = surface.space.dtype
    points = jnp.asarray(points, dtype)
    offset = points.mean(axis=0)
    placed = _placed(surface, offset)
    local = points - offset
    size = jnp.max(jnp.ptp(points, axis=0)) + jnp.max(jnp.abs(placed.points))
    if start is None:
        # The mesh may be traced, too: its elements are not known, and the samples are a plain grid.
        middle = (np.arange(TRACED_SIDE) + 0.5) / TRACED_SIDE
        places = jnp.asarray(np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2), dtype)
        known = placed.jet(places)[0]
        nearest = jax.lax.map(lambda x: jnp.argmin(jnp.sum((known - x) ** 2, axis=1)), local, batch_size=256)
        start = places[nearest]
    return _settle(placed, (tolerance * size, jnp.int32(max_iterations)), local, start)


def sample_places(space: SplineSpace) -> Float[np.ndarray, "k 2"]:
    """Parameters spread over all Bézier elements of a space, at the middles of cells."""
    count = int(space.n_elements)
    side = max(LEAST_A_SIDE, ceil(sqrt(SAMPLES / count)))
    middle = (np.arange(side) + 0.5) / side
    inside = np.stack(np.meshgrid(middle, middle, indexing="ij"), axis=-1).reshape(1, -1, 2)
    corner, size = (np.asarray(part, np.float64)[:count, None] for part in (space.tables.corner, space.tables.size))
    return np.clip(corner + inside * size, 0, 1).reshape(-1, 2)


def points_of(surface: TSpline, parameters: Float[ArrayLike, "m 2"]) -> Float[Array, "m 3"]:
    """Points in space at parameters, also of a surface of heights."""
    values = surface(parameters)
    if not surface.is_height_map:
        return values
    return jnp.concatenate([surface.origin + jnp.asarray(parameters) * surface.extent, values[:, None]], axis=1)


def _size(points: np.ndarray, surface: TSpline, known: np.ndarray | None) -> float:
    """A length that steps are measured against."""
    samples = np.asarray(surface.control_points, np.float64) if known is None else known
    return float(np.linalg.norm(np.ptp(points, axis=0)) + np.linalg.norm(np.ptp(samples, axis=0)))


def _nearest(known: Any, points: np.ndarray) -> np.ndarray:
    """Index of the nearest known point of each point."""
    from scipy.spatial import KDTree

    return np.asarray(KDTree(known, balanced_tree=False, compact_nodes=False).query(points, workers=-1)[1])


class Search(eqx.Module):
    """Where a damped Newton search stands: feet, squared distances, gradients, Hessians and damping of every point."""

    parameters: Float[Array, "m 2"]
    square: Float[Array, " m"]
    gradient: Float[Array, "m 2"]
    metric: Float[Array, "m 3"]
    hessian: Float[Array, "m 3"]
    damping: Float[Array, " m"]
    settled: Bool[Array, " m"]


@jax.jit
def _settle(
    placed: Placed, limits: tuple[Any, Any], points: Float[Array, "m 3"], start: Float[Array, "m 2"]
) -> tuple[Float[Array, "m 2"], Bool[Array, " m"]]:
    """Move all points' parameters until every step is shorter than a length, or for so many steps (the limits)."""
    tolerance, steps = limits
    square, gradient, metric, hessian = _measured(placed, points, start)
    blank = jnp.zeros(len(start), bool)
    search = Search(start, square, gradient, metric, hessian, jnp.zeros_like(square), blank)

    def iterate(state: tuple[Search, Array]) -> tuple[Search, Array]:
        search, k = state
        step, length = _step(search)
        settled = search.settled | (length <= tolerance)
        tried = jnp.clip(search.parameters + step, 0, 1)
        square, *rest = _measured(placed, points, tried)
        # The last step of a settled point is still taken: it squares the error. Rounding does not count as a rise.
        better = (square <= (1 + 64 * jnp.finfo(square.dtype).eps) * search.square) & ~search.settled
        old = (search.gradient, search.metric, search.hessian)
        gradient, metric, hessian = (jnp.where(better[:, None], a, b) for a, b in zip(rest, old, strict=True))
        square = jnp.where(better, square, search.square)
        damping = jnp.where(better, search.damping / 8, jnp.maximum(8 * search.damping, 0.5))
        damping = jnp.where(damping < 1e-3, 0, damping)
        parameters = jnp.where(better[:, None], tried, search.parameters)
        return Search(parameters, square, gradient, metric, hessian, damping, settled), k + 1

    def unfinished(state: tuple[Search, Array]) -> Array:
        return (state[1] < steps) & ~jnp.all(state[0].settled)

    search, _ = jax.lax.while_loop(unfinished, iterate, (search, jnp.int32(0)))
    # The step that was due when the count ran out may have been a short one.
    return search.parameters, search.settled | (_step(search)[1] <= tolerance)


def _measured(placed: Placed, points: Array, parameters: Array) -> tuple[Array, Array, Array, Array]:
    """|r|², its half gradient, the metric (E, F, G) and the second derivatives' part, for r = S - x."""
    S, S_s, S_t, S_ss, S_st, S_tt = placed.jet(parameters)
    r = S - points

    def dot(a: Array, b: Array) -> Array:
        return jnp.sum(a * b, axis=-1)

    metric = jnp.stack([dot(S_s, S_s), dot(S_s, S_t), dot(S_t, S_t)], axis=-1)
    second = jnp.stack([dot(r, S_ss), dot(r, S_st), dot(r, S_tt)], axis=-1)
    return dot(r, r), jnp.stack([dot(r, S_s), dot(r, S_t)], axis=-1), metric, metric + second


def _step(search: Search) -> tuple[Float[Array, "m 2"], Float[Array, " m"]]:
    """Newton's step, Gauss-Newton's where the Hessian is not positive; and its length in space."""
    u, g, metric, hessian = search.parameters, search.gradient, search.metric, search.hessian
    least = 0.05
    convex = (
        (hessian[:, 0] > least * metric[:, 0])
        & (hessian[:, 2] > least * metric[:, 2])
        & (_determinant(hessian) > least * _determinant(metric))
    )
    form = jnp.where(convex[:, None], hessian, metric) + search.damping[:, None] * metric
    step = -multiply_two(invert_two(form, held(u, g)), g)
    step = jnp.clip(u + step, 0, 1) - u
    a, b = step[:, 0], step[:, 1]
    square = metric[:, 0] * a * a + 2 * metric[:, 1] * a * b + metric[:, 2] * b * b
    return step, jnp.sqrt(jnp.maximum(square, 0))


def _determinant(form: Float[Array, "m 3"]) -> Float[Array, " m"]:
    return form[:, 0] * form[:, 2] - form[:, 1] ** 2


def _at_feet(surface: TSpline, points: Any, parameters: Array, converged: Array) -> Projection:
    """Feet, normals and distances, differentiable by one more Newton step whose matrix is held fixed."""
    traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((surface, points)))
    if not traced:
        host = np.asarray(points, np.float64)
        offset = host.mean(axis=0) if len(host) else np.zeros(3)
        placed, local = _placed(surface, offset), (host - offset).astype(surface.space.dtype)
        found = _of_chunks(partial(_details, placed), local, np.asarray(parameters))
        feet, normals, distances, beyond = (to_device(part) for part in found)
        return Projection(parameters, feet + jnp.asarray(offset, feet.dtype), normals, distances, beyond, converged)
    points = jnp.asarray(points, surface.space.dtype)
    offset = jax.lax.stop_gradient(points.mean(axis=0))
    placed, local = _placed(surface, offset), points - offset
    _, gradient, _, hessian = _measured(placed, local, parameters)
    inverse = invert_two(hessian, held(parameters, gradient))
    step = multiply_two(jax.lax.stop_gradient(inverse), gradient)
    # The value stays: only the derivative of the step counts.
    moving = parameters - (step - jax.lax.stop_gradient(step))
    feet, normals, distances, beyond = _details(placed, local, moving)
    return Projection(moving, feet + offset, normals, distances, beyond, converged)


@jax.jit
def _details(placed: Placed, points: Array, parameters: Array) -> tuple[Array, Array, Array, Array]:
    """Feet, unit normals, signed distances and which points lie past the border."""
    S, S_s, S_t, *_ = placed.jet(parameters)
    normal = jnp.cross(S_s, S_t)
    normal = normal / jnp.linalg.norm(normal, axis=1, keepdims=True)
    r = points - S
    gradient = -jnp.stack([jnp.sum(r * S_s, axis=1), jnp.sum(r * S_t, axis=1)], axis=1)
    beyond = held(parameters, gradient)
    return S, normal, jnp.sum(r * normal, axis=1), beyond.any(axis=1)
