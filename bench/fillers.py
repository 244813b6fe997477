"""Other ways to fill holes of a height map: each takes heights with NaN and gives heights at the missing pixels."""

from collections.abc import Callable

import numpy as np

Fill = Callable[[np.ndarray, tuple[float, float]], np.ndarray]
_MOST_LEVELS = 12


def biharmonic(heights: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """scikit-image's biharmonic inpainting; it scales nothing, so heights come to it in [0, 1]."""
    from skimage.restoration import inpaint_biharmonic

    missing = np.isnan(heights)
    low, span = np.nanmin(heights), np.ptp(heights[~missing]) or 1.0
    scaled = np.where(missing, 0, (heights - low) / span)
    return inpaint_biharmonic(scaled, missing, split_into_regions=True)[missing] * span + low


def linear(heights: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """scipy's linear interpolation over a Delaunay triangulation; nearest neighbours beyond it."""
    from scipy.interpolate import griddata

    known, missing, values = _scattered(heights, spacing)
    result = griddata(known, values, missing, method="linear")
    beyond = np.isnan(result)
    if beyond.any():
        result[beyond] = griddata(known, values, missing[beyond], method="nearest")
    return result


def nearest(heights: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """scipy's nearest neighbour: surfalize's own fill, unless it is asked for scipy's linear interpolation."""
    from scipy.interpolate import griddata

    known, missing, values = _scattered(heights, spacing)
    return griddata(known, values, missing, method="nearest")


def radial(heights: np.ndarray, spacing: tuple[float, float], neighbours: int = 50) -> np.ndarray:
    """scipy's thin-plate spline through the nearest known pixels of each missing one."""
    from scipy.interpolate import RBFInterpolator

    known, missing, values = _scattered(heights, spacing)
    beside = _beside(np.isnan(heights))[~np.isnan(heights)]  # others are never among the neighbours
    return RBFInterpolator(known[beside], values[beside], neighbors=min(neighbours, int(beside.sum())))(missing)


def multilevel(heights: np.ndarray, spacing: tuple[float, float]) -> np.ndarray:
    """Multilevel B-spline approximation (Lee, Wolberg & Shin 1997): each level halves the lattice's spacing and fits
    what the levels before left, down to a pixel.
    """
    known, missing, values = _scattered(heights, spacing)
    extent = np.array([(n - 1) * step for n, step in zip(heights.shape[::-1], spacing, strict=True)])
    known, missing = known / extent, missing / extent
    mean = values.mean()
    rest, result = values - mean, np.full(len(missing), mean)
    shorter = extent.min()
    for level in range(_MOST_LEVELS):
        cells = np.maximum(np.round(extent / shorter).astype(int), 1) * 2**level
        lattice = _lattice(known, rest, cells)
        rest, result = rest - _evaluated(lattice, known), result + _evaluated(lattice, missing)
        if (cells >= np.array(heights.shape[::-1]) - 1).all():
            break
    return result


def _lattice(places: np.ndarray, values: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Control points of one level: each is the mean of what the samples around ask of it, weighted by w²."""
    index, weights = _weights(places, cells)
    shares = values[:, None] * weights / (weights**2).sum(axis=1, keepdims=True)
    size = int(np.prod(cells + 3))
    above = np.bincount(index.ravel(), (weights**2 * shares).ravel(), size)
    below = np.bincount(index.ravel(), (weights**2).ravel(), size)
    return (above / np.where(below > 0, below, 1)).reshape(cells + 3)


def _evaluated(lattice: np.ndarray, places: np.ndarray) -> np.ndarray:
    """One level's spline at places."""
    index, weights = _weights(places, np.array(lattice.shape) - 3)
    return (lattice.ravel()[index] * weights).sum(axis=1)


def _weights(places: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The sixteen control points around each place, and their cubic B-splines there."""
    scaled = places * cells
    cell = np.minimum(scaled.astype(int), cells - 1)
    u = scaled - cell
    cubic = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3], axis=-1) / 6
    steps = np.arange(4)
    index = (cell[:, 0, None, None] + steps[:, None]) * (cells[1] + 3) + cell[:, 1, None, None] + steps
    return index.reshape(-1, 16), (cubic[:, 0, :, None] * cubic[:, 1, None, :]).reshape(-1, 16)


def _scattered(heights: np.ndarray, spacing: tuple[float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (x, y) of known and of missing pixels, and the known heights."""
    missing = np.isnan(heights)
    places = [np.argwhere(part)[:, ::-1] * np.array(spacing) for part in (~missing, missing)]
    return places[0], places[1], heights[~missing]


def _beside(missing: np.ndarray, within: int = 8) -> np.ndarray:
    """Pixels within some pixels of a missing one."""
    from scipy.ndimage import distance_transform_edt

    return distance_transform_edt(~missing) <= within


PEERS: dict[str, Fill] = {
    "biharmonic": biharmonic,
    "linear": linear,
    "nearest": nearest,
    "thin plate, 50 neighbours": radial,
    "multilevel B-splines": multilevel,
}
