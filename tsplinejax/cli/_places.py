"""A surface at many places, in parts that bound the memory."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from .._errors import InputError
from ..data import HeightMap, PointCloud
from ..surface import TSpline

#: Places evaluated at a time; one compiled kernel serves all parts.
_CHUNK = 1 << 18
_FEWEST = 1 << 10


def in_unit_of(surface: TSpline, data: HeightMap | PointCloud) -> HeightMap | PointCloud:
    """The data in the model's unit; refused where only the model's is known."""
    unit = surface.frame.unit
    if unit is None or unit == data.unit:
        return data
    if data.unit is None:
        raise InputError(
            f"the model is in {unit}, but the data have no unit; give --unit (and --spacing) as for the fit"
        )
    return data.to_unit(unit)


def at_parameters(surface: TSpline, parameters: Float[np.ndarray, "m 2"]) -> np.ndarray:
    """The surface at many parameters: heights (m,) or points (m, 3)."""
    return _in_chunks(lambda chunk: np.asarray(surface(chunk)), np.asarray(parameters, surface.space.dtype))


def at_places(surface: TSpline, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """The surface at many places: heights of their shape, or points in space; NaN outside the domain."""
    places = np.column_stack([np.ravel(x), np.ravel(y)])
    if surface.is_height_map:
        values = _in_chunks(lambda chunk: np.asarray(surface.at(chunk[:, 0], chunk[:, 1])), places)
        return values.reshape(np.shape(x))
    parameters = surface.frame.parameters_of(places[:, 0], places[:, 1])
    slack = 64 * np.finfo(surface.space.dtype).eps
    inside = ((parameters >= -slack) & (parameters <= 1 + slack)).all(axis=1)
    values = at_parameters(surface, np.clip(parameters, 0, 1))
    return np.where(inside[:, None], values, np.nan)


def _in_chunks(evaluate: Callable[[np.ndarray], np.ndarray], places: Float[np.ndarray, "m 2"]) -> np.ndarray:
    """Evaluate in parts of one length: each part but the last is full, and the last is filled up."""
    length = _FEWEST
    while length < min(len(places), _CHUNK):
        length *= 2
    parts = []
    for start in range(0, len(places), length):
        part = places[start : start + length]
        filled = np.concatenate([part, np.repeat(part[-1:], length - len(part), axis=0)])
        parts.append(evaluate(filled)[: len(part)])
    return np.concatenate(parts)
