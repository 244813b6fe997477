"""Freeform surfaces over the unit square, and how to scatter, turn and damage them."""

import numpy as np
from scipy.spatial.transform import Rotation

from tsplinejax import PointCloud


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


def with_faults(points, noise, seed):
    """Noise in all directions, and one point in a hundred up to 20 times that off."""
    generator = np.random.default_rng(seed)
    faulty = points + noise * generator.normal(size=points.shape)
    outlying = generator.random(len(points)) < 0.01
    faulty[outlying] += 40 * noise * (generator.random((outlying.sum(), 3)) - 0.5)
    return faulty


def mercator(columns=161, rows=121):
    """A patch of a sphere between latitudes: (longitude, ln tan(π/4 + latitude/2)) is conformal.

    Points, triangles, known parameters, and the known side ratio.
    """
    u, v = grid(columns, rows)
    longitude, latitude = 2.0 * u, 0.2 + 0.9 * v
    points = np.column_stack(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )
    height = np.log(np.tan(np.pi / 4 + latitude / 2))
    known = np.column_stack([u, (height - height[0]) / (height[-1] - height[0])])
    return points, grid_triangles(columns, rows), known, (height[-1] - height[0]) / 2.0


def facing_patch(blade):
    """What of a blade's mesh looks towards +y between z = 120 and 140: its largest piece."""
    from tsplinejax.parameterisation._triangles import pieces

    a, b, c = np.moveaxis(blade.points[blade.triangles].astype(float), 1, 0)
    normal, height = np.cross(b - a, c - a), (a + b + c)[:, 2] / 3
    chosen = (normal[:, 1] > 0.5 * np.linalg.norm(normal, axis=1)) & (height > 120) & (height < 140)
    triangles = blade.triangles[chosen]
    triangles = triangles[pieces(triangles) == 0]
    used, renumbered = np.unique(triangles, return_inverse=True)
    return PointCloud(blade.points[used], blade.unit, triangles=renumbered.reshape(-1, 3))
