"""The physical place of the parameter square [0, 1]²: s runs along x, t along y."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from .._errors import InputError
from ._units import canonical_unit


@dataclass(frozen=True)
class Frame:
    """Origin, extent and unit of the rectangle on which parameters live: x = x₀ + s Lx, y = y₀ + t Ly.

    **Arguments:**

    - `origin`: (x₀, y₀), the place of s = t = 0.
    - `extent`: (Lx, Ly), both above zero.
    - `unit`: the unit of both, or `None` if unknown.

    **Raises:** `InputError` for a rectangle without area and for values that are not finite.

    >>> Frame((0.0, 0.0), (2.0, 1.0), "mm").parameters_of(1.0, 1.0)
    array([[0.5, 1. ]])
    """

    origin: tuple[float, float] = (0.0, 0.0)
    extent: tuple[float, float] = (1.0, 1.0)
    unit: str | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "origin", finite_pair(self.origin, "an origin (x0, y0)"))
        object.__setattr__(self, "extent", finite_pair(self.extent, "an extent (Lx, Ly)"))
        object.__setattr__(self, "unit", canonical_unit(self.unit))
        for name, length in zip("xy", self.extent, strict=True):
            if length <= 0:
                raise InputError(
                    f"a surface needs a positive extent along x and y, but along {name} it is {length:g}: "
                    "data on one line (or in one point) are not a surface; keep at least two rows and columns"
                )

    def parameters_of(self, x: ArrayLike, y: ArrayLike) -> Float[np.ndarray, "m 2"]:
        """Return the parameters (s, t) of physical positions; `x` and `y` are broadcast, then flattened.

        >>> Frame((10.0, 0.0), (2.0, 1.0)).parameters_of([10.0, 12.0], 0.5)
        array([[0. , 0.5],
               [1. , 0.5]])
        """
        return self._map(x, y, lambda values, start, length: (values - start) / length)

    def xy_of(self, parameters: Float[ArrayLike, "m 2"]) -> Float[np.ndarray, "m 2"]:
        """Return the physical positions (x, y) of parameters (s, t).

        >>> Frame((10.0, 0.0), (2.0, 1.0)).xy_of([[0.5, 1.0]])
        array([[11.,  1.]])
        """
        array = np.asarray(parameters, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 2:
            raise InputError(f"parameters are an (m, 2) array of (s, t), but got shape {array.shape}")
        return self._map(array[:, 0], array[:, 1], lambda values, start, length: start + values * length)

    def _map(self, first: ArrayLike, second: ArrayLike, along) -> np.ndarray:
        pair = np.broadcast_arrays(np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64))
        columns = [
            along(values.ravel(), start, length)
            for values, start, length in zip(pair, self.origin, self.extent, strict=True)
        ]
        return np.stack(columns, axis=1)


def finite_pair(values: object, what: str) -> tuple[float, float]:
    """Return two finite floats, or an `InputError` that names `what`.

    >>> finite_pair([1, 2], "a spacing (dx, dy)")
    (1.0, 2.0)
    """
    try:
        first, second = (float(value) for value in values)  # type: ignore[attr-defined]
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} is a pair of numbers, but got {values!r}") from error
    if not (math.isfinite(first) and math.isfinite(second)):
        raise InputError(f"{what} must be finite, but got ({first}, {second})")
    return first, second
