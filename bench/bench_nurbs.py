"""T-splines against NURBS at equal control points, and control points at an equal error.

At about 16 000 control points: the rms error of the fit with a budget, and of the best uniform cubic lattice of any
side ratio with at most as many coefficients. On a plate with particles (T2), and on structured freeforms (points in
space over a common parameterisation: a saddle with 15, and with 60, sharp-edged pillars along its normals; the more of
the surface is edge, the less is left to save). All weights of the NURBS are one: free weights make the fit non-linear,
and nobody's software for measured surfaces fits them. Then the fewest control points that keep sparse bumps (T6) and
the laser-textured disk (T1) within 0.1 % of the range (the paper's Fig. 3).
"""

import sys
from collections.abc import Callable, Iterator

import jax
import numpy as np
from peers import uniform_separable
from reporting import keep
from surfaces import case_study

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402

BUDGET = 16_000
RATIOS = np.geomspace(1 / 4, 4, 17)  # of a lattice's sides
FINE = 0.0005  # of the range: below what the budget can reach, so that the budget ends the fit
LEAST_ERROR = 0.001


def main(size: int = 512, budget: int = BUDGET) -> None:
    """Both comparisons on grids of size × size samples."""
    rows = list(_at_equal_control_points(size, budget))
    keep("nurbs", rows, asked_rms_over_uniform=0.25)
    keep("nurbs_error", list(_at_equal_error(size)), asked_control_points_over_uniform=0.25)


def structured_freeform(size: int, pillars: int) -> np.ndarray:
    """Points (size, size, 3) of a saddle with pillars of 0.04 along its normals, whose edges are 1.5 samples wide."""
    rng = np.random.default_rng(5)
    places = np.linspace(-1, 1, size)
    x, y = np.meshgrid(places, places)
    z, slope_x, slope_y = 0.3 * (x**2 - y**2), 0.6 * x, -0.6 * y
    height, width = np.zeros_like(x), 1.5 * 2 / size
    for _ in range(pillars):
        centre, radius, angle = rng.uniform(-0.95, 0.95, 2), rng.uniform(0.02, 0.08), rng.uniform(0, np.pi)
        across = np.cos(angle) * (x - centre[0]) + np.sin(angle) * (y - centre[1])
        along = np.cos(angle) * (y - centre[1]) - np.sin(angle) * (x - centre[0])
        distance = np.hypot(across, 1.5 * along) - radius
        height = np.maximum(height, 0.04 / (1 + np.exp(np.clip(distance / (width / 4), -60, 60))))
    normal = np.stack([-slope_x, -slope_y, np.ones_like(x)]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    return np.moveaxis(np.stack([x, y, z]) + height * normal, 0, -1)


def _at_equal_control_points(size: int, budget: int) -> Iterator[dict]:
    """A row for each surface and method."""
    plate = case_study("T2", size).heights[..., None]
    freeforms = {f"freeform with {n} pillars": structured_freeform(size, n) for n in (15, 60)}
    for name, values in {"T2": plate, **freeforms}.items():
        samples = _grid_samples(values)
        result = tsj.fit(samples, relative_tolerance=FINE, max_control_points=budget)
        reference, lattice = _best_uniform(values, budget)
        for method, points, errors, remark in (
            ("tsplinejax", result.control_points, np.asarray(result.residuals), result.stop),
            ("best uniform NURBS", (lattice[0] + 3) * (lattice[1] + 3), reference, f"{lattice[0]} × {lattice[1]}"),
        ):
            distance = np.linalg.norm(errors.reshape(-1, values.shape[-1]), axis=1)
            rms = float(np.sqrt(np.mean(distance**2)))
            row = {"surface": name, "method": method, "control points": points, "rms %": 100 * rms / result.range}
            row |= {"max %": 100 * float(distance.max()) / result.range, "remark": str(remark)}
            row["rms over uniform"] = rms / float(np.sqrt(np.mean(np.sum(reference**2, axis=-1))))
            print(row, file=sys.stderr)
            yield row


def _grid_samples(values: np.ndarray) -> tsj.Samples:
    """Samples of a grid of values (rows, columns, d) over the unit square."""
    places = [np.linspace(0, 1, length) for length in values.shape[1::-1]]
    parameters = np.stack(np.meshgrid(*places), axis=-1).reshape(-1, 2)
    shape = values.shape[:2]
    return tsj.Samples(
        parameters, values.reshape(-1, values.shape[-1]), grid_shape=shape, grid_index=np.arange(parameters.shape[0])
    )


def _uniform_errors(values: np.ndarray, lattice: tuple[int, int]) -> np.ndarray:
    """Errors (rows, columns, d) of the least-squares fit over a uniform lattice."""
    places = [np.linspace(0, 1, length) for length in values.shape[1::-1]]
    parameters = np.stack(np.meshgrid(*places, indexing="ij"), axis=-1)
    parts = (uniform_separable(part, lattice).evaluate(parameters).T for part in np.moveaxis(values, -1, 0))
    return values - np.stack(list(parts), axis=-1)


def _best_uniform(values: np.ndarray, budget: int) -> tuple[np.ndarray, tuple[int, int]]:
    """Errors and lattice of the least rms error among lattices of all side ratios within the budget."""
    best, chosen = None, (0, 0)
    for ratio in RATIOS:
        across = int(np.sqrt(budget * ratio)) - 3
        lattice = across, budget // (across + 3) - 3
        errors = _uniform_errors(values, lattice)
        if best is None or np.sum(errors**2) < np.sum(best**2):
            best, chosen = errors, lattice
    assert best is not None
    return best, chosen


def _at_equal_error(size: int) -> Iterator[dict]:
    """Control points that keep every error within a share of the range."""
    for name in ("T6", "T1"):
        height_map = case_study(name, size)
        limit = LEAST_ERROR * height_map.range
        result = tsj.fit(height_map, tolerance=limit)
        side = _smallest(lambda m, h=height_map.heights, e=limit: _within(h, (m, m), e), size)
        points = (side + 3) ** 2
        row = {"surface": name, "max error %": 100 * LEAST_ERROR, "tsplinejax": result.control_points}
        row |= {"reached %": 100 * result.max_error / height_map.range, "best uniform NURBS": points}
        yield row | {"over uniform": result.control_points / points}


def _within(heights: np.ndarray, lattice: tuple[int, int], limit: float) -> bool:
    return bool(np.abs(_uniform_errors(heights[..., None], lattice)).max() <= limit)


def _smallest(holds: Callable[[int], bool], size: int) -> int:
    """The smallest square lattice, to two elements, that holds."""
    return next(side for side in range(16, size - 3, 2) if holds(side))


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:]))
