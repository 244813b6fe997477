"""How few control points? The case studies to 1, 0.5 and 0.1 % of the range, beside the best peers' published figures.

The global solver, and the default local one beside it. Every fit is saved, loaded again and evaluated at every sample
by the loaded model; `max error` is that evaluation's. Then medians over ten seeds, shifts and rotations of T1 and T2,
at 512 × 512 and at 640 × 480 pixels with dx ≠ dy.
"""

import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
from reporting import keep
from surfaces import case_study

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import laser_textured_disk, plate_with_particles  # noqa: E402

ASKED = {
    ("T1", 0.01): 24_000, ("T1", 0.005): 24_600, ("T1", 0.001): 32_500,
    ("T2", 0.01): 9_200, ("T2", 0.005): 10_000, ("T2", 0.001): 16_500,
    ("T6", 0.01): 8_200, ("T6", 0.001): 11_800,
}  # fmt: skip
BEST_PEER = {
    ("T1", 0.01): "THB-splines 23 361", ("T1", 0.005): "THB-splines 29 089", ("T1", 0.001): "THB-splines 49 177",
    ("T2", 0.01): "LR B-splines 8 183", ("T2", 0.005): "LR B-splines 11 418", ("T2", 0.001): "THB-splines 25 096",
    ("T6", 0.01): "uniform 8 281", ("T6", 0.001): "uniform 57 121",
}  # fmt: skip


def main(kind: str = "all") -> None:
    """Run the case studies, the medians, or both."""
    if kind in ("all", "cases"):
        cases()
    if kind in ("all", "medians"):
        medians()


def cases() -> None:
    """Fit each case study to each tolerance, from 8 × 8 elements and from the best start lattice."""
    rows = []
    for (name, tolerance), asked in ASKED.items():
        height_map = case_study(name)
        plain, automatic = (
            tsj.fit(height_map, relative_tolerance=tolerance, lattice=lattice, solver=tsj.GlobalSolver())
            for lattice in ((8, 8), "auto")
        )
        local = tsj.fit(height_map, relative_tolerance=tolerance, lattice=(8, 8))
        options = automatic.provenance["options"]
        rows.append(
            {
                "surface": name,
                "tolerance %": 100 * tolerance,
                "asked": asked,
                "8 x 8": plain.control_points,
                "max error %": 100 * reloaded_error(plain, height_map) / height_map.range,
                "auto": automatic.control_points,
                "auto max error %": 100 * reloaded_error(automatic, height_map) / height_map.range,
                "8 x 8 local": local.control_points,
                "local max error %": 100 * reloaded_error(local, height_map) / height_map.range,
                "auto lattice": f"{options['lattice'][0]} x {options['lattice'][1]} {options['first_cut']}",
                "best peer (quoted)": BEST_PEER[name, tolerance],
                "seconds": plain.seconds,
                "auto seconds": automatic.seconds,
            }
        )
        print(rows[-1], file=sys.stderr)
    keep("counts", rows)


def medians() -> None:
    """Fit the two surfaces in ten poses each, on square and on oblong pixels."""
    rows = []
    for name, maker in (("T1", laser_textured_disk), ("T2", plate_with_particles)):
        for shape, spacing in (((512, 512), (1.0, 1.0)), ((480, 640), (1.0, 1.2))):
            for tolerance in (0.01, 0.001):
                found = [varied(name, maker, shape, spacing, tolerance, k) for k in range(10)]
                counts, local, errors = zip(*found, strict=True)
                asked = ASKED[name, tolerance]
                rows.append(
                    {
                        "surface": name,
                        "pixels": f"{shape[1]} x {shape[0]}",
                        "dx, dy": f"{spacing[0]:g}, {spacing[1]:g}",
                        "tolerance %": 100 * tolerance,
                        "asked (+15 %)": round(1.15 * asked),
                        "median": float(np.median(counts)),
                        "largest": max(counts),
                        "median local": float(np.median(local)),
                        "largest error %": 100 * max(errors),
                    }
                )
                print(rows[-1], file=sys.stderr)
    keep("counts_medians", rows)


def varied(name: str, maker, shape, spacing, tolerance: float, k: int) -> tuple[int, int, float]:
    """Control points with the global and the local solver, and the largest error, for one seed, shift and rotation."""
    rng = np.random.default_rng(100 + k)
    options = {"shift": tuple(rng.uniform(-0.05, 0.05, 2)), "rotation": float(rng.uniform(0, np.pi / 2))}
    if name == "T2":
        options["seed"] = 7 + k
    height_map = tsj.HeightMap(maker(shape, **options).heights, spacing)
    solvers = (tsj.GlobalSolver(), tsj.LocalSolver())
    results = [tsj.fit(height_map, relative_tolerance=tolerance, solver=solver) for solver in solvers]
    error = max(result.max_error / result.range for result in results)
    return results[0].control_points, results[1].control_points, error


def reloaded_error(result: tsj.FitResult, height_map: tsj.HeightMap) -> float:
    """Largest error at the samples, of the saved and loaded model."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.tspl"
        tsj.save(path, result)
        surface = tsj.load(path)
    rows, columns = height_map.shape
    (x0, y0), (dx, dy) = height_map.origin, height_map.spacing
    x, y = np.meshgrid(x0 + np.arange(columns) * dx, y0 + np.arange(rows) * dy)
    return float(np.nanmax(np.abs(np.asarray(surface.at(x, y)) - height_map.heights)))


if __name__ == "__main__":
    main(*sys.argv[1:])
