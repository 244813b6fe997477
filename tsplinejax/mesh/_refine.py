"""Refinement: marked elements are bisected at their middle, with or without a closure.

Both refinements cut an element of even level in the direction of the mesh's first cut and one of odd level in the
other, so an element of level k is `2^-ceil(k/2)` wide and `2^-floor(k/2)` high when s is cut first.

[`Dyadic`][tsplinejax.mesh.Dyadic] bisects what is marked and nothing else (the paper's own refinement).
[`AnalysisSuitable`][tsplinejax.mesh.AnalysisSuitable] first adds every element of lower level that meets the patch of a
marked one (Morgenstern & Peterseim, "Analysis-suitable adaptive T-mesh refinement with linear complexity", CAGD 34,
2015): the blending functions then sum to one, are linearly independent, and span a space that contains the old one.
"""

from abc import abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Int

from .._errors import InputError
from ._codes import DEPTH, MAX_LEVEL, UNIT, cell_boxes
from ._knots import refine_traces
from ._tmesh import Forest, TMesh, make_forest_mesh


@dataclass(frozen=True)
class AbstractRefinement:
    """A rule that completes a set of marked elements before they are bisected."""

    @abstractmethod
    def complete(self, tmesh: TMesh, marked: Bool[np.ndarray, " elements"]) -> Bool[np.ndarray, " elements"]:
        """The marked elements and those that must be bisected with them."""


@dataclass(frozen=True)
class Dyadic(AbstractRefinement):
    """The paper's refinement: no closure, hence the rational form of Eq. 2.

    >>> from tsplinejax.mesh import b_lattice
    >>> refine(b_lattice(2, 2), [True, False, False, False], Dyadic()).mesh.n_elements
    5
    """

    def complete(self, tmesh: TMesh, marked: np.ndarray) -> np.ndarray:
        """The marked elements themselves."""
        return marked


@dataclass(frozen=True)
class AnalysisSuitable(AbstractRefinement):
    """Refinement that keeps the mesh analysis-suitable, by Morgenstern and Peterseim's closure.

    >>> from tsplinejax.mesh import b_lattice
    >>> tmesh = refine(b_lattice(4, 4), np.arange(16) == 5).mesh
    >>> refine(tmesh, tmesh.levels == 1).mesh.n_elements
    22
    """

    def complete(self, tmesh: TMesh, marked: np.ndarray) -> np.ndarray:
        """The smallest set that holds the marked elements and leaves an analysis-suitable mesh."""
        forest = require_forest(tmesh)
        chosen = marked.copy()
        for level in range(int(forest.levels.max()), 0, -1):
            at_level = np.flatnonzero(chosen & (forest.levels == level))
            if at_level.size:
                neighbours = _patch_elements(tmesh, forest, at_level, level)
                chosen[neighbours[forest.levels[neighbours] < level]] = True
        return chosen


def _patch_elements(tmesh: TMesh, forest: Forest, elements: np.ndarray, level: int) -> np.ndarray:
    """Elements at the lower corners of the patch's cells: one cell each side across the new edge, two along it."""
    across, along = UNIT >> ((level + 1) >> 1), UNIT >> (level >> 1)
    reach_first, reach_second = (1, 2) if level % 2 == 0 else (2, 1)
    first_axis = 0 if forest.first_cut == "s" else 1
    offsets = np.empty(((2 * reach_first + 1) * (2 * reach_second + 1), 2), np.int64)
    first, second = np.meshgrid(
        np.arange(-reach_first, reach_first + 1) * across,
        np.arange(-reach_second, reach_second + 1) * along,
        indexing="ij",
    )
    offsets[:, first_axis], offsets[:, 1 - first_axis] = first.ravel(), second.ravel()
    cells = (tmesh.boxes[elements, None, :2] + offsets).reshape(-1, 2)
    inside = ((cells >= 0) & (cells < tmesh.extent)).all(axis=1)
    return tmesh.locate(cells[inside, 0], cells[inside, 1])


