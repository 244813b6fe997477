"""A T-mesh made ready for a fit: its Bézier elements, and the device rows they keep from step to step."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from ..mesh import Refinement, TMesh
from ..space import BezierElements, bezier_elements, capacity_for, refine_elements


@dataclass(frozen=True, eq=False)
class Discretisation:
    """Topology on the host, and where its Bézier elements live on the device.

    **Attributes:**

    - `tmesh`, `elements`: the mesh and its Bézier elements, in the order of their codes.
    - `slots`: device row of each Bézier element; the rows 0 ... number of elements - 1 are all in use.
    - `capacity`: padded length of the device arrays.
    """

    tmesh: TMesh
    elements: BezierElements
    slots: Int[np.ndarray, " bezier"]
    capacity: int

    @cached_property
    def owner_starts(self) -> Int[np.ndarray, " elements"]:
        """First Bézier element of each element of the T-mesh."""
        return np.searchsorted(self.elements.owner, np.arange(self.tmesh.n_elements))

    def per_element(self, reduce: np.ufunc, by_slot: np.ndarray) -> np.ndarray:
        """Reduce a number per device row to one per element of the T-mesh."""
        return reduce.reduceat(by_slot[self.slots], self.owner_starts, axis=0)

    def by_slot(self, per_bezier: np.ndarray) -> np.ndarray:
        """Rows of the Bézier elements in the order of their slots."""
        result = np.empty_like(per_bezier)
        result[self.slots] = per_bezier
        return result

    def places_of(self, slots: np.ndarray) -> np.ndarray:
        """The Bézier elements in these slots."""
        element = np.empty(len(self.slots), np.int64)
        element[self.slots] = np.arange(len(self.slots))
        return element[slots]

    def touched_by(self, chosen: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " bezier"]:
        """Bézier elements on which a chosen function lives."""
        functions = self.elements.functions
        return np.any(chosen[np.maximum(functions, 0)] & (functions >= 0), axis=1)

    def with_neighbours(self, chosen: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
        """The chosen functions and all that share a Bézier element with one of them."""
        functions = self.elements.functions[self.touched_by(chosen)]
        grown = chosen.copy()
        grown[functions[functions >= 0]] = True
        return grown


@dataclass(frozen=True, eq=False)
class Change:
    """What a refinement left as it was.

    **Attributes:**

    - `mesh`: the refined mesh.
    - `kept`: for each new blending function the index of the same old one (same anchor and knots), or -1.
    - `changed`: Bézier elements that are new.
    - `touched`: Bézier elements that are new, or whose functions or local knots are.
    """

    mesh: Discretisation
    kept: Int[np.ndarray, " new_functions"]
    changed: Bool[np.ndarray, " bezier"]
    touched: Bool[np.ndarray, " bezier"]


def discretise(tmesh: TMesh, least_capacity: int) -> Discretisation:
    """A mesh on its own: slots in the order of the codes."""
    elements = bezier_elements(tmesh)
    return Discretisation(tmesh, elements, np.arange(len(elements)), _capacity(tmesh, elements, least_capacity))


def change(old: Discretisation, refinement: Refinement, least_capacity: int) -> Change:
    """A refined mesh, whose unchanged Bézier elements keep their slots."""
    update = refine_elements(old.elements, old.tmesh, refinement)
    elements, same = update.elements, update.source >= 0
    capacity = max(old.capacity, _capacity(refinement.mesh, elements, least_capacity))
    if len(elements) < len(old.elements):  # without a closure a refinement may need fewer cuts: all rows begin anew
        every = np.ones(len(elements), bool)
        mesh = Discretisation(refinement.mesh, elements, np.arange(len(elements)), capacity)
        return Change(mesh, update.kept, every, every)
    slots = np.empty(len(elements), np.int64)
    slots[same] = old.slots[update.source[same]]
    left = np.ones(len(old.elements), bool)
    left[update.source[same]] = False
    slots[~same] = np.concatenate([old.slots[left], np.arange(len(old.elements), len(elements))])
    mesh = Discretisation(refinement.mesh, elements, slots, capacity)
    return Change(mesh, update.kept, ~same, update.touched)


def _capacity(tmesh: TMesh, elements: BezierElements, least: int) -> int:
    """The padded length for a mesh."""
    return capacity_for(max(len(elements), tmesh.n_anchors), least)
