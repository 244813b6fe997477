"""Levelling: subtract the least-squares plane, and say so."""

import numpy as np
from jaxtyping import Float

from ..data import HeightMap, PointCloud


def levelled(data: HeightMap | PointCloud) -> HeightMap | PointCloud:
    """The data without their least-squares plane z = a + b x + c y; provenance lists the operation.

    >>> x = np.arange(5.0)
    >>> levelled(HeightMap(np.add.outer(2 * x, 3 * x))).range < 1e-12
    True
    """
    samples = data.samples()
    slopes, heights = plane_of(data)
    operation = f"level plane: slopes {slopes[0]:.6g} along x and {slopes[1]:.6g} along y taken off"
    provenance = {**data.provenance, "operations": [*data.provenance.get("operations", ()), operation]}
    values = samples.values[:, 0] - heights
    if isinstance(data, PointCloud):
        points = np.column_stack([data.points[:, :2], values]).astype(data.points.dtype)
        return PointCloud(points, data.unit, triangles=data.triangles, provenance=provenance)
    grid = samples.scatter(values).astype(data.heights.dtype)
    return HeightMap(grid, data.spacing, data.unit, origin=data.origin, provenance=provenance)


def plane_of(data: HeightMap | PointCloud) -> tuple[Float[np.ndarray, " 2"], Float[np.ndarray, " m"]]:
    """Slopes (along x, along y) of the least-squares plane, and its heights at the samples."""
    samples = data.samples()
    values = samples.values[:, 0].astype(np.float64)
    columns = np.column_stack([np.ones(len(values)), samples.parameters])
    coefficients = np.linalg.lstsq(columns, values, rcond=None)[0]
    return coefficients[1:] / np.asarray(samples.frame.extent), columns @ coefficients
