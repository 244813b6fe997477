"""T-meshes: rectangles that tile the parameter square, T-junctions allowed.

A [`TMesh`][tsplinejax.mesh.TMesh] lives on the host, in integer *index coordinates*: `x` counts along s and `y` along
t. Index lines inside the mesh run from 0 to `extent`; the frame lines beyond them (three on each side, `frame` apart)
carry the border's repeated knots. [`TMesh.parameters`][tsplinejax.mesh.TMesh.parameters] maps index lines to
parameters.

Two kinds of mesh share the class. A *dyadic forest* starts from a B-lattice of M × N unit squares and bisects
elements at their middle; an element of level k was bisected k times, its Z-order code identifies it, and the codes
stay sorted, so that the element that holds a point is one binary search away at any depth. A mesh *given by hand* is
any tiling by rectangles, and keeps a table of its index cells instead.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from .._errors import InputError
from ._codes import DEPTH, MAX_LATTICE, MAX_LEVEL, UNIT, Border, Direction, cell_boxes, z_order
from ._knots import Traces, find_anchors, find_traces


def frozen_array(values: ArrayLike) -> np.ndarray:
    """A read-only copy-free view: host values never change after they are made."""
    array = np.asarray(values).view()
    array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False)
class Forest:
    """What makes a T-mesh a dyadic forest: lattice (M, N), direction of the first cut, levels and Z-order codes."""

    lattice: tuple[int, int]
    first_cut: Direction
    levels: Int[np.ndarray, " elements"]
    codes: Int[np.ndarray, " elements"]

    def code(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Z-order codes of index cells; the direction of the first cut holds the more significant bits."""
        return z_order(x, y) if self.first_cut == "s" else z_order(y, x)


