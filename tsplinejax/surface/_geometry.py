"""Differential geometry of T-splines: unit normals and curvatures, in physical coordinates.

A height map is the surface (x, y, f) with x and y from its frame; its normals point up. A surface in space has the
normal q_s × q_t. With the first fundamental form E, F, G and the second e, f, g: K = (e g - f²) / (E G - F²), H = (e
G - 2 f F + g E) / (2 (E G - F²)); H is positive where the surface bends towards n.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, ArrayLike, Float

from ._tspline import TSpline


def normals(surface: TSpline, parameters: Float[ArrayLike, "m 2"]) -> Float[Array, "m 3"]:
    """Unit normals at parameters (m, 2).

    Where a surface in space is degenerate (q_s parallel to q_t) the normal is NaN.

    >>> import numpy as np
    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> from tsplinejax.surface import make_surface
    >>> normals(make_surface(spline_space(b_lattice(1, 1)), np.ones(16)), np.array([[0.5, 0.5]])).tolist()
    [[0.0, 0.0, 1.0]]
    """
    s, t = (_tangent(surface, parameters, axis) for axis in range(2))
    direction = jnp.cross(s, t)
    return direction / jnp.linalg.norm(direction, axis=-1, keepdims=True)


class Curvatures(eqx.Module):
    """Mean curvature H (1 / unit) and Gaussian curvature K (1 / unit²), each (m,)."""

    mean: Float[Array, " m"]
    gaussian: Float[Array, " m"]


def curvatures(surface: TSpline, parameters: Float[ArrayLike, "m 2"]) -> Curvatures:
    """Mean and Gaussian curvature at parameters (m, 2).

    >>> import numpy as np
    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> from tsplinejax.surface import make_surface
    >>> flat = make_surface(spline_space(b_lattice(1, 1)), np.ones(16))
    >>> curvatures(flat, np.array([[0.5, 0.5]])).gaussian.tolist()
    [0.0]
    """
    s, t = (_tangent(surface, parameters, axis) for axis in range(2))
    n = normals(surface, parameters)
    second = [_normal_part(surface, parameters, n, order) for order in ((2, 0), (1, 1), (0, 2))]
    e, f, g = second
    E, F, G = (jnp.sum(a * b, axis=-1) for a, b in ((s, s), (s, t), (t, t)))
    area = E * G - F * F
    return Curvatures((e * G - 2 * f * F + g * E) / (2 * area), (e * g - f * f) / area)


def _tangent(surface: TSpline, parameters: ArrayLike, axis: int) -> Array:
    """q_s or q_t, (m, 3)."""
    derivative = surface.derivative(parameters, (1, 0) if axis == 0 else (0, 1))
    if not surface.is_height_map:
        return derivative
    planar = jnp.zeros((*derivative.shape, 2), derivative.dtype).at[..., axis].set(surface.extent[axis])
    return jnp.concatenate([planar, derivative[..., None]], axis=-1)


def _normal_part(surface: TSpline, parameters: ArrayLike, n: Array, order: tuple[int, int]) -> Array:
    """A second derivative's component along the normal."""
    derivative = surface.derivative(parameters, order)
    return derivative * n[..., 2] if surface.is_height_map else jnp.sum(derivative * n, axis=-1)
