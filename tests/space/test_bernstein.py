"""Bernstein polynomials, blossoms and their integrals against scipy, numpy and quadrature."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.interpolate import BPoly, BSpline

from tsplinejax.space import bernstein, bernstein6, blossom_weights, gram, product_weights
from tsplinejax.space._bernstein import blossom_pieces

NODES, WEIGHTS = (values / 2 for values in np.polynomial.legendre.leggauss(8))


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4])
def test_bernstein_and_derivatives(order):
    """The four cubic polynomials and their derivatives equal scipy's."""
    u = np.linspace(0, 1, 23)
    expected = np.stack([BPoly(row[:, None], [0, 1])(u, nu=order) for row in np.eye(4)], axis=1)
    np.testing.assert_allclose(bernstein(jnp.asarray(u), order), expected, atol=1e-12)


def test_bernstein_of_degree_six():
    """The seven polynomials of degree six equal scipy's."""
    u = np.linspace(0, 1, 23)
    expected = np.stack([BPoly(row[:, None], [0, 1])(u) for row in np.eye(7)], axis=1)
    np.testing.assert_allclose(bernstein6(jnp.asarray(u)), expected, atol=1e-14)


def test_products_of_cubics():
    """B³_a B³_b = w[a, b] B⁶_(a+b), which moments rest on."""
    u = jnp.linspace(0, 1, 11)
    cubic, six, weights = bernstein(u), bernstein6(u), product_weights()
    for a in range(4):
        for b in range(4):
            np.testing.assert_allclose(cubic[:, a] * cubic[:, b], weights[a, b] * six[:, a + b], atol=1e-15)


@pytest.mark.parametrize("order", [0, 1, 2])
def test_gram_matrices(order):
    """Closed integrals equal Gauss quadrature that is exact for them."""
    values = np.asarray(bernstein(jnp.asarray(NODES + 0.5), order))
    np.testing.assert_allclose(gram(order), np.einsum("qa,qb,q->ab", values, values, WEIGHTS), atol=1e-12)


def test_precision_is_kept(dtype):
    """Each lane stays in its own precision."""
    assert bernstein(jnp.zeros(3, dtype)).dtype == dtype
    assert bernstein6(jnp.zeros(3, dtype)).dtype == dtype


@st.composite
def knots_around_unit(draw: st.DrawFn) -> np.ndarray:
    """Five knots, possibly repeated, none strictly inside [0, 1]."""
    inside = draw(st.integers(1, 4))
    distance = st.sampled_from([0.0, 0.0, 0.25, 0.5, 1.0, 3.0])
    below = -np.cumsum([draw(distance) for _ in range(inside)])[::-1]
    above = 1 + np.cumsum([draw(distance) for _ in range(5 - inside)])
    return np.concatenate([below, above])


@given(knots_around_unit())
def test_pieces_are_the_blending_function(knots):
    """The Bernstein coefficients reproduce the blending function over [0, 1] (Cox-de Boor in scipy)."""
    u = np.linspace(0.01, 0.99, 9)
    value = np.asarray(bernstein(jnp.asarray(u)) @ blossom_pieces(jnp.asarray(knots)))
    np.testing.assert_allclose(value, BSpline.basis_element(knots, extrapolate=False)(u), atol=1e-13)


def test_functions_elsewhere_give_zeros():
    """A function whose support ends at 0 or starts at 1 has no coefficients over [0, 1]."""
    knots = jnp.array([[-4.0, -3, -2, -1, 0], [1, 2, 3, 4, 5], [0, 0, 0, 0, 0]])
    assert not np.asarray(blossom_pieces(knots)).any()


@given(st.lists(st.floats(-1, 2), min_size=3, max_size=3), st.lists(st.floats(-2, 2), min_size=4, max_size=4))
def test_blossoms(arguments, coefficients):
    """A blossom is symmetric, affine in each argument, and the polynomial itself on the diagonal."""
    c = jnp.asarray(coefficients)

    def blossom(*u: float) -> float:
        return float(blossom_weights(jnp.asarray(u, float)) @ c)

    a, b, d = arguments
    assert blossom(a, b, d) == pytest.approx(blossom(d, a, b), abs=1e-10)
    assert blossom(a, b, (a + d) / 2) == pytest.approx((blossom(a, b, a) + blossom(a, b, d)) / 2, abs=1e-10)
    assert blossom(a, a, a) == pytest.approx(float(bernstein(jnp.asarray(a)) @ c), abs=1e-10)


def test_derivatives_by_autodiff():
    """Differentiated polynomials equal autodiff of the undifferentiated ones."""
    slope = jax.vmap(jax.jacfwd(bernstein))(jnp.linspace(0, 1, 7))
    np.testing.assert_allclose(slope, bernstein(jnp.linspace(0, 1, 7), 1), atol=1e-13)
