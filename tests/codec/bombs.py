"""Small files that ask for much memory: wrong counts, and coded numbers that stand for very many more."""

import numpy as np

from tsplinejax.codec._compressed import ModelPart
from tsplinejax.codec._entropy import Encoder
from tsplinejax.codec._grid import HeightCoder
from tsplinejax.codec._lossless import encode_exactly
from tsplinejax.codec._mask import code_mask
from tsplinejax.codec._model import RoundedModel, code_model
from tsplinejax.codec._sections import sealed
from tsplinejax.mesh import b_lattice

SIDE = 2000


def bombs(grid: dict, model: dict) -> dict[str, bytes]:
    """Files by name, made with the header entries of two sound ones: predicted pixels, and a T-spline."""
    flat, pixels = {**grid, "missing": 0}, _pixels((SIDE, SIDE))
    files = {
        "shape of a million million": sealed({**flat, "shape": [1 << 20, 1 << 20]}, pixels),
        "more pixels than are coded": sealed({**flat, "shape": [2 * SIDE, 2 * SIDE]}, pixels),
        "flat pixels": sealed({**flat, "shape": [SIDE, SIDE]}, pixels),
        "flat pixels in a row": sealed({**flat, "shape": [1, 1 << 21]}, _pixels((1, 1 << 21))),
        "a mask and no pixels": sealed({**grid, "shape": [SIDE, SIDE], "missing": SIDE**2 - 1}, _mask()),
        "bytes that nobody reads": sealed(flat, [pixels[0] + bytes(4 << 20), bytes(4 << 20)]),
        "many sections": sealed(flat, [b""] * 300_000),
        "many objects in the header": sealed({**flat, "provenance": {"": [{}] * 300_000}}, pixels),
        "long text in the header": sealed({**flat, "unit": "x" * 1_000_000}, pixels),
        "a lattice of control points that are all zero": _lattice(model, (120, 120)),
    }
    for count in (10**4, 10**6, 10**7):
        files[f"{count} zeros, deflated"] = _deflated(grid, count, count)
        files[f"{count} zeros, deflated, of 100"] = _deflated(grid, count, 100)
    for lattice in ([5000, 5000], [1 << 14, 1 << 14], [1, 1 << 20]):
        part = {**model["model"], "lattice": lattice, "elements": lattice[0] * lattice[1]}
        part["control_points"] = (lattice[0] + 3) * (lattice[1] + 3)
        files[f"lattice of {lattice}"] = sealed({**model, "model": part}, pixels)
    return files


def _pixels(shape: tuple[int, int]) -> list[bytes]:
    """Sections of a flat map."""
    coder = Encoder()
    HeightCoder(coder, np.zeros(shape, bool), np.zeros(shape)).run()
    return list(coder.finish())


def _mask() -> list[bytes]:
    """Sections that end behind a mask with a single valid pixel."""
    missing = np.ones((SIDE, SIDE), bool)
    missing[SIDE // 2, SIDE // 2] = False
    coder = Encoder()
    code_mask(coder, missing.shape, missing)
    return list(coder.finish())


def _deflated(entries: dict, count: int, declared: int) -> bytes:
    """A lossless file of so many heights, in a thousandth of their bytes."""
    header = {**entries, "mode": "lossless", "missing": 0, "shape": [1, declared]}
    zeros = np.zeros((1, count))
    return sealed(header, [*Encoder().finish(), encode_exactly(zeros, np.zeros(zeros.shape, bool))])


def _lattice(entries: dict, lattice: tuple[int, int]) -> bytes:
    """A T-spline that is zero everywhere."""
    tmesh = b_lattice(*lattice)
    part = ModelPart(lattice, "s", 1.0, tmesh.n_anchors, tmesh.n_elements, residual=False)
    coder = Encoder()
    code_model(coder, part, RoundedModel(tmesh, np.zeros(tmesh.n_anchors, np.int64)))
    changed = {"lattice": list(lattice), "first_cut": "s", "control_points": tmesh.n_anchors}
    changed |= {"elements": tmesh.n_elements, "residual": False}
    return sealed({**entries, "missing": 0, "model": {**entries["model"], **changed}}, list(coder.finish()))
