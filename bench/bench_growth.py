"""How does time grow with samples, and with control points? Fits of one surface, each warm.

Samples: sparse bumps (T6) to 2 % of the range on ever finer grids, 2¹⁶ to 2²⁴ pixels; the same formula needs about the
same control points on each. Control points: 2²⁰ pixels of a laser texture, to a falling tolerance. Exponents are slopes
of the logarithm of seconds over the logarithm of the size, by least squares over all rows and over the upper half.
"""

import sys
from dataclasses import dataclass

import jax
import numpy as np
from reporting import keep

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import laser_textured_disk, sparse_bumps  # noqa: E402

TOLERANCE = 0.02
TOLERANCES = (0.63, 0.6, 0.5, 0.4, 0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
MANY = 1 << 22  # samples of which one timed run must do
ASKED = 1.1


@dataclass(frozen=True)
class Sweep:
    """What grows, and its name in the notes."""

    name: str
    size: str


SAMPLES, CONTROL_POINTS = Sweep("samples", "samples"), Sweep("control points", "control points")


def main(first: int = 16, last: int = 24, fixed: int = 20, tolerances: int = len(TOLERANCES)) -> None:
    """Fit 2^first to 2^last samples, then 2^fixed samples to the first so many tolerances."""
    rows = []
    for power in range(first, last + 1):
        rows.append(_row(SAMPLES, sparse_bumps(shape_of(power)), TOLERANCE))
        print(rows[-1], file=sys.stderr, flush=True)
    texture = laser_textured_disk(shape_of(fixed), bumps=12, scale=0.5)
    for tolerance in TOLERANCES[:tolerances]:
        rows.append(_row(CONTROL_POINTS, texture, tolerance))
        print(rows[-1], file=sys.stderr, flush=True)
    exponents = {}
    for sweep in (SAMPLES, CONTROL_POINTS):
        chosen = [row for row in rows if row["growing"] == sweep.name]
        exponents[sweep.name] = {
            "all": exponent(chosen, sweep.size),
            "upper half": exponent(chosen[len(chosen) // 2 :], sweep.size),
        }
    keep("growth", rows, exponents=exponents, asked=ASKED)


def shape_of(power: int) -> tuple[int, int]:
    """Rows and columns of 2^power pixels."""
    return 1 << (power // 2), 1 << (power - power // 2)


def _row(sweep: Sweep, height_map: tsj.HeightMap, tolerance: float) -> dict:
    """The fastest of three runs, or a single one of many samples, after one that compiles."""
    samples = height_map.heights.size
    seconds = []
    for _ in range(2 if samples >= MANY else 4):
        result = tsj.fit(height_map, relative_tolerance=tolerance)
        seconds.append(result.seconds)
    return {
        "growing": sweep.name,
        "samples": samples,
        "tolerance %": 100 * tolerance,
        "control points": result.control_points,
        "max error %": 100 * result.max_error / result.range,
        "steps": len(result.history),
        "seconds": min(seconds[1:]),
        "microseconds a sample": 1e6 * min(seconds[1:]) / samples,
        "microseconds a control point": 1e6 * min(seconds[1:]) / result.control_points,
    }


def exponent(rows: list[dict], size: str) -> float | None:
    """The slope of log seconds over log size."""
    sizes, seconds = (np.log([row[name] for row in rows]) for name in (size, "seconds"))
    return round(float(np.polyfit(sizes, seconds, 1)[0]), 3) if np.ptp(sizes) > 0 else None


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
