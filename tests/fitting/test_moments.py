"""Moments add up: over any chunking of the samples, any tiling of the blocks, scattered or on a grid."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tsplinejax.fitting._moments import Moments, add_samples
from tsplinejax.fitting._samples import grid_samples, scattered_samples
from tsplinejax.mesh import refine
from tsplinejax.space import bernstein, bernstein6

from .problems import CASES, Case, make_case, refined

CASE = make_case(refined())


def close(first: Moments, second: Moments) -> None:
    """Assert that two sets of moments agree to round-off."""
    np.testing.assert_allclose(first.mass, second.mass, atol=1e-12)
    np.testing.assert_allclose(first.load, second.load, atol=1e-12)


@pytest.mark.parametrize("name", ["closure", "hole", "points in space", "pixels", "pixels with a hole"])
def test_moments_are_the_sums_of_the_definition(name):
    """Σ w B⁶ B⁶ and Σ w B³ B³ v, summed sample by sample."""
    case: Case = CASES[name]()
    element = case.element_of_samples()
    local = case.local_places(element)
    six, cubic = ([np.asarray(f(jnp.asarray(local[:, k]))) for k in range(2)] for f in (bernstein6, bernstein))
    mass, load = np.zeros((case.mesh.capacity, 7, 7)), np.zeros((case.mesh.capacity, 4, 4, case.dimension))
    np.add.at(mass, element, np.einsum("m,ma,mb->mab", case.weights, *six))
    np.add.at(load, element, np.einsum("m,ma,mb,md->mabd", case.weights, *cubic, case.values))
    close(case.moments(), Moments(jnp.asarray(mass), jnp.asarray(load)))


@settings(max_examples=15)
@given(st.integers(0, 2**20))
def test_any_part_of_the_elements_adds_up(pattern):
    """The elements summed in any two parts give the moments of all at once."""
    chosen = np.array([pattern >> (k % 20) & 1 for k in range(len(CASE.mesh.slots))], bool)
    parts = [CASE.moments(np.flatnonzero(part)) for part in (chosen, ~chosen)]
    close(Moments(parts[0].mass + parts[1].mass, parts[0].load + parts[1].load), CASE.moments())


@pytest.mark.parametrize("grid", [None, (23, 31)])
@pytest.mark.parametrize("tile", [1, 7, 512])
def test_any_tiling_adds_up(tile, grid):
    """The length of a tile, and the padding it brings, changes nothing."""
    close(make_case(refined(), grid=grid, tile=tile).moments(), make_case(refined(), grid=grid).moments())


@pytest.mark.parametrize("hole", [False, True])
def test_pixels_are_samples(hole):
    """The pixels of a grid give the same moments, counts, places and residual order as the same samples scattered."""
    case = make_case(refined(), grid=(33, 27), hole=hole)
    options = {"dtype": np.dtype(np.float64), "tile": 64}
    scattered = scattered_samples(case.tmesh, case.parameters, case.values, case.weights, None, **options)
    every, store = np.arange(len(case.mesh.slots)), case.store()
    pixels = np.bincount(case.element_of_samples(), minlength=len(every))
    found = []
    for samples in (case.samples, scattered):
        part = add_samples(case.store().moments, samples, case.mesh, every, store.boxes, case.lattice)
        found.append((*part, samples.places_in(case.tmesh, case.mesh.per_element(np.add, pixels))))
    close(found[0][0], found[1][0])
    np.testing.assert_array_equal(found[0][1].samples, found[1][1].samples)
    np.testing.assert_array_equal(found[0][2], found[1][2])
    counted = np.bincount(case.element_of_samples(), case.weights > 0, len(every))
    np.testing.assert_array_equal(found[0][1].samples, counted)


def test_variances_are_summed():
    """An element's variance is the sum over its samples of a weight above zero."""
    case = make_case(refined(), grid=(33, 27))
    variance = np.random.default_rng(1).random(len(case.values))
    options = {"dtype": np.dtype(np.float64), "tile": 64}
    samples = grid_samples(case.tmesh, (33, 27), None, case.values, case.weights, variance, **options)
    every, store = np.arange(len(case.mesh.slots)), case.store()
    _, counts = add_samples(case.store().moments, samples, case.mesh, every, store.boxes, case.lattice)
    expected = np.bincount(case.element_of_samples(), variance * (case.weights > 0), len(every))
    np.testing.assert_allclose(counts.variance, expected, atol=1e-12)


def test_places_are_counted():
    """Elements with several places, one (whatever the samples there), or none are told apart."""
    tmesh = refine(refined(steps=0), np.ones(6, bool)).mesh
    low = tmesh.element_boxes[:, :2]
    parameters = np.concatenate([low[:3] + 0.01, low[:3] + 0.01, low[:1] + 0.02])
    samples = scattered_samples(tmesh, parameters, np.ones((7, 1)), None, None, dtype=np.dtype(np.float64), tile=1)
    assert samples.places_in(tmesh, np.zeros(0)).tolist() == [2, 1, 1, *[0] * (tmesh.n_elements - 3)]
