"""A T-mesh made ready for a fit: Bézier elements, spline space, and the samples' blocks on it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from ..mesh import TMesh, anchor_codes
from ..space import (
    BezierElements,
    Blocks,
    Order,
    SplineSpace,
    bezier_elements,
    capacity_for,
    make_blocks,
    sample_ranges,
    spline_space,
)


@dataclass(frozen=True, eq=False)
class Discretisation:
    """Topology on the host, space on the device, and which samples lie in which Bézier element.

    **Attributes:**

    - `tmesh`, `elements`, `space`: the mesh, its Bézier elements and its spline space.
    - `ranges`: first sorted sample of each Bézier element and, last, their number.
    """

    tmesh: TMesh
    elements: BezierElements
    space: SplineSpace
    ranges: Int[np.ndarray, " bezier_1"]

    @property
    def capacity(self) -> int:
        """Padded length of the device arrays."""
        return self.space.capacity

    @cached_property
    def blocks(self) -> Blocks:
        """Blocks of all samples."""
        return make_blocks(self.ranges, np.arange(len(self.elements)))

    @cached_property
    def owner_starts(self) -> Int[np.ndarray, " elements"]:
        """First Bézier element of each element of the T-mesh."""
        return np.searchsorted(self.elements.owner, np.arange(self.tmesh.n_elements))

    def per_bezier(self, reduce: np.ufunc, per_block: np.ndarray) -> np.ndarray:
        """Reduce a number per block to one per Bézier element (zero where it holds no samples)."""
        result = np.zeros((len(self.elements), *per_block.shape[1:]), per_block.dtype)
        element = self.blocks.element
        if len(element):
            first = np.flatnonzero(np.diff(element, prepend=-1))
            result[element[first]] = reduce.reduceat(per_block, first, axis=0)
        return result

    def per_element(self, reduce: np.ufunc, per_bezier: np.ndarray) -> np.ndarray:
        """Reduce a number per Bézier element to one per element of the T-mesh."""
        return reduce.reduceat(per_bezier, self.owner_starts, axis=0)


def discretise(tmesh: TMesh, order: Order, *, dtype: np.dtype, rational: bool, least_capacity: int) -> Discretisation:
    """Extract a T-mesh's space and find the samples of its elements."""
    elements = bezier_elements(tmesh)
    assert elements.codes is not None
    capacity = capacity_for(max(len(elements), tmesh.n_anchors), least_capacity)
    space = spline_space(tmesh, dtype=dtype, rational=rational, elements=elements, capacity=capacity)
    return Discretisation(tmesh, elements, space, sample_ranges(order, elements.codes))


def same_elements(old: BezierElements, new: BezierElements) -> Int[np.ndarray, " new"]:
    """For each new Bézier element the index of the same old one, or -1."""
    assert old.codes is not None
    assert old.levels is not None
    assert new.codes is not None
    place = np.minimum(np.searchsorted(old.codes, new.codes), len(old) - 1)
    same = (old.codes[place] == new.codes) & (old.levels[place] == new.levels)
    return np.where(same, place, -1)


def unaltered_functions(old: TMesh, new: TMesh) -> Int[np.ndarray, " new"]:
    """For each new blending function the index of the same old one (same anchor and knots), or -1."""
    old_codes, new_codes = anchor_codes(old, old.anchors), anchor_codes(new, new.anchors)
    place = np.minimum(np.searchsorted(old_codes, new_codes), len(old_codes) - 1)
    same = (old_codes[place] == new_codes) & (old.local_knots[place] == new.local_knots).all(axis=(1, 2))
    return np.where(same, place, -1)


def grow(functions: Int[np.ndarray, "bezier K"], chosen: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """The chosen functions and their neighbours: all that share a Bézier element with one of them."""
    table = np.where(functions >= 0, functions, 0)
    touched = (chosen[table] & (functions >= 0)).any(axis=1)
    grown = chosen.copy()
    grown[table[touched][functions[touched] >= 0]] = True
    return grown
