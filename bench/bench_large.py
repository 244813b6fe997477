"""A map of 16 384 × 16 384 pixels that stays on disk: seconds, memory, and time per sample beside T5's in memory.

A wavy plate with 144 laser bumps, float32 (1 GB), is written band by band into a temporary file and fitted to 1 % from
there, in a process of its own. `python bench/bench_large.py SIDE` takes another size.
"""

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from reporting import RESULTS, keep

SIDE, ACROSS, BAND = 16_384, 12, 256
RADIUS, WIDTH, DIMPLE, HEIGHT = 0.00875, 0.003, 0.0025, 20.0  # of T5's bumps, in parts of the square
REACH = RADIUS + 5 * WIDTH
MAX_MEMORY = 4e9


def main(side: int = SIDE) -> None:
    """Write, fit, delete, report."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "plate.npy"
        write_plate(path, side)
        words = [sys.executable, __file__, "fit", str(path)]
        row = json.loads(subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout.splitlines()[-1])
    asked = {"resident GB asked": 6.0}
    reference = t5_microseconds()
    if reference is not None:
        asked["over T5 per sample"] = round(row["microseconds a sample"] / reference, 3)
    keep("large", [row], **asked)


def write_plate(path: Path, side: int) -> None:
    """The plate, a band of rows at a time."""
    generator = np.random.default_rng(3)
    down, across = (part.ravel() for part in np.mgrid[:ACROSS, :ACROSS])
    centres = (np.stack([down, across], axis=1) + 0.5 + generator.uniform(-0.2, 0.2, (ACROSS**2, 2))) / ACROSS
    heights = np.lib.format.open_memmap(path, "w+", np.float32, (side, side))
    places = np.linspace(0, 1, side)
    for first in range(0, side, BAND):
        v = places[first : first + BAND]
        band = 2 * np.sin(5 * v[:, None] + 1) * np.cos(4 * places)
        for centre_v, centre_u in centres:
            if v[0] - REACH < centre_v < v[-1] + REACH:
                near = slice(*np.searchsorted(places, [centre_u - REACH, centre_u + REACH]))
                distance = np.hypot(v[:, None] - centre_v, places[near] - centre_u)
                band[:, near] += HEIGHT * np.exp(-2 * ((distance - RADIUS) / WIDTH) ** 2)
                band[:, near] -= 0.4 * HEIGHT * np.exp(-0.5 * (distance / DIMPLE) ** 2)
        heights[first : first + BAND] = band
    heights.flush()


def fit_mapped(path: str) -> None:
    """Fit the file in this process and print the row."""
    import tsplinejax as tsj

    heights = np.load(path, mmap_mode="r")
    result = tsj.fit(heights, relative_tolerance=0.01, max_memory=MAX_MEMORY, progress=True)
    row = {
        "pixels": f"{heights.shape[0]} × {heights.shape[1]}",
        "samples": result.n_samples,
        "control points": result.control_points,
        "max error %": 100 * result.max_error / result.range,
        "stop": str(result.stop),
        "seconds": round(result.seconds, 1),
        "microseconds a sample": result.seconds / result.n_samples * 1e6,
        "peak resident GB": round(peak_memory(), 2),
    }
    print(json.dumps(row))


def peak_memory() -> float:
    """Largest resident memory of this process in GB; not getrusage's, which begins with the parent's."""
    found = re.search(r"VmHWM:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return float("nan") if found is None else int(found[1]) * 1024 / 1e9


def t5_microseconds() -> float | None:
    """Microseconds a sample of T5's fit in memory, as last measured."""
    path = RESULTS / "speed.json"
    if not path.exists():
        return None
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return next((row["microseconds a sample"] for row in rows if row["surface"] == "T5"), None)


if __name__ == "__main__":
    if sys.argv[1:2] == ["fit"]:
        fit_mapped(sys.argv[2])
    else:
        main(*(int(argument) for argument in sys.argv[1:]))
