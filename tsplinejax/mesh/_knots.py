"""Anchors and local knot vectors by Sederberg's rule one.

From an anchor, a ray along its row meets the closed vertical skeleton at the nearest side of the element above the
row or of the element below it, whichever comes first: an edge that ends on the row from below bounds the lower
element. Rows in the frame see the lines that reach the border, because these run straight through the frame.
"""

from typing import TYPE_CHECKING

import numpy as np

from ._codes import z_order

if TYPE_CHECKING:
    from ._tmesh import TMesh


def find_anchors(tmesh: "TMesh") -> np.ndarray:
    """All vertices, with border vertices repeated one frame line outwards, in the order of `anchor_codes`."""
    corners = [tmesh.boxes[:, [i, j]] for i in (0, 2) for j in (1, 3)]
    points = _in_order(tmesh, np.concatenate(corners))
    for axis in range(2):
        ends = []
        for line, beyond in ((0, -tmesh.frame), (tmesh.extent[axis], tmesh.extent[axis] + tmesh.frame)):
            end = points[points[:, axis] == line]
            end[:, axis] = beyond
            ends.append(end)
        points = np.concatenate([points, *ends])
    return _in_order(tmesh, points)


def anchor_codes(tmesh: "TMesh", anchors: np.ndarray) -> np.ndarray:
    """Z-order codes of anchors, counted from the first frame line: a name that refinement does not change."""
    return z_order(anchors[:, 0] + tmesh.frame, anchors[:, 1] + tmesh.frame)


def _in_order(tmesh: "TMesh", points: np.ndarray) -> np.ndarray:
    """Distinct points in the order of their codes, so that neighbours stay close in memory."""
    _, first = np.unique(anchor_codes(tmesh, points), return_index=True)
    return points[first]


def find_local_knots(tmesh: "TMesh", anchors: np.ndarray) -> np.ndarray:
    """Local knot vectors (anchors, 2, 5) in index coordinates."""
    knots = np.empty((len(anchors), 2, 5), np.int64)
    for axis in range(2):
        knots[:, axis, 2] = anchors[:, axis]
        for step in (-1, 1):
            at = anchors[:, axis]
            for place in (1, 2):
                at = walk(tmesh, axis, step, at, anchors[:, 1 - axis])
                knots[:, axis, 2 + step * place] = at
    return knots


def walk(tmesh: "TMesh", axis: int, step: int, at: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Next line that a ray meets.

    `axis` 0 walks along s on rows of constant t, 1 along t on columns of constant s; `step` is +1 or -1; `at` and `row`
    are the ray's place along and across the axis. Outside the mesh the ray meets the frame's full lines.
    """
    extent = tmesh.extent[axis]
    inside = (at < extent) & (at >= 0) if step > 0 else (at > 0) & (at <= extent)
    result = at + step * tmesh.frame
    rows = np.clip(row[inside], 0, tmesh.extent[1 - axis])
    result[inside] = _next_side(tmesh, axis, step, at[inside], rows)
    return result


def _next_side(tmesh: "TMesh", axis: int, step: int, at: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Nearest side, in the walking direction, of the elements on both sides of the row."""
    cell = at if step > 0 else at - 1
    side = axis + 2 if step > 0 else axis
    last = tmesh.extent[1 - axis] - 1
    above, below = np.minimum(row, last), np.maximum(row - 1, 0)
    sides = []
    for across in (above, below):
        element = tmesh.locate(cell, across) if axis == 0 else tmesh.locate(across, cell)
        sides.append(tmesh.boxes[element, side])
    return np.minimum(*sides) if step > 0 else np.maximum(*sides)
