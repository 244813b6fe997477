"""Surfaces: values and derivatives against scipy, the definition, autodiff and differences; JAX transformations."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.interpolate import NdBSpline

from tsplinejax import Frame, InputError, TSpline
from tsplinejax.mesh import Dyadic, b_lattice, from_rectangles, is_analysis_suitable, refine
from tsplinejax.space import spline_space
from tsplinejax.surface import make_surface

from ..blending import blending
from ..random_meshes import hand_given, marks_at_points, meshes, parameters

T_JUNCTIONS = [[0, 0, 0.3, 1], [0.3, 0, 1, 0.45], [0.3, 0.45, 0.8, 1], [0.8, 0.45, 1, 0.7], [0.8, 0.7, 1, 1]]
PINWHEEL = [[0, 0, 0.6, 0.4], [0.6, 0, 1, 0.6], [0.4, 0.6, 1, 1], [0, 0.4, 0.4, 1], [0.4, 0.4, 0.6, 0.6]]


def random_surface(tmesh, seed: int = 0, dimension: int = 1, **options) -> TSpline:
    """A surface with normal control points."""
    shape = (tmesh.n_anchors,) if dimension == 1 else (tmesh.n_anchors, dimension)
    return make_surface(spline_space(tmesh, **options), np.random.default_rng(seed).normal(size=shape))


def refined(rule=None, steps: int = 4, seed: int = 3):
    """A 3 × 2 lattice after a few random refinements."""
    generator, tmesh = np.random.default_rng(seed), b_lattice(3, 2)
    for _ in range(steps):
        tmesh = refine(tmesh, generator.random(tmesh.n_elements) < 0.3, rule).mesh
    return tmesh


POLYNOMIAL = refined()
RATIONAL = refined(Dyadic())
INSIDE = np.random.default_rng(1).uniform(0.01, 0.99, (40, 2))
BOTH = pytest.mark.parametrize("tmesh", [POLYNOMIAL, RATIONAL], ids=["polynomial", "rational"])
ORDERS = [(1, 0), (2, 0), (3, 0), (0, 1), (0, 2), (0, 3), (1, 1), (1, 2), (2, 1), (2, 3), (3, 3)]


def test_the_two_examples_are_of_both_kinds():
    """The meshes of this module are a polynomial and a truly rational one."""
    assert not random_surface(POLYNOMIAL).space.rational
    assert random_surface(RATIONAL).space.rational


@pytest.mark.parametrize("border", ["clamped", "open"])
@pytest.mark.parametrize(("columns", "rows"), [(1, 1), (3, 2), (6, 4)])
def test_lattices_equal_scipy(columns, rows, border):
    """A T-mesh without T-junctions is scipy's tensor-product B-spline, values and derivatives, up to the border."""
    tmesh = b_lattice(columns, rows, border=border)
    surface = random_surface(tmesh)
    steps = [np.arange(-3, count + 4) / count for count in (columns, rows)]
    knots = tuple(np.clip(step, 0, 1) if border == "clamped" else step for step in steps)
    column, row = (tmesh.anchors // tmesh.frame + 1).T
    coefficients = np.empty((columns + 3, rows + 3))
    coefficients[column, row] = np.asarray(surface.control_points)
    scipy_surface = NdBSpline(knots, coefficients, 3)
    ends = np.array([[s, t] for s in (0, 0.5, 1) for t in (0, 0.5, 1)])
    places = np.concatenate([INSIDE, ends])
    np.testing.assert_allclose(surface(places), scipy_surface(places), atol=1e-12)
    for order in ((1, 0), (1, 1), (2, 2)):
        expected = scipy_surface(places, nu=order)
        np.testing.assert_allclose(
            surface.derivative(places, order), expected, atol=1e-12 * (1 + np.abs(expected).max())
        )


@settings(max_examples=6)
@given(meshes(Dyadic(), most=60))
def test_surfaces_are_the_sum_of_the_definition(tmesh):
    """Σ b_i p_i / Σ b_i with blending functions from their local knots, on any dyadic mesh."""
    surface, basis = random_surface(tmesh), blending(tmesh, INSIDE)
    expected = basis @ np.asarray(surface.control_points) / basis.sum(axis=1)
    np.testing.assert_allclose(surface(INSIDE), expected, atol=1e-12)


@settings(max_examples=6)
@given(hand_given())
def test_hand_given_surfaces_are_the_sum_of_the_definition(tmesh):
    """The same on meshes given by hand, with T-junctions and uneven knots."""
    surface, basis = random_surface(tmesh), blending(tmesh, INSIDE)
    expected = basis @ np.asarray(surface.control_points) / basis.sum(axis=1)
    np.testing.assert_allclose(surface(INSIDE), expected, atol=1e-12)


@pytest.mark.parametrize("rectangles", [T_JUNCTIONS, PINWHEEL], ids=["T-junctions", "pinwheel"])
def test_a_hand_given_mesh(rectangles):
    """A T-mesh given by hand is built, checked with a reason, and evaluated rationally where its sum is not one."""
    tmesh = from_rectangles(rectangles)
    verdict = is_analysis_suitable(tmesh)
    surface = random_surface(tmesh, dimension=3)
    assert verdict.reason
    assert surface.space.rational == (not verdict)
    basis = blending(tmesh, INSIDE)
    expected = basis @ np.asarray(surface.control_points) / basis.sum(axis=1)[:, None]
    np.testing.assert_allclose(surface(INSIDE), expected, atol=1e-12)
    np.testing.assert_allclose(make_surface(surface.space, np.ones(tmesh.n_anchors))(INSIDE), 1, atol=1e-14)


@settings(max_examples=6)
@given(meshes(Dyadic()), parameters())
def test_constants_are_kept(tmesh, places):
    """The rational form reproduces a constant on any mesh, up to the border."""
    surface = make_surface(spline_space(tmesh), np.full(tmesh.n_anchors, 2.5))
    np.testing.assert_allclose(surface(places), 2.5, atol=1e-12)


@BOTH
@pytest.mark.parametrize("order", ORDERS)
def test_derivatives(tmesh, order):
    """Each derivative equals autodiff, and central differences, of the one below it: so all do, up to the third."""
    surface, h = random_surface(tmesh), 1e-5
    axis = 0 if order[0] else 1
    below = (order[0] - 1, order[1]) if axis == 0 else (order[0], order[1] - 1)
    step = h * np.eye(2)[axis]
    exact = np.asarray(surface.derivative(INSIDE, order))
    scale = np.abs(exact).max() + 1
    _, slope = jax.jvp(
        lambda p: surface.derivative(p, below), (jnp.asarray(INSIDE),), (jnp.tile(jnp.eye(2)[axis], (40, 1)),)
    )
    np.testing.assert_allclose(slope, exact, atol=1e-10 * scale)
    difference = (surface.derivative(INSIDE + step, below) - surface.derivative(INSIDE - step, below)) / (2 * h)
    # Third derivatives jump at knot lines: count where the whole stencil lies in one element.
    elements = [np.asarray(surface.space.locator(jnp.asarray(INSIDE + k * step))) for k in (-1, 1)]
    same = elements[0] == elements[1]
    assert same.sum() > 30
    np.testing.assert_allclose(np.asarray(difference)[same], exact[same], atol=2e-5 * scale)


@pytest.mark.parametrize("order", [(-1, 0), (4, 0), (1,), (0.5, 0), (1, 0, 0)])
def test_bad_orders(order):
    """Orders are two whole numbers from 0 to 3."""
    with pytest.raises(InputError, match="whole numbers from 0 to 3"):
        random_surface(POLYNOMIAL).derivative(INSIDE, order)


@pytest.mark.parametrize("dimension", [1, 3])
def test_transformations(dtype, tolerance_of, dimension):
    """jit and vmap give the eager values, in both precisions; a single parameter gives a scalar or a point."""
    surface = random_surface(POLYNOMIAL, dimension=dimension, dtype=dtype)
    eager = np.asarray(surface(INSIDE))
    assert eager.dtype == dtype
    assert eager.shape == ((40,) if dimension == 1 else (40, 3))
    places = jnp.asarray(INSIDE, dtype)
    close = partial(np.testing.assert_allclose, rtol=tolerance_of(dtype), atol=tolerance_of(dtype))
    close(jax.jit(lambda surface, p: surface(p))(surface, places), eager)
    close(jax.vmap(surface)(places), eager)
    close(jax.vmap(jax.vmap(surface))(places.reshape(8, 5, 2)).reshape(eager.shape), eager)
    close(surface(INSIDE[0]), eager[0])
    stack = jnp.stack([surface.control_points, 2 * surface.control_points])
    batch = jax.vmap(lambda points: make_surface(surface.space, points)(places))(stack)
    close(batch, np.stack([eager, 2 * eager]))


@pytest.mark.parametrize(
    ("tmesh", "dtype"), [(POLYNOMIAL, np.float64), (POLYNOMIAL, np.float32), (RATIONAL, np.float64)]
)
def test_gradients_with_respect_to_control_points(tmesh, dtype):
    """The gradient of a sum of squares in the control points equals finite differences, the Jacobian the basis."""
    surface = random_surface(tmesh, dtype=dtype)
    places = jnp.asarray(INSIDE, dtype)

    def heights(points: jax.Array) -> jax.Array:
        return make_surface(surface.space, points)(places)

    basis = blending(tmesh, INSIDE)
    exact = 1e-12 if dtype == np.float64 else 2e-5
    jacobian = jax.jacfwd(heights)(surface.control_points)
    np.testing.assert_allclose(jacobian, basis / basis.sum(axis=1, keepdims=True), atol=exact)
    gradient = jax.grad(lambda points: jnp.sum(heights(points) ** 2))(surface.control_points)
    expected = 2 * np.asarray(jacobian).T @ np.asarray(heights(surface.control_points))
    np.testing.assert_allclose(gradient, expected, atol=100 * exact)
    whole = eqx.filter_grad(lambda surface: jnp.sum(surface(places) ** 2))(surface)
    np.testing.assert_allclose(whole.control_points, gradient, atol=100 * exact)


@pytest.mark.parametrize(
    ("tmesh", "transform", "dtype"),
    [
        (POLYNOMIAL, jax.jacfwd, np.float64),
        (POLYNOMIAL, jax.jacrev, np.float32),
        (RATIONAL, jax.jacrev, np.float64),
    ],
)
def test_gradients_with_respect_to_parameters(tmesh, transform, dtype):
    """Forward and reverse differentiation in the parameters give the first derivatives, points in space included."""
    surface = random_surface(tmesh, dimension=3, dtype=dtype)
    exact = [np.asarray(surface.derivative(INSIDE, order)) for order in ((1, 0), (0, 1))]
    jacobian = jax.vmap(transform(surface))(jnp.asarray(INSIDE, dtype))
    scale = np.abs(exact).max() * (1e-12 if dtype == np.float64 else 1e-4)
    np.testing.assert_allclose(jacobian, np.stack(exact, axis=-1), atol=scale)


@BOTH
def test_padding_changes_nothing(tmesh):
    """A space of another capacity evaluates to the same heights."""
    small, large = random_surface(tmesh), random_surface(tmesh, capacity=4096)
    np.testing.assert_allclose(small(INSIDE), large(INSIDE), rtol=0, atol=1e-14)


def test_many_and_few_parameters():
    """Both ways to contract, all elements at once or those met only, agree."""
    surface = random_surface(POLYNOMIAL)
    places = np.tile(INSIDE, (20, 1))
    one_by_one = [float(surface(place)) for place in INSIDE[:5]]
    np.testing.assert_allclose(np.asarray(surface(places))[:5], one_by_one, atol=1e-14)


@pytest.mark.parametrize("bad", [[[1.1, 0.5]], [[0.5, -1e-9]], [[np.nan, 0.5]], [[0.5, np.inf]]])
def test_parameters_outside(bad):
    """Parameters beyond [0, 1]² and NaN are an error, eagerly and inside jit."""
    surface = random_surface(POLYNOMIAL)
    with pytest.raises(InputError, match=r"\[0, 1\]"):
        surface(np.array(bad))
    with pytest.raises(Exception, match=r"\[0, 1\]"):
        eqx.filter_jit(surface)(jnp.array(bad)).block_until_ready()


@pytest.mark.parametrize("shape", [(), (3,), (4, 3), (2, 2, 2)])
def test_parameters_of_wrong_shape(shape):
    """Parameters are rows of two, eagerly and inside jit."""
    surface = random_surface(POLYNOMIAL)
    with pytest.raises(InputError, match="shape"):
        surface(np.full(shape, 0.5))
    with pytest.raises(InputError, match="shape"):
        jax.jit(lambda places: surface(places))(np.full(shape, 0.5))


@pytest.mark.parametrize("count", [0, 10, 12])
def test_wrong_number_of_control_points(count):
    """A space takes one control point a blending function."""
    with pytest.raises(InputError, match="blending functions"):
        make_surface(spline_space(b_lattice(1, 1)), np.zeros(count))


def test_places_in_the_plane():
    """`at` evaluates where the frame says, in any shape; beyond the domain it is NaN, or the border's if asked for."""
    tmesh = refined()
    frame = Frame((10.0, -3.0), (6.0, 2.0), "mm")
    surface = make_surface(spline_space(tmesh), random_surface(tmesh).control_points, frame)
    x, y = 10 + 6 * INSIDE[:, 0], -3 + 2 * INSIDE[:, 1]
    np.testing.assert_allclose(surface.at(x, y), surface(INSIDE), atol=1e-12)
    assert surface.at(x.reshape(5, 8), y.reshape(5, 8)).shape == (5, 8)
    assert surface.at(12.0, np.array([-2.5, -2.0])).shape == (2,)
    assert surface.at(12.0, -2.0).shape == ()
    beyond = surface.at(np.array([9.9, 16.1, 12.0, 12.0, np.nan]), np.array([-2.0, -2.0, -3.1, -0.9, -2.0]))
    assert np.isnan(beyond).all()
    held = surface.at(np.array([9.0, 99.0]), np.array([-2.0, -9.0]), extrapolate=True)
    np.testing.assert_allclose(held, surface(np.array([[0, 0.5], [1, 0]])), atol=1e-12)
    assert surface.frame == frame


@given(st.floats(-1e6, 1e6), st.floats(1e-6, 1e6))
def test_border_places_are_inside(origin, extent):
    """Round-off of the frame pushes no border sample outside, however far away the origin is, in both precisions."""
    near, far = origin, origin + extent
    for space in FLAT:
        surface = make_surface(space, np.ones(16), Frame((origin, origin), (extent, extent)))
        assert np.isfinite(surface.at(np.array([near, far, near, far]), np.array([near, near, far, far]))).all()


FLAT = [spline_space(b_lattice(1, 1), dtype=name) for name in ("float32", "float64")]


def test_points_in_space_have_no_unique_places():
    """`at` is for height maps: a surface in space is refused."""
    with pytest.raises(InputError, match="points in space"):
        random_surface(POLYNOMIAL, dimension=3).at(0.5, 0.5)


@pytest.mark.parametrize("order", [(0, 0), (1, 0), (1, 1)])
def test_deepest_meshes_are_evaluated(order):
    """Thirty bisections at one point change nothing of a plane: s + 2 t, its slopes and its twist."""
    tmesh = b_lattice(1, 1)
    for _ in range(30):
        tmesh = refine(tmesh, marks_at_points(tmesh, np.array([[0.3, 0.7]]))).mesh
    greville = [tmesh.parameters(axis, tmesh.local_knots[:, axis, 1:4]).mean(axis=1) for axis in range(2)]
    plane = make_surface(spline_space(tmesh), greville[0] + 2 * greville[1])
    near = np.array([0.3, 0.7]) + 2.0 ** -np.arange(2, 20)[:, None] * np.array([0.3, -0.2])
    expected = {(0, 0): near[:, 0] + 2 * near[:, 1], (1, 0): np.ones(18), (1, 1): np.zeros(18)}[order]
    scale = 2.0 ** (15 * sum(order))
    np.testing.assert_allclose(plane.derivative(near, order), expected, atol=1e-14 * scale)


def test_evaluation_compiles_once():
    """Surfaces with as many control points share a compiled kernel, whatever their lattice and its refinement."""
    traces = 0

    def counted(surface: TSpline, places: jax.Array) -> jax.Array:
        nonlocal traces
        traces += 1
        return surface(places)

    kernel = eqx.filter_jit(counted)
    for tmesh in (b_lattice(2, 6), b_lattice(6, 2)):
        kernel(random_surface(tmesh), jnp.asarray(INSIDE))
    assert traces == 1


def test_readable():
    """A surface says what it is."""
    text = repr(random_surface(RATIONAL, dimension=3))
    assert "points in space" in text
    assert "rational" in text
