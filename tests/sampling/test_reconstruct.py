"""Reconstruction: plain least squares where the samples are enough, smoothing where they are not, and misuse."""

import numpy as np
import pytest

import tsplinejax as tsj

from .surfaces import random_model, refined_mesh, structured


def test_it_is_least_squares_with_the_bending_energy():
    """For a given λ the control points are those of `lstsq`, which solves by other means."""
    model = random_model()
    rng = np.random.default_rng(2)
    places, values = rng.random((600, 2)), rng.normal(size=(600, 3))
    surface = tsj.make_surface(model.space, np.zeros((model.control_points.shape[0], 3)), model.frame)
    result = tsj.reconstruct((places, values), surface, smoothing=1e-4)
    expected = tsj.lstsq(model.space, places, values, smoothing=1e-4, extent=model.frame.extent)
    np.testing.assert_allclose(result.surface.control_points, expected, atol=1e-7)
    errors = np.linalg.norm(np.asarray(result.surface(places)) - values, axis=1)
    assert result.rms_error == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert result.max_error == pytest.approx(errors.max())


def test_samples_that_determine_the_surface_are_not_smoothed():
    """Twice as many as control points, noisy: plain least squares."""
    model = random_model()
    samples = tsj.sample(model, size=300)
    noisy = samples.values[:, 0] + np.random.default_rng(0).normal(size=len(samples))
    assert tsj.reconstruct((samples.parameters, noisy), model).smoothing == 0


def test_too_few_samples_are_smoothed_and_it_is_said():
    """Half as many as control points: a finite surface, a λ above zero, a warning with both numbers."""
    data, model = structured()
    n = model.control_points.shape[0]
    result = tsj.reconstruct(tsj.sample(model, size=n // 2))
    assert result.smoothing > 0
    assert f"{n // 2} samples are too few to determine {n} control points" in result.warnings[0]
    places = np.random.default_rng(0).random((500, 2))
    assert np.abs(np.asarray(result.surface(places)) - np.asarray(model(places))).max() < data.range


def test_fewer_samples_than_control_points_are_met_where_that_is_well_posed():
    """Half of the pixels' worth of a wave over a lattice as fine as the grid: a trace of smoothing, no averaging."""
    places = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, 20)]), axis=-1).reshape(-1, 2)[::2]
    wave = np.sin(9 * places[:, 0]) * np.cos(7 * places[:, 1])
    result = tsj.reconstruct((places, wave), tsj.spline_space(tsj.b_lattice(20, 20)))
    assert 0 < result.smoothing < 1e-6
    assert result.noise_gain < 3
    assert result.max_error < 1e-3


def test_automatic_smoothing_is_near_the_best_there_is():
    """Noisy random samples: the error with the λ of least GCV is within a third of the least over all λ."""
    data, model = structured()
    rng = np.random.default_rng(4)
    places = rng.random((1500, 2))
    values = np.asarray(model(places)) + 0.02 * data.range * rng.normal(size=1500)
    judged = rng.random((4000, 2))

    def error(smoothing):
        surface = tsj.reconstruct((places, values), model, smoothing=smoothing).surface
        return np.sqrt(np.mean((np.asarray(surface(judged)) - np.asarray(model(judged))) ** 2))

    assert error("auto") < 1.33 * min(error(10.0**exponent) for exponent in np.arange(-10, 0, 0.5))


def test_a_function_that_no_sample_sees_is_not_called_determined():
    """More samples than control points, but none in one corner."""
    model = random_model()
    samples = tsj.sample(model, size=500)
    away = (samples.parameters > 0.45).any(axis=1)
    assert away.sum() > model.control_points.shape[0]
    pair = (samples.parameters[away], samples.values[away])
    assert tsj.reconstruct(pair, model).smoothing > 0
    with pytest.raises(tsj.InputError, match="do not determine"):
        tsj.reconstruct(pair, model, smoothing=0)


def test_a_bare_space_is_enough():
    """The frame comes from the samples; a pair has the unit square."""
    space = tsj.spline_space(refined_mesh())
    n = int(space.n_functions)
    model = tsj.make_surface(space, np.random.default_rng(0).normal(size=n), tsj.Frame((1.0, 2.0), (3.0, 4.0), "mm"))
    samples = tsj.sample(model)
    assert tsj.reconstruct(samples.samples, space).surface.frame == model.frame
    bare = tsj.reconstruct((samples.parameters, samples.values), space).surface
    assert bare.frame == tsj.Frame()
    np.testing.assert_allclose(bare.control_points, model.control_points, atol=1e-9)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda model: tsj.reconstruct(3.0, model), "received float"),
        (lambda model: tsj.reconstruct((np.zeros((9, 2)), np.zeros(9))), "received NoneType"),
        (lambda model: tsj.reconstruct((np.zeros((9, 2)), np.zeros((9, 2))), model), "received dimension 2"),
        (lambda model: tsj.reconstruct((np.full((9, 2), 2.0), np.zeros(9)), model), "in \\[0, 1\\]"),
        (lambda model: tsj.reconstruct((np.zeros((9, 2)), np.full(9, np.nan)), model), "finite"),
        (lambda model: tsj.reconstruct(tsj.sample(model), smoothing=-1.0), "at least zero"),
        (lambda model: tsj.reconstruct(tsj.sample(model), smoothing="none"), "'auto' or a number"),
        (lambda model: tsj.reconstruct(tsj.sample(model, size=20), smoothing=0), "20 samples do not determine"),
        (
            lambda model: tsj.reconstruct(tsj.Samples([[0.1, 0.2], [0.5, 0.5]], [1.0, 2.0], [1.0, 2.0]), model),
            "weigh the same",
        ),
        (lambda model: tsj.reconstruct((np.linspace(0, 1, 40)[:, None] * [1, 1], np.ones(40)), model), "one line"),
    ],
)
def test_misuse_is_refused(call, message):
    """The rule, what was received, the remedy."""
    with pytest.raises(tsj.InputError, match=message):
        call(random_model())
