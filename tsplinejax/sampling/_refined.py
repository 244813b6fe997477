"""Samples to spare spent on a finer T-mesh: the surface as it is where it lies in the space, and closer where not.

More samples than control points make a recovered surface less noisy, but leave the distance between the measured
surface and the space. A refined space contains the old one, and its own Greville points are as few as can be.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..mesh import TMesh, refine
from ..surface import TSpline, transfer
from ._greville import Greville
from ._site import Site
from ._strategies import AbstractStrategy

_ROUNDS_A_DOUBLING = 4
_CANDIDATES_AN_ELEMENT = 9


@dataclass(frozen=True)
class RefinedGreville(AbstractStrategy):
    """Greville sampling of a refinement of the T-mesh that has as many control points as there are samples.

    Elements are bisected where the model's third derivatives change most from one to the next, which is what a bicubic
    spline cannot follow. For measured surfaces with features beyond the model, and little noise; `Greville()` spends
    the same samples on the noise. Surfaces of the model's space are recovered exactly either way. The refined model
    comes with the samples.
    """

    def natural_size(self, site: Site) -> int:
        """Two samples for each control point of the given model."""
        return 2 * site.control_points

    def planned(self, site: Site, size: int, rng: np.random.Generator) -> tuple[TSpline, Float[np.ndarray, "size 2"]]:
        """The model over the refined T-mesh and its Greville points; the largest leverage where its closure left room.

        **Raises:** `InputError` for a rational model, and one whose mesh was given by hand.
        """
        if site.space.rational or site.tmesh.forest is None:
            raise InputError(
                "only polynomial T-splines over dyadic meshes are refined; sample this one by strategy 'greville'"
            )
        finest = 0.0 if site.candidates is None else _CANDIDATES_AN_ELEMENT / len(site.candidates)
        while (spare := size - site.control_points) > 0:
            scores = _changes(site)
            scores[np.prod(site.elements[:, 2:] - site.elements[:, :2], axis=1) < 2 * finest] = -1.0
            tmesh = _bisected(site.tmesh, scores, min(spare, max(site.control_points // _ROUNDS_A_DOUBLING, 1)), size)
            if tmesh is None:
                break
            site = replace(site, model=transfer(site.model, tmesh))
        return site.model, Greville().places(site, size, rng)

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Places on the refined mesh."""
        return self.planned(site, size, rng)[1]


def _bisected(tmesh: TMesh, scores: Float[np.ndarray, " e"], count: int, most: int) -> TMesh | None:
    """The mesh with about `count` elements of the highest scores bisected, and at most `most` anchors, if any."""
    order = np.argsort(-scores)[: int((scores > 0).sum())]
    count = min(count, len(order))
    while count:
        marked = np.zeros(len(scores), bool)
        marked[order[:count]] = True
        refined = refine(tmesh, marked).mesh
        if refined.n_anchors <= most:
            return refined
        count //= 2
    return None


def _changes(site: Site) -> Float[np.ndarray, " e"]:
    """What a bicubic spline misses: h³ times the third derivative's change to the neighbours, times √area."""
    boxes = site.elements
    middle, sizes = (boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]
    missed = np.zeros(len(boxes))
    for axis, order in ((0, (3, 0)), (1, (0, 3))):
        step = np.zeros_like(sizes)
        step[:, axis] = sizes[:, axis]
        ends = [np.clip(middle + way * step, 0, 1) for way in (-1, 1)]
        low, high = (np.asarray(site.model.derivative(end, order)).reshape(len(boxes), -1) for end in ends)
        missed += (sizes[:, axis] ** 3 * np.linalg.norm(high - low, axis=1)) ** 2
    return np.sqrt(missed * np.prod(sizes, axis=1))
