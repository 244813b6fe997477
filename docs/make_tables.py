"""Results of the benchmarks as tables: `python docs/make_tables.py` writes docs/benchmarks.md and the README's table.

Every bench/results/NAME.json (written by `bench/bench_NAME.py`) becomes a section of the page: what its script asks, in
the words of the script's docstring, the rows it measured, and with which versions. In the README it is one line: the
question, and the notes as the answer. Without results both say how to make them.
"""

import ast
import json
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
README, PAGE = ROOT / "README.md", ROOT / "docs" / "benchmarks.md"
RESULTS = ROOT / "bench" / "results"
OPENING, CLOSING = "<!-- compared: written by docs/make_tables.py -->", "<!-- end of compared -->"

INTRODUCTION = """# Benchmarks

Written by `docs/make_tables.py` from `bench/results/*.json`; `make bench` measures them anew. Accuracy stands beside
seconds, and peers run in the same process. Surfaces T1 (laser-textured disk), T2 (plate with particles; T2n with 1 % of
noise), T3 (scattered Peaks), T5 (T1 with 2048 × 2048 pixels) and T6 (sparse bumps) are those of `tsplinejax.data`.
"""
NOTHING = "No results yet: `make bench` measures, `python docs/make_tables.py` writes them here.\n"


def documents() -> dict[Path, str]:
    """The page and the README as they should be."""
    results = [json.loads(path.read_text(encoding="utf-8")) for path in sorted(RESULTS.glob("*.json"))]
    results = [result for result in results if _docstring(result["benchmark"])]  # of a script that is still there
    page = "\n".join([INTRODUCTION, *(map(_section, results) if results else [NOTHING])])
    before, _, rest = README.read_text(encoding="utf-8").partition(OPENING)
    after = rest.partition(CLOSING)[2]
    return {PAGE: page, README: f"{before}{OPENING}\n{_summary(results)}{CLOSING}{after}"}


def _summary(results: list[dict[str, Any]]) -> str:
    """The README's table: one line a benchmark."""
    if not results:
        return NOTHING
    rows = [{"what is measured": _question(result), "result": _notes(result) or _link(result)} for result in results]
    return f"{_table(rows)}\nAll rows, peers and versions: [benchmarks](docs/benchmarks.md).\n"


def _link(result: dict[str, Any]) -> str:
    """To a benchmark's section, for one whose rows have no summary."""
    title = _title(result)
    return f"[table](docs/benchmarks.md#{title.lower().replace(' ', '-')})"


def _title(result: dict[str, Any]) -> str:
    return result["benchmark"].replace("_", " ").capitalize()


def _section(result: dict[str, Any]) -> str:
    """One benchmark of the page."""
    name, notes = result["benchmark"], _notes(result)
    versions = ", ".join(f"{package} {version}" for package, version in result["versions"].items())
    machine = result["machine"]
    made = f"By `bench/bench_{name}.py` with {versions}, Python {machine['python']}, {machine['cores']} cores.\n"
    parts = [
        f"## {_title(result)}\n",
        _docstring(name) + "\n",
        _table(result["rows"]),
        f"{notes}.\n" if notes else "",
        made,
    ]
    return "\n".join(part for part in parts if part)


def _question(result: dict[str, Any]) -> str:
    """The first sentence of the script's docstring, without its full stop."""
    return re.split(r"(?<=[?])\s|\.\s|\.$", _docstring(result["benchmark"]).replace("\n", " "), maxsplit=1)[0]


def _notes(result: dict[str, Any]) -> str:
    return "; ".join(f"{name.replace('_', ' ')}: {_cell(value)}" for name, value in result["notes"].items())


def _docstring(name: str) -> str:
    """What a benchmark says of itself; empty where its script is gone."""
    script = ROOT / "bench" / f"bench_{name}.py"
    if not script.is_file():
        return ""
    return ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or ""


def _table(rows: list[dict[str, Any]]) -> str:
    """Rows of any keys as a Markdown table; a key that a row lacks is an empty cell."""
    if not rows:
        return "(no rows)\n"
    names = list(dict.fromkeys(name for row in rows for name in row))
    lines = [[name.strip() for name in names], ["---"] * len(names)]
    lines += [[_cell(row.get(name)) for name in names] for row in rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return ", ".join(f"{name} {_cell(entry)}" for name, entry in value.items())
    if isinstance(value, list):
        return ", ".join(map(_cell, value))
    return "" if value is None else str(value).replace("|", "\\|").replace("\n", " ")


def main() -> None:
    """Write what has changed."""
    for path, text in documents().items():
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
