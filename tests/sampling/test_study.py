"""The study: errors by strategy and size are those of sampling and reconstructing by hand; what the paper claims."""

import numpy as np
import pytest

import tsplinejax as tsj

from .surfaces import structured


def test_errors_are_those_of_the_steps_by_hand():
    """Measured data are judged at every valid pixel, by strategy and size."""
    data, model = structured()
    n = model.control_points.shape[0]
    study = tsj.sampling_study(data, ["greville", "halton"], [2 * n, n], model=model, rng=1)
    assert (study.strategies, study.sizes, study.control_points) == (("greville", "halton"), (n, 2 * n), n)
    assert (study.unit, study.range) == ("µm", pytest.approx(data.range))
    surface = tsj.reconstruct(tsj.sample(data, model=model, strategy="halton", size=2 * n, rng=1)).surface
    y, x = np.mgrid[0:128, 0:128]
    errors = np.asarray(surface.at(10 + 0.5 * x, -5 + 0.4 * y)) - data.heights
    assert study.rms_errors[1, 1] == pytest.approx(np.sqrt(np.mean(errors**2)), rel=1e-6)
    assert study.max_errors[1, 1] == pytest.approx(np.abs(errors).max(), rel=1e-6)


def test_strategies_that_know_the_mesh_need_fewer_samples():
    """On a structured surface at 1.2 and 2 samples a control point: a third of the error of those that do not."""
    _, model = structured()
    n = model.control_points.shape[0]
    ours = tsj.sampling_study(model, ["greville", "greville-centres"], [round(1.2 * n), 2 * n]).rms_errors.min(axis=0)
    others = ["uniform", "random", "halton", "latin-hypercube", "curvature"]
    study = tsj.sampling_study(model, others, [round(1.2 * n), 2 * n])
    assert (ours <= study.rms_errors.min(axis=0) / 3).all()


def test_nothing_to_compare_is_refused():
    """At least one strategy."""
    with pytest.raises(tsj.InputError, match="at least one strategy"):
        tsj.sampling_study(structured()[1], [])


@pytest.mark.slow
def test_a_face_from_a_thousand_of_its_points(shared_data):
    """Fig. 1c: the rms distance at the other points is at most half of that of a thousand random ones."""
    face = tsj.read(shared_data / "face_fran_cut.ply")
    place = tsj.conformal(face)
    every = tsj.Samples(place.parameters, face.points, None, place.frame)
    model = tsj.fit(every, relative_tolerance=0.005).surface

    def rms(strategy, seed=0):
        samples = tsj.sample(every, model=model, strategy=strategy, size=1000, rng=seed)
        errors = np.asarray(tsj.reconstruct(samples).surface(place.parameters)) - face.points
        others = np.delete(np.linalg.norm(errors, axis=1), samples.index)
        return np.sqrt(np.mean(others**2))

    assert rms("adaptive") <= 0.5 * min(rms("random", seed) for seed in range(3))
