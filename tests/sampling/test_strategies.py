"""Strategies: any size, inside the square, the same for the same seed, and each what its name says."""

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.mesh import from_rectangles
from tsplinejax.sampling import STRATEGIES, Curvature, ElementArea, Grid, LatinHypercube, Random, TPatch
from tsplinejax.sampling._greville import greville_points
from tsplinejax.sampling._site import Site

from .surfaces import random_model, structured


def _in_elements(surface: tsj.TSpline, places: np.ndarray) -> np.ndarray:
    """How many places each element holds."""
    s0, t0, s1, t1 = surface.space.mesh.element_boxes.T[:, :, None]
    s, t = places.T
    return ((s0 <= s) & (s < s1) & (t0 <= t) & (t < t1)).sum(axis=1)


@pytest.mark.parametrize("name", STRATEGIES)
@pytest.mark.parametrize("share", [0.4, 1.0, 1.7, 4.3])
def test_every_strategy_takes_any_size(name, share):
    """Exactly that many places, distinct, in the square; a seed decides over all of them."""
    model = random_model()
    size = round(share * model.control_points.shape[0])
    samples = tsj.sample(model, strategy=name, size=size, rng=3)
    assert samples.parameters.shape == (size, 2)
    assert samples.values.shape == (size, 1)
    assert ((samples.parameters >= 0) & (samples.parameters <= 1)).all()
    assert len(np.unique(samples.parameters, axis=0)) == size
    again = tsj.sample(model, strategy=name, size=size, rng=np.random.default_rng(3))
    np.testing.assert_array_equal(samples.parameters, again.parameters)
    np.testing.assert_allclose(samples.values[:, 0], model(samples.parameters), atol=1e-12)


@pytest.mark.parametrize("random", [False, True])
def test_t_patch_holds_as_many_in_every_element(random):
    """Four in each by default; a size in between gives some one more."""
    model = random_model()
    samples = tsj.sample(model, strategy=TPatch(random=random))
    assert (_in_elements(model, samples.parameters) == 4).all()
    counts = _in_elements(model, tsj.sample(model, strategy=TPatch(random=random), size=len(samples) + 5).parameters)
    assert sorted(counts)[-6:] == [4, 5, 5, 5, 5, 5]


def test_a_mesh_given_by_hand_is_sampled_too():
    """Elements of any size and order."""
    tmesh = from_rectangles([[0.5, 0, 1, 0.5], [0, 0, 0.5, 1], [0.5, 0.5, 1, 1]])
    space = tsj.spline_space(tmesh)
    model = tsj.make_surface(space, np.random.default_rng(0).normal(size=int(space.n_functions)))
    for name in STRATEGIES.keys() - {"greville-refined"}:
        assert len(tsj.sample(model, strategy=name, size=30)) == 30
    with pytest.raises(tsj.InputError, match="over dyadic meshes are refined"):
        tsj.sample(model, strategy="greville-refined", size=30)


def test_element_area_is_the_area_of_the_surface():
    """Over a slope the area is that of the slope; the larger elements get more samples, every one at least one."""
    space = tsj.spline_space(tsj.b_lattice(4, 4))
    s, _ = greville_points(space.mesh).T
    slope = tsj.make_surface(space, 3.0 * s, tsj.Frame((0.0, 0.0), (1.0, 2.0)))
    areas = Site(slope).integrals(slope.space.mesh.element_boxes, of_curvature=False)
    np.testing.assert_allclose(areas, 2 / 16 * np.sqrt(10), rtol=1e-12)
    model = random_model()
    counts = _in_elements(model, tsj.sample(model, strategy=ElementArea(), size=300).parameters)
    assert counts.min() >= 1
    levels = model.space.mesh.levels
    assert counts[levels == 0].mean() > 2 * counts[levels == levels.max()].mean()


