"""Sampling measured data: which pixels and points are taken, and that units and places fit the model."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.data import freeform_artefact, saddle_with_texture
from tsplinejax.mesh import is_analysis_suitable
from tsplinejax.sampling._measured import nearest

from .surfaces import random_model, structured


def test_pixels_of_a_map_are_taken_as_they_are():
    """Values and places are those of the pixels that `index` names, near the places that the model wants."""
    data, model = structured()
    samples = tsj.sample(data, model=model, size=900)
    assert len(np.unique(samples.index)) == 900
    np.testing.assert_array_equal(samples.values[:, 0], data.heights.ravel()[samples.index])
    row, column = np.divmod(samples.index, data.shape[1])
    np.testing.assert_allclose(samples.parameters, np.stack([column / 127, row / 127], axis=1), atol=1e-12)
    np.testing.assert_array_equal(samples.samples.grid_index, samples.index)
    wanted = tsj.sample(model, size=900).parameters
    apart = np.abs(wanted[:, None] - samples.parameters[None]).max(axis=2).min(axis=1)
    assert np.quantile(apart, 0.8) < 1 / 127


def test_missing_pixels_are_never_taken():
    """A map with a hole gives as many samples, all of them valid."""
    data, model = structured()
    holed = data.with_mask(np.hypot(*np.mgrid[-64:64, -64:64]) < 30)
    samples = tsj.sample(holed, model=model, size=1500)
    assert np.isfinite(samples.values).all()
    assert holed.valid.ravel()[samples.index].all()


def test_a_model_of_part_of_the_map_takes_pixels_of_that_part():
    """Places are the model's own, pixels elsewhere are left alone."""
    data, _ = structured()
    part = data.crop(20, 0, 50, 30)
    model = tsj.fit(part, relative_tolerance=0.05).surface
    samples = tsj.sample(data, model=model, size=400)
    xy = model.frame.xy_of(samples.parameters)
    assert samples.samples.frame == model.frame
    row, column = np.divmod(samples.index, data.shape[1])
    np.testing.assert_allclose(xy, np.stack([10 + 0.5 * column, -5 + 0.4 * row], axis=1), atol=1e-9)
    assert (xy.min(axis=0) >= (20, 0)).all()
    beyond = data.valid.sum() - part.valid.sum()
    assert samples.warnings == (f"{beyond} samples of the data lie beyond the model and are left out",)
    assert not tsj.sample(part, model=model, size=400).warnings


def test_data_come_into_the_unit_of_the_model():
    """A map in nanometres and the model in micrometres; without a unit it is refused."""
    data, model = structured()
    samples = tsj.sample(data.to_unit("nm"), model=model, size=700)
    same = tsj.sample(data, model=model, size=700)
    np.testing.assert_array_equal(samples.index, same.index)
    np.testing.assert_allclose(samples.values, same.values, rtol=1e-12)
    with pytest.raises(tsj.InputError, match="model is in µm, but the data have no unit"):
        tsj.sample(data.heights, model=model)


def test_without_a_model_one_is_fitted():
    """Plain arrays are enough to begin with."""
    y, x = np.mgrid[0:40, 0:50] / 40
    samples = tsj.sample(np.sin(3 * x) * np.cos(2 * y))
    assert len(samples) == samples.model.control_points.shape[0]
    surface = tsj.reconstruct(samples).surface
    assert (
        np.abs(np.asarray(surface.at(50 / 2 * np.ones(1), 20 * np.ones(1))) - np.sin(75 / 40) * np.cos(1)).max() < 0.01
    )


def test_a_cloud_is_sampled_as_heights_or_as_points_in_space():
    """Planar parameters of heights, conformal ones of points; `index` names the points."""
    cloud = saddle_with_texture((24, 24), roughness=0.0)
    heights = tsj.sample(cloud, size=100)
    assert heights.values.shape == (100, 1)
    np.testing.assert_array_equal(heights.values[:, 0], cloud.points[heights.index, 2])
    place = tsj.conformal(cloud)
    for parameters in ("conformal", place, place.parameters):
        samples = tsj.sample(cloud, size=300, parameters=parameters)
        np.testing.assert_array_equal(samples.values, cloud.points[samples.index])
        np.testing.assert_array_equal(samples.parameters, place.parameters[samples.index])
    recovered, fitted = (
        np.linalg.norm(np.asarray(surface(place.parameters)) - cloud.points)
        for surface in (tsj.reconstruct(samples).surface, samples.model)
    )
    assert recovered < 2 * fitted


