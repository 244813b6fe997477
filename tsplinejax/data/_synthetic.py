"""Synthetic height maps: the structured surfaces of the case studies, seeded, at any resolution.

All are formulas over the unit square, without unit; `noise` is the standard deviation of added Gaussian noise relative
to the range, `shift` and `rotation` move the pattern below the square.
"""

import math

import numpy as np

from .._errors import InputError
from ._grid import PixelGrid, Pose, add_bumps
from ._height_map import HeightMap

_NEGLIGIBLE = 40.0  # exp(-40) = 4e-18: a Gaussian's exponent below which it no longer counts


def laser_textured_disk(
    shape: tuple[int, int] = (512, 512),
    *,
    bumps: int = 6,
    scale: float = 1.0,
    height: float = 20.0,
    shift: tuple[float, float] = (0.0, 0.0),
    rotation: float = 0.0,
    noise: float = 0.0,
    noise_seed: int = 0,
) -> HeightMap:
    """Make a hard disk's laser texture: a square array of sombrero bumps, each a sharp ring rim around a dimple.

    h exp(-2 ((r - R) / w)²) - 0.4 h exp(-(r / d)² / 2) with R, w, d = 0.035, 0.012, 0.010 times `scale`.

    **Arguments:**

    - `shape`: (rows, columns).
    - `bumps`: how many bumps there are along each side of the square.
    - `scale`: size of a bump; halve it when doubling `bumps`.
    - `height`: height h of the rim.
    - `shift`, `rotation`: move the pattern, in parts of the square and radians.
    - `noise`, `noise_seed`: standard deviation relative to the range, and its seed.

    >>> laser_textured_disk((64, 64), bumps=2)
    HeightMap(64 rows × 64 columns, spacing=(0.015873, 0.015873), range=26.6045, 100 % valid, float64)
    """
    if bumps < 1 or not scale > 0:
        raise InputError(f"a laser texture needs bumps ≥ 1 and scale > 0, but got {bumps} and {scale}")
    grid = PixelGrid(shape)
    u, v = Pose(shift, rotation).seen_at(grid.u, grid.v)
    radius, width, dimple = 0.035 * scale, 0.012 * scale, 0.010 * scale
    reach = max(math.ceil((radius + 5 * width) * bumps - 0.5), 0)  # in cells of the array, beyond a point's own
    offset_u, offset_v = ((position * bumps) % 1.0 - 0.5 for position in (u, v))
    heights = np.zeros(grid.shape)
    for step_u in range(-reach, reach + 1):
        for step_v in range(-reach, reach + 1):
            squared = ((offset_u - step_u) ** 2 + (offset_v - step_v) ** 2) / bumps**2
            heights += height * np.exp(-2.0 * ((np.sqrt(squared) - radius) / width) ** 2)
            heights -= 0.4 * height * np.exp(-0.5 * squared / dimple**2)
    return grid.height_map(heights, "laser_textured_disk", noise, noise_seed)


