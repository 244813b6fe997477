"""Evaluation: control points to Bézier points, parameters to elements, Bernstein polynomials times Bézier points.

Kernels are sums over a, b = 0 ... 3 of arrays (m, d), one row a parameter: the gathers of the 16 Bézier points and all
arithmetic fuse into one loop over parameters, without temporaries of (m, 4, 4). Concrete parameters are handed over
in chunks that stay in the cache, padded to capacities, so that no number of parameters and no number of control points
asks for a kernel of its own. Inside a transformation everything is one expression of the caller's.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from math import comb
from typing import Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from ..space import ElementTables, SplineSpace, bernstein_terms, capacity_for, pad, to_device
from ..space._locate import AbstractLocator
from ._parameters import refuse_traced, require_inside

# 1 to 4 MB of parameters and values: little enough for the cache, long enough to hide the call.
CHUNK = 1 << 17
ALIGNMENT = 64
Places = np.ndarray | Array
Rows = list[list[Array]]


@dataclass(frozen=True)
class Query:
    """What is evaluated, as kernels are compiled for it.

    **Attributes:**

    - `order`: of the derivative in s and t.
    - `rational`: whether Σ b_i divides.
    - `beyond`: places are parameters and refused outside [0, 1]², or are in the frame's unit, and outside the domain
      values are NaN or the border's.
    """

    order: tuple[int, int]
    rational: bool
    beyond: Literal["refuse", "nan", "hold"] = "refuse"


def bezier_points(
    tables: ElementTables, coefficients: Float[Array, "n d"], elements: Int[Array, " chosen"] | None = None
) -> Float[Array, "chosen 4 4 d"]:
    """Bézier points of every element, or of the chosen ones."""
    parts = (tables.functions, tables.along_s, tables.along_t)
    functions, along_s, along_t = parts if elements is None else (part[elements] for part in parts)
    points = coefficients[functions]
    total = jnp.zeros((), coefficients.dtype)
    for k in range(functions.shape[1]):  # one fused loop over elements: seven times the speed of a batched product
        column = along_t[:, k, None, :, None] * points[:, k, None, None, :]
        total = total + along_s[:, k, :, None, None] * column
    return total


def evaluate(
    space: SplineSpace,
    control_points: Float[Array, " n"] | Float[Array, "n 3"],
    frame: tuple[Array, Array],
    places: Places,
    query: Query,
) -> Float[Array, "*shape"] | Float[Array, "*shape 3"]:
    """Values at places (*shape, 2); `frame` is origin and extent."""
    inputs = (control_points, space.tables, space.locator, frame, places)
    if not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(inputs)):
        # Concrete numbers stay concrete inside somebody's jit, too: the chunks are cut on the host.
        with jax.ensure_compile_time_eval():
            return _in_chunks(space, control_points, frame, places, query)
    flat = jnp.asarray(places, space.dtype).reshape(-1, 2)
    if query.beyond == "refuse":
        flat = refuse_traced(flat)
    coefficients = control_points.reshape(control_points.shape[0], -1)
    values = _kernel(space, coefficients, frame, len(flat), query)(flat)
    return values.reshape(*places.shape[:-1], *control_points.shape[1:])


def jet(
    space: SplineSpace,
    points: Float[Array, "elements 4 4 d"],
    parameters: Float[Array, "m 2"],
    orders: Sequence[tuple[int, int]],
) -> list[Float[Array, "m d"]]:
    """Values and derivatives of several orders at once, inside a transformation: they share their gathers.

    `points` are the Bézier points of all elements, in homogeneous coordinates where the space is rational.
    """
    element = space.locator(parameters)
    sizes = [space.tables.size[element, k] for k in range(2)]
    local = [(parameters[:, k] - space.tables.corner[element, k]) / sizes[k] for k in range(2)]
    rows = _rows(points, element)
    return [_values(Query(order, space.rational), local, sizes, rows, None) for order in orders]


def on_host(space: SplineSpace) -> bool:
    """Whether the device's memory is the host's, so that cutting and joining arrays there costs no transfer."""
    functions = space.tables.functions
    return not isinstance(functions, jax.Array) or all(device.platform == "cpu" for device in functions.devices())


def _in_chunks(
    space: SplineSpace, control_points: Array, frame: tuple[Array, Array], places: Places, query: Query
) -> Array:
    """The same for concrete numbers, by kernels that any number of places and control points shares."""
    shape = (*places.shape[:-1], *control_points.shape[1:])
    host = on_host(space)
    flat = (np.asarray(places) if host else places).reshape(-1, 2)
    m = len(flat)
    # Memory is far and launches are dear on an accelerator: one pass over all places, without a copy of many.
    length = CHUNK if host else max(m, CHUNK)
    coefficients = np.asarray(control_points, space.dtype).reshape(control_points.shape[0], -1)
    kernel = _kernel(space, to_device(pad(coefficients, space.capacity, 0)), frame, m, query)
    starts = range(0, max(m, 1), length)
    parts = [kernel(_padded(flat[start : start + length], space.dtype, query)) for start in starts]
    if not host:
        return parts[0][:m].reshape(shape)
    return to_device(_joined(parts, length, m).reshape(shape))


def _joined(parts: list[Array], length: int, m: int) -> np.ndarray:
    """The first m rows of chunks of a length, where the device can take them over without another copy."""
    if len(parts) == 1:
        return np.asarray(parts[0])[:m]
    rows = (m, *parts[0].shape[1:])
    memory = np.empty(int(np.prod(rows)) * parts[0].dtype.itemsize + ALIGNMENT, np.uint8)
    start = -memory.ctypes.data % ALIGNMENT
    joined = memory[start : start - ALIGNMENT].view(parts[0].dtype).reshape(rows)
    for k, part in enumerate(parts):
        joined[k * length : (k + 1) * length] = np.asarray(part)[: m - k * length]
    return joined


def _padded(places: Places, dtype: np.dtype, query: Query) -> Places:
    """A chunk, checked and padded to a capacity."""
    numbers = jnp if isinstance(places, jax.Array) else np
    places = numbers.asarray(places, dtype)
    if query.beyond == "refuse":
        require_inside(places)  # type: ignore[arg-type]
    m = len(places)
    padding = capacity_for(m) - m if m < CHUNK else 0
    return numbers.concatenate([places, numbers.zeros((padding, 2), dtype)]) if padding else places


def _kernel(
    space: SplineSpace, coefficients: Array, frame: tuple[Array, Array], m: int, query: Query
) -> Callable[[Places], Array]:
    """The kernel that suits m places: all Bézier points first, or those of the elements that are met."""
    tables, locator = space.tables, space.locator
    if 4 * m < space.capacity:
        return partial(_at_few, query, tables, locator, coefficients, frame)
    points = _bezier_points(tables, _homogeneous(coefficients, query.rational))
    return partial(_at_many, query, tables.corner, tables.size, locator, points, frame)


_bezier_points = jax.jit(bezier_points)


@partial(jax.jit, static_argnums=1)
def _homogeneous(coefficients: Array, rational: bool) -> Array:
    """Ones as a last component, which become Σ b_i."""
    return jnp.concatenate([coefficients, jnp.ones_like(coefficients[:, :1])], axis=1) if rational else coefficients


@partial(jax.jit, static_argnums=0)
def _at_many(
    query: Query,
    corner: Array,
    size: Array,
    locator: AbstractLocator,
    points: Float[Array, "elements 4 4 d"],
    frame: tuple[Array, Array],
    places: Float[Array, "m 2"],
) -> Array:
    """Values from the Bézier points of all elements."""
    parameters, inside = _parameters(query, frame, places)
    element = locator(parameters)
    local = [(parameters[:, k] - corner[element, k]) / size[element, k] for k in range(2)]
    sizes = [size[element, k] for k in range(2)]
    return _values(query, local, sizes, _rows(points, element), inside)


@partial(jax.jit, static_argnums=0)
def _at_few(
    query: Query,
    tables: ElementTables,
    locator: AbstractLocator,
    coefficients: Float[Array, "n d"],
    frame: tuple[Array, Array],
    places: Float[Array, "m 2"],
) -> Array:
    """Values from the Bézier points of the elements that are met."""
    parameters, inside = _parameters(query, frame, places)
    element = locator(parameters)
    points = bezier_points(tables, _homogeneous(coefficients, query.rational), element)
    sizes = [tables.size[element, k] for k in range(2)]
    local = [(parameters[:, k] - tables.corner[element, k]) / sizes[k] for k in range(2)]
    return _values(query, local, sizes, _split(points), inside)


def _parameters(query: Query, frame: tuple[Array, Array], places: Array) -> tuple[Array, Array | None]:
    """Parameters of places, and which are inside the domain where that counts."""
    if query.beyond == "refuse":
        return places, None
    origin, extent = frame
    parameters = (places - origin) / extent
    # Round-off of places far from zero must not push a border sample outside.
    slack = 64 * jnp.finfo(parameters.dtype).eps * (1 + jnp.abs(origin) / extent)
    inside = jnp.all((parameters >= -slack) & (parameters <= 1 + slack), axis=-1)
    return jnp.clip(parameters, 0, 1), inside if query.beyond == "nan" else None


@jax.custom_jvp
def _rows(points: Float[Array, "elements 4 4 d"], element: Int[Array, " m"]) -> Rows:
    """Bézier points (a, b) of each parameter's element, (m, d) each: sixteen gathers that fuse into what uses them."""
    return [[points[element, a, b] for b in range(4)] for a in range(4)]


