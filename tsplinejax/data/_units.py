"""Units of length: their names, the factors between them, and lengths written as text.

One unit serves x, y and z alike. Factors are exact fractions of a metre, rounded once to a float, so a conversion
there and back costs no more than the rounding of the numbers themselves.
"""

import math
import re
from collections.abc import Mapping
from fractions import Fraction
from types import MappingProxyType

from .._errors import InputError

#: The length of each unit in metres, exactly, by its canonical symbol.
LENGTH_UNITS: Mapping[str, Fraction] = MappingProxyType(
    {
        "pm": Fraction(1, 10**12),
        "Å": Fraction(1, 10**10),
        "nm": Fraction(1, 10**9),
        "µm": Fraction(1, 10**6),
        "mm": Fraction(1, 10**3),
        "cm": Fraction(1, 10**2),
        "dm": Fraction(1, 10),
        "m": Fraction(1),
        "km": Fraction(10**3),
        "inch": Fraction(254, 10**4),
        "mil": Fraction(254, 10**7),
        "foot": Fraction(3048, 10**4),
    }
)

_MICRO_SIGN, _GREEK_MU = "\u00b5", "\u03bc"
_RING_A, _ANGSTROM_SIGN = "\u00c5", "\u212b"

_ALIASES: Mapping[str, str] = MappingProxyType(
    {
        "um": "µm",
        "micron": "µm",
        "microns": "µm",
        "micrometre": "µm",
        "micrometer": "µm",
        "A": "Å",
        "angstrom": "Å",
        "ångström": "Å",
        "picometre": "pm",
        "picometer": "pm",
        "nanometre": "nm",
        "nanometer": "nm",
        "millimetre": "mm",
        "millimeter": "mm",
        "centimetre": "cm",
        "centimeter": "cm",
        "metre": "m",
        "meter": "m",
        "metres": "m",
        "meters": "m",
        "kilometre": "km",
        "kilometer": "km",
        "in": "inch",
        "inches": "inch",
        '"': "inch",
        "ft": "foot",
        "feet": "foot",
        "thou": "mil",
    }
)

_LENGTH = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\D*?)\s*")


def canonical_unit(unit: str | None) -> str | None:
    """Return the one symbol by which the library calls a unit of length.

    **Arguments:**

    - `unit`: a symbol, an alias (`"um"`, Greek `"μm"`, `"micron"`, `"in"`, ...), or `None` for an unknown unit.

    **Raises:** `InputError` for anything that is not a unit of length.

    >>> canonical_unit("um")
    'µm'
    """
    if unit is None:
        return None
    if not isinstance(unit, str):
        raise InputError(f"a unit is text such as 'µm' or None, but got {type(unit).__name__} {unit!r}")
    name = unit.strip().replace(_GREEK_MU, _MICRO_SIGN).replace(_ANGSTROM_SIGN, _RING_A)
    for candidate in (name, _ALIASES.get(name), _ALIASES.get(name.lower())):
        if candidate in LENGTH_UNITS:
            return candidate
    raise InputError(f"{unit!r} is not a unit of length; use one of {', '.join(LENGTH_UNITS)}, or None if unknown")


def unit_factor(from_unit: str, to_unit: str) -> float:
    """Return the number by which a length in one unit is multiplied to have it in another.

    **Arguments:**

    - `from_unit`, `to_unit`: units of length, as symbols or aliases.

    **Raises:** `InputError` for an unknown unit or `None`.

    >>> unit_factor("mm", "um")
    1000.0
    """
    source, target = canonical_unit(from_unit), canonical_unit(to_unit)
    if source is None or target is None:
        raise InputError(f"converting needs both units, but got from {from_unit!r} to {to_unit!r}; state the data's")
    return float(LENGTH_UNITS[source] / LENGTH_UNITS[target])


def parse_length(length: float | str, unit: str | None) -> float:
    """Return a length in the data's unit.

    **Arguments:**

    - `length`: a number, already in the data's unit, or text such as `"5nm"`, `"0.8 um"`, `"1e-3mm"`, `"0.5"`.
    - `unit`: the data's unit, or `None` where it is unknown; then a length may not name one.

    **Raises:** `InputError` for text that is no length, a unit where the data have none, and NaN or infinity. The sign
    is left to the caller.

    >>> parse_length("800nm", "µm")
    0.8
    """
    if isinstance(length, str):
        return _parse_text(length, canonical_unit(unit))
    try:
        value = float(length)
    except (TypeError, ValueError) as error:
        raise InputError(f"a length is a number or text such as '5nm', but got {length!r}") from error
    if not math.isfinite(value):
        raise InputError(f"a length must be finite, but got {value}")
    return value


def _parse_text(text: str, unit: str | None) -> float:
    match = _LENGTH.fullmatch(text)
    if text.rstrip().endswith("%"):
        raise InputError(
            f"a length is a number with an optional unit such as '5nm', but got the share {text!r}; a share of the "
            "range is given as relative_tolerance=0.01 (--relative-tolerance 1%)"
        )
    if match is None:
        raise InputError(f"a length is a number with an optional unit such as '5nm' or '0.8um', but got {text!r}")
    number, suffix = float(match[1]), match[2]
    if not math.isfinite(number):
        raise InputError(f"a length must be finite, but got {text!r}")
    if not suffix:
        return number
    if unit is None:
        canonical_unit(suffix)
        raise InputError(
            f"the length {text!r} names a unit but the data have none; "
            "state the data's unit (unit=..., --unit) or give a bare number"
        )
    return float(Fraction(match[1]) * LENGTH_UNITS[canonical_unit(suffix) or unit] / LENGTH_UNITS[unit])
