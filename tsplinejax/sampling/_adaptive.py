"""Adaptive down-sampling: keep the measured samples that a reconstruction from the others misses most."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from ..fitting import SMALLEST
from ..mesh import TMesh, refine
from ..space import to_device
from ..surface import TSpline, transfer
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
    alone. Noise and outliers attract it; where they count, take `Greville()`. Over measured data the T-mesh is refined
    with the samples, to two to four control points each, so that the surface meets every one of them and bends least
    between them: it follows detail that the given model lacks. That model comes with the samples.

    **Attributes:**

    - `start`: share of the samples that are placed before the first look.
    - `rounds`: how often the surface is reconstructed and samples are added.
    """

    start: float = 0.5
    rounds: int = 16

    def __post_init__(self) -> None:
        if not 0 < self.start <= 1 or self.rounds < 1:
            raise InputError(
                f"adaptive sampling starts with a share above 0, up to 1, and has at least one round; received "
                f"{self.start!r} and {self.rounds!r}"
            )

    def planned(self, site: Site, size: int, rng: np.random.Generator) -> tuple[TSpline, Float[np.ndarray, "size 2"]]:
        """The model over a T-mesh that follows the samples, and their places among the candidates.

        Candidates are the measured samples, or sixteen places in each Bézier element of a model.
        """
        places, values = _candidates(site, size)
        first = min(size, max(int(self.start * size), 3))
        chosen = nearest(places, Greville().places(site, first, rng), site.sides)
        over = _with_room(site, places[chosen])
        batch = -(-(size - first) // self.rounds)
        while len(chosen) < size:
            worst = _worst(over, places, values, chosen, min(batch, size - len(chosen)))
            chosen = np.concatenate([chosen, worst])
            over = _with_room(site, places[chosen])
        return over.model, places[chosen]

    def places(self, site: Site, size: int, rng: np.random.Generator) -> Float[np.ndarray, "size 2"]:
        """Places of candidates."""
        return self.planned(site, size, rng)[1]


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


def _with_room(site: Site, places: Float[np.ndarray, "m 2"]) -> Site:
    """For measured data: the model over a T-mesh in which a smooth surface meets any values at the places.

    No element holds two of them, and those that hold one are halved once more, so that there are more blending
    functions than samples everywhere: the bending energy says what the samples leave open.
    """
    if site.candidates is None or site.space.rational or site.tmesh.forest is None:
        return site
    tmesh, least = site.tmesh, SMALLEST / len(site.candidates)
    while (crowded := _holding(tmesh, places, 2, least)).any():
        tmesh = refine(tmesh, crowded).mesh
    return replace(site, model=transfer(site.model, refine(tmesh, _holding(tmesh, places, 1, least)).mesh))


def _holding(tmesh: TMesh, places: Float[np.ndarray, "m 2"], count: int, least: float) -> Bool[np.ndarray, " e"]:
    """Elements of more than the least area that hold so many places."""
    extent = np.asarray(tmesh.extent)
    cells = np.clip((places * extent).astype(np.int64), 0, extent - 1)
    held = np.bincount(tmesh.locate(cells[:, 0], cells[:, 1]), minlength=tmesh.n_elements)
    lengths = tmesh.element_boxes[:, 2:] - tmesh.element_boxes[:, :2]
    return (held >= count) & (lengths.prod(axis=1) > least)


def _worst(site: Site, places: np.ndarray, values: np.ndarray, chosen: np.ndarray, count: int) -> np.ndarray:
    """Candidates that a reconstruction from the chosen misses most; one in a Bézier element, where that is enough."""
    middle = values.mean(axis=0)
    trial = Regression(site, places[chosen], values[chosen] - middle).automatic()
    reached = surface_of(site, trial.points + middle)(places.astype(site.space.dtype))
    misses = np.linalg.norm(values - np.asarray(reached).reshape(values.shape), axis=1)
    misses[chosen] = -1.0
    order = np.argsort(-misses)
    order = order[misses[order] >= 0]
    piece = np.asarray(site.space.locator(to_device(places.astype(site.space.dtype))))
    _, first = np.unique(piece[order], return_index=True)
    return order[np.sort(first)][:count]
