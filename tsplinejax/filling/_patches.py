"""Patches of known pixels that are hidden to see how well they are filled: shaped like the map's holes, in like places.

A hole is drawn with the chance of its area, moved to where all its pixels are known, and of several such places that
one is taken whose rim resembles the hole's own: a dropout on a steep flank is judged on flanks.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import binary_dilation

from ._holes import labelled

#: Draws a patch, of which some find no place; and the share of the known pixels that may be hidden at once.
_DRAWS, _MOST_SHARE = 3, 0.08
_TRIES, _PLACES, _LEAST_FREE = 200, 12, 0.75
#: Sides of a patch at most: what is deeper is told by the same coarse shapes.
_LARGEST = 48


@dataclass(frozen=True, eq=False)
class Holes:
    """The holes to fill, pixel by pixel in the order of their numbers."""

    missing: Bool[np.ndarray, "rows columns"]

    @cached_property
    def pixels(self) -> Int[np.ndarray, "m 2"]:
        """Places of all missing pixels, hole after hole."""
        numbers, _ = labelled(self.missing)
        places = np.argwhere(self.missing)
        return places[np.argsort(numbers[self.missing], kind="stable")]

    @cached_property
    def starts(self) -> Int[np.ndarray, " holes_and_one"]:
        """Where each hole begins among the pixels."""
        numbers, count = labelled(self.missing)
        return np.concatenate([[0], np.cumsum(np.bincount(numbers[self.missing], minlength=count + 1)[1:])])

    def drawn(self, rng: np.random.Generator) -> Int[np.ndarray, "k 2"]:
        """A hole, drawn by its area; of a large one a part."""
        pixel = int(rng.integers(len(self.pixels)))
        hole = int(np.searchsorted(self.starts, pixel, side="right")) - 1
        shape = self.pixels[self.starts[hole] : self.starts[hole + 1]]
        near = np.abs(shape - self.pixels[pixel]).max(axis=1) <= _LARGEST // 2
        return shape[near]


def hidden_patches(
    heights: Float[np.ndarray, "rows columns"],
    missing: Bool[np.ndarray, "rows columns"],
    rng: np.random.Generator,
    most: int,
    most_patches: int,
) -> tuple[Bool[np.ndarray, "rows columns"], list[float]]:
    """Known pixels to hide, about `most` of them, and for each patch how many times as uneven its hole's rim is as its
    own; none where the known pixels leave no room.

    **Arguments:**

    - `heights`: the map, NaN where missing.
    - `missing`: which of the missing pixels are to be filled.
    - `rng`: draws holes and places.
    - `most`: pixels to hide; at most a twelfth of those known.
    - `most_patches`: how many patches at most.
    """
    known = np.isfinite(heights)
    limit = min(most, int(_MOST_SHARE * known.sum()))
    holes, hidden = Holes(missing), np.zeros(heights.shape, bool)
    count, ratios = 0, []
    for _ in range(_DRAWS * most_patches):
        if count >= limit or len(ratios) >= most_patches:
            break
        shape = holes.drawn(rng)
        found = _like_place(heights, known & ~hidden, shape, rng)
        if found is not None:
            place, ratio = found
            place = place[known[place[:, 0], place[:, 1]]]
            ratios.append(ratio)
            hidden[place[:, 0], place[:, 1]] = True
            count += len(place)
    return hidden, ratios


def _like_place(
    heights: np.ndarray, free: np.ndarray, shape: Int[np.ndarray, "k 2"], rng: np.random.Generator
) -> tuple[Int[np.ndarray, "k 2"], float] | None:
    """The shape moved to where every pixel is free and the rim most like its own, and the ratio of their unevenness."""
    size = shape.max(axis=0) - shape.min(axis=0) + 1
    room = np.array(heights.shape) - size
    corner = shape.min(axis=0)
    at_border = (corner == 0) | (corner == room)
    if (room < 2).any() or at_border.all():
        return None
    # What touches the border moves along it; what does not keeps off it.
    corners = np.where(at_border, corner, rng.integers(1, room, (_TRIES, 2)))
    places = (shape - corner)[None] + corners[:, None]
    shares = free[places[..., 0], places[..., 1]].mean(axis=1)
    fits = np.flatnonzero(shares == 1)[:_PLACES]
    if not len(fits):  # a crowded map: other holes may touch it
        fits = np.flatnonzero(shares >= _LEAST_FREE)[:_PLACES]
    if not len(fits):
        return None
    rim = _rim(shape)
    own = _unevenness(heights, rim)
    others = np.array([_unevenness(heights, rim + (corners[k] - corner)) for k in fits])
    if not np.isfinite(own):
        return places[fits[0]], 1.0
    others = np.nan_to_num(others)
    least = 1e-9 * max(own, float(others.max())) + np.finfo(float).tiny
    ratios = (own + least) / (others + least)
    best = int(np.argmin(np.abs(np.log(ratios))))
    return places[fits[best]], float(ratios[best])


def _rim(shape: Int[np.ndarray, "k 2"]) -> Int[np.ndarray, "r 2"]:
    """Pixels beside a shape, two wide."""

    low = shape.min(axis=0) - 2
    inside = np.zeros(shape.max(axis=0) - low + 3, bool)
    inside[tuple((shape - low).T)] = True
    return np.argwhere(binary_dilation(inside, iterations=2) & ~inside) + low


def _unevenness(heights: np.ndarray, places: Int[np.ndarray, "r 2"]) -> float:
    """Standard deviation of the known heights at places."""
    inside = places[np.all((places >= 0) & (places < heights.shape), axis=1)]
    values = heights[inside[:, 0], inside[:, 1]]
    values = values[np.isfinite(values)]
    return float(values.std()) if len(values) > 1 else float("nan")