def plate_with_particles(
    shape: tuple[int, int] = (512, 512),
    *,
    seed: int = 7,
    particles: int = 150,
    shift: tuple[float, float] = (0.0, 0.0),
    rotation: float = 0.0,
    noise: float = 0.0,
    noise_seed: int = 5,
) -> HeightMap:
    """Make a wavy plate with particles: elliptic Gaussian bumps of random size, shape and height.

    **Arguments:**

    - `shape`: (rows, columns).
    - `seed`, `particles`: which particles, and how many; 1/e radii run from 0.006 to 0.03 of the square.
    - `shift`, `rotation`: move the pattern, in parts of the square and radians.
    - `noise`, `noise_seed`: standard deviation relative to the range, and its seed.

    >>> plate_with_particles((64, 64)).shape
    (64, 64)
    """
    grid, pose = PixelGrid(shape), Pose(shift, rotation)
    u, v = pose.seen_at(grid.u, grid.v)
    heights = 0.5 * np.sin(2 * np.pi * 1.3 * u + 0.4) * np.cos(2 * np.pi * 0.9 * v)
    heights = heights + 0.3 * np.sin(2 * np.pi * (0.7 * u + 1.1 * v))
    low = np.array([0.02, 0.02, 0.006, 0.6, 0.0, 0.5])
    high = np.array([0.98, 0.98, 0.03, 1.0, np.pi, 3.0])
    drawn = low + (high - low) * np.random.default_rng(seed).random((particles, 6))
    centre_u, centre_v, long, aspect, angle, peak = drawn.T
    centre_u, centre_v = pose.place_of(centre_u, centre_v)
    peak = peak * np.sqrt(long / 0.03)
    angle = angle - rotation
    cosine, sine = np.cos(angle), np.sin(angle)

    def particle(k: int, du: np.ndarray, dv: np.ndarray) -> np.ndarray:
        along, across = du * cosine[k] + dv * sine[k], dv * cosine[k] - du * sine[k]
        return peak[k] * np.exp(-((along / long[k]) ** 2) - (across / (long[k] * aspect[k])) ** 2)

    add_bumps(heights, grid, zip(centre_u, centre_v, long * math.sqrt(_NEGLIGIBLE), strict=True), particle)
    return grid.height_map(heights, "plate_with_particles", noise, noise_seed)


def sparse_bumps(
    shape: tuple[int, int] = (512, 512),
    *,
    seed: int = 0,
    shift: tuple[float, float] = (0.0, 0.0),
    rotation: float = 0.0,
    noise: float = 0.0,
    noise_seed: int = 0,
) -> HeightMap:
    """Make 25 laser bumps on a waviness, each slightly off its place in a regular array.

    Pixels are cells of the square: the outermost centres lie half a pixel inside. Lengths are parts of 256: rims of
    radius 9 and width 4 around dimples of radius 5, 49 apart.

    **Arguments:**

    - `shape`: (rows, columns).
    - `seed`: of the bumps' displacements, 0.7 in standard deviation.
    - `shift`, `rotation`: move the pattern, in parts of the square and radians.
    - `noise`, `noise_seed`: standard deviation relative to the range, and its seed.

    >>> sparse_bumps((64, 128)).spacing
    (0.0078125, 0.015625)
    """
    grid, pose = PixelGrid(shape, cell_centred=True), Pose(shift, rotation)
    u, v = pose.seen_at(grid.u, grid.v)
    heights = 0.15 * np.sin(5 * v + 1) * np.cos(4 * u)
    across, down = np.divmod(np.arange(25), 5)
    displaced = 0.7 * np.random.default_rng(seed).normal(size=(25, 2))
    centre_v, centre_u = (30 + 49 * across + displaced[:, 0]) / 256, (30 + 49 * down + displaced[:, 1]) / 256
    centre_u, centre_v = pose.place_of(centre_u, centre_v)
    reach = (9 + 4 * math.sqrt(_NEGLIGIBLE)) / 256

    def bump(_: int, du: np.ndarray, dv: np.ndarray) -> np.ndarray:
        radius = 256 * np.hypot(du, dv)
        return np.exp(-(((radius - 9) / 4) ** 2)) - 0.5 * np.exp(-((radius / 5) ** 2))

    add_bumps(heights, grid, ((a, b, reach) for a, b in zip(centre_u, centre_v, strict=True)), bump)
    return grid.height_map(heights, "sparse_bumps", noise, noise_seed)


def step(
    shape: tuple[int, int] = (256, 256),
    *,
    height: float = 1.0,
    angle: float = 0.0,
    width: float = 0.0,
    noise: float = 0.0,
    noise_seed: int = 0,
) -> HeightMap:
    """Make a step through the middle of the square.

    **Arguments:**

    - `shape`: (rows, columns).
    - `height`: height of the step.
    - `angle`: of the step's upward direction against s (along x), in radians towards t.
    - `width`: 0 for a sharp edge, else the scale of the tanh with which the step rises, in parts of the square.
    - `noise`, `noise_seed`: standard deviation relative to the range, and its seed.

    >>> step((2, 4), height=3.0).heights
    array([[0., 0., 3., 3.],
           [0., 0., 3., 3.]])
    """
    grid = PixelGrid(shape)
    distance = (grid.v - 0.5) * math.cos(angle) + (grid.u - 0.5) * math.sin(angle)
    rise = 0.5 + 0.5 * np.tanh(distance / width) if width > 0 else np.where(distance > 0, 1.0, 0.0)
    return grid.height_map(height * rise, "step", noise, noise_seed)


