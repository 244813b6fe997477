"""Control points in whole steps, coarse to fine along the cut direction.

An anchor at x = X / 2^a, y = Y / 2^b (X, Y odd) lies on the middle line of a cell of level max(2 a - 1, 2 b) - 1 (s cut
first), and the two ends of that cell's halved sides are anchors of a lower order: the control point is predicted from
theirs, cubically where the next two are anchors, too. So every control point is coded once, and nothing else.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from ..mesh import TMesh, anchor_codes, require_forest
from ..mesh._codes import DEPTH, UNIT, z_order
from ._entropy import AbstractCoder, Model, number_model

_CLASSES = np.array([0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 28, 40, 56, 80, 112, 160, 224, 320, 448, 640])
_LARGEST = 1 << 20


@dataclass(eq=False)
class _Anchors:
    """Anchors of a mesh and how to find them."""

    tmesh: TMesh

    def __post_init__(self) -> None:
        self.places = np.asarray(self.tmesh.anchors)
        self.codes = anchor_codes(self.tmesh, self.places)
        first = 0 if require_forest(self.tmesh).first_cut == "s" else 1
        fineness = DEPTH - np.stack([_twos(self.places[:, axis]) for axis in range(2)], axis=1)
        self.order = np.maximum(np.maximum(2 * fineness[:, first] - 1, 2 * fineness[:, 1 - first]), 0)
        self.axis = np.where(self.order % 2 == 1, first, 1 - first)

    def at(self, places: Int[np.ndarray, "n 2"]) -> Int[np.ndarray, " n"]:
        """The anchors at some places, or -1."""
        reach = np.array(self.tmesh.extent) + UNIT
        inside = ((places >= -UNIT) & (places <= reach)).all(axis=1)
        code = z_order(*(np.where(inside, places[:, axis] + UNIT, 0) for axis in range(2)))
        found = np.minimum(np.searchsorted(self.codes, code), len(self.codes) - 1)
        return np.where(inside & (self.codes[found] == code), found, -1)


def _twos(values: np.ndarray) -> np.ndarray:
    """How often each whole number is divisible by two, at most DEPTH times."""
    low = values | UNIT
    return np.round(np.log2(low & -low)).astype(np.int64)


def code_points(coder: AbstractCoder, tmesh: TMesh, points: Int[np.ndarray, " n"] | None) -> Int[np.ndarray, " n"]:
    """Write control points in whole steps, in the order of the anchors, or read them where `points` is `None`."""
    anchors = _Anchors(tmesh)
    values = np.zeros(len(anchors.codes), np.int64)
    sizes = np.zeros(len(anchors.codes), np.int64)
    known = anchors.order == 0
    values[known], sizes[known] = _code_lattice(coder, anchors, known, points)
    model = number_model(len(_CLASSES) * 6, len(_CLASSES) * 3)
    for order in range(1, int(anchors.order.max()) + 1):
        at_order = np.flatnonzero(anchors.order == order)
        for parity in (0, 1):
            width = UNIT >> ((order + 1) // 2)
            across = anchors.places[at_order, 1 - anchors.axis[at_order]] // width
            chosen = at_order[across % 2 == parity]
            if chosen.size:
                _code_order(coder, model, anchors, chosen, width, (values, sizes, known), points)
                known[chosen] = True
    return values


def _code_lattice(
    coder: AbstractCoder, anchors: _Anchors, known: np.ndarray, points: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """The control points of the lattice's own anchors: second differences of rows and columns."""
    rows = len(np.unique(anchors.places[known, 0]))
    order = np.lexsort((anchors.places[known, 1], anchors.places[known, 0]))
    wanted = None
    if points is not None:
        grid = points[known][order].reshape(rows, -1)
        wanted = np.diff(np.diff(grid, axis=0, prepend=0), axis=1, prepend=0).ravel()
    nowhere = np.zeros(len(order), np.int64)
    steps = coder.code(number_model(1, 1), (nowhere, nowhere), wanted).reshape(rows, -1)
    values = np.empty(len(order), np.int64)
    values[order] = np.cumsum(np.cumsum(steps, axis=0), axis=1).ravel()
    return values, nowhere


def _code_order(
    coder: AbstractCoder,
    model: Model,
    anchors: _Anchors,
    chosen: np.ndarray,
    width: int,
    state: tuple[np.ndarray, np.ndarray, np.ndarray],
    points: np.ndarray | None,
) -> None:
    """The control points of one order and parity; `state` holds values, sizes of corrections, and what is known."""
    values, sizes, known = state
    axis = anchors.axis[chosen]
    along = np.stack([axis == 0, axis == 1], axis=1).astype(np.int64) * width
    across = np.stack([axis == 1, axis == 0], axis=1).astype(np.int64) * width
    place = anchors.places[chosen]

    def value(step: int, side: int = 0) -> tuple[np.ndarray, np.ndarray]:
        found = anchors.at(place + step * along + side * across)
        there = (found >= 0) & known[found]
        return np.where(there, found, -1), there

    (left, _), (right, _) = value(-1), value(1)
    (far_left, has_left), (far_right, has_right) = value(-3), value(3)
    near = values[left] + values[right]
    bend_left = np.where(has_left, 2 * values[left] - values[far_left] - values[right], 0)
    bend_right = np.where(has_right, 2 * values[right] - values[far_right] - values[left], 0)
    # 16 (-1 9 9 -1) or, with one of the outer two, 8 (3 6 -1): the mean plus a sixteenth or an eighth of the bends.
    both = has_left & has_right
    predicted = (8 * near + np.where(both, 1, 2) * (bend_left + bend_right) + 8) >> 4
    rough = np.abs(bend_left) + np.abs(bend_right)
    rough = np.where(both, rough, 2 * rough) >> 3
    active = 2 * (sizes[left] + sizes[right])
    for side in (-1, 1):
        beside, there = value(0, side)
        active = active + np.where(there, sizes[beside], 0)
    outer = has_left.astype(np.int64) + has_right
    classes = np.searchsorted(_CLASSES, active, side="right") - 1
    roughness = np.searchsorted(_CLASSES, rough, side="right") - 1
    first = (classes * 3 + np.minimum(roughness // 2, 2)) * 2 + (outer == 2)
    wanted = None if points is None else points[chosen] - predicted
    steps = coder.code(model, (first, roughness * 3 + outer), wanted)
    values[chosen] = predicted + steps
    sizes[chosen] = np.minimum(np.abs(steps), _LARGEST)
