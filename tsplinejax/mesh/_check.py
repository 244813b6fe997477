"""Is a T-mesh analysis-suitable, and if not, why?

A T-mesh is analysis-suitable where no horizontal T-junction extension meets a vertical one (Scott, Li, Sederberg &
Hughes, "Local refinement of analysis-suitable T-splines", CMAME 213-216, 2012). For bicubic functions the extension
of a T-junction runs two elements on in the direction of the missing edge and one element back.
"""

from dataclasses import dataclass

import numpy as np

from ._knots import walk
from ._tmesh import TMesh


@dataclass(frozen=True)
class Verdict:
    """Whether a T-mesh is analysis-suitable, and the reason when it is not; true or false as a condition.

    >>> bool(Verdict(True, "no extensions meet"))
    True
    """

    suitable: bool
    reason: str

    def __bool__(self) -> bool:
        return self.suitable


def is_analysis_suitable(tmesh: TMesh) -> Verdict:
    """Check the T-junction extensions of a T-mesh.

    **Arguments:**

    - `tmesh`: any T-mesh, dyadic or given by hand.

    **Returns:** a [`Verdict`][tsplinejax.mesh.Verdict]: its `reason` names two T-junctions whose extensions meet.

    >>> from tsplinejax.mesh import b_lattice
    >>> is_analysis_suitable(b_lattice(3, 3)).reason
    'no T-junctions'
    """
    along_s = _extensions(tmesh, 0)
    along_t = _extensions(tmesh, 1)
    if len(along_s) + len(along_t) == 0:
        return Verdict(True, "no T-junctions")
    meeting = _first_meeting(along_s, along_t)
    if meeting is None:
        return Verdict(True, f"{len(along_s) + len(along_t)} T-junctions, no extensions meet")
    first, second = (_describe(tmesh, axis, row) for axis, row in zip((0, 1), meeting, strict=True))
    return Verdict(
        False, f"the extension along s of the T-junction at {first} meets that along t of the one at {second}"
    )


def _extensions(tmesh: TMesh, axis: int) -> np.ndarray:
    """T-junctions that lack an edge along the axis, as rows: place, row, extension's start and end."""
    vertices = tmesh.anchors
    inner = vertices[((vertices > 0) & (vertices < tmesh.extent)).all(axis=1)]
    at, row = inner[:, axis], inner[:, 1 - axis]
    found = []
    for step in (-1, 1):
        cell = at if step > 0 else at - 1
        sides = [tmesh.locate(cell, r) if axis == 0 else tmesh.locate(r, cell) for r in (row, row - 1)]
        missing = sides[0] == sides[1]
        place, across = at[missing], row[missing]
        back = walk(tmesh, axis, -step, place, across)
        ahead = walk(tmesh, axis, step, walk(tmesh, axis, step, place, across), across)
        ends = np.sort(np.stack([back, ahead], axis=1), axis=1)
        found.append(np.column_stack([place, across, np.clip(ends, 0, tmesh.extent[axis])]))
    return np.concatenate(found)


def _first_meeting(along_s: np.ndarray, along_t: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """The first pair of an extension along s and one along t that share a point, or `None`."""
    order = np.argsort(along_t[:, 1], kind="stable")
    columns = along_t[order]
    start = np.searchsorted(columns[:, 1], along_s[:, 2], side="left")
    stop = np.searchsorted(columns[:, 1], along_s[:, 3], side="right")
    counts = stop - start
    horizontal = np.repeat(np.arange(len(along_s)), counts)
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    vertical = np.repeat(start, counts) + within
    rows = along_s[horizontal, 1]
    meets = (rows >= columns[vertical, 2]) & (rows <= columns[vertical, 3])
    if not meets.any():
        return None
    pair = int(np.argmax(meets))
    return along_s[horizontal[pair]], columns[vertical[pair]]


def _describe(tmesh: TMesh, axis: int, row: np.ndarray) -> str:
    """The T-junction's parameters, for the reason."""
    x, y = (row[0], row[1]) if axis == 0 else (row[1], row[0])
    s, t = tmesh.parameters(0, x), tmesh.parameters(1, y)
    return f"(s, t) = ({float(s):.6g}, {float(t):.6g})"