def peaks_formula(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Evaluate the Peaks function, sums of Gaussians times polynomials, usually over [-3, 3]².

    >>> round(float(peaks_formula(0.0, 0.0)), 6)
    0.981012
    """
    return (
        3 * (1 - x) ** 2 * np.exp(-(x**2) - (y + 1) ** 2)
        - 10 * (x / 5 - x**3 - y**5) * np.exp(-(x**2) - y**2)
        - np.exp(-((x + 1) ** 2) - y**2) / 3
    )


def peaks(shape: tuple[int, int] = (256, 256), *, noise: float = 0.0, noise_seed: int = 0) -> HeightMap:
    """Make the Peaks function over [-3, 3]², as a map of extent 6 × 6.

    **Arguments:**

    - `shape`: (rows, columns).
    - `noise`, `noise_seed`: standard deviation relative to the range, and its seed.

    >>> peaks((3, 3)).origin
    (-3.0, -3.0)
    """
    grid = PixelGrid(shape)
    unit_map = grid.height_map(peaks_formula(6 * grid.v - 3, 6 * grid.u - 3), "peaks", noise, noise_seed)
    dx, dy = unit_map.spacing
    return HeightMap(unit_map.heights, (6 * dx, 6 * dy), origin=(-3.0, -3.0), provenance=unit_map.provenance)


def structured_with_missing(
    shape: tuple[int, int] = (512, 512),
    *,
    missing: float = 0.211,
    seed: int = 11,
    noise: float = 0.0,
    noise_seed: int = 0,
) -> HeightMap:
    """Make 8 × 8 square pillars on a waviness, of which blobs are missing.

    The complete surface is the same map with `missing=0`.

    **Arguments:**

    - `shape`: (rows, columns).
    - `missing`: share of the pixels that are NaN, in blobs of some 0.04 of the square.
    - `seed`: of the blobs.
    - `noise`, `noise_seed`: standard deviation relative to the range, and its seed.

    >>> round(float(structured_with_missing((64, 64)).valid.mean()), 3)
    0.789
    """
    if not 0 <= missing < 1:
        raise InputError(f"the missing share lies in [0, 1), but got {missing}")
    grid = PixelGrid(shape)
    u, v = grid.u, grid.v
    pillar = (np.abs((u * 8) % 1 - 0.5) < 0.27) & (np.abs((v * 8) % 1 - 0.5) < 0.27)
    complete = grid.height_map(
        np.where(pillar, 1.0, 0.0) + 0.1 * np.sin(3 * u) * np.cos(2 * v), "structured_with_missing", noise, noise_seed
    )
    if not missing:
        return complete
    blobs = _blob_field(grid, seed)
    return complete.with_mask(blobs <= np.quantile(blobs, missing))


def _blob_field(grid: PixelGrid, seed: int, size: int = 512) -> np.ndarray:
    """Low-pass noise made once at 512 × 512 and interpolated, so that a resolution only samples it."""
    noise = np.fft.rfft2(np.random.default_rng(seed).normal(size=(size, size)))
    frequency = np.hypot(np.fft.fftfreq(size)[:, np.newaxis], np.fft.rfftfreq(size)[np.newaxis, :])
    field = np.fft.irfft2(noise * np.exp(-0.5 * (frequency * 10 * np.pi) ** 2), s=(size, size))
    field = _interpolated(field, grid.u[:, 0] * (size - 1))
    return _interpolated(field.T, grid.v[0] * (size - 1)).T


def _interpolated(rows: np.ndarray, position: np.ndarray) -> np.ndarray:
    lower = np.minimum(position.astype(np.int64), len(rows) - 2)
    share = (position - lower)[:, np.newaxis]
    return rows[lower] + share * (rows[lower + 1] - rows[lower])
