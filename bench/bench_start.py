"""From process start to a fitted T2 at 1 %: the command line cold, and with a warm compilation cache."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from reporting import keep
from surfaces import case_study


def main() -> None:
    """Time the command line with an empty compilation cache, then twice with the one that it left."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "plate.npy", case_study("T2").heights)
        environment = {**os.environ, "XDG_CACHE_HOME": folder}
        environment.pop("JAX_COMPILATION_CACHE_DIR", None)
        command = [
            str(Path(sys.executable).parent / "tsplinejax"),
            "fit",
            "plate.npy",
            "-o",
            "plate.tspl",
            "--relative-tolerance",
            "0.01",
            "--lattice",
            "8x8",
        ]
        for label in ("cold", "warm cache", "warm cache, again"):
            started = time.perf_counter()
            subprocess.run([*command, "--json"], cwd=folder, env=environment, check=True, stdout=subprocess.DEVNULL)
            rows.append({"start": label, "seconds": time.perf_counter() - started})
    keep("start", rows)


if __name__ == "__main__":
    main()
