"""Point clouds: points in space, with or without triangles; right-handed coordinates, one unit."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int, Real
from numpy.typing import ArrayLike

from .._errors import InputError
from ._arrays import frozen, real_array
from ._frame import Frame
from ._provenance import recorded
from ._samples import Samples
from ._units import canonical_unit, parse_length, unit_factor

_FLAT = 1e-10  # width over length of an (x, y) projection below which points count as collinear


@dataclass(frozen=True, init=False, eq=False, repr=False)
class PointCloud:
    """Measured points in space, scattered or the vertices of a triangle mesh; immutable.

    **Arguments:**

    - `points`: (m, 3), finite; float32 and float64 are kept, integers become float64. Copied and read-only.
    - `unit`: the unit of all three coordinates, or `None` if unknown.
    - `triangles`: (k, 3) indices of vertices; their winding says which side is outside. Optional.
    - `provenance`: where the data come from; `name`, `sha256` and `operations` by convention.

    **Raises:** `InputError` for another shape, an empty cloud, points that are not finite real numbers, an unknown unit
    and triangles that name vertices that do not exist.

    >>> PointCloud([[0, 0, 0], [1, 0, 0], [0, 1, 1]], unit="mm")
    PointCloud(3 points, diagonal=1.73205 mm, float64)
    """

    points: Float[np.ndarray, "m 3"]
    unit: str | None
    triangles: Int[np.ndarray, "k 3"] | None
    provenance: dict[str, Any]

    def __init__(
        self,
        points: Real[ArrayLike, "m 3"],
        unit: str | None = None,
        *,
        triangles: Int[ArrayLike, "k 3"] | None = None,
        provenance: Mapping[str, Any] | None = None,
    ) -> None:
        array = _point_array(points)
        object.__setattr__(self, "points", frozen(array))
        object.__setattr__(self, "unit", canonical_unit(unit))
        object.__setattr__(self, "triangles", None if triangles is None else _triangle_array(triangles, len(array)))
        object.__setattr__(self, "provenance", dict(provenance or {}))

    def __repr__(self) -> str:
        """Say how many points there are, of what size."""
        unit = f" {self.unit}" if self.unit else ""
        triangles = "" if self.triangles is None else f"{len(self.triangles)} triangles, "
        return (
            f"PointCloud({len(self.points)} points, {triangles}diagonal={self.diagonal:.6g}{unit}, {self.points.dtype})"
        )

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.points)

    @property
    def diagonal(self) -> float:
        """The diagonal of the bounding box: the range of a model in space."""
        return float(np.linalg.norm(np.ptp(self.points.astype(np.float64), axis=0)))

    @property
    def frame(self) -> Frame:
        """The bounding box of x and y; raises `InputError` where it has no area."""
        plane = self.points[:, :2].astype(np.float64)
        low, extent = plane.min(axis=0), np.ptp(plane, axis=0)
        return Frame((float(low[0]), float(low[1])), (float(extent[0]), float(extent[1])), self.unit)

    def samples(self, *, as_surface: bool = False) -> Samples:
        """Return the points as samples over the bounding box of x and y: s along x, t along y.

        **Arguments:**

        - `as_surface`: False gives heights z (m, 1); True gives the points themselves (m, 3), for a model in space.

        **Raises:** `InputError` for points that lie on one line, seen along z: they are not a surface over (x, y).

        >>> PointCloud([[0, 0, 5], [2, 0, 6], [0, 1, 7]]).samples().parameters
        array([[0., 0.],
               [1., 0.],
               [0., 1.]])
        """
        self._refuse_line()
        frame = self.frame
        parameters = frame.parameters_of(self.points[:, 0], self.points[:, 1])
        values = self.points if as_surface else self.points[:, 2:]
        return Samples(np.clip(parameters, 0.0, 1.0), values, None, frame)

    def crop(self, x0: float | str, y0: float | str, x1: float | str, y1: float | str) -> "PointCloud":
        """Return the points with x in [x0, x1] and y in [y0, y1], and the triangles that keep all three vertices.

        **Raises:** `InputError` when no point is left.

        >>> PointCloud([[0, 0, 0], [1, 0, 0], [9, 1, 1]]).crop(0, 0, 2, 2)
        PointCloud(2 points, diagonal=1, float64)
        """
        low = np.array([parse_length(x0, self.unit), parse_length(y0, self.unit)])
        high = np.array([parse_length(x1, self.unit), parse_length(y1, self.unit)])
        plane = self.points[:, :2]
        inside = np.logical_and.reduce((plane >= low) & (plane <= high), axis=1)
        name = f"{low[0]:g},{low[1]:g},{high[0]:g},{high[1]:g}"
        if not inside.any():
            raise InputError(f"the crop {name} holds no point: x and y run from {plane.min(0)} to {plane.max(0)}")
        triangles = self.triangles
        if triangles is not None:
            renumbered = np.cumsum(inside) - 1
            triangles = renumbered[triangles[inside[triangles].all(axis=1)]]
        provenance = recorded(self.provenance, f"crop {name}", self.unit)
        return replace(self, points=self.points[inside], triangles=triangles, provenance=provenance)

    def to_unit(self, unit: str) -> "PointCloud":
        """Return the same points in another unit.

        **Raises:** `InputError` for a cloud whose unit is unknown.

        >>> PointCloud([[1.0, 2.0, 3.0]], unit="mm").to_unit("m").points
        array([[0.001, 0.002, 0.003]])
        """
        if self.unit is None:
            raise InputError(f"a cloud of unknown unit cannot be converted to {unit!r}; state its unit= (--unit)")
        return replace(self, points=self.points * unit_factor(self.unit, unit), unit=unit)

    def _refuse_line(self) -> None:
        plane = self.points[:, :2].astype(np.float64)
        count = len(plane)
        centred = plane - plane.mean(axis=0)
        length, width = np.linalg.svd(centred, compute_uv=False)[:2] if count > 1 else (0.0, 0.0)
        rounding = 2 * np.finfo(self.points.dtype).eps * float(np.abs(plane).max()) * count**0.5
        if width > max(_FLAT * length, rounding):
            return
        if count < 3:
            raise InputError(f"a surface needs three points that are not on one line, but the cloud holds {count}")
        raise InputError(
            f"the {count} points lie on one line in (x, y), so they are not a surface over (x, y); "
            "check the order of the coordinates or rotate the cloud"
        )


def _point_array(points: ArrayLike) -> np.ndarray:
    array = real_array(points, "points")
    if array.ndim != 2 or array.shape[1] != 3:
        raise InputError(f"points are an (m, 3) array of x, y, z, but got shape {array.shape}")
    if not len(array):
        raise InputError("a point cloud needs at least one point, but got none")
    bad = int((~np.isfinite(array).all(axis=1)).sum())
    if bad:
        raise InputError(f"points must be finite, but {bad} of {len(array)} hold NaN or infinity; leave them out")
    return array


def _triangle_array(triangles: ArrayLike, count: int) -> np.ndarray:
    array = np.array(triangles)
    if array.size == 0:
        array = array.astype(np.int64).reshape(0, 3)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "iu":
        raise InputError(f"triangles are a (k, 3) array of integers, but got {array.dtype} of shape {array.shape}")
    if array.size and (array.min() < 0 or array.max() >= count):
        raise InputError(f"triangles name vertices 0 to {count - 1}, but got {array.min()} to {array.max()}")
    return frozen(array.astype(np.int64, copy=False))
