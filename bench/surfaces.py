"""Surfaces for the benchmarks: the case studies at any resolution, measured ones, and a seeded random generator."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

import tsplinejax as tsj
from tsplinejax.data import laser_textured_disk, plate_with_particles, sparse_bumps, structured_with_missing

#: Measured surfaces beside the repository, not part of it.
SHARED = Path(__file__).parents[2] / "shared" / "data"
MAPS = ("mnt-2.mnt", "frt-1.frt", "tmd-1.tmd", "x3p-2.x3p", "sur-2.sur", "opd-1.opd", "SainteHelens.dem")


def case_study(name: str, size: int | None = None) -> tsj.HeightMap:
    """T1, T2, T4, T5 or T6 of the reference figures; `size` is the number of pixels along each side."""
    side = size or (2048 if name == "T5" else 512)
    makers = {
        "T1": laser_textured_disk,
        "T2": plate_with_particles,
        "T4": structured_with_missing,
        "T5": lambda shape: laser_textured_disk(shape, bumps=24, scale=0.25),
        "T6": sparse_bumps,
    }
    return makers[name]((side, side))


def jacksboro() -> tsj.HeightMap:
    """The elevation model that ships with matplotlib, as `tsplinejax demo` fits it but without units."""
    from matplotlib.cbook import get_sample_data

    with np.load(get_sample_data("jacksboro_fault_dem.npz", asfileobj=False)) as grid:
        return tsj.HeightMap(grid["elevation"].astype(float), (1.0, 1.0))


def measured(names: tuple[str, ...] = MAPS) -> Iterator[tuple[str, tsj.HeightMap]]:
    """The measured maps that are there."""
    for name in names:
        if (SHARED / name).exists():
            data = tsj.read(SHARED / name)
            assert isinstance(data, tsj.HeightMap)
            yield name, data


def random_surface(seed: int) -> tsj.HeightMap:
    """A map of 48² to 96² pixels: waves and bumps; half with an edge or a crease, half with holes, noise up to 5 %."""
    rng = np.random.default_rng(seed)
    rows, columns = rng.integers(48, 97, 2)
    y, x = np.mgrid[0:rows, 0:columns] / [[[rows - 1]], [[columns - 1]]]
    heights = np.zeros((rows, columns))
    for _ in range(rng.integers(1, 4)):
        k, phase = rng.uniform(-6, 6, 2), rng.uniform(0, 2 * np.pi)
        heights += rng.uniform(0.2, 1) * np.sin(k[0] * x + k[1] * y + phase)
    for _ in range(rng.integers(0, 6)):
        centre, radius = rng.random(2), rng.uniform(0.03, 0.3)
        heights += rng.uniform(-1, 1.5) * np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / radius**2)
    if seed % 2:
        angle = rng.uniform(0, np.pi)
        across = (x - rng.uniform(0.3, 0.7)) * np.cos(angle) + (y - rng.uniform(0.3, 0.7)) * np.sin(angle)
        heights += rng.uniform(0.5, 1.5) * (np.abs(across) * 2 if seed % 4 == 1 else (across > 0))
    heights += rng.uniform(0, 0.05) * np.ptp(heights) * rng.normal(size=heights.shape) * (seed % 8 > 0)
    if seed // 2 % 2:
        heights[_holes(rng, heights.shape, rng.uniform(0.05, 0.3))] = np.nan
    return tsj.HeightMap(heights)


def _holes(rng: np.random.Generator, shape: tuple[int, int], share: float) -> np.ndarray:
    """Blobs that cover a share of the pixels."""
    from scipy.ndimage import gaussian_filter

    field = gaussian_filter(rng.normal(size=shape), rng.uniform(1, 5))
    return field <= np.quantile(field, share)
