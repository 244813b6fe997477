"""Bézier elements on the host: which blending functions live on which rectangle.

A Bézier element is a rectangle on which every blending function is one bicubic polynomial. On a dyadic forest it is an
element of the mesh, or a piece that further bisections of it would give: the pieces are found by bisecting every cell
that a local knot of a function alive there cuts. On a mesh given by hand every index cell is one.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from .._errors import InputError
from ..mesh import TMesh, bisect_cells, cell_boxes
from ._spans import NOBODY, cut_in_vain, lay_out, likely_pieces

# Functions on an element of an analysis-suitable mesh.
_LEAST_WIDTH = 16

Locate = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class BezierElements:
    """Bézier elements of a T-mesh, in the order of their codes.

    **Attributes:**

    - `boxes`: `x0, y0, x1, y1` in index coordinates, (elements, 4).
    - `owner`: element of the T-mesh that holds each, (elements,); sorted on a forest.
    - `functions`: blending functions alive on each, (elements, K), ascending, -1 where there are fewer than K.
    - `levels`, `codes`: place in the dyadic forest; `None` for a mesh given by hand.
    """

    boxes: Int[np.ndarray, "bezier 4"]
    owner: Int[np.ndarray, " bezier"]
    functions: Int[np.ndarray, "bezier K"]
    levels: Int[np.ndarray, " bezier"] | None = None
    codes: Int[np.ndarray, " bezier"] | None = None

    def __len__(self) -> int:
        return len(self.boxes)


def bezier_elements(tmesh: TMesh, *, most: float = math.inf) -> BezierElements:
    """The Bézier elements of a T-mesh.

    **Raises:** `InputError` where their table of functions would have more than `most` entries: on a mesh that is not
    analysis-suitable, elements side by side of very different sizes take any number of them.

    >>> from tsplinejax.mesh import b_lattice
    >>> bezier_elements(b_lattice(3, 2)).functions.shape
    (6, 16)
    """
    elements = None if tmesh.forest is None else by_spans(tmesh)
    return by_cutting(tmesh, most=most) if elements is None else elements


def by_spans(tmesh: TMesh) -> BezierElements | None:
    """The Bézier elements of an analysis-suitable dyadic mesh, `None` where it turns out not to be one."""
    pieces = likely_pieces(tmesh, np.arange(tmesh.n_elements))
    layout = lay_out(tmesh, tmesh.local_knots, np.arange(tmesh.n_anchors), pieces)
    if layout is None:
        return None
    table = np.ascontiguousarray(layout.table[:, :-1].T)
    if (table == NOBODY).any():
        return None
    table.sort(axis=1)
    if cut_in_vain(tmesh.local_knots, pieces, table, layout.sure[:-1]):
        return None
    return BezierElements(pieces.boxes, pieces.owner, table, pieces.levels, pieces.codes)


def by_cutting(tmesh: TMesh, *, most: float = math.inf) -> BezierElements:
    """The Bézier elements of any T-mesh; at most so many entries in their table of functions."""
    knots = tmesh.local_knots
    supports = np.stack([knots[:, 0, 0], knots[:, 1, 0], knots[:, 0, 4], knots[:, 1, 4]], axis=1)
    supports = np.clip(supports, 0, np.tile(tmesh.extent, 2))
    if tmesh.forest is None:
        return _index_cells(tmesh, supports, most)
    forest = tmesh.forest
    levels, codes, boxes = forest.levels, forest.codes, tmesh.boxes
    owner = np.arange(len(codes))
    function, cell = _overlaps(supports, boxes, tmesh.locate)
    # A cell stays whole once no local knot cuts it; each round can only cut the pieces of the round before.
    open_pairs = np.ones(len(cell), bool)
    while True:
        cut = np.zeros(len(codes), bool)
        cut[cell[open_pairs][cut_by_knots(knots[function[open_pairs]], boxes[cell[open_pairs]])]] = True
        if not cut.any():
            break
        _check_entries(len(codes) + int(np.count_nonzero(cut)), _LEAST_WIDTH, most)
        levels, codes, parent = bisect_cells(levels, codes, cut)
        owner, boxes = owner[parent], cell_boxes(forest.first_cut, levels, codes)
        function, cell, open_pairs = _inherit(function, cell, cut, parent, boxes, supports)
    return BezierElements(boxes, owner, _table(function, cell, len(codes), len(knots), most), levels, codes)


def _index_cells(tmesh: TMesh, supports: np.ndarray, most: float) -> BezierElements:
    """Every index cell of a mesh given by hand."""
    columns, rows = tmesh.extent
    _check_entries(columns * rows, _LEAST_WIDTH, most)
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
    boxes = np.stack([x, y, x + 1, y + 1], axis=1)
    function, cell = _overlaps(supports, boxes, lambda x, y: x * rows + y)
    return BezierElements(boxes, tmesh.locate(x, y), _table(function, cell, len(boxes), len(supports), most))


def _overlaps(supports: np.ndarray, boxes: np.ndarray, locate: Locate) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of a support and a cell that overlap.

    Each support is swept from its lower corner: the cell there is taken away, which leaves a rectangle on its right and
    one above. A cell counts where the sweep meets its own lower corner (or the support's), hence once.
    """
    keep = (supports[:, 0] < supports[:, 2]) & (supports[:, 1] < supports[:, 3])
    function = np.flatnonzero(keep)
    rest = supports[keep]
    functions, cells = [], []
    while len(function):
        cell = locate(rest[:, 0], rest[:, 1])
        box = boxes[cell]
        corner = np.maximum(box[:, :2], supports[function, :2])
        first = (corner == rest[:, :2]).all(axis=1)
        functions.append(function[first])
        cells.append(cell[first])
        right, above = box[:, 2] < rest[:, 2], box[:, 3] < rest[:, 3]
        right_rest, above_rest = rest[right], rest[above]
        right_rest[:, 0] = box[right, 2]
        right_rest[:, 3] = np.minimum(right_rest[:, 3], box[right, 3])
        above_rest[:, 1] = box[above, 3]
        function = np.concatenate([function[right], function[above]])
        rest = np.concatenate([right_rest, above_rest])
    return np.concatenate(functions), np.concatenate(cells)


