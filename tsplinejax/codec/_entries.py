"""Entries of the headers of files, each checked before it is used: what a file says is not trusted."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._errors import InputError

#: Bytes of a header at most: as JSON in memory it takes some forty times as many.
LONGEST_HEADER = 1 << 20

#: Characters of a wrong entry that a message quotes.
_QUOTED = 80


def entry(entries: Mapping[str, Any], name: str, kind: type) -> Any:
    """An entry of a type; true and false are no numbers."""
    value = entries.get(name)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise _wrong(name, value, f"{kind.__name__} is")
    return value


def choice(entries: Mapping[str, Any], name: str, choices: tuple[str, ...]) -> Any:
    """One of several words."""
    value = entries.get(name)
    if not isinstance(value, str) or value not in choices:
        raise _wrong(name, value, f"one of {', '.join(choices)} is")
    return value


def number(entries: Mapping[str, Any], name: str, *, least: float = -math.inf) -> float:
    """A finite number."""
    return _finite(name, entries.get(name), least)


def pair(entries: Mapping[str, Any], name: str) -> tuple[float, float]:
    """Two finite numbers."""
    values = entry(entries, name, list)
    if len(values) != 2:
        raise _wrong(name, values, "a pair of numbers is")
    return _finite(name, values[0]), _finite(name, values[1])


def counts(entries: Mapping[str, Any], name: str) -> tuple[int, int]:
    """Two counts."""
    values = entry(entries, name, list)
    if len(values) != 2 or not all(type(value) is int and 0 < value <= 1 << 30 for value in values):
        raise _wrong(name, values, "two counts are")
    return values[0], values[1]


def _finite(name: str, value: Any, least: float = -math.inf) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= np.finfo(float).max:
        raise _wrong(name, value, "a number is")
    if value < least:
        raise _wrong(name, value, f"at least {least} is")
    return float(value)


def _wrong(name: str, value: Any, expected: str) -> InputError:
    text = repr(value)
    quoted = text if len(text) <= _QUOTED else text[:_QUOTED] + " ..."
    return InputError(f"its header's entry {name!r} is {quoted}, where {expected} expected")
