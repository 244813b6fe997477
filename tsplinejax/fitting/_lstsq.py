"""Least squares on a fixed space, differentiable with respect to values, weights, parameters and smoothing.

min_P Σ_j w_j |v_j - f_P(s_j, t_j)|² + λ E(f_P). The linear solve is implicit: its derivatives solve the same system,
so they cost one more solve and hold at the solution, whatever path the iterations took.
"""

from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._errors import InputError
from ..space import SplineSpace, bernstein, bernstein6
from ..surface import check_parameters
from ._moments import Moments
from ._solve import descend
from ._system import element_matrices

CHUNK = 1 << 14
ITERATIONS = 2000


def lstsq(
    space: SplineSpace,
    parameters: Float[ArrayLike, "m 2"],
    values: Float[ArrayLike, " m"] | Float[ArrayLike, "m d"],
    weights: Float[ArrayLike, " m"] | None = None,
    *,
    smoothing: Float[ArrayLike, ""] = 0.0,
    extent: tuple[float, float] = (1.0, 1.0),
) -> Float[Array, " n"] | Float[Array, "n d"]:
    """Control points of the least-squares T-spline over a fixed space.

    **Arguments:**

    - `space`: the spline space, with n blending functions.
    - `parameters`: (m, 2) in [0, 1]².
    - `values`: (m,) or (m, d): d sets of values over the same parameters share the matrix, so a batch is one call.
    - `weights`: (m,), not negative; by default one.
    - `smoothing`: weight λ of the bending energy, at least zero (see `bending_energy`).
    - `extent`: physical sides (Lx, Ly) of the parameter square, for the energy; only their ratio counts.

    **Returns:** control points (n,) or (n, d). Differentiable, and works under `jit` and `vmap`.

    **Raises:** `InputError` for shapes that do not fit together, values, weights or λ that are not finite (or negative,
    for the latter two) and, without smoothing, for fewer samples than control
    points (the problem is then singular: give `smoothing=`, or a coarser space).

    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> places = np.random.default_rng(0).random((100, 2))
    >>> points = lstsq(spline_space(b_lattice(2, 2)), places, places[:, 0])
    >>> points.shape
    (25,)
    """
    places = check_parameters(parameters, space.dtype)
    values, weights = _checked(space, places, values, weights, smoothing)
    columns = values if values.ndim == 2 else values[:, None]
    sides = np.asarray(extent, np.float64)
    sides = jnp.asarray(sides / np.sqrt(sides.prod()), space.dtype)
    points = _solve(space, places, columns, weights, jnp.asarray(smoothing, space.dtype), sides)
    points = points[: int(space.n_functions)]
    return points if values.ndim == 2 else points[:, 0]


def _checked(
    space: SplineSpace, places: Array, values: ArrayLike, weights: ArrayLike | None, smoothing: ArrayLike
) -> tuple[Array, Array]:
    """Values and weights as device arrays of matching shape."""
    values = _real(values, "values", space.dtype)
    weights = jnp.ones(len(places), space.dtype) if weights is None else _real(weights, "weights", space.dtype)
    m = len(places)
    if places.ndim != 2 or values.ndim not in (1, 2) or len(values) != m or weights.shape != (m,):
        raise InputError(
            "lstsq takes parameters (m, 2), values (m,) or (m, d) and weights (m,); received "
            f"{places.shape}, {values.shape} and {weights.shape}"
        )
    _require(weights, lambda w: bool((w >= 0).all()), "weights are finite and not negative")
    _require(values, lambda v: True, "values are finite; leave missing ones out")
    weight = _real(smoothing, "smoothing", space.dtype)
    _require(weight, lambda w: w.ndim == 0 and bool(w >= 0), "smoothing λ is one finite number of at least zero")
    unsmoothed = not isinstance(weight, Tracer) and float(weight) == 0
    if unsmoothed and m < int(space.n_functions):
        raise InputError(
            f"without smoothing there must be at least as many samples as control points; received {m} samples for "
            f"{int(space.n_functions)}; give smoothing=, or a coarser space"
        )
    return values, weights


def _real(values: ArrayLike, name: str, dtype: np.dtype) -> Array:
    """Real numbers as a device array."""
    if not isinstance(values, jax.Array) and np.asarray(values).dtype.kind not in "biuf":
        raise InputError(f"{name} are real numbers; received {np.asarray(values).dtype}; convert them first")
    return jnp.asarray(values, dtype)


