"""Where a fit's samples come from: held in memory, or stored elsewhere and read page by page."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import jax
import numpy as np
from jaxtyping import Bool, Float

from ..data import Frame, NoiseEstimate, Samples, StoredMap
from ..mesh import TMesh
from ._criteria import FLOOR, noise_variance
from ._engines import AbstractEngine
from ._pages import page_side, paged_samples
from ._samples import AbstractSamples, grid_samples, scattered_samples
from ._tiles import LANES


@dataclass(frozen=True, eq=False)
class Scaling:
    """Values are fitted centred and scaled: value = offset + factor · fitted. Metres in float32 are safe."""

    offset: Float[np.ndarray, " d"]
    factor: float


class AbstractSource(ABC):
    """Samples, what they add up to, and how they get onto the device."""

    @property
    @abstractmethod
    def frame(self) -> Frame:
        """The physical place of the parameter square."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """1 for heights, 3 for points in space."""

    @property
    @abstractmethod
    def dtype(self) -> np.dtype:
        """The number format of the values."""

    @property
    @abstractmethod
    def n_samples(self) -> int:
        """Number of samples, outliers included."""

    @property
    @abstractmethod
    def n_counted(self) -> int:
        """Number of samples that are neither outliers nor of weight zero."""

    @property
    @abstractmethod
    def signal(self) -> tuple[float, float]:
        """Σ |v|² of the samples that count, as they are and with their mean removed: the signals of the two SNRs."""

    @property
    @abstractmethod
    def range(self) -> float:
        """Largest minus smallest value of those that count; for points in space the diagonal of their box."""

    @property
    @abstractmethod
    def scaling(self) -> Scaling:
        """Centred on the mean of the samples that count, in units of their range (the diagonal of their box)."""

    @abstractmethod
    def prepare(self, start: TMesh, noise: NoiseEstimate | None, dtype: np.dtype) -> AbstractSamples:
        """The samples scaled and ready for the device, over a mesh's lattice."""


@dataclass(frozen=True, eq=False)
class HeldSource(AbstractSource):
    """Samples in memory, and which of them are set aside as outliers."""

    samples: Samples
    outliers: Bool[np.ndarray, " m"]

    @property
    def frame(self) -> Frame:
        """The samples'."""
        return self.samples.frame

    @property
    def dimension(self) -> int:
        """The samples'."""
        return self.samples.dimension

    @property
    def dtype(self) -> np.dtype:
        """The samples'."""
        return self.samples.values.dtype

    @property
    def n_samples(self) -> int:
        """The samples'."""
        return len(self.samples)

    @cached_property
    def counted(self) -> Bool[np.ndarray, " m"]:
        """Samples that count."""
        return ~self.outliers if self.samples.weights is None else ~self.outliers & (self.samples.weights > 0)

    @cached_property
    def n_counted(self) -> int:
        """Counted once."""
        return int(self.counted.sum())

    @cached_property
    def signal(self) -> tuple[float, float]:
        """Summed once."""
        values = self.samples.values[self.counted].astype(np.float64)
        return float(np.sum(values**2)), float(np.sum((values - values.mean(axis=0)) ** 2))

    @cached_property
    def range(self) -> float:
        """Found once."""
        return float(np.linalg.norm(np.ptp(self.samples.values[self.counted].astype(np.float64), axis=0)))

    @cached_property
    def scaling(self) -> Scaling:
        """Found once."""
        values = self.samples.values[self.counted].astype(np.float64)
        return Scaling(values.mean(axis=0), self.range if self.range > 0 else 1.0)

    def prepare(self, start: TMesh, noise: NoiseEstimate | None, dtype: np.dtype) -> AbstractSamples:
        """As pixels where they come from a grid, else sorted."""
        data, scaling, weights = self.samples, self.scaling, None
        if data.weights is not None or not self.counted.all():
            weights = np.where(self.counted, 1.0 if data.weights is None else data.weights, 0.0)
        variance = None if noise is None else noise_variance(noise, data, scaling.factor)
        values = (data.values.astype(np.float64) - scaling.offset) / scaling.factor
        tile, shape = tile_of(len(data)), data.grid_shape
        if shape is None or not _on_grid(data, shape):
            return scattered_samples(start, data.parameters, values, weights, variance, dtype=dtype, tile=tile)
        index = None if len(data) == shape[0] * shape[1] else data.grid_index
        return grid_samples(start, shape, index, values, weights, variance, dtype=dtype, tile=tile)


@dataclass(frozen=True, eq=False)
class StoredSource(AbstractSource):
    """A map that is read page by page, within a budget of memory in bytes, here or by an engine."""

    stored: StoredMap
    max_memory: float
    engine: AbstractEngine | None = None

    @property
    def frame(self) -> Frame:
        """The map's."""
        return self.stored.frame

    @property
    def dimension(self) -> int:
        """Heights."""
        return 1

    @property
    def dtype(self) -> np.dtype:
        """The map's, or float64 for whole numbers."""
        return self.stored.dtype

    @property
    def n_samples(self) -> int:
        """Valid pixels."""
        return self.stored.statistics.count

    @property
    def n_counted(self) -> int:
        """Valid pixels."""
        return self.stored.statistics.count

    @property
    def signal(self) -> tuple[float, float]:
        """From the map's statistics."""
        found = self.stored.statistics
        return found.centred + found.count * found.mean**2, found.centred

    @property
    def range(self) -> float:
        """The map's."""
        return self.stored.range

    @property
    def scaling(self) -> Scaling:
        """From the map's statistics."""
        return Scaling(np.array([self.stored.statistics.mean]), self.range if self.range > 0 else 1.0)

    def prepare(self, start: TMesh, noise: NoiseEstimate | None, dtype: np.dtype) -> AbstractSamples:
        """Pages of a size that suits the budget."""
        scaling = self.scaling
        return paged_samples(
            start,
            self.stored,
            float(scaling.offset[0]),
            scaling.factor,
            None if noise is None else max(noise.sigma / scaling.factor, FLOOR) ** 2,
            side=page_side(self.max_memory / (1 if self.engine is None else self.engine.pages_held)),
            dtype=dtype,
            tile=tile_of(self.n_samples),
            engine=self.engine,
        )


def tile_of(n_samples: int) -> int:
    """Blocks of sixteen samples in a tile: a power of two that suits the number of samples and the device."""
    largest = 1024 if jax.default_backend() == "cpu" else 65536
    return int(np.clip(2 ** np.ceil(np.log2(n_samples / LANES + 1)), 64, largest))


def _on_grid(data: Samples, shape: tuple[int, int]) -> bool:
    """Whether the samples are pixels of their grid, each at most once, in order and in their places."""
    index = data.grid_index
    if index is None or min(shape) < 2 or not (np.diff(index) > 0).all():
        return False
    places = np.stack([index % shape[1] / (shape[1] - 1), index // shape[1] / (shape[0] - 1)], axis=1)
    return np.array_equal(places, data.parameters)
