"""Which fillers, in which mixture, and how far off: judged on patches that were hidden.

The mixture is convex (weights not negative, sum 1) and has the least squared error on the hidden pixels (stacking,
Breiman 1996). Places differ in how hard they are, and a few hard ones would decide alone: each counts by the inverse of
its mean square, as in any least squares whose errors differ in variance. How much the fillers disagree about a pixel
tells how uncertain it is; the hidden pixels tell how uncertain that is in figures.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import isotonic_regression, nnls

#: A filler without which the error would be larger by no more than this is left out.
_HARDLY = 1.003
_BINS, _LEAST_IN_BIN = 12, 40
#: Side in pixels of the places that are taken to be equally hard, and the share of a typical one's mean square below
#: which none counts as easier.
_PLACE, _EASIEST = 20, 0.1


def blend_weights(
    errors: Float[np.ndarray, "fillers pixels"], places: Int[np.ndarray, "pixels 2"]
) -> Float[np.ndarray, " fillers"]:
    """The convex mixture of least squared error, without fillers that hardly lower it.

    >>> blend_weights(np.array([[-0.5, -0.5], [1.5, 1.5]]), np.array([[3, 7], [3, 8]])).tolist()
    [0.75, 0.25]
    """
    kept = np.arange(len(errors))
    errors = (errors * np.sqrt(_importance(errors, places))).T
    weights, error = _convex(errors)
    while True:
        kept, weights = kept[weights > 0], weights[weights > 0]
        if len(kept) == 1:
            break
        others = np.delete(kept, np.argmin(weights))
        fewer, larger = _convex(errors[:, others])
        if larger > _HARDLY * error:
            break
        kept, weights = others, fewer
    result = np.zeros(errors.shape[1])
    result[kept] = weights
    return result


def _importance(
    errors: Float[np.ndarray, "fillers pixels"], places: Int[np.ndarray, "pixels 2"]
) -> Float[np.ndarray, " pixels"]:
    """Inverse of the mean square of a middling filler around each pixel."""
    tiles = np.unique(places // _PLACE, axis=0, return_inverse=True)[1].ravel()
    squares = np.array([np.bincount(tiles, row**2) for row in errors]) / np.bincount(tiles)
    hardness = np.median(squares, axis=0)
    if not hardness.any():
        return np.ones(len(tiles))
    hardness = hardness / hardness.max()
    return 1 / (hardness + _EASIEST * np.median(hardness[hardness > 0]))[tiles]


def _convex(errors: Float[np.ndarray, "pixels fillers"]) -> tuple[Float[np.ndarray, " fillers"], float]:
    """Weights, not negative and adding up to one, of the least mean square, and its root."""

    scale = float(np.sqrt(np.mean(errors**2)))
    if scale == 0:
        return np.eye(errors.shape[1])[0], 0.0
    heavy = 1e4 * np.sqrt(len(errors))  # the sum, as one more equation
    rows = np.vstack([errors / scale, np.full(errors.shape[1], heavy)])
    weights = nnls(rows, np.append(np.zeros(len(errors)), heavy))[0]
    weights = np.round(weights / weights.sum(), 9)
    return weights, float(np.sqrt(np.mean((errors @ weights) ** 2)))


def disagreement(
    predictions: Float[np.ndarray, "fillers pixels"], blended: Float[np.ndarray, " pixels"]
) -> Float[np.ndarray, " pixels"]:
    """Root mean square difference of the fillers from the mixture."""
    return np.sqrt(np.mean((predictions - blended) ** 2, axis=0))


@dataclass(frozen=True, eq=False)
class Calibration:
    """Standard uncertainty as a function of disagreement, rising, from the errors at the hidden pixels."""

    disagreements: Float[np.ndarray, " bins"]
    uncertainties: Float[np.ndarray, " bins"]

    def __call__(self, disagreements: Float[np.ndarray, " pixels"]) -> Float[np.ndarray, " pixels"]:
        """Standard uncertainty of each pixel; beyond all that was hidden it grows with the disagreement."""
        beyond = np.maximum(disagreements / max(self.disagreements[-1], np.finfo(float).tiny), 1)
        return beyond * np.interp(disagreements, self.disagreements, self.uncertainties)


def calibrated(disagreements: Float[np.ndarray, " pixels"], errors: Float[np.ndarray, " pixels"]) -> Calibration:
    """Root mean square errors of pixels of about the same disagreement.

    >>> calibrated(np.ones(8), np.array([1.0, -1.0] * 4))(np.array([1.0, 2.0])).tolist()
    [1.0, 2.0]
    """
    order = np.argsort(disagreements, kind="stable")
    bins = int(np.clip(len(order) // _LEAST_IN_BIN, 1, _BINS))
    parts = np.array_split(order, bins)
    middle = np.array([np.mean(disagreements[part]) for part in parts])
    squares = isotonic_regression([np.mean(errors[part] ** 2) for part in parts], weights=[len(part) for part in parts])
    return Calibration(middle, np.sqrt(squares.x))
