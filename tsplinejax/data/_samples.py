"""Samples: values at parameters, the form in which every fit receives its data."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy.typing import ArrayLike

from .._errors import InputError
from ._arrays import frozen, real_array
from ._frame import Frame

_UNIT_SQUARE = Frame()


@dataclass(frozen=True, eq=False, repr=False)
class Samples:
    """Values v (m, d) at parameters (s, t) in [0, 1]², with optional weights: d = 1 for heights, 3 for points in space.

    **Arguments:**

    - `parameters`: (m, 2), column 0 is s (along x), column 1 is t (along y); kept in float64.
    - `values`: (m, d) or (m,), finite, in the unit of the frame; float32 stays float32.
    - `weights`: (m,), finite and not negative, or `None` for equal weights.
    - `frame`: the physical place of the parameter square.
    - `grid_shape`: (rows, columns) of the height map the samples come from, if they do.
    - `grid_index`: (m,), each sample's place in the flattened grid; given together with `grid_shape`.

    **Raises:** `InputError` for wrong shapes, values that are not finite, and parameters outside the square.

    >>> Samples([[0.0, 0.0], [1.0, 1.0]], [1.0, 2.0])
    Samples(2 values of dimension 1, float64, weights=None, grid_shape=None)
    """

    parameters: Float[np.ndarray, "m 2"]
    values: Float[np.ndarray, "m d"]
    weights: Float[np.ndarray, " m"] | None = None
    frame: Frame = _UNIT_SQUARE
    grid_shape: tuple[int, int] | None = None
    grid_index: Int[np.ndarray, " m"] | None = None

    def __post_init__(self) -> None:
        parameters, values = _checked_pair(self.parameters, self.values)
        object.__setattr__(self, "parameters", frozen(parameters))
        object.__setattr__(self, "values", frozen(values))
        if self.weights is not None:
            object.__setattr__(self, "weights", frozen(_checked_weights(self.weights, len(values), values.dtype)))
        if (self.grid_shape is None) != (self.grid_index is None):
            raise InputError("grid_shape and grid_index belong together, but only one of them was given")
        if self.grid_index is not None:
            object.__setattr__(self, "grid_index", _checked_index(self.grid_index, self.grid_shape, len(values)))

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.values)

    def __repr__(self) -> str:
        """Say how many samples there are and of what kind."""
        weights = None if self.weights is None else "given"
        return (
            f"Samples({len(self)} values of dimension {self.dimension}, {self.values.dtype}, "
            f"weights={weights}, grid_shape={self.grid_shape})"
        )

    @property
    def dimension(self) -> int:
        """The number of components of a value: 1 for heights, 3 for points in space."""
        return self.values.shape[1]

    def scatter(self, values_per_sample: ArrayLike) -> np.ndarray:
        """Put one number per sample back on the grid the samples came from; NaN where no sample is.

        **Arguments:**

        - `values_per_sample`: (m,), for instance residuals or a mask of outliers.

        **Returns:** (rows, columns), floats.

        **Raises:** `InputError` if the samples come from no grid, or for another shape.

        >>> Samples([[0, 0], [1, 0], [0, 1]], [1, 2, 3], grid_shape=(2, 2), grid_index=[0, 1, 2]).scatter([5, 6, 7])
        array([[ 5.,  6.],
               [ 7., nan]])
        """
        if self.grid_shape is None:
            raise InputError("only the samples of a height map can be put back on a grid, but these have none")
        array = np.asarray(values_per_sample)
        if array.shape != (len(self),):
            raise InputError(f"one number per sample is needed, shape ({len(self)},), but got {array.shape}")
        dtype = array.dtype if array.dtype.kind == "f" else np.float64
        grid = np.full(self.grid_shape[0] * self.grid_shape[1], np.nan, dtype)
        grid[self.grid_index] = array
        return grid.reshape(self.grid_shape)


def _checked_pair(parameters: ArrayLike, values: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    place = real_array(parameters, "parameters").astype(np.float64, copy=False)
    value = real_array(values, "values")
    if value.ndim == 1:
        value = value[:, np.newaxis]
    if place.ndim != 2 or place.shape[1] != 2:
        raise InputError(f"parameters are an (m, 2) array of (s, t), but got shape {place.shape}")
    if value.ndim != 2 or len(value) != len(place) or value.shape[1] == 0:
        raise InputError(f"values are an (m, d) array with m = {len(place)} as the parameters, but got {value.shape}")
    if len(value) == 0:
        raise InputError("there are no samples: at least one is needed")
    if not np.isfinite(value).all():
        bad = int((~np.isfinite(value).all(axis=1)).sum())
        raise InputError(f"values must be finite, but {bad} of {len(value)} hold NaN or infinity; leave them out")
    if not ((place >= 0) & (place <= 1)).all():
        raise InputError(
            f"parameters must lie in [0, 1]², but they run from {place.min():g} to {place.max():g}; "
            "map them there with Frame.parameters_of"
        )
    return place, value


def _checked_weights(weights: ArrayLike, count: int, dtype: np.dtype) -> np.ndarray:
    array = real_array(weights, "weights").astype(dtype, copy=False)
    if array.shape != (count,):
        raise InputError(f"one weight per sample is needed, shape ({count},), but got {array.shape}")
    if not np.isfinite(array).all() or (array < 0).any():
        raise InputError("weights must be finite and not negative; a sample to be ignored has weight 0")
    if not array.any():
        raise InputError("all weights are 0: at least one sample must count")
    return array


def _checked_index(index: ArrayLike, shape: tuple[int, int] | None, count: int) -> np.ndarray:
    array = np.array(index)
    rows, columns = shape or (0, 0)
    if array.dtype.kind not in "iu" or array.shape != (count,):
        raise InputError(f"grid_index holds {count} integers, one per sample, but got {array.dtype} {array.shape}")
    if array.min() < 0 or array.max() >= rows * columns:
        raise InputError(f"grid_index must lie in the grid of {rows} × {columns} pixels, but reaches {array.max()}")
    return frozen(array.astype(np.int64, copy=False))
