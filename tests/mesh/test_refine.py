"""Refinement: the closure is the smallest set its definition asks for, and nothing else changes."""

import numpy as np
import pytest
from hypothesis import given, settings

from tsplinejax import InputError
from tsplinejax.mesh import AnalysisSuitable, Dyadic, b_lattice, bisect, from_rectangles, refine

from ..random_meshes import marked_meshes, marks_at_points, refinements
from . import oracles


@settings(max_examples=40)
@given(marked_meshes())
def test_closure_is_the_smallest_patch(case):
    """The completed set equals the fixed point of the patch rule, element by element."""
    tmesh, marked = case
    np.testing.assert_array_equal(AnalysisSuitable().complete(tmesh, marked), oracles.closure(tmesh, marked))


@given(marked_meshes(Dyadic()))
def test_bisection_halves_by_parity(case):
    """Marked elements become two halves, cut across the direction of their level's parity; the others stay."""
    tmesh, marked = case
    step = bisect(tmesh, marked)
    first = 0 if tmesh.forest.first_cut == "s" else 1
    np.testing.assert_array_equal(np.bincount(step.parent), 1 + marked)
    size, parent_size = (boxes[:, 2:] - boxes[:, :2] for boxes in (step.mesh.boxes, tmesh.boxes[step.parent]))
    axis = np.where(tmesh.levels[step.parent] % 2 == 0, first, 1 - first)
    halved = marked[step.parent]
    expected = parent_size.copy()
    expected[halved, axis[halved]] //= 2
    np.testing.assert_array_equal(size, expected)
    np.testing.assert_array_equal(step.mesh.levels, tmesh.levels[step.parent] + halved)
    inside = tmesh.boxes[step.parent]
    assert (step.mesh.boxes[:, :2] >= inside[:, :2]).all()
    assert (step.mesh.boxes[:, 2:] <= inside[:, 2:]).all()


@given(refinements())
def test_neighbours_of_refined_meshes_differ_little(history):
    """Admissibility: every element that meets the patch of a parent has at least the parent's level."""
    tmesh = history[-1]
    for element in np.flatnonzero(tmesh.levels > 0)[::7]:
        level = tmesh.levels[element] - 1
        first = 0 if tmesh.forest.first_cut == "s" else 1
        across = first if level % 2 == 0 else 1 - first
        size = (tmesh.boxes[element, 2:] - tmesh.boxes[element, :2]).copy()
        size[across] *= 2
        low = tmesh.boxes[element, :2] // size * size
        reach = np.where(np.arange(2) == across, 1, 2) * size
        meets = ((tmesh.boxes[:, :2] < low + size + reach) & (tmesh.boxes[:, 2:] > low - reach)).all(axis=1)
        assert tmesh.levels[meets].min() >= level


@given(marked_meshes())
def test_refinement_does_not_depend_on_the_direction_of_counting(case):
    """Refining the mesh with s and t exchanged gives the refined mesh with s and t exchanged."""
    tmesh, marked = case
    forest = tmesh.forest
    turned = b_lattice(*forest.lattice[::-1], first_cut="t" if forest.first_cut == "s" else "s", border=tmesh.border)
    swap = [1, 0, 3, 2]
    while turned.n_elements < tmesh.n_elements:
        centres = (turned.boxes[:, :2] + turned.boxes[:, 2:]) // 2
        turned = bisect(turned, tmesh.levels[tmesh.locate(centres[:, 1], centres[:, 0])] > turned.levels).mesh
    elements = tmesh.locate(turned.boxes[:, 1], turned.boxes[:, 0])
    np.testing.assert_array_equal(turned.boxes[:, swap], tmesh.boxes[elements])
    refined, other = refine(tmesh, marked).mesh, refine(turned, marked[elements]).mesh
    assert set(map(tuple, refined.boxes.tolist())) == set(map(tuple, other.boxes[:, swap].tolist()))


@pytest.mark.parametrize("first_cut", ["s", "t"])
def test_shape_of_a_level(first_cut):
    """An element of level k is 2^-ceil(k/2) by 2^-floor(k/2), the shorter side across the first cut."""
    tmesh = b_lattice(1, 1, first_cut=first_cut)
    for level in range(1, 8):
        tmesh = refine(tmesh, np.ones(tmesh.n_elements, bool)).mesh
        sides = tmesh.element_boxes[0, 2:] - tmesh.element_boxes[0, :2]
        across, along = 2.0 ** -((level + 1) // 2), 2.0 ** -(level // 2)
        assert sides.tolist() == ([across, along] if first_cut == "s" else [along, across])


def test_refinement_stays_local():
    """Twenty bisections at one point cost a few dozen elements a level, not a finest-level raster."""
    tmesh = b_lattice(4, 4)
    for _ in range(20):
        tmesh = refine(tmesh, marks_at_points(tmesh, np.array([[0.37, 0.61]]))).mesh
    assert tmesh.levels.max() == 20
    assert tmesh.n_elements < 20 * 60


def test_hand_given_meshes_are_not_bisected():
    """A mesh given by hand has no levels to bisect by: the error says what to start from."""
    with pytest.raises(InputError, match="b_lattice"):
        refine(from_rectangles([[0, 0, 1, 1]]), np.array([True]))


@pytest.mark.parametrize("marks", [[1, 0, 0, 0], [True], [0.5] * 4, np.ones((2, 2), bool)])
def test_bad_marks(marks):
    """Marks are one boolean an element."""
    with pytest.raises(InputError, match="one boolean mark"):
        refine(b_lattice(2, 2), marks)
