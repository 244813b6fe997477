"""Anchors and local knot vectors by Sederberg's rule one.

From an anchor, a ray along its row meets the closed vertical skeleton at the nearest side of the element above the
row or of the element below it, whichever comes first: an edge that ends on the row from below bounds the lower
element. Rows in the frame see the lines that reach the border, because these run straight through the frame.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

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


@dataclass(frozen=True, eq=False)
class Traces:
    """Anchors, and what the rays from them met: enough to tell which of them a bisection changes.

    **Attributes:**

    - `anchors`, `codes`: places and names of the anchors, in the order of their codes.
    - `local_knots`: index coordinates along s and t.
    - `met`: elements on both sides of the rays, four around the anchor and two behind each first knot.
    """

    anchors: Int[np.ndarray, "anchors 2"]
    codes: Int[np.ndarray, " anchors"]
    local_knots: Int[np.ndarray, "anchors 2 5"]
    met: Int[np.ndarray, "12 anchors"]


def find_traces(tmesh: "TMesh", anchors: np.ndarray) -> Traces:
    """Local knot vectors of all anchors of a T-mesh."""
    return Traces(anchors, anchor_codes(tmesh, anchors), *_trace(tmesh, anchors))


def _trace(tmesh: "TMesh", anchors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Local knots of some anchors and the elements that their rays met.

    The four elements around an anchor bound the first step of all four rays; each second step looks up two more.
    """
    last = np.array(tmesh.extent) - 1
    cells = np.stack([np.clip(anchors - 1, 0, last), np.clip(anchors, 0, last)], axis=2)
    around = tmesh.locate(cells[:, 0, :, None], cells[:, 1, None, :])
    knots = np.empty((len(anchors), 2, 5), np.int64)
    met = [around.reshape(-1, 4)]
    for axis in range(2):
        at, across = anchors[:, axis], cells[:, 1 - axis]
        knots[:, axis, 2] = at
        for step in (-1, 1):
            first = around.take((step + 1) // 2, axis=1 + axis)
            near = _next_side(tmesh, axis, step, at, first)
            cell = np.clip(near if step > 0 else near - 1, 0, last[axis])[:, None]
            second = tmesh.locate(cell, across) if axis == 0 else tmesh.locate(across, cell)
            knots[:, axis, 2 + step] = near
            knots[:, axis, 2 + 2 * step] = _next_side(tmesh, axis, step, near, second)
            met.append(second)
    return knots, np.ascontiguousarray(np.concatenate(met, axis=1).T, dtype=np.int32)


def refine_traces(
    old: Traces, tmesh: "TMesh", parent: np.ndarray, bisected: np.ndarray
) -> tuple[Traces, Int[np.ndarray, " anchors"]]:
    """Traces of a refined T-mesh from those of the mesh before, and where each anchor that did not change was there.

    Only rays that met a bisected element are traced again.
    """
    first_child = np.arange(len(bisected), dtype=np.int32)
    first_child[1:] += np.cumsum(bisected[:-1], dtype=np.int32)
    points = _in_order(tmesh, _cut_ends(tmesh, parent))
    codes = anchor_codes(tmesh, points)
    place = np.searchsorted(old.codes, codes)
    fresh = old.codes[np.minimum(place, len(old.codes) - 1)] != codes
    points, codes = points[fresh], codes[fresh]
    source = np.insert(np.arange(len(old.codes)), place[fresh], -1)
    inserted = np.flatnonzero(source < 0)
    anchors, names = old.anchors.take(source, axis=0), old.codes.take(source)
    anchors[inserted], names[inserted] = points, codes
    crossed = np.any(bisected.take(old.met), axis=0).take(source)
    crossed[inserted] = True
    again = np.flatnonzero(crossed)
    knots, met = old.local_knots.take(source, axis=0), first_child.take(old.met).take(source, axis=1)
    traced, met[:, again] = _trace(tmesh, anchors[again])
    altered = again[(knots.take(again, axis=0) != traced).any(axis=(1, 2))]
    knots[again] = traced
    source[altered] = -1
    return Traces(anchors, names, knots, met), source


def _cut_ends(tmesh: "TMesh", parent: np.ndarray) -> np.ndarray:
    """Ends of the new edges between two elements with the same parent, repeated in the frame."""
    upper = np.flatnonzero(parent[1:] == parent[:-1]) + 1
    box, across = tmesh.boxes[upper], tmesh.boxes[upper, 0] > tmesh.boxes[upper - 1, 0]
    points = np.concatenate([box[:, :2], np.where(across[:, None], box[:, [0, 3]], box[:, [2, 1]])])
    frame = np.where(points == 0, -tmesh.frame, np.where(points == tmesh.extent, points + tmesh.frame, points))
    return np.concatenate([points, frame])


def walk(tmesh: "TMesh", axis: int, step: int, at: np.ndarray, row: np.ndarray) -> np.ndarray:
    """Next line that a ray meets.

    `axis` 0 walks along s on rows of constant t, 1 along t on columns of constant s; `step` is +1 or -1; `at` and `row`
    are the ray's place along and across the axis. Outside the mesh the ray meets the frame's full lines.
    """
    cell = np.clip(at if step > 0 else at - 1, 0, tmesh.extent[axis] - 1)[:, None]
    across = np.clip(np.stack([row - 1, row], axis=1), 0, tmesh.extent[1 - axis] - 1)
    elements = tmesh.locate(cell, across) if axis == 0 else tmesh.locate(across, cell)
    return _next_side(tmesh, axis, step, at, elements)


def _next_side(tmesh: "TMesh", axis: int, step: int, at: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Nearest side, in the walking direction, of the elements on both sides of the row; frame lines outside."""
    extent = tmesh.extent[axis]
    sides = tmesh.boxes[:, axis + 2 if step > 0 else axis].take(elements)
    if step > 0:
        return np.where((at < extent) & (at >= 0), np.minimum(sides[:, 0], sides[:, 1]), at + tmesh.frame)
    return np.where((at > 0) & (at <= extent), np.maximum(sides[:, 0], sides[:, 1]), at - tmesh.frame)
