"""Does the objective ever rise? 200 random surfaces, global and local solver, beside the paper's dyadic baseline.

Fixed λ, unit weights, tolerance 5 % of the range. Reported per method: in how many fits, and in how many steps, the
objective Σ w r² + λ E and the maximum error rose, the largest relative rise of the objective, and control points over
the surfaces on which every method met the tolerance.
"""

import sys

import jax
import numpy as np
from reporting import keep
from surfaces import random_surface

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402

METHODS = {
    "analysis-suitable, global": {"solver": tsj.GlobalSolver()},
    "analysis-suitable, local": {"solver": tsj.LocalSolver()},
    "dyadic, local, ring 0 (paper)": {"refinement": tsj.Dyadic(), "solver": tsj.LocalSolver(ring=0), "max_steps": 15},
}


def main(surfaces: int = 200) -> None:
    """Fit the random surfaces by every method and count the rises."""
    fits = {name: [] for name in METHODS}
    for seed in range(surfaces):
        for name, options in METHODS.items():
            result = tsj.fit(random_surface(seed), relative_tolerance=0.05, **options)
            fits[name].append(result)
        if seed % 20 == 19:
            print(f"{seed + 1} surfaces", file=sys.stderr)
    converged = ([fit.converged for fit in fits[name]] for name in list(METHODS)[:2])
    both = np.array([all(pair) for pair in zip(*converged, strict=True)])
    rows = [_row(name, results, both) for name, results in fits.items()]
    ratio = rows[1]["control points"] / rows[0]["control points"]
    keep("monotone", rows, surfaces=surfaces, reachable=int(both.sum()), local_over_global=round(ratio, 4))


def _row(name: str, results: list, both: np.ndarray) -> dict:
    """One method's line."""
    rises = [_rises([step.objective for step in result.history]) for result in results]
    errors = [_rises([step.max_error for step in result.history]) for result in results]
    return {
        "method": name,
        "fits": len(results),
        "steps": int(sum(len(rise) for rise in rises)),
        "objective rose: fits": int(sum((rise > 1e-10).any() for rise in rises)),
        "steps ": int(sum((rise > 1e-10).sum() for rise in rises)),
        "largest rise": float(max(rise.max(initial=-1) for rise in rises)),
        "max error rose: fits": int(sum((rise > 1e-10).any() for rise in errors)),
        "converged": int(sum(result.converged for result in results)),
        "control points": int(sum(r.control_points for r, counts in zip(results, both, strict=True) if counts)),
    }


def _rises(values: list[float]) -> np.ndarray:
    """Relative rise from each step to the next."""
    array = np.array(values)
    return np.diff(array) / np.maximum(array[:-1], np.finfo(float).tiny)


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
