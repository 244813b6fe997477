"""Small models and maps for the tests of sampling: refined around a few bumps, so that elements differ in size."""

from functools import lru_cache

import numpy as np
from scipy.interpolate import RectBivariateSpline

import tsplinejax as tsj
from tsplinejax.data import laser_textured_disk
from tsplinejax.mesh import TMesh


def refined_mesh(columns: int = 5, rows: int = 4, seed: int = 0) -> TMesh:
    """A lattice refined four times around two places."""
    tmesh = tsj.b_lattice(columns, rows)
    centres = np.random.default_rng(seed).random((2, 2))
    for _ in range(4):
        s0, t0, s1, t1 = tmesh.element_boxes.T
        marked = [(s0 <= s) & (s < s1) & (t0 <= t) & (t < t1) for s, t in centres]
        tmesh = tsj.refine(tmesh, np.logical_or(*marked)).mesh
    return tmesh


def random_model(dimension: int = 1, dtype: str = "float64", frame: tsj.Frame | None = None) -> tsj.TSpline:
    """Random control points over a refined mesh."""
    space = tsj.spline_space(refined_mesh(), dtype=dtype)
    n = int(space.n_functions)
    points = np.random.default_rng(1).normal(size=(n,) if dimension == 1 else (n, dimension))
    return tsj.make_surface(space, points, frame or tsj.Frame((3.0, -1.0), (2.0, 1.5), "mm"))


@lru_cache
def structured() -> tuple[tsj.HeightMap, tsj.TSpline]:
    """A map of one laser bump in micrometres, spacing unequal, and its model to 1 %."""
    heights = laser_textured_disk((128, 128), bumps=1, scale=3.0).heights
    data = tsj.HeightMap(heights, (0.5, 0.4), "µm", origin=(10.0, -5.0))
    return data, tsj.fit(data, relative_tolerance=0.01).surface


@lru_cache
def _between_pixels() -> RectBivariateSpline:
    """The bump on a map four times as fine."""
    axis = np.linspace(0, 1, 509)
    return RectBivariateSpline(axis, axis, laser_textured_disk((509, 509), bumps=1, scale=3.0).heights)


def measured(places: np.ndarray) -> np.ndarray:
    """The structured map's surface at any parameters, also between its pixels."""
    return _between_pixels()(places[:, 1], places[:, 0], grid=False)
