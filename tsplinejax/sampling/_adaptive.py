"""Adaptive down-sampling: keep the measured samples that a reconstruction from the others misses most."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..space import to_device
from ._allocation import in_rows
from ._greville import Greville
from ._measured import nearest
from ._regression import Regression, surface_of
from ._site import Site
from ._strategies import AbstractStrategy

_CANDIDATES_A_PIECE = 16


@dataclass(frozen=True)
class Adaptive(AbstractStrategy):
    """Down-sampling by what is known: start at Greville points, then add the samples that are reconstructed worst.

    For thinning data that have been measured (or a model): a sample is kept because of its value, not of its place
    alone. Noise and outliers attract it; where they count, take `Greville()`.

    **Attributes:**

    - `start`: share of the samples that are placed before the first look.
    - `rounds`: how often the surface is reconstructed and samples are added.
    """

    start: float = 0.5
    rounds: int = 8

    def __post_init__(self) -> None:
        if not 0 < self.start <= 1 or self.rounds < 1:
            raise InputError(
                f"adaptive sampling starts with a share above 0, up to 1, and has at least one round; received "
                f"{self.start!r} and {self.rounds!r}"
            )

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Places of candidates: of the measured samples, or of sixteen in each Bézier element of a model."""
        places, values = _candidates(site, size)
        piece = np.asarray(site.space.locator(to_device(places.astype(site.space.dtype))))
        first = min(size, max(int(self.start * size), 3))
        chosen = nearest(places, Greville().places(site, first, rng), site.sides)
        batch = -(-(size - first) // self.rounds)
        while len(chosen) < size:
            misses = _misses(site, places, values, chosen)
            worst = _worst_of_each(misses, piece, min(batch, size - len(chosen)))
            chosen = np.concatenate([chosen, worst])
        return places[chosen]


def _candidates(site: Site, size: int) -> tuple[Float[np.ndarray, "c 2"], Float[np.ndarray, "c d"]]:
    """Places and values to choose from."""
    if site.candidates is not None:
        return site.candidates.parameters, site.candidates.values.astype(np.float64)
    boxes = site.pieces
    counts = np.full(len(boxes), max(_CANDIDATES_A_PIECE, -(-4 * size // len(boxes))))
    lengths = (boxes[:, 2:] - boxes[:, :2]) * site.sides
    owner, local = in_rows(counts, lengths[:, 1] / lengths[:, 0])
    places = boxes[owner, :2] + local * (boxes[owner, 2:] - boxes[owner, :2])
    return places, site.values(places).astype(np.float64)


def _misses(site: Site, places: np.ndarray, values: np.ndarray, chosen: np.ndarray) -> Float[np.ndarray, " c"]:
    """How far the reconstruction from the chosen candidates is from each; below zero for the chosen."""
    middle = values.mean(axis=0)
    trial = Regression(site, places[chosen], values[chosen] - middle).automatic()
    reached = surface_of(site, trial.points + middle)(places.astype(site.space.dtype))
    misses = np.linalg.norm(values - np.asarray(reached).reshape(values.shape), axis=1)
    misses[chosen] = -1.0
    return misses


def _worst_of_each(misses: np.ndarray, piece: np.ndarray, count: int) -> np.ndarray:
    """The candidates that are missed most, at most one in each Bézier element, where that is enough."""
    order = np.argsort(-misses)
    order = order[misses[order] >= 0]
    _, first = np.unique(piece[order], return_index=True)
    return order[np.sort(first)][:count]
