"""What arrays of measured numbers may be: one door through which all data come in."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .._errors import InputError


def real_array(values: ArrayLike, what: str) -> NDArray[np.floating]:
    """Return numbers as a fresh array of native float32 or float64, or say why they are not numbers.

    Integers become float64, half precision becomes float32. The entries of a masked array that are masked become NaN.

    **Arguments:**

    - `values`: anything numpy can read as an array of real numbers.
    - `what`: what the array is, for messages: `"heights"`, `"points"`.

    **Raises:** `InputError` for booleans, complex numbers, text, objects and ragged lists.

    >>> real_array([[1, 2]], "heights").dtype
    dtype('float64')
    """
    try:
        array = np.ma.asanyarray(values) if isinstance(values, np.ma.MaskedArray) else np.asarray(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} must be an array of real numbers, but numpy cannot read them: {error}") from error
    if array.dtype.kind not in "iuf":
        raise InputError(
            f"{what} must be real numbers (integers or floats), but got dtype {array.dtype}{_remedy(array.dtype.kind)}"
        )
    small = array.dtype.kind == "f" and array.dtype.itemsize <= 4
    result = np.array(np.ma.getdata(array), dtype=np.float32 if small else np.float64, order="C")
    missing = np.ma.getmask(array)
    if missing is not np.ma.nomask:
        result[missing] = np.nan
    return result


def _remedy(kind: str) -> str:
    if kind == "b":
        return "; a mask goes to mask=, or convert with .astype(float)"
    if kind == "c":
        return "; take the real part or the magnitude first"
    return "; convert with .astype(float)"


def frozen(array: NDArray) -> NDArray:
    """Make an array read-only and return it.

    >>> frozen(np.zeros(2)).flags.writeable
    False
    """
    array.setflags(write=False)
    return array


def mask_array(mask: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return a mask of missing pixels (True or non-zero = missing) as booleans of the map's shape.

    **Raises:** `InputError` for another shape and for anything but booleans and finite numbers.

    >>> mask_array([[0, 1]], (1, 2))
    array([[False,  True]])
    """
    array = np.asarray(mask)
    if array.dtype.kind not in "biuf":
        raise InputError(f"a mask holds booleans or 0 and 1 (non-zero = missing), but got dtype {array.dtype}")
    if array.shape != shape:
        raise InputError(f"a mask must have the shape of the heights, {shape}, but got {array.shape}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise InputError("a mask must be finite (non-zero = missing), but it holds NaN or infinity")
    return array != 0
