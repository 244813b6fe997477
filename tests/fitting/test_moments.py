"""Moments add up: over any chunking of the samples, any tiling of the blocks, and any numbering of the elements."""

from itertools import pairwise

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from tsplinejax.fitting._discretisation import discretise, same_elements
from tsplinejax.fitting._moments import Moments, add_samples, empty_moments, inherit_moments
from tsplinejax.mesh import refine
from tsplinejax.space import Blocks, bernstein, bernstein6, make_blocks, pad

from .problems import CASES, TILE, Case, make_case, refined

CASE = make_case(refined())


def close(first: Moments, second: Moments) -> None:
    """Assert that two sets of moments agree to round-off."""
    np.testing.assert_allclose(first.mass, second.mass, atol=1e-12)
    np.testing.assert_allclose(first.load, second.load, atol=1e-12)


@pytest.mark.parametrize("name", ["closure", "hole", "points in space"])
def test_moments_are_the_sums_of_the_definition(name):
    """Σ w B⁶ B⁶ and Σ w B³ B³ v, summed sample by sample."""
    case: Case = CASES[name]()
    tables = case.mesh.space.tables
    element = np.asarray(case.mesh.space.locator(jnp.asarray(case.parameters)))
    local = (case.parameters - np.asarray(tables.corner)[element]) / np.asarray(tables.size)[element]
    six, cubic = ([np.asarray(f(jnp.asarray(local[:, k]))) for k in range(2)] for f in (bernstein6, bernstein))
    mass, load = np.zeros((case.mesh.capacity, 7, 7)), np.zeros((case.mesh.capacity, 4, 4, case.values.shape[1]))
    np.add.at(mass, element, np.einsum("m,ma,mb->mab", case.weights, *six))
    np.add.at(load, element, np.einsum("m,ma,mb,md->mabd", case.weights, *cubic, case.values))
    close(case.moments(), Moments(jnp.asarray(mass), jnp.asarray(load)))


@settings(max_examples=15)
@given(st.lists(st.integers(0, 10_000), max_size=6))
def test_any_chunking_adds_up(cuts):
    """The blocks summed in any consecutive chunks give the moments of all at once."""
    blocks, space = CASE.mesh.blocks, CASE.mesh.space
    ends = [0, *sorted(cut % len(blocks.start) for cut in cuts), len(blocks.start)]
    moments = empty_moments(space, 1)
    for first, last in pairwise(ends):
        chunk = Blocks(blocks.start[first:last], blocks.count[first:last], blocks.element[first:last])
        moments = add_samples(moments, space, CASE.samples, chunk, TILE)
    close(moments, CASE.moments())


@pytest.mark.parametrize("tile", [1, 7, 512])
def test_any_tiling_adds_up(tile):
    """The length of a tile, and the padding it brings, changes nothing."""
    space, blocks = CASE.mesh.space, CASE.mesh.blocks
    close(add_samples(empty_moments(space, 1), space, CASE.samples, blocks, tile), CASE.moments())


def test_changed_elements_only():
    """After a refinement, inherited moments plus those of the changed elements are the moments of all samples."""
    case = make_case(refined(steps=2))
    finer = refine(case.tmesh, np.arange(case.tmesh.n_elements) % 3 == 0).mesh
    mesh = discretise(finer, case.order, dtype=np.dtype(np.float64), rational=False, least_capacity=256)
    source = same_elements(case.mesh.elements, mesh.elements)
    assert 0 < (source >= 0).sum() < len(source)
    moments = inherit_moments(case.moments(), jnp.asarray(pad(source, mesh.capacity, -1)))
    changed = make_blocks(mesh.ranges, np.flatnonzero(source < 0))
    moments = add_samples(moments, mesh.space, case.samples, changed, TILE)
    close(moments, add_samples(empty_moments(mesh.space, 1), mesh.space, case.samples, mesh.blocks, TILE))


def test_weights_scale_moments():
    """Doubled weights double both moments; samples of weight zero leave no trace."""
    space, blocks = CASE.mesh.space, CASE.mesh.blocks
    doubled = eqx.tree_at(lambda s: s.weights, CASE.samples, 2 * CASE.samples.weights)
    moments = add_samples(empty_moments(space, 1), space, doubled, blocks, TILE)
    close(moments, Moments(2 * CASE.moments().mass, 2 * CASE.moments().load))
    garbage = eqx.tree_at(
        lambda s: s.values, CASE.samples, jnp.where(CASE.samples.weights[:, None] > 0, CASE.samples.values, 1e9)
    )
    close(add_samples(empty_moments(space, 1), space, garbage, blocks, TILE), CASE.moments())
