"""Parameters of samples: planar, conformal, or the caller's own, for every valid sample in its order."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from .._errors import InputError
from ..data import HeightMap, PointCloud
from ..parameterisation import Parameterisation, conformal, planar
from ._triangulation import nearest_of

_UP = (0.0, 0.0, 1.0)


class Placed(NamedTuple):
    """Parameters (m, 2), the rectangle's mean side lengths, E_u · E_v where it is conformal, and warnings."""

    parameters: Float[np.ndarray, "m 2"]
    sides: tuple[float, float]
    conformality: float | None
    warnings: tuple[str, ...]


def placed(
    data: HeightMap | PointCloud,
    points: Float[np.ndarray, "m 3"],
    kept: Bool[np.ndarray, " m"],
    parameters: Any,
    outward: Float[np.ndarray, " 3"] | None,
) -> Placed:
    """Give every sample its parameters; those that are not kept take the nearest kept one's.

    **Raises:** `InputError` for an unknown kind, and parameters of another shape or outside [0, 1]².
    """
    if isinstance(parameters, str):
        if parameters == "planar" and isinstance(data, HeightMap):
            return Placed(data.samples().parameters, data.extent, None, ())
        return _completed(_computed(data, points, kept, parameters, outward), points, kept)
    if isinstance(parameters, Parameterisation):
        values, sides, found = parameters.parameters, parameters.sides, parameters
        certificate, warnings = found.certificate, found.warnings
    else:
        values, sides, certificate, warnings = np.asarray(parameters, np.float64), None, None, ()
    if values.shape != (len(points), 2):
        raise InputError(
            f"parameters hold one (s, t) a valid sample, shape ({len(points)}, 2); received {values.shape}"
        )
    if not ((values >= 0) & (values <= 1)).all():
        raise InputError(
            f"parameters lie in [0, 1]²; received {np.min(values):g} to {np.max(values):g}; scale them, or use 'planar'"
        )
    return Placed(values, _mean_sides(values[kept], points[kept]) if sides is None else sides, certificate, warnings)


def _computed(
    data: HeightMap | PointCloud, points: np.ndarray, kept: np.ndarray, kind: str, outward: np.ndarray | None
) -> Parameterisation:
    """The parameterisation of the kept samples."""
    if kind not in ("planar", "conformal"):
        raise InputError(
            f"parameters are 'planar', 'conformal', an (m, 2) array or a Parameterisation; received {kind!r}"
        )
    triangles = data.triangles if isinstance(data, PointCloud) and kept.all() else None
    cloud = PointCloud(points[kept], data.unit, triangles=triangles)
    side = _UP if outward is None else tuple(outward.tolist())
    return planar(cloud, axes="plane", outward=side) if kind == "planar" else conformal(cloud, outward=side)


def _completed(found: Parameterisation, points: np.ndarray, kept: np.ndarray) -> Placed:
    """The same for all samples."""
    parameters = np.empty((len(points), 2))
    parameters[kept] = found.parameters
    if not kept.all():
        parameters[~kept] = found.parameters[nearest_of(points[kept], points[~kept])]
    return Placed(parameters, found.sides, found.certificate, found.warnings)


def _mean_sides(parameters: np.ndarray, points: np.ndarray) -> tuple[float, float]:
    """Lengths of the rectangle for parameters of unknown origin: those of the best affine map to space."""
    columns = np.column_stack([parameters, np.ones(len(points))])
    along, across, _ = np.linalg.lstsq(columns, points, rcond=None)[0]
    lengths = float(np.linalg.norm(along)), float(np.linalg.norm(across))
    if min(lengths) <= 0:
        raise InputError("parameters must spread the points over the square; received parameters on one line")
    return lengths
