"""The rows of docs/figures.md: every figure of the paper, what it reports, and the same from bench/results.

A row whose result is not there says so. Numbers are read, never written here, except those that the paper prints.
"""

from collections.abc import Callable, Sequence
from typing import Any

Rows = Callable[..., list[dict[str, Any]]]  # rows of a result: rows("fig5", method="tsplinejax")
NOT_RUN = "not run"


def figures(rows: Rows) -> list[dict[str, str]]:
    """A row for each figure."""
    return [
        {"figure": figure, "shows": shows, "the paper": paper, "tsplinejax": _told(ours, rows), "more": more}
        for figure, shows, paper, ours, more in _FIGURES
    ]


def _told(ours: Callable[[Rows], str], rows: Rows) -> str:
    try:
        return ours(rows)
    except (IndexError, KeyError):
        return NOT_RUN


def _one_model(rows: Rows) -> str:
    height, free = (rows("form_model", fitted=way)[0] for way in ("in height", "by orthogonal distance, free"))
    return (
        f"rms along normals {height['rms along normals']:.4f} fitted in height, {free['rms along normals']:.4f} by "
        f"orthogonal distance, {free['control points']} control points"
    )


def _disk(rows: Rows) -> str:
    row = rows("nurbs_error", surface="T6")[0]
    return (
        f"{row['tsplinejax']:,} against {row['best uniform NURBS']:,} on sparse bumps to {row['max error %']:g} % of "
        f"the range ({row['over uniform']:.2f})"
    )


def _fig5(rows: Rows) -> str:
    parts = []
    for surface in dict.fromkeys(row["surface"] for row in rows("fig5")):
        globally, ours = (
            next(row for row in rows("fig5", method=method, surface=surface) if row["tolerance %"] == 1)
            for method in ("paper global", "tsplinejax")
        )
        parts.append(
            f"{surface} to 1 %: {ours['seconds']:.2f} s ({ours['SNR dB']:.0f} dB) against {globally['seconds']:.1f} s "
            f"({globally['SNR dB']:.0f} dB)"
        )
    return "; ".join(parts)


def _saddle(rows: Rows) -> str:
    height, joint = (rows("orthogonal", method=method)[0] for method in ("height", "joint (default)"))
    return (
        f"Sq {height['Sq']:.3f} by height, {joint['Sq']:.4f} by orthogonal distance (truth 0.033, mean of 20 textures; "
        f"{joint['over lost part']:.3f} of the error that no method can avoid)"
    )


def _artefact(rows: Rows) -> str:
    row = rows("form_artefact")[0]
    return f"Sq {row['Sq']:.4f} mm, {row['Sq off %']:+.2f} % of the truth, correlation {row['correlation']:.3f}"


_FIGURES: Sequence[tuple[str, str, str, Callable[[Rows], str], str]] = (
    ("1 (a)", "one NURBS fitted in two ways", "remarkable error of the ordinary fit", _one_model, "[form](form.md)"),
    ("3", "control points of the disk", "4 900 against 14 400 (0.34)", _disk, "[benchmarks](benchmarks.md#nurbs)"),
    ("5", "time of a fit", "local in 1/2 to 1/4 of global", _fig5, "[benchmarks](benchmarks.md#fig5)"),
    ("6 (a-c)", "form of a saddle", "Sq 0.062 ordinary, 0.032 parametric", _saddle, "[form](form.md)"),
    ("6 (d, e)", "form of a milled artefact", "Sq 0.139 mm", _artefact, "[form](form.md)"),
)
