"""Cubic Bernstein polynomials and what local knots look like in them.

A polynomial of degree p on [0, 1] is written Σ_a c_a B^p_a(u). A cubic blending function's piece over [0, 1] has the
four Bernstein coefficients f(0,0,0), f(0,0,1), f(0,1,1), f(1,1,1) of its blossom f, and the blossom follows the
Cox-de Boor recursion with a different argument at each degree.
"""

from itertools import pairwise
from math import comb

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


def bernstein(u: Float[Array, "*shape"], order: int = 0) -> Float[Array, "*shape 4"]:
    """The four cubic Bernstein polynomials at u, or their derivatives of the given order with respect to u.

    >>> bernstein(jnp.asarray(0.5)).tolist()
    [0.125, 0.375, 0.375, 0.125]
    """
    return jnp.stack(bernstein_terms(u, order), axis=-1)


def bernstein_terms(u: Float[Array, "*shape"], order: int = 0) -> list[Float[Array, "*shape"]]:
    """The same one by one: sums over separate arrays fuse into one loop, which products of stacks do not.

    >>> tuple(float(term) for term in bernstein_terms(jnp.asarray(0.5), 1))
    (-0.75, -0.75, 0.75, 0.75)
    """
    v = 1 - u
    lower = (
        [u * 0 + 1],
        [v, u],
        [v * v, 2 * u * v, u * u],
        [v * v * v, 3 * u * v * v, 3 * u * u * v, u * u * u],
    )
    if order > 3:
        return [jnp.zeros_like(u)] * 4
    values = lower[3 - order]
    for degree in range(4 - order, 4):  # (B^p_a)' = p (B^(p-1)_(a-1) - B^(p-1)_a)
        padded = [0 * u, *values, 0 * u]
        values = [degree * (left - right) for left, right in pairwise(padded)]
    return values


def bernstein6(u: Float[Array, "*shape"]) -> Float[Array, "*shape 7"]:
    """The seven Bernstein polynomials of degree six: products of two cubic ones are multiples of these."""
    v = 1 - u
    u2, v2 = u * u, v * v
    u3, v3 = u2 * u, v2 * v
    terms = [v3 * v3, 6 * u * v3 * v2, 15 * u2 * v2 * v2, 20 * u3 * v3, 15 * u2 * u2 * v2, 6 * u3 * u2 * v, u3 * u3]
    return jnp.stack(terms, axis=-1)


def product_weights() -> Float[np.ndarray, "4 4"]:
    """Weights w with B³_a B³_b = w[a, b] B⁶_(a+b)."""
    return np.array([[comb(3, a) * comb(3, b) / comb(6, a + b) for b in range(4)] for a in range(4)])


def gram(order: int) -> Float[np.ndarray, "4 4"]:
    """∫ B_a⁽ᵏ⁾ B_b⁽ᵏ⁾ du over [0, 1] for derivatives of the given order k, exact.

    >>> gram(0).sum().round(12).item()
    1.0
    """
    degree = 3 - order
    binomials = np.array([comb(degree, a) for a in range(degree + 1)])
    places = np.add.outer(np.arange(degree + 1), np.arange(degree + 1))
    middle = np.array([comb(2 * degree, k) for k in range(2 * degree + 1)])
    mass = np.outer(binomials, binomials) / middle[places] / (2 * degree + 1)
    derive = np.eye(4)
    for p in range(3, degree, -1):  # coefficients of the derivative: p (c_(a+1) - c_a)
        derive = p * np.diff(derive, axis=0)
    return derive.T @ mass @ derive


def blossom_pieces(knots: Float[Array, "*shape 5"]) -> Float[Array, "*shape 4"]:
    """Bernstein coefficients over [0, 1] of the cubic blending function with these local knots.

    No knot lies strictly inside [0, 1]; repeated knots are allowed, and a function that vanishes there gives zeros.
    """
    knot = jnp.unstack(knots, axis=-1)
    rising, falling = {}, {}  # weights by degree and argument, which the pieces share
    for degree in (1, 2, 3):
        widths = [knot[r + degree] - knot[r] for r in range(5 - degree)]
        empty = [width <= 0 for width in widths]
        safe = [jnp.where(none, 1, width) for none, width in zip(empty, widths, strict=True)]
        for u in (0, 1):
            rising[degree, u] = [jnp.where(empty[r], 0, (u - knot[r]) / safe[r]) for r in range(4 - degree)]
            falling[degree, u] = [
                jnp.where(empty[r], 0, (knot[r + degree] - u) / safe[r]) for r in range(1, 5 - degree)
            ]

    def blend(values: list[Array], degree: int, u: int) -> list[Array]:
        up, down = rising[degree, u], falling[degree, u]
        return [up[r] * values[r] + down[r] * values[r + 1] for r in range(4 - degree)]

    spans = [((low <= 0) & (high >= 1)).astype(knots.dtype) for low, high in pairwise(knot)]
    at_0, at_1 = blend(spans, 1, 0), blend(spans, 1, 1)
    at_00, at_01, at_11 = blend(at_0, 2, 0), blend(at_0, 2, 1), blend(at_1, 2, 1)
    pieces = blend(at_00, 3, 0) + blend(at_00, 3, 1) + blend(at_01, 3, 1) + blend(at_11, 3, 1)
    return jnp.stack(pieces, axis=-1)


def blossom_weights(u: Float[Array, "*shape 3"]) -> Float[Array, "*shape 4"]:
    """Weights of the Bernstein coefficients in the blossom of a cubic at three arguments."""
    weights = [jnp.ones_like(u[..., 0])]
    for k in range(3):
        x = u[..., k]
        padded = [jnp.zeros_like(x), *weights, jnp.zeros_like(x)]
        weights = [x * left + (1 - x) * right for left, right in pairwise(padded)]
    return jnp.stack(weights, axis=-1)
