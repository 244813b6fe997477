"""Blending functions on the Bézier elements of an analysis-suitable dyadic mesh, one knot span at a time.

The five local knots in each direction bound sixteen knot spans, and each span is a Bézier element or made of several.
Two functions with the same span (i, j) on one element would share a place in a tensor-product's order of sixteen; on an
analysis-suitable mesh no two do, so a table of sixteen columns is filled without sorting pairs. Whatever does not hold
is noticed, and the caller then cuts cells one bisection after the other instead.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from ..mesh import TMesh, bisect_cells, cell_boxes

NOBODY = np.iinfo(np.int32).max


@dataclass(frozen=True, eq=False)
class Pieces:
    """Cells of a dyadic forest in the order of their codes, and the elements of the T-mesh that hold them."""

    boxes: Int[np.ndarray, "pieces 4"]
    owner: Int[np.ndarray, " pieces"]
    levels: Int[np.ndarray, " pieces"]
    codes: Int[np.ndarray, " pieces"]

    @property
    def is_half(self) -> Bool[np.ndarray, " pieces"]:
        """Whether a piece shares its owner with another one."""
        same = self.owner[1:] == self.owner[:-1]
        return np.append(same, False) | np.append(False, same)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Blending functions and pieces they live on: which of the sixteen spans, and whether the piece fills it."""

    function: Int[np.ndarray, " pairs"]
    piece: Int[np.ndarray, " pairs"]
    slot: Int[np.ndarray, " pairs"]
    fills: Bool[np.ndarray, " pairs"]


def likely_pieces(tmesh: TMesh, elements: Int[np.ndarray, " n"]) -> Pieces:
    """Some elements, sorted, halved where the extension of a T-junction cuts them."""
    forest = tmesh.forest
    assert forest is not None
    cut = _cut_by_extensions(tmesh, elements)
    levels, codes, parent = bisect_cells(forest.levels[elements], forest.codes[elements], cut)
    halved, owner = cut[parent], elements[parent]
    boxes = tmesh.boxes[owner]
    boxes[halved] = cell_boxes(forest.first_cut, levels[halved], codes[halved])
    return Pieces(boxes, owner, levels, codes)


def _cut_by_extensions(tmesh: TMesh, elements: np.ndarray) -> np.ndarray:
    """Whether a T-junction lies on an element's middle line, at most two elements back from its middle."""
    assert tmesh.forest is not None
    boxes = tmesh.boxes
    first = 0 if tmesh.forest.first_cut == "s" else 1
    axis = np.where(tmesh.forest.levels[elements] % 2 == 0, first, 1 - first)
    middle = (boxes[elements, axis] + boxes[elements, axis + 2]) >> 1
    cut = np.zeros(len(elements), bool)
    for side in (1, 3):
        open_, at = np.arange(len(elements)), boxes[elements, side - axis]
        for _ in range(2):
            inside = (at > 0) & (at < np.array(tmesh.extent)[1 - axis[open_]])
            open_, at = open_[inside], at[inside]
            along, line, cell = axis[open_], middle[open_], at - (side == 1)
            beside = tmesh.locate(np.where(along == 0, line, cell), np.where(along == 0, cell, line))
            met = boxes[beside, along] == line
            cut[open_[met]] = True
            open_, at = open_[~met], boxes[beside, side - along][~met]
    return cut


def span_pairs(tmesh: TMesh, knots: Int[np.ndarray, "n 2 5"], pieces: Pieces) -> Pairs | None:
    """All pairs of the functions with these local knots and a piece in their supports.

    A span is a piece or made of two, as it always is on an analysis-suitable mesh; `None` where one is not.
    """
    assert tmesh.forest is not None
    lines = [np.clip(knots[:, axis], 0, tmesh.extent[axis]) for axis in range(2)]
    widths, heights = (np.diff(line, axis=1).astype(np.int32) for line in lines)
    live = np.flatnonzero((widths > 0)[:, :, None] & (heights > 0)[:, None, :])
    corner = tmesh.forest.code(lines[0][:, :4, None], lines[1][:, None, :4]).ravel().take(live)
    size = np.stack([np.repeat(widths, 4, axis=1).ravel().take(live), np.tile(heights, (1, 4)).ravel().take(live)])
    sides = np.ascontiguousarray((pieces.boxes[:, 2:] - pieces.boxes[:, :2]).T, dtype=np.int32)
    piece = np.searchsorted(pieces.codes, corner, side="right") - 1
    rest = size - sides.take(piece, axis=1)
    if (pieces.codes.take(piece) != corner).any() or (rest < 0).any():
        return None
    several = np.flatnonzero((rest[0] > 0) | (rest[1] > 0))
    other = _filled_by(tmesh, pieces, sides, piece[several], rest[:, several], size[:, several])
    if other is None:
        return None
    fills = np.ones(len(live) + len(several), bool)
    fills[several] = False
    fills[len(live) :] = False
    live = np.concatenate([live, live[several]])
    return Pairs(live >> 4, np.concatenate([piece, other]), live & 15, fills)


def _filled_by(
    tmesh: TMesh, pieces: Pieces, sides: np.ndarray, piece: np.ndarray, rest: np.ndarray, size: np.ndarray
) -> Int[np.ndarray, " n"] | None:
    """The one other piece that fills what a piece leaves of a span, on its right or above; `None` if there is none."""
    assert tmesh.forest is not None
    right = rest[0] > 0
    if (right & (rest[1] > 0)).any():
        return None
    low = pieces.boxes.take(piece, axis=0)
    corner = tmesh.forest.code(np.where(right, low[:, 2], low[:, 0]), np.where(right, low[:, 1], low[:, 3]))
    other = np.searchsorted(pieces.codes, corner, side="right") - 1
    filled = (pieces.codes.take(other) == corner) & (sides.take(other, axis=1) == np.where(rest > 0, rest, size)).all(
        axis=0
    )
    return other if filled.all() else None


def cut_in_vain(
    knots: Int[np.ndarray, "functions 2 5"], pieces: Pieces, table: Int[np.ndarray, "pieces 16"], sure: np.ndarray
) -> bool:
    """Whether some half of an element need not be one: no function alive there has a knot on the line between them.

    `sure` names halves that fill a span, which are needed for certain.
    """
    doubt = pieces.is_half
    doubt[sure] = False
    # The other half of a sure one is needed, too.
    first = np.flatnonzero(pieces.is_half)[::2]
    doubt = first[doubt[first] & doubt[first + 1]]
    low, high = pieces.boxes[doubt], pieces.boxes[doubt + 1]
    axis = (high[:, 1] > low[:, 1]).astype(np.int64)
    line = high[np.arange(len(doubt)), axis]
    needed = np.zeros(len(doubt), bool)
    for half in (doubt, doubt + 1):
        on_line = knots[table[half], axis[:, None]] == line[:, None, None]
        needed |= on_line.any(axis=(1, 2))
    return not needed.all()
