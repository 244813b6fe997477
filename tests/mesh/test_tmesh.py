"""T-meshes tile the parameter square, hold every point once, and are refused where they would not."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given

from tsplinejax import InputError
from tsplinejax.mesh import MAX_LEVEL, Dyadic, b_lattice, forest_from_boxes, from_rectangles, refine

from ..random_meshes import hand_given, lattices, marks_at_points, meshes, parameters, rectangles


@given(meshes(), parameters())
def test_every_parameter_lies_in_one_element(tmesh, places):
    """The half-open element boxes, closed at the domain's far ends, hold each parameter exactly once."""
    s0, t0, s1, t1 = tmesh.element_boxes.T[:, None]
    s, t = places.T[:, :, None]
    across = (s0 <= s) & ((s < s1) | ((s == 1) & (s1 == 1)))
    along = (t0 <= t) & ((t < t1) | ((t == 1) & (t1 == 1)))
    assert ((across & along).sum(axis=1) == 1).all()


@given(meshes(Dyadic()), parameters())
def test_locate_finds_that_element(tmesh, places):
    """`locate` answers with the element whose index box holds the cell."""
    cells = np.minimum((places * tmesh.extent).astype(int), np.array(tmesh.extent) - 1)
    box = tmesh.boxes[tmesh.locate(cells[:, 0], cells[:, 1])]
    assert ((box[:, :2] <= cells) & (cells < box[:, 2:])).all()


@given(meshes())
def test_areas_add_up(tmesh):
    """Elements cover the square once: areas sum to one."""
    sides = tmesh.element_boxes[:, 2:] - tmesh.element_boxes[:, :2]
    assert abs(sides.prod(axis=1).sum() - 1) < 1e-12


@given(lattices())
def test_lattice_count(tmesh):
    """A lattice of M × N elements has (M + 3)(N + 3) anchors."""
    columns, rows = tmesh.forest.lattice
    assert tmesh.n_elements == columns * rows
    assert tmesh.n_anchors == (columns + 3) * (rows + 3)


@given(meshes(Dyadic()))
def test_saved_boxes_give_the_mesh_back(tmesh):
    """A dyadic mesh is rebuilt from its boxes in any order: same elements, anchors, knots and levels."""
    shuffled = tmesh.boxes[np.random.default_rng(0).permutation(tmesh.n_elements)]
    forest = tmesh.forest
    again = forest_from_boxes(shuffled, forest.lattice, first_cut=forest.first_cut, border=tmesh.border)
    for name in ("boxes", "levels", "anchors", "local_knots"):
        np.testing.assert_array_equal(getattr(again, name), getattr(tmesh, name))


@given(rectangles())
def test_rectangles_give_themselves_back(given_boxes):
    """A mesh given by hand has the rectangles it was given."""
    np.testing.assert_array_equal(from_rectangles(given_boxes).element_boxes, given_boxes)


@given(hand_given(), parameters())
def test_hand_given_locate(tmesh, places):
    """In a mesh given by hand, too, `locate` answers with the element that holds the index cell."""
    cells = np.minimum((places * tmesh.extent).astype(int), np.array(tmesh.extent) - 1)
    box = tmesh.boxes[tmesh.locate(cells[:, 0], cells[:, 1])]
    assert ((box[:, :2] <= cells) & (cells < box[:, 2:])).all()


def test_a_lattice_by_hand_equals_the_lattice():
    """A 3 × 2 lattice written as rectangles has the local knots of `b_lattice`."""
    tmesh = b_lattice(3, 2)
    by_hand = from_rectangles(tmesh.element_boxes)
    for axis in range(2):
        knots = [mesh.parameters(axis, mesh.local_knots[:, axis]) for mesh in (tmesh, by_hand)]
        order = [np.lexsort(np.column_stack([mesh.anchors[:, ::-1]]).T) for mesh in (tmesh, by_hand)]
        np.testing.assert_allclose(knots[0][order[0]], knots[1][order[1]], atol=1e-15)


def test_open_border_continues_outwards():
    """The paper's own frame has unrepeated knots: one lattice step apart, or the last interval's width again."""
    assert b_lattice(4, 4, border="open").parameters(0, np.array([-(1 << 16)])).tolist() == [-0.25]
    uneven = from_rectangles([[0, 0, 0.2, 1], [0.2, 0, 1, 1]], border="open")
    np.testing.assert_allclose(uneven.parameters(0, np.arange(-2, 5)), [-0.4, -0.2, 0, 0.2, 1, 1.8, 2.6])


