"""Normals and curvatures are physical: exact on surfaces whose geometry is known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax import Frame, HeightMap
from tsplinejax.mesh import b_lattice, refine
from tsplinejax.space import spline_space
from tsplinejax.surface import curvatures, make_surface, normals

PLACES = np.random.default_rng(2).uniform(0.02, 0.98, (50, 2))


def quadratic(coefficients, frame: Frame):
    """z = a x² + b x y + c y² over a frame, exactly, by least squares."""
    space = spline_space(b_lattice(3, 2))
    places = np.random.default_rng(0).random((400, 2))
    x, y = frame.xy_of(places).T
    a, b, c = coefficients
    return make_surface(space, tsj.lstsq(space, places, a * x**2 + b * x * y + c * y**2), frame)


def test_a_tilted_plane():
    """The normal of z = 2 x - 3 y points up along (-2, 3, 1), whatever the sides of its frame; it is not curved."""
    frame = Frame((5.0, 1.0), (10.0, 6.0))
    space = spline_space(b_lattice(2, 2))
    x, y = frame.xy_of(PLACES).T
    plane = make_surface(space, tsj.lstsq(space, PLACES, 2 * x - 3 * y), frame)
    expected = np.array([-2, 3, 1]) / np.sqrt(14)
    np.testing.assert_allclose(normals(plane, PLACES), np.tile(expected, (50, 1)), atol=1e-9)
    bent = curvatures(plane, PLACES)
    np.testing.assert_allclose(bent.mean, 0, atol=1e-9)
    np.testing.assert_allclose(bent.gaussian, 0, atol=1e-9)


def test_a_quadratic_against_its_formula():
    """Normals, H and K of z = a x² + b x y + c y² equal the textbook's, with unequal sides."""
    frame = Frame((-4.0, -1.0), (7.0, 3.0))
    a, b, c = 0.3, -0.2, 0.15
    surface = quadratic((a, b, c), frame)
    x, y = frame.xy_of(PLACES).T
    p, q, r, s, t = 2 * a * x + b * y, b * x + 2 * c * y, 2 * a, b, 2 * c
    w = 1 + p**2 + q**2
    bent = curvatures(surface, PLACES)
    np.testing.assert_allclose(bent.gaussian, (r * t - s**2) / w**2, atol=1e-9)
    np.testing.assert_allclose(bent.mean, ((1 + q**2) * r - 2 * p * q * s + (1 + p**2) * t) / (2 * w**1.5), atol=1e-9)
    up = np.stack([-p, -q, np.ones_like(p)], axis=1) / np.sqrt(w)[:, None]
    np.testing.assert_allclose(normals(surface, PLACES), up, atol=1e-9)


def test_a_sphere_cap():
    """A cap of 10 × 6 mm with dx ≠ dy has K = 1 / R² and H = -1 / R to 1e-3 (bent away from its normal)."""
    radius, dx, dy = 40.0, 10 / 120, 6 / 45
    y, x = np.mgrid[0:46, 0:121] * np.array([dy, dx])[:, None, None]
    heights = np.sqrt(radius**2 - (x - 5) ** 2 - (y - 3) ** 2)
    result = tsj.fit(HeightMap(heights, (dx, dy), "mm"), tolerance=1e-6, smoothing=0.0)
    bent = curvatures(result.surface, PLACES)
    np.testing.assert_allclose(np.asarray(bent.gaussian) * radius**2, 1, atol=1e-3)
    np.testing.assert_allclose(np.asarray(bent.mean) * radius, -1, atol=1e-3)
    x, y = result.surface.frame.xy_of(PLACES).T
    outward = np.stack([x - 5, y - 3, np.sqrt(radius**2 - (x - 5) ** 2 - (y - 3) ** 2)], axis=1) / radius
    np.testing.assert_allclose(normals(result.surface, PLACES), outward, atol=1e-5)


def test_height_maps_and_surfaces_in_space_agree():
    """The same surface as points (x, y, z) has the normals and curvatures of the height map."""
    frame = Frame((-4.0, -1.0), (7.0, 3.0))
    heights = quadratic((0.3, -0.2, 0.15), frame)
    space, places = heights.space, np.random.default_rng(0).random((400, 2))
    points = np.column_stack([frame.xy_of(places), heights(places)])
    in_space = make_surface(space, tsj.lstsq(space, places, points))
    np.testing.assert_allclose(normals(in_space, PLACES), normals(heights, PLACES), atol=1e-8)
    for name in ("mean", "gaussian"):
        first, second = (getattr(curvatures(surface, PLACES), name) for surface in (heights, in_space))
        np.testing.assert_allclose(first, second, atol=1e-8)


def test_units(dtype, tolerance_of):
    """Lengths ten times as large divide H by ten and K by a hundred, and leave normals alone; in both precisions."""
    generator = np.random.default_rng(0)
    tmesh = refine(b_lattice(2, 2), [True, False, False, False]).mesh
    points = generator.normal(size=tmesh.n_anchors)
    space = spline_space(tmesh, dtype=dtype)
    small = make_surface(space, points, Frame((0, 0), (2.0, 3.0)))
    large = make_surface(space, 10 * points, Frame((0, 0), (20.0, 30.0)))
    close = {"rtol": 100 * tolerance_of(dtype), "atol": 100 * tolerance_of(dtype)}
    np.testing.assert_allclose(normals(small, PLACES), normals(large, PLACES), **close)
    np.testing.assert_allclose(curvatures(small, PLACES).mean, 10 * curvatures(large, PLACES).mean, **close)
    np.testing.assert_allclose(curvatures(small, PLACES).gaussian, 100 * curvatures(large, PLACES).gaussian, **close)
    lengths = np.linalg.norm(np.asarray(normals(small, PLACES)), axis=1)
    np.testing.assert_allclose(lengths, 1, atol=tolerance_of(dtype))


def test_transformations():
    """Normals and curvatures pass through jit and vmap, one parameter at a time, too."""
    surface = quadratic((0.3, -0.2, 0.15), Frame())
    np.testing.assert_allclose(jax.jit(normals)(surface, PLACES), normals(surface, PLACES), atol=1e-12)
    each = jax.vmap(lambda place: normals(surface, place))(jnp.asarray(PLACES))
    np.testing.assert_allclose(each, normals(surface, PLACES), atol=1e-12)
    single = jax.vmap(lambda place: curvatures(surface, place).gaussian)(jnp.asarray(PLACES))
    np.testing.assert_allclose(single, curvatures(surface, PLACES).gaussian, atol=1e-12)


@pytest.mark.parametrize("collapsed", [0, 1])
def test_degenerate_places_have_no_normal(collapsed):
    """Where q_s and q_t are parallel the normal is NaN rather than an arbitrary direction."""
    space = spline_space(b_lattice(1, 1))
    line = np.zeros((16, 3))
    line[:, collapsed] = np.arange(16.0)
    assert np.isnan(normals(make_surface(space, line), PLACES)).all()
