"""The four corners of a boundary loop.

Kinks of the outline are candidates: places that turn outwards more than what lies just before and after them. Another
set are the points farthest out towards the corners of the smallest rectangle around the outline, each moved to a kink
where one is near. Of all sets of four the one wins whose kinks are sharpest (up to a right angle each) and whose
opposite sides are most alike; the rectangle's is preferred unless kinks say clearly otherwise.
"""

from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from .._errors import InputError
from ._layout import flattened
from ._points import best_turn, cloud_of, direction, duplicates, smallest_box
from ._triangles import Loop

_WINDOWS, _SHARES = (2, 4), (0.004, 0.06)  # in points, and as a share of the loop
_LEAST_KINK, _CLEAN = 0.3, 0.1  # radians
_BOX_BONUS = 1.0
_MOST = 12
_NEAR = 0.08  # of the loop's length


def find_corners(
    data: Any, boundary: ArrayLike, *, outward: ArrayLike = (0.0, 0.0, 1.0), neighbours: int = 30
) -> Int[np.ndarray, "4"]:
    """Find the four corners of a boundary.

    **Arguments:**

    - `data`: a `PointCloud`, an (m, 3) array of points, or a `HeightMap`, of which the valid pixels count.
    - `boundary`: (b,) indices of points in order, as `find_boundary` returns them.
    - `outward`: direction (x, y, z) out of the material: the outline as seen from there comes first.
    - `neighbours`: how many nearest points show a point's surroundings.

    **Returns:** (4,) indices of points in the boundary's order. The first is the one from which the first side runs
    most nearly along +x.

    **Raises:** `InputError` for a boundary that is not a loop of points of the cloud.

    >>> grid = np.stack(np.meshgrid(np.arange(5.0), np.arange(4.0), 0.0), axis=-1).reshape(-1, 3)
    >>> from tsplinejax.parameterisation import find_boundary
    >>> grid[find_corners(grid, find_boundary(grid)), :2].tolist()
    [[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]
    """
    points = cloud_of(data).points.astype(np.float64)
    loop = checked_loop(boundary, points)
    first, inverse = duplicates(points)
    flat = flattened(points[first], neighbours, direction(outward), inverse[loop])
    places = np.full((len(first), 2), np.nan)
    places[flat.kept] = flat.places
    if not np.isfinite(places[inverse[loop]]).all():
        raise InputError("the boundary must lie on the largest connected piece of the cloud")
    return loop[corners_of(points[loop], places[inverse[loop]])]


def checked_loop(boundary: ArrayLike, points: Float[np.ndarray, "m 3"]) -> Loop:
    """Return a boundary as an array of at least four different indices of points."""
    loop = np.asarray(boundary)
    if loop.ndim != 1 or loop.dtype.kind not in "iu" or len(loop) < 4:
        raise InputError(
            f"a boundary is a list of at least four indices of points, but got {loop.dtype} of shape {loop.shape}"
        )
    return _distinct(loop, points, "boundary")


def checked_corners(corners: ArrayLike, points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, "4"]:
    """Return corners as an array of four different indices of points."""
    given = np.asarray(corners)
    if given.shape != (4,) or given.dtype.kind not in "iu":
        raise InputError(f"corners are the indices of four points, but got {given.dtype} of shape {given.shape}")
    return _distinct(given, points, "corners")


def placed_corners(given: Int[np.ndarray, "4"], loop: Loop, points: Float[np.ndarray, "m 3"]) -> Int[np.ndarray, "4"]:
    """Return given corners as places in the loop, in its direction from the first one on.

    **Raises:** `InputError` unless they lie on the loop, in order one way or the other.
    """
    place = np.full(len(points), -1)
    place[loop] = np.arange(len(loop))
    missing = given[place[given] < 0]
    if len(missing):
        nearest = loop[np.argmin(np.linalg.norm(points[loop] - points[missing[0]], axis=1))]
        raise InputError(
            f"corners must lie on the boundary, but point {missing[0]} does not; the nearest one that does is {nearest}"
        )
    steps = (place[given] - place[given[0]]) % len(loop)
    if (np.diff(steps) > 0).all():
        return place[given]
    if (np.diff(steps[1:]) < 0).all():
        return place[given][[0, 3, 2, 1]]
    raise InputError(f"corners must be in order around the boundary, but got {given.tolist()}")


def _distinct(indices: np.ndarray, points: np.ndarray, what: str) -> np.ndarray:
    names, counts = np.unique(indices, return_counts=True)
    if names[0] < 0 or names[-1] >= len(points):
        raise InputError(f"{what} name points 0 to {len(points) - 1}, but got {names[0]} to {names[-1]}")
    if (counts > 1).any():
        raise InputError(f"{what} must name different points, but {names[counts > 1][0]} is given twice")
    return indices.astype(np.int64)


