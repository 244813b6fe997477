"""Bézier extraction against the definition: every blending function is its local knots' B-spline, on every element."""

import numpy as np
from hypothesis import given, settings

from tsplinejax.mesh import Dyadic, TMesh, b_lattice, cell_boxes, refine
from tsplinejax.space import BezierElements, bernstein, bezier_elements, spline_space

from ..blending import blending
from ..random_meshes import hand_given, marks_at_points, meshes

LOCAL = np.array([0.08, 0.37, 0.52, 0.93])


def extracted(tmesh: TMesh) -> tuple[np.ndarray, np.ndarray]:
    """Places inside every Bézier element, and all blending functions there from the space's tables."""
    space, elements = spline_space(tmesh), bezier_elements(tmesh)
    count = len(elements)
    u, v = (grid.ravel() for grid in np.meshgrid(LOCAL, LOCAL))
    places = (
        np.asarray(space.tables.corner)[:count, None]
        + np.stack([u, v], axis=1) * np.asarray(space.tables.size)[:count, None]
    )
    pieces = np.einsum(
        "eka,ekb,qa,qb->eqk",
        np.asarray(space.tables.along_s)[:count],
        np.asarray(space.tables.along_t)[:count],
        np.asarray(bernstein(u)),
        np.asarray(bernstein(v)),
    )
    values = np.zeros((count, len(u), tmesh.n_anchors))
    for element in range(count):
        np.add.at(values[element].T, np.asarray(space.tables.functions)[element], pieces[element].T)
    return places.reshape(-1, 2), values.reshape(-1, tmesh.n_anchors)


@settings(max_examples=25)
@given(meshes(most=60))
def test_extraction_with_closure(tmesh):
    """On analysis-suitable meshes the tables give scipy's values, and zero for functions that are not listed."""
    places, values = extracted(tmesh)
    np.testing.assert_allclose(values, blending(tmesh, places), atol=1e-12)


@settings(max_examples=25)
@given(meshes(Dyadic(), most=60))
def test_extraction_without_closure(tmesh):
    """On dyadic meshes the pieces cut by every knot line alive do so, too."""
    places, values = extracted(tmesh)
    np.testing.assert_allclose(values, blending(tmesh, places), atol=1e-12)


@settings(max_examples=25)
@given(hand_given())
def test_extraction_by_hand(tmesh):
    """And on meshes given by hand, at uneven knots."""
    places, values = extracted(tmesh)
    np.testing.assert_allclose(values, blending(tmesh, places), atol=1e-12)


def _check_tiling(tmesh: TMesh, elements: BezierElements) -> None:
    boxes, owner = elements.boxes, tmesh.boxes[elements.owner]
    assert ((boxes[:, :2] >= owner[:, :2]) & (boxes[:, 2:] <= owner[:, 2:])).all()
    areas = np.bincount(elements.owner, (boxes[:, 2:] - boxes[:, :2]).astype(float).prod(axis=1))
    np.testing.assert_allclose(areas, (tmesh.boxes[:, 2:] - tmesh.boxes[:, :2]).astype(float).prod(axis=1))


@given(meshes())
def test_bezier_elements_with_closure(tmesh):
    """Exactly sixteen functions live on each, and it is an element of the mesh or one of its two halves."""
    elements = bezier_elements(tmesh)
    assert elements.functions.shape[1] == 16
    assert (elements.functions >= 0).all()
    assert (np.diff(elements.functions, axis=1) > 0).all()
    assert (elements.levels - tmesh.levels[elements.owner] <= 1).all()
    _check_tiling(tmesh, elements)


@given(meshes(Dyadic()))
def test_bezier_elements_without_closure(tmesh):
    """They tile the elements in the order of their codes, and their boxes are those of their codes and levels."""
    elements = bezier_elements(tmesh)
    _check_tiling(tmesh, elements)
    assert (np.diff(elements.codes) > 0).all()
    assert (np.diff(elements.owner) >= 0).all()
    np.testing.assert_array_equal(elements.boxes, cell_boxes(tmesh.forest.first_cut, elements.levels, elements.codes))


def test_deepest_meshes_are_extracted():
    """Thirty bisections at one point: pieces one level deeper still exist, sixteen functions on each."""
    tmesh = b_lattice(3, 2)
    for _ in range(30):
        tmesh = refine(tmesh, marks_at_points(tmesh, np.array([[0.41, 0.83]]))).mesh
    elements = bezier_elements(tmesh)
    assert elements.levels.max() >= 30
    assert (elements.functions >= 0).all()
    assert elements.functions.shape[1] == 16
    _check_tiling(tmesh, elements)
