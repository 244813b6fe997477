"""What a parameterisation is: a place in [0, 1]² for every point, and how far the map to space is from a similarity."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..data import Frame


class Dilatation(NamedTuple):
    """How much longer circles of the rectangle become along one axis than the other; 1 is conformal. Area-weighted."""

    median: float
    percentile_95: float


@dataclass(frozen=True, eq=False, repr=False)
class Parameterisation:
    """Parameters (s, t) of points in space, s × t right-handed towards the outward side.

    - `parameters`: (m, 2) in [0, 1]², in the order of the points; read-only.
    - `sides`: (Ls, Lt), mean physical lengths of the parameter rectangle along s and t; a lattice of M × N elements
      with M / N ≈ Ls / Lt has elements that are square in space. A conformal map's rectangle has the surface's area.
    - `kind`: `"planar"` or `"conformal"`.
    - `unit`: of the points and the sides, or `None`.
    - `corners`: (4,), the points at (s, t) = (0, 0), (1, 0), (1, 1), (0, 1); `None` for planar.
    - `boundary`: (b,), the outer loop from the first corner on, counter-clockwise seen from outside; `None` for planar.
    - `certificate`: E_u · E_v, which is 1 for a conformal map; `None` for planar.
    - `dilatation`: median and 95th percentile over the area of the surface; `None` for planar.
    - `warnings`: what was done beyond the request, or looks doubtful.
    """

    parameters: Float[np.ndarray, "m 2"]
    sides: tuple[float, float]
    kind: Literal["planar", "conformal"]
    unit: str | None = None
    corners: Int[np.ndarray, "4"] | None = None
    boundary: Int[np.ndarray, " b"] | None = None
    certificate: float | None = None
    dilatation: Dilatation | None = None
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.parameters, self.corners, self.boundary):
            if array is not None:
                array.setflags(write=False)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.parameters)

    def __repr__(self) -> str:
        """Say the kind, the size of the rectangle, and how conformal it is."""
        parts = [f"{len(self)} points", self.kind, "sides={:.4g} × {:.4g}".format(*self.sides)]
        parts[-1] += f" {self.unit}" if self.unit else ""
        if self.certificate is not None and self.dilatation is not None:
            parts.append(f"E_u·E_v={self.certificate:.4f}")
            parts.append(f"dilatation={self.dilatation.median:.3f} (95 %: {self.dilatation.percentile_95:.3f})")
        if self.warnings:
            parts.append(f"{len(self.warnings)} warning{'s' if len(self.warnings) > 1 else ''}")
        return f"Parameterisation({', '.join(parts)})"

    @property
    def side_ratio(self) -> float:
        """The ratio h = Lt / Ls; (s, h t) is the conformal map."""
        return self.sides[1] / self.sides[0]

    @property
    def frame(self) -> Frame:
        """The parameter rectangle at its mean side lengths, as a frame for `Samples`."""
        return Frame((0.0, 0.0), self.sides, self.unit)
