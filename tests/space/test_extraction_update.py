"""Bézier elements found span by span, and those carried over a refinement, are those found by cutting cell by cell."""

from itertools import pairwise
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings

from tsplinejax.mesh import MAX_LEVEL, Dyadic, Refinement, TMesh, b_lattice, bisect, bisect_cells, cell_boxes, refine
from tsplinejax.space import BezierElements, _update, bezier_elements
from tsplinejax.space._extraction import by_cutting, by_spans
from tsplinejax.space._spans import Pieces, cut_in_vain, likely_pieces
from tsplinejax.space._update import ElementUpdate, refine_elements

from ..mesh.replay import replay
from ..random_meshes import marks_at_points, meshes, refinements

FIELDS = ("boxes", "owner", "functions", "levels", "codes")


def check_same(found: BezierElements, expected: BezierElements) -> None:
    """Every array equal, in value and type."""
    for name in FIELDS:
        assert getattr(found, name).dtype == getattr(expected, name).dtype
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)


def content(tmesh: TMesh, elements: BezierElements) -> dict[bytes, set[bytes]]:
    """Local knots of the functions on each rectangle, by the rectangle."""
    knots = [knots.tobytes() for knots in tmesh.local_knots]
    rows = [{knots[k] for k in row if k >= 0} for row in elements.functions]
    return dict(zip((box.tobytes() for box in elements.boxes), rows, strict=True))


def check_update(old: BezierElements, tmesh: TMesh, step: Refinement, update: ElementUpdate) -> None:
    """The update against its definition: rectangles and local knots looked up one by one."""
    check_same(update.elements, by_cutting(step.mesh))
    places = {box.tobytes(): index for index, box in enumerate(old.boxes)}
    assert update.source.tolist() == [places.get(box.tobytes(), -1) for box in update.elements.boxes]
    functions = {knots.tobytes(): index for index, knots in enumerate(tmesh.local_knots)}
    assert update.kept.tolist() == [functions.get(knots.tobytes(), -1) for knots in step.mesh.local_knots]
    if update.elements.functions.shape[1] != old.functions.shape[1]:
        assert update.touched.all()
        return
    before, after = content(tmesh, old), content(step.mesh, update.elements)
    assert update.touched.tolist() == [before.get(box) != rows for box, rows in after.items()]


@settings(max_examples=60)
@given(meshes())
def test_spans_with_closure(tmesh):
    """On analysis-suitable meshes the short way answers, and as the long one does."""
    found = by_spans(tmesh)
    assert found is not None
    check_same(found, by_cutting(tmesh))


@settings(max_examples=60)
@given(meshes(Dyadic()))
def test_spans_without_closure(tmesh):
    """On other meshes it says that it cannot, or is right."""
    found = by_spans(tmesh)
    if found is not None:
        check_same(found, by_cutting(tmesh))
    check_same(bezier_elements(tmesh), by_cutting(tmesh))


@settings(max_examples=60)
@given(refinements(most=200))
def test_updates_with_closure(history):
    """Over sequences of refinements, each update from the one before, never all over again."""
    elements = bezier_elements(history[0])
    for tmesh, step in replay(history):
        with mock.patch.object(_update, "bezier_elements", side_effect=AssertionError("found all over again")):
            update = refine_elements(elements, tmesh, step)
        check_update(elements, tmesh, step, update)
        elements = update.elements


@settings(max_examples=60)
@given(refinements(most=200))
def test_two_refinements_at_once(history):
    """Two refinements joined into one are updated in one go, and as by their definition."""
    steps = list(replay(history))
    for (tmesh, first), (_, second) in pairwise(steps):
        elements = bezier_elements(tmesh)
        both = first.then(second)
        assert both.bisected.tolist() == (np.bincount(both.parent, minlength=tmesh.n_elements) > 1).tolist()
        with mock.patch.object(_update, "bezier_elements", side_effect=AssertionError("found all over again")):
            check_update(elements, tmesh, both, refine_elements(elements, tmesh, both))