def cut_by_knots(knots: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """Whether a local knot of the pair's function runs through the inside of the pair's cell."""
    cut = np.zeros(len(boxes), bool)
    for axis in range(2):
        low, high = boxes[:, axis, None], boxes[:, axis + 2, None]
        cut |= ((knots[:, axis] > low) & (knots[:, axis] < high)).any(axis=1)
    return cut


def _inherit(
    function: np.ndarray, cell: np.ndarray, cut: np.ndarray, parent: np.ndarray, boxes: np.ndarray, supports: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs after cells were cut: both halves take over their parent's functions where the supports reach them."""
    start = np.searchsorted(parent, np.arange(len(cut)))
    halved = cut[cell]
    function = np.concatenate([function, function[halved]])
    new_cell = np.concatenate([start[cell], start[cell[halved]] + 1])
    touched = np.concatenate([halved, halved[halved]])
    box, support = boxes[new_cell], supports[function]
    alive = (np.minimum(box[:, 2:], support[:, 2:]) > np.maximum(box[:, :2], support[:, :2])).all(axis=1)
    return function[alive], new_cell[alive], touched[alive]


def _table(function: np.ndarray, cell: np.ndarray, n_cells: int, n_functions: int, most: float) -> np.ndarray:
    """The pairs as a padded table, one row a cell, functions ascending."""
    order = np.argsort(cell * n_functions + function)
    function, cell = function[order], cell[order]
    counts = np.bincount(cell, minlength=n_cells)
    width = -(-int(counts.max()) // _LEAST_WIDTH) * _LEAST_WIDTH
    _check_entries(n_cells, width, most)
    table = np.full((n_cells, width), -1, np.int32)
    table[cell, np.arange(len(cell)) - np.repeat(np.cumsum(counts) - counts, counts)] = function
    return table


def _check_entries(elements: int, width: int, most: float) -> None:
    """Refuse a table of functions before memory is taken for it."""
    if elements * width > most:
        raise InputError(
            f"the mesh has {elements} Bézier elements with up to {width} functions each, more than the {most} entries "
            "that are allowed; refine with AnalysisSuitable() instead"
        )
