"""What an orthogonal fit returns."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Bool, Float

from ..surface import TSpline
from ._methods import AbstractMethod


class OrthogonalStop(StrEnum):
    """Why an orthogonal fit stopped; `message` says it in a sentence."""

    SETTLED = "settled"
    MAX_ITERATIONS = "max_iterations"
    TOLERANCE = "tolerance"
    FINEST = "finest"
    MAX_STEPS = "max_steps"
    MAX_CONTROL_POINTS = "max_control_points"

    @property
    def message(self) -> str:
        """The reason and, where there is one, the remedy."""
        return _MESSAGES[self]


_MESSAGES = {
    OrthogonalStop.SETTLED: "the fit over a fixed space has settled",
    OrthogonalStop.MAX_ITERATIONS: "the fit was still moving; raise max_iterations, or hold more slip",
    OrthogonalStop.TOLERANCE: "every point that counts is within the tolerance of the surface",
    OrthogonalStop.FINEST: "no violating element can be split: each is smaller than the points' distance; set outliers "
    "aside with robust=Tukey(), or relax the tolerance",
    OrthogonalStop.MAX_STEPS: "the step budget is used up; raise max_steps",
    OrthogonalStop.MAX_CONTROL_POINTS: "the control-point budget is used up; raise max_control_points or relax the "
    "tolerance",
}


@dataclass(frozen=True)
class OrthogonalStep:
    """A fit over one space; lengths in the data's unit.

    **Attributes:**

    - `step`: 0 is the start lattice, or the space that was given.
    - `control_points`: of the space.
    - `max_error`, `rms_error`: largest and root-mean-square distance between points that count and their feet.
    - `objective`: half the weighted sum of squared residuals at each iterate, in the unit squared.
    - `gradient`: largest gradient component of the reduced problem there, in the unit.
    - `settled`: whether the iterations settled.
    """

    step: int
    control_points: int
    max_error: float
    rms_error: float
    objective: tuple[float, ...]
    gradient: tuple[float, ...]
    settled: bool

    @property
    def iterations(self) -> int:
        """How many iterates there were."""
        return len(self.objective)


@dataclass(frozen=True, eq=False, repr=False)
class OrthogonalFit:
    """A surface through points in space, and how each point lies to it.

    **Attributes:**

    - `surface`: the T-spline, of control points in space.
    - `parameters`: of the foot points, (m, 2).
    - `feet`: the foot points, (m, 3).
    - `normals`: unit normals q_s × q_t there, (m, 3).
    - `distances`: (point - foot) · normal, (m,), in the unit.
    - `beyond`: points past the surface's border, (m,).
    - `weights`: that the fit gave to each point, (m,).
    - `outliers`: points that robust weights set aside, (m,).
    - `method`: how it was fitted.
    - `stop`, `converged`: why it ended; whether it settled (a fixed space) or met the tolerance.
    - `tolerance`: largest distance asked for, or `None`.
    - `max_error`, `rms_error`: of the points that are no outliers, by distance to their feet.
    - `edf`: effective degrees of freedom: how many numbers of the points' normal distances the surface can follow.
    - `smoothing`: the weight λ of the bending energy.
    - `history`: one [`OrthogonalStep`][tsplinejax.orthogonal.OrthogonalStep] a space.
    - `unit`: of all lengths, or `None`.
    """

    surface: TSpline
    parameters: Float[np.ndarray, "m 2"]
    feet: Float[np.ndarray, "m 3"]
    normals: Float[np.ndarray, "m 3"]
    distances: Float[np.ndarray, " m"]
    beyond: Bool[np.ndarray, " m"]
    weights: Float[np.ndarray, " m"]
    outliers: Bool[np.ndarray, " m"]
    method: AbstractMethod
    stop: OrthogonalStop
    converged: bool
    tolerance: float | None
    max_error: float
    rms_error: float
    edf: float
    smoothing: float
    history: tuple[OrthogonalStep, ...]
    unit: str | None

    @property
    def control_points(self) -> int:
        """How many there are."""
        return int(self.surface.space.n_functions)

    @property
    def iterations(self) -> int:
        """Iterates of all steps together."""
        return sum(step.iterations for step in self.history)

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"OrthogonalFit({len(self.distances)} points, {type(self.method).__name__.lower()}, "
            f"{self.control_points} control points, edf {self.edf:.4g}, max error {self.max_error:.4g}{unit}, "
            f"rms {self.rms_error:.4g}{unit}, stop: {self.stop})"
        )
