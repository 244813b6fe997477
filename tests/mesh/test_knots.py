"""Anchors and local knot vectors against the definition: edges, rays and nothing else."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings

from tsplinejax.mesh import Dyadic, anchor_codes, b_lattice, refine

from ..random_meshes import hand_given, meshes, refinements
from . import oracles

SLOW = settings(max_examples=30)


@SLOW
@given(meshes(most=80))
def test_rule_one_with_closure(tmesh):
    """On analysis-suitable meshes anchors and local knots are those of the brute-force rule."""
    assert set(map(tuple, tmesh.anchors.tolist())) == oracles.anchors(tmesh)
    np.testing.assert_array_equal(tmesh.local_knots, oracles.local_knots(tmesh))


@SLOW
@given(meshes(Dyadic(), most=80))
def test_rule_one_without_closure(tmesh):
    """On the paper's own meshes, whose T-junctions are unrestricted, too."""
    assert set(map(tuple, tmesh.anchors.tolist())) == oracles.anchors(tmesh)
    np.testing.assert_array_equal(tmesh.local_knots, oracles.local_knots(tmesh))


@SLOW
@given(hand_given())
def test_rule_one_by_hand(tmesh):
    """And on meshes given by hand with knots at uneven places."""
    assert set(map(tuple, tmesh.anchors.tolist())) == oracles.anchors(tmesh)
    np.testing.assert_array_equal(tmesh.local_knots, oracles.local_knots(tmesh))


@given(refinements())
def test_anchors_keep_their_names(history):
    """Anchors come in the order of their codes, each once, and a refinement keeps all of them."""
    for tmesh in history:
        assert (np.diff(anchor_codes(tmesh, tmesh.anchors)) > 0).all()
    for old, new in pairwise(history):
        assert np.isin(anchor_codes(old, old.anchors), anchor_codes(new, new.anchors)).all()


@given(meshes(Dyadic()))
def test_local_knots_rise(tmesh):
    """Local knots rise strictly in index coordinates, and their middle one is the anchor."""
    assert (np.diff(tmesh.local_knots, axis=2) > 0).all()
    np.testing.assert_array_equal(tmesh.local_knots[:, :, 2], tmesh.anchors)


def test_a_known_t_junction():
    """One element of a 4 × 4 lattice cut in s: the T-junction's row knots skip to the next full lines."""
    tmesh = refine(b_lattice(4, 4), np.arange(16) == 0, Dyadic()).mesh  # element 0 lies at the lower left
    half = tmesh.frame // 2
    row = tmesh.anchors.tolist().index([half, tmesh.frame])
    knots = tmesh.local_knots[row] / tmesh.frame
    assert knots[0].tolist() == [-1, 0, 0.5, 1, 2]
    assert knots[1].tolist() == [-1, 0, 1, 2, 3]


@pytest.mark.parametrize("border", ["clamped", "open"])
def test_the_frame_repeats_or_continues(border):
    """The corner function's parameters: fourfold end knots when clamped, evenly spaced ones in the open frame."""
    tmesh = b_lattice(2, 2, border=border)
    knots = tmesh.parameters(0, tmesh.local_knots[0, 0])
    assert knots.tolist() == ([0, 0, 0, 0, 0.5] if border == "clamped" else [-1.5, -1, -0.5, 0, 0.5])