def test_curvature_of_a_sphere():
    """A cap of radius R: √(k₁² + k₂²) is √2 / R everywhere, so its integral is that times the area."""
    radius, frame = 10.0, tsj.Frame((-2.0, -1.0), (4.0, 2.0), "mm")
    y, x = np.meshgrid(np.linspace(-1, 1, 41), np.linspace(-2, 2, 81), indexing="ij")
    cap = tsj.HeightMap(np.sqrt(radius**2 - x**2 - y**2), 0.05, "mm", origin=(-2.0, -1.0))
    model = tsj.fit(cap, tolerance=1e-7).surface
    assert model.frame == frame
    site = Site(model)
    area, bent = (site.integrals(site.elements, of_curvature=flag) for flag in (False, True))
    np.testing.assert_allclose(bent / area, np.sqrt(2) / radius, rtol=1e-3)


def test_curvature_draws_samples_to_the_features():
    """Where the surface bends the density is higher; a share of 0 is even over the area."""
    _, model = structured()
    site = Site(model)
    bent = site.integrals(site.elements, of_curvature=True)
    density = bent / np.prod(site.elements[:, 2:] - site.elements[:, :2], axis=1)
    feature = density > np.median(density)

    def share(strategy):
        return _in_elements(model, tsj.sample(model, strategy=strategy, size=2000).parameters)[feature].sum() / 2000

    even = share(Curvature(share=0.0))
    area = site.integrals(site.elements, of_curvature=False)
    assert even == pytest.approx(area[feature].sum() / area.sum(), abs=0.02)
    assert share(Curvature(share=1.0)) == pytest.approx(bent[feature].sum() / bent.sum(), abs=0.02)
    assert share(Curvature(share=1.0)) > even


def test_a_latin_hypercube_has_one_sample_a_row_and_column():
    """Sorted along either axis, the k-th sample is in the k-th interval."""
    places = tsj.sample(random_model(), strategy=LatinHypercube(), size=97).parameters
    np.testing.assert_array_equal(np.sort((places * 97).astype(int), axis=0), np.arange(97)[:, None].repeat(2, axis=1))


def test_a_grid_is_square_in_space_and_reaches_the_border():
    """48 samples on a frame of 4 × 3 are 8 × 6, from border to border."""
    model = random_model(frame=tsj.Frame((0.0, 0.0), (4.0, 3.0), "mm"))
    places = tsj.sample(model, strategy=Grid(), size=48).parameters
    np.testing.assert_allclose(np.unique(places[:, 0]), np.linspace(0, 1, 8))
    np.testing.assert_allclose(np.unique(places[:, 1]), np.linspace(0, 1, 6))


def test_halton_is_more_even_than_random():
    """The largest share of a cell of 10 × 10 is smaller."""
    model = random_model()

    def fullest(name):
        places = tsj.sample(model, strategy=name, size=1000).parameters
        return np.histogram2d(*places.T, bins=10, range=[[0, 1], [0, 1]])[0].max()

    assert fullest("halton") < fullest(Random())


@pytest.mark.parametrize(
    ("strategy", "message"),
    [
        (lambda: tsj.sample(random_model(), strategy="sobol"), "one of greville, .*received 'sobol'"),
        (lambda: tsj.sample(random_model(), size=0), "at least 1; received 0"),
        (lambda: tsj.sample(random_model(), size=2.5), "whole number"),
        (lambda: TPatch(per_element=0), "at least one sample an element"),
        (lambda: Curvature(share=1.5), "from 0 to 1; received 1.5"),
        (lambda: tsj.sampling.Adaptive(start=0), "share above 0"),
    ],
)
def test_misuse_is_refused(strategy, message):
    """The rule, what was received, the remedy."""
    with pytest.raises(tsj.InputError, match=message):
        strategy()


def test_names_are_read_with_some_tolerance():
    """As the paper writes them."""
    model = random_model()
    for written, name in [("T-patch random", "t-patch-random"), ("Greville + centres", "greville-centres")]:
        np.testing.assert_array_equal(
            tsj.sample(model, strategy=written, size=50).parameters,
            tsj.sample(model, strategy=name, size=50).parameters,
        )
