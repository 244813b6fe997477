"""Measured samples over a model's parameters, and the ones nearest to wanted places."""

from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float, Int

from .._errors import InputError
from ..data import HeightMap, PointCloud, Samples, as_data
from ..parameterisation import Parameterisation, conformal
from ..surface import TSpline

_SLACK = 1e-6  # of the side: frames of single precision differ by less, pixels by more


def measured_samples(data: Any, model: TSpline | None, parameters: Any) -> tuple[Samples, Int[np.ndarray, " m"]]:
    """The data's valid samples on the parameter square of a model (or their own), and which of the data they are.

    **Raises:** `InputError` for units that do not fit, data outside the model, and parameters that are no such.
    """
    if isinstance(data, Samples):
        samples, index = data, np.arange(len(data))
    else:
        samples, index = _samples_of(_in_unit(as_data(data), model), model, parameters)
    dimension = 0 if model is None else 1 if model.is_height_map else 3
    if dimension not in (0, samples.dimension):
        raise InputError(
            f"the model's values have {dimension} component{'s' if dimension > 1 else ''}, the data's "
            f"{samples.dimension}; a height map needs a model of heights"
        )
    return samples, index


def sample_count(data: Any) -> int:
    """How many valid samples data hold."""
    if not isinstance(data, Samples):
        data = as_data(data)
    return int(data.valid.sum()) if isinstance(data, HeightMap) else len(data)


def _in_unit(data: HeightMap | PointCloud, model: TSpline | None) -> HeightMap | PointCloud:
    """The data in the model's unit."""
    unit = None if model is None else model.unit
    if unit is None or data.unit == unit:
        return data
    if data.unit is None:
        raise InputError(f"the model is in {unit}, but the data have no unit; state it (unit=, --unit)")
    return data.to_unit(unit)


def _samples_of(
    data: HeightMap | PointCloud, model: TSpline | None, parameters: Any
) -> tuple[Samples, Int[np.ndarray, " m"]]:
    """Samples of a map, or of a cloud as heights or as points in space."""
    planar = isinstance(parameters, str) and parameters == "planar"
    if isinstance(data, HeightMap):
        if not planar:
            raise InputError("a height map's parameters are its own x and y; leave parameters= out")
        samples = data.samples()
        assert samples.grid_index is not None
        return _within(samples, samples.grid_index, model)
    if not planar:
        return _unrolled(data, model, parameters), np.arange(len(data))
    in_space = model is not None and not model.is_height_map
    return _within(data.samples(as_surface=in_space), np.arange(len(data)), model)


def _within(
    samples: Samples, index: Int[np.ndarray, " m"], model: TSpline | None
) -> tuple[Samples, Int[np.ndarray, " m"]]:
    """The samples that lie on the model, with its parameters."""
    if model is None or model.frame == samples.frame:
        return samples, index
    places = model.frame.parameters_of(*samples.frame.xy_of(samples.parameters).T)
    inside = ((places >= -_SLACK) & (places <= 1 + _SLACK)).all(axis=1)
    if not inside.any():
        raise InputError("no sample lies on the model; check spacing, unit and origin of the data")
    grid = None if samples.grid_index is None else samples.grid_index[inside]
    kept = Samples(np.clip(places[inside], 0, 1), samples.values[inside], None, model.frame, samples.grid_shape, grid)
    return kept, index[inside]


def _unrolled(cloud: PointCloud, model: TSpline | None, parameters: Any) -> Samples:
    """Points in space over conformal or given parameters."""
    if isinstance(parameters, str):
        if parameters != "conformal":
            raise InputError(f"parameters are 'planar', 'conformal', (m, 2) or a Parameterisation; got {parameters!r}")
        parameters = conformal(cloud)
    frame = None if model is None else model.frame
    if isinstance(parameters, Parameterisation):
        frame, parameters = frame or parameters.frame, parameters.parameters
    return Samples(np.asarray(parameters), cloud.points, None, frame or cloud.frame)


def nearest(
    candidates: Float[np.ndarray, "c 2"], wanted: Float[np.ndarray, "m 2"], sides: ArrayLike
) -> Int[np.ndarray, " m"]:
    """A candidate for each wanted place, near it, and none twice.

    Each round gives every candidate to the closest of the places that want it; the others choose among what is left.

    **Raises:** `InputError` for more places than candidates.

    >>> nearest(np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([[0.6, 0.6], [0.9, 0.9]]), (1.0, 1.0)).tolist()
    [0, 1]
    """
    from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] -- compiled, without annotations

    if len(wanted) > len(candidates):
        raise InputError(
            f"{len(wanted)} samples are asked for, but only {len(candidates)} were measured; ask for fewer"
        )
    there, here = np.asarray(candidates) * sides, np.asarray(wanted) * sides
    chosen = np.full(len(here), -1)
    free, waiting = np.arange(len(there)), np.arange(len(here))
    while len(waiting):
        distance, found = cKDTree(there[free]).query(here[waiting])
        order = np.lexsort((distance, found))
        first = order[np.flatnonzero(np.diff(found[order], prepend=-1))]
        chosen[waiting[first]] = free[found[first]]
        free = np.delete(free, found[first])
        waiting = np.delete(waiting, first)
    return chosen
