"""Noise of scattered points: residuals of polynomials fitted to each point's nearest neighbours."""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from ._differences import dense_level

_CENTRES = 6000
_NEIGHBOURS = 40
_DEGREES = (1, 2, 3)


def scattered_noise(points: Float[np.ndarray, "m 3"], *, in_space: bool = False) -> Float[np.ndarray, " degrees"]:
    """Noise levels about local polynomials of degree 1, 2 and 3; they agree where noise is all that is left.

    At 6 000 centres, spread evenly over the points, a polynomial of the place is fitted to the 40 nearest points. The
    level is the densest value of the residuals' standard deviations, degrees of freedom allowed for.

    **Arguments:**

    - `points`: (m, 3), place x, y and height.
    - `in_space`: measure heights along each neighbourhood's own normal, for points of a surface in space.

    **Returns:** (3,), NaN where there are too few points.

    >>> rng = np.random.default_rng(0)
    >>> x, y = rng.random((2, 5000))
    >>> level = scattered_noise(np.stack([x, y, np.sin(x) + rng.normal(0, 0.1, 5000)], axis=1))
    >>> bool(np.all(np.abs(level - 0.1) < 0.01))
    True
    """
    count = min(_NEIGHBOURS, len(points))
    if len(points) < 12:
        return np.full(len(_DEGREES), np.nan)
    places = points if in_space else points[:, :2]
    scale = np.ptp(places, axis=0)
    scale = scale.max() if in_space else np.where(scale > 0, scale, 1.0)
    tree = KDTree(places / scale)
    centres = np.unique(np.linspace(0, len(points) - 1, min(_CENTRES, len(points))).astype(int))
    around = points[tree.query(tree.data[centres], k=count)[1]].astype(np.float64)
    around = around - around.mean(axis=1, keepdims=True)
    if in_space:
        frames = np.linalg.eigh(np.einsum("mki,mkj->mij", around, around))[1][:, :, ::-1]
        around = around @ frames
    return np.array([_level(around, degree) for degree in _DEGREES])


def _level(around: Float[np.ndarray, "m k 3"], degree: int) -> float:
    """The densest residual standard deviation about polynomials of a degree."""
    size = np.abs(around[:, :, :2]).max(axis=1, keepdims=True)
    place = around[:, :, :2] / np.where(size > 0, size, 1.0)
    terms = [place[:, :, 0] ** i * place[:, :, 1] ** j for i in range(degree + 1) for j in range(degree + 1 - i)]
    design = np.stack(terms, axis=2)
    freedom = design.shape[1] - design.shape[2]
    if freedom < 4:
        return float("nan")
    basis = np.linalg.qr(design)[0]
    heights = around[:, :, 2]
    residuals = heights - np.einsum("mkt,mt->mk", basis, np.einsum("mkt,mk->mt", basis, heights))
    # The median of a chi-square of f degrees of freedom is f (1 − 2 / (9 f))³.
    return dense_level(np.sqrt((residuals**2).sum(axis=1) / (freedom * (1 - 2 / (9 * freedom)) ** 3)))