@settings(max_examples=60)
@given(refinements(Dyadic(), most=200))
def test_updates_without_closure(history):
    """Meshes that are not analysis-suitable get the same answers the long way."""
    elements = bezier_elements(history[0])
    for tmesh, step in replay(history):
        update = refine_elements(elements, tmesh, step)
        check_update(elements, tmesh, step, update)
        elements = update.elements


def test_a_refinement_without_a_memory():
    """Where the refinement does not say which functions it kept, they are looked up."""
    tmesh = refine(b_lattice(5, 4), np.arange(20) == 7).mesh
    step = refine(tmesh, tmesh.levels == 1)
    assert step.kept is None
    elements = bezier_elements(tmesh)
    check_update(elements, tmesh, step, refine_elements(elements, tmesh, step))


def test_nothing_bisected():
    """An empty refinement touches nothing."""
    tmesh = refine(b_lattice(4, 4), np.arange(16) == 5).mesh
    elements = bezier_elements(tmesh)
    update = refine_elements(elements, tmesh, bisect(tmesh, np.zeros(tmesh.n_elements, bool)))
    check_same(update.elements, elements)
    assert not update.touched.any()
    assert update.source.tolist() == list(range(len(elements)))


@pytest.mark.parametrize("border", ["clamped", "open"])
@pytest.mark.parametrize("first_cut", ["s", "t"])
def test_updates_down_to_the_deepest_level(border, first_cut):
    """Thirty bisections of one corner, each updating the elements of the one before."""
    tmesh = b_lattice(3, 2, border=border, first_cut=first_cut)
    elements = bezier_elements(tmesh)
    for _ in range(MAX_LEVEL):
        step = refine(tmesh, marks_at_points(tmesh, np.zeros((1, 2))))
        tmesh, elements = step.mesh, refine_elements(elements, tmesh, step).elements
    assert tmesh.levels.max() == MAX_LEVEL
    check_same(elements, by_cutting(tmesh))


def test_far_elements_are_not_touched():
    """One bisection on a large lattice touches its neighbourhood: the support of the altered functions."""
    tmesh = b_lattice(20, 20)
    elements = bezier_elements(tmesh)
    step = refine(tmesh, marks_at_points(tmesh, np.array([[0.52, 0.53]])))
    update = refine_elements(elements, tmesh, step)
    centres = update.elements.boxes[:, :2] / np.array(tmesh.extent)
    near = (abs(centres - 0.5) <= 0.25).all(axis=1)
    assert not update.touched[~near].any()
    assert (update.source[~near] >= 0).all()


def test_a_needless_cut_is_noticed():
    """A cell halved although no local knot runs through it is not a Bézier element of the mesh."""
    tmesh = b_lattice(3, 3)
    levels, codes, owner = bisect_cells(tmesh.levels, tmesh.forest.codes, np.arange(9) == 4)
    pieces = Pieces(cell_boxes("s", levels, codes), owner, levels, codes)
    table = bezier_elements(tmesh).functions[owner]
    assert cut_in_vain(tmesh.local_knots, pieces, table, np.zeros(len(codes), bool))
    finer = bisect(tmesh, np.arange(9) == 4).mesh
    table = bezier_elements(finer).functions
    halves = likely_pieces(finer, np.arange(finer.n_elements))
    assert halves.is_half.any()
    assert not cut_in_vain(finer.local_knots, halves, table, np.zeros(len(halves.codes), bool))


def test_pieces_are_not_joined_across_a_knot():
    """Two halves that an unaltered function keeps apart stay two, whatever a new guess says."""
    tmesh = bisect(b_lattice(5, 5), np.arange(25) == 12).mesh
    elements = bezier_elements(tmesh)
    half = np.flatnonzero(np.diff(elements.owner) == 0)[0]
    owner = elements.owner[half]
    whole = Pieces(tmesh.boxes[[owner]], np.array([owner]), tmesh.levels[[owner]], tmesh.forest.codes[[owner]])
    assert _update._staying(elements, elements.functions, np.array([half]), whole, tmesh) is None
