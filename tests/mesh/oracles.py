"""Slow and plain versions of what the mesh package computes, straight from the definitions.

Points, lines and edges are Python numbers in index coordinates; nothing here is shared with the package.
"""

from bisect import bisect_left, bisect_right
from itertools import product

import numpy as np

from tsplinejax.mesh import TMesh

Edge = tuple[int, int, int]  # place across, start and end along


def skeleton(tmesh: TMesh, axis: int) -> list[Edge]:
    """Closed edges that a ray along the axis can meet: element sides, and frame lines, run through the frame."""
    far = [int(extent) + 3 * tmesh.frame for extent in tmesh.extent]
    near = -3 * tmesh.frame
    other = 1 - axis
    edges = set()
    for box in tmesh.boxes.tolist():
        start, end = box[other], box[other + 2]
        start = near if start == 0 else start
        end = far[other] if end == tmesh.extent[other] else end
        edges |= {(box[axis], start, end), (box[axis + 2], start, end)}
    for step in range(1, 4):
        for line in (-step * tmesh.frame, tmesh.extent[axis] + step * tmesh.frame):
            edges.add((int(line), near, far[other]))
    return sorted(edges)


def anchors(tmesh: TMesh) -> set[tuple[int, int]]:
    """Crossings and ends of mesh lines with index in [-1, M + 1] × [-1, N + 1], where lines run through the frame."""
    (columns, rows), frame = (int(extent) for extent in tmesh.extent), tmesh.frame
    corners = {(box[i], box[j]) for box in tmesh.boxes.tolist() for i in (0, 2) for j in (1, 3)}

    def reached(value: int, end: int) -> list[int]:
        return [value] + [-frame] * (value == 0) + [end + frame] * (value == end)

    return {point for x, y in corners for point in product(reached(x, columns), reached(y, rows))}


def local_knots(tmesh: TMesh) -> np.ndarray:
    """Rule one: the two nearest edges on each side of each anchor, along its row and along its column."""
    edges = [skeleton(tmesh, axis) for axis in range(2)]
    knots = np.empty((tmesh.n_anchors, 2, 5), np.int64)
    for k, anchor in enumerate(tmesh.anchors.tolist()):
        for axis in range(2):
            row = anchor[1 - axis]
            met = sorted({place for place, start, end in edges[axis] if start <= row <= end})
            below, above = met[: bisect_left(met, anchor[axis])], met[bisect_right(met, anchor[axis]) :]
            knots[k, axis] = [*below[-2:], anchor[axis], *above[:2]]
    return knots


def closure(tmesh: TMesh, marked: np.ndarray) -> np.ndarray:
    """Morgenstern and Peterseim's closure: add lower elements that meet the patch of a chosen one, until none is left.

    The patch of an element of even level is 3 of its own widths across the new edge and 5 of its sizes along it.
    """
    chosen = marked.copy()
    first = 0 if tmesh.forest.first_cut == "s" else 1
    boxes, levels = tmesh.boxes, tmesh.levels
    changed = True
    while changed:
        changed = False
        for element in np.flatnonzero(chosen):
            box, level = boxes[element], levels[element]
            across = first if level % 2 == 0 else 1 - first
            size = box[2:] - box[:2]
            reach = np.where(np.arange(2) == across, 1, 2) * size
            low, high = box[:2] - reach, box[2:] + reach
            meets = ((boxes[:, :2] < high) & (boxes[:, 2:] > low)).all(axis=1)
            lower = meets & (levels < level) & ~chosen
            if lower.any():
                chosen |= lower
                changed = True
    return chosen


def t_junctions(tmesh: TMesh, axis: int) -> list[tuple[int, int, int]]:
    """Vertices (place along the axis, row) inside the mesh with no edge on one side along the axis, and which side."""
    edges = skeleton(tmesh, 1 - axis)  # edges that run along the axis: (row, start, end)
    found = []
    for vertex in {(b[i], b[j]) for b in tmesh.boxes.tolist() for i in (0, 2) for j in (1, 3)}:
        if not all(0 < v < e for v, e in zip(vertex, tmesh.extent, strict=True)):
            continue
        place, row = vertex[axis], vertex[1 - axis]
        on_row = [(start, end) for at, start, end in edges if at == row]
        for side in (-1, 1):
            if not any(start < place + side / 2 < end for start, end in on_row):
                found.append((place, row, side))
    return found


def extension(tmesh: TMesh, axis: int, junction: tuple[int, int, int]) -> tuple[int, int]:
    """Where a T-junction's extension starts and ends: two edges on where its own edge is missing, one back."""
    place, row, side = junction
    met = sorted({at for at, start, end in skeleton(tmesh, axis) if start <= row <= end})
    here = met.index(place)
    ends = sorted((met[here + 2 * side], met[here - side]))
    return max(ends[0], 0), min(ends[1], int(tmesh.extent[axis]))


def extensions_meet(tmesh: TMesh) -> bool:
    """Whether any extension along s has a point in common with one along t."""
    rows, columns = (
        [(junction[1], *extension(tmesh, axis, junction)) for junction in t_junctions(tmesh, axis)] for axis in range(2)
    )
    return any(
        left <= column <= right and low <= row <= high for row, left, right in rows for column, low, high in columns
    )