def test_meshes_do_not_change():
    """A T-mesh is a frozen value of read-only arrays."""
    tmesh = b_lattice(2, 2)
    with pytest.raises(dataclasses.FrozenInstanceError):
        tmesh.border = "open"
    for array in (tmesh.boxes, tmesh.anchors, tmesh.local_knots, tmesh.levels):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_deepest_level_is_reached_and_guarded():
    """Elements can be bisected thirty times; one more is refused."""
    tmesh = b_lattice(2, 1)
    for _ in range(MAX_LEVEL):
        tmesh = refine(tmesh, marks_at_points(tmesh, np.array([[0.3, 0.7]]))).mesh
    assert tmesh.levels.max() == MAX_LEVEL
    assert abs((tmesh.element_boxes[:, 2:] - tmesh.element_boxes[:, :2]).prod(axis=1).sum() - 1) < 1e-12
    with pytest.raises(InputError, match=f"{MAX_LEVEL} times at most"):
        refine(tmesh, tmesh.levels == MAX_LEVEL)


@pytest.mark.parametrize(
    ("given_boxes", "reason"),
    [
        ([[0, 0, 0.6, 1], [0.5, 0, 1, 1]], "overlap"),
        ([[0, 0, 1, 1], [0, 0, 1, 1]], "overlap"),
        ([[0, 0, 0.5, 1], [0.5, 0, 1, 0.5]], "gap"),
        ([[0, 0, 2, 1]], "fills"),
        ([[-0.5, 0, 1, 1]], "fills"),
        ([[0, 0, 0.5, 1]], "fills"),
        ([[0, 0, 0.5, 1], [1, 0, 0.5, 1]], "swap its corners"),
        ([[0, 0, 0.5, 1], [0.5, 0, 1, 1], [0.2, 0, 0.2, 1]], "swap its corners"),
        ([[0, 0, np.nan, 1]], "finite"),
        ([[0, 0, np.inf, 1]], "finite"),
        ([[0, 0, 1]], "one row"),
        ([0, 0, 1, 1], "one row"),
        (np.zeros((0, 4)), "one row"),
        ([["a", "b", "c", "d"]], "numbers"),
    ],
)
def test_bad_rectangles(given_boxes, reason):
    """Rectangles that overlap, leave gaps, leave the square or are none are refused with the reason."""
    with pytest.raises(InputError, match=reason):
        from_rectangles(given_boxes)


@pytest.mark.parametrize("bad", [(0, 3), (3, -1), (2.0, 2), (1 << 15, 1), ("3", 2)])
def test_bad_lattices(bad):
    """A lattice has whole numbers of elements from 1 to 16384."""
    with pytest.raises(InputError, match="lattice"):
        b_lattice(*bad)


@pytest.mark.parametrize("options", [{"first_cut": "x"}, {"border": "free"}])
def test_bad_options(options):
    """Unknown words for the first cut and the border are refused."""
    with pytest.raises(InputError, match="choose one"):
        b_lattice(2, 2, **options)


def test_unknown_border_by_hand():
    """A mesh given by hand checks its border, too."""
    with pytest.raises(InputError, match="choose one"):
        from_rectangles([[0, 0, 1, 1]], border="free")


@pytest.mark.parametrize(
    "boxes",
    [
        [[0, 0, 1 << 16, 1 << 16]],  # one square of two
        [[0, 0, 1 << 16, 1 << 16], [0, 0, 1 << 16, 1 << 16]],  # the same square twice
        [[0, 0, 1 << 15, 1 << 16], [1 << 15, 0, 1 << 16, 1 << 15], [1 << 16, 0, 2 << 16, 1 << 16]],  # a gap
        [[0, 0, 20000, 1 << 16], [20000, 0, 1 << 16, 1 << 16], [1 << 16, 0, 2 << 16, 1 << 16]],  # off the middle
        [[0, 0, 1 << 16, 1 << 15], [0, 1 << 15, 1 << 16, 1 << 16], [1 << 16, 0, 2 << 16, 1 << 16]],  # cut in t first
        [[0, 0, 1 << 16, 1 << 16], [2 << 16, 0, 3 << 16, 1 << 16]],  # outside the lattice
        [[0, 0, 2 << 16, 1 << 16]],
        [[-1, 0, 1 << 16, 1 << 16]],
        np.zeros((0, 4), int),
    ],
)
def test_bad_saved_boxes(boxes):
    """Boxes that no bisection of the lattice gives are refused: what a corrupted file could hold."""
    with pytest.raises(InputError, match=r"dyadic|bisected"):
        forest_from_boxes(np.asarray(boxes, np.int64), (2, 1), first_cut="s", border="clamped")
