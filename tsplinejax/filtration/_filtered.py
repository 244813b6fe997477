"""What a filter returns: the filtered map, what was taken off, the surface, and the account of them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..data import HeightMap
from ..fitting import StopReason
from ..surface import TSpline


@dataclass(frozen=True, eq=False, repr=False)
class Filtered:
    """A filtered height map and what was taken off; lengths are in the map's unit.

    **Attributes:**

    - `filtered`, `residual`: maps over the same pixels, which add up to the data; missing pixels stay missing.
    - `cutoff`: the wavelength λc of which a linear filter lets half through, away from kept edges; `None` where only a
      spacing or a tolerance limits the waves.
    - `tolerance`: largest magnitude of the residual allowed; `None` for a linear filter.
    - `finest_spacing`: smallest element allowed, or `None`.
    - `sq_removed`, `sa_removed`: Sq and Sa of the residual, its mean removed.
    - `max_error`, `rms_error`: largest and root-mean-square residual; outliers do not count.
    - `range`: max - min of the data, without outliers.
    - `edge_share`: the part of the area on which edges are kept; 0 for a linear filter.
    - `outliers`: how many pixels were set aside.
    - `control_points`: of the surface.
    - `stop`, `converged`: why refinement stopped, and whether the tolerance is met; of a linear filter `None` and True.
    - `unit`, `seconds`, `warnings`, `operations`, `provenance`: as for a fit.
    """

    filtered: HeightMap
    residual: HeightMap
    cutoff: float | None
    tolerance: float | None
    finest_spacing: float | None
    sq_removed: float
    sa_removed: float
    max_error: float
    rms_error: float
    range: float
    edge_share: float
    outliers: int
    control_points: int
    stop: StopReason | None
    converged: bool
    unit: str | None
    seconds: float
    warnings: tuple[str, ...]
    operations: tuple[str, ...]
    provenance: Mapping[str, Any]
    _make_surface: Callable[[], TSpline]

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        rows, columns = self.filtered.shape
        named = (("cut-off", self.cutoff), ("tolerance", self.tolerance), ("spacing", self.finest_spacing))
        limits = ", ".join(f"{name} {value:.4g}{unit}" for name, value in named if value is not None)
        return (
            f"Filtered({rows} rows × {columns} columns, {limits}, Sq removed {self.sq_removed:.4g}{unit}, "
            f"{self.control_points} control points{'' if self.stop is None else f', stop: {self.stop}'})"
        )

    @cached_property
    def surface(self) -> TSpline:
        """The T-spline of which `filtered` are the heights; it has heights at missing pixels, too."""
        return self._make_surface()

    @property
    def report(self) -> dict[str, Any]:
        """The figures under the names that the command line uses."""
        names = (
            "cutoff",
            "tolerance",
            "finest_spacing",
            "sq_removed",
            "sa_removed",
            "max_error",
            "rms_error",
            "range",
            "edge_share",
            "outliers",
            "control_points",
            "converged",
            "unit",
            "seconds",
        )
        return {
            **{name: getattr(self, name) for name in names},
            "stop": None if self.stop is None else str(self.stop),
            "missing": int(np.count_nonzero(~self.filtered.valid)),
            "operations": list(self.operations),
            "warnings": list(self.warnings),
            "provenance": dict(self.provenance),
        }
