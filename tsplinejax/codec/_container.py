"""Model files (`.tspl`): what rebuilds a T-spline, and where it comes from.

The arrays are the element boxes in index coordinates (int32), the control points in the order of the mesh's anchors,
and for a mesh given by hand its knot lines; the header says the rest. Blending functions are not stored: rule one makes
them again. Files are not trusted: sizes, shapes, checksums and numbers are checked before a mesh is built of them.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from .._errors import InputError
from ..fitting import FitResult
from ..io._files import check_count, existing_file, reading, written_whole
from ..mesh import TMesh, forest_from_boxes, from_rectangles
from ..space import bezier_elements, spline_space
from ..surface import TSpline, make_surface
from ._archive import read_archive, read_header, write_archive
from ._decompress import NO_MODEL, compressed_header, decode_model, is_compressed
from ._header import ModelHeader, header_of, parse_header
from ._model import surface_of_model

MODEL_SUFFIX = ".tspl"

#: A mesh of n elements has at most this many functions on Bézier elements, plus so many for each element. Refinement
#: keeps far below; a mesh of very different neighbours could ask for any memory.
_FREE_ENTRIES, _ENTRIES_PER_ELEMENT = 1 << 19, 1 << 10


def save(path: str | os.PathLike, model: TSpline | FitResult) -> Path:
    """Write a model file; the file appears whole or not at all, and equal models give equal bytes.

    **Arguments:**

    - `path`: the file, with the suffix `.tspl`. An existing file is replaced.
    - `model`: a `TSpline`, or a `FitResult`, whose figures and provenance are then kept, too.

    **Returns:** the path.

    **Raises:** `InputError` for another suffix, a missing folder, control points that are not finite, or anything that
    is not a model; then nothing is written.

    >>> from tsplinejax import b_lattice, make_surface, spline_space
    >>> flat = make_surface(spline_space(b_lattice(4, 2)), [1.0] * 35)
    >>> load(save(getfixture("tmp_path") / "flat.tspl", flat)).control_points.shape
    (35,)
    """
    target = checked_target(path)
    surface = model.surface if isinstance(model, FitResult) else model
    if not isinstance(surface, TSpline):
        raise InputError(f"a model file holds a TSpline or a FitResult, but got {type(model).__name__}")
    points = np.asarray(surface.control_points)
    if not np.isfinite(points).all():
        raise InputError("a model file holds finite control points, but these have NaN or infinity; fit again")
    tmesh = surface.space.mesh
    tables = surface.space.tables
    entries, most = int(surface.space.n_elements) * tables.functions.shape[1], _most_entries(tmesh.n_elements)
    if entries > most:
        raise InputError(
            f"a model file is for meshes with at most {most} functions on Bézier elements, but this one has {entries}; "
            "refine with AnalysisSuitable()"
        )
    arrays = {"boxes": tmesh.boxes.astype(np.int32), "control_points": points}
    if tmesh.lines is not None:
        arrays |= {"lines_s": tmesh.lines[0], "lines_t": tmesh.lines[1]}
    with written_whole(target) as stream:
        write_archive(stream, header_of(surface, tmesh, model), arrays)
    return target


def load(path: str | os.PathLike, *, dtype: DTypeLike | None = None) -> TSpline:
    """Read a model file, or the T-spline of a compressed height map.

    **Arguments:**

    - `path`: the file.
    - `dtype`: `"float32"` or `"float64"` to read the model in that precision; by default the one it was saved in.

    **Returns:** the surface that was saved, with the same values to the last bit where the precision is the same; of a
    compressed map the T-spline with rounded control points, without the corrections of single pixels.

    **Raises:** `InputError` for a file that is missing, no model, truncated, corrupted or of a later version, and for a
    float64 model where JAX's x64 mode is off.

    >>> from tsplinejax import b_lattice, make_surface, spline_space
    >>> flat = make_surface(spline_space(b_lattice(4, 2)), [1.0] * 35)
    >>> load(save(getfixture("tmp_path") / "flat.tspl", flat), dtype="float32")
    TSpline(35 control points, heights, unit None, polynomial, float32)
    """
    file = existing_file(path)
    with reading(file):
        if is_compressed(file):
            return _load_compressed(file, dtype)
        header = parse_header(read_header(file))
        lines = {} if header.lattice else {"lines_s": "float64", "lines_t": "float64"}
        _, arrays = read_archive(file, {"boxes": "int32", "control_points": header.dtype, **lines})
        _check_shapes(header, arrays, set(lines))
        tmesh = _mesh(header, arrays)
        if tmesh.n_anchors != header.control_points:
            raise InputError(
                f"its mesh has {tmesh.n_anchors} anchors, but there are {header.control_points} control points"
            )
        elements = bezier_elements(tmesh, most=_most_entries(tmesh.n_elements))
        kind = header.dtype if dtype is None else dtype
        space = spline_space(tmesh, dtype=kind, rational=header.rational, elements=elements)
        return make_surface(space, arrays["control_points"], header.frame)


def load_header(path: str | os.PathLike) -> ModelHeader:
    """Read what a model file says about its model, without building it.

    **Raises:** `InputError` as for [`load`][tsplinejax.load].

    >>> from tsplinejax import b_lattice, make_surface, spline_space
    >>> flat = make_surface(spline_space(b_lattice(4, 2)), [1.0] * 35)
    >>> load_header(save(getfixture("tmp_path") / "flat.tspl", flat)).lattice
    (4, 2)
    """
    file = existing_file(path)
    with reading(file):
        if is_compressed(file):
            return _header_of_compressed(file)
        return parse_header(read_header(file))


def _load_compressed(file: Path, dtype: DTypeLike | None) -> TSpline:
    """The T-spline of a compressed map."""
    header, model = decode_model(file.read_bytes())
    return surface_of_model(header, model, header.dtype if dtype is None else dtype)


def _header_of_compressed(file: Path) -> ModelHeader:
    """What a compressed map says about its T-spline."""
    header = compressed_header(file)
    if header.model is None:
        raise InputError(NO_MODEL)
    return ModelHeader(
        kind="heights",
        frame=header.frame,
        lattice=header.model.lattice,
        first_cut=header.model.first_cut,
        border="clamped",
        rational=False,
        elements=header.model.elements,
        control_points=header.model.control_points,
        dtype=header.dtype,
        software=header.software,
        fit={"tolerance": header.tolerance, "max_error": header.max_error},
        provenance=header.provenance,
    )


def checked_target(path: str | os.PathLike) -> Path:
    """The path to save a model at: with the right suffix, in a folder that exists."""
    target = Path(path)
    if target.suffix.lower() != MODEL_SUFFIX:
        raise InputError(
            f"a model file ends in {MODEL_SUFFIX}, but got {target.name!r}; try {target.stem}{MODEL_SUFFIX}"
        )
    if not target.parent.is_dir():
        raise InputError(f"the output folder {target.parent} does not exist; create it first")
    return target


def _most_entries(elements: int) -> int:
    """How many entries the table of functions of a mesh of so many elements may have."""
    return _FREE_ENTRIES + _ENTRIES_PER_ELEMENT * elements


def _check_shapes(header: ModelHeader, arrays: dict[str, np.ndarray], lines: set[str]) -> None:
    """Arrays complete, of the sizes that the header declares, and finite."""
    missing = {"boxes", "control_points"} | lines
    missing -= set(arrays)
    if missing:
        raise InputError(f"it holds no array {sorted(missing)[0]!r}; it was damaged: copy it again")
    check_count(header.elements, "elements")
    shapes = {
        "boxes": (header.elements, 4),
        "control_points": (header.control_points,) if header.kind == "heights" else (header.control_points, 3),
    }
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise InputError(f"its array {name!r} has the shape {arrays[name].shape}, but its header says {shape}")
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            raise InputError(f"its array {name!r} holds NaN or infinity; fit and save the model again")


def _mesh(header: ModelHeader, arrays: dict[str, np.ndarray]) -> TMesh:
    """The T-mesh of the element boxes."""
    boxes = arrays["boxes"].astype(np.int64)
    border: Any = header.border
    if header.lattice is not None:
        first_cut: Any = header.first_cut
        tmesh = forest_from_boxes(boxes, header.lattice, first_cut=first_cut, border=border)
    else:
        lines = [arrays["lines_s"], arrays["lines_t"]]
        _check_lines(boxes, lines)
        corners = [lines[k % 2][boxes[:, k]] for k in range(4)]
        tmesh = from_rectangles(np.stack(corners, axis=1), border=border)
    if not np.array_equal(tmesh.boxes, boxes):
        raise InputError("its elements are not in the order in which they are saved; it was damaged: copy it again")
    return tmesh


def _check_lines(boxes: np.ndarray, lines: list[np.ndarray]) -> None:
    """Knot lines that rise from 0 to 1, named by the boxes, and few enough for a table of index cells."""
    for knots in lines:
        if knots.ndim != 1 or len(knots) < 2 or (np.diff(knots) <= 0).any() or (knots[0], knots[-1]) != (0.0, 1.0):
            raise InputError("its knot lines do not rise from 0 to 1; it was damaged: copy it again")
    cells, most = (len(lines[0]) - 1) * (len(lines[1]) - 1), _most_entries(len(boxes))
    if 16 * cells > most:
        raise InputError(f"its mesh has {cells} index cells, more than the {most // 16} that are read")
    counts = [len(lines[k % 2]) for k in range(4)]
    if (boxes < 0).any() or (boxes >= counts).any():
        raise InputError("its elements lie outside its knot lines; it was damaged: copy it again")
