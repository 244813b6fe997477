"""All areal parameters of a map, or those that scattered samples have, as plain numbers with units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any

import jax
import numpy as np
from jaxtyping import ArrayLike, Float

from .._errors import InputError
from ..data import HeightMap, as_data, canonical_unit, checked_precision, parse_length
from ._functional import functional_parameters
from ._height import height_parameters
from ._hybrid import Stencil, hybrid_parameters
from ._spatial import spatial_parameters

_PERCENT = {"Sdr", "Smr1", "Smr2", "Smr"}
_PURE = {"Ssk", "Sku", "Sdq", "Str"}
_VOLUMES = {"Vmp", "Vmc", "Vvc", "Vvv"}


@dataclass(frozen=True, repr=False)
class ArealParameters:
    """Areal surface texture parameters (ISO 25178-2:2021) of one surface; NaN where one is not defined.

    **Attributes:** one number for each parameter, by its name in the standard, and

    - `units`: name → unit of the number, `"%"`, `"°"`, or `None` where it has none or the data's is unknown.
    - `notes`: the choices behind the numbers, and for each that is NaN the reason.

    Height: Sq, Sa, Sz, Sp, Sv, Ssk, Sku. Hybrid: Sdq, Sdr. Spatial: Sal, Str, Std. Functional: Sk, Spk, Svk, Smr1,
    Smr2, Smr, Smc. Volumes per area: Vmp, Vmc, Vvc, Vvv.
    """

    Sq: float
    Sa: float
    Sz: float
    Sp: float
    Sv: float
    Ssk: float
    Sku: float
    Sdq: float
    Sdr: float
    Sal: float
    Str: float
    Std: float
    Sk: float
    Spk: float
    Svk: float
    Smr1: float
    Smr2: float
    Smr: float
    Smc: float
    Vmp: float
    Vmc: float
    Vvc: float
    Vvv: float
    units: Mapping[str, str | None]
    notes: tuple[str, ...]

    @property
    def values(self) -> dict[str, float]:
        """Name → number, in the order of the standard's groups."""
        return {name: getattr(self, name) for name in _NAMES}

    def as_dict(self) -> dict[str, Any]:
        """The parameters by name, then `units` (a dictionary) and `notes` (a list)."""
        return {**self.values, "units": dict(self.units), "notes": list(self.notes)}

    def __repr__(self) -> str:
        """A line for each parameter with its unit, then the notes."""
        lines = [f"  {name:<4} = {value:.6g} {self.units[name] or ''}".rstrip() for name, value in self.values.items()]
        return "\n".join(["ArealParameters(", *lines, *(f"  # {note}" for note in self.notes), ")"])


_NAMES = tuple(field.name for field in fields(ArealParameters) if field.type is float)


def areal_parameters(
    data: HeightMap | Float[ArrayLike, "rows columns"] | Float[ArrayLike, " m"],
    *,
    spacing: float | Sequence[float] | None = None,
    unit: str | None = None,
    weights: Float[ArrayLike, "rows columns"] | Float[ArrayLike, " m"] | None = None,
    stencil: Stencil = "differences",
    threshold: float = 0.2,
    cut_height: float | str = 0.0,
    material_ratio: float = 10.0,
    volume_ratios: tuple[float, float] = (10.0, 80.0),
    include_filled: bool = False,
    dtype: Any = None,
) -> ArealParameters:
    """Areal surface texture parameters of a map, with what is missing left out (ISO 25178-2:2021).

    Nothing is levelled, filtered or filled: remove form and waviness first. The weighted mean of the samples that are
    present is removed.

    **Arguments:**

    - `data`: a height map: a `HeightMap`, a 2-D array or `(heights, dx, dy)`, NaN where missing. Or scattered samples
      of a texture, (m,): they have height and functional parameters only.
    - `spacing`: (dx, dy) or one number, in the data's unit, in place of the data's own.
    - `unit`: the unit of lengths and heights alike, for data that do not state theirs.
    - `weights`: of the shape of the heights, not negative: the area that each sample stands for, as for texture on a
      curved form.
    - `stencil`: `"differences"` or `"seven-point"`, for Sdq and Sdr (see `hybrid_parameters`).
    - `threshold`: s, to which the autocorrelation falls in Sal and Str.
    - `cut_height`: height above the mean at which Smr is taken; text such as `"5nm"` is converted.
    - `material_ratio`: ratio in % at which Smc is taken, a height above the mean.
    - `volume_ratios`: the ratios in % that bound the core in Vmp, Vmc, Vvc, Vvv.
    - `include_filled`: whether heights count that were not measured but filled in (`HeightMap.filled`).
    - `dtype`: `"float32"` accepts single precision knowingly. By default double precision where JAX's 64-bit mode
      is on; without it float64 data are refused.

    **Returns:** `ArealParameters`.

    **Raises:** `InputError` for a map of unknown spacing (without unit, with spacing 1 and no `spacing=`), for point
    clouds, for data without a single height, and for options out of range.

    >>> heights = np.sin(np.arange(400) / 20) * np.ones((300, 1))
    >>> parameters = areal_parameters(HeightMap(heights, (0.5, 0.5), "µm"))
    >>> round(parameters.Sq, 2), parameters.units["Sq"], round(parameters.Ssk, 2), parameters.units["Sdr"]
    (0.7, 'µm', -0.08, '%')
    """
    heights, steps, unit = _resolved(data, spacing, unit, include_filled)
    precision = _precision(heights.dtype, dtype)
    heights = heights.astype(precision)
    if np.isnan(heights).all():
        raise InputError(f"every one of the {heights.size} heights is missing (NaN): there is nothing to characterise")
    shares = None if weights is None else np.asarray(weights, precision)
    cut = parse_length(cut_height, unit)
    groups: list[Any] = [height_parameters(heights, shares)]
    if steps is not None:
        groups += [
            hybrid_parameters(heights, steps, shares, stencil=stencil),
            spatial_parameters(heights, steps, shares, threshold=threshold),
        ]
    groups.append(
        functional_parameters(
            *_falling(heights, shares),
            cut_height=cut,
            material_ratio=material_ratio,
            volume_ratios=volume_ratios,
            ordered=True,
        )
    )
    found = {name: float(value) for group in groups for name, value in group._asdict().items()}
    values = {name: found.get(name, float("nan")) for name in _NAMES}
    choices = [
        f"Smr at {cut:g}{f' {unit}' if unit else ''} above the mean, Smc at {material_ratio:g} %, "
        f"volumes at {volume_ratios[0]:g} and {volume_ratios[1]:g} %"
    ]
    if steps is not None:
        choices.append(f"Sdq and Sdr by the stencil {stencil!r}; Sal and Str not circular, s = {threshold:g}")
    units = MappingProxyType({name: _unit_of(name, unit) for name in _NAMES})
    notes = (*choices, *_reasons(values, np.shape(heights), threshold))
    return ArealParameters(**values, units=units, notes=notes)


