"""What filling returns: the complete map, which of its pixels were filled, how uncertain they are, and the account."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..data import HeightMap
from ..surface import TSpline


@dataclass(frozen=True, eq=False, repr=False)
class Filled:
    """A map whose holes are filled, and the account.

    **Attributes:**

    - `map`: the height map; `map.filled` marks the filled pixels, which areal parameters leave out unless asked.
    - `n_filled`: how many pixels were filled.
    - `uncertainty`: (rows, columns), standard uncertainty of each filled height, NaN elsewhere and where no patch could
      be hidden; 95 % of the errors are to be expected within twice of it.
    - `surface`: the T-spline, of `exact=True` and `smooth_all=True`; else `None`.
    - `left`: (rows, columns), pixels that are still missing.
    - `weights`: the fillers in the mixture and their weights, by name.
    - `validated_rms`: root mean square error of the same mixture at `hidden` pixels that were hidden; NaN where none
      could be.
    - `hidden_rms`: the same of every filler alone, by name.
    - `max_error`, `rms_error`: of the map's heights against the measured ones; 0 unless `smooth_all`.
    - `tolerance`, `stop`, `control_points`, `converged`: of the surface's fit, where there is one.
    - `range`: max - min of the measured heights.
    - `unit`, `seconds`, `warnings`, `provenance`: as for a fit.
    """

    map: HeightMap
    n_filled: int
    uncertainty: Float[np.ndarray, "rows columns"]
    surface: TSpline | None
    left: Bool[np.ndarray, "rows columns"]
    weights: Mapping[str, float]
    validated_rms: float
    hidden: int
    hidden_rms: Mapping[str, float]
    max_error: float
    rms_error: float
    tolerance: float | None
    stop: str | None
    converged: bool
    range: float
    unit: str | None
    seconds: float
    warnings: tuple[str, ...]
    provenance: Mapping[str, Any]

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        left = int(self.left.sum())
        return (
            f"Filled({self.map.shape[0]} rows × {self.map.shape[1]} columns, {self.n_filled} pixels filled, "
            f"{left} left, validated rms {self.validated_rms:.4g}{unit})"
        )

    @property
    def control_points(self) -> int | None:
        """Of the surface, where there is one."""
        return None if self.surface is None else len(self.surface.control_points)

    @property
    def report(self) -> dict[str, Any]:
        """The figures under the names that the command line uses."""
        known = self.uncertainty[np.isfinite(self.uncertainty)]
        return {
            "filled": self.n_filled,
            "left": int(self.left.sum()),
            "weights": dict(self.weights),
            "validated_rms": self.validated_rms,
            "hidden": self.hidden,
            "hidden_rms": dict(self.hidden_rms),
            "uncertainty_rms": float(np.sqrt(np.mean(known**2))) if known.size else float("nan"),
            "max_error": self.max_error,
            "rms_error": self.rms_error,
            "tolerance": self.tolerance,
            "stop": self.stop,
            "converged": self.converged,
            "control_points": self.control_points,
            "range": self.range,
            "unit": self.unit,
            "shape": list(self.map.shape),
            "seconds": self.seconds,
            "warnings": list(self.warnings),
            "provenance": dict(self.provenance),
        }
