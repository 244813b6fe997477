"""The T-spline surface of Eq. 2: values and derivatives at parameters, as a pytree.

A surface is a spline space, one control point a blending function, and the frame that says where its parameters lie in
space. Derivatives are exact, from differentiated Bernstein polynomials and, for rational surfaces, the quotient rule.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._errors import InputError
from ..data import Frame
from ..space import SplineSpace
from ._evaluate import Query, evaluate, on_host
from ._parameters import real_array, rows_of_two


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
        query = Query((order[0], order[1]), self.space.rational)
        return evaluate(self.space, self.control_points, self._place, rows_of_two(parameters), query)

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
        query = Query((0, 0), self.space.rational, "hold" if extrapolate else "nan")
        return evaluate(self.space, self.control_points, self._place, _pairs(x, y, self.space), query)

    @property
    def _place(self) -> tuple[Array, Array]:
        """Origin and extent."""
        return self.origin, self.extent


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


def _pairs(x: ArrayLike, y: ArrayLike, space: SplineSpace) -> np.ndarray | Array:
    """Places (*shape, 2), put together where they are."""
    columns = [real_array(values, "places x and y") for values in (x, y)]
    try:
        shape = np.broadcast_shapes(*(column.shape for column in columns))
    except ValueError as error:
        raise InputError(
            f"places x and y have one shape, or shapes that broadcast; received {columns[0].shape} and "
            f"{columns[1].shape}; for all pairs of two axes pass x[None, :] and y[:, None]"
        ) from error
    apart = any(isinstance(column, Tracer) or not on_host(space) for column in columns)
    if apart:
        return jnp.stack([jnp.broadcast_to(jnp.asarray(column, space.dtype), shape) for column in columns], axis=-1)
    places = np.empty((*shape, 2), space.dtype)
    places[..., 0], places[..., 1] = columns
    return places
