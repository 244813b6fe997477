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


def _spread_table() -> np.ndarray:
    """The 16-bit numbers with a zero bit between any two of their bits."""
    values = np.arange(1 << 16, dtype=np.int64)
    spread = np.zeros_like(values)
    for bit in range(16):
        spread |= ((values >> bit) & 1) << (2 * bit)
    return spread


_SPREAD = _spread_table()


def z_order(major: np.ndarray, minor: np.ndarray) -> np.ndarray:
    """Z-order code of non-negative 31-bit coordinates; `major` holds the more significant bit of each pair."""
    high = (_SPREAD[major >> 16] << 32) | _SPREAD[major & 0xFFFF]
    low = (_SPREAD[minor >> 16] << 32) | _SPREAD[minor & 0xFFFF]
    return (high << 1) | low


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
