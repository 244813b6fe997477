"""The one door for data: whatever a verb accepts as a measured surface."""

from typing import Any

import numpy as np

from .._errors import InputError
from ._height_map import HeightMap
from ._point_cloud import PointCloud


def as_data(data: Any) -> HeightMap | PointCloud:
    """Return measured data as a height map or a point cloud, in memory.

    **Arguments:**

    - `data`: a `HeightMap` or `PointCloud`, returned as it is; a tuple `(heights, dx, dy)`; an (m, 3) array, which is a
      point cloud x, y, z; any other 2-D array or any masked array, which is a height map of spacing 1. An array
      of exactly three columns is always taken as points: wrap a map that narrow in `HeightMap`.

    **Raises:** `InputError` for anything else.

    >>> as_data(([[1.0, 2.0], [3.0, 4.0]], 0.5, 0.25))
    HeightMap(2 rows × 2 columns, spacing=(0.5, 0.25), range=3, 100 % valid, float64)
    """
    if isinstance(data, HeightMap | PointCloud):
        return data
    if isinstance(data, tuple) and len(data) == 3 and np.ndim(data[1]) == 0 and np.ndim(data[2]) == 0:
        return HeightMap(data[0], (data[1], data[2]))
    if isinstance(data, str) or not (hasattr(data, "__array__") or isinstance(data, list | tuple)):
        raise InputError(
            "data are a HeightMap, a PointCloud, a 2-D array of heights, (heights, dx, dy) or an (m, 3) array of "
            f"points, but got {type(data).__name__}; a file is read with tsplinejax.read(path)"
        )
    if isinstance(data, np.ma.MaskedArray):
        return HeightMap(data)
    try:
        shape = np.shape(data)
    except ValueError as error:
        raise InputError(f"data must be a rectangular array, but its rows differ in length: {error}") from error
    return PointCloud(data) if len(shape) == 2 and shape[1] == 3 else HeightMap(data)
