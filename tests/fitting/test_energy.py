"""The bending energy is exact, independent of units, and does with waves what its cut-off says."""

import jax.numpy as jnp
import numpy as np
import pytest

from tsplinejax import lstsq
from tsplinejax.fitting._energy import bernstein_energy, default_smoothing, piece_energies, smoothing_for_cutoff
from tsplinejax.mesh import b_lattice, refine
from tsplinejax.space import spline_space
from tsplinejax.surface import bezier_points, make_surface, transfer

from .problems import EXTENT, bending_matrix, refined


def energy_of(tmesh, control_points: np.ndarray) -> float:
    """The energy from Bézier points."""
    space = spline_space(tmesh)
    points = bezier_points(space.tables, jnp.asarray(control_points))
    return float(piece_energies(points, space.tables.size * EXTENT)[: int(space.n_elements)].sum())


@pytest.mark.parametrize("dimension", [1, 3])
def test_energy_equals_quadrature(dimension):
    """∫ |f_xx|² + 2 |f_xy|² + |f_yy|² equals Gauss quadrature of scipy's second derivatives."""
    tmesh = refined()
    points = np.random.default_rng(0).normal(size=(tmesh.n_anchors, dimension))
    expected = np.einsum("id,ij,jd->", points, bending_matrix(tmesh), points)
    assert energy_of(tmesh, points) == pytest.approx(expected, rel=1e-11)


def test_element_matrices_add_up_to_the_energy():
    """The element matrices are the same quadratic form."""
    tmesh = refined()
    space, n = spline_space(tmesh), tmesh.n_anchors
    tables = space.tables
    along = [np.asarray(part) for part in (tables.along_s, tables.along_t)]
    basis = np.einsum("eka,ekb->ekab", *along).reshape(*along[0].shape[:2], 16)
    matrices = np.einsum("eia,eab,ejb->eij", basis, bernstein_energy(tables.size * EXTENT), basis)
    functions, matrix = np.asarray(tables.functions), np.zeros((n, n))
    np.add.at(matrix, (functions[:, :, None], functions[:, None]), matrices)
    expected = bending_matrix(tmesh)
    np.testing.assert_allclose(matrix, expected, atol=1e-11 * np.abs(expected).max())


def test_energy_does_not_depend_on_the_mesh():
    """The same surface over a refined mesh has the same energy: what keeps a smoothed fit monotone."""
    tmesh = b_lattice(2, 3)
    surface = make_surface(spline_space(tmesh), np.random.default_rng(0).normal(size=tmesh.n_anchors))
    finer = refine(refine(tmesh, np.arange(6) % 2 == 0).mesh, np.arange(9) % 2 == 0).mesh
    moved = np.asarray(transfer(surface, finer).control_points)
    before = energy_of(tmesh, np.asarray(surface.control_points)[:, None])
    assert energy_of(finer, moved[:, None]) == pytest.approx(before, rel=1e-11)


def test_planes_cost_nothing():
    """A plane has no bending energy, to round-off of a rough surface's."""
    tmesh = refined()
    greville = [tmesh.parameters(axis, tmesh.local_knots[:, axis, 1:4]).mean(axis=1) for axis in range(2)]
    rough = energy_of(tmesh, np.random.default_rng(0).normal(size=(tmesh.n_anchors, 1)))
    assert abs(energy_of(tmesh, (greville[0] - 2 * greville[1] + 3)[:, None])) < 1e-14 * rough


def test_a_known_energy():
    """z = x²/2 over a rectangle of unit area has the energy 1."""
    space = spline_space(b_lattice(2, 2))
    places = np.random.default_rng(0).random((200, 2))
    points = lstsq(space, places, 0.5 * (EXTENT[0] * places[:, 0]) ** 2)
    assert energy_of(b_lattice(2, 2), np.asarray(points)[:, None]) == pytest.approx(1.0, rel=1e-9)


def test_cut_off():
    """A wave of the cut-off length is passed by one half, as 1 / (1 + (λc / L)⁴)."""
    space, count, cutoff = spline_space(b_lattice(24, 1)), 241, 0.5
    s, t = (grid.ravel() for grid in np.meshgrid(np.linspace(0, 1, count), np.linspace(0, 1, 9)))
    weight = smoothing_for_cutoff(cutoff, len(s))
    middle = np.abs(s - 0.5) < 0.25
    for length in (0.25, 0.5):
        wave = np.cos(2 * np.pi * (s - 0.5) / length)
        smoothed = np.asarray(space_values(space, lstsq(space, np.stack([s, t], 1), wave, smoothing=weight), s, t))
        passed = (smoothed[middle] @ wave[middle]) / (wave[middle] @ wave[middle])
        assert passed == pytest.approx(1 / (1 + (cutoff / length) ** 4), abs=0.04)


def space_values(space, points, s, t):
    """Values of a surface over a space."""
    return make_surface(space, points)(np.stack([s, t], axis=1))


def test_default_smoothing_is_a_trace():
    """The default weight's cut-off lies below the samples' mean distance, so it only fills what they leave open."""
    weights = [default_smoothing(count) for count in (100, 10_000, 1_000_000)]
    assert weights == sorted(weights, reverse=True)
    assert default_smoothing(10_000) == smoothing_for_cutoff(0.3 / 100, 10_000)
