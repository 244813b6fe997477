"""Conformal parameters: how conformal, on which clouds, in how long?

Freeforms sampled at random, clean and damaged (three holes, noise of 0.3 spacings, 1 % outliers up to 20 times that), a
measured face and a patch of a turbine blade, with the projection on the least-squares plane beside them: the peer that
everybody has. Its dilatation is judged on the triangles between the points. A sphere in Mercator's coordinates tells
the error against a known map. Processor seconds.
"""

import sys
import time
from typing import Any

import numpy as np
from reporting import keep
from sheets import (
    BLADE,
    FACE,
    blade_patch,
    cylinder,
    dome,
    mercator,
    saddle,
    scattered,
    twist,
    with_faults,
    with_holes,
)

import tsplinejax as tsj
from tsplinejax import PointCloud
from tsplinejax.parameterisation import conformal, planar
from tsplinejax.parameterisation._delaunay import delaunay
from tsplinejax.parameterisation._harmonic import dilatation

FAULTY = 10_000


def main(largest: int = 100_000) -> None:
    """Every surface at three sizes, the damaged ones at the middle size, the known map, and what was measured."""
    rows = []
    for surface in (saddle, dome, cylinder, twist):
        for count in (1000, 10_000, largest):
            rows.append(row(surface.__name__, "clean", surface(*scattered(count, 0))))
        damaged = with_faults(surface(*with_holes(*scattered(FAULTY, 1))), 0.6 / FAULTY**0.5, 1)
        rows.append(row(surface.__name__, "holes, noise, outliers", damaged))
    if FACE.is_file():
        face = tsj.read(FACE)
        rows += [row("face", "measured cloud", face.points), row("face", "measured mesh", face)]
    if BLADE.is_file():
        rows.append(row("turbine blade", "patch of a measured mesh", blade_patch()))
    rows += [known(columns) for columns in (41, 81, 161)]
    keep("conformal", rows)


def row(name: str, kind: str, data: Any) -> dict[str, Any]:
    """One cloud or mesh, mapped conformally and projected."""
    started = time.process_time()
    result = conformal(data)
    seconds = time.process_time() - started
    points = data.points.astype(float) if isinstance(data, PointCloud) else data
    triangles = delaunay(result.parameters * result.sides)
    flat = planar(points, axes="plane")
    return {
        **_figures(name, kind, result),
        "planar dilatation": dilatation(points, triangles, flat.parameters * flat.sides).median,
        "seconds": seconds,
    }


def known(columns: int) -> dict[str, Any]:
    """A mesh whose conformal map is known."""
    points, triangles, truth, _ = mercator(columns, columns * 3 // 4)
    corners = [0, columns - 1, len(points) - 1, len(points) - columns]
    started = time.process_time()
    result = conformal(PointCloud(points, triangles=triangles), corners=corners)
    seconds = time.process_time() - started
    error = float(np.abs(result.parameters - truth).max())
    return {**_figures("sphere (Mercator)", "mesh", result), "largest error": error, "seconds": seconds}


def _figures(name: str, kind: str, result: tsj.Parameterisation) -> dict[str, Any]:
    """What a map says of itself."""
    assert result.dilatation is not None
    return {
        "surface": name,
        "cloud": kind,
        "points": len(result),
        "E_u E_v": result.certificate,
        "dilatation": result.dilatation.median,
        "95 %": result.dilatation.percentile_95,
    }


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
