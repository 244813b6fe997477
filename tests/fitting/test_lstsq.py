"""Least squares on a fixed space: numpy's answer, its derivatives in every argument, batches, and clear refusals."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tsplinejax import InputError, lstsq
from tsplinejax.mesh import Dyadic, b_lattice
from tsplinejax.space import spline_space
from tsplinejax.surface import make_surface

from ..blending import blending
from .problems import EXTENT, bending_matrix, refined

GENERATOR = np.random.default_rng(0)
PLACES = GENERATOR.uniform(0.01, 0.99, (600, 2))
VALUES = np.sin(5 * PLACES[:, 0]) + PLACES[:, 1] ** 2
WEIGHTS = GENERATOR.uniform(0.2, 2, 600)
QUERY = jnp.asarray(np.random.default_rng(1).uniform(0.01, 0.99, (40, 2)))
MESHES = {"polynomial": refined(lattice=(2, 2), steps=2), "rational": refined(Dyadic())}
KINDS = pytest.mark.parametrize("kind", MESHES)


def basis_of(tmesh) -> np.ndarray:
    """Blending functions at the samples, divided by their sum."""
    basis = blending(tmesh, PLACES)
    return basis / basis.sum(axis=1, keepdims=True)


@KINDS
def test_against_numpy(kind):
    """The fitted values are those of numpy's dense least squares, weighted, for one and for three sets of values."""
    tmesh, root = MESHES[kind], np.sqrt(WEIGHTS)[:, None]
    basis, space = basis_of(tmesh), spline_space(tmesh)
    assert space.rational == (kind == "rational")
    values = np.stack([VALUES, VALUES**2, PLACES[:, 0]], axis=1)
    expected = basis @ np.linalg.lstsq(root * basis, root * values, rcond=None)[0]
    np.testing.assert_allclose(basis @ np.asarray(lstsq(space, PLACES, values, WEIGHTS)), expected, atol=1e-9)
    np.testing.assert_allclose(basis @ np.asarray(lstsq(space, PLACES, VALUES, WEIGHTS)), expected[:, 0], atol=1e-9)


def test_smoothed_against_dense():
    """With smoothing it solves (BᵀWB + λK) p = BᵀWv, lengths from the extent's ratio alone."""
    tmesh = MESHES["polynomial"]
    basis, bending = basis_of(tmesh), bending_matrix(tmesh)
    matrix = basis.T @ (WEIGHTS[:, None] * basis) + 0.3 * bending
    expected = np.linalg.solve(matrix, basis.T @ (WEIGHTS * VALUES))
    for extent in (EXTENT, 1000 * EXTENT):
        found = lstsq(spline_space(tmesh), PLACES, VALUES, WEIGHTS, smoothing=0.3, extent=tuple(extent))
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_fewer_samples_than_control_points_when_smoothed():
    """Smoothing makes few samples enough: ten points give a finite, nearly interpolating surface."""
    space = spline_space(b_lattice(4, 4))
    points = lstsq(space, PLACES[:10], VALUES[:10], smoothing=1e-9)
    np.testing.assert_allclose(make_surface(space, points)(PLACES[:10]), VALUES[:10], atol=1e-3)


def test_single_precision():
    """A float32 space gives a float32 answer near the float64 one."""
    tmesh = MESHES["polynomial"]
    single = lstsq(spline_space(tmesh, dtype="float32"), PLACES, VALUES)
    assert single.dtype == np.float32
    double = np.asarray(lstsq(spline_space(tmesh), PLACES, VALUES))
    np.testing.assert_allclose(basis_of(tmesh) @ np.asarray(single), basis_of(tmesh) @ double, atol=1e-4)


def scalar(space, places, values, weights, smoothing) -> jax.Array:
    """Sum of squares of the fitted surface at fixed places: what the gradients are taken of."""
    return jnp.sum(make_surface(space, lstsq(space, places, values, weights, smoothing=smoothing))(QUERY) ** 2)


@KINDS
@pytest.mark.parametrize("argument", ["parameters", "values", "weights", "smoothing"])
def test_gradients_against_finite_differences(kind, argument):
    """The implicit derivative in each argument equals the central difference along a random direction to 1e-5."""
    function = partial(scalar, spline_space(MESHES[kind]))
    arguments = [PLACES, VALUES, WEIGHTS, np.asarray(1e-2)]
    k = ["parameters", "values", "weights", "smoothing"].index(argument)
    direction = np.asarray(np.random.default_rng(k).normal(size=arguments[k].shape))
    gradient = jax.grad(function, k)(*map(jnp.asarray, arguments))
    h = 3e-5

    def shifted(step: float) -> float:
        moved = list(arguments)
        moved[k] = arguments[k] + step * direction
        return float(function(*map(jnp.asarray, moved)))

    difference = (shifted(h) - shifted(-h)) / (2 * h)
    assert float(np.sum(np.asarray(gradient) * direction)) == pytest.approx(difference, rel=1e-5)


