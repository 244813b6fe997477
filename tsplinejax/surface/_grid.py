"""Regular grids over a surface, and its heights at the pixels of a map."""

import numpy as np
from jaxtyping import Float

from ._tspline import TSpline

_ROWS_AT_A_TIME = 1 << 18  # pixels whose parameters are held at a time


def heights_on_grid(surface: TSpline, shape: tuple[int, int]) -> Float[np.ndarray, "rows columns"]:
    """The surface at the pixels of a grid (rows, columns) from border to border, in its own precision.

    >>> from tsplinejax.mesh import b_lattice
    >>> from tsplinejax.space import spline_space
    >>> from tsplinejax.surface import make_surface
    >>> plane = make_surface(spline_space(b_lattice(1, 1), dtype="float64"), np.ones(16))
    >>> heights_on_grid(plane, (2, 3)).round(12).tolist()
    [[1.0, 1.0, 1.0], [1.0, 1.0, 1.0]]
    """
    heights = np.empty(shape, surface.space.dtype)
    s = np.arange(shape[1]) / max(1, shape[1] - 1)
    t = np.arange(shape[0]) / max(1, shape[0] - 1)
    rows = max(1, _ROWS_AT_A_TIME // shape[1])
    for start in range(0, shape[0], rows):
        part = t[start : start + rows]
        parameters = np.stack(np.broadcast_arrays(s[None, :], part[:, None]), axis=-1).reshape(-1, 2)
        heights[start : start + rows] = np.asarray(surface(parameters)).reshape(len(part), -1)
    return heights


def parameter_grid(rows: int, columns: int) -> Float[np.ndarray, "m 2"]:
    """The parameters of a regular grid over [0, 1]², row by row.

    >>> parameter_grid(2, 2)[1]
    array([1., 0.])
    """
    t, s = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    return np.stack([s.ravel(), t.ravel()], axis=1)
