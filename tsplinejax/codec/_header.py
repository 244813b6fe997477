"""The header of a model file: everything but the numbers, written as a JSON object and checked when read."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._errors import InputError
from .._version import __version__
from ..data import Frame
from ..fitting import FitResult
from ..mesh import TMesh
from ..surface import TSpline
from ._entries import choice, counts, entry, pair
from ._plain import plain

FORMAT, VERSION = "tsplinejax model", 1
_FIT_FIGURES = (
    "converged",
    "tolerance",
    "noise",
    "max_error",
    "rms_error",
    "snr_db",
    "snr_db_centred",
    "range",
    "smoothing",
)


@dataclass(frozen=True)
class ModelHeader:
    """What a model file says about its model; everything but the numbers.

    **Attributes:**

    - `kind`: `"heights"` or `"points"` (a surface in space).
    - `frame`: place and unit of the parameter square.
    - `lattice`: start lattice (M, N), or `None` for a mesh given by hand; `first_cut`: `"s"` or `"t"`, or `None`.
    - `border`: `"clamped"` or `"open"`; `rational`: whether Eq. 2's division is needed.
    - `elements`, `control_points`: size of the T-mesh; `dtype`: `"float32"` or `"float64"`.
    - `software`: what wrote the file.
    - `fit`: the figures of the fit it comes from (`stop`, `max_error`, `tolerance`, ...); empty without a fit.
    - `provenance`: input, options and operations of the fit.
    """

    kind: str
    frame: Frame
    lattice: tuple[int, int] | None
    first_cut: str | None
    border: str
    rational: bool
    elements: int
    control_points: int
    dtype: str
    software: str
    fit: dict[str, Any]
    provenance: dict[str, Any]


def header_of(surface: TSpline, tmesh: TMesh, model: TSpline | FitResult) -> dict[str, Any]:
    """The header as JSON has it."""
    frame = surface.frame
    fit, provenance = {}, {}
    if isinstance(model, FitResult):
        fit = {"stop": str(model.stop), **{name: getattr(model, name) for name in _FIT_FIGURES}}
        kept = model.at_samples
        fit["outliers"] = 0 if kept is None else int(np.count_nonzero(kept.outliers))
        provenance = dict(model.provenance)
    return {
        "format": FORMAT,
        "version": VERSION,
        "software": f"tsplinejax {__version__}",
        "kind": "heights" if surface.is_height_map else "points",
        "dtype": str(surface.space.dtype),
        "unit": frame.unit,
        "origin": list(frame.origin),
        "extent": list(frame.extent),
        "lattice": None if tmesh.forest is None else list(tmesh.forest.lattice),
        "first_cut": None if tmesh.forest is None else tmesh.forest.first_cut,
        "border": tmesh.border,
        "rational": surface.space.rational,
        "elements": tmesh.n_elements,
        "control_points": tmesh.n_anchors,
        "fit": plain(fit),
        "provenance": plain(provenance),
    }


def parse_header(header: dict[str, Any]) -> ModelHeader:
    """The header after checking every entry."""
    if header.get("format") != FORMAT:
        raise InputError(f"its header does not say {FORMAT!r}; it is no model file")
    version = entry(header, "version", int)
    if version > VERSION:
        raise InputError(
            f"it is of version {version} of the model file, and tsplinejax {__version__} reads up to {VERSION}; "
            "update tsplinejax"
        )
    lattice = header.get("lattice")
    return ModelHeader(
        kind=choice(header, "kind", ("heights", "points")),
        frame=Frame(pair(header, "origin"), pair(header, "extent"), header.get("unit")),
        lattice=None if lattice is None else counts(header, "lattice"),
        first_cut=None if lattice is None else choice(header, "first_cut", ("s", "t")),
        border=choice(header, "border", ("clamped", "open")),
        rational=entry(header, "rational", bool),
        elements=entry(header, "elements", int),
        control_points=entry(header, "control_points", int),
        dtype=choice(header, "dtype", ("float32", "float64")),
        software=entry(header, "software", str),
        fit=entry(header, "fit", dict),
        provenance=entry(header, "provenance", dict),
    )
