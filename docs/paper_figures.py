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


def _steps(rows: Rows) -> str:
    found = rows("filtration", filter="T-spline")
    gaussian = rows("filtration", filter="Gaussian")
    ratio = max(
        row["width"] / wide["width"]
        for row in found
        for wide in gaussian
        if (wide["step"], wide["tolerance"]) == (row["step"], row["tolerance"])
    )
    near, over = (max(row[name] for row in found) for name in ("near / far", "overshoot %"))
    return (
        f"edges at most {ratio:.2f} times as wide as the Gaussian's at equal noise, overshoot at most {over:.2f} %, "
        f"residual Sq near the edge {near:.2f} times that far from it (all steps and tolerances)"
    )


def _bands(rows: Rows) -> str:
    row = rows("multiresolution", surface="Peaks", meshes="adaptive")[0]
    return (
        f"{row['bands']} nested bands that add up to {row['sum off / range']:.0e} of the range; "
        f"|Sq² - Σ Sq²| {row['leak']:.0e} of Sq²"
    )


def _holes(rows: Rows) -> str:
    row = rows("filling_pillars", holes="edges")[0]
    names = ("biharmonic", "linear", "thin plate, 50 neighbours", "multilevel B-splines")
    peers = ", ".join(f"{name} {row[name]:.3f}" for name in names)
    return (
        f"rms in the holes {row['ours']:.3f} of the range ({peers}), {row['missing %']:.0f} % missing, overshoot "
        f"{row['overshoot %']:.0f} %"
    )


def _face(rows: Rows) -> str:
    ratios = [row["adaptive / random"] for row in rows("sampling_face")]
    return f"a face from 1 000 of its points: {min(ratios):.2f} to {max(ratios):.2f} of the error of 1 000 random ones"


def _samples(rows: Rows) -> str:
    ratios = {row["samples / control point"]: [] for row in rows("sampling", truth="surface")}
    for row in rows("sampling", truth="surface"):
        ratios[row["samples / control point"]].append(row["ours / usual"])
    told = ", ".join(f"{max(found):.2f} at {size:g}" for size, found in ratios.items())
    exact = max(row["largest error / range"] for row in rows("sampling_exact"))
    return (
        f"error over that of the best usual sampling (largest of the surfaces): {told} samples a control point; a "
        f"model is recovered to {exact:.0e} of the range from as many samples as control points"
    )


def _bytes(rows: Rows) -> str:
    parts = []
    for name in ("T1", "T2"):
        row = next(row for row in rows("compression", map=name) if row["bound %"] == 1)
        parts.append(f"{name} to 1 %: {row['bytes']:,} bytes (24 a control point: {24 * row['control points']:,})")
    return "; ".join(parts) + "; float64 heights 2,097,152"


_FIGURES: Sequence[tuple[str, str, str, Callable[[Rows], str], str]] = (
    ("1 (a)", "one NURBS fitted in two ways", "remarkable error of the ordinary fit", _one_model, "[form](form.md)"),
    ("1 (c)", "smart samples of a face", "dense at eyes, nostrils and lips", _face, "[sampling](sampling.md)"),
    ("3", "control points of the disk", "4 900 against 14 400 (0.34)", _disk, "[benchmarks](benchmarks.md#nurbs)"),
    ("5", "time of a fit", "local in 1/2 to 1/4 of global", _fig5, "[benchmarks](benchmarks.md#fig5)"),
    ("6 (a-c)", "form of a saddle", "Sq 0.062 ordinary, 0.032 parametric", _saddle, "[form](form.md)"),
    ("6 (d, e)", "form of a milled artefact", "Sq 0.139 mm", _artefact, "[form](form.md)"),
    ("7", "a step filtered by tolerance", "edges kept, residual even", _steps, "[filtration](filtration.md)"),
    ("8", "Peaks band by band", "nested approximately", _bands, "[multi-resolution](multiresolution.md)"),
    ("9", "a fifth missing", "like multilevel B-splines; slight ripples", _holes, "[missing data](filling.md)"),
    ("10", "error over sample size", "up to half an order of magnitude", _samples, "[sampling](sampling.md)"),
    ("11", "compression", "24 bytes a control point", _bytes, "[compression](compression.md)"),
)
