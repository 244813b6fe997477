"""Derivatives through the converged joint fit agree with finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.mesh import b_lattice, refine
from tsplinejax.orthogonal import fit_points
from tsplinejax.space import spline_space

from .problems import saddle

GENERATOR = np.random.default_rng(0)
SPACE = spline_space(refine(b_lattice(2, 2), np.arange(4) == 1).mesh)
POINTS = jnp.asarray(saddle(300, noise=0.05))
PARAMETERS = np.clip(np.asarray(POINTS[:, :2]) / 2.2 + 0.5, 0, 1)
START = tsj.lstsq(SPACE, PARAMETERS, POINTS)
WEIGHTS = GENERATOR.uniform(0.5, 1.5, 300)


def fitted(points: jax.Array) -> tuple[tsj.TSpline, jax.Array]:
    """The form, and the parameters of the feet."""
    control_points, parameters = fit_points(
        SPACE, points, START, PARAMETERS, weights=WEIGHTS, method=tsj.Joint(slip=1.0), smoothing=1e-3
    )
    return tsj.make_surface(SPACE, control_points), parameters


def texture_sq(points: jax.Array) -> jax.Array:
    """Sq of the distances along the normals."""
    form, parameters = fitted(points)
    distances = jnp.sum((points - form(parameters)) * tsj.normals(form, parameters), axis=1)
    return jnp.sqrt(jnp.mean(distances**2))


def form_somewhere(points: jax.Array) -> jax.Array:
    """A linear functional of the form."""
    return jnp.sum(fitted(points)[0](np.array([[0.3, 0.7], [0.8, 0.2]])) * np.array([[1.0, -2, 3], [0.5, 1, 2]]))


@pytest.mark.parametrize("functional", [texture_sq, form_somewhere])
def test_gradients_against_finite_differences(functional):
    """Gradients of the texture's Sq and of the form with respect to all points, to 1e-6 in random directions."""
    gradient = jax.grad(functional)(POINTS)
    for _ in range(2):
        direction = GENERATOR.normal(size=POINTS.shape)
        difference = (functional(POINTS + 1e-5 * direction) - functional(POINTS - 1e-5 * direction)) / 2e-5
        assert abs(jnp.vdot(gradient, direction) - difference) < 1e-5 * abs(difference)


def test_a_free_fit_has_no_derivative():
    """Without held slip, with wrong shapes and under `jit`, the reason is given."""
    with pytest.raises(tsj.InputError, match="slip"):
        fit_points(SPACE, POINTS, START, PARAMETERS, method=tsj.Joint(slip=0.0))
    with pytest.raises(tsj.InputError, match="received"):
        fit_points(SPACE, POINTS[:7], START, PARAMETERS)
    with pytest.raises(tsj.InputError, match="without jit"):
        jax.jit(texture_sq)(POINTS)
