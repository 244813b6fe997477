"""Results of a benchmark: printed as a table and kept as JSON with versions, machine and date."""

import datetime
import json
import os
import platform
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).parent / "results"


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows with the same keys as an aligned text table."""
    if not rows:
        return "(no rows)"
    cells = [[_text(row[key]) for key in rows[0]] for row in rows]
    lines = [list(rows[0]), *cells]
    widths = [max(len(line[k]) for line in lines) for k in range(len(lines[0]))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)


def keep(name: str, rows: Sequence[Mapping[str, Any]], **notes: Any) -> None:
    """Print the table and write `results/NAME.json`."""
    print(f"\n{name}\n{table(rows)}")
    for key, value in notes.items():
        print(f"{key}: {value}")
    RESULTS.mkdir(exist_ok=True)
    packages = ("tsplinejax", "jax", "numpy", "scipy")
    document = {
        "benchmark": name,
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": {"processor": platform.machine(), "cores": os.cpu_count(), "python": platform.python_version()},
        "versions": {package: version(package) for package in packages},
        "notes": notes,
        "rows": list(rows),
    }
    (RESULTS / f"{name}.json").write_text(json.dumps(document, indent=1, default=float) + "\n")


def _text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
