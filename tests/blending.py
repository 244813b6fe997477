"""Blending functions straight from their definition, by scipy's Cox-de Boor recursion: what the kernels are held to."""

import numpy as np
from scipy.interpolate import BSpline

from tsplinejax.mesh import TMesh


def blending(tmesh: TMesh, places: np.ndarray, order: tuple[int, int] = (0, 0)) -> np.ndarray:
    """All blending functions, or derivatives, at parameters (m, 2) strictly inside the domain: (m, n)."""
    values = np.ones((len(places), tmesh.n_anchors))
    for k, local in enumerate(tmesh.local_knots):
        for axis in range(2):
            knots = np.asarray(tmesh.parameters(axis, local[axis]), float)
            if knots[0] == knots[-1]:
                values[:, k] = 0
                continue
            piece = BSpline.basis_element(knots, extrapolate=False)(places[:, axis], order[axis])
            values[:, k] *= np.nan_to_num(piece)
    return values
