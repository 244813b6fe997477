"""The device finds the same Bézier element as the host, at random places, on knot lines and at the ends."""

import jax
import numpy as np
import pytest
from hypothesis import given, settings

from tsplinejax.mesh import DEPTH, Dyadic, b_lattice, refine
from tsplinejax.space import bezier_elements, spline_space
from tsplinejax.space._locate import make_locator

from ..random_meshes import hand_given, marks_at_points, meshes, parameters

located = jax.jit(lambda locator, places: locator(places))


@settings(max_examples=40)
@given(meshes(Dyadic()), parameters())
def test_forest_locator(tmesh, places):
    """On a dyadic forest: the element whose index box holds the parameter's index cell."""
    scale = np.array(tmesh.forest.lattice) << DEPTH
    cells = np.minimum((places * scale).astype(int), scale - 1)
    elements = bezier_elements(tmesh)
    inside = (elements.boxes[None, :, :2] <= cells[:, None]) & (cells[:, None] < elements.boxes[None, :, 2:])
    host = inside.all(axis=2)
    assert (host.sum(axis=1) == 1).all()
    found = np.asarray(located(spline_space(tmesh, rational=True).locator, places))
    np.testing.assert_array_equal(found, host.argmax(axis=1))


@settings(max_examples=40)
@given(hand_given(), parameters())
def test_table_locator(tmesh, places):
    """On a mesh given by hand: the index cell between its knot lines, the far ends in the last ones."""
    space = spline_space(tmesh, rational=True)
    found = np.asarray(space.locator(places))
    corner, size = np.asarray(space.tables.corner)[found], np.asarray(space.tables.size)[found]
    local = (places - corner) / size
    assert ((local >= 0) & (local <= 1)).all()
    assert ((local < 1) | (places == 1)).all()


@pytest.mark.parametrize("level", [12, 30])
def test_deep_meshes(level, dtype):
    """Deep elements are found in both precisions where their width can be told apart at all."""
    place = np.array([[0.375, 0.625]])
    tmesh = b_lattice(1, 1)
    for _ in range(level):
        tmesh = refine(tmesh, marks_at_points(tmesh, place)).mesh
    space = spline_space(tmesh, dtype=dtype)
    found = int(space.locator(place.astype(dtype))[0])
    corner, size = np.asarray(space.tables.corner)[found], np.asarray(space.tables.size)[found]
    assert ((corner <= place) & (place <= corner + size)).all()
    assert size.max() <= 2.0 ** -(level // 2)


@settings(max_examples=40)
@given(meshes(Dyadic()))
def test_tables_grow_with_elements_alone(tmesh):
    """The tables fit four entries an element, however uneven the mesh is, and lead to every element."""
    elements = bezier_elements(tmesh)
    locator = make_locator(tmesh, elements, len(elements), np.dtype(np.float64))
    table = np.asarray(locator.table)
    assert len(table) == 4 * len(elements)
    assert table.max() < len(elements)
    assert (-table.min() + (1 << int(locator.fan_out)) <= len(table)) or table.min() >= 0
    assert set(np.unique(table[table >= 0])) == set(range(len(elements)))


@pytest.mark.parametrize("first_cut", ["s", "t"])
def test_far_apart_levels(first_cut):
    """A lattice with one place cut thirty times: every element is found from its middle and its lower corner."""
    tmesh = b_lattice(5, 3, first_cut=first_cut)
    for _ in range(30):
        tmesh = refine(tmesh, marks_at_points(tmesh, np.array([[0.7, 0.2]]))).mesh
    elements = bezier_elements(tmesh)
    space = spline_space(tmesh)
    scale = np.array(tmesh.forest.lattice) << DEPTH
    # A place just inside the lower corner: knot lines of this lattice are no binary fractions.
    lower = (elements.boxes[:, :2] + 2.0**-4) / scale
    middle = (elements.boxes[:, :2] + elements.boxes[:, 2:]) / 2 / scale
    assert elements.levels.max() >= 30
    for places in (lower, middle):
        np.testing.assert_array_equal(located(space.locator, places), np.arange(len(elements)))
    # Thirty levels below the lattice, read four or more at a time.
    assert int(space.locator.steps) <= 8
