"""Noisy steps of a known edge, and what a filter makes of them: edge width, overshoot, noise left, even residual."""

from dataclasses import dataclass

import numpy as np

import tsplinejax as tsj

NEAR, FAR = 20, 30  # pixels: beside the edge, and away from it


@dataclass(frozen=True, eq=False)
class Step:
    """A step of height 1: signed distance of every pixel from the edge, in pixels, and the noise on it."""

    name: str
    distance: np.ndarray
    noise: np.ndarray

    @property
    def clean(self) -> np.ndarray:
        """The step itself."""
        return np.where(self.distance > 0, 1.0, 0.0)

    @property
    def height_map(self) -> tsj.HeightMap:
        """What is measured, with pixels of 1 µm."""
        return tsj.HeightMap(self.clean + self.noise, 1.0, "µm")


def steps(size: int, sigma: float, seed: int = 0) -> list[Step]:
    """Straight steps at 0°, 17° and 45°, and a circular one."""
    y, x = np.mgrid[0:size, 0:size] - (size - 1) / 2
    noise = sigma * np.random.default_rng(seed).normal(size=(size, size))
    found = []
    for degrees in (0, 17, 45):
        angle = np.deg2rad(degrees)
        found.append(Step(f"{degrees}°", x * np.cos(angle) + y * np.sin(angle), noise))
    return [*found, Step("circle", size / 4 - np.hypot(x, y), noise)]


def noise_left(step: Step, heights: np.ndarray) -> float:
    """Standard deviation from the step, away from edge and border."""
    away = (np.abs(step.distance) > FAR) & inner(step.distance.shape)
    return float(np.std((heights - step.clean)[away]))


def inner(shape: tuple[int, int], border: int = 8) -> np.ndarray:
    """Pixels away from the border."""
    mask = np.zeros(shape, bool)
    mask[border:-border, border:-border] = True
    return mask


def profile(step: Step, heights: np.ndarray, bin_width: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """Mean distance and mean height of bins of pixels with like distance from the edge."""
    chosen = (np.abs(step.distance) < FAR) & inner(step.distance.shape)
    bins = np.floor(step.distance[chosen] / bin_width).astype(int)
    bins -= bins.min()
    counts = np.bincount(bins)
    held = counts > 0
    distances = np.bincount(bins, step.distance[chosen])[held] / counts[held]
    return distances, np.bincount(bins, heights[chosen])[held] / counts[held]


def edge_width(step: Step, heights: np.ndarray) -> float:
    """Distance over which the mean profile rises from 10 to 90 % of the step, in pixels."""
    distances, means = profile(step, heights)
    low = np.flatnonzero(means < 0.1)[-1] if (means < 0.1).any() else 0
    high = low + 1 + int(np.argmax(means[low + 1 :] > 0.9))

    def crossing(first: int, level: float) -> float:
        share = (level - means[first]) / (means[first + 1] - means[first])
        return float(distances[first] + share * (distances[first + 1] - distances[first]))

    return crossing(high - 1, 0.9) - crossing(low, 0.1)


def overshoot(step: Step, heights: np.ndarray) -> float:
    """How far the mean profile leaves the step's two levels, as a part of its height."""
    _, means = profile(step, heights)
    return float(max(means.max() - 1, -means.min(), 0.0))


def unevenness(step: Step, heights: np.ndarray) -> float:
    """Sq of what was taken off within 20 pixels of the edge over that elsewhere."""
    rest, near, inside = step.height_map.heights - heights, np.abs(step.distance) <= NEAR, inner(step.distance.shape)
    return float(np.std(rest[near & inside]) / np.std(rest[~near & inside]))
