"""Anchors and local knots that a refinement brings with it are those of the same mesh seen for the first time."""

import numpy as np
import pytest
from hypothesis import given, settings

from tsplinejax.mesh import MAX_LEVEL, Dyadic, Refinement, TMesh, b_lattice, refine

from ..random_meshes import marks_at_points, refinements
from .replay import replay, seen_first


def check_step(old: TMesh, step: Refinement) -> None:
    """Same anchors, knots and elements met by rays; and `kept` names exactly the old anchors with equal knots."""
    fresh = seen_first(step.mesh)
    for name in ("boxes", "anchors", "local_knots"):
        np.testing.assert_array_equal(getattr(step.mesh, name), getattr(fresh, name))
    for name in ("codes", "met"):
        np.testing.assert_array_equal(getattr(step.mesh.traces, name), getattr(fresh.traces, name))
    before = {knots.tobytes(): index for index, knots in enumerate(old.local_knots)}
    assert step.kept.tolist() == [before.get(knots.tobytes(), -1) for knots in step.mesh.local_knots]


@settings(max_examples=60)
@given(refinements())
def test_traces_with_closure(history):
    """Over sequences of analysis-suitable refinements, where each step builds on the one before."""
    for old, step in replay(history):
        check_step(old, step)


@settings(max_examples=60)
@given(refinements(Dyadic()))
def test_traces_without_closure(history):
    """And on the paper's own meshes, where an element may have many small neighbours."""
    for old, step in replay(history):
        check_step(old, step)


@pytest.mark.parametrize("border", ["clamped", "open"])
def test_traces_at_the_deepest_level(border):
    """Thirty bisections of one corner: the traces followed through all of them are still right."""
    tmesh = b_lattice(2, 2, border=border)
    assert tmesh.n_anchors == len(tmesh.local_knots)
    for _ in range(MAX_LEVEL):
        tmesh = refine(tmesh, marks_at_points(tmesh, np.zeros((1, 2)))).mesh
    assert tmesh.is_traced
    np.testing.assert_array_equal(tmesh.local_knots, seen_first(tmesh).local_knots)


def test_nothing_is_traced_unasked():
    """A chain of refinements whose knots nobody asked for traces none of them."""
    step = refine(b_lattice(3, 3), np.arange(9) == 4)
    assert step.kept is None
    assert not step.mesh.is_traced
