"""Evaluation: control points to Bézier points, parameters to elements, Bernstein polynomials times Bézier points.

Kernels are sums over a, b = 0 ... 3 of flat arrays (m,), one entry a parameter: the gathers of the 16 Bézier points and
all arithmetic fuse into one loop over parameters, without temporaries of (m, 4, 4). Concrete parameters are handed over
in chunks that stay in the cache, padded to capacities, so that no number of parameters and no number of control points
asks for a kernel of its own. Inside a transformation everything is one expression of the caller's.
"""

from collections.abc import Callable
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
Places = np.ndarray | Array
Point = Callable[[int, int, int], Array]


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
    cut = [np.asarray(part)[: m - start] for start, part in zip(starts, parts, strict=True)]
    return to_device((np.concatenate(cut) if len(cut) > 1 else cut[0]).reshape(shape))


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
    return _values(query, local, sizes, lambda a, b, c: points[element, a, b, c], points.shape[-1], inside)


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
    return _values(query, local, sizes, lambda a, b, c: points[:, a, b, c], points.shape[-1], inside)


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


def _values(
    query: Query, local: list[Array], sizes: list[Array], point: Point, components: int, inside: Array | None
) -> Array:
    """Σ_ab B_a(u) B_b(v) P_ab or its derivative: (m,) for one component, (m, d) for more."""

    def polynomial(orders: tuple[int, int]) -> list[Array]:
        terms = zip(local, sizes, orders, strict=True)
        B, C = ([term / size**k for term in bernstein_terms(u, k)] if k else bernstein_terms(u) for u, size, k in terms)
        return [
            sum(B[a] * sum(C[b] * point(a, b, c) for b in range(4)) for a in range(4))  # type: ignore[misc]
            for c in range(components)
        ]

    values = _quotient(polynomial, query.order) if query.rational else polynomial(query.order)
    if inside is not None:
        values = [jnp.where(inside, value, jnp.nan) for value in values]
    return values[0] if len(values) == 1 else jnp.stack(values, axis=-1)


def _quotient(polynomial: Callable[[tuple[int, int]], list[Array]], order: tuple[int, int]) -> list[Array]:
    """Derivative of numerator over denominator, by Leibniz' rule on f · w = p."""
    known: dict[tuple[int, int], list[Array]] = {}
    raw = {(i, j): polynomial((i, j)) for i in range(order[0] + 1) for j in range(order[1] + 1)}
    for (i, j), (*rest, _) in raw.items():
        for (k, m), earlier in known.items():
            if k <= i and m <= j:
                weight = comb(i, k) * comb(j, m) * raw[i - k, j - m][-1]
                rest = [value - weight * other for value, other in zip(rest, earlier, strict=True)]
        known[i, j] = [value / raw[0, 0][-1] for value in rest]
    return known[order]