def _resolved(
    data: Any, spacing: float | Sequence[float] | None, unit: str | None, include_filled: bool
) -> tuple[np.ndarray, tuple[float, float] | None, str | None]:
    """Heights, spacing (none for scattered samples) and unit."""
    unit = canonical_unit(unit)
    if not isinstance(data, HeightMap | tuple) and np.ndim(data) == 1:
        if spacing is not None:
            raise InputError("scattered samples, (m,), have no spacing; give a map as a 2-D array")
        return HeightMap(np.atleast_2d(data)).heights[0], None, unit
    surface = as_data(data)
    if not isinstance(surface, HeightMap):
        raise InputError(
            "areal parameters are those of a height map or of the heights of a texture, (m,), but got a point cloud; "
            "remove its form first, or wrap a map of three columns in HeightMap"
        )
    if unit is not None and surface.unit not in (None, unit):
        raise InputError(f"the data are in {surface.unit}, but unit= says {unit}; convert them with .to_unit({unit!r})")
    unit = unit or surface.unit
    known = unit is not None or spacing is not None or surface.spacing != (1.0, 1.0) or isinstance(data, tuple)
    if not known:
        raise InputError(
            "Sdq, Sdr, Sal and volumes need the spacing of the pixels in the unit of the heights, but this map states "
            "neither spacing nor unit; give spacing=(dx, dy) (--spacing) or unit= (--unit)"
        )
    steps = surface.spacing if spacing is None else HeightMap([[0.0]], spacing).spacing
    return surface.heights if include_filled else np.where(surface.measured, surface.heights, np.nan), steps, unit


def _falling(heights: np.ndarray, shares: np.ndarray | None) -> tuple[np.ndarray, np.ndarray | None]:
    """Heights and weights, highest first, what is missing last: numpy sorts several times as fast as JAX does."""
    if shares is None:
        return -np.sort(-heights, axis=None), None
    order = np.argsort(np.where(shares > 0, -heights, np.nan), axis=None)
    return heights.ravel()[order], shares.ravel()[order]


def _precision(stored: np.dtype, dtype: Any) -> np.dtype:
    """What is asked for; else double precision where it is to be had."""
    double = bool(jax.config.read("jax_enable_x64"))
    default = np.float64 if double else stored
    return checked_precision(default if dtype is None else dtype, double=double)


def _unit_of(name: str, unit: str | None) -> str | None:
    if name in _PERCENT:
        return "%"
    if name == "Std":
        return "°"
    if name in _PURE or unit is None:
        return None
    return f"{unit}³/{unit}²" if name in _VOLUMES else unit


def _reasons(values: dict[str, float], shape: tuple[int, ...], threshold: float) -> list[str]:
    """Why each parameter that is NaN is so."""
    missing = {name for name, value in values.items() if np.isnan(value)}
    if len(shape) == 1:
        return ["Sdq, Sdr, Sal, Str and Std: NaN, scattered samples have no neighbours; give a map"]
    if values["Sq"] == 0:
        return [f"{', '.join(name for name in _NAMES if name in missing)}: NaN, all heights are equal"]
    reasons = {
        "Sdq": "no stencil is complete: the map is too narrow, or too much is missing",
        "Sdr": "no stencil is complete: the map is too narrow, or too much is missing",
        "Sal": f"the autocorrelation does not fall to {threshold:g} within half the map, or too few pairs are present",
        "Str": f"the autocorrelation does not fall to {threshold:g} within half the map in every direction",
        "Std": "the map has no direction",
    }
    return [f"{name}: NaN, {reason}" for name, reason in reasons.items() if name in missing]
