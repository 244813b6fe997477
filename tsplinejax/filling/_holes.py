"""Where a map is missing: holes, their depth, which of them touch the border, and the windows that cover them."""

from collections.abc import Iterator
from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import distance_transform_edt, find_objects, label, maximum, maximum_filter, minimum, minimum_filter

from ._filler import Window

#: Side of the tiles that cut large holes; half of it gathers tiny ones.
_TILE = 32
#: A hole at most this wide, and at least this deep, has a window of its own.
_WIDEST, _SHALLOWEST = 64, 3.0
_RIM = 7

Box = tuple[int, int, int, int]


def labelled(missing: Bool[np.ndarray, "r c"]) -> tuple[Int[np.ndarray, "r c"], int]:
    """Number the holes, sets of pixels that touch along their sides, from 1; also how many there are.

    >>> labelled(np.array([[True, False, True]]))[1]
    2
    """

    numbers, count = label(missing)  # pyright: ignore[reportGeneralTypeIssues]
    return numbers, int(count)


def interior(missing: Bool[np.ndarray, "r c"]) -> Bool[np.ndarray, "r c"]:
    """The missing pixels of holes that do not touch the map's border.

    >>> interior(np.array([[1, 1, 1, 1], [1, 0, 0, 0], [1, 0, 1, 0], [1, 0, 0, 0]], bool)).sum().item()
    1
    """
    numbers, count = labelled(missing)
    outer = np.zeros(count + 1, bool)
    for edge in (numbers[0], numbers[-1], numbers[:, 0], numbers[:, -1]):
        outer[edge] = True
    outer[0] = True
    return ~outer[numbers]


def depth_of(missing: Bool[np.ndarray, "r c"]) -> Float[np.ndarray, "r c"]:
    """Distance in pixels of each missing pixel from the nearest known one; infinite where nothing is known."""

    if missing.all():
        return np.full(missing.shape, np.inf)
    return np.asarray(distance_transform_edt(missing))


def windows(wanted: Bool[np.ndarray, "r c"], depth: Float[np.ndarray, "r c"], margin: int) -> Iterator[Window]:
    """Cover the wanted pixels by windows with margins of what tells them.

    A hole of middling size has a window of its own. Tiny ones share the windows of tiles. Tiles cut large ones, too,
    and there the margin is wide enough that the cut through the hole is felt little.
    """

    numbers, count = labelled(wanted)
    boxes = np.array([(r.start, c.start, r.stop, c.stop) for r, c in find_objects(numbers)], int).reshape(-1, 4)
    deepest = np.asarray(maximum(depth, numbers, np.arange(1, count + 1))).reshape(-1)
    own = ((boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0) <= _WIDEST) & (deepest >= _SHALLOWEST)
    for number in np.flatnonzero(own):
        box = tuple(boxes[number])
        yield _window(numbers, box, margin, lambda part, hole=number + 1: part == hole)
    for chosen, side in ((~own & (deepest < _SHALLOWEST), _TILE // 2), (~own & (deepest >= _SHALLOWEST), _TILE)):
        shared = np.append(False, chosen)[numbers]
        for top, left in product(range(0, wanted.shape[0], side), range(0, wanted.shape[1], side)):
            tile = shared[top : top + side, left : left + side]
            if tile.any():
                rows, columns = np.flatnonzero(tile.any(axis=1)), np.flatnonzero(tile.any(axis=0))
                box = (top + rows[0], left + columns[0], top + rows[-1] + 1, left + columns[-1] + 1)
                reach = int(depth[top : top + side, left : left + side][tile].max())
                yield _window(shared, box, margin + 2 * (reach - 1), lambda part: part)


def _window(marked: np.ndarray, box: Box, margin: int, wanted_in) -> Window:
    """The window of a box and its margin; what is wanted lies in the box."""
    top, left, bottom, right = (int(side) for side in box)
    rows = slice(max(top - margin, 0), min(bottom + margin, marked.shape[0]))
    columns = slice(max(left - margin, 0), min(right + margin, marked.shape[1]))
    wanted = np.zeros((rows.stop - rows.start, columns.stop - columns.start), bool)
    inside = (slice(top - rows.start, bottom - rows.start), slice(left - columns.start, right - columns.start))
    wanted[inside] = wanted_in(marked[top:bottom, left:right])
    return Window(rows, columns, wanted)


def bounds_of(
    heights: Float[np.ndarray, "r c"], wanted: Bool[np.ndarray, "r c"]
) -> tuple[Float[np.ndarray, "r c"], Float[np.ndarray, "r c"]]:
    """Lowest and highest known height at the rim of each wanted pixel's hole, three pixels wide; infinite elsewhere.

    >>> low, high = bounds_of(np.array([[0.0, 1.0, np.nan, 3.0]]), np.array([[False, False, True, False]]))
    >>> low[0, 2].item(), high[0, 2].item()
    (0.0, 3.0)
    """

    missing = np.isnan(heights)
    numbers, count = labelled(missing)
    low, high = np.full(heights.shape, -np.inf), np.full(heights.shape, np.inf)
    if wanted.any():
        holes, here = np.arange(1, count + 1), numbers[missing]
        below = minimum_filter(np.where(missing, np.inf, heights), _RIM)[missing]
        above = maximum_filter(np.where(missing, -np.inf, heights), _RIM)[missing]
        low[wanted] = np.asarray(minimum(below, here, holes))[numbers[wanted] - 1]
        high[wanted] = np.asarray(maximum(above, here, holes))[numbers[wanted] - 1]
    return low, high
