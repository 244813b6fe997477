"""What a multi-resolution analysis returns: bands, their sum, and what is left."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ..data import HeightMap
from ..fitting import StopReason
from ..surface import TSpline


@dataclass(frozen=True, eq=False, repr=False)
class Band:
    """What a finer space adds to the coarser one before it; lengths are in the map's unit.

    **Attributes:**

    - `surface`: the band as a T-spline in its own space V_k, which holds the spaces before it.
    - `heights`: its heights at the pixels; missing ones stay missing.
    - `spacing`: size of the smallest elements of its mesh.
    - `shortest`, `longest`: the wavelengths at which half of a wave's energy is in the band, on average over its
      phases: twice the smallest element of its own mesh, and twice the largest of the mesh before; infinite for the
      first band.
    - `sq`: Sq of the heights.
    """

    surface: TSpline
    heights: HeightMap
    spacing: float
    shortest: float
    longest: float
    sq: float

    def __repr__(self) -> str:
        unit = f" {self.heights.unit}" if self.heights.unit else ""
        return (
            f"Band({self.shortest:.4g} to {self.longest:.4g}{unit}, Sq {self.sq:.4g}{unit}, "
            f"{len(self.surface.control_points)} control points)"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Multiresolution:
    """A surface as a sum of bands; lengths are in the map's unit.

    **Attributes:**

    - `bands`: from coarse to fine.
    - `surface`: their sum as one T-spline in the finest space; `fitted`: its heights at the pixels.
    - `remainder`: data minus `fitted`: what no band holds.
    - `sq_fitted`, `sq_remainder`: Sq of both.
    - `tolerance`: largest remainder asked for, or `None` where lattices are uniform.
    - `max_error`, `rms_error`: largest and root-mean-square remainder.
    - `range`: max - min of the data.
    - `stop`, `converged`: why refinement stopped, and whether the tolerance is met; of uniform lattices `None`, True.
    - `unit`, `seconds`, `warnings`, `operations`, `provenance`: as for a fit.
    """

    bands: tuple[Band, ...]
    surface: TSpline
    fitted: HeightMap
    remainder: HeightMap
    sq_fitted: float
    sq_remainder: float
    tolerance: float | None
    max_error: float
    rms_error: float
    range: float
    stop: StopReason | None
    converged: bool
    unit: str | None
    seconds: float
    warnings: tuple[str, ...]
    operations: tuple[str, ...]
    provenance: Mapping[str, Any]

    def __len__(self) -> int:
        """Return the number of bands."""
        return len(self.bands)

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        shares = ", ".join(f"{band.sq:.3g}" for band in self.bands)
        return f"Multiresolution({len(self)} bands of Sq {shares}{unit}, remainder Sq {self.sq_remainder:.3g}{unit})"

    @property
    def heights(self) -> Float[np.ndarray, "k rows columns"]:
        """The heights of all bands, coarse first; they add up to `fitted`."""
        return np.stack([band.heights.heights for band in self.bands])

    @property
    def leak(self) -> float:
        """How far the bands are from orthogonal on the samples: |Sq² - Σ Sq_k²| / Sq² of the fitted surface."""
        whole = self.sq_fitted**2
        return abs(whole - sum(band.sq**2 for band in self.bands)) / whole if whole > 0 else 0.0

    @property
    def report(self) -> dict[str, Any]:
        """The figures under the names that the command line uses."""
        return {
            "bands": [
                {
                    "sq": band.sq,
                    "shortest": band.shortest,
                    "longest": band.longest,
                    "spacing": band.spacing,
                    "control_points": len(band.surface.control_points),
                }
                for band in self.bands
            ],
            "levels": len(self),
            "leak": self.leak,
            "control_points": len(self.surface.control_points),
            "stop": None if self.stop is None else str(self.stop),
            **{
                name: getattr(self, name)
                for name in (
                    "sq_fitted",
                    "sq_remainder",
                    "tolerance",
                    "max_error",
                    "rms_error",
                    "range",
                    "converged",
                    "unit",
                    "seconds",
                )
            },
            "operations": list(self.operations),
            "warnings": list(self.warnings),
            "provenance": dict(self.provenance),
        }
