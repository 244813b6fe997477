"""What a fit returns: the surface, how it got there, and why it stopped."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from ..data import Samples
from ..surface import TSpline


class StopReason(StrEnum):
    """Why a fit stopped; `message` says it in a sentence."""

    TOLERANCE = "tolerance"
    NOISE = "noise"
    FINEST = "finest"
    MAX_STEPS = "max_steps"
    MAX_CONTROL_POINTS = "max_control_points"
    MAX_SECONDS = "max_seconds"
    INTERRUPTED = "interrupted"

    @property
    def message(self) -> str:
        """The reason and, where there is one, the remedy."""
        return _MESSAGES[self]


_MESSAGES = {
    StopReason.TOLERANCE: "every sample is within the tolerance",
    StopReason.NOISE: "no element's residuals are significantly above the noise",
    StopReason.FINEST: "no violating element can be split: each holds a single place and is smaller than the samples' "
    "distance; set outliers aside with robust=True, or relax the tolerance",
    StopReason.MAX_STEPS: "the step budget is used up; raise max_steps",
    StopReason.MAX_CONTROL_POINTS: "the control-point budget is used up; raise max_control_points, relax the "
    "tolerance, or set outliers aside with robust=True",
    StopReason.MAX_SECONDS: "the time budget is used up; raise max_seconds",
    StopReason.INTERRUPTED: "interrupted; this is the best step so far",
}


@dataclass(frozen=True)
class Step:
    """One step of the adaptive loop; lengths are in the data's unit.

    **Attributes:**

    - `step`: 0 is the start lattice.
    - `control_points`, `elements`: size of the T-mesh.
    - `max_error`, `rms_error`: largest and root-mean-square Euclidean residual of the samples that count.
    - `snr_db`, `snr_db_centred`: Eq. 7, and the same with the mean removed from the data.
    - `objective`: Σ w r² + λ E, from residuals.
    - `tolerance`: the stage's own tolerance; `None` for a fit to noise.
    - `seconds`: wall time of the step.
    - `stages`: its parts: `topology` (mark, refine, find Bézier elements), `functions` (transfer and extraction),
      `moments` (sums over the samples of changed elements), `solve` (normal matrices and conjugate gradients),
      `residuals` (of the samples where the surface changed).
    """

    step: int
    control_points: int
    elements: int
    max_error: float
    rms_error: float
    snr_db: float
    snr_db_centred: float
    objective: float
    tolerance: float | None
    seconds: float
    stages: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class AtSamples:
    """What a fit of data in memory keeps of every sample."""

    samples: Samples
    residuals: Float[np.ndarray, " m"] | Float[np.ndarray, "m 3"]
    outliers: Bool[np.ndarray, " m"]


@dataclass(frozen=True, eq=False, repr=False)
class FitResult:
    """A fitted T-spline and its account.

    **Attributes:**

    - `surface`: the T-spline of the best step by the user's criterion.
    - `at_samples`: samples, residuals and outliers; `None` for a stored map.
    - `n_samples`: how many samples it was fitted to.
    - `stop`, `converged`: why the loop stopped; whether the criterion was met.
    - `tolerance`: largest error asked for, in `unit`; `None` for a fit to noise.
    - `noise`: standard deviation of the noise that the fit assumed, or `None`.
    - `max_error`, `rms_error`, `snr_db`, `snr_db_centred`: of the samples that were not set aside.
    - `range`: max - min of the samples that were not set aside (for points in space: the bounding box's diagonal).
    - `smoothing`: the weight λ of the bending energy.
    - `history`: one [`Step`][tsplinejax.Step] a step; the first is the start lattice.
    - `warnings`: what the user should know, in sentences.
    - `provenance`: version, input, options.
    """

    surface: TSpline
    at_samples: AtSamples | None
    n_samples: int
    stop: StopReason
    converged: bool
    tolerance: float | None
    noise: float | None
    max_error: float
    rms_error: float
    snr_db: float
    snr_db_centred: float
    range: float
    unit: str | None
    smoothing: float
    control_points: int
    elements: int
    seconds: float
    history: tuple[Step, ...]
    warnings: tuple[str, ...]
    provenance: Mapping[str, Any]

    @property
    def samples(self) -> Samples:
        """The samples it was fitted to, (m,).

        **Raises:** `InputError` for a stored map, of which nothing is kept sample by sample.
        """
        return self._kept.samples

    @property
    def residuals(self) -> Float[np.ndarray, " m"] | Float[np.ndarray, "m 3"]:
        """Value minus surface at each sample, (m,) for heights, (m, 3) for points in space; as for `samples`."""
        return self._kept.residuals

    @property
    def outliers(self) -> Bool[np.ndarray, " m"]:
        """Samples that were set aside, (m,); as for `samples`."""
        return self._kept.outliers

    @property
    def _kept(self) -> AtSamples:
        if self.at_samples is None:
            raise InputError(
                "samples and residuals of a stored map are not kept in memory; compare a window of it with "
                "result.surface.at(x, y)"
            )
        return self.at_samples

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        return (
            f"FitResult({self.n_samples} samples, {self.control_points} control points, {self.elements} elements, "
            f"max error {self.max_error:.4g}{unit}, rms {self.rms_error:.4g}{unit}, stop: {self.stop})"
        )
