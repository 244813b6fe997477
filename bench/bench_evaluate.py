"""Nanoseconds a point of evaluation, next to scipy's tensor-product splines with as many control points.

A T-spline with about 20 000 control points, refined along a ring, against `RectBivariateSpline.ev` and `NdBSpline` over
a uniform grid, at random parameters and at a raster of them, element lookup included. All are built from the same
function, and the largest error at the random parameters stands beside the time.

    python bench/bench_evaluate.py [POINTS [CONTROL_POINTS [REPEATS]]]
"""

import sys
import time
from collections.abc import Callable, Iterator

import jax
import numpy as np
from reporting import keep
from scipy.interpolate import NdBSpline, RectBivariateSpline

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.mesh import b_lattice, refine  # noqa: E402
from tsplinejax.space import spline_space  # noqa: E402
from tsplinejax.surface import make_surface  # noqa: E402

CENTRE, RADIUS, WIDTH = (0.4, 0.5), 0.3, 0.01
START = 8


def main(points: int = 10**7, control_points: int = 20_000, repeats: int = 3) -> None:
    """All evaluators at random parameters and at a raster."""
    side = int(np.sqrt(points))
    axis = np.linspace(0, 1, side)
    raster = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    random = np.random.default_rng(0).random((side * side, 2))
    rows = []
    evaluators = list(peers_and_us(control_points))
    for order, places in (("random", random), ("raster", raster)):
        slowest = None
        for name, count, evaluate in evaluators:
            seconds = min(timed(evaluate, places) for _ in range(repeats))
            error = float(np.abs(np.asarray(evaluate(random)) - ring(*random.T)).max())
            slowest = seconds if slowest is None else slowest
            rows.append(
                {
                    "evaluator": name,
                    "parameters": order,
                    "control points": count,
                    "ns a point": seconds / len(places) * 1e9,
                    "times as fast as ev": slowest / seconds,
                    "largest error": error,
                }
            )
    keep("evaluate", rows, points=side * side, repeats=repeats, dtype="float64")


def peers_and_us(control_points: int) -> Iterator[tuple[str, int, Callable[[np.ndarray], np.ndarray | jax.Array]]]:
    """Name, number of control points and evaluator of each, scipy's first."""
    side = round(np.sqrt(control_points))
    axis = np.linspace(0, 1, side)
    uniform = RectBivariateSpline(axis, axis, ring(axis[:, None], axis[None, :]))
    yield "RectBivariateSpline.ev", side * side, lambda places: uniform.ev(places[:, 0], places[:, 1])
    tensor = NdBSpline(tuple(uniform.tck[:2]), np.reshape(uniform.tck[2], (side, side)), 3)
    yield "NdBSpline", side * side, tensor
    surface = t_spline(control_points)
    count = surface.control_points.shape[0]
    yield "TSpline", count, lambda places: surface(places).block_until_ready()
    single = make_surface(spline_space(surface.space.mesh, dtype="float32"), surface.control_points)
    yield "TSpline, float32", count, lambda places: single(places).block_until_ready()


def ring(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """A narrow step around a circle, on a wave."""
    return np.tanh((np.hypot(s - CENTRE[0], t - CENTRE[1]) - RADIUS) / WIDTH) + 0.3 * np.sin(5 * s) * np.cos(3 * t)


def t_spline(control_points: int) -> tsj.TSpline:
    """The least-squares T-spline over a mesh that is refined where the ring is."""
    tmesh = b_lattice(START, START)
    while tmesh.n_anchors < control_points:
        s0, t0, s1, t1 = tmesh.element_boxes.T
        beyond = np.abs(np.hypot((s0 + s1) / 2 - CENTRE[0], (t0 + t1) / 2 - CENTRE[1]) - RADIUS)
        urgency = (s1 - s0) * (t1 - t0) / (beyond + WIDTH) ** 2
        chosen = min(len(s0), max(1, (control_points - tmesh.n_anchors) // 2))
        tmesh = refine(tmesh, urgency >= np.sort(urgency)[-chosen]).mesh
    space = spline_space(tmesh)
    # Sixteen places an element: no control point goes without.
    corners, sizes = tmesh.element_boxes[:, None, :2], np.diff(tmesh.element_boxes.reshape(-1, 2, 2), axis=1)
    inside = np.stack(np.meshgrid(*[np.arange(4) / 4 + 0.125] * 2), axis=-1).reshape(1, -1, 2)
    places = (corners + inside * sizes).reshape(-1, 2)
    return make_surface(space, tsj.lstsq(space, places, ring(*places.T)))


def timed(evaluate: Callable[[np.ndarray], object], places: np.ndarray) -> float:
    """Seconds of one call."""
    started = time.perf_counter()
    evaluate(places)
    return time.perf_counter() - started


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
