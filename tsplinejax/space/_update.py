"""Bézier elements of a refined T-mesh from those of the mesh before, at the cost of what changed.

A blending function is unaltered where its anchor and local knots are. On an element of the mesh where all functions are
unaltered nothing happens but renumbering. On the others the unaltered functions are read from the old table, because a
function lives on all of a Bézier element or on none of it, and only the altered ones are laid out over the new mesh.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from ..mesh import Refinement, TMesh, anchor_codes
from ._extraction import BezierElements, bezier_elements, cut_by_knots
from ._spans import NOBODY, Pieces, cut_in_vain, lay_out, likely_pieces

# What stands for an altered function in an old table that is numbered anew; -1 is a place without a function.
ALTERED = -2


@dataclass(frozen=True, eq=False)
class ElementUpdate:
    """Bézier elements after a refinement, and what they have in common with those before.

    **Attributes:**

    - `elements`: those of the new mesh.
    - `source`: for each the old one that is the same rectangle, or -1.
    - `touched`: which are new, or have other functions or local knots than before.
    - `kept`: for each new blending function the old one with the same anchor and local knots, or -1.
    """

    elements: BezierElements
    source: Int[np.ndarray, " bezier"]
    touched: Bool[np.ndarray, " bezier"]
    kept: Int[np.ndarray, " functions"]


def refine_elements(old: BezierElements, tmesh: TMesh, refinement: Refinement) -> ElementUpdate:
    """The Bézier elements of a refined T-mesh, equal to what `bezier_elements` finds.

    **Arguments:**

    - `old`: Bézier elements of the mesh before.
    - `tmesh`: the mesh before.
    - `refinement`: one step, from `refine` or `bisect`.

    >>> from tsplinejax.mesh import b_lattice, refine
    >>> tmesh = b_lattice(8, 8)
    >>> update = refine_elements(bezier_elements(tmesh), tmesh, refine(tmesh, np.arange(64) == 0))
    >>> len(update.elements), int(update.touched.sum())
    (67, 15)
    """
    kept = _unaltered(tmesh, refinement.mesh) if refinement.kept is None else refinement.kept
    number = np.full(tmesh.n_anchors + 1, ALTERED, np.int32)
    number[-1] = -1
    unaltered = np.flatnonzero(kept >= 0)
    number[kept[unaltered]] = unaltered
    table = number.take(old.functions)
    # Sixteen functions everywhere is what makes the short way right; without a closure it is seldom so.
    short = table.shape[1] == 16 and not (table[:, -1] == -1).any()
    return (_short_way(old, table, refinement, kept) if short else None) or _long_way(old, table, refinement.mesh, kept)


def _unaltered(old: TMesh, new: TMesh) -> np.ndarray:
    """For each new blending function the same old one, or -1, where the refinement does not say."""
    old_codes, new_codes = (anchor_codes(mesh, mesh.anchors) for mesh in (old, new))
    place = np.minimum(np.searchsorted(old_codes, new_codes), len(old_codes) - 1)
    same = (old_codes[place] == new_codes) & (old.local_knots[place] == new.local_knots).all(axis=(1, 2))
    return np.where(same, place, -1)


def _same_place(old: BezierElements, levels: np.ndarray, codes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The old Bézier element at each cell's lower corner, and whether it is the same cell."""
    assert old.codes is not None
    assert old.levels is not None
    place = np.searchsorted(old.codes, codes, side="right") - 1
    return place, (old.codes[place] == codes) & (old.levels[place] == levels)


def _long_way(old: BezierElements, table: np.ndarray, tmesh: TMesh, kept: np.ndarray) -> ElementUpdate:
    """All Bézier elements found anew, then compared."""
    elements = bezier_elements(tmesh)
    assert elements.levels is not None
    assert elements.codes is not None
    place, same = _same_place(old, elements.levels, elements.codes)
    touched = np.ones(len(elements), bool)
    if table.shape[1] == elements.functions.shape[1]:
        touched = ~same | (table[place] != elements.functions).any(axis=1)
    return ElementUpdate(elements, np.where(same, place, -1), touched, kept)


