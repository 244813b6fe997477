"""Transfer: a refined space contains the old surface exactly, and only what the refinement altered changes."""

import numpy as np
import pytest
from hypothesis import given, settings

from tsplinejax import Frame, InputError
from tsplinejax.mesh import Dyadic, anchor_codes, b_lattice, from_rectangles, refine
from tsplinejax.space import spline_space
from tsplinejax.surface import make_surface, transfer

from ..blending import blending
from ..random_meshes import marks_at_points, refinements

INSIDE = np.random.default_rng(6).uniform(0.001, 0.999, (60, 2))
PLACES = np.concatenate([np.random.default_rng(5).random((60, 2)), [[0, 0], [1, 0], [0, 1], [1, 1]]])


def random_surface(tmesh, dimension: int = 1):
    """A surface with normal control points."""
    shape = (tmesh.n_anchors,) if dimension == 1 else (tmesh.n_anchors, dimension)
    return make_surface(spline_space(tmesh), np.random.default_rng(0).normal(size=shape))


@settings(max_examples=12)
@given(refinements(most=150))
def test_old_space_inside_new(history):
    """Any surface over a mesh is one over each of its refinements, to 1e-12, both borders and first cuts."""
    coarse = random_surface(history[0])
    fine = transfer(coarse, history[-1])
    before, after = (
        blending(surface.space.mesh, INSIDE) @ np.asarray(surface.control_points) for surface in (coarse, fine)
    )
    np.testing.assert_allclose(after, before, atol=1e-12)


@settings(max_examples=4)
@given(refinements(most=150))
def test_step_by_step_equals_at_once(history):
    """Transfer from step to step gives the control points of one transfer over all steps."""
    coarse = random_surface(history[0], dimension=3)
    stepped = coarse
    for tmesh in history[1:]:
        stepped = transfer(stepped, tmesh)
    at_once = transfer(coarse, history[-1])
    np.testing.assert_allclose(stepped.control_points, at_once.control_points, atol=1e-11)


@settings(max_examples=8)
@given(refinements(most=150))
def test_unaltered_functions_keep_their_control_points(history):
    """A function with the same anchor and local knots keeps its control point, so frozen ones may stay frozen."""
    old, new = history[-2:] if len(history) > 1 else history * 2
    surface = random_surface(old)
    moved = np.asarray(transfer(surface, new).control_points)
    _, before, after = np.intersect1d(
        anchor_codes(old, old.anchors), anchor_codes(new, new.anchors), return_indices=True
    )
    same = (old.local_knots[before] == new.local_knots[after]).all(axis=(1, 2))
    np.testing.assert_allclose(moved[after[same]], np.asarray(surface.control_points)[before[same]], atol=1e-12)


def test_the_frame_is_kept(dtype, tolerance_of):
    """Place, unit and precision of a surface survive the transfer."""
    frame = Frame((1.0, 2.0), (3.0, 4.0), "nm")
    tmesh = b_lattice(2, 2)
    surface = make_surface(spline_space(tmesh, dtype=dtype), np.random.default_rng(0).normal(size=25), frame)
    finer = transfer(surface, refine(tmesh, [True, False, False, True]).mesh)
    assert finer.frame == frame
    assert finer.space.dtype == dtype
    np.testing.assert_allclose(finer(PLACES), surface(PLACES), atol=tolerance_of(dtype))


def test_deep_transfer():
    """Thirty bisections at one point: the surface stays where it was."""
    tmesh = b_lattice(2, 2)
    surface = random_surface(tmesh)
    for _ in range(30):
        tmesh = refine(tmesh, marks_at_points(tmesh, np.array([[0.3, 0.7]]))).mesh
    near = np.clip(np.array([0.3, 0.7]) + 2.0 ** -np.arange(1, 33)[:, None] * np.array([0.7, -0.5]), 0, 1)
    places = np.concatenate([PLACES[:32], near])
    np.testing.assert_allclose(transfer(surface, tmesh)(places), surface(places), atol=1e-11)


def test_without_closure_spaces_are_not_nested():
    """What the closure is for: refined without it, the same blossoms no longer give the old surface."""
    worst = 0.0
    for seed in range(6):
        generator, tmesh = np.random.default_rng(seed), b_lattice(4, 4)
        surface = random_surface(tmesh)
        for _ in range(3):
            tmesh = refine(tmesh, generator.random(tmesh.n_elements) < 0.3, Dyadic()).mesh
        moved = transfer(surface, tmesh)
        worst = max(worst, float(np.abs(np.asarray(moved(PLACES) - surface(PLACES))).max()))
    assert worst > 1e-3


def test_what_cannot_be_transferred():
    """Rational surfaces, meshes by hand, other lattices and coarser meshes are refused."""
    tmesh = b_lattice(4, 4)
    surface = random_surface(tmesh)
    finer = refine(tmesh, np.arange(16) == 3).mesh
    by_hand = from_rectangles(tmesh.element_boxes)
    generator, dyadic = np.random.default_rng(1), tmesh
    for _ in range(3):
        dyadic = refine(dyadic, generator.random(dyadic.n_elements) < 0.3, Dyadic()).mesh
    for bad, target, reason in (
        (surface, b_lattice(5, 4), "refinement of its own mesh"),
        (surface, b_lattice(4, 4, first_cut="t"), "refinement of its own mesh"),
        (surface, b_lattice(4, 4, border="open"), "refinement of its own mesh"),
        (random_surface(finer), tmesh, "refinement of its own mesh"),
        (surface, by_hand, "dyadic"),
        (random_surface(by_hand), tmesh, "dyadic"),
        (random_surface(dyadic), refine(dyadic, np.ones(dyadic.n_elements, bool)).mesh, "refit"),
    ):
        with pytest.raises(InputError, match=reason):
            transfer(bad, target)
