"""Foot points: exact on surfaces of known geometry, at borders too, and differentiable."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.mesh import AnalysisSuitable, Dyadic, b_lattice, refine
from tsplinejax.space import spline_space

PLACES = np.random.default_rng(0).random((300, 2))


def wave(dtype=np.float64, refinement=None, offset: float = 0.0) -> tsj.TSpline:
    """A surface in space over a refined mesh."""
    mesh = refine(b_lattice(3, 3), np.arange(9) % 3 == 1, refinement or AnalysisSuitable()).mesh
    space = spline_space(mesh, dtype=dtype)
    places = np.random.default_rng(1).random((600, 2))
    points = np.column_stack([4 * places[:, 0], 3 * places[:, 1], np.sin(3 * places[:, 0]) * places[:, 1]])
    return tsj.make_surface(space, tsj.lstsq(space, places, points) + np.asarray(offset))


def displaced(surface: tsj.TSpline, spread: float = 0.05) -> tuple[np.ndarray, np.ndarray]:
    """Points beside a surface, and how far along its normals."""
    distances = np.random.default_rng(2).uniform(-spread, spread, len(PLACES))
    feet, normals = (np.asarray(part, np.float64) for part in (surface(PLACES), tsj.normals(surface, PLACES)))
    return feet + distances[:, None] * normals, distances


@pytest.mark.parametrize("refinement", [AnalysisSuitable(), Dyadic()])
def test_points_beside_a_surface_find_their_way_back(refinement):
    """Points displaced along normals return to where they came from, on polynomial and rational surfaces."""
    surface = wave(refinement=refinement)
    points, distances = displaced(surface)
    found = tsj.project(surface, points)
    assert found.converged_fraction == 1
    np.testing.assert_allclose(found.distances, distances, atol=1e-12)
    np.testing.assert_allclose(found.parameters, PLACES, atol=1e-9)
    np.testing.assert_allclose(found.points, surface(PLACES), atol=1e-9)


def test_single_precision_far_from_zero():
    """float32 holds far from the origin, because distances are taken about the points' middle."""
    surface = wave()
    points, distances = displaced(surface)
    moved = tsj.make_surface(spline_space(surface.space.mesh, dtype="float32"), surface.control_points + 100.0)
    found = tsj.project(moved, points + 100.0)
    # The control points themselves are rounded to 1e-7 of 100.
    np.testing.assert_allclose(found.distances, distances, atol=3e-5)


def test_a_height_map_is_a_surface_over_its_frame():
    """On z = 2 x the distance of a point is known, in the unit of the frame, with sides that differ."""
    frame = tsj.Frame((5.0, -1.0), (4.0, 2.0))
    space = spline_space(b_lattice(2, 2))
    x, y = frame.xy_of(PLACES).T
    ramp = tsj.make_surface(space, tsj.lstsq(space, PLACES, 2 * x), frame)
    inner = (PLACES[:, 0] > 0.3) & (PLACES[:, 0] < 0.7)
    points = np.column_stack([x, y, 2 * x + 0.5])[inner]
    found = tsj.project(ramp, points)
    np.testing.assert_allclose(found.distances, 0.5 / np.sqrt(5), atol=1e-10)
    np.testing.assert_allclose(found.normals, np.tile(np.array([-2, 0, 1]) / np.sqrt(5), (len(points), 1)), atol=1e-10)


def test_points_past_the_border():
    """A point past the border has its foot on it and is said to be beyond; its distance is the normal part."""
    flat = tsj.make_surface(spline_space(b_lattice(2, 2)), np.zeros(25))
    found = tsj.project(flat, [[1.5, 0.5, 0.25], [0.5, 0.5, -1.0], [-1.0, 3.0, 0.0]])
    np.testing.assert_allclose(found.parameters, [[1, 0.5], [0.5, 0.5], [0, 1]], atol=1e-12)
    np.testing.assert_allclose(found.distances, [0.25, -1.0, 0.0], atol=1e-12)
    assert found.beyond.tolist() == [True, False, True]


def test_gradients_against_finite_differences():
    """Derivatives of distances are the normals; those of parameters agree with differences, and under `jit`."""
    surface = wave()
    points = jnp.asarray(displaced(surface)[0][:6])

    def distances(points):
        return tsj.project(surface, points).distances

    slopes = jax.jacrev(distances)(points)
    np.testing.assert_allclose(np.einsum("iij->ij", slopes), tsj.project(surface, points).normals, atol=1e-8)
    direction = np.random.default_rng(3).normal(size=points.shape)

    def mean_parameter(points):
        return jnp.sum(tsj.project(surface, points).parameters * jnp.arange(12).reshape(6, 2))

    difference = (mean_parameter(points + 1e-5 * direction) - mean_parameter(points - 1e-5 * direction)) / 2e-5
    np.testing.assert_allclose(jnp.vdot(jax.grad(mean_parameter)(points), direction), difference, rtol=1e-6)
    np.testing.assert_allclose(jax.jit(distances)(points), distances(points), atol=1e-10)


def test_gradients_with_respect_to_control_points():
    """Moving all control points by one vector changes each distance by minus its normal component."""
    surface = wave()
    points = displaced(surface)[0][:6]

    def moved(vector):
        there = tsj.TSpline(
            surface.space, surface.control_points + vector, surface.origin, surface.extent, surface.unit
        )
        return tsj.project(there, points).distances

    np.testing.assert_allclose(jax.jacfwd(moved)(jnp.zeros(3)), -tsj.project(surface, points).normals, atol=1e-8)


@pytest.mark.parametrize(
    ("points", "said"),
    [([[0, 0]], r"shape \(m, 3\)"), ([[0, 0, np.nan]], "finite"), ([["a", "b", "c"]], "real numbers")],
)
def test_bad_points(points, said):
    """Points of another shape, NaN and text are refused."""
    with pytest.raises(tsj.InputError, match=said):
        tsj.project(wave(), points)


def test_bad_options():
    """A tolerance of zero, no iterations, and starts of another shape are refused."""
    surface, points = wave(), np.zeros((2, 3))
    for options in ({"tolerance": 0}, {"max_iterations": 0}, {"initial": np.zeros((3, 2))}):
        with pytest.raises(tsj.InputError):
            tsj.project(surface, points, **options)


def test_no_points():
    """An empty set has empty feet."""
    assert tsj.project(wave(), np.zeros((0, 3))).points.shape == (0, 3)
