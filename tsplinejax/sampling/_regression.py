"""Least squares over a fixed space from few samples: is it well posed, and if not, how much smoothing it takes.

The samples determine the control points where BᵀB is regular and noise at the samples comes out of it hardly larger
than it went in. Fewer samples than control points determine a surface where that holds with a trace of the bending
energy, which fills what they leave open. Otherwise the energy's weight λ is that of the least predicted error on the
surface: generalised cross validation predicts m |r|² / (m - tr H)² at the samples, and where these leave gaps noise is
larger between them, by 1 + g² with the noise gain g. Traces and gains come from random signs at the samples
(Hutchinson).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..fitting import default_smoothing
from ..fitting._design import Design, energy_matrix, factorise
from ..surface import TSpline, make_surface
from ._site import Site

PROBES = 8
WELL_POSED = 3.0
#: Of the smoothing that fills gaps: little enough to leave samples that lie close together alone.
TRACE = 0.01
#: Weights tried, in decades about the trace of smoothing that fills gaps only: what lies close together needs less.
_LEAST, _MOST = -8, 6


@dataclass(frozen=True, eq=False)
class Trial:
    """A solution: control points, what random signs at the samples become, and what is left at the samples.

    `left` is m - tr H.
    """

    site: Site
    smoothing: float
    points: Float[np.ndarray, "n d"]
    responses: Float[np.ndarray, "n probes"]
    residuals: Float[np.ndarray, "m d"]
    left: float

    @cached_property
    def noise_gain(self) -> float:
        """Rms, over the whole surface, of what unit noise at the samples becomes."""
        design, shares = self.site.everywhere
        return float(
            np.sqrt(sum(shares[taken] @ ((band @ self.responses) ** 2).mean(axis=1) for taken, band in design))
        )

    @property
    def score(self) -> float:
        """The predicted error; infinite where the surface has as many degrees of freedom as samples."""
        m = len(self.residuals)
        if self.left <= 1e-6 * m:
            return np.inf
        return m * float(np.sum(self.residuals**2)) / self.left**2 * (1 + self.noise_gain**2)


class Regression:
    """Samples over a space, ready for solutions with one smoothing after the other."""

    def __init__(
        self, site: Site, places: Float[np.ndarray, "m 2"], values: Float[np.ndarray, "m d"], probes: int = PROBES
    ) -> None:
        signs = np.random.default_rng(0).choice([-1.0, 1.0], size=(len(places), probes))
        self.site, self.design = site, Design(site.space, places)
        self.energy = energy_matrix(site.space, site.model.frame)
        self.columns, self.dimension = np.concatenate([values, signs], axis=1), values.shape[1]
        self.loads = np.zeros((site.control_points, self.columns.shape[1]))
        self.seen = np.zeros(site.control_points)
        for taken, band in self.design:
            self.loads += band.T @ self.columns[taken]
            self.seen += band.sum(axis=0)

    def solved(self, smoothing: float) -> Trial | None:
        """The control points with a weight λ; `None` where they are not determined."""
        if smoothing == 0 and not (self.seen > 0).all():
            return None
        try:
            factor = factorise(self.design, self.energy if smoothing > 0 else None, smoothing, "the set")
        except InputError:
            return None
        points, d = factor.solve(self.loads), self.dimension
        left = self.columns.copy()
        for taken, band in self.design:
            left[taken] -= band @ points
        # wᵀ (I - H) w for signs w: no difference of large numbers where nearly nothing is left.
        freedom = float(np.mean(np.sum(self.columns[:, d:] * left[:, d:], axis=0)))
        return Trial(self.site, smoothing, points[:, :d], points[:, d:], left[:, :d], freedom)

    def automatic(self) -> Trial:
        """Least squares where it is well posed, else the smoothing of the least predicted error.

        Fewer samples than control points are never enough by themselves, but with a trace of smoothing they may be.

        **Raises:** `InputError` where no smoothing helps: samples on one line.
        """
        trace, found = default_smoothing(len(self.columns)), dict[float, Trial]()
        least = 0.0 if len(self.columns) >= self.site.control_points else TRACE * trace
        self._try(least, found)
        if least in found and found[least].noise_gain <= WELL_POSED:
            return found[least]
        for exponent in range(_LEAST, _MOST + 1, 2):
            self._try(trace * 10.0**exponent, found)
            if len(found) > 2 and min(found, key=lambda weight: found[weight].score) < trace * 10.0 ** (exponent - 3):
                break
        if not found:
            raise InputError(
                f"{len(self.columns)} samples do not determine a surface, with smoothing neither: do they lie on one "
                "line? Spread them over the domain"
            )
        best = min(found, key=lambda weight: found[weight].score)
        for weight in (best / 10, best * 10):
            self._try(weight, found)
        return min(found.values(), key=lambda trial: trial.score)

    def _try(self, smoothing: float, found: dict[float, Trial]) -> None:
        """Add a weight's solution, where there is one."""
        trial = None if smoothing in found else self.solved(smoothing)
        if trial is not None:
            found[smoothing] = trial


def surface_of(site: Site, points: Float[np.ndarray, "n d"]) -> TSpline:
    """The surface with these control points, in the place of the site's model."""
    return make_surface(site.space, points[:, 0] if points.shape[1] == 1 else points, site.model.frame)
