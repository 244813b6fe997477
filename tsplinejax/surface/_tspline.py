"""The T-spline surface of Eq. 2: values and derivatives at parameters, as a pytree.

A surface is a spline space, one control point a blending function, and the frame that says where its parameters lie in
space. Evaluation contracts the control points to 4 × 4 Bézier points an element, then multiplies Bernstein polynomials;
derivatives are exact, from differentiated Bernstein polynomials and, for rational surfaces, the quotient rule.
"""

from math import comb

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float, Int

from .._errors import InputError
from ..data import Frame
from ..space import ElementTables, SplineSpace, bernstein


class TSpline(eqx.Module):
    """A T-spline height map (d = 1) or surface in space (d = 3).

    **Attributes:**

    - `space`: the spline space.
    - `control_points`: shape (n,) for heights, (n, 3) for a surface in space, in the unit of the frame.
    - `origin`, `extent`: place and size of the parameter square in the plane, (2,) each.
    - `unit`: the length unit of control points and frame, or `None`.

    `jit`, `grad`, `vmap` and `jacfwd` work on it with respect to control points and parameters.

    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> flat = make_surface(spline_space(b_lattice(2, 2)), np.ones(25))
    >>> flat(np.array([[0.3, 0.7]])).shape
    (1,)
    """

    space: SplineSpace
    control_points: Float[Array, " n"] | Float[Array, "n 3"]
    origin: Float[Array, " 2"]
    extent: Float[Array, " 2"]
    unit: str | None = eqx.field(static=True)

    @property
    def frame(self) -> Frame:
        """Where the parameter square lies: x = x0 + s Lx, y = y0 + t Ly."""
        (x0, y0), (width, height) = np.asarray(self.origin).tolist(), np.asarray(self.extent).tolist()
        return Frame((x0, y0), (width, height), self.unit)

    @property
    def is_height_map(self) -> bool:
        """Whether control points are heights rather than points in space."""
        return self.control_points.ndim == 1

    def __repr__(self) -> str:
        kind = "heights" if self.is_height_map else "points in space"
        return (
            f"TSpline({self.control_points.shape[0]} control points, {kind}, unit {self.unit}, "
            f"{'rational' if self.space.rational else 'polynomial'}, {self.space.dtype})"
        )

    def __call__(self, parameters: Float[ArrayLike, "m 2"]) -> Float[Array, " m"] | Float[Array, "m 3"]:
        """Heights (m,) or points (m, 3) at parameters (m, 2); a single parameter (2,) gives a scalar or a point.

        **Raises:** `InputError` for parameters outside [0, 1]² (also inside `jit`, as a runtime error).
        """
        return self.derivative(parameters, (0, 0))

    def derivative(
        self, parameters: Float[ArrayLike, "m 2"], order: tuple[int, int]
    ) -> Float[Array, " m"] | Float[Array, "m 3"]:
        """Partial derivative of the given order in s and t, each 0 to 3, with respect to parameters.

        **Raises:** `InputError` for parameters outside [0, 1]² or orders outside 0 ... 3.
        """
        if len(order) != 2 or not all(isinstance(k, int) and 0 <= k <= 3 for k in order):
            raise InputError(f"a derivative's order is two whole numbers from 0 to 3; received {order!r}; try (1, 0)")
        array = check_parameters(parameters, self.space.dtype)
        single = array.ndim == 1
        values = _derivative(self, jnp.atleast_2d(array), (order[0], order[1]))
        return values[0] if single else values

    def at(
        self, x: Float[ArrayLike, "*shape"], y: Float[ArrayLike, "*shape"], *, extrapolate: bool = False
    ) -> Float[Array, "*shape"]:
        """Heights at places (x, y) in the frame's unit; NaN outside the domain unless `extrapolate` holds the border's.

        **Raises:** `InputError` for a surface in space, whose places are not unique.
        """
        if not self.is_height_map:
            raise InputError(
                "only height maps are evaluated at (x, y); this surface has points in space; use parameters"
            )
        x, y = jnp.broadcast_arrays(jnp.asarray(x, self.space.dtype), jnp.asarray(y, self.space.dtype))
        parameters = (jnp.stack([x, y], axis=-1) - self.origin) / self.extent
        # Round-off of places far from zero must not push a border sample outside.
        slack = 64 * jnp.finfo(parameters.dtype).eps * (1 + jnp.abs(self.origin) / self.extent)
        inside = jnp.all((parameters >= -slack) & (parameters <= 1 + slack), axis=-1)
        values = _derivative(self, jnp.clip(parameters, 0, 1).reshape(-1, 2), (0, 0)).reshape(x.shape)
        return values if extrapolate else jnp.where(inside, values, jnp.nan)


