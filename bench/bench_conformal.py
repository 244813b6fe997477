"""Conformal parameters: how conformal, on which clouds, in how long?

Freeforms sampled at random, clean and damaged (three holes, noise of 0.3 spacings, 1 % outliers up to 20 times that),
with the projection on the least-squares plane beside them: the peer that everybody has. Its dilatation is judged by
the same triangles as ours. A sphere in Mercator's coordinates tells the error against a known map. Processor seconds.
"""

import sys
import time
from pathlib import Path

import numpy as np
from reporting import keep

import tsplinejax as tsj
from tsplinejax import PointCloud
from tsplinejax.parameterisation import conformal, planar
from tsplinejax.parameterisation._delaunay import delaunay
from tsplinejax.parameterisation._harmonic import dilatation

MEASURED = Path(__file__).resolve().parents[2] / "shared" / "data" / "face_fran_cut.ply"


def saddle(u, v):
    """z = 1.5 (x² - y²) over [-1, 1]²."""
    x, y = 2 * u - 1, 2 * v - 1
    return np.column_stack([x, y, 1.5 * (x**2 - y**2)])


def dome(u, v):
    """A cap of a sphere over a rectangle."""
    x, y = 2 * u - 1, 1.4 * v - 0.7
    return np.column_stack([x, y, np.sqrt(2 - x**2 - y**2)])


def cylinder(u, v):
    """A segment of 258°."""
    return np.column_stack([np.cos(4.5 * u), np.sin(4.5 * u), 2 * v])


def twist(u, v):
    """A blade that turns by 206°."""
    return np.column_stack([3 * u, (v - 0.5) * np.cos(3.6 * u), (v - 0.5) * np.sin(3.6 * u)])


def main(largest: int = 100_000) -> None:
    """Every surface at three sizes, the damaged ones at the middle size, the known map, and the measured face."""
    rows = []
    for surface in (saddle, dome, cylinder, twist):
        for count in (1000, 10_000, largest):
            rows.append(row(surface.__name__, "clean", surface(*np.random.default_rng(0).random((2, count)))))
        rows.append(row(surface.__name__, "holes, noise, outliers", damaged(surface, 10_000)))
    if MEASURED.is_file():
        rows.append(row("face", "measured cloud", tsj.read(MEASURED).points))
    rows += [mercator(columns) for columns in (41, 81, 161)]
    keep("conformal", rows)


def row(name: str, kind: str, points: np.ndarray) -> dict:
    """One cloud, mapped conformally and projected."""
    started = time.process_time()
    result = conformal(points)
    seconds = time.process_time() - started
    triangles = delaunay(result.parameters * result.sides)
    flat = planar(points, axes="plane")
    return {
        "surface": name,
        "cloud": kind,
        "points": len(points),
        "E_u E_v": result.certificate,
        "dilatation": result.dilatation.median,
        "95 %": result.dilatation.percentile_95,
        "planar dilatation": dilatation(points, triangles, flat.parameters * flat.sides).median,
        "seconds": seconds,
    }


def damaged(surface, count: int) -> np.ndarray:
    """Three holes, noise and outliers."""
    generator = np.random.default_rng(1)
    u, v = generator.random((2, count))
    for s, t, radius in ((0.3, 0.3, 0.1), (0.7, 0.6, 0.15), (0.25, 0.75, 0.06)):
        keep_these = np.hypot(u - s, v - t) > radius
        u, v = u[keep_these], v[keep_these]
    sigma = 0.3 * 2 / count**0.5
    points = surface(u, v) + sigma * generator.normal(size=(len(u), 3))
    outlying = generator.random(len(u)) < 0.01
    points[outlying] += 40 * sigma * (generator.random((outlying.sum(), 3)) - 0.5)
    return points


def mercator(columns: int) -> dict:
    """A mesh whose conformal map is known."""
    rows = columns * 3 // 4
    u, v = (part.ravel() for part in np.meshgrid(np.linspace(0, 1, columns), np.linspace(0, 1, rows)))
    longitude, latitude = 2 * u, 0.2 + 0.9 * v
    across = np.cos(latitude)
    points = np.column_stack([across * np.cos(longitude), across * np.sin(longitude), np.sin(latitude)])
    cell = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.column_stack([cell, cell + 1, cell + columns + 1])
    upper = np.column_stack([cell, cell + columns + 1, cell + columns])
    corners = [0, columns - 1, len(u) - 1, len(u) - columns]
    started = time.process_time()
    result = conformal(PointCloud(points, triangles=np.concatenate([lower, upper])), corners=corners)
    seconds = time.process_time() - started
    height = np.log(np.tan(np.pi / 4 + latitude / 2))
    known = np.column_stack([u, (height - height[0]) / (height[-1] - height[0])])
    return {
        "surface": "sphere (Mercator)",
        "cloud": "mesh",
        "points": len(points),
        "E_u E_v": result.certificate,
        "dilatation": result.dilatation.median,
        "95 %": result.dilatation.percentile_95,
        "largest error": float(np.abs(result.parameters - known).max()),
        "seconds": seconds,
    }


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
