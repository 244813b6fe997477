"""In which precision numbers are computed: the one rule of all packages."""

import numpy as np
from numpy.typing import DTypeLike

from .._errors import InputError


def checked_precision(dtype: DTypeLike, *, double: bool) -> np.dtype:
    """float32 or float64, and the second only where it is to be had.

    **Arguments:**

    - `dtype`: what is asked for.
    - `double`: whether JAX's 64-bit mode is on.

    **Raises:** `InputError` for any other type, and for float64 without that mode.

    >>> checked_precision("float32", double=False)
    dtype('float32')
    """
    try:
        chosen = np.dtype(dtype)
    except TypeError as error:
        raise InputError(f"a dtype is float32 or float64; received {dtype!r}; leave it out for the data's") from error
    if chosen not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise InputError(f"a dtype is float32 or float64; received {chosen}; leave it out for the data's")
    if chosen == np.float64 and not double:
        raise InputError(
            "float64 data need JAX's 64-bit mode, which is off; run jax.config.update('jax_enable_x64', True) "
            "before the first computation, or pass dtype='float32' to accept single precision"
        )
    return chosen
