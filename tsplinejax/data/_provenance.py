"""Provenance: a plain dictionary that says where data come from and what was done to them.

By convention `name` is the file's name, `sha256` the hash of its bytes, `operations` the list of what was done since,
in order, and `notes` what a reader should know ("no height scale").
"""

from collections.abc import Mapping
from typing import Any


def recorded(provenance: Mapping[str, Any], operation: str, unit: str | None = None) -> dict[str, Any]:
    """Return provenance with one more operation at the end of its list; the given one is left as it is.

    >>> recorded({"name": "a.npy"}, "crop 0,0,1,1", "mm")
    {'name': 'a.npy', 'operations': ['crop 0,0,1,1 mm']}
    """
    line = operation if unit is None else f"{operation} {unit}"
    return {**provenance, "operations": [*provenance.get("operations", ()), line]}
