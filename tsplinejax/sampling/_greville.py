"""Greville sampling: one sample for each blending function, further ones where the surface is least certain.

The Greville point of a blending function is the mean of its three inner knots in each direction, where it is largest or
nearly so. Collocation there recovers a T-spline of an analysis-suitable mesh exactly.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..fitting import default_smoothing
from ..fitting._design import Design
from ..mesh import TMesh
from ._regression import Regression
from ._site import Site
from ._strategies import AbstractStrategy

_PROBES = 16
_ROUNDS_A_DOUBLING = 2


@dataclass(frozen=True)
class Greville(AbstractStrategy):
    """One sample at each blending function's Greville point: a T-spline is recovered exactly from n samples.

    Further samples go where noise at those so far would show most on the surface (the largest leverage b(x)ᵀ (BᵀB)⁻¹
    b(x), by batches: a G-optimal design); fewer are every so-manieth along a curve that fills the square.

    **Attributes:**

    - `centres`: after the Greville points come the elements' centres, which then belong to the natural size.
    """

    centres: bool = False

    def natural_size(self, site: Site) -> int:
        """The number of control points, and that of the elements with their centres."""
        return site.control_points + (len(site.elements) if self.centres else 0)

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Greville points, then centres if asked for, then those of the largest leverage."""
        places = thinned(greville_points(site.tmesh), size)
        if self.centres and size > len(places):
            boxes = site.elements
            places = np.concatenate([places, thinned((boxes[:, :2] + boxes[:, 2:]) / 2, size - len(places))])
        return grown(site, places, size)


def greville_points(tmesh: TMesh) -> Float[np.ndarray, "n 2"]:
    """The Greville points of a T-mesh's blending functions, in the order of its anchors, in [0, 1]².

    Source: W. J. Gordon, R. F. Riesenfeld, B-spline curves and surfaces, 1974, where they are called nodes.

    >>> from tsplinejax.mesh import b_lattice
    >>> [round(float(s), 3) for s in np.unique(greville_points(b_lattice(3, 1))[:, 0])]
    [0.0, 0.111, 0.333, 0.667, 0.889, 1.0]
    """
    knots = [tmesh.parameters(axis, tmesh.local_knots[:, axis, 1:4]) for axis in (0, 1)]
    return np.clip(np.stack([along.mean(axis=1) for along in knots], axis=1), 0, 1)


def thinned(places: Float[np.ndarray, "m 2"], size: int) -> Float[np.ndarray, "k 2"]:
    """At most `size` of the places, taken evenly along their order."""
    m = len(places)
    return places if size >= m else places[((np.arange(size) + 0.5) * m / size).astype(int)]


def grown(site: Site, places: Float[np.ndarray, "m 2"], size: int) -> Float[np.ndarray, "size 2"]:
    """The places, and as many of the largest leverage as are missing."""
    boxes = site.pieces
    along = int(np.ceil(np.sqrt(size / len(boxes)))) + 1
    inside = (np.stack(np.meshgrid(*2 * [np.arange(along)], indexing="ij"), axis=-1).reshape(-1, 2) + 0.5) / along
    candidates = boxes[:, None, :2] + inside * (boxes[:, None, 2:] - boxes[:, None, :2])
    # Evaluated once: the same blending functions whatever has been chosen.
    bands = list(Design(site.space, candidates.reshape(-1, 2)))
    free = np.ones(candidates.shape[:2], bool)
    while len(places) < size:
        batch = min(size - len(places), max(len(places) // _ROUNDS_A_DOUBLING, 1), len(boxes))
        responses = _responses(site, places)
        leverage = np.concatenate([((band @ responses) ** 2).mean(axis=1) for _, band in bands]).reshape(free.shape)
        leverage[~free] = -1.0
        best = leverage.argmax(axis=1)
        element = np.argsort(-leverage[np.arange(len(boxes)), best])[:batch]
        free[element, best[element]] = False
        places = np.concatenate([places, candidates[element, best[element]]])
    return places


def _responses(site: Site, places: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "n probes"]:
    """Control points of random signs at the places: their mean square at x is the leverage there, in expectation."""
    regression = Regression(site, places, np.zeros((len(places), 0)), _PROBES)
    trial = regression.solved(default_smoothing(len(places)))
    assert trial is not None  # the energy fills what samples spread like these leave open
    return trial.responses
