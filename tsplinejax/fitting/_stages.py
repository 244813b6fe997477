"""Marking in stages, and refinement within a budget: what every adaptive loop shares.

Elements are marked against a threshold that falls in stages to the criterion's own: marking for the final tolerance at
once refines many elements for errors that their neighbours cause. Halving both sides of an element lowers the error of
a cubic by sixteen where the surface is smooth, a bisection by four: what three of them cannot mend gets two at once.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ..mesh import AbstractRefinement, Refinement, TMesh, bisect

SMALLEST = 0.25  # area of an element of one sample that is still cut, in mean areas of a sample
TRIFLE = 0.02  # share of the elements for which a stage is not worth another step
ROOM = 64  # samples of an element that may be bisected twice at once


@dataclass(frozen=True)
class Marking:
    """How fast an adaptive loop descends.

    **Attributes:**

    - `fall`: factor by which the marking threshold falls from stage to stage.
    - `twice`: elements with a measure above this multiple of the criterion's threshold are bisected twice in a step.
    """

    fall: float = 0.15
    twice: float = 64.0


def mark_in_stages(
    excess: Float[np.ndarray, " elements"],
    can: Bool[np.ndarray, " elements"],
    stage: float,
    fall: float = Marking.fall,
) -> tuple[Bool[np.ndarray, " elements"], float]:
    """Elements to bisect and the stage they are marked against: the first that marks more than a trifle.

    **Arguments:**

    - `excess`: each element's measure, as a multiple of the criterion's threshold.
    - `can`: elements that may be split, at least one.
    - `stage`: the last multiple that was marked against, infinite at first; it never falls below one.
    - `fall`: the factor by which it falls.

    >>> mark_in_stages(np.array([100.0, 30.0, 2.0]), np.ones(3, bool), np.inf)
    (array([ True,  True, False]), 15.0)
    """
    stage = max(1.0, float(excess[can].max()) * fall) if np.isinf(stage) else stage
    while stage > 1 and np.count_nonzero(can & (excess > stage)) <= TRIFLE * len(can):
        stage = max(1.0, stage * fall)
    return can & (excess > stage), stage


def bisect_worst(
    tmesh: TMesh,
    marked: Bool[np.ndarray, " elements"],
    excess: Float[np.ndarray, " elements"],
    refinement: AbstractRefinement,
    limit: int | None,
) -> Refinement | None:
    """Bisect what is marked, or the worst part of it that a budget of control points allows; `None` if it allows none.

    >>> from tsplinejax.mesh import AnalysisSuitable, b_lattice
    >>> found = bisect_worst(b_lattice(2, 2), np.ones(4, bool), np.arange(4.0), AnalysisSuitable(), 32)
    >>> found.bisected.tolist(), found.mesh.n_anchors
    ([False, False, True, True], 30)
    """
    while marked.any():
        found = bisect(tmesh, refinement.complete(tmesh, marked))
        if limit is None or found.mesh.n_anchors <= limit:
            return found
        worst_first = np.argsort(np.where(marked, -excess, np.inf), kind="stable")
        half = worst_first[: int(marked.sum()) // 2]
        marked = np.zeros_like(marked)
        marked[half] = True
    return None
