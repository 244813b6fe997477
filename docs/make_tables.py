"""Results of the benchmarks as tables: `python docs/make_tables.py` writes docs/benchmarks.md and the README's table.

A page with a line `<!-- table: RESULT -->` gets that result's rows between it and the next `<!-- end of table -->`.
Every `bench/bench_NAME.py` becomes a section of the page: what it asks, in the words of its docstring, and the rows,
versions and machine of each result that it left in bench/results; "not run" where it left none. The README has a few
headlines of them, docs/figures.md a row for each figure of the paper. Pictures are drawn from the same results.
"""

import ast
import json
import re
from pathlib import Path
from typing import Any

from paper_figures import figures

ROOT = Path(__file__).resolve().parents[1]
README, PAGE = ROOT / "README.md", ROOT / "docs" / "benchmarks.md"
BENCH, RESULTS, IMAGES = ROOT / "bench", ROOT / "bench" / "results", ROOT / "docs" / "images"
FIGURES_OPENING, FIGURES_CLOSING = "<!-- figures: written by docs/make_tables.py -->", "<!-- end of figures -->"
OPENING, CLOSING = "<!-- compared: written by docs/make_tables.py -->", "<!-- end of compared -->"

INTRODUCTION = """# Benchmarks

Written by `docs/make_tables.py` from `bench/results/*.json`; `make bench` measures them anew. Accuracy stands beside
seconds, and peers run in the same process, or are marked as quoted. Surfaces T1 (laser-textured disk), T2 (plate with
particles; T2n with 1 % of noise), T3 (scattered Peaks), T4 (pillars, of which a fifth is missing), T5 (T1 with
2048 × 2048 pixels) and T6 (sparse bumps) are those of `tsplinejax.data`.
"""
NOT_RUN = "not run"
#: Pictures by result: file and description.
PICTURES = {
    "growth": {"bench_growth.png": "Seconds over samples and over control points, both on logarithmic axes"},
    "fig5": {"bench_fig5.png": "Seconds over the signal-to-noise ratio, for the paper's fits and ours"},
    "compression": {"bench_compression.png": "Size over the largest error, both on logarithmic axes, for eight coders"},
}
#: Results that are too long for a table.
UNLISTED = {"fig5_steps"}


def documents() -> dict[Path, str]:
    """The page and the README as they should be."""
    results = _results()
    page = "\n".join([INTRODUCTION, *(_section(script, found) for script, found in results.items())])
    before, _, rest = README.read_text(encoding="utf-8").partition(OPENING)
    after = rest.partition(CLOSING)[2]
    pages = {path: _with_tables(path.read_text(encoding="utf-8")) for path in ROOT.glob("docs/*.md") if path != PAGE}
    return {**pages, PAGE: page, README: f"{before}{OPENING}\n{_summary()}{CLOSING}{after}"}


def _with_tables(text: str) -> str:
    """A page with the tables it asks for; as it was where a result is not there."""

    def filled(match: re.Match[str]) -> str:
        path = RESULTS / f"{match[2]}.json"
        if not path.is_file():
            return match[0]
        return f"{match[1]}\n{_table(json.loads(path.read_text(encoding='utf-8'))['rows'])}{match[3]}"

    before, opening, rest = text.partition(FIGURES_OPENING)
    if opening:
        text = f"{before}{opening}\n{_table(figures(_rows))}{FIGURES_CLOSING}{rest.partition(FIGURES_CLOSING)[2]}"
    return re.sub(r"(<!-- table: (\w+) -->)\n.*?(<!-- end of table -->)", filled, text, flags=re.DOTALL)


def _results() -> dict[str, list[dict[str, Any]]]:
    """The results of each script, by its name; those of a script that is gone are left out."""
    results = {path.stem.removeprefix("bench_"): [] for path in sorted(BENCH.glob("bench_*.py"))}
    for path in sorted(RESULTS.glob("*.json")):
        result = json.loads(path.read_text(encoding="utf-8"))
        script = _script_of(result, list(results))
        if script is not None and result["benchmark"] not in UNLISTED:
            results[script].append(result)
    return results


def _script_of(result: dict[str, Any], scripts: list[str]) -> str | None:
    """The script that left a result: it says so itself, or its name begins with the script's."""
    name = result.get("script", "").removeprefix("bench_").removesuffix(".py") or result["benchmark"]
    parts = name.split("_")
    prefixes = ("_".join(parts[:length]) for length in range(len(parts), 0, -1))
    return next((prefix for prefix in prefixes if prefix in scripts), None)