def test_forward_and_reverse_agree():
    """jacfwd and jacrev of the control points with respect to the values agree, and are the pseudo-inverse."""
    tmesh = MESHES["polynomial"]
    space, function = spline_space(tmesh), lambda values: lstsq(spline_space(tmesh), PLACES, values, WEIGHTS)
    direction = np.random.default_rng(3).normal(size=600)
    _, forward = jax.jvp(function, (jnp.asarray(VALUES),), (jnp.asarray(direction),))
    np.testing.assert_allclose(forward, lstsq(space, PLACES, direction, WEIGHTS), atol=1e-7)
    cotangent = np.random.default_rng(4).normal(size=tmesh.n_anchors)
    (reverse,) = jax.vjp(function, jnp.asarray(VALUES))[1](jnp.asarray(cotangent))
    assert float(np.dot(reverse, direction)) == pytest.approx(float(np.dot(cotangent, forward)), rel=1e-7)


def test_a_batch_equals_the_loop():
    """jit(vmap) over 64 sets of values gives what 64 calls give."""
    space = spline_space(MESHES["polynomial"])
    batch = np.random.default_rng(2).normal(size=(64, 600))
    together = jax.jit(jax.vmap(lambda values: lstsq(space, PLACES, values, WEIGHTS)))(batch)
    one_by_one = np.stack([lstsq(space, PLACES, values, WEIGHTS) for values in batch])
    np.testing.assert_allclose(together, one_by_one, atol=1e-9)
    as_columns = lstsq(space, PLACES, batch.T, WEIGHTS)
    np.testing.assert_allclose(as_columns.T, one_by_one, atol=1e-9)


def test_chunks_change_nothing():
    """More samples than one chunk holds give the answer of the normal equations over all of them."""
    space = spline_space(b_lattice(1, 1))
    places = np.random.default_rng(5).uniform(0.01, 0.99, (40_000, 2))
    values = np.cos(7 * places[:, 0] * places[:, 1])
    basis = blending(b_lattice(1, 1), places)
    expected = np.linalg.solve(basis.T @ basis, basis.T @ values)
    np.testing.assert_allclose(lstsq(space, places, values), expected, atol=1e-8)


def test_padding_changes_nothing():
    """A space of larger capacity gives the same control points."""
    tmesh = MESHES["polynomial"]
    first, second = (lstsq(spline_space(tmesh, capacity=c), PLACES, VALUES) for c in (256, 1024))
    np.testing.assert_allclose(first, second, atol=1e-9)


BAD = {
    "fewer samples than control points": ((PLACES[:10], VALUES[:10]), {}, "at least as many samples"),
    "the same with an array for λ": (
        (PLACES[:10], VALUES[:10]),
        {"smoothing": jnp.zeros(())},
        "at least as many samples",
    ),
    "no samples": ((np.zeros((0, 2)), np.zeros(0)), {}, "at least as many samples"),
    "lengths that differ": ((PLACES, VALUES[:-1]), {}, "lstsq takes"),
    "weights of another length": ((PLACES, VALUES, WEIGHTS[:5]), {}, "lstsq takes"),
    "values in three dimensions": ((PLACES, VALUES.reshape(600, 1, 1)), {}, "lstsq takes"),
    "a single parameter": ((PLACES[0], VALUES[:1]), {}, "lstsq takes"),
    "parameters outside": ((PLACES + 0.5, VALUES), {}, r"\[0, 1\]"),
    "NaN values": ((PLACES, np.where(VALUES > 0.5, np.nan, VALUES)), {}, "finite"),
    "infinite values": ((PLACES, np.where(VALUES > 0.5, np.inf, VALUES)), {}, "finite"),
    "negative weights": ((PLACES, VALUES, -WEIGHTS), {}, "not negative"),
    "NaN weights": ((PLACES, VALUES, WEIGHTS * np.nan), {}, "not negative"),
    "negative smoothing": ((PLACES, VALUES), {"smoothing": -1.0}, "at least zero"),
    "NaN smoothing": ((PLACES, VALUES), {"smoothing": np.nan}, "at least zero"),
    "text": ((PLACES, np.array(["a"] * 600)), {}, "real numbers"),
    "complex values": ((PLACES, VALUES + 1j), {}, "real numbers"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name):
    """Each misuse is refused with the rule that it breaks."""
    arguments, options, message = BAD[name]
    with pytest.raises(InputError, match=message):
        lstsq(spline_space(b_lattice(2, 2)), *arguments, **options)


def test_weights_that_leave_functions_unseen():
    """Control points that no weighted sample sees come out finite, and the others are not disturbed."""
    weights = (PLACES[:, 0] < 0.4).astype(float)
    space = spline_space(b_lattice(4, 4))
    points = lstsq(space, PLACES, VALUES, weights)
    assert np.isfinite(points).all()
    seen = weights > 0
    fitted = np.asarray(make_surface(space, points)(PLACES[seen]))
    basis = blending(b_lattice(4, 4), PLACES[seen])
    expected = basis @ np.linalg.lstsq(basis, VALUES[seen], rcond=None)[0]
    np.testing.assert_allclose(fitted, expected, atol=1e-6)
