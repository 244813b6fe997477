"""A T-spline through every pixel of a complete map.

One control point a pixel and one more at either end, on a lattice whose elements are the squares between pixels. The
conditions are a product of those along x and those along y, so the solve is two passes of one banded factorisation
each; at the border the second derivative is zero, which makes the curve along each line the one of least ∫ f″².
"""

import numpy as np
from scipy.interpolate import make_interp_spline

from .._errors import InputError
from ..data import HeightMap
from ..mesh import b_lattice
from ..space import spline_space
from ..surface import TSpline, make_surface


def interpolate(height_map: HeightMap) -> TSpline:
    """The bicubic T-spline through every pixel of a map without missing ones.

    **Raises:** `InputError` for a map with missing pixels, or of fewer than two rows or columns.

    >>> surface = interpolate(HeightMap(np.arange(12.0).reshape(3, 4) ** 2))
    >>> round(float(surface.at(2.0, 1.0)), 9)
    36.0
    """

    frame, (rows, columns) = height_map.frame, height_map.shape
    if not height_map.valid.all():
        raise InputError(
            f"a surface through every pixel needs a complete map; {int((~height_map.valid).sum())} are missing; fill "
            "them first: fill_missing(height_map, exact=True, border=True)"
        )
    points = height_map.heights.astype(np.float64)
    for count in (rows, columns):  # each pass leaves the other direction in front
        points = make_interp_spline(np.arange(float(count)), points, k=3, bc_type="natural").c.T
    tmesh = b_lattice(columns - 1, rows - 1)
    space = spline_space(tmesh, dtype=height_map.heights.dtype, rational=False)
    across, down = (tmesh.anchors[:, axis] // tmesh.frame + 1 for axis in range(2))  # from one before the border
    return make_surface(space, points[down, across], frame)
