"""The texture as a height map, the area behind every sample, and how far the map is from the form's own surface."""

from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from ..data import HeightMap, PointCloud
from ..surface import TSpline
from ._fit_form import FittedForm
from ._methods import Formed
from ._removal import Distortion
from ._triangulation import Triangulation, grid_for, triangulate

_PLACES = 4000  # at which the distortion is taken
_SHARE = 95


def sample_areas(
    data: HeightMap | PointCloud, formed: Formed, sides: tuple[float, float]
) -> tuple[Float[np.ndarray, " m"], Triangulation | None]:
    """The form's area that each sample stands for, (m,), 0 for outliers; and a cloud's triangulation of the others."""
    inliers = ~formed.outliers
    if isinstance(data, HeightMap):
        pixel = data.spacing[0] * data.spacing[1]
        return np.where(inliers, pixel / np.maximum(np.abs(formed.normals[:, 2]), 1e-6), 0.0), None
    areas = np.zeros(len(inliers))
    triangulation = triangulate(formed.parameters[inliers] * sides)
    areas[inliers] = 1.0 if triangulation is None else triangulation.areas(formed.feet[inliers])
    if not areas.any():
        areas[inliers] = 1.0
    return areas, triangulation


def texture_map_of(
    data: HeightMap | PointCloud,
    texture: Float[np.ndarray, " m"],
    outliers: Bool[np.ndarray, " m"],
    triangulation: Triangulation | None,
) -> HeightMap | None:
    """The texture on a height map's own pixels, or resampled over the parameter rectangle; NaN where nothing is."""
    provenance = {**data.provenance, "operations": list(data.provenance.get("operations", ()))}
    if isinstance(data, HeightMap):
        heights = np.full(data.shape, np.nan)
        heights[data.valid] = np.where(outliers, np.nan, texture)
        return replace(data, heights=heights, provenance=provenance)
    if triangulation is None:
        return None
    origin, step, shape = grid_for(triangulation.places)
    heights = triangulation.on_grid(texture[~outliers], origin, step, shape)
    return HeightMap(heights, step, data.unit, origin=origin.tolist(), provenance=provenance)


def without_long_waves(
    data: HeightMap | PointCloud,
    texture: Float[np.ndarray, " m"],
    before: HeightMap,
    after: HeightMap,
    places: Float[np.ndarray, "m 2"],
) -> Float[np.ndarray, " m"]:
    """Take off at the samples what an L-filter took off the texture map."""
    mean = before.heights - after.heights
    gaps = np.isnan(mean)
    if gaps.any():
        nearest: Any = ndimage.distance_transform_edt(gaps, return_distances=False, return_indices=True)
        mean = mean[tuple(nearest)]
    if isinstance(data, HeightMap):
        return texture - mean[data.valid]
    pixels = (places - before.origin) / before.spacing
    return texture - ndimage.map_coordinates(mean, pixels.T[::-1], order=1, mode="nearest")


def distortion_of(
    data: HeightMap | PointCloud, formed: Formed, sides: tuple[float, float], inliers: Bool[np.ndarray, " m"]
) -> Distortion:
    """Area and length ratios of the form's surface to the texture map's plane."""
    chosen = np.flatnonzero(inliers)
    chosen = chosen[:: max(1, len(chosen) // _PLACES)]
    over_xy = isinstance(data, HeightMap) or (isinstance(formed.form, TSpline) and formed.form.is_height_map)
    if over_xy or isinstance(formed.form, FittedForm):
        # The map's plane is the projection along z, or along the mean normal: lengths grow by 1 / cos in one direction.
        up = np.array([0.0, 0.0, 1.0]) if over_xy else _unit(formed.normals[chosen].mean(axis=0))
        stretch = 1 / np.maximum(np.abs(formed.normals[chosen] @ up), 1e-6)
        return Distortion(_share(stretch - 1), _share(stretch - 1))
    parameters = formed.parameters[chosen]
    along, across = (
        np.asarray(formed.form.derivative(parameters, order), np.float64) / length
        for order, length in (((1, 0), sides[0]), ((0, 1), sides[1]))
    )
    E, F, G = (np.sum(a * b, axis=1) for a, b in ((along, along), (along, across), (across, across)))
    spread = np.sqrt(((E - G) / 2) ** 2 + F**2)
    lengths = np.sqrt(np.maximum(np.stack([(E + G) / 2 + spread, (E + G) / 2 - spread]), 0))
    return Distortion(_share(lengths.prod(axis=0) - 1), _share(np.abs(lengths - 1).max(axis=0)))


def _share(deviations: np.ndarray) -> float:
    return float(np.percentile(np.abs(deviations), _SHARE))


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / (np.linalg.norm(vector) or 1.0)
