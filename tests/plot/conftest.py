"""A surface, a fit and a tolerance study to draw, made by formulas: pictures are tested without fitting anything."""

from collections.abc import Iterator
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

from tsplinejax.data import Frame, HeightMap
from tsplinejax.mesh import TMesh, b_lattice, refine

EXTENT = (2.0, 1.2)
TOLERANCE = 2e-6


def heights_at(parameters: np.ndarray) -> np.ndarray:
    """Laser bumps in millimetres, a fifth of a micrometre high, on a waviness: rims around dimples, in two rows."""
    x, y = (np.asarray(parameters) * EXTENT).T
    heights = 8e-5 * np.sin(2 * x + 1) * np.cos(3 * y)
    for column in range(4):
        for row in range(2):
            r = np.hypot(x - 0.3 - 0.46 * column, y - 0.32 - 0.55 * row)
            heights += 2e-4 * np.exp(-(((r - 0.11) / 0.035) ** 2)) - 8e-5 * np.exp(-((r / 0.05) ** 2))
    return heights


def refined_mesh(steps: int) -> TMesh:
    """A T-mesh of 10 × 6 elements, refined where the surface bends most."""
    mesh = b_lattice(10, 6)
    for _ in range(steps):
        s0, t0, s1, t1 = mesh.element_boxes.T
        corners, middle = ((s0, t0), (s1, t0), (s0, t1), (s1, t1)), ((s0 + s1) / 2, (t0 + t1) / 2)
        flat = np.mean([heights_at(np.stack(corner, 1)) for corner in corners], axis=0)
        bent = np.abs(heights_at(np.stack(middle, 1)) - flat)
        mesh = refine(mesh, bent > 8e-6).mesh
    return mesh


@pytest.fixture
def surface() -> SimpleNamespace:
    """What plots need of a `TSpline` of heights."""

    class HeightSurface(SimpleNamespace):
        def __call__(self, parameters: np.ndarray) -> np.ndarray:
            return heights_at(parameters)

    return HeightSurface(frame=Frame((0.0, 0.0), EXTENT, "mm"), space=SimpleNamespace(mesh=refined_mesh(6)))


@pytest.fixture
def surface_in_space() -> SimpleNamespace:
    """What plots need of a `TSpline` in space: half a torus."""

    class SpaceSurface(SimpleNamespace):
        def __call__(self, parameters: np.ndarray) -> np.ndarray:
            around, tube = np.pi * parameters[:, 0], np.pi * (2 * parameters[:, 1] - 0.5)
            radius = 3 + np.cos(tube)
            return np.stack([radius * np.cos(around), radius * np.sin(around), np.sin(tube)], axis=1)

        def normals(self, parameters: np.ndarray) -> np.ndarray:
            around, tube = np.pi * parameters[:, 0], np.pi * (2 * parameters[:, 1] - 0.5)
            return np.stack([np.cos(tube) * np.cos(around), np.cos(tube) * np.sin(around), np.sin(tube)], axis=1)

    return SpaceSurface(frame=Frame((-4.0, 0.0), (8.0, 4.0), "mm"), space=SimpleNamespace(mesh=b_lattice(8, 8)))


@pytest.fixture
def height_map() -> HeightMap:
    """The bumps on 200 × 333 pixels, with a hole."""
    t, s = np.meshgrid(np.linspace(0, 1, 200), np.linspace(0, 1, 333), indexing="ij")
    heights = heights_at(np.stack([s.ravel(), t.ravel()], 1)).reshape(s.shape)
    heights[np.hypot((s - 0.8) * EXTENT[0], (t - 0.75) * EXTENT[1]) < 0.09] = np.nan
    return HeightMap(heights, (EXTENT[0] / 332, EXTENT[1] / 199), "mm")


@pytest.fixture
def result(surface: SimpleNamespace, height_map: HeightMap) -> SimpleNamespace:
    """What plots need of a `FitResult`: errors within the tolerance but for a few, and two outliers set aside."""
    samples = height_map.samples()
    x, y = samples.parameters.T
    noise = np.random.default_rng(0).normal(0, 0.25, len(samples))
    residuals = TOLERANCE * (0.5 * np.sin(40 * x) * np.cos(31 * y) + noise)
    outliers = np.zeros(len(samples), bool)
    outliers[[12_000, 40_000]] = True
    residuals[outliers] = 1e-3
    history = tuple(
        SimpleNamespace(control_points=count, max_error=error, rms_error=error / 7, tolerance=stage)
        for count, error, stage in [
            (117, 2.1e-4, 4e-5),
            (310, 9.7e-5, 4e-5),
            (680, 3.6e-5, 4e-5),
            (1190, 2.3e-5, 1e-5),
            (1890, 8.1e-6, 1e-5),
            (2710, 5.2e-6, TOLERANCE),
            (3370, 1.8e-6, TOLERANCE),
        ]
    )
    return SimpleNamespace(
        surface=surface,
        samples=samples,
        residuals=residuals,
        outliers=outliers,
        history=history,
        tolerance=TOLERANCE,
        unit="mm",
    )


@pytest.fixture
def study() -> SimpleNamespace:
    """What plots need of a tolerance study."""
    return SimpleNamespace(tolerances=[2e-6, 1e-5, 2e-5], control_points=[16_000, 9_800, 9_000], unit="mm")


@pytest.fixture(autouse=True)
def _closed_figures() -> Iterator[None]:
    """No figure outlives its test."""
    yield
    plt.close("all")
