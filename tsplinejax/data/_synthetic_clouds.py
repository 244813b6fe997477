"""Synthetic point clouds: scattered Peaks, a saddle with a random texture, a milled freeform scanned with faults."""

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

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


def freeform_artefact(
    points: int = 120_000,
    *,
    roughness: float = 0.139,
    outliers: float = 0.01,
    density: float = 2.0,
    rotation: ArrayLike | None = None,
    shift: ArrayLike = (0.0, 0.0, 0.0),
    seed: int = 0,
) -> PointCloud:
    """Make a milled freeform as a scanner sees it, in millimetres: tool marks, three holes, outliers and dust.

    The form is a cubic polynomial over 100 × 80 mm with 30 mm of sag. Marks of a ball-nose mill, |cos| cusps 4 mm apart
    and slightly oblique, are added along its unit normals; mean 0, root mean square `roughness`. The dust is one
    cluster of points 1.5 mm wide, up to 1.5 mm above the marks. With `roughness=0` or `outliers=0` the same call gives
    the form, or the faultless scan, point by point.

    **Arguments:**

    - `points`: before those in the holes are left out.
    - `roughness`: Sq of the marks.
    - `outliers`: share of the points that are displaced, in any direction by up to 2.8 mm; 0 also leaves the
      dust away.
    - `density`: how many times as dense the points are where x > 0.
    - `rotation`, `shift`: pose: a (3, 3) rotation matrix, and a displacement after it.
    - `seed`: of the outliers.

    >>> freeform_artefact(2000)
    PointCloud(1861 points, diagonal=131.688 mm, float64)
    """
    if points < 100 or not roughness >= 0 or not 0 <= outliers < 1 or not density > 0:
        raise InputError(
            "a freeform artefact needs points ≥ 100, roughness ≥ 0, 0 ≤ outliers < 1 and density > 0, "
            f"but got {points}, {roughness}, {outliers} and {density}"
        )
    x, y = _places_without_holes(points, density)
    u, v = x / 50, y / 40
    height, slope_x, slope_y = _sag(u, v)
    normals = np.stack([-slope_x / 50, -slope_y / 40, np.ones_like(x)], axis=1)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cusps = (np.abs(np.cos(np.pi * (y + 0.12 * x) / 4)) - 2 / np.pi) / np.sqrt(0.5 - 4 / np.pi**2)
    cloud = np.stack([x, y, height], axis=1) + roughness * cusps[:, None] * normals
    if outliers:
        _add_faults(cloud, np.hypot(x + 30, y + 22), normals, outliers, 20 * 0.139, seed)
    cloud = cloud @ (np.eye(3) if rotation is None else np.asarray(rotation, np.float64)).T + np.asarray(shift)
    return PointCloud(cloud, "mm", provenance={"name": "freeform_artefact", "operations": []})


def _places_without_holes(points: int, density: float) -> Float[np.ndarray, "2 m"]:
    """An even sequence (Roberts 2018) over 100 × 80, denser where x > 0, without what falls into three holes."""
    dense = round(points * density / (1 + density))
    index = np.concatenate([np.arange(dense), np.arange(points - dense)])
    first, second = (0.5 + index[:, None] * (0.7548776662466927, 0.5698402909980532)).T % 1.0
    x = 50 * np.where(np.arange(points) < dense, first, -first)
    y = 80 * second - 40
    holes = ((-25.0, 14.0, 7.0), (16.0, -15.0, 9.0), (30.0, 20.0, 5.0))
    outside = np.logical_and.reduce([np.hypot(x - a, y - b) > radius for a, b, radius in holes])
    return np.stack([x[outside], y[outside]])


def _sag(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heights of the artefact's form in mm, 30 between the lowest and the highest, and their slopes in u and v."""
    scale = 30 / 1.6123
    height = scale * (0.8 * u**2 - 0.5 * v**2 + 0.3 * u * v + 0.15 * u * v**2 + 0.18 * u**3)
    slope_u = scale * (1.6 * u + 0.3 * v + 0.15 * v**2 + 0.54 * u**2)
    slope_v = scale * (-v + 0.3 * u + 0.3 * u * v)
    return height, slope_u, slope_v


def _add_faults(
    cloud: np.ndarray, from_dust: np.ndarray, normals: np.ndarray, share: float, reach: float, seed: int
) -> None:
    """Displace a share of the points in any direction, and lift a cluster of dust; changes the cloud in place."""
    generator = np.random.default_rng(seed)
    chosen = generator.random(len(cloud)) < share
    direction = generator.normal(size=(len(cloud), 3))
    direction *= reach * generator.random((len(cloud), 1)) / np.linalg.norm(direction, axis=1, keepdims=True)
    lift = np.where(from_dust < 0.75, 1.0 + 0.5 * generator.random(len(cloud)), 0.0)
    cloud += np.where(chosen[:, None], direction, lift[:, None] * normals)


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
