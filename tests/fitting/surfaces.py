"""Small seeded surfaces of many kinds: smooth, with edges or creases, with noise, with holes."""

import numpy as np

from tsplinejax import HeightMap


def random_surface(seed: int) -> tuple[HeightMap, float]:
    """A map of 48² to 96² pixels and a tolerance; even seeds have an edge or a crease, every other pair a hole."""
    generator = np.random.default_rng(seed)
    rows, columns = generator.integers(48, 97, 2)
    t, s = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    heights = sum(
        generator.normal() * np.sin(2 * np.pi * (generator.uniform(0, 3) * s + generator.uniform(0, 3) * t + phase))
        for phase in generator.random(4)
    )
    across = np.cos(seed) * s + np.sin(seed) * t - 0.4
    if seed % 2 == 0:
        heights = heights + (2 * np.tanh(across / 0.02) if seed % 4 == 0 else 6 * np.abs(across))
    noise = (seed % 6) / 100
    heights = heights + noise * np.ptp(heights) * generator.normal(size=heights.shape)
    if seed % 4 < 2:
        share, centre = generator.uniform(0.05, 0.3), generator.random(2)
        distance = np.hypot(s - centre[0], t - centre[1])
        heights = np.where(distance <= np.quantile(distance, share), np.nan, heights)
    return HeightMap(heights, (1.0, 1.0)), float(np.nanmax(heights) - np.nanmin(heights)) * (0.02 + 2 * noise)


def bump(rows: int = 60, columns: int = 80, width: float = 0.12) -> np.ndarray:
    """Heights of a Gaussian on a waviness."""
    t, s = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    return np.exp(-((s - 0.4) ** 2 + (t - 0.55) ** 2) / width**2) + 0.1 * np.sin(5 * s) * np.cos(4 * t)