def _short_way(
    old: BezierElements, table: Int[np.ndarray, "old 16"], refinement: Refinement, kept: np.ndarray
) -> ElementUpdate | None:
    """Only elements with altered functions found anew; `None` where the refined mesh is not analysis-suitable."""
    assert old.codes is not None
    eights = (table < 0).view(np.uint64)
    altered = (eights[:, 0] | eights[:, 1]) != 0
    stale = refinement.bisected.copy()
    stale[old.owner[altered]] = True
    fresh = likely_pieces(refinement.mesh, np.flatnonzero(stale[refinement.parent]))
    clean = np.flatnonzero(~stale[old.owner])
    # Both lists are sorted by code: -1 marks the fresh ones among the clean.
    source = np.insert(clean, np.searchsorted(old.codes[clean], fresh.codes), -1)
    where = np.flatnonzero(source < 0)
    pieces = _merge(old, source, where, fresh, refinement.parent)
    place, same = _same_place(old, fresh.levels, fresh.codes)
    staying = _staying(old, table, place, fresh, refinement.mesh)
    rows = None if staying is None else _fresh_rows(refinement.mesh, kept, fresh, staying)
    if rows is None:
        return None
    functions = table.take(source, axis=0)
    functions[where] = rows
    elements = BezierElements(pieces.boxes, pieces.owner, functions, pieces.levels, pieces.codes)
    touched = np.zeros(len(source), bool)
    touched[where] = ~same | altered[place]
    source[where] = np.where(same, place, -1)
    return ElementUpdate(elements, source, touched, kept)


def _merge(old: BezierElements, source: np.ndarray, where: np.ndarray, fresh: Pieces, parent: np.ndarray) -> Pieces:
    """Old pieces and fresh ones in the order of their codes."""
    assert old.codes is not None
    assert old.levels is not None
    first_child = np.flatnonzero(np.diff(parent, prepend=-1))
    boxes, owner = old.boxes.take(source, axis=0), first_child.take(old.owner.take(source))
    pieces = Pieces(boxes, owner, old.levels.take(source), old.codes.take(source))
    for name in ("boxes", "owner", "levels", "codes"):
        getattr(pieces, name)[where] = getattr(fresh, name)
    return pieces


def _staying(
    old: BezierElements, table: np.ndarray, place: np.ndarray, fresh: Pieces, tmesh: TMesh
) -> Int[np.ndarray, "fresh 16"] | None:
    """Unaltered functions on fresh pieces; `None` where a fresh piece would join two that they keep apart."""
    assert old.levels is not None
    rows = table.take(place, axis=0)
    joined = np.flatnonzero(old.levels[place] > fresh.levels)
    first, beside = rows[joined], table[np.minimum(place[joined] + 1, len(table) - 1)]
    if (old.levels[place[joined]] != fresh.levels[joined] + 1).any():
        return None
    if np.any(np.sort(first, axis=1) != np.sort(beside, axis=1)):
        return None
    row, column = np.nonzero(first >= 0)
    if cut_by_knots(tmesh.local_knots[first[row, column]], fresh.boxes[joined[row]]).any():
        return None
    return rows


def _fresh_rows(
    tmesh: TMesh, kept: np.ndarray, fresh: Pieces, staying: np.ndarray
) -> Int[np.ndarray, "fresh 16"] | None:
    """Functions on the fresh pieces: those that stayed and the altered ones; `None` unless sixteen on each."""
    altered = np.flatnonzero(kept < 0)
    layout = lay_out(tmesh, tmesh.local_knots.take(altered, axis=0), altered, fresh)
    if layout is None:
        return None
    rows = np.full((len(staying), 32), NOBODY, np.int32)
    rows[:, :16] = layout.table[:, :-1].T
    np.copyto(rows[:, 16:], staying, where=staying >= 0)
    rows.sort(axis=1)
    if (rows[:, 15] == NOBODY).any() or (rows[:, 16] != NOBODY).any():
        return None
    rows = np.ascontiguousarray(rows[:, :16])
    return None if cut_in_vain(tmesh.local_knots, fresh, rows, layout.sure[:-1]) else rows