@_rows.defjvp
def _rows_jvp(primals: tuple[Array, Array], tangents: tuple[Array, Array]) -> tuple[Rows, Rows]:
    """One gather for the tangents: its transpose is one scatter, where sixteen of them take six times as long."""
    points, element = primals
    return _rows(points, element), _split(tangents[0][element])


def _split(pieces: Float[Array, "m 4 4 d"]) -> Rows:
    """Each Bézier point (a, b) by itself."""
    return [[pieces[:, a, b] for b in range(4)] for a in range(4)]


def _values(query: Query, local: list[Array], sizes: list[Array], points: Rows, inside: Array | None) -> Array:
    """Σ_ab B_a(u) B_b(v) P_ab or its derivative: (m,) for one component, (m, d) for more."""

    def polynomial(orders: tuple[int, int]) -> Float[Array, "m d"]:
        B, C = (
            [term[:, None] / size[:, None] ** k for term in bernstein_terms(u, k)]
            for u, size, k in zip(local, sizes, orders, strict=True)
        )
        rows = [B[a] * sum(C[b] * points[a][b] for b in range(4)) for a in range(4)]
        return rows[0] + rows[1] + rows[2] + rows[3]

    values = _quotient(polynomial, query.order) if query.rational else polynomial(query.order)
    if inside is not None:
        values = jnp.where(inside[:, None], values, jnp.nan)
    return values[:, 0] if values.shape[1] == 1 else values


def _quotient(polynomial: Callable[[tuple[int, int]], Array], order: tuple[int, int]) -> Array:
    """Derivative of numerator over denominator, by Leibniz' rule on f · w = p."""
    known: dict[tuple[int, int], Array] = {}
    raw = {(i, j): polynomial((i, j)) for i in range(order[0] + 1) for j in range(order[1] + 1)}
    for (i, j), value in raw.items():
        rest = value[:, :-1]
        for (k, m), earlier in known.items():
            if k <= i and m <= j:
                rest = rest - comb(i, k) * comb(j, m) * raw[i - k, j - m][:, -1:] * earlier
        known[i, j] = rest / raw[0, 0][:, -1:]
    return known[order]
