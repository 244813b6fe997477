"""Planar parameters: the points' places in a plane, scaled to [0, 1]²."""

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from .._errors import InputError
from ._points import best_turn, cloud_of, direction, faces, smallest_box
from ._result import Parameterisation


def planar(data: Any, *, axes: Literal["xy", "plane"] = "xy", outward: ArrayLike = (0.0, 0.0, 1.0)) -> Parameterisation:
    """Project points on a plane, and scale their bounding rectangle there to [0, 1]².

    **Arguments:**

    - `data`: a `PointCloud`, an (m, 3) array of points, or a `HeightMap`, of which the valid pixels count.
    - `axes`: `"xy"`: s along x and t along y. `"plane"`: the least-squares plane; the rectangle is the smallest one
      around the points, s runs along its side nearest to +x, and s × t looks to the outward side.
    - `outward`: direction (x, y, z) out of the material; only `"plane"` uses it.

    **Raises:** `InputError` for points on one line, in space or seen along z (`"xy"`), and for unknown axes.

    >>> planar([[0, 0, 5], [2, 0, 6], [0, 1, 7]]).parameters
    array([[0., 0.],
           [1., 0.],
           [0., 1.]])
    """
    cloud = cloud_of(data)
    towards = direction(outward)
    if axes == "xy":
        samples = cloud.samples()
        return Parameterisation(samples.parameters, samples.frame.extent, "planar", cloud.unit)
    if axes != "plane":
        raise InputError(f'axes are "xy" or "plane", but got {axes!r}')
    points = cloud.points.astype(np.float64)
    centred = points - points.mean(axis=0)
    basis = np.linalg.svd(centred, full_matrices=False)[2]
    upright, warning = faces(basis[2], towards)
    normal = basis[2] if upright else -basis[2]
    first = basis[0]
    plane = np.stack([first, np.cross(normal, first)])
    box = smallest_box(centred @ plane.T) @ plane
    origin, right, _, up = np.roll(box, -best_turn(box), axis=0)
    edges = np.stack([right - origin, up - origin])
    lengths = np.linalg.norm(edges, axis=1)
    parameters = (centred - origin) @ edges.T / lengths**2
    return Parameterisation(
        np.clip(parameters, 0.0, 1.0),
        (float(lengths[0]), float(lengths[1])),
        "planar",
        cloud.unit,
        warnings=() if warning is None else (warning,),
    )