def make_surface(space: SplineSpace, control_points: ArrayLike, frame: Frame | None = None) -> TSpline:
    """A surface from a space and its control points.

    **Arguments:**

    - `space`: the spline space, with n blending functions.
    - `control_points`: (n,) heights or (n, 3) points.
    - `frame`: the parameter square's place; by default the unit square without a unit.

    **Raises:** `InputError` where the number of control points is not n.

    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> make_surface(spline_space(b_lattice(2, 2)), np.zeros((25, 3))).is_height_map
    False
    """
    points = jnp.asarray(control_points, space.dtype)
    n = int(space.n_functions)
    if points.shape not in ((n,), (n, 3)):
        raise InputError(
            f"this space has {n} blending functions, so control points have shape ({n},) or ({n}, 3); "
            f"received {points.shape}"
        )
    frame = Frame((0.0, 0.0), (1.0, 1.0), None) if frame is None else frame
    return TSpline(
        space, points, jnp.asarray(frame.origin, space.dtype), jnp.asarray(frame.extent, space.dtype), frame.unit
    )


def check_parameters(parameters: ArrayLike, dtype: np.dtype) -> Array:
    """Parameters as a device array, refused outside [0, 1]²."""
    if isinstance(parameters, Tracer):
        traced = jnp.asarray(parameters, dtype)
        _check_shape(traced.shape)
        outside = jnp.any(~((traced >= 0) & (traced <= 1)))
        return eqx.error_if(traced, outside, "parameters lie in [0, 1]²; clip them or use TSpline.at")
    array = np.asarray(parameters, dtype)
    _check_shape(array.shape)
    if not ((array >= 0) & (array <= 1)).all():
        worst = array[~((array >= 0) & (array <= 1))][0]
        raise InputError(f"parameters lie in [0, 1]²; received {worst:g}; clip them, or use TSpline.at for NaN outside")
    return jnp.asarray(parameters, dtype)


def _check_shape(shape: tuple[int, ...]) -> None:
    """Raise unless parameters come in rows of two."""
    if len(shape) not in (1, 2) or shape[-1] != 2:
        raise InputError(f"parameters have shape (m, 2) or (2,); received {shape}; stack s and t as columns")


def bezier_points(
    tables: ElementTables, coefficients: Float[Array, "n d"], elements: Int[Array, " chosen"] | None = None
) -> Float[Array, "chosen 4 4 d"]:
    """Bézier points of every element, or of the chosen ones."""
    parts = (tables.functions, tables.along_s, tables.along_t)
    functions, along_s, along_t = parts if elements is None else (part[elements] for part in parts)
    return jnp.einsum("eka,ekb,ekd->eabd", along_s, along_t, coefficients[functions], precision="highest")


@eqx.filter_jit
def _derivative(surface: TSpline, parameters: Array, order: tuple[int, int]) -> Array:
    """The partial derivative at parameters (m, 2), in one dispatch."""
    space = surface.space
    coefficients = surface.control_points.reshape(surface.control_points.shape[0], -1)
    if space.rational:
        coefficients = jnp.concatenate([coefficients, jnp.ones_like(coefficients[:, :1])], axis=1)
    element = space.locator(parameters)
    if 4 * parameters.shape[0] < space.tables.functions.shape[0]:
        points = bezier_points(space.tables, coefficients, element)
    else:
        points = bezier_points(space.tables, coefficients)[element]
    size = space.tables.size[element]
    local = (parameters - space.tables.corner[element]) / size

    def polynomial(orders: tuple[int, int]) -> Array:
        along_s, along_t = (bernstein(local[:, k], orders[k]) / size[:, k, None] ** orders[k] for k in range(2))
        return jnp.einsum("ma,mb,mabd->md", along_s, along_t, points)

    values = _quotient(polynomial, order) if space.rational else polynomial(order)
    return values[:, 0] if surface.is_height_map else values


def _quotient(polynomial, order: tuple[int, int]) -> Array:
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
