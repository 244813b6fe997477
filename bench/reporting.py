"""Results of a benchmark: printed as a table and kept as JSON with command, versions, machine and date.

With `BENCH_DRY` set in the environment (`bench/run.py --dry` sets it) nothing is kept: for runs whose figures are worth
nothing.
"""

import datetime
import json
import math
import os
import platform
import sys
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

DRY = "BENCH_DRY"
RESULTS = Path(__file__).parent / "results"
PACKAGES = ("tsplinejax", "jax", "numpy", "scipy")


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Rows of any keys as an aligned text table; a key that a row lacks is an empty cell."""
    if not rows:
        return "(no rows)"
    names = list(dict.fromkeys(name for row in rows for name in row))
    lines = [names, *([_text(row.get(name)) for name in names] for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(names))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in lines)


def keep(name: str, rows: Sequence[Mapping[str, Any]], *, peers: Sequence[str] = (), **notes: Any) -> None:
    """Print the table and write `results/NAME.json`; `peers` are packages whose versions matter, too."""
    print(f"\n{name}\n{table(rows)}")
    for key, value in notes.items():
        print(f"{key}: {value}")
    if os.environ.get(DRY):
        return
    script = Path(sys.argv[0]).name
    document = {
        "benchmark": name,
        "script": script,
        "command": " ".join(["python", f"bench/{script}", *sys.argv[1:]]),
        "date": datetime.datetime.now(datetime.UTC).date().isoformat(),
        "machine": machine(),
        "versions": {package: found for package in (*PACKAGES, *peers) if (found := _version(package))},
        "notes": notes,
        "rows": list(rows),
    }
    RESULTS.mkdir(exist_ok=True)
    text = json.dumps(_finite(document), indent=1, default=float, ensure_ascii=False, allow_nan=False)
    (RESULTS / f"{name}.json").write_text(text + "\n", encoding="utf-8")


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    import jax

    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory GB": _memory(),
        "device": jax.devices()[0].device_kind,
        "system": platform.system(),
        "python": platform.python_version(),
    }


def _processor() -> str:
    """The processor's name, where the system tells it."""
    told = Path("/proc/cpuinfo")
    if told.is_file():
        for line in told.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _memory() -> float | None:
    """Main memory in GB, where the system tells it."""
    try:
        return round(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9, 1)
    except (AttributeError, ValueError, OSError):
        return None


def _version(package: str) -> str | None:
    """The version of a package, or nothing where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _finite(value: Any) -> Any:
    """The same without infinities and NaN, which JSON does not have."""
    if isinstance(value, Mapping):
        return {name: _finite(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    # A numpy float64 is a float; other numpy numbers are turned into one by `json.dumps`.
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _text(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.4g}" if isinstance(value, float) else str(value)