def corners_of(ring: Float[np.ndarray, "b 3"], places: Float[np.ndarray, "b 2"]) -> Int[np.ndarray, "4"]:
    """Return the places in a loop of its four corners.

    **Arguments:**

    - `ring`: the loop's points in space, in order.
    - `places`: the same in a layout.
    """
    arc = _arc(ring)
    for window in _WINDOWS:
        candidates, kinks, noise = _kinks(ring, places, np.clip(window / len(ring), *_SHARES))
        if noise < _CLEAN:
            break
    sharp = np.full(len(ring), 0.0)
    sharp[candidates] = np.minimum(kinks, np.pi / 2)
    sets = np.stack([_box_corners(arc, places, candidates), *combinations(np.sort(candidates), 4)])
    sets = sets[[len(np.unique(four)) == 4 for four in sets]]
    if not len(sets):
        raise InputError("the boundary shows no four corners; give them as corners=")
    score = sharp[sets].sum(axis=1) + _balance(arc[sets])
    score[0] += _BOX_BONUS
    corners = sets[int(np.argmax(score))]
    return np.roll(corners, -best_turn(ring[corners]))


def _balance(at: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " n"]:
    """How alike the lengths of opposite sides are, 2 if they are the same, for corners at shares of the loop."""
    sides = np.diff(at, axis=1, append=at[:, :1] + 1.0)
    return (np.minimum(sides[:, :2], sides[:, 2:]) / np.maximum(sides[:, :2], sides[:, 2:])).sum(axis=1)


def _arc(ring: Float[np.ndarray, "b d"]) -> Float[np.ndarray, " b"]:
    """Length along the loop up to each point, as a share of the whole."""
    steps = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1)
    return np.concatenate([[0.0], np.cumsum(steps[:-1])]) / steps.sum()


def _kinks(
    ring: Float[np.ndarray, "b 3"], places: Float[np.ndarray, "b 2"], share: float
) -> tuple[Int[np.ndarray, " c"], Float[np.ndarray, " c"], float]:
    """Points where the loop turns outwards more sharply than beside them; by what angle more; the noise of that.

    Angles are those between chords of one window, a share of the loop, in space or in the layout, whichever is more;
    the layout tells outwards from inwards. A ragged loop turns everywhere: what does not stand out of that is no kink.
    """
    steps = int(np.clip(4 * len(ring), 500, 20_000))
    arc, even = _arc(ring), np.arange(steps) / steps
    window = max(round(share * steps), 1)
    path, flat = (
        np.stack([np.interp(even, arc, curve[:, k], period=1.0) for k in range(curve.shape[1])], axis=1)
        for curve in (ring, places)
    )
    (before, after), (coming, going) = _chords(path, window), _chords(flat, window)
    left = np.sign(coming[:, 0] * going[:, 1] - coming[:, 1] * going[:, 0]) * _winding(places)
    in_space, in_layout = _excess(left * _angle(before, after), window), _excess(left * _angle(coming, going), window)
    kink, noise = np.maximum(in_space, in_layout), 1.4826 * float(np.median(np.abs(in_space)))
    around = np.lib.stride_tricks.sliding_window_view(np.pad(kink, window, mode="wrap"), 2 * window + 1)
    peak = np.flatnonzero((kink > _LEAST_KINK) & (kink >= around.max(axis=1)))
    peak = peak[np.argsort(-kink[peak], kind="stable")][:_MOST]
    # The corner itself is the point farthest out along the bisector, near the peak.
    apart = _apart(arc, even[peak])
    reach = np.maximum(share, apart.min(axis=1, initial=1.0))[:, None]
    height = np.where(apart <= reach, (before - after)[peak] @ ring.T, -np.inf)
    found, which = np.unique(height.argmax(axis=1), return_index=True)
    return found, kink[peak][which], noise


def _chords(path: Float[np.ndarray, "n d"], window: int) -> tuple[np.ndarray, np.ndarray]:
    """Directions over one window before and after each step of a closed path."""
    before, after = path - np.roll(path, window, axis=0), np.roll(path, -window, axis=0) - path
    return before / _norm(before), after / _norm(after)


def _angle(one: Float[np.ndarray, "n d"], other: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    return np.arccos(np.clip((one * other).sum(axis=1), -1, 1))


def _excess(turn: Float[np.ndarray, " n"], window: int) -> Float[np.ndarray, " n"]:
    """How much more a path turns than beside: a kink shows within one window, so beside is further off than that."""
    return turn - np.mean([np.roll(turn, round(step * window)) for step in (-2.0, -1.5, 1.5, 2.0)], axis=0)


def _apart(arc: Float[np.ndarray, " b"], places: Float[np.ndarray, " c"]) -> Float[np.ndarray, "c b"]:
    """Shares of the loop between places and all points, the shorter way round."""
    return np.abs((arc - places[:, None] + 0.5) % 1.0 - 0.5)


def _norm(vectors: np.ndarray) -> np.ndarray:
    return np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)


def _winding(places: Float[np.ndarray, "b 2"]) -> float:
    after = np.roll(places, -1, axis=0)
    return float(np.sign((places[:, 0] * after[:, 1] - places[:, 1] * after[:, 0]).sum()))


def _box_corners(arc: np.ndarray, places: Float[np.ndarray, "b 2"], candidates: np.ndarray) -> Int[np.ndarray, "4"]:
    """The points farthest out towards the corners of the smallest rectangle, or a kink near them."""
    box = smallest_box(places)
    sides = box[[1, 3]] - box[0]
    unit = (places - box[0]) @ (sides / (sides**2).sum(axis=1, keepdims=True)).T - 0.5
    corners = np.argmax(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ unit.T, axis=1)
    for kink in candidates:
        apart = _apart(arc[corners], arc[[kink]])[0]
        if apart.min() < _NEAR:
            corners[int(apart.argmin())] = kink
    return np.sort(corners)
