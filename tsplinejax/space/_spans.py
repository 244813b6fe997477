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
    lines = tmesh.boxes.ravel()  # line k of element e is at 4 e + k
    first = 0 if tmesh.forest.first_cut == "s" else 1
    axis = np.where(tmesh.forest.levels[elements] % 2 == 0, first, 1 - first)
    middle = (lines.take(4 * elements + axis) + lines.take(4 * elements + axis + 2)) >> 1
    end = np.array(tmesh.extent).take(1 - axis)
    cut = np.zeros(len(elements), bool)
    for side in (1, 3):
        left, at = np.arange(len(elements)), lines.take(4 * elements + side - axis)
        for _ in range(2):
            inside = np.flatnonzero((at > 0) & (at < end.take(left)))
            left, at = left.take(inside), at.take(inside)
            along, line, cell = axis.take(left), middle.take(left), at - (side == 1)
            beside = 4 * tmesh.locate(np.where(along == 0, line, cell), np.where(along == 0, cell, line))
            met = lines.take(beside + along) == line
            cut[left[met]] = True
            left, at = left[~met], lines.take(beside + side - along)[~met]
    return cut


@dataclass(frozen=True, eq=False)
class Layout:
    """The way from piece to piece, and the table that a walk over the functions' spans fills.

    **Attributes:**

    - `sides`: widths and heights of the pieces.
    - `beyond`: the pieces that start at their lower right and at their upper left corners.
    - `table`: sixteen functions a piece, or `NOBODY`.
    - `sure`: pieces that fill a span of a function.

    The last place of each stands for "none": no piece starts there, and it is too large for any span.
    """

    sides: Int[np.ndarray, "2 pieces_1"]
    beyond: Int[np.ndarray, "2 pieces_1"]
    table: Int[np.ndarray, "16 pieces_1"]
    sure: Bool[np.ndarray, " pieces_1"]


def lay_out(
    tmesh: TMesh, knots: Int[np.ndarray, "n 2 5"], numbers: Int[np.ndarray, " n"], pieces: Pieces
) -> Layout | None:
    """Enter the functions with these local knots in the rows of the pieces they live on.

    A span is a piece or made of two, as it always is on an analysis-suitable mesh; `None` where one is not, or where
    two functions claim one place.
    """
    assert tmesh.forest is not None
    layout = _empty_layout(tmesh, pieces)
    lines = [np.clip(knots[:, axis], 0, tmesh.extent[axis]) for axis in range(2)]
    widths, heights = (np.ascontiguousarray(np.diff(line, axis=1).T, dtype=np.int32) for line in lines)
    row_start = _starting_at(pieces, tmesh.forest.code(lines[0][:, 0], lines[1][:, 0]))
    numbers = numbers.astype(np.int32)
    written = 0
    for j in range(4):
        piece, above = row_start, row_start
        for i in range(4):
            count = _enter_span(layout, numbers, 4 * i + j, widths[i], heights[j], piece)
            if count is None:
                return None
            written += count
            if i == 0:
                above = _next_span(layout, 1, piece, heights[j])
            piece = _next_span(layout, 0, piece, widths[i])
        row_start = above
    return layout if written == int((layout.table[:, :-1] != NOBODY).sum()) else None


def _empty_layout(tmesh: TMesh, pieces: Pieces) -> Layout:
    """Sizes and neighbours of the pieces, and an empty table."""
    assert tmesh.forest is not None
    x0, y0, x1, y1 = np.ascontiguousarray(pieces.boxes.T)
    none = len(x0)
    sides, beyond = np.full((2, none + 1), NOBODY, np.int32), np.full((2, none + 1), none, np.int32)
    sides[0, :-1], sides[1, :-1] = x1 - x0, y1 - y0
    beyond[0, :-1] = _starting_at(pieces, tmesh.forest.code(x1, y0))
    beyond[1, :-1] = _starting_at(pieces, tmesh.forest.code(x0, y1))
    return Layout(sides, beyond, np.full((16, none + 1), NOBODY, np.int32), np.zeros(none + 1, bool))


def _starting_at(pieces: Pieces, codes: np.ndarray) -> Int[np.ndarray, " n"]:
    """The piece whose lower corner has each code, or "none"."""
    place = np.searchsorted(pieces.codes, codes)
    none = len(pieces.codes)
    return np.where(np.append(pieces.codes, -1).take(place) == codes, place, none).astype(np.int32)


def _enter_span(
    layout: Layout, numbers: np.ndarray, slot: int, width: np.ndarray, height: np.ndarray, piece: np.ndarray
) -> int | None:
    """Enter each function on the piece or two of one of its spans; how many entries, or `None` if that fails."""
    live = np.flatnonzero((width > 0) & (height > 0))
    if len(live) < len(width):
        numbers, width, height, piece = numbers[live], width[live], height[live], piece[live]
    right, above = width - layout.sides[0].take(piece), height - layout.sides[1].take(piece)
    more = np.flatnonzero(right | above)
    column = layout.table[slot]
    column[piece] = numbers
    whole = np.ones(len(piece), bool)
    whole[more] = False
    layout.sure[piece[whole]] = True
    right, above, width, height = right[more], above[more], width[more], height[more]
    if (right < 0).any() or (above < 0).any() or ((right > 0) & (above > 0)).any():
        return None
    other = np.where(right > 0, layout.beyond[0].take(piece[more]), layout.beyond[1].take(piece[more]))
    filled = (layout.sides[0].take(other) == np.where(right > 0, right, width)) & (
        layout.sides[1].take(other) == np.where(above > 0, above, height)
    )
    column[other] = numbers[more]
    return len(piece) + len(more) if filled.all() else None


def _next_span(layout: Layout, axis: int, piece: np.ndarray, size: np.ndarray) -> Int[np.ndarray, " n"]:
    """The piece where the next span starts along the axis, one or two pieces on; the same where the span is empty."""
    step = layout.beyond[axis]
    following = step.take(piece)
    more = np.flatnonzero(size > layout.sides[axis].take(piece))
    following[more] = step.take(following[more])
    empty = np.flatnonzero(size == 0)
    following[empty] = piece[empty]
    return following


def cut_in_vain(
    knots: Int[np.ndarray, "functions 2 5"],
    pieces: Pieces,
    table: Int[np.ndarray, "pieces 16"],
    sure: Bool[np.ndarray, " pieces"],
) -> bool:
    """Whether some half of an element need not be one: no function alive there has a knot on the line between them.

    `sure` names halves that fill a span, which are needed for certain, and the other half with them.
    """
    first = np.flatnonzero(pieces.is_half)[::2]
    doubt = first[~(sure[first] | sure[first + 1])]
    low, high = pieces.boxes[doubt], pieces.boxes[doubt + 1]
    axis = (high[:, 1] > low[:, 1]).astype(np.int64)
    line = high[np.arange(len(doubt)), axis]
    needed = np.zeros(len(doubt), bool)
    for half in (doubt, doubt + 1):
        on_line = knots[table[half], axis[:, None]] == line[:, None, None]
        needed |= on_line.any(axis=(1, 2))
    return not needed.all()