def _summary() -> str:
    """The README's table: a few headlines, each with the peer from the same run, of those results that are there."""
    rows = [headline() for headline in HEADLINES]
    note = "All rows, peers and versions, and what falls short: [benchmarks](docs/benchmarks.md)."
    return f"{_table([row for row in rows if row])}\n{note}\n"


def _headline(what: str, ours: str, others: str) -> dict[str, str]:
    return {"what": what, "tsplinejax": ours, "others": others}


def _rows(benchmark: str, **wanted: Any) -> list[dict[str, Any]]:
    """The rows of a result with these values in the columns of these names (underscores are blanks)."""
    path = RESULTS / f"{benchmark}.json"
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    return [row for row in rows if all(row.get(name.replace("_", " ")) == value for name, value in wanted.items())]


def _fitted(surface: str, share: float, what: str) -> dict[str, str] | None:
    """Seconds and control points of a fit to a tolerance, and of scipy's uniform least squares."""
    columns = {"surface": surface, "tolerance_%": share}
    methods = ("tsplinejax, local", "scipy, uniform, sparse", "scipy, uniform, separable")
    found = [_rows("speed", method=method, **columns) for method in methods]
    if not all(found):
        return None
    ours, theirs, separable = (rows[0] for rows in found)
    cells = [f"{row['seconds']:.2f} s, {row['control points']:,} control points" for row in (ours, theirs)]
    others = f"scipy, uniform lattice: {cells[1]} (full grids alone: {separable['seconds']:.3f} s)"
    return _headline(f"{what} to {share:g} % of the range, warm", cells[0], others)


def _counted() -> dict[str, str] | None:
    rows = _rows("counts", surface="T1", **{"tolerance_%": 0.1})
    if not rows:
        return None
    what = "control points for a laser-textured disk to 0.1 %"
    return _headline(what, f"{rows[0]['8 x 8 local']:,}", f"{rows[0]['best peer (quoted)']} (quoted)")


def _evaluated() -> dict[str, str] | None:
    ours, theirs = (
        _rows("evaluate", evaluator=name, parameters="random") for name in ("TSpline", "RectBivariateSpline.ev")
    )
    if not ours or not theirs:
        return None
    cells = [f"{rows[0]['ns a point']:.0f} ns a point" for rows in (ours, theirs)]
    return _headline("heights at 10⁷ random places", cells[0], f"scipy's `RectBivariateSpline.ev`: {cells[1]}")


def _batched() -> dict[str, str] | None:
    ours, theirs = (_rows("batch", batch=name) for name in ("shared space", "lstsq"))
    if not ours or not theirs:
        return None
    cells = [f"{rows[0]['milliseconds a map']:.3g} ms a map" for rows in (ours, theirs)]
    return _headline("256 maps of 256 × 256 pixels over one space", cells[0], f"one after the other: {cells[1]}")


def _never_rose() -> dict[str, str] | None:
    ours, theirs = (
        _rows("monotone", method=name) for name in ("analysis-suitable, local", "dyadic, local, ring 0 (paper)")
    )
    if not ours or not theirs:
        return None
    cells = [str(rows[0]["objective rose: fits"]) for rows in (ours, theirs)]
    return _headline(
        f"fits whose objective ever rose, of {ours[0]['fits']} random surfaces",
        cells[0],
        f"the paper's way: {cells[1]}",
    )


HEADLINES = (
    lambda: _fitted("T2", 1.0, "a plate with particles, 512 × 512 pixels,"),
    lambda: _fitted("T1", 0.1, "a laser-textured disk, 512 × 512 pixels,"),
    _counted,
    _evaluated,
    _batched,
    _never_rose,
)


def _title(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _section(script: str, found: list[dict[str, Any]]) -> str:
    """One script's part of the page."""
    parts = [f"## {_title(script)}\n", _docstring(script) + "\n"]
    if not found:
        parts.append(f"{NOT_RUN.capitalize()}.\n")
    for result in found:
        notes = _notes(result)
        parts += [
            f"### {_title(result['benchmark'])}\n" if len(found) > 1 else "",
            *(f"![{text}](images/{name})\n" for name, text in PICTURES.get(result["benchmark"], {}).items()),
            _table(result["rows"]),
            f"{notes}.\n" if notes else "",
            _made(script, result),
        ]
    return "\n".join(part for part in parts if part)


def _made(script: str, result: dict[str, Any]) -> str:
    """With what a result was measured."""
    versions = ", ".join(f"{package} {version}" for package, version in result["versions"].items())
    machine = result["machine"]
    memory = f", {machine['memory GB']} GB" if machine.get("memory GB") else ""
    command = result.get("command", f"python bench/bench_{script}.py")
    return (
        f"By `{command}` on {result['date']} with {versions}, Python {machine['python']}; "
        f"{machine['processor']}, {machine['cores']} cores{memory}.\n"
    )


def _notes(result: dict[str, Any]) -> str:
    return "; ".join(f"{name.replace('_', ' ')}: {_cell(value)}" for name, value in result["notes"].items())


def _docstring(script: str) -> str:
    """What a script says of itself."""
    text = (BENCH / f"bench_{script}.py").read_text(encoding="utf-8")
    return ast.get_docstring(ast.parse(text)) or ""


def _table(rows: list[dict[str, Any]]) -> str:
    """Rows of any keys as a Markdown table; a key that a row lacks is an empty cell."""
    if not rows:
        return "(no rows)\n"
    names = list(dict.fromkeys(name for row in rows for name in row))
    lines = [[name.strip() for name in names], ["---"] * len(names)]
    lines += [[_cell(row.get(name)) for name in names] for row in rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _cell(value: Any, within: bool = False) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_cell(entry, within=True)}" for name, entry in value.items()).join(
            "()" if within else ("", "")
        )
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    return "" if value is None else str(value).replace("|", "\\|").replace("\n", " ")


