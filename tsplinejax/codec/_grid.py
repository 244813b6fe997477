"""Heights over a grid, coarse to fine: every pixel is predicted from those already decoded, and corrected by a multiple
of one step.

The pixels of stride 2h are known; those of stride h follow in three passes, each predicted from its known neighbours:

    EE  known                    OO  from the EE around it
    OE  (odd row, even column)   from EE above and below, and OO on both sides
    EO  (even row, odd column)   from EE on both sides, OO above and below, and OE across the corners

A prediction is the mean of the four nearest pixels plus weighted differences between the means of further groups and
that mean: cubic by default, or by least squares on the map itself where that is worth the bytes of the weights.
Everything is in whole numbers, `UNITS` to a step, so that every machine decodes the same heights.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float, Int

from ._entropy import AbstractCoder, Model, number_model

#: Units of a prediction to one step of the corrections; a power of two.
UNITS = 64
#: Heights are at most this many units from their offset, so that predictions stay within 64 bits.
MOST_UNITS = 1 << 40
_FINE = 8  # strides up to this one may have weights of their own, where they predict at least _ENOUGH pixels
_ENOUGH = 256
_ONE = 256  # a weight of one
_LARGEST_WEIGHT = 2047
_MARGIN = 2
#: Lower ends of the classes of activity and roughness that choose a distribution.
_CLASSES = np.array([0, 1, 2, 3, 4, 6, 8, 11, 15, 20, 28, 40, 56, 80, 112, 160, 224, 320, 448, 640])
_ROUGH = 3
_LARGEST = 1023  # magnitudes count up to here in contexts: beyond the highest class in any case
_AT_A_TIME = 1 << 16  # pixels that are predicted at a time

#: Arrays of one grid: each layer says something else about its pixels.
Layers = tuple[np.ndarray, ...]

Neighbour = tuple[str, int, int]

#: The four planes of a grid: parity of row and column.
_PARITIES = {"EE": (0, 0), "OO": (1, 1), "OE": (1, 0), "EO": (0, 1)}


def _neighbours(parity: tuple[int, int], offsets: list[tuple[int, int]]) -> list[Neighbour]:
    """Plane and index offset there, of pixels at some offset from a pixel of a parity."""
    names = {place: name for name, place in _PARITIES.items()}
    found = []
    for down, right in offsets:
        row, column = parity[0] + down, parity[1] + right
        found.append((names[row % 2, column % 2], row // 2, column // 2))
    return found


def _around(down: int, right: int) -> list[tuple[int, int]]:
    """An offset and its mirror images."""
    return sorted({(a * down, b * right) for a in (-1, 1) for b in (-1, 1)})


@dataclass(frozen=True)
class Pass:
    """One plane of pixels: its parity, the four nearest known pixels, and the groups behind the weights."""

    name: str
    parity: tuple[int, int]
    nearest: list[Neighbour]
    groups: list[list[Neighbour]]
    weights: tuple[int, ...]


def _make_pass(
    name: str, parity: tuple[int, int], nearest: list, groups: list[list[tuple[int, int]]], weights: tuple[int, ...]
) -> Pass:
    return Pass(name, parity, _neighbours(parity, nearest), [_neighbours(parity, group) for group in groups], weights)


_CROSS = [(-1, 0), (1, 0), (0, -1), (0, 1)]
PASSES = (
    _make_pass(
        "OO",
        (1, 1),
        _around(1, 1),
        [[(-1, -1), (1, 1)], _around(1, 3), _around(3, 1), _around(3, 3)],
        (0, -36, -36, 4),
    ),
    _make_pass(
        "OE",
        (1, 0),
        _CROSS,
        [_around(1, 0), _around(3, 0), _around(0, 3), _around(1, 2), _around(2, 1)],
        (0, -16, -16, 0, 0),
    ),
    _make_pass(
        "EO",
        (0, 1),
        _CROSS,
        [_around(0, 1), _around(0, 3), _around(3, 0), _around(2, 1), _around(1, 2), _around(1, 1)],
        (0, -16, -16, 0, 0, 0),
    ),
)


def coarse_to_fine(
    shape: tuple[int, int],
    top: Callable[[int, tuple[int, int]], Layers],
    between: Callable[[int, Pass, dict[str, Layers], tuple[int, int]], Layers],
    *,
    straight: Sequence[bool],
) -> np.ndarray:
    """Build a grid from its coarsest pixels down to stride 1; its first layer is returned.

    **Arguments:**

    - `top`: makes the layers of the coarsest grid, from its stride and shape.
    - `between`: makes those of one pass, from stride, pass, the planes so far with their margins, and the shape.
    - `straight`: how each layer continues into a margin: in a straight line, or held.

    No array is larger than the grid of the stride at hand, so that damaged data end before they take memory.
    """

    def with_margins(layers: Layers) -> Layers:
        return tuple(extended(layer, straight=line) for layer, line in zip(layers, straight, strict=True))

    stride = 1
    while 2 * stride < max(shape):
        stride *= 2
    layers = top(stride, _size(shape, stride))
    while stride > 1:
        stride //= 2
        rows, columns = _size(shape, stride)
        planes = {"EE": with_margins(layers)}
        del layers
        for which in PASSES:
            down, right = which.parity
            size = ((rows + 1 - down) // 2, (columns + 1 - right) // 2)
            planes[which.name] = with_margins(between(stride, which, planes, size))
        if stride == 1:
            planes = {name: plane[:1] for name, plane in planes.items()}
        layers = tuple(
            _joined([planes[name][k] for name in _PARITIES], (rows, columns)) for k in range(len(planes["EE"]))
        )
        del planes
    return layers[0]


def _joined(planes: list[np.ndarray], shape: tuple[int, int]) -> np.ndarray:
    """The grid of four planes, without their margins."""
    joined = np.empty(shape, planes[0].dtype)
    for (down, right), plane in zip(_PARITIES.values(), planes, strict=True):
        joined[down::2, right::2] = plane[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN]
    return joined


def _size(shape: tuple[int, int], stride: int) -> tuple[int, int]:
    """Rows and columns of the grid of a stride."""
    return -(-shape[0] // stride), -(-shape[1] // stride)


def of_pass(array: np.ndarray, stride: int, which: Pass) -> np.ndarray:
    """The pixels of an array that a pass is about."""
    return array[::stride, ::stride][which.parity[0] :: 2, which.parity[1] :: 2]


def extended(plane: np.ndarray, *, straight: bool) -> np.ndarray:
    """The plane with a margin, continued in a straight line or held; a single row or column is held without a copy."""
    shape = tuple(count + 2 * _MARGIN for count in plane.shape)
    if plane.size == 0:
        return np.broadcast_to(plane.dtype.type(0), shape)
    margins = [0 if count == 1 else _MARGIN for count in plane.shape]
    padded = np.empty([count + 2 * margin for count, margin in zip(plane.shape, margins, strict=True)], plane.dtype)
    inside = [slice(margin, margin + count) for count, margin in zip(plane.shape, margins, strict=True)]
    padded[tuple(inside)] = plane
    for lines, part in zip((padded, padded.T), inside, strict=True):
        for step in range(1, part.start + 1):
            for end, outward in ((part.start, -step), (part.stop - 1, step)):
                lines[end + outward] = 2 * lines[end] - lines[end - outward] if straight else lines[end]
    return np.broadcast_to(padded, shape)


def strips(shape: tuple[int, int]) -> Iterator[tuple[slice, slice]]:
    """Windows of a few rows each that make up a grid, so that sums over neighbours take little memory."""
    rows, columns = shape
    height = max(1, _AT_A_TIME // max(1, columns))
    for start in range(0, rows, height):
        yield slice(start, min(start + height, rows)), slice(0, columns)


def total(planes: dict[str, np.ndarray], group: list[Neighbour], window: tuple[slice, slice]) -> np.ndarray:
    """Sum over a group of neighbours of the pixels in a window, from planes with margins."""
    parts = []
    for name, *offset in group:
        start = [_MARGIN + step + part.start for step, part in zip(offset, window, strict=True)]
        stop = [_MARGIN + step + part.stop for step, part in zip(offset, window, strict=True)]
        parts.append(planes[name][start[0] : stop[0], start[1] : stop[1]])
    return sum(parts[1:], parts[0])


@dataclass(eq=False)
class HeightCoder:
    """Codes heights in units, or reads them.

    **Attributes:**

    - `coder`: writes or reads.
    - `missing`: pixels that count for nothing.
    - `target`: heights in units to write, everywhere finite; `None` to read.
    """

    coder: AbstractCoder
    missing: Bool[np.ndarray, "rows columns"]
    target: Float[np.ndarray, "rows columns"] | None
    models: dict[str, Model] = field(
        default_factory=lambda: {which.name: number_model(len(_CLASSES) * _ROUGH, len(_CLASSES)) for which in PASSES}
    )
    weights: Model = field(default_factory=lambda: number_model(1, 1))

    def run(self) -> Int[np.ndarray, "rows columns"]:
        """The heights in units, as they are decoded."""
        return coarse_to_fine(self.missing.shape, self._top, self._between, straight=(True, False))

    def _top(self, stride: int, shape: tuple[int, int]) -> Layers:
        """The coarsest pixels, without a prediction."""
        wanted = None if self.target is None else self._steps(self.target[::stride, ::stride], 0)
        nowhere = np.zeros(shape, np.int64)
        steps = self._coded(number_model(1, 1), (nowhere, nowhere), wanted, np.ones(shape, bool))
        return steps * UNITS, np.zeros(shape, np.uint16)

    def _between(self, stride: int, which: Pass, planes: dict[str, Layers], shape: tuple[int, int]) -> Layers:
        """One pass: predict, correct."""
        heights, sizes = ({name: layers[k] for name, layers in planes.items()} for k in range(2))
        target = None if self.target is None else of_pass(self.target, stride, which)
        weights = self._chosen_weights(stride, which, heights, target, shape)
        predicted = np.empty(shape, np.int64)
        contexts = np.empty(shape, np.int8), np.empty(shape, np.int8)
        for window in strips(shape):
            base, differences = _terms(heights, which, window)
            predicted[window] = _predicted(base, differences, weights)
            contexts[0][window], contexts[1][window] = _contexts(sizes, which, differences, window)
        # Missing pixels count at coarse strides, where they carry the prediction across holes.
        coded = ~of_pass(self.missing, stride, which) | (stride > _FINE)
        wanted = None if target is None else self._steps(target, predicted)
        steps = self._coded(self.models[which.name], contexts, wanted, coded)
        size = np.abs(steps)
        found = np.minimum(size, _LARGEST, out=size).astype(np.uint16)
        steps *= UNITS
        steps += predicted
        return steps, found

    def _steps(self, target: np.ndarray, predicted: np.ndarray | int) -> np.ndarray:
        """Corrections as whole steps."""
        return np.rint((target - predicted) / UNITS).astype(np.int64)

    def _coded(
        self, model: Model, contexts: tuple[np.ndarray, np.ndarray], wanted: np.ndarray | None, coded: np.ndarray
    ) -> np.ndarray:
        """Corrections of the pixels that are coded, zero elsewhere."""
        steps = np.zeros(coded.shape, np.int64)
        values = None if wanted is None else wanted[coded]
        steps[coded] = self.coder.code(model, (contexts[0][coded], contexts[1][coded]), values)
        return steps

    def _chosen_weights(
        self,
        stride: int,
        which: Pass,
        heights: dict[str, np.ndarray],
        target: np.ndarray | None,
        shape: tuple[int, int],
    ) -> np.ndarray:
        """The weights of a pass: the usual ones, or at fine strides what the encoder found and wrote."""
        usual = np.array(which.weights)
        if stride > _FINE or shape[0] * shape[1] < _ENOUGH:
            return usual
        change = None
        if target is not None:
            valid = ~of_pass(self.missing, stride, which)
            base, differences = _terms(heights, which, (slice(0, shape[0]), slice(0, shape[1])))
            change = best_weights(base, differences, target, valid, usual) - usual
        nowhere = np.zeros(len(usual), np.int64)
        change = self.coder.code(self.weights, (nowhere, nowhere), change)
        return usual + np.clip(change, -2 * _LARGEST_WEIGHT, 2 * _LARGEST_WEIGHT)


def _terms(
    heights: dict[str, np.ndarray], which: Pass, window: tuple[slice, slice]
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Four times the mean of the nearest pixels, and what those of the further groups differ by, for a window."""
    base = total(heights, which.nearest, window)
    return base, [total(heights, group, window) * (4 // len(group)) - base for group in which.groups]


def _predicted(base: np.ndarray, differences: list[np.ndarray], weights: np.ndarray) -> np.ndarray:
    """Predictions in units; `base` and the differences are four times theirs."""
    total = base * _ONE + 2 * _ONE
    for difference, weight in zip(differences, weights.tolist(), strict=True):
        total += difference * weight
    return total >> 10


def _contexts(
    sizes: dict[str, np.ndarray], which: Pass, differences: list[np.ndarray], window: tuple[slice, slice]
) -> tuple[np.ndarray, np.ndarray]:
    """What to expect of a correction: from the corrections around it, and from how rough the heights are."""
    near = total(sizes, which.nearest, window)
    far = total(sizes, which.groups[-1], window) + total(sizes, which.groups[-2], window)
    roughness = sum(np.abs(difference) for difference in differences) // (UNITS * len(differences))
    rough = np.searchsorted(_CLASSES, roughness, side="right") - 1
    active = np.searchsorted(_CLASSES, 2 * near + far, side="right") - 1
    return active * _ROUGH + np.minimum(rough // 2, _ROUGH - 1), rough


def best_weights(
    base: np.ndarray, differences: list[np.ndarray], target: np.ndarray, valid: np.ndarray, usual: np.ndarray
) -> Int[np.ndarray, " groups"]:
    """Least-squares weights, or the usual ones where those do not save what they cost."""
    if np.count_nonzero(valid) < _ENOUGH:
        return usual
    rows = np.stack([difference[valid] for difference in differences], axis=1).astype(np.float64)
    wanted = 4 * target[valid] - base[valid]
    normal = rows.T @ rows
    normal[np.diag_indices(len(normal))] += 1 + 1e-6 * np.diag(normal)
    found = np.rint(np.linalg.solve(normal, rows.T @ wanted) * _ONE)
    found = np.clip(found, -_LARGEST_WEIGHT, _LARGEST_WEIGHT).astype(np.int64)

    def digits(weights: np.ndarray) -> float:
        predicted = _predicted(base, differences, weights)[valid]
        steps = np.abs(np.rint((target[valid] - predicted) / UNITS))
        return float(np.log2(1 + 2 * steps).sum() + np.count_nonzero(steps))

    return found if digits(found) + 10 * len(found) < digits(usual) else usual
