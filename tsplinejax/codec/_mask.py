"""The mask of missing pixels, coarse to fine, each pixel in the context of its known neighbours."""

import numpy as np
from jaxtyping import Bool

from ._entropy import AbstractCoder, bit_model
from ._grid import PASSES, Pass, coarse_to_fine, extended, of_pass, total

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

    def top(stride: int, size: tuple[int, int]) -> np.ndarray:
        nowhere = np.zeros(size[0] * size[1], np.int64)
        wanted = None if missing is None else missing[::stride, ::stride].astype(np.int64).ravel()
        return _bits(coder.code(bit_model(_HALF, _HALF), (nowhere, nowhere), wanted)).reshape(1, *size)

    def between(stride: int, which: Pass, planes: dict[str, np.ndarray], size: tuple[int, int]) -> np.ndarray:
        known = {name: extended(layers[0], straight=False) for name, layers in planes.items()}
        if 0 in size:
            return np.zeros((1, *size), np.int64)
        near = total(known, which.nearest, size)
        groups = [total(known, group, size) for group in which.groups[1:]]
        far = np.minimum(sum(groups), 15)
        # Which two of the four are missing tells the direction of an edge.
        first = total(known, which.groups[0], size)
        model = models[which.name, stride == 1]
        wanted = None if missing is None else of_pass(missing, stride, which).astype(np.int64).ravel()
        contexts = ((near * 16 + far).ravel(), (near * 3 + first).ravel())
        return _bits(coder.code(model, contexts, wanted)).reshape(1, *size)

    return coarse_to_fine(shape, top, between)[0].astype(bool)


def _bits(values: np.ndarray) -> np.ndarray:
    """Zeros and ones, whatever a damaged file holds."""
    return values & 1
