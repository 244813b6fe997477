"""Reading measured surfaces: the format follows from the suffix, options add what the file does not say."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from .._errors import InputError
from ..data import HeightMap, PointCloud, canonical_unit, parse_length
from ._arrays import load_npy, read_npy, read_npz
from ._dem import read_dem
from ._files import existing_file, reading, sha256_of
from ._images import load_image, read_image
from ._instrument import FORMATS, read_instrument
from ._meshes import read_mesh
from ._pcd import read_pcd
from ._raw import RawCloud, RawMap
from ._regular_grid import sparse_grid
from ._text import read_table, read_xyz

_READERS: dict[str, Callable[[Path], RawMap | RawCloud]] = {
    ".npy": read_npy,
    ".npz": read_npz,
    ".csv": read_table,
    ".txt": read_table,
    ".xyz": read_xyz,
    ".png": read_image,
    ".tif": read_image,
    ".tiff": read_image,
    ".dem": read_dem,
    ".ply": read_mesh,
    ".stl": read_mesh,
    ".obj": read_mesh,
    ".pcd": read_pcd,
    **dict.fromkeys(FORMATS, read_instrument),
}

#: Every suffix that `read` understands.
READABLE: tuple[str, ...] = tuple(_READERS)


def read(
    path: str | os.PathLike,
    *,
    as_: Literal["map", "cloud"] | None = None,
    spacing: float | str | Sequence[float | str] | None = None,
    unit: str | None = None,
    height_unit: str | None = None,
    mask: str | os.PathLike | ArrayLike | None = None,
    crop: str | Sequence[float | str] | None = None,
) -> HeightMap | PointCloud:
    """Read a measured surface from a file: a height map or a point cloud.

    A table of points that fills a regular grid is a height map. What a file states is kept; the options say what
    it does not. They are applied in this order: units, mask, crop.

    **Arguments:**

    - `path`: the file; its suffix names the format.
    - `as_`: `"map"` or `"cloud"` overrides what the file would be read as. As a map, points may leave pixels out.
    - `spacing`: pixel spacing dx or (dx, dy), as numbers in `unit` or as text such as `"0.5um"`, for files that state
      none, or in place of the stated one.
    - `unit`: the unit of a file that states none; a file that states its unit is converted to this one.
    - `height_unit`: the unit of the heights, if the file states no unit and it differs from `unit`.
    - `mask`: array or file (`.npy`, `.png`, `.tif`, `.csv`, `.txt`) of the map's shape; non-zero marks missing pixels.
    - `crop`: (x0, y0, x1, y1), or text `"X0,Y0,X1,Y1"`, in the resulting unit.

    **Returns:** the data, with the file's name and SHA-256 and all operations in `provenance`.

    **Raises:** `InputError` for a file that is missing, truncated, corrupted or of unknown suffix, and for options that
    do not fit it; `MissingExtraError` when its format needs an optional package.

    >>> from tsplinejax.data import peaks
    >>> from tsplinejax.io import write
    >>> folder = getfixture("tmp_path")
    >>> read(write(folder / "peaks.npz", peaks((4, 5)))).shape
    (4, 5)
    """
    file = existing_file(path)
    reader = _READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError(f"{file.name}: the suffix {file.suffix!r} is not known; readable are {' '.join(READABLE)}")
    if as_ not in (None, "map", "cloud"):
        raise InputError(f"data are read as 'map' or 'cloud' (or None, as the file is), but got {as_!r}")
    with reading(file):
        raw = reader(file)
        if as_ == "map" and isinstance(raw, RawCloud):
            raw = _as_map(raw)
        provenance = {"name": file.name, "sha256": sha256_of(file), "operations": []}
        if isinstance(raw, RawMap):
            data = _height_map(raw, spacing, canonical_unit(unit), canonical_unit(height_unit), provenance)
            data = data if mask is None else data.with_mask(_mask(mask))
            data = _as_cloud(data) if as_ == "cloud" else data
        else:
            _refuse_map_options(spacing=spacing, height_unit=height_unit, mask=mask)
            data = _point_cloud(raw, canonical_unit(unit), provenance)
        return data if crop is None else data.crop(*_corners(crop))


def _height_map(raw: RawMap, spacing, unit: str | None, height_unit: str | None, provenance: dict) -> HeightMap:
    own_unit = canonical_unit(raw.unit)
    if own_unit is not None and height_unit is not None:
        raise InputError(f"it states its unit, {own_unit}, so height_unit (--height-unit) cannot be given; use unit")
    if own_unit is not None and raw.spacing is None and spacing is None:
        raise InputError("it states a unit but no pixel spacing; give it with spacing= (--spacing)")
    steps, origin = raw.spacing or (1.0, 1.0), raw.origin
    notes = [note for note in raw.notes if not (height_unit or unit) or not note.startswith("no height scale")]
    provenance = {**provenance, **({"notes": notes} if notes else {})}
    height_map = HeightMap(
        raw.heights,
        steps,
        own_unit or unit,
        height_unit,
        origin=origin,
        provenance=provenance,
        filled=raw.filled,
    )
    if own_unit is not None and unit is not None and unit != own_unit:
        height_map = height_map.to_unit(unit)
    if spacing is None:
        return height_map
    return _respaced(height_map, spacing, stated=raw.spacing is not None)


def _respaced(height_map: HeightMap, spacing, *, stated: bool) -> HeightMap:
    steps = parse_spacing(spacing, height_map.unit)
    operations = height_map.provenance["operations"]
    if stated:
        operations = [*operations, f"spacing {steps[0]:g},{steps[1]:g} in place of the file's"]
    return HeightMap(
        height_map.heights,
        steps,
        height_map.unit,
        provenance={**height_map.provenance, "operations": operations},
        filled=height_map.filled,
    )


def parse_spacing(spacing: float | str | Sequence[float | str], unit: str | None) -> tuple[float, float]:
    """Pixel spacing (dx, dy) from one or two lengths.

    >>> parse_spacing("0.5um,250nm", "µm")
    (0.5, 0.25)
    """
    if isinstance(spacing, str):
        parts: Sequence[float | str] = spacing.split(",")
    else:
        parts = spacing if isinstance(spacing, Sequence | np.ndarray) else [spacing]
    steps = [parse_length(part, unit) for part in parts]
    if len(steps) not in (1, 2):
        raise InputError(f"a spacing is DX or DX,DY, but got {spacing!r}")
    return steps[0], steps[-1]


def _point_cloud(raw: RawCloud, unit: str | None, provenance: dict) -> PointCloud:
    provenance = {**provenance, **({"notes": list(raw.notes)} if raw.notes else {})}
    cloud = PointCloud(raw.points, raw.unit or unit, triangles=raw.triangles, provenance=provenance)
    return cloud.to_unit(unit) if unit is not None and cloud.unit != unit else cloud


def _as_map(raw: RawCloud) -> RawMap:
    grid = sparse_grid(np.asarray(raw.points, dtype=np.float64))
    return RawMap(grid.heights, grid.spacing, raw.unit, grid.origin, raw.notes)


def _as_cloud(height_map: HeightMap) -> PointCloud:
    samples = height_map.samples()
    points = np.concatenate([samples.frame.xy_of(samples.parameters), samples.values], axis=1)
    return PointCloud(points, height_map.unit, provenance=height_map.provenance)


def _refuse_map_options(**options) -> None:
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise InputError(
            f"it is a point cloud, but {', '.join(given)} is for height maps; leave it out or read as a map"
        )


def _mask(mask) -> np.ndarray:
    if not isinstance(mask, str | os.PathLike):
        return np.asarray(mask)
    file = existing_file(mask)
    suffix = file.suffix.lower()
    with reading(file):
        if suffix == ".npy":
            return load_npy(file)
        if suffix in (".png", ".tif", ".tiff"):
            return load_image(file)
        if suffix in (".csv", ".txt"):
            table = read_table(file)
            return table.heights if isinstance(table, RawMap) else table.points
        raise InputError("a mask is read from .npy, .png, .tif, .tiff, .csv or .txt")


def _corners(crop: str | Sequence[float | str]) -> Sequence[float | str]:
    corners = crop.split(",") if isinstance(crop, str) else list(crop)
    if len(corners) != 4:
        raise InputError(f"a crop is X0,Y0,X1,Y1, but got {crop!r}")
    return corners
