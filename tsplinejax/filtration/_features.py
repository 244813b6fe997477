"""Where a map has features that a filter keeps, and the criterion that resolves them.

A feature is what a linear filter would take off by more than half of the tolerance: of a step it takes half the
height on either side, so a step is kept when it is higher than the tolerance. Around features elements are refined, not
only until no residual exceeds the tolerance, but until none stands out from the residuals elsewhere: a feature is kept
whole or not at all. Everywhere else the tolerance alone counts.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from ..data import HeightMap
from ..fitting import ToleranceCriterion
from ..fitting._discretisation import Discretisation
from ..fitting._tally import Tally
from ..mesh import TMesh

_AROUND, _FAR = 1 / 8, 3 / 8  # in cut-offs: as far as a feature reaches, and where the plain residuals begin
_STANDS_OUT = 3.5  # robust standard deviations; noise alone reaches that once in 2000 pixels
_CELL = 8  # pixels: over which residuals are looked at together
_FINE = 0.05  # of the tolerance: no feature is resolved more finely
_ENOUGH = 0.1  # share of the pixels that a robust deviation needs
_MEDIAN = 0.6744897501960817  # median of |x| for a standard normal


@dataclass(frozen=True, eq=False)
class Features:
    """Pixels at features, pixels far from them, and the standard deviation there of what is taken off."""

    at: Bool[np.ndarray, "rows columns"]
    plain: Bool[np.ndarray, "rows columns"]
    deviation: float


def find_features(
    height_map: HeightMap, removed: Float[np.ndarray, "rows columns"], tolerance: float, cutoff: float
) -> Features:
    """Find the features in what a linear filter of this cut-off takes off (NaN where missing)."""
    from scipy.ndimage import distance_transform_edt

    with np.errstate(invalid="ignore"):
        core = np.abs(removed) > tolerance / 2
    if not core.any():
        return Features(core, height_map.valid, tolerance / _STANDS_OUT)
    distance = np.asarray(distance_transform_edt(~core, sampling=height_map.spacing[::-1]))
    at = distance <= max(_AROUND * cutoff, max(height_map.spacing))
    known = height_map.valid
    plain = next(
        (part for part in (known & (distance > _FAR * cutoff), known & ~at) if part.sum() >= _ENOUGH * known.sum()),
        known,
    )
    return Features(at, plain, plain_deviation(removed[plain], tolerance))


def plain_deviation(residuals: Float[np.ndarray, " m"], tolerance: float) -> float:
    """The robust standard deviation of residuals, and no less than a part of the tolerance stands out from."""
    deviation = float(np.median(np.abs(residuals - np.median(residuals)))) / _MEDIAN
    return max(deviation, _FINE * tolerance / _STANDS_OUT)


@dataclass(frozen=True, eq=False)
class FeatureCriterion(ToleranceCriterion):
    """No residual exceeds the tolerance, nor, in elements at features, the level at which it stands out.

    **Attributes:**

    - `tolerance`, `deviation`: in the units of the fit's values; the second is of the residuals far from features.
    - `counts`: pixels at features above and left of each pixel corner, (rows + 1, columns + 1).
    - `finest`: smallest (width, height) of an element, in parameters; smaller ones are not asked for.
    """

    deviation: float
    counts: Int[np.ndarray, "rows1 columns1"]
    finest: tuple[float, float]

    @property
    def level(self) -> float:
        """The residual that stands out."""
        return min(_STANDS_OUT * self.deviation, self.tolerance)

    def resolution(self, tally: Tally) -> float:
        """The finer of both limits."""
        return self.level

    def excess(self, mesh: Discretisation, tally: Tally, dimension: int) -> Float[np.ndarray, " elements"]:
        """Largest residual over the element's own limit; one at most where it is too small to be bisected."""
        limits = np.where(self.at_features(mesh.tmesh), self.level, self.tolerance)
        excess = mesh.per_element(np.maximum, tally.largest) / limits
        return np.where(self._splittable(mesh.tmesh), excess, np.minimum(excess, 1.0))

    def excess_together(self, mesh: Discretisation, tally: Tally) -> Float[np.ndarray, " elements"]:
        """Root mean square of the residuals around each element at features, over what noise makes of it."""
        pixels = np.array(self.counts.shape[::-1]) - 1
        boxes = mesh.tmesh.element_boxes
        column, row = ((boxes[:, :2] + boxes[:, 2:]) / 2 * pixels // _CELL).astype(int).T
        cell = np.unique(row * pixels[0] + column, return_inverse=True)[1]
        squares, counts = (
            np.bincount(cell, mesh.per_element(np.add, part))[cell] for part in (tally.plain, tally.counts)
        )
        counts = np.maximum(counts, 1)
        spread = 2 / (9 * counts)
        limits = self.deviation**2 * counts * (1 - spread + _STANDS_OUT * np.sqrt(spread)) ** 3
        at_features = self.at_features(mesh.tmesh) & self._splittable(mesh.tmesh)
        return np.where(at_features, np.sqrt(squares / limits), 0.0)

    def at_features(self, tmesh: TMesh) -> Bool[np.ndarray, " elements"]:
        """Elements that hold a pixel at a feature, or lie between such pixels."""
        pixels = np.array(self.counts.shape[::-1]) - 2  # intervals along x and y
        boxes = tmesh.element_boxes * np.tile(pixels, 2)
        first = np.floor(boxes[:, :2] + 1e-9).astype(int)
        last = np.ceil(boxes[:, 2:] - 1e-9).astype(int) + 1
        (x0, y0), (x1, y1) = first.T, last.T
        counts = self.counts
        return counts[y1, x1] - counts[y0, x1] - counts[y1, x0] + counts[y0, x0] > 0

    def _splittable(self, tmesh: TMesh) -> Bool[np.ndarray, " elements"]:
        """Elements whose halves are not smaller than allowed."""
        assert tmesh.forest is not None
        sizes = tmesh.element_boxes[:, 2:] - tmesh.element_boxes[:, :2]
        cut_s = (tmesh.levels % 2 == 0) == (tmesh.forest.first_cut == "s")
        halves, least = np.where(cut_s, sizes[:, 0], sizes[:, 1]) / 2, np.where(cut_s, *self.finest)
        return halves >= least * (1 - 1e-9)


def cumulated(at: Bool[np.ndarray, "rows columns"]) -> Int[np.ndarray, "rows1 columns1"]:
    """Counts of pixels above and left of each pixel corner."""
    counts = np.zeros((at.shape[0] + 1, at.shape[1] + 1), np.int64)
    counts[1:, 1:] = at.cumsum(axis=0).cumsum(axis=1)
    return counts
