"""Z-order codes name cells: they are unique, sorted by nesting, and lead back to the cell's box."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from tsplinejax.mesh import DEPTH, MAX_LEVEL, cell_boxes
from tsplinejax.mesh._codes import UNIT, z_order


def _interleave(major: int, minor: int) -> int:
    """Bit by bit, as the definition says."""
    return sum(((major >> k) & 1) << (2 * k + 1) | ((minor >> k) & 1) << (2 * k) for k in range(31))


@given(st.integers(0, 2**30 - 1), st.integers(0, 2**30 - 1))
def test_codes_interleave_bits(major, minor):
    """A code's bits are those of the two coordinates in turn, the major one's first."""
    assert int(z_order(np.array([major]), np.array([minor]))[0]) == _interleave(major, minor)


@pytest.mark.parametrize("first_cut", ["s", "t"])
@given(st.integers(0, 2**14 * 4 - 1), st.integers(0, 2**14 * 4 - 1), st.integers(0, MAX_LEVEL))
def test_boxes_of_codes(first_cut, column, row, level):
    """The box of a level-k code is its lattice square halved k times, the code's coordinates at its lower corner."""
    major_size, minor_size = UNIT >> ((level + 1) // 2), UNIT >> (level // 2)
    major, minor = column // major_size * major_size, row // minor_size * minor_size
    box = cell_boxes(first_cut, np.array([level]), z_order(np.array([major]), np.array([minor])))[0]
    expected = [major, minor, major + major_size, minor + minor_size]
    assert box.tolist() == (expected if first_cut == "s" else [expected[k] for k in (1, 0, 3, 2)])


def test_deepest_cells_are_whole():
    """At the deepest level a cell still spans whole index steps in both directions, so Bézier halves exist, too."""
    box = cell_boxes("s", np.array([MAX_LEVEL + 2]), np.array([0]))[0]
    assert (box[2:] - box[:2] >= 1).all()
    assert MAX_LEVEL + 2 == 2 * DEPTH
