"""Greville sampling: one sample a control point recovers a T-spline exactly; further ones lower the noise."""

import numpy as np
import pytest
from hypothesis import given, settings

import tsplinejax as tsj
from tsplinejax.mesh import is_analysis_suitable
from tsplinejax.sampling import Greville

from ..random_meshes import meshes
from .surfaces import measured, random_model, structured


@pytest.mark.parametrize("dimension", [1, 3])
def test_a_t_spline_comes_back_from_as_many_samples_as_control_points(dimension, dtype, tolerance_of):
    """Heights and points in space, in both precisions, without smoothing."""
    model = random_model(dimension, str(dtype))
    samples = tsj.sample(model)
    assert len(samples) == model.control_points.shape[0]
    result = tsj.reconstruct(samples)
    assert result.smoothing == 0
    assert not result.warnings
    scale = float(np.abs(model.control_points).max())
    np.testing.assert_allclose(
        result.surface.control_points, model.control_points, atol=100 * tolerance_of(dtype, scale)
    )


@settings(max_examples=40)
@given(meshes(most=120))
def test_so_it_does_on_any_analysis_suitable_mesh(tmesh):
    """Random refinements, lattices and first cuts; with an open border Greville points can leave the square."""
    space = tsj.spline_space(tmesh)
    points = np.random.default_rng(0).normal(size=int(space.n_functions))
    model = tsj.make_surface(space, points)
    result = tsj.reconstruct(tsj.sample(model))
    places = np.random.default_rng(1).random((300, 2))
    if tmesh.border == "clamped":
        assert result.smoothing == 0
        np.testing.assert_allclose(result.surface(places), model(places), atol=1e-9)
    else:
        assert np.isfinite(np.asarray(result.surface(places))).all()


def test_a_large_offset_and_a_small_unit_lose_nothing():
    """Heights of nanometres in metres, a metre above zero, come back to the last digits there are."""
    model = random_model(frame=tsj.Frame((0.0, 0.0), (1e-5, 2e-5), "m"))
    moved = tsj.make_surface(model.space, 1.0 + 1e-9 * model.control_points, model.frame)
    result = tsj.reconstruct(tsj.sample(moved))
    np.testing.assert_allclose(result.surface.control_points, moved.control_points, atol=1e-14)


def test_more_samples_let_less_noise_through():
    """The gain falls from n to 2 n to 4 n samples, and stays below that of random ones in each element."""
    model = random_model()
    n = model.control_points.shape[0]
    gains = [tsj.reconstruct(tsj.sample(model, size=size)).noise_gain for size in (n, 2 * n, 4 * n)]
    assert gains[0] > gains[1] > gains[2]
    random = tsj.reconstruct(tsj.sample(model, strategy="t-patch-random", size=4 * n), smoothing=0).noise_gain
    assert gains[2] < 0.7 * random


def test_the_noise_gain_is_what_noise_does():
    """Predicted and measured over forty noisy sample sets."""
    model = random_model()
    samples = tsj.sample(model, size=300)
    gain = tsj.reconstruct(samples).noise_gain
    rng = np.random.default_rng(5)
    places = rng.random((2000, 2))
    errors = []
    for _ in range(40):
        noisy = samples.values[:, 0] + rng.normal(size=len(samples))
        surface = tsj.reconstruct((samples.parameters, noisy), model).surface
        errors.append(np.mean((np.asarray(surface(places)) - np.asarray(model(places))) ** 2))
    assert gain == pytest.approx(np.sqrt(np.mean(errors)), rel=0.2)


def test_centres_come_after_greville_points():
    """The natural size counts the elements, and the first n places are the Greville points."""
    model = random_model()
    n, elements = model.control_points.shape[0], model.space.mesh.n_elements
    samples = tsj.sample(model, strategy=Greville(centres=True))
    assert len(samples) == n + elements
    np.testing.assert_array_equal(samples.parameters[:n], tsj.sample(model).parameters)
    boxes = model.space.mesh.element_boxes
    np.testing.assert_allclose(samples.parameters[n:], (boxes[:, :2] + boxes[:, 2:]) / 2)


def test_a_refined_space_holds_the_surface_and_follows_the_measured_one_more_closely():
    """From twice the samples the model still comes back, and a surface beyond its space to a third of the error."""
    _, model = structured()
    n = model.control_points.shape[0]
    exact = tsj.sample(model, strategy="greville-refined", size=2 * n)
    assert 1.5 * n < exact.model.control_points.shape[0] <= 2 * n == len(exact)
    assert is_analysis_suitable(exact.model.space.mesh)
    places = np.random.default_rng(0).random((3000, 2))
    np.testing.assert_allclose(exact.model(places), model(places), atol=1e-12)
    np.testing.assert_allclose(tsj.reconstruct(exact).surface(places), model(places), atol=1e-9)

    def error(strategy):
        samples = tsj.sample(model, strategy=strategy, size=2 * n)
        surface = tsj.reconstruct((samples.parameters, measured(samples.parameters)), samples.model).surface
        return np.sqrt(np.mean((np.asarray(surface(places)) - measured(places)) ** 2))

    usual = ("element-area", "element-curvature", "curvature", "halton", "uniform")
    assert error("greville-refined") < min(error("greville"), *map(error, usual)) / 3
