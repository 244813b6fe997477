"""Clouds of known surfaces for orthogonal fits."""

import numpy as np

import tsplinejax as tsj
from tsplinejax.mesh import b_lattice, refine
from tsplinejax.space import spline_space


def saddle(m: int = 2000, noise: float = 0.0, seed: int = 0, curvature: float = 0.6) -> np.ndarray:
    """Scattered points beside z = c (x² - y²) on [-1, 1]², displaced along normals."""
    generator = np.random.default_rng(seed)
    x, y = generator.uniform(-1, 1, (2, m))
    normal = np.stack([-2 * curvature * x, 2 * curvature * y, np.ones(m)], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    form = np.stack([x, y, curvature * (x**2 - y**2)], axis=1)
    return form + noise * generator.normal(size=(m, 1)) * normal


def known_surface() -> tsj.TSpline:
    """A T-spline in space with T-junctions, bent in all three components."""
    mesh = refine(b_lattice(3, 3), np.arange(9) == 4).mesh
    space = spline_space(mesh)
    places = np.random.default_rng(5).random((800, 2))
    s, t = places.T
    points = np.stack([2 * s + 0.1 * np.sin(3 * t), 1.5 * t + 0.1 * s * t, 0.4 * np.sin(3 * s) * np.cos(2 * t)], axis=1)
    return tsj.make_surface(space, tsj.lstsq(space, places, points))
