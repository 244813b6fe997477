"""Run the benchmarks one after the other: `python bench/run.py [--dry] [--small] [names]`.

Each `bench_NAME.py` runs in a process of its own and writes `bench/results/NAME.json`. `--dry` keeps no result;
`--small` runs each on small surfaces to see that it works, and keeps no result either.
"""

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

from reporting import DRY

HERE = Path(__file__).parent

#: Arguments that make a benchmark small enough to be tried.
SMALL = {
    "batch": ["4", "2", "1", "2"],
    "conformal": ["2000"],
    "fig5": ["64", "20"],
    "form": ["model"],
    "growth": ["14", "16", "16", "3"],
    "monotone": ["3"],
    "peers": ["64"],
    "sampling": ["64", "1.2,4"],
    "speed": ["64", "128"],
    "start": ["256", "1"],
}


def main() -> int:
    """Run what is named, or all; a benchmark that fails does not keep the others from running."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="benchmarks, without bench_ and .py (default: all)")
    parser.add_argument("--dry", action="store_true", help="keep no result")
    parser.add_argument("--small", action="store_true", help="small surfaces, to try the scripts; keeps no result")
    options = parser.parse_args()
    scripts = {path.stem.removeprefix("bench_"): path for path in sorted(HERE.glob("bench_*.py"))}
    unknown = [name for name in options.names if name not in scripts]
    if unknown:
        parser.error(f"no benchmark is named {', '.join(unknown)}; there are {', '.join(scripts)}")
    names = options.names or [name for name in scripts if not options.small or name in SMALL]
    failed = [name for name in names if not _succeeds(scripts[name], name, options.dry, options.small)]
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


def _succeeds(script: Path, name: str, dry: bool, small: bool) -> bool:
    """Run one benchmark, and say how it ended."""
    environment = {**os.environ, DRY: "1"} if dry or small else dict(os.environ)
    arguments = SMALL.get(name, []) if small else []
    print(f"== {name} {' '.join(arguments)}", file=sys.stderr, flush=True)
    started = time.perf_counter()
    code = subprocess.run([sys.executable, str(script), *arguments], env=environment, check=False).returncode
    print(f"== {name}: exit code {code}, {time.perf_counter() - started:.0f} s", file=sys.stderr, flush=True)
    return code == 0


if __name__ == "__main__":
    sys.exit(main())
