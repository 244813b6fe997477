"""Refinement of an orthogonal fit: elements that hold points farther than the tolerance are bisected.

Stages and budget are those of the fit of height maps.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..fitting import SMALLEST, bisect_worst, mark_in_stages
from ..mesh import MAX_LEVEL, AnalysisSuitable, TMesh, require_forest
from ._result import OrthogonalStop
from ._round import Fitted


@dataclass(frozen=True)
class Budget:
    """What refinement may use."""

    max_steps: int | None
    max_control_points: int


def refined(
    fitted: Fitted, limit: float, stage: float, budget: Budget, step: int
) -> tuple[TMesh | None, float, OrthogonalStop | None]:
    """A finer mesh and the stage it was marked against, or why there is none."""
    if fitted.worst <= limit:
        return None, stage, OrthogonalStop.TOLERANCE
    if budget.max_steps is not None and step >= budget.max_steps:
        return None, stage, OrthogonalStop.MAX_STEPS
    tmesh = fitted.surface.space.mesh
    excess = _excess(fitted, tmesh) / limit
    areas = 0.5**tmesh.levels / np.prod(require_forest(tmesh).lattice)
    can = (areas * len(fitted.weights) > SMALLEST) & (tmesh.levels < MAX_LEVEL)
    if not (can & (excess > 1)).any():
        return None, stage, OrthogonalStop.FINEST
    marked, stage = mark_in_stages(excess, can, stage)
    found = bisect_worst(tmesh, marked, excess, AnalysisSuitable(), budget.max_control_points)
    return (None, stage, OrthogonalStop.MAX_CONTROL_POINTS) if found is None else (found.mesh, stage, None)


def _excess(fitted: Fitted, tmesh: TMesh) -> Float[np.ndarray, " elements"]:
    """The largest distance of each element's points."""
    extent = np.asarray(tmesh.extent)
    parameters = np.asarray(fitted.feet.parameters, np.float64)[fitted.counted]
    cells = np.clip((parameters * extent).astype(np.int64), 0, extent - 1)
    element = tmesh.locate(cells[:, 0], cells[:, 1])
    largest = np.zeros(tmesh.n_elements)
    np.maximum.at(largest, element, fitted.gaps[fitted.counted])
    return largest
