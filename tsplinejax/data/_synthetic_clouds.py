"""Synthetic point clouds: scattered Peaks, and a saddle with a random texture along its normals."""

import numpy as np

from .._errors import InputError
from ._point_cloud import PointCloud
from ._synthetic import peaks_formula


def scattered_peaks(points: int = 200_000, *, sigma: float = 0.05, seed: int = 3) -> PointCloud:
    """Scatter points over the Peaks function on [-3, 3]², with noise on z.

    The noise-free cloud over the same places is the one with `sigma=0`.

    **Arguments:**

    - `points`: how many.
    - `sigma`: standard deviation of the noise, in units of z (whose range is about 14.6).
    - `seed`: of places and noise.

    >>> scattered_peaks(1000).points.shape
    (1000, 3)
    """
    if points < 1 or not sigma >= 0:
        raise InputError(f"scattered peaks need points ≥ 1 and sigma ≥ 0, but got {points} and {sigma}")
    generator = np.random.default_rng(seed)
    x, y = 6 * generator.random((2, points)) - 3
    z = peaks_formula(x, y) + generator.normal(0.0, sigma, points)
    return PointCloud(np.stack([x, y, z], axis=1), provenance={"name": "scattered_peaks", "operations": []})


def saddle_with_texture(
    shape: tuple[int, int] = (90, 90),
    *,
    roughness: float = 0.033,
    correlation_length: float = 0.045,
    curvature: float = 1.5,
    seed: int = 0,
) -> PointCloud:
    """Make the saddle z = c (x² - y²) over [-1, 1]², displaced along its unit normals by a Gaussian process.

    The process has correlation exp(-r² / 2ℓ²) in the (x, y) plane, mean 0 and root mean square `roughness`. With
    `roughness=0` the same call gives the bare form, point by point; the texture is the distance between the two.

    **Arguments:**

    - `shape`: points along y and along x; a resolution only samples the one process of a seed.
    - `roughness`: Sq of the texture.
    - `correlation_length`: ℓ.
    - `curvature`: c.
    - `seed`: of the process.

    >>> saddle_with_texture((30, 40)).points.shape
    (1200, 3)
    """
    rows, columns = shape
    if rows < 2 or columns < 2 or not roughness >= 0 or not correlation_length >= 0.005:
        raise InputError(
            "a textured saddle needs shape ≥ (2, 2), roughness ≥ 0 and correlation_length ≥ 0.005, "
            f"but got {shape}, {roughness} and {correlation_length}"
        )
    y, x = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    texture = roughness * _gaussian_process(y[:, 0], x[0], correlation_length, seed)
    slope_x, slope_y = 2 * curvature * x, -2 * curvature * y
    steepness = np.sqrt(1 + slope_x**2 + slope_y**2)
    form = np.stack([x, y, curvature * (x**2 - y**2)], axis=-1)
    normals = np.stack([-slope_x, -slope_y, np.ones_like(x)], axis=-1) / steepness[..., np.newaxis]
    points = form + texture[..., np.newaxis] * normals
    return PointCloud(points.reshape(-1, 3), provenance={"name": "saddle_with_texture", "operations": []})


def _gaussian_process(y: np.ndarray, x: np.ndarray, correlation_length: float, seed: int) -> np.ndarray:
    """A seeded process on the grid y × x within [-1, 1]², of mean 0 and mean square 1 over that square.

    White noise on a lattice three nodes to a correlation length, spread by exp(-r² / ℓ²): the convolution of that
    kernel with itself is the correlation exp(-r² / 2ℓ²). Both are separable, so a grid costs two products.
    """
    margin = 4 * correlation_length
    nodes = np.linspace(-1 - margin, 1 + margin, int(np.ceil(6 * (1 + margin) / correlation_length)) + 1)
    noise = np.random.default_rng(seed).normal(size=(len(nodes), len(nodes)))

    def at(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        spread = [np.exp(-(((place[:, np.newaxis] - nodes) / correlation_length) ** 2)) for place in (rows, columns)]
        return spread[0] @ noise @ spread[1].T

    reference = np.linspace(-1, 1, 2 * len(nodes))
    process = at(reference, reference)
    return (at(y, x) - process.mean()) / process.std()
