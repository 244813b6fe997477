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
    """All pairs of the functions with these local knots and a piece in their supports; `None` if a knot cuts a piece.

    A span's lower corner is a piece's lower corner unless that piece is cut. Mostly the piece fills the span.
    """
    assert tmesh.forest is not None
    x, y = (np.clip(knots[:, axis], 0, tmesh.extent[axis]) for axis in range(2))
    corner = tmesh.forest.code(x[:, :4, None], y[:, None, :4])
    piece = np.searchsorted(pieces.codes, corner.ravel(), side="right").reshape(-1, 16) - 1
    width, height = (np.diff(lines, axis=1).astype(np.int32) for lines in (x, y))
    width, height = np.repeat(width, 4, axis=1), np.tile(height, (1, 4))
    sides = (pieces.boxes[:, 2:] - pieces.boxes[:, :2]).astype(np.int32)
    across, along = sides[:, 0][piece], sides[:, 1][piece]
    live = (width > 0) & (height > 0)
    inside = (pieces.codes[piece] == corner.reshape(-1, 16)) & (across <= width) & (along <= height)
    if (live & ~inside).any():
        return None
    fills = live & (across == width) & (along == height)
    function, slot = np.nonzero(fills)
    several, place = np.nonzero(live & ~fills)
    i, j = place >> 2, place & 3
    spans = np.stack([x[several, i], y[several, j], x[several, i + 1], y[several, j + 1]])
    swept = _sweep(tmesh, spans, piece[several, place], pieces)
    if swept is None:
        return None
    span, other = swept
    return Pairs(
        np.concatenate([function, several[span]]),
        np.concatenate([piece[fills], other]),
        np.concatenate([slot, place[span]]),
        np.repeat([True, False], [len(function), len(span)]),
    )


def _sweep(
    tmesh: TMesh, spans: Int[np.ndarray, "4 n"], piece: np.ndarray, pieces: Pieces
) -> tuple[np.ndarray, np.ndarray] | None:
    """All pairs of a span and a piece inside it; `None` where a piece reaches beyond a span.

    The piece at the lower corner is taken away, which leaves a rectangle on its right and one above. A piece counts
    where the sweep meets its lower corner, hence once.
    """
    assert tmesh.forest is not None
    span, rest, boxes = np.arange(spans.shape[1]), spans, np.ascontiguousarray(pieces.boxes.T)
    found, met = [], []
    while len(span):
        x0, y0, x1, y1 = boxes[:, piece]
        low_x, low_y, high_x, high_y = spans[:, span]
        if ((x0 < low_x) | (y0 < low_y) | (x1 > high_x) | (y1 > high_y)).any():
            return None
        first = (x0 == rest[0]) & (y0 == rest[1])
        found.append(span[first])
        met.append(piece[first])
        right, above = np.flatnonzero(x1 < rest[2]), np.flatnonzero(y1 < rest[3])
        beside = np.stack([x1[right], rest[1, right], rest[2, right], np.minimum(rest[3, right], y1[right])])
        over = np.stack([rest[0, above], y1[above], rest[2, above], rest[3, above]])
        span, rest = np.concatenate([span[right], span[above]]), np.concatenate([beside, over], axis=1)
        piece = np.searchsorted(pieces.codes, tmesh.forest.code(rest[0], rest[1]), side="right") - 1
    return np.concatenate([span[:0], *found]), np.concatenate([piece[:0], *met])


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