def _require(values: Array, rule: Callable[[np.ndarray], bool], message: str) -> None:
    """Raise for concrete values that are not finite or break the rule; traced ones are not known yet."""
    if not isinstance(values, Tracer):
        array = np.asarray(values)
        if not np.isfinite(array).all() or not rule(array):
            raise InputError(f"{message}; received {array[~(np.isfinite(array) & (array >= 0))].ravel()[:3]}")


@eqx.filter_jit
def _solve(
    space: SplineSpace, places: Array, values: Array, weights: Array, smoothing: Array, sides: Array
) -> Float[Array, "capacity d"]:
    """The implicit solve, with diagonal scaling."""
    moments = _moments(space, places, values, weights)
    matrices, loads = element_matrices(
        space.tables.functions,
        space.tables.along_s,
        space.tables.along_t,
        space.tables.size * sides,
        moments,
        smoothing,
    )
    length = space.capacity
    load = jnp.zeros((length, values.shape[1]), space.dtype).at[space.tables.functions].add(loads)
    diagonal = jnp.zeros(length, space.dtype).at[space.tables.functions].add(jnp.diagonal(matrices, axis1=1, axis2=2))
    scale = jax.lax.stop_gradient(jnp.where(diagonal > 0, 1 / jnp.where(diagonal > 0, diagonal, 1), 1))[:, None]
    absent = (diagonal <= 0)[:, None]

    def apply(x: Array) -> Array:
        products = jnp.einsum("eij,ejd->eid", matrices, x[space.tables.functions], precision="highest")
        return jnp.zeros_like(x).at[space.tables.functions].add(products) + jnp.where(absent, x, 0)

    tolerance = 1e-13 if space.dtype == np.float64 else 1e-7
    iterate = partial(_solve_from_zero, scale=scale, tolerance=tolerance)
    return jax.lax.custom_linear_solve(apply, load, iterate, symmetric=True)


def _solve_from_zero(apply: Callable[[Array], Array], load: Array, *, scale: Array, tolerance: float) -> Array:
    """Solve a symmetric positive system."""
    limit = tolerance**2 * jnp.sum(load * scale * load, axis=0)
    return descend(apply, jnp.zeros_like(load), load, scale, limit, jnp.asarray(ITERATIONS))[0]


def _moments(space: SplineSpace, places: Array, values: Array, weights: Array) -> Moments:
    """Moments of the samples in the order they come, in chunks that bound memory."""
    m = len(places)
    chunks = -(-m // CHUNK) if m > CHUNK else 1
    length = -(-m // chunks)
    padding = chunks * length - m

    def chunked(part: Array) -> Array:
        padded = jnp.pad(part, ((0, padding), *((0, 0) for _ in part.shape[1:])))
        return padded.reshape(chunks, length, *part.shape[1:])

    tables = space.tables
    sums = jnp.einsum("eka,ekb->eab", tables.along_s, tables.along_t, precision="highest") if space.rational else None
    capacity = space.capacity
    empty = Moments(jnp.zeros((capacity, 7, 7), space.dtype), jnp.zeros((capacity, 4, 4, values.shape[1]), space.dtype))

    def add(moments: Moments, chunk: tuple[Array, Array, Array]) -> tuple[Moments, None]:
        places, values, weights = chunk
        element = space.locator(places)
        local = (places - space.tables.corner[element]) / space.tables.size[element]
        cubic_s, cubic_t = bernstein(local[:, 0]), bernstein(local[:, 1])
        if sums is not None:
            total = jnp.einsum("ma,mb,mab->m", cubic_s, cubic_t, sums[element])
            weights, values = weights / total**2, values * total[:, None]
        six_s, six_t = bernstein6(local[:, 0]) * weights[:, None], bernstein6(local[:, 1])
        mass = moments.mass.at[element].add(six_s[:, :, None] * six_t[:, None, :])
        cubic = (cubic_s * weights[:, None])[:, :, None] * cubic_t[:, None, :]
        return Moments(mass, moments.load.at[element].add(cubic[..., None] * values[:, None, None])), None

    return jax.lax.scan(add, empty, (chunked(places), chunked(values), chunked(weights)))[0]