def test_single_precision_stays():
    """float32 in, float32 out."""
    data, _ = structured()
    single = tsj.HeightMap(data.heights.astype(np.float32), data.spacing, data.unit)
    samples = tsj.sample(single, size=300)
    assert samples.values.dtype == np.float32
    assert tsj.reconstruct(samples).surface.control_points.dtype == np.float32


def test_nearest_gives_each_place_a_candidate_of_its_own():
    """Where every place wants the same candidate the others get the next ones; distances are physical."""
    candidates = np.column_stack([np.linspace(0, 1, 50), np.full(50, 0.5)])
    taken = nearest(candidates, np.full((20, 2), 0.5), (1.0, 1.0))
    assert len(set(taken)) == 20
    assert set(taken) <= set(range(10, 40))
    tall = np.array([[0.5, 0.5 + 0.2], [0.5 + 0.3, 0.5]])
    assert nearest(tall, np.array([[0.5, 0.5]]), (1.0, 1.0)).tolist() == [0]
    assert nearest(tall, np.array([[0.5, 0.5]]), (1.0, 10.0)).tolist() == [1]


def test_adaptive_sampling_of_data_keeps_what_is_missed_most():
    """Fewer samples than control points: better than the same number at Greville points or at random."""
    data, model = structured()
    size = round(0.7 * model.control_points.shape[0])
    errors = {
        name: tsj.sampling_study(data, [name], [size], model=model).rms_errors[0, 0]
        for name in ("adaptive", "greville", "random")
    }
    assert errors["adaptive"] < errors["greville"] < errors["random"]


def _grooved() -> tsj.HeightMap:
    """A ring's steep wall and a few grooves two pixels wide, which a model to 5 % does not have."""
    y, x = np.mgrid[0:64, 0:64] / 63
    groove = np.exp(-(((x + 0.3 * y - 0.6) / 0.02) ** 2)) + np.exp(-(((y - 0.8) / 0.02) ** 2))
    return tsj.HeightMap(np.tanh(20 * (np.hypot(x - 0.4, y - 0.5) - 0.25)) - 0.1 * groove, 1 / 63)


def test_adaptive_sampling_of_data_brings_room_for_its_samples():
    """The T-mesh is refined until the surface meets every sample; the given model stays in its space."""
    data = _grooved()
    model = tsj.fit(data, relative_tolerance=0.05).surface
    size = round(1.2 * model.control_points.shape[0])
    samples = tsj.sample(data, model=model, strategy="adaptive", size=size)
    assert len(np.unique(samples.index)) == size
    assert is_analysis_suitable(samples.model.space.mesh)
    places = np.random.default_rng(0).random((2000, 2))
    np.testing.assert_allclose(samples.model(places), model(places), atol=1e-10)
    recovered = tsj.reconstruct(samples)
    assert recovered.max_error < 1e-3 * data.range
    assert recovered.warnings == ()  # more functions than samples is what the strategy plans
    assert tsj.reconstruct((samples.parameters, samples.values), samples.model).warnings


def test_adaptive_sampling_of_data_follows_detail_that_the_model_lacks():
    """From two samples a control point two thirds of the error of any strategy that does not look at the heights."""
    data = _grooved()
    model = tsj.fit(data, relative_tolerance=0.05).surface
    others = ["greville", "greville-refined", "element-area", "curvature", "uniform"]
    study = tsj.sampling_study(data, ["adaptive", *others], [2 * model.control_points.shape[0]], model=model)
    errors = study.rms_errors[:, 0]
    assert errors[0] < errors[1:].min() * 2 / 3


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda data, model: tsj.sample(model, model=model), "leave model= out"),
        (lambda data, model: tsj.sample(data, model="nominal"), "received str"),
        (lambda data, model: tsj.sample(data, model=model, size=10**6), "only 16384 were measured"),
        (lambda data, model: tsj.sample(data, model=model, parameters="conformal"), "its own x and y"),
        (lambda data, model: tsj.sample(data, model=random_model(3)), "unit|components"),
        (lambda data, model: tsj.sample(freeform_artefact(600), parameters="spherical"), "'planar', 'conformal'"),
        (
            lambda data, model: tsj.sample(tsj.HeightMap(data.heights, 0.5, "µm", origin=(900, 900)), model=model),
            "no sample lies on the model",
        ),
    ],
)
def test_misuse_is_refused(call, message):
    """The rule, what was received, the remedy."""
    with pytest.raises(tsj.InputError, match=message):
        call(*structured())


def test_the_account_is_readable():
    """How many, by what, how many a control point."""
    _, model = structured()
    samples = tsj.sample(model, strategy="halton", size=500)
    assert "500 samples by Halton()" in repr(samples)
    assert "unit µm" in repr(samples)
    assert "500 samples" in repr(tsj.reconstruct(samples))
