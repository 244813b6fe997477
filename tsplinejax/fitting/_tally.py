"""What the host keeps of every Bézier element: how many samples it holds and how well they are met."""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float

from ._moments import Counts
from ._residuals import Residuals


@dataclass(frozen=True, eq=False)
class Tally:
    """Numbers by device slot.

    **Attributes:**

    - `counts`, `variance`: number of samples of a weight above zero, and the sum of their noise variances.
    - `largest`, `weighted`, `plain`: largest residual norm of those, and sums of squares with weights and without.
    - `energy`: bending energy.
    - `explained`: the part of the weighted squares that a bicubic patch of the element's own would explain; kept only
      for fits to noise.
    """

    counts: Float[np.ndarray, " bezier"]
    variance: Float[np.ndarray, " bezier"]
    largest: Float[np.ndarray, " bezier"]
    weighted: Float[np.ndarray, " bezier"]
    plain: Float[np.ndarray, " bezier"]
    energy: Float[np.ndarray, " bezier"]
    explained: Float[np.ndarray, " bezier"]

    def extended(self, length: int) -> "Tally":
        """A copy with zeros appended up to a length."""
        copies = {}
        for name in (field.name for field in fields(self)):
            part = getattr(self, name)
            copies[name] = np.zeros(length)
            copies[name][: len(part)] = part
        return Tally(**copies)

    def with_counts(self, slots: np.ndarray, counts: Counts) -> "Tally":
        """Other samples in these elements."""
        return self._with({"counts": counts.samples, "variance": counts.variance}, slots)

    def with_residuals(self, slots: np.ndarray, residuals: Residuals, energy: np.ndarray) -> "Tally":
        """Other residuals and energies in these elements."""
        parts = {"largest": residuals.largest, "weighted": residuals.weighted, "plain": residuals.plain}
        return self._with({**parts, "energy": energy}, slots)

    def with_explained(self, slots: np.ndarray, explained: np.ndarray) -> "Tally":
        """Other explained squares in these elements."""
        return self._with({"explained": explained}, slots)

    def _with(self, parts: dict[str, np.ndarray], slots: np.ndarray) -> "Tally":
        changed = {name: getattr(self, name).copy() for name in parts}
        for name, part in parts.items():
            changed[name][slots] = part
        return replace(self, **changed)


def empty_tally(length: int) -> Tally:
    """No samples."""
    return Tally(*(np.zeros(length) for _ in fields(Tally)))
