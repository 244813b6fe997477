"""Rasters: what a map picture shows, reduced to no more pixels than a page can hold.

Index conventions are those of a height map: axis 0 is y, axis 1 is x, and values belong to pixel centres.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from ..data import Frame, HeightMap, PointCloud, Samples, as_data
from ..surface import parameter_grid

#: Pixels a side that are drawn at most: 300 to the inch over the height of a page's column.
MOST_PIXELS = 1200

#: What one drawn pixel shows of the values it covers: their mean, or the one largest in magnitude.
Reduction = Literal["mean", "largest"]


@dataclass(frozen=True, eq=False)
class Raster:
    """Values on a regular grid of pixels, with the place of the pixels' outer edges.

    **Arguments:**

    - `values`: NaN where nothing was measured.
    - `start`: (x, y) of the outer corner of pixel [0, 0].
    - `pixel`: (width, height) of a pixel.
    - `size`: (width, height) of the picture, which may end inside the last pixels.
    - `unit`: of x, y and the values, or `None`.
    """

    values: Float[np.ndarray, "rows columns"]
    start: tuple[float, float]
    pixel: tuple[float, float]
    size: tuple[float, float]
    unit: str | None

    @property
    def edges(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the pixels, for `imshow` with row 0 at the top."""
        rows, columns = self.values.shape
        (x, y), (width, height) = self.start, self.pixel
        return x, x + columns * width, y + rows * height, y

    def reduced(self, by: Reduction, most: int = MOST_PIXELS) -> "Raster":
        """Return the raster with at most `most` pixels a side, each standing for a block of the old ones."""
        block = tuple(-(-count // most) for count in self.values.shape)
        if block == (1, 1):
            return self
        pixel = (self.pixel[0] * block[1], self.pixel[1] * block[0])
        return replace(self, values=_reduced_blocks(self.values, block, by), pixel=pixel)


def raster_of_data(data: Any) -> Raster:
    """Return whatever is accepted as data as a raster of heights.

    >>> raster_of_data([[0.0, 1.0], [2.0, 3.0]]).size
    (2.0, 2.0)
    """
    data = as_data(data)
    return raster_of_map(data) if isinstance(data, HeightMap) else raster_of_cloud(data)


def raster_of_map(height_map: HeightMap) -> Raster:
    """Return a height map's pixels."""
    return _centred(height_map.heights, height_map.origin, height_map.spacing, height_map.unit)


def raster_of_cloud(cloud: PointCloud) -> Raster:
    """Return the mean height of a cloud's points in each pixel."""
    samples = cloud.samples()
    return raster_of_samples(samples, samples.values[:, 0], "mean")


def raster_of_samples(samples: Samples, values: Float[np.ndarray, " m"], by: Reduction) -> Raster:
    """Return one number per sample as a raster: on the samples' own grid, or else binned."""
    frame = samples.frame
    if samples.grid_shape is not None:
        rows, columns = samples.grid_shape
        spacing = (frame.extent[0] / max(columns - 1, 1), frame.extent[1] / max(rows - 1, 1))
        return _centred(samples.scatter(values), frame.origin, spacing, frame.unit)
    shape = _bin_shape(len(values), frame)
    rows, columns = shape
    index = np.minimum((samples.parameters * (columns, rows)).astype(int), (columns - 1, rows - 1))
    binned = _binned(index[:, 1] * columns + index[:, 0], values, rows * columns, by).reshape(shape)
    pixel = (frame.extent[0] / columns, frame.extent[1] / rows)
    return Raster(binned, frame.origin, pixel, frame.extent, frame.unit)


def raster_of_surface(surface: Any, most: int = 400) -> Raster:
    """Return a surface's heights (z, for a model in space) over its own frame."""
    frame = surface.frame
    rows, columns = grid_shape(frame.extent, most)
    heights = np.asarray(surface(parameter_grid(rows, columns)), dtype=np.float64)
    heights = heights.reshape(rows, columns, -1)[:, :, -1]
    return _centred(heights, frame.origin, (frame.extent[0] / (columns - 1), frame.extent[1] / (rows - 1)), frame.unit)


def grid_shape(extent: tuple[float, float], most: int) -> tuple[int, int]:
    """Return rows and columns of a grid with near-square cells and `most` points along the longer side.

    >>> grid_shape((2.0, 1.0), 100)
    (50, 100)
    """
    longest = max(extent)
    columns, rows = (max(8, round(most * length / longest)) for length in extent)
    return rows, columns


def _centred(values: np.ndarray, origin: tuple[float, float], spacing: tuple[float, float], unit: str | None) -> Raster:
    rows, columns = values.shape
    start = (origin[0] - spacing[0] / 2, origin[1] - spacing[1] / 2)
    return Raster(values, start, spacing, (columns * spacing[0], rows * spacing[1]), unit)


def _bin_shape(count: int, frame: Frame) -> tuple[int, int]:
    """Rows and columns that leave about eight samples in each bin, so that hardly any bin stays empty by chance."""
    cell = np.sqrt(8 * frame.extent[0] * frame.extent[1] / count)
    columns, rows = (int(np.clip(length / cell, 1, MOST_PIXELS)) for length in frame.extent)
    return rows, columns


def _reduced_blocks(values: np.ndarray, block: tuple[int, ...], by: Reduction) -> np.ndarray:
    counts = [-(-length // size) for length, size in zip(values.shape, block, strict=True)]
    padded = np.full([count * size for count, size in zip(counts, block, strict=True)], np.nan, values.dtype)
    padded[: values.shape[0], : values.shape[1]] = values
    blocks = padded.reshape(counts[0], block[0], counts[1], block[1])
    valid = ~np.isnan(blocks)
    covered = np.count_nonzero(valid, axis=(1, 3))
    if by == "mean":
        reduced = np.where(valid, blocks, 0).sum(axis=(1, 3), dtype=np.float64) / np.maximum(covered, 1)
    else:
        reduced = _larger(
            blocks.max(axis=(1, 3), where=valid, initial=0), blocks.min(axis=(1, 3), where=valid, initial=0)
        )
    return _where_covered(covered > 0, reduced)


def _binned(index: np.ndarray, values: np.ndarray, bins: int, by: Reduction) -> np.ndarray:
    covered = np.bincount(index, minlength=bins)
    if by == "mean":
        return _where_covered(covered > 0, np.bincount(index, values, bins) / np.maximum(covered, 1))
    highest, lowest = np.zeros(bins), np.zeros(bins)
    np.maximum.at(highest, index, values)
    np.minimum.at(lowest, index, values)
    return _where_covered(covered > 0, _larger(highest, lowest))


def _larger(highest: np.ndarray, lowest: np.ndarray) -> np.ndarray:
    """The one of two numbers that is larger in magnitude."""
    return np.where(highest >= -lowest, highest, lowest)


def _where_covered(covered: Bool[np.ndarray, "..."], values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    return np.where(covered, values, np.nan)
