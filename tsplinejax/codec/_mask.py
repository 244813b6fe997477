"""The mask of missing pixels, coarse to fine, each pixel in the context of its known neighbours."""

import numpy as np
from jaxtyping import Bool

from ._entropy import AbstractCoder, bit_model
from ._grid import PASSES, Layers, Pass, coarse_to_fine, of_pass, strips, total

#: How often a pixel is missing, by how many of its four nearest are; and without any neighbour.
_SHARES, _HALF = np.arange(5) / 4, np.full(1, 0.5)


def code_mask(
    coder: AbstractCoder, shape: tuple[int, int], missing: Bool[np.ndarray, "rows columns"] | None
) -> Bool[np.ndarray, "rows columns"]:
    """Write a mask, or read it where `missing` is `None`; either way it is returned."""
    models = {
        (which.name, finest): bit_model(np.repeat(_SHARES, 16), np.repeat(_SHARES, 3))
        for which in PASSES
        for finest in (False, True)
    }

    def top(stride: int, size: tuple[int, int]) -> Layers:
        nowhere = np.zeros(size[0] * size[1], np.int8)
        wanted = None if missing is None else missing[::stride, ::stride].astype(np.int64).ravel()
        return (_bits(coder.code(bit_model(_HALF, _HALF), (nowhere, nowhere), wanted)).reshape(size),)

    def between(stride: int, which: Pass, planes: dict[str, Layers], size: tuple[int, int]) -> Layers:
        known = {name: layers[0] for name, layers in planes.items()}
        contexts = np.empty(size, np.int8), np.empty(size, np.int8)
        for window in strips(size):
            near = total(known, which.nearest, window)
            far = np.minimum(sum(total(known, group, window) for group in which.groups[1:]), 15)
            # Which two of the four are missing tells the direction of an edge.
            first = total(known, which.groups[0], window)
            contexts[0][window], contexts[1][window] = near * 16 + far, near * 3 + first
        wanted = None if missing is None else of_pass(missing, stride, which).astype(np.int64).ravel()
        bits = coder.code(models[which.name, stride == 1], (contexts[0].ravel(), contexts[1].ravel()), wanted)
        return (_bits(bits).reshape(size),)

    return coarse_to_fine(shape, top, between, straight=(False,)).view(bool)


def _bits(values: np.ndarray) -> np.ndarray:
    """Zeros and ones, whatever a damaged file holds."""
    return (values & 1).astype(np.uint8)
