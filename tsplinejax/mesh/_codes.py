"""Z-order codes: the names of a dyadic forest's cells.

A cell of level k is the square of its lattice bisected k times, alternately in the two directions. Its lower corner's
coordinates, interleaved bit by bit with the first cut's direction on top, are its code; its 2^(2 DEPTH - k) codes are
consecutive, so a sorted list of codes is the whole topology.
"""

from typing import Literal

import numpy as np

# Halvings of a lattice square in each direction: codes of both coordinates fit 62 bits, coordinates fit int32.
DEPTH = 16
UNIT = 1 << DEPTH
MAX_LEVEL = 2 * DEPTH - 2
MAX_LATTICE = 1 << 14

Direction = Literal["s", "t"]
Border = Literal["clamped", "open"]


def z_order(major: np.ndarray, minor: np.ndarray) -> np.ndarray:
    """Z-order code of non-negative 31-bit coordinates; `major` holds the more significant bit of each pair."""
    return (_spread(major) << 1) | _spread(minor)


def _spread(coordinates: np.ndarray) -> np.ndarray:
    """The coordinates with a zero bit between any two of their bits."""
    bits = np.array(coordinates, np.int64)
    moved = np.empty_like(bits)
    for shift, mask in (
        (16, 0x0000FFFF0000FFFF),
        (8, 0x00FF00FF00FF00FF),
        (4, 0x0F0F0F0F0F0F0F0F),
        (2, 0x3333333333333333),
        (1, 0x5555555555555555),
    ):
        np.left_shift(bits, shift, out=moved)
        bits |= moved
        bits &= mask
    return bits


def cell_boxes(first_cut: Direction, levels: np.ndarray, codes: np.ndarray) -> np.ndarray:
    """Index boxes of the cells with the given levels and codes."""
    major, minor = _compact(codes >> 1), _compact(codes)
    across = UNIT >> ((levels + 1) >> 1)  # size along the first cut's direction: it is cut at even levels
    along = UNIT >> (levels >> 1)
    x, y, width, height = (major, minor, across, along) if first_cut == "s" else (minor, major, along, across)
    return np.stack([x, y, x + width, y + height], axis=1)


def _compact(codes: np.ndarray) -> np.ndarray:
    """Every second bit of the codes, packed: the inverse of spreading."""
    bits = codes & 0x5555555555555555
    for shift, mask in (
        (1, 0x3333333333333333),
        (2, 0x0F0F0F0F0F0F0F0F),
        (4, 0x00FF00FF00FF00FF),
        (8, 0x0000FFFF0000FFFF),
        (16, 0x00000000FFFFFFFF),
    ):
        bits = (bits | (bits >> shift)) & mask
    return bits