@dataclass(frozen=True, eq=False)
class Refinement:
    """A refined T-mesh and where its elements came from.

    **Attributes:**

    - `mesh`: the new T-mesh.
    - `parent`: for each new element the old element that holds it.
    - `bisected`: which old elements were bisected.
    - `kept`: for each new anchor the old one at the same place with the same local knots, or -1; `None` where the
      old mesh's local knots were not at hand.
    """

    mesh: TMesh
    parent: Int[np.ndarray, " new_elements"]
    bisected: Bool[np.ndarray, " elements"]
    kept: Int[np.ndarray, " new_anchors"] | None = None

    def then(self, second: "Refinement") -> "Refinement":
        """This refinement and one of its mesh, as one.

        >>> from tsplinejax.mesh import b_lattice
        >>> first = refine(b_lattice(2, 1), [True, False])
        >>> both = first.then(refine(first.mesh, [False, False, True]))
        >>> both.parent.tolist(), both.bisected.tolist()
        ([0, 0, 1, 1], [True, True])
        """
        bisected = self.bisected.copy()
        bisected[self.parent[second.bisected]] = True
        kept = None
        if self.kept is not None and second.kept is not None:
            kept = np.where(second.kept >= 0, self.kept[second.kept], -1)
        return Refinement(second.mesh, self.parent[second.parent], bisected, kept)


def refine(
    tmesh: TMesh, marked: Bool[np.ndarray, " elements"], refinement: AbstractRefinement | None = None
) -> Refinement:
    """Bisect the marked elements of a dyadic T-mesh, completed by the refinement's rule.

    **Arguments:**

    - `tmesh`: a dyadic T-mesh.
    - `marked`: one boolean an element.
    - `refinement`: `AnalysisSuitable()` (the default) or `Dyadic()`.

    **Raises:** `InputError` for a mesh given by hand, a wrong number of marks, or elements beyond the deepest level.

    >>> from tsplinejax.mesh import b_lattice
    >>> refine(b_lattice(2, 2), [True] * 4).mesh
    TMesh(8 elements, 35 anchors, lattice 2 × 2, level 1)
    """
    require_forest(tmesh)
    marks = np.asarray(marked)
    if marks.dtype != bool or marks.shape != (tmesh.n_elements,):
        raise InputError(
            f"one boolean mark an element: shape ({tmesh.n_elements},); received {marks.dtype} of shape {marks.shape}"
        )
    return bisect(tmesh, (refinement or AnalysisSuitable()).complete(tmesh, marks))


def bisect(tmesh: TMesh, chosen: Bool[np.ndarray, " elements"]) -> Refinement:
    """Bisect exactly the chosen elements, each in the direction of its level's parity.

    Where the old mesh's local knots are at hand, the new mesh's come with it, at the cost of what changed.

    >>> from tsplinejax.mesh import b_lattice
    >>> bisect(b_lattice(1, 1), np.array([True])).mesh.element_boxes[:, 2].tolist()
    [0.5, 1.0]
    """
    forest = require_forest(tmesh)
    if (forest.levels[chosen] >= MAX_LEVEL).any():
        raise InputError(f"elements can be bisected {MAX_LEVEL} times at most; a marked element is at that level")
    levels, codes, parent = bisect_cells(forest.levels, forest.codes, chosen)
    halved = chosen[parent]
    boxes = tmesh.boxes.take(parent, axis=0)
    boxes[halved] = cell_boxes(forest.first_cut, levels[halved], codes[halved])
    mesh = make_forest_mesh(forest.lattice, forest.first_cut, levels, codes, tmesh.border, boxes)
    if not tmesh.is_traced:
        return Refinement(mesh, parent, chosen)
    traces, kept = refine_traces(tmesh.traces, mesh, parent, chosen)
    return Refinement(replace(mesh, _known=traces), parent, chosen, kept)


def bisect_cells(
    levels: np.ndarray, codes: np.ndarray, chosen: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Levels, codes and parents after bisecting the chosen cells of a sorted forest; the order stays sorted."""
    counts = 1 + chosen.astype(np.int64)
    parent = np.repeat(np.arange(len(codes)), counts)
    second = np.zeros(len(parent), bool)
    second[np.cumsum(counts)[chosen] - 1] = True
    new_levels = levels.take(parent) + chosen.take(parent)
    # The second half starts half a code range on: a cell of level k owns 2^(2 DEPTH - k) codes.
    half = np.int64(1) << (2 * DEPTH - new_levels)
    return new_levels, codes.take(parent) + np.where(second, half, 0), parent


def require_forest(tmesh: TMesh) -> Forest:
    """The mesh's forest, or an error that says why refinement needs one."""
    if tmesh.forest is None:
        raise InputError(
            "only dyadic T-meshes are refined by bisection; this one was given by hand as rectangles; "
            "start from b_lattice(columns, rows)"
        )
    return tmesh.forest
