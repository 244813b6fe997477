"""Measured surfaces: to 10 % of the range, robustly to 5 % of the inliers' range, and to the noise.

Reads every map in `../shared/data` where that folder exists (its files are not part of this repository), and always the
elevation model that ships with matplotlib.
"""

import sys
from typing import Any

import jax
import numpy as np
from reporting import keep
from surfaces import jacksboro, measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402

WAYS: dict[str, dict[str, Any]] = {
    "10 %": {"relative_tolerance": 0.1},
    "robust 5 %": {"relative_tolerance": 0.05, "robust": True},
    "noise": {"noise": "auto", "robust": True},
}


def main(*only: str) -> None:
    """Fit every measured surface, or only those named, in three ways."""
    rows = []
    for name, data in [("jacksboro", jacksboro()), *measured()]:
        if only and name not in only:
            continue
        for label, options in WAYS.items():
            rows.append(row(name, label, tsj.fit(data, **options)))
            print(rows[-1], file=sys.stderr)
    keep("real" if not only else "real_part", rows)


def row(name: str, label: str, result: tsj.FitResult) -> dict:
    """One fit's line."""
    samples = len(result.samples)
    return {
        "map": name,
        "fit": label,
        "samples": samples,
        "control points": result.control_points,
        "points % of samples": 100 * result.control_points / samples,
        "outliers %": 100 * float(result.outliers.mean()),
        "max error %": 100 * result.max_error / result.range,
        "rms error %": 100 * result.rms_error / result.range,
        "neighbour correlation": neighbour_correlation(result),
        "stop": str(result.stop),
        "warnings": len(result.warnings),
        "seconds": result.seconds,
    }


def neighbour_correlation(result: tsj.FitResult) -> float:
    """Correlation of the residuals at horizontal and vertical neighbours, outliers left out."""
    residuals = np.where(result.outliers, np.nan, result.residuals)
    grid = result.samples.scatter(residuals)
    pairs = [(grid[:, 1:], grid[:, :-1]), (grid[1:], grid[:-1])]
    products = np.concatenate([(a * b).ravel() for a, b in pairs])
    return float(np.nanmean(products) / np.nanmean(grid**2))


if __name__ == "__main__":
    main(*sys.argv[1:])
