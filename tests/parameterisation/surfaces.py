"""Freeform surfaces over the unit square, and how to scatter, turn and damage them."""

import numpy as np
from scipy.spatial.transform import Rotation


def saddle(u, v):
    """The paper's saddle, 1.5 (x² - y²)."""
    x, y = 2 * u - 1, 2 * v - 1
    return np.column_stack([x, y, 1.5 * (x**2 - y**2)])


def dome(u, v):
    """A cap of a sphere over a rectangle."""
    x, y = 2 * u - 1, 1.4 * v - 0.7
    return np.column_stack([x, y, np.sqrt(2 - x**2 - y**2)])


def cylinder(u, v):
    """A segment of 258°: no plane holds it without folds."""
    return np.column_stack([np.cos(4.5 * u), np.sin(4.5 * u), 2 * v])


def twist(u, v):
    """A blade that turns by 206° along its length."""
    x, angle = 3 * u, 3.6 * u
    return np.column_stack([x, (v - 0.5) * np.cos(angle), (v - 0.5) * np.sin(angle)])


def strip(u, v):
    """A wavy strip that bends in its plane."""
    angle, radius = 2.5 * u, 1 + 0.6 * v
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 0.3 * np.sin(3 * angle) * v])


SURFACES = {"saddle": saddle, "dome": dome, "cylinder": cylinder, "twist": twist, "strip": strip}


def grid(columns, rows):
    """Parameters of a full grid, row by row."""
    u, v = np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows))
    return u.ravel(), v.ravel()


def scattered(count, seed):
    """Parameters drawn at random."""
    return np.random.default_rng(seed).random((2, count))


def grid_triangles(columns, rows):
    """Two triangles a cell of `grid`, counter-clockwise in (u, v)."""
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.column_stack([corner, corner + 1, corner + columns + 1])
    upper = np.column_stack([corner, corner + columns + 1, corner + columns])
    return np.concatenate([lower, upper])


def turned(points, seed):
    """The points in another pose, and where +z went."""
    rotation = Rotation.random(rng=np.random.default_rng(seed))
    return rotation.apply(points), rotation.apply([0.0, 0.0, 1.0])


def with_holes(u, v):
    """Leave out three discs of the parameter square."""
    keep = np.ones(len(u), bool)
    for s, t, radius in ((0.3, 0.3, 0.1), (0.7, 0.6, 0.15), (0.25, 0.75, 0.06)):
        keep &= np.hypot(u - s, v - t) > radius
    return u[keep], v[keep]
