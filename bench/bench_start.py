"""From process start to a fitted T2 at 1 %: the command line cold, and with a warm compilation cache.

Cold is a process whose folder for compiled kernels is new and empty; the two after it find what it left there.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from reporting import keep
from surfaces import case_study

ASKED = {"cold": 4.5, "warm cache": 2.0}  # seconds
#: Variables that would lead the command to kernels compiled elsewhere, or have Python translate the installed sources
#: in every start.
NOT_A_USERS = (
    "JAX_COMPILATION_CACHE_DIR", "JAX_ENABLE_COMPILATION_CACHE", "TSPLINEJAX_CACHE", "PYTHONDONTWRITEBYTECODE",
)  # fmt: skip


def main(size: int = 512, rounds: int = 3) -> None:
    """Time the command line with an empty cache, then twice with the one that it left; a few rounds of this."""
    rows = [row for _ in range(rounds) for row in one_round(size)]
    fastest = {name: round(min(row["seconds"] for row in rows if row["start"] == name), 2) for name in ASKED}
    keep("start", rows, fastest_seconds=fastest, asked_seconds=ASKED)


def one_round(size: int) -> list[dict]:
    """Three starts that share a cache which was empty before."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "plate.npy", case_study("T2", size).heights)
        environment = {name: value for name, value in os.environ.items() if name not in NOT_A_USERS}
        environment["XDG_CACHE_HOME"] = environment["LOCALAPPDATA"] = folder
        program = str(Path(sys.executable).parent / "tsplinejax")
        command = [program, "fit", "plate.npy", "-o", "plate.tspl", "--relative-tolerance", "0.01", "--lattice", "8x8"]
        cache = Path(folder) / "tsplinejax" / "jax"
        for label in ("cold", "warm cache", "warm cache"):
            assert cache.exists() == (label != "cold"), f"the cache is not at {cache}"
            started = time.perf_counter()
            answer = subprocess.run(
                [*command, "--json"], cwd=folder, env=environment, check=True, stdout=subprocess.PIPE, text=True
            ).stdout
            seconds = time.perf_counter() - started
            report = json.loads(answer)
            rows.append(
                {
                    "start": label,
                    "seconds": seconds,
                    "seconds of the fit": report["seconds"],
                    "control points": report["control_points"],
                    "max error %": 100 * report["max_error"] / report["range"],
                }
            )
    return rows


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
