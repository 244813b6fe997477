"""Parameters of samples: planar, conformal, or the caller's own, for every valid sample in its order."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

from .._errors import InputError
from ..data import HeightMap, PointCloud
from ..parameterisation import Parameterisation, conformal, planar
from ._triangulation import nearest_of

_UP = (0.0, 0.0, 1.0)
_SEEN, _ASKED, _AROUND = 40_000, 1000, 12
_FOLD = 3.0  # times as far: more than any slope that can be fitted in a plane
_FOLDED = "seen from any direction the points lie over each other; planar parameters fold, use parameters='conformal'"


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
    if kind == "conformal":
        return conformal(cloud, outward=outward, merge_duplicates=True)
    direction, folded = viewing_direction(cloud.points, np.array(_UP) if outward is None else outward)
    flat = cloud.points - (cloud.points @ direction)[:, None] * direction
    found = planar(PointCloud(flat, data.unit), axes="plane", outward=tuple(direction.tolist()))
    return replace(found, warnings=(*found.warnings, _FOLDED)) if folded else found


def viewing_direction(points: Float[np.ndarray, "m 3"], outward: Float[np.ndarray, " 3"]) -> tuple[np.ndarray, bool]:
    """The direction along which a cloud is seen without folds: a principal axis or `outward`; and if all fold.

    A view folds where points that lie side by side in it are far from each other in space. The least-squares plane's
    normal comes first, but a form may well be deeper than it is wide.

    >>> x, y = np.meshgrid(np.linspace(-1, 1, 40), np.linspace(-1, 1, 40))
    >>> saddle = np.column_stack([x.ravel(), y.ravel(), 3 * (x**2 - y**2).ravel()])
    >>> round(float(viewing_direction(saddle, np.array([0.0, 0.0, 1.0]))[0][2]), 6)
    1.0
    """
    few = points[:: max(1, len(points) // _SEEN)]
    axes = np.linalg.svd(few - few.mean(axis=0), full_matrices=False)[2][::-1]
    candidates = [*axes, outward]
    folds = [_fold(few, direction) for direction in candidates]
    best = min(folds)
    chosen = next(k for k, fold in enumerate(folds) if fold <= 1.5 * best)
    direction = candidates[chosen]
    return direction * (1.0 if direction @ outward >= 0 else -1.0), best > _FOLD


def _fold(points: np.ndarray, direction: np.ndarray) -> float:
    """How many times as far the neighbours in a view are from each other, in space, as those in space; on the mean."""
    across = np.linalg.svd(direction[None])[2][1:]
    asked = np.arange(0, len(points), max(1, len(points) // _ASKED))
    count = min(_AROUND, len(points))

    def reach(places: np.ndarray) -> np.ndarray:
        nearest = cKDTree(places).query(places[asked], k=count)[1].reshape(len(asked), count)
        return np.linalg.norm(points[nearest] - points[asked][:, None], axis=2).sum(axis=1)

    apart = reach(points)
    return float(np.mean(reach(points @ across.T)[apart > 0] / apart[apart > 0])) if apart.any() else 1.0


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
