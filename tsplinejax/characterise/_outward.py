"""The side that is outside the material: as stated, else the winding's for meshes, and up for all other data."""

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._errors import InputError
from ..data import HeightMap, PointCloud


def checked_outward(outward: ArrayLike | None) -> Float[np.ndarray, " 3"] | None:
    """A unit vector, or nothing where nothing was said.

    **Raises:** `InputError` for anything but three finite numbers that are not all 0.

    >>> checked_outward((0, 0, 2))
    array([0., 0., 1.])
    """
    if outward is None:
        return None
    direction = np.asarray(outward, np.float64)
    length = np.linalg.norm(direction)
    if direction.shape != (3,) or not np.isfinite(length) or length == 0:
        raise InputError(f"outward is a direction of three numbers such as (0, 0, 1); received {outward!r}")
    return direction / length


def outward_side(
    normals: Float[np.ndarray, "m 3"], data: HeightMap | PointCloud, outward: Float[np.ndarray, " 3"] | None
) -> float:
    """1 where the normals of a form at the data's points look out of the material on the whole, else -1."""
    if outward is None and isinstance(data, PointCloud) and data.triangles is not None and len(data.triangles):
        a, b, c = (data.points[data.triangles[:, k]].astype(np.float64) for k in range(3))
        areas = np.cross(b - a, c - a)
        return 1.0 if np.sum(areas * normals[data.triangles[:, 0]]) >= 0 else -1.0
    direction = np.array([0.0, 0.0, 1.0]) if outward is None else outward
    return 1.0 if (normals @ direction).sum() >= 0 else -1.0
