"""What users hand in as parameters: rows of two numbers in [0, 1]², checked in one pass."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from .._errors import InputError

RULE = "parameters lie in [0, 1]²"


def check_parameters(parameters: ArrayLike, dtype: np.dtype) -> Array:
    """Parameters as a device array, refused outside [0, 1]²."""
    array = rows_of_two(parameters)
    if isinstance(array, Tracer):
        return refuse_traced(jnp.asarray(array, dtype))
    require_inside(np.asarray(array, dtype))
    return jnp.asarray(array, dtype)


def rows_of_two(parameters: ArrayLike) -> np.ndarray | Array:
    """Parameters as they are, on the host or on the device, refused unless they are rows of two real numbers."""
    array = real_array(parameters, "parameters")
    if array.ndim not in (1, 2) or array.shape[-1] != 2:
        raise InputError(f"parameters have shape (m, 2) or (2,); received {array.shape}; stack s and t as columns")
    return array


def real_array(values: ArrayLike, name: str) -> np.ndarray | Array:
    """Real numbers as an array, which stays where it is."""
    try:
        array = values if isinstance(values, jax.Array) else np.asarray(values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} are real numbers in rows of one length; received {values!r}") from error
    if not jnp.issubdtype(array.dtype, jnp.floating) and array.dtype.kind not in "biu":
        raise InputError(f"{name} are real numbers; received {array.dtype}; convert them first")
    return array


def require_inside(parameters: Float[np.ndarray, "m 2"] | Float[Array, "m 2"]) -> None:
    """Raise for parameters outside [0, 1]², and for NaN."""
    if not parameters.size:
        return
    if isinstance(parameters, jax.Array):
        # Not by extremes: those of large arrays lose NaN in some versions of XLA.
        good = bool(_all_inside(parameters))
    else:
        # numpy's extremes carry NaN along, and need no array of flags as long as the parameters.
        good = bool(parameters.min() >= 0 and parameters.max() <= 1)
    if good:
        return
    array = np.asarray(parameters)
    worst = array[~((array >= 0) & (array <= 1))][0]
    if np.isnan(worst):
        raise InputError(f"{RULE}; received NaN; leave missing places out, or use TSpline.at, which is NaN there")
    raise InputError(f"{RULE}; received {worst:g}; clip them, or use TSpline.at for NaN outside")


def refuse_traced(parameters: Array) -> Array:
    """The same while a function is being transformed: an error when it runs."""
    return eqx.error_if(parameters, ~_all_inside(parameters), f"{RULE} and are not NaN; clip them or use TSpline.at")


@jax.jit
def _all_inside(parameters: Array) -> Array:
    """Whether all parameters are in [0, 1]², without leaving the device."""
    return jnp.all((parameters >= 0) & (parameters <= 1))