@dataclass(frozen=True, eq=False)
class TMesh:
    """An immutable T-mesh over the parameter square [0, 1]².

    **Attributes:**

    - `boxes`: elements as `x0, y0, x1, y1` in index coordinates, shape (elements, 4).
    - `extent`: index coordinate of the last line in each direction.
    - `frame`: index distance between frame lines.
    - `lines`: parameters of the index lines 0 ... extent of a mesh given by hand; `None` for a forest (uniform).
    - `border`: `"clamped"` repeats the end knots, `"open"` continues them outwards (the paper's own frame).
    - `forest`: levels and codes of a dyadic mesh, `None` for a mesh given by hand.

    Make one with [`b_lattice`][tsplinejax.mesh.b_lattice] or [`from_rectangles`][tsplinejax.mesh.from_rectangles].

    >>> b_lattice(4, 3)
    TMesh(12 elements, 42 anchors, lattice 4 × 3, level 0)
    """

    boxes: Int[np.ndarray, "elements 4"]
    extent: tuple[int, int]
    frame: int
    lines: tuple[np.ndarray, np.ndarray] | None = None
    border: Border = "clamped"
    forest: Forest | None = None
    _table: np.ndarray | None = field(default=None, repr=False)
    _known: Traces | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        kind = "given by hand"
        if self.forest is not None:
            columns, rows = self.forest.lattice
            kind = f"lattice {columns} × {rows}, level {int(self.forest.levels.max())}"
        return f"TMesh({self.n_elements} elements, {self.n_anchors} anchors, {kind})"

    @property
    def n_elements(self) -> int:
        """Number of elements."""
        return len(self.boxes)

    @property
    def n_anchors(self) -> int:
        """Number of anchors: one blending function and one control point each."""
        return len(self.anchors)

    @property
    def levels(self) -> Int[np.ndarray, " elements"]:
        """How often each element was bisected (zero for a mesh given by hand)."""
        return np.zeros(self.n_elements, np.int64) if self.forest is None else self.forest.levels

    @cached_property
    def anchors(self) -> Int[np.ndarray, "anchors 2"]:
        """Index coordinates of the anchors: every vertex, and one frame line beyond the border (§4 of the paper)."""
        return frozen_array(find_anchors(self) if self._known is None else self._known.anchors)

    @cached_property
    def local_knots(self) -> Int[np.ndarray, "anchors 2 5"]:
        """Local knot vectors by Sederberg's rule one, as index coordinates: `[:, 0]` along s, `[:, 1]` along t."""
        return frozen_array(self.traces.local_knots)

    @cached_property
    def traces(self) -> Traces:
        """Local knots with the elements that decided them: what a refinement updates."""
        return find_traces(self, self.anchors) if self._known is None else self._known

    @property
    def is_traced(self) -> bool:
        """Whether the local knots are at hand."""
        return self._known is not None or "traces" in vars(self)

    def locate(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Index of the element that holds each index cell (x, x + 1) × (y, y + 1) inside the mesh."""
        if self.forest is None:
            assert self._table is not None
            return self._table[x, y]
        return np.searchsorted(self.forest.codes, self.forest.code(x, y), side="right") - 1

    def parameters(self, direction: int, index: np.ndarray) -> np.ndarray:
        """Parameters of index lines along s (`direction` 0) or t (1); frame lines follow the border."""
        extent = self.extent[direction]
        clamped = np.clip(index, 0, extent)
        if self.lines is None:
            return (clamped if self.border == "clamped" else index) / extent
        knots = self.lines[direction]
        inside = knots[clamped]
        if self.border == "clamped":
            return inside
        below, above = np.minimum(index, 0), np.maximum(index - extent, 0)
        return inside + below * (knots[1] - knots[0]) + above * (knots[-1] - knots[-2])

    @property
    def element_boxes(self) -> Float[np.ndarray, "elements 4"]:
        """Elements as `s0, t0, s1, t1` in parameters."""
        s = self.parameters(0, self.boxes[:, [0, 2]])
        t = self.parameters(1, self.boxes[:, [1, 3]])
        return np.stack([s[:, 0], t[:, 0], s[:, 1], t[:, 1]], axis=1)


def b_lattice(columns: int, rows: int, *, first_cut: Direction = "s", border: Border = "clamped") -> TMesh:
    """A T-mesh without T-junctions: M × N unit squares, the start of every refinement.

    **Arguments:**

    - `columns`, `rows`: M elements along s and N along t.
    - `first_cut`: direction in which elements of even level are cut.
    - `border`: `"clamped"` (fourfold end knots) or `"open"` (the paper's unrepeated frame).

    **Raises:** `InputError` where a count is not a whole number from 1 to 16384.

    >>> b_lattice(8, 8).n_anchors
    121
    """
    _check_lattice(columns, rows)
    _check_words(first_cut, border)
    x, y = (grid.ravel() * UNIT for grid in np.meshgrid(np.arange(columns), np.arange(rows), indexing="ij"))
    codes = z_order(x, y) if first_cut == "s" else z_order(y, x)
    order = np.argsort(codes)
    levels = np.zeros(len(order), np.int64)
    return make_forest_mesh((int(columns), int(rows)), first_cut, levels, codes[order], border)


def _check_lattice(columns: int, rows: int) -> None:
    """Raise unless both counts are whole numbers in range."""
    for name, count in (("columns", columns), ("rows", rows)):
        if not isinstance(count, int | np.integer) or not 1 <= count <= MAX_LATTICE:
            raise InputError(
                f"a lattice has 1 to {MAX_LATTICE} elements along each side; received {name} = {count!r}; "
                "give two whole numbers, for instance (8, 8)"
            )


def _check_words(first_cut: str, border: str) -> None:
    """Raise for an unknown direction or border."""
    if first_cut not in ("s", "t"):
        raise InputError(f"the first cut runs across 's' or 't'; received {first_cut!r}; choose one of the two")
    if border not in ("clamped", "open"):
        raise InputError(f"the border is 'clamped' or 'open'; received {border!r}; choose one of the two")


def make_forest_mesh(
    lattice: tuple[int, int],
    first_cut: Direction,
    levels: np.ndarray,
    codes: np.ndarray,
    border: Border,
    boxes: np.ndarray | None = None,
) -> TMesh:
    """The T-mesh of sorted Z-order codes and their levels (and boxes, where these are known)."""
    forest = Forest(lattice, first_cut, frozen_array(levels), frozen_array(codes))
    boxes = cell_boxes(first_cut, levels, codes) if boxes is None else boxes
    extent = (lattice[0] * UNIT, lattice[1] * UNIT)
    return TMesh(frozen_array(boxes), extent, UNIT, border=border, forest=forest)


def forest_from_boxes(
    boxes: Int[np.ndarray, "elements 4"], lattice: tuple[int, int], *, first_cut: Direction, border: Border
) -> TMesh:
    """The dyadic T-mesh with these index boxes, in any order: what a saved model keeps.

    **Raises:** `InputError` where the boxes are not the cells of a bisected lattice.

    >>> forest_from_boxes(b_lattice(2, 1).boxes, (2, 1), first_cut="s", border="clamped").n_elements
    2
    """
    _check_words(first_cut, border)
    _check_lattice(*lattice)
    extent = np.array(lattice) * UNIT
    widths = boxes[:, 2:] - boxes[:, :2]
    if len(boxes) == 0 or (widths < 1).any() or (boxes[:, :2] < 0).any() or (boxes[:, 2:] > extent).any():
        raise InputError(
            f"the elements of a dyadic T-mesh lie in its lattice of {lattice[0]} × {lattice[1]} squares; "
            "these boxes do not"
        )
    # Cells that are not a square's 2^-k parts come out otherwise from their own levels and codes.
    levels = (DEPTH - np.log2(widths)).astype(np.int64).sum(axis=1)
    codes = z_order(boxes[:, 0], boxes[:, 1]) if first_cut == "s" else z_order(boxes[:, 1], boxes[:, 0])
    order = np.argsort(codes)
    levels, codes = np.clip(levels[order], 0, MAX_LEVEL), codes[order]
    mesh = make_forest_mesh(lattice, first_cut, levels, codes, border)
    spans = np.int64(1) << (2 * DEPTH - levels)
    apart = (codes[:-1] + spans[:-1] <= codes[1:]).all()
    full = int(spans.sum()) == lattice[0] * lattice[1] << 2 * DEPTH
    if not (np.array_equal(mesh.boxes, boxes[order]) and apart and full):
        raise InputError(
            "these boxes are not the elements of a bisected lattice; they overlap, leave gaps or are cut elsewhere "
            "than in the middle"
        )
    return mesh


def from_rectangles(rectangles: Float[np.ndarray, "elements 4"], *, border: Border = "clamped") -> TMesh:
    """A T-mesh given by hand: any rectangles that tile the parameter square.

    **Arguments:**

    - `rectangles`: elements as `s0, t0, s1, t1`, parameters in [0, 1]; equal coordinates must be equal numbers.
    - `border`: as in [`b_lattice`][tsplinejax.mesh.b_lattice].

    **Raises:** `InputError` where the rectangles overlap, leave gaps or do not fill [0, 1]².

    >>> from_rectangles([[0, 0, 0.5, 1], [0.5, 0, 1, 0.5], [0.5, 0.5, 1, 1]])
    TMesh(3 elements, 23 anchors, given by hand)
    """
    _check_words("s", border)
    try:
        given = np.asarray(rectangles, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"a T-mesh is given as rows of four numbers s0, t0, s1, t1; {error}") from error
    if given.ndim != 2 or given.shape[1] != 4 or len(given) == 0 or not np.isfinite(given).all():
        raise InputError(
            "a T-mesh is given as finite rows s0, t0, s1, t1; received an array of shape "
            f"{given.shape}; give one row for each rectangle"
        )
    lines = (np.unique(given[:, [0, 2]]), np.unique(given[:, [1, 3]]))
    for name, knots in zip("st", lines, strict=True):
        if knots[0] != 0.0 or knots[-1] != 1.0:
            raise InputError(
                f"a T-mesh fills [0, 1]²; received {name} from {knots[0]:g} to {knots[-1]:g}; rescale the rectangles"
            )
    boxes = np.stack([np.searchsorted(lines[k % 2], given[:, k]) for k in range(4)], axis=1)
    shape = (len(lines[0]) - 1, len(lines[1]) - 1)
    table = _index_table(boxes, shape)
    extent = (int(shape[0]), int(shape[1]))
    knots = (frozen_array(lines[0]), frozen_array(lines[1]))
    return TMesh(frozen_array(boxes), extent, 1, knots, border, None, frozen_array(table))


def _index_table(boxes: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Element of every index cell, after checking that the rectangles tile the square."""
    if (boxes[:, 0] >= boxes[:, 2]).any() or (boxes[:, 1] >= boxes[:, 3]).any():
        row = int(np.argmax((boxes[:, 0] >= boxes[:, 2]) | (boxes[:, 1] >= boxes[:, 3])))
        raise InputError(f"a rectangle has s0 < s1 and t0 < t1; rectangle {row} has not; swap its corners")
    table = np.full(shape, -1, np.int64)
    for element, (x0, y0, x1, y1) in enumerate(boxes):
        window = table[x0:x1, y0:y1]
        if (window >= 0).any():
            other = int(window.max())
            raise InputError(f"rectangles of a T-mesh do not overlap; rectangles {other} and {element} do; cut one")
        window[...] = element
    if (table < 0).any():
        x, y = np.argwhere(table < 0)[0]
        raise InputError(
            f"rectangles of a T-mesh leave no gap; index cell ({x}, {y}) is not covered; add a rectangle there"
        )
    return table
