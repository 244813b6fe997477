"""The checker agrees with the definition of analysis-suitability, and its reason names T-junctions that exist."""

import re

import numpy as np
from hypothesis import given, settings

from tsplinejax.mesh import Dyadic, b_lattice, from_rectangles, is_analysis_suitable, refine

from ..random_meshes import hand_given, lattices, meshes
from . import oracles


@given(meshes())
def test_closure_makes_suitable_meshes(tmesh):
    """Every mesh refined with the closure is analysis-suitable."""
    assert is_analysis_suitable(tmesh)


@given(lattices())
def test_lattices_are_suitable(tmesh):
    """A mesh without T-junctions is analysis-suitable and says so."""
    verdict = is_analysis_suitable(tmesh)
    assert verdict
    assert verdict.reason == "no T-junctions"


@settings(max_examples=60)
@given(meshes(Dyadic(), most=60))
def test_dyadic_meshes_against_the_definition(tmesh):
    """Without closure, the verdict is that of intersecting all pairs of extensions."""
    assert bool(is_analysis_suitable(tmesh)) == (not oracles.extensions_meet(tmesh))


@settings(max_examples=60)
@given(hand_given())
def test_hand_given_meshes_against_the_definition(tmesh):
    """So it is on meshes given by hand."""
    assert bool(is_analysis_suitable(tmesh)) == (not oracles.extensions_meet(tmesh))


@settings(max_examples=40)
@given(hand_given())
def test_the_reason_names_t_junctions(tmesh):
    """The two places in the reason are T-junctions of the mesh."""
    verdict = is_analysis_suitable(tmesh)
    if verdict:
        return
    named = [tuple(map(float, pair)) for pair in re.findall(r"\(([\d.e+-]+), ([\d.e+-]+)\)", verdict.reason)]
    assert len(named) == 2
    for axis, place in enumerate(named):
        junctions = [(j[axis], j[1 - axis]) for j in oracles.t_junctions(tmesh, axis)]
        known = [(float(tmesh.parameters(0, x)), float(tmesh.parameters(1, y))) for x, y in junctions]
        assert any(np.allclose(place, other, atol=1e-5) for other in known)


def test_random_dyadic_meshes_are_often_found_unsuitable():
    """Without closure reasons are found: the checker does not pass everything."""
    unsuitable = 0
    for seed in range(20):
        generator, tmesh = np.random.default_rng(seed), b_lattice(4, 4)
        for _ in range(3):
            tmesh = refine(tmesh, generator.random(tmesh.n_elements) < 0.3, Dyadic()).mesh
        verdict = is_analysis_suitable(tmesh)
        unsuitable += not verdict
        assert verdict or "meets" in verdict.reason
    assert unsuitable >= 15


def test_a_pinwheel_is_not_suitable():
    """Four rectangles around a fifth: each T-junction's extension crosses a neighbour's."""
    pinwheel = [[0, 0, 0.6, 0.4], [0.6, 0, 1, 0.6], [0.4, 0.6, 1, 1], [0, 0.4, 0.4, 1], [0.4, 0.4, 0.6, 0.6]]
    verdict = is_analysis_suitable(from_rectangles(pinwheel))
    assert not verdict
    assert "0.4" in verdict.reason
