"""Opening large maps without reading them: `.npy` files are mapped into memory, zarr arrays opened."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .._errors import InputError, require
from ..data import StoredMap, canonical_unit
from ._files import existing_file, reading, sha256_of
from ._read import parse_spacing

#: Every suffix that `open_stored` understands.
OPENABLE: tuple[str, ...] = (".npy", ".zarr")


def open_stored(
    path: str | os.PathLike,
    *,
    spacing: float | str | Sequence[float | str] | None = None,
    unit: str | None = None,
) -> StoredMap:
    """Open a height map that stays on disk, to be fitted page by page.

    **Arguments:**

    - `path`: a `.npy` file, or a `.zarr` folder with one array (extra `large`); heights in rows and columns.
    - `spacing`: pixel spacing dx or (dx, dy), as numbers in `unit` or as text such as `"0.5um"`; 1 by default.
    - `unit`: the unit of x, y and z.

    **Returns:** the map, with the name (and of a file its SHA-256) in `provenance`.

    **Raises:** `InputError` for what is missing, truncated, of another suffix, or no height map; `MissingExtraError`
    where zarr is not installed.

    >>> folder = getfixture("tmp_path")
    >>> np.save(folder / "map.npy", np.zeros((400, 300), np.float32))
    >>> open_stored(folder / "map.npy", spacing="0.5um", unit="µm")
    StoredMap(400 rows × 300 columns, spacing=(0.5, 0.5) µm, float32)
    """
    file = Path(path)
    suffix = file.suffix.lower()
    if suffix not in OPENABLE:
        raise InputError(
            f"{file.name}: only {' and '.join(OPENABLE)} are opened without reading them; write the heights into one "
            "of these first (tsplinejax convert), or read the file into memory"
        )
    provenance: dict[str, Any] = {"name": file.name, "operations": []}
    if suffix == ".npy":
        file = existing_file(file)
        provenance["sha256"] = sha256_of(file)
    elif not file.is_dir():
        raise InputError(f"{file} is no folder; a zarr array is a folder: check the path")
    with reading(file):
        heights = np.load(file, mmap_mode="r") if suffix == ".npy" else _zarr_array(file)
        if len(heights.shape) == 2 and heights.shape[1] == 3:
            raise InputError(
                "three columns are points, which are fitted in memory; use tsplinejax.read (no --max-memory)"
            )
        steps = (1.0, 1.0) if spacing is None else parse_spacing(spacing, canonical_unit(unit))
        return StoredMap(heights, steps, unit, provenance=provenance)


def _zarr_array(folder: Path) -> Any:
    """The array of a folder, to read."""
    return require("zarr", "large").open_array(str(folder), mode="r")
