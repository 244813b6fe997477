"""What form removal returns: form, texture and the account of both."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from ..data import HeightMap, PointCloud
from ..surface import TSpline
from ._fit_form import FittedForm


@dataclass(frozen=True)
class Distortion:
    """How far the texture map's plane is from the form's own surface, at 95 % of the places or less.

    **Attributes:**

    - `area`: deviation of the area ratio from 1.
    - `length`: deviation of the length ratio from 1, in the direction in which it is largest.
    """

    area: float
    length: float


@dataclass(frozen=True, eq=False, repr=False)
class FormRemoval:
    """A form, the texture on it, and the account of both. Arrays are in the order of the data's valid samples.

    **Attributes:**

    - `form`: a `TSpline`, or a `FittedForm`.
    - `data`: the data the form was taken from, after S-filter and levelling.
    - `points`: (m, 3), its valid samples in space.
    - `parameters`: (m, 2), where they stand on the form, in [0, 1]².
    - `form_points`: (m, 3), the feet of the points (for method "height": the form above the same x and y).
    - `texture`: (m,), signed distance along the form's normal, positive out of the material; along z for "height".
    - `normals`: (m, 3), the form's unit normals out of the material.
    - `outliers`: (m,), samples that were set aside; they count in none of the figures.
    - `weights`: (m,), the area of the form that each sample stands for.
    - `texture_map`: the texture as a height map: on the data's own pixels for a height map, else resampled over the
      parameter rectangle scaled to its mean side lengths; outliers and gaps are missing.
    - `distortion`: of that map.
    - `sq_texture`, `sa_texture`: Sq and Sa of the texture, weighted by area, its mean removed.
    - `max_error`: the largest magnitude of the texture.
    - `control_points`: of the form; `None` for a simple form.
    - `edf`: effective degrees of freedom of the form, of which each takes its part of the texture.
    - `conformality`: E_u · E_v, 1 for a conformal parameterisation; `None` for a planar one.
    - `normal`: (3,), the mean direction out of the material.
    - `cutoff_estimate`: twice the form's mean element size: waves much longer are form, waves much shorter texture.
    - `absorbed_share`: the estimated share of the texture's mean square that the form took along.
    - `tolerance`: the largest distance asked for, or `None`.
    - `converged`: whether the fit came to rest and met the tolerance, if there is one.
    - `method`, `unit`, `seconds`, `warnings`, `operations`, `provenance`: as for a fit.
    """

    form: TSpline | FittedForm
    data: HeightMap | PointCloud
    points: Float[np.ndarray, "m 3"]
    parameters: Float[np.ndarray, "m 2"]
    form_points: Float[np.ndarray, "m 3"]
    texture: Float[np.ndarray, " m"]
    normals: Float[np.ndarray, "m 3"]
    outliers: Bool[np.ndarray, " m"]
    weights: Float[np.ndarray, " m"]
    texture_map: HeightMap | None
    distortion: Distortion
    sq_texture: float
    sa_texture: float
    max_error: float
    control_points: int | None
    edf: float
    conformality: float | None
    normal: Float[np.ndarray, " 3"]
    cutoff_estimate: float | None
    absorbed_share: float
    tolerance: float | None
    converged: bool
    method: str
    unit: str | None
    seconds: float
    warnings: tuple[str, ...]
    operations: tuple[str, ...]
    provenance: Mapping[str, Any]

    def __repr__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        form = self.form.form.name if isinstance(self.form, FittedForm) else f"{self.control_points} control points"
        return (
            f"FormRemoval({len(self.texture)} samples, {self.method}, {form}, Sq {self.sq_texture:.4g}{unit}, "
            f"edf {self.edf:.4g}, {'converged' if self.converged else 'not converged'})"
        )

    @property
    def report(self) -> dict[str, Any]:
        """The figures under the names that the command line uses."""
        return {
            "sq_texture": self.sq_texture,
            "sa_texture": self.sa_texture,
            "max_error": self.max_error,
            "rms_error": float(np.sqrt(np.mean(self.texture[~self.outliers] ** 2))),
            "range": float(np.ptp(self.texture[~self.outliers])),
            "unit": self.unit,
            "tolerance": self.tolerance,
            "converged": self.converged,
            "method": self.method,
            "samples": len(self.texture),
            "control_points": self.control_points,
            "edf": self.edf,
            "conformality": self.conformality,
            "outliers": int(np.count_nonzero(self.outliers)),
            "normal": self.normal.tolist(),
            "cutoff_estimate": self.cutoff_estimate,
            "absorbed_share": self.absorbed_share,
            "distortion": {"area": self.distortion.area, "length": self.distortion.length},
            "operations": list(self.operations),
            "seconds": self.seconds,
            "warnings": list(self.warnings),
            "provenance": dict(self.provenance),
        }
