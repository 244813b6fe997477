"""The topology of a bisected lattice: one split bit for each element that may be split, level by level.

In an analysis-suitable mesh an element of level k is split only where its patch (Morgenstern & Peterseim 2015) holds
no element of a lower level, so most bits need not be written. The others depend on which neighbours exist and, in four
phases by the parity of an element's place, on which of them are split.
"""

import numpy as np
from jaxtyping import Bool, Int

from .._errors import InputError
from ..mesh import MAX_LEVEL, Direction, TMesh, forest_from_boxes
from ..mesh._codes import DEPTH, UNIT, cell_boxes, z_order
from ._entropy import AbstractCoder, Model, bit_model

_PHASES = ((0, 0), (1, 1), (0, 1), (1, 0))
_RINGS = 16
#: How often a cell is split, by how many of its neighbours are known to be.
_SHARES = (np.arange(9) + 1) / 12


def code_topology(
    coder: AbstractCoder, lattice: tuple[int, int], first_cut: Direction, tmesh: TMesh | None, most_elements: int
) -> TMesh:
    """Write the topology of a mesh, or read it where `tmesh` is `None`; the mesh is returned.

    **Raises:** `InputError` where more elements are read than `most_elements`.
    """
    codes = _lattice_codes(lattice, first_cut)
    model = bit_model(np.tile(np.repeat(_SHARES, 2), 4), np.repeat(_SHARES, 27))
    leaves, level, count = [], 0, len(codes)
    while codes.size and level < MAX_LEVEL:
        cells = _Cells(codes, level, lattice, first_cut)
        given = None if tmesh is None else _split_in(tmesh, cells)
        split = _code_level(coder, model, cells, given)
        leaves.append(cell_boxes(first_cut, np.full(np.count_nonzero(~split), level), codes[~split]))
        count += np.count_nonzero(split)
        if count > most_elements:
            raise InputError(f"its mesh has more than the {most_elements} elements that its header declares")
        half = np.int64(1) << (2 * DEPTH - level - 1)
        codes = np.stack([codes[split], codes[split] + half], axis=1).ravel()
        level += 1
    leaves.append(cell_boxes(first_cut, np.full(codes.size, level), codes))
    return forest_from_boxes(np.concatenate(leaves), lattice, first_cut=first_cut, border="clamped")


def _lattice_codes(lattice: tuple[int, int], first_cut: Direction) -> Int[np.ndarray, " elements"]:
    x, y = np.meshgrid(np.arange(lattice[0]) * UNIT, np.arange(lattice[1]) * UNIT, indexing="ij")
    major, minor = (x, y) if first_cut == "s" else (y, x)
    return np.sort(z_order(major.ravel(), minor.ravel()))


def _split_in(tmesh: TMesh, cells: "_Cells") -> Bool[np.ndarray, " cells"]:
    """Which cells a mesh splits."""
    boxes = cells.boxes
    return tmesh.levels[tmesh.locate(boxes[:, 0], boxes[:, 1])] > cells.level


class _Cells:
    """The cells of one level, sorted by code, and how to find their neighbours."""

    def __init__(self, codes: np.ndarray, level: int, lattice: tuple[int, int], first_cut: Direction) -> None:
        self.codes, self.level, self.first_cut = codes, level, first_cut
        self.boxes = cell_boxes(first_cut, np.full(len(codes), level), codes)
        self.size = np.array([UNIT >> ((level + 1) >> 1), UNIT >> (level >> 1)])
        if first_cut == "t":
            self.size = self.size[::-1]
        self.extent = np.array(lattice) * UNIT
        self.place = self.boxes[:, :2] // self.size

    def neighbours(self, right: int, up: int) -> tuple[np.ndarray, np.ndarray]:
        """For each cell the one so many cells right and up, or -1; and whether that is outside the mesh."""
        corner = self.boxes[:, :2] + np.array([right, up]) * self.size
        outside = np.any((corner < 0) | (corner >= self.extent), axis=1)
        corner = np.where(outside[:, None], 0, corner)
        major, minor = (corner[:, 0], corner[:, 1]) if self.first_cut == "s" else (corner[:, 1], corner[:, 0])
        code = z_order(major, minor)
        found = np.minimum(np.searchsorted(self.codes, code), len(self.codes) - 1)
        return np.where(outside | (self.codes[found] != code), -1, found), outside


def _code_level(
    coder: AbstractCoder, model: Model, cells: _Cells, given: Bool[np.ndarray, " cells"] | None
) -> Bool[np.ndarray, " cells"]:
    """Split bits of one level."""
    free, ring = _surroundings(cells)
    around = [cells.neighbours(right, up)[0] for right in (-1, 0, 1) for up in (-1, 0, 1) if (right, up) != (0, 0)]
    split = np.zeros(len(cells.codes), np.int64)
    known = np.zeros(len(cells.codes), np.int64)
    for phase, parity in enumerate(_PHASES):
        chosen = np.flatnonzero(free & np.all(cells.place % 2 == parity, axis=1))
        neighbours = np.stack([index[chosen] for index in around])
        there = neighbours >= 0
        splits = (split[neighbours] * there).sum(axis=0)
        seen = (known[neighbours] * there).sum(axis=0)
        first = (phase * 9 + splits) * 2 + (cells.level % 2)
        second = (splits * 9 + seen) * 3 + np.minimum(ring[chosen] * 3 // _RINGS, 2)
        wanted = None if given is None else given[chosen].astype(np.int64)
        split[chosen] = coder.code(model, (first, second), wanted) & 1
        known[chosen] = 1
        known[~free] = 1
    return split.astype(bool)


def _surroundings(cells: _Cells) -> tuple[np.ndarray, np.ndarray]:
    """Which cells may be split, and how many cells of the same level there are a little farther away (0 to 16)."""
    across, along = (1, 2) if cells.level % 2 == 0 else (2, 1)
    if cells.first_cut == "t":
        across, along = along, across
    free = np.ones(len(cells.codes), bool)
    ring = np.zeros(len(cells.codes), np.int64)
    for right in range(-3, 4):
        for up in range(-3, 4):
            found, outside = cells.neighbours(right, up)
            there = (found >= 0) | outside
            # The patch, in cells of this level: across the new edge one each side, along it two.
            if abs(right) <= across and abs(up) <= along:
                free &= there
            elif abs(right) == 3 or abs(up) == 3:
                ring += there
    return free, np.minimum(ring * _RINGS // 24, _RINGS)