def _draw() -> None:
    """The pictures of the results that are there."""
    drawings = {"growth": _draw_growth, "fig5": _draw_fig5, "compression": _draw_compression}
    for path in (RESULTS / f"{name}.json" for name in drawings):
        if path.is_file():
            rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
            (name,) = PICTURES[path.stem]
            figure = drawings[path.stem](rows)
            figure.savefig(IMAGES / name, dpi=110)


def _axes(titles: list[str], **options: Any) -> tuple[Any, Any]:
    """A figure with axes beside each other."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9, 3.8), layout="constrained")
    axes = figure.subplots(1, len(titles), squeeze=False, **options)[0]
    for ax, title in zip(axes, titles, strict=True):
        ax.set(title=title, ylabel="seconds", yscale="log")
        ax.grid(which="both", alpha=0.25)
    return figure, axes


def _draw_growth(rows: list[dict[str, Any]]) -> Any:
    """Seconds over samples and over control points, with slopes of one."""
    sizes = ("samples", "control points")
    figure, axes = _axes([f"growing {size}" for size in sizes])
    for ax, size in zip(axes, sizes, strict=True):
        chosen = [row for row in rows if row["growing"] == size]
        x, y = ([row[name] for row in chosen] for name in (size, "seconds"))
        ax.plot(x, y, "o-", label="tsplinejax")
        if x:
            ends = [x[0], x[-1]]
            ax.plot(ends, [y[-1] * end / x[-1] for end in ends], "--", color="0.5", label="slope 1")
        ax.set(xscale="log", xlabel=size)
        ax.legend()
    return figure


def _draw_fig5(rows: list[dict[str, Any]]) -> Any:
    """Seconds over the signal-to-noise ratio, a line for each method."""
    surfaces, methods = (list(dict.fromkeys(row[name] for row in rows)) for name in ("surface", "method"))
    figure, axes = _axes(surfaces, sharey=True)
    for ax, surface in zip(axes, surfaces, strict=True):
        for method in methods:
            chosen = [row for row in rows if (row["surface"], row["method"]) == (surface, method)]
            ax.plot([row["SNR dB"] for row in chosen], [row["seconds"] for row in chosen], "o-", label=method)
        ax.set(xlabel="signal-to-noise ratio, centred, in dB")
        ax.legend()
    return figure


def _draw_compression(rows: list[dict[str, Any]]) -> Any:
    """Size over the bound, a line for each coder (Fig. 11), on the surfaces with a whole curve."""
    names = [name for name in ("T6", "T2", "T1") if any(row["map"] == name for row in rows)]
    figure, axes = _axes(names, sharey=True)
    for ax, name in zip(axes, names, strict=True):
        chosen = [row for row in rows if row["map"] == name]
        for coder, label in [("bytes", "tsplinejax"), *((peer, peer) for peer in _CODERS)]:
            pairs = [(row["bound %"], row[coder] / 1000) for row in chosen if isinstance(row[coder], int)]
            style = {"color": "black", "linewidth": 2.2, "zorder": 3} if coder == "bytes" else {"linewidth": 1}
            ax.plot(*zip(*pairs, strict=True), "o-", markersize=3, label=label, **style)
        ax.set(xscale="log", xlabel="largest error, % of the range", ylabel="kB" if ax is axes[0] else "")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside right center")
    return figure


_CODERS = ("SZ3", "SPERR", "JPEG XL", "JPEG 2000", "zstd", "ZFP", "LERC")


def main() -> None:
    """Write what has changed."""
    _draw()
    for path, text in documents().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
