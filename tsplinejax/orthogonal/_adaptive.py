"""Refinement of an orthogonal fit: elements that hold points farther than the tolerance are bisected.

Elements are marked against a threshold that falls in stages to the tolerance, as in the fit of height maps: marking for
the last one at once refines many elements for errors that their neighbours cause.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ..mesh import MAX_LEVEL, AnalysisSuitable, TMesh, bisect, require_forest
from ._result import OrthogonalStop
from ._round import Fitted

STAGE_FACTOR = 0.25
SMALLEST = 0.25  # area of an element that is still cut, in mean areas of a point


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
    worst = float(excess[can].max())
    stage = max(1.0, worst * STAGE_FACTOR) if np.isinf(stage) else stage
    while stage > 1 and worst <= stage:
        stage = max(1.0, stage * STAGE_FACTOR)
    marked = can & (excess > stage)
    while marked.any():
        finer = bisect(tmesh, AnalysisSuitable().complete(tmesh, marked)).mesh
        if finer.n_anchors <= budget.max_control_points:
            return finer, stage, None
        worst_first = np.argsort(np.where(marked, -excess, np.inf), kind="stable")
        half = worst_first[: int(marked.sum()) // 2]
        marked = np.zeros_like(marked)
        marked[half] = True
    return None, stage, OrthogonalStop.MAX_CONTROL_POINTS


def _excess(fitted: Fitted, tmesh: TMesh) -> Float[np.ndarray, " elements"]:
    """The largest distance of each element's points."""
    extent = np.asarray(tmesh.extent)
    parameters = np.asarray(fitted.feet.parameters, np.float64)[fitted.counted]
    cells = np.clip((parameters * extent).astype(np.int64), 0, extent - 1)
    element = tmesh.locate(cells[:, 0], cells[:, 1])
    largest = np.zeros(tmesh.n_elements)
    np.maximum.at(largest, element, fitted.gaps[fitted.counted])
    return largest
