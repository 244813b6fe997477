"""At equal sample size, how much smaller is the error of a surface recovered from samples that know the T-mesh?

Structured surfaces and a measured map, each fitted to 1 % of its range first; that T-mesh is known to all. Truth is the
fitted T-spline ("model", as in the paper's Fig. 10) or the map itself ("map": samples are its pixels, and the fit's own
error is the least that any sampling can reach). Every strategy is reconstructed over the T-mesh with automatic smoothing;
the usual strategies (uniform grid, random, Halton, Latin hypercube, curvature-weighted with two weights, and Wang's
element-area and element-curvature sampling) also by bicubic spline (grids), cubic triangles and thin-plate radial
functions, and the better counts. Ours are Greville, Greville + centres and T-patch, uniform and random. Errors are rms, in
% of the range; errors below 10⁻¹² of it are called exact. The face is Fig. 1c: 1 000 of its 2 205 points, judged at the
others.
"""

import sys
import time
from typing import Any

import jax
import numpy as np
from peers import radial, triangulated
from reporting import keep
from surfaces import SHARED, case_study, measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.sampling import Adaptive, Curvature, Greville, Random  # noqa: E402

OURS = {name: name for name in ("greville", "greville-centres", "t-patch", "t-patch-random")}
USUAL = {
    **{name: name for name in ("uniform", "random", "halton", "latin-hypercube", "element-area", "element-curvature")},
    "curvature 0.5": Curvature(0.5),
    "curvature 0.9": Curvature(0.9),
}
KNOW_THE_MESH = ("element-area", "element-curvature")
JUDGED = 20_000
EXACT = 1e-12


def main(size: str = "256", shares: str = "1.2,2,3,4") -> None:
    """Every surface, truth and size."""
    lines, details = [], []
    for name, data in surfaces(int(size)):
        model = tsj.fit(data, relative_tolerance=0.01).surface
        for truth in ("model", "map"):
            for share in map(float, shares.split(",")):
                errors = compared(data, model, truth, share)
                lines.append(line(name, truth, share, model, errors))
                print(lines[-1], file=sys.stderr, flush=True)
                details.append({"surface": name, "truth": truth, "samples / control point": share, **errors})
    keep("sampling", lines)
    keep("sampling_strategies", details)
    keep("sampling_exact", exact(int(size)))
    if (SHARED / "face_fran_cut.ply").exists():
        keep("sampling_face", face())


def surfaces(size: int) -> list[tuple[str, tsj.HeightMap]]:
    """The structured ones, and a measured one."""
    found = [(name, case_study(name, size)) for name in ("T1", "T2", "T6")]
    for name, data in measured(("tmd-1.tmd",)):
        found.append((name, tsj.HeightMap(data.heights[:size, :size], data.spacing, data.unit)))
    return found


def compared(data: tsj.HeightMap, model: tsj.TSpline, truth: str, share: float) -> dict[str, float]:
    """The rms error of every strategy in % of the range, by the better of its reconstructions."""
    source, known = (model, None) if truth == "model" else (data, model)
    places, values = judged(data, model, truth)
    spread = float(np.ptp(values))
    number = round(share * int(model.space.n_functions))
    errors = {}
    for name, strategy in {**OURS, **USUAL}.items():
        samples = tsj.sample(source, model=known, strategy=strategy, size=number)
        found = [rms(np.asarray(tsj.reconstruct(samples).surface(places)), values)]
        if name in USUAL:
            found += interpolated(name, samples, source, known, places, values)
        errors[name] = 100 * min(found) / spread
    return errors


def judged(data: tsj.HeightMap, model: tsj.TSpline, truth: str) -> tuple[np.ndarray, np.ndarray]:
    """Places all over the surface, and what is true there."""
    rng = np.random.default_rng(1)
    if truth == "model":
        places = rng.random((JUDGED, 2))
        return places, np.asarray(model(places))
    samples = data.samples()
    chosen = rng.permutation(len(samples))[:JUDGED]
    return samples.parameters[chosen], samples.values[chosen, 0]


def interpolated(name: str, samples: Any, source: Any, known: Any, places: np.ndarray, values: np.ndarray) -> list[float]:
    """Errors of the interpolants that such samples usually go to."""
    at, heights = scaled(samples.parameters, samples), samples.values[:, 0]
    to = scaled(places, samples)
    cubic = np.asarray(triangulated(at, heights, to).evaluate(to))
    beyond = np.isnan(cubic)
    if beyond.any():  # outside the samples' hull
        from scipy.interpolate import NearestNDInterpolator

        cubic[beyond] = NearestNDInterpolator(at, heights)(to[beyond])
    smooth = np.asarray(radial(at, heights, to).evaluate(to))
    found = [rms(cubic, values), rms(smooth, values)]
    return [*found, bicubic(len(samples), source, known, places, values)] if name == "uniform" else found


def bicubic(number: int, source: Any, known: Any, places: np.ndarray, values: np.ndarray) -> float:
    """The bicubic spline through a true grid of at most so many samples."""
    from scipy.interpolate import RectBivariateSpline

    model = source if known is None else known
    width, height = model.frame.extent
    rows = int(np.sqrt(number * height / width))
    columns = number // rows
    s, t = np.linspace(0, 1, columns), np.linspace(0, 1, rows)
    if known is None:
        grid = np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)
        heights = np.asarray(model(grid)).reshape(rows, columns)
    else:  # the nearest rows and columns of pixels
        i, j = (np.unique(np.rint(along * (n - 1)).astype(int)) for along, n in zip((t, s), source.shape, strict=True))
        heights, s, t = source.heights[np.ix_(i, j)], j / (source.shape[1] - 1), i / (source.shape[0] - 1)
    return rms(RectBivariateSpline(t, s, heights)(places[:, 1], places[:, 0], grid=False), values)


def scaled(places: np.ndarray, samples: Any) -> np.ndarray:
    """Places in physical proportion, which interpolants need."""
    return places * samples.model.frame.extent / max(samples.model.frame.extent)


def rms(reached: np.ndarray, values: np.ndarray) -> float:
    """Root-mean-square error."""
    return float(np.sqrt(np.mean((reached - values) ** 2)))


def line(name: str, truth: str, share: float, model: tsj.TSpline, errors: dict[str, float]) -> dict[str, Any]:
    """The best of ours beside the best of the usual."""
    ours, usual, blind = (
        min(names, key=errors.__getitem__) for names in (OURS, USUAL, [k for k in USUAL if k not in KNOW_THE_MESH])
    )
    least = 100 * EXACT
    return {
        "surface": name,
        "truth": truth,
        "control points": int(model.space.n_functions),
        "samples / control point": share,
        "ours": ours,
        "error %": errors[ours] if errors[ours] > least else 0.0,
        "best usual": usual,
        "its error %": errors[usual] if errors[usual] > least else 0.0,
        "ratio": errors[ours] / errors[usual] if errors[usual] > least else None,
        "best without the mesh": blind,
        "ratio to it": errors[ours] / errors[blind] if errors[blind] > least else None,
    }


def exact(size: int) -> list[dict[str, Any]]:
    """Greville's own number of samples: the largest error, and the seconds it takes."""
    rows = []
    for name in ("T1", "T2", "T6"):
        model = tsj.fit(case_study(name, size), relative_tolerance=0.01).surface
        started = time.perf_counter()
        samples = tsj.sample(model)
        sampled = time.perf_counter()
        result = tsj.reconstruct(samples)
        seconds = time.perf_counter() - sampled
        points = np.asarray(model.control_points)
        rows.append(
            {
                "surface": name,
                "samples": len(samples),
                "control points": len(points),
                "largest error / range": float(np.abs(result.surface.control_points - points).max() / np.ptp(points)),
                "noise gain": result.noise_gain,
                "seconds to sample": sampled - started,
                "seconds to reconstruct": seconds,
            }
        )
    return rows


def face(size: int = 1000) -> list[dict[str, Any]]:
    """Fig. 1c, for models of several tolerances."""
    cloud = tsj.read(SHARED / "face_fran_cut.ply")
    assert isinstance(cloud, tsj.PointCloud)
    place = tsj.conformal(cloud)
    every = tsj.Samples(place.parameters, cloud.points, None, place.frame)
    rows = []
    for tolerance in (0.02, 0.01, 0.005):
        model = tsj.fit(every, relative_tolerance=tolerance).surface
        found: dict[str, Any] = {}
        for name, strategy in {"adaptive": Adaptive(), "greville": Greville(), "random": Random()}.items():
            seeds = range(5) if name == "random" else range(1)
            found[name] = float(np.median([_at_others(cloud, every, model, strategy, size, seed) for seed in seeds]))
        rows.append(
            {
                "tolerance %": 100 * tolerance,
                "control points": int(model.space.n_functions),
                **{f"{name}: rms at the others": error for name, error in found.items()},
                "adaptive / random": found["adaptive"] / found["random"],
            }
        )
    return rows


def _at_others(cloud: tsj.PointCloud, every: tsj.Samples, model: Any, strategy: Any, size: int, seed: int) -> float:
    samples = tsj.sample(every, model=model, strategy=strategy, size=size, rng=seed)
    reached = np.asarray(tsj.reconstruct(samples).surface(every.parameters))
    errors = np.delete(np.linalg.norm(reached - cloud.points, axis=1), samples.index)
    return float(np.sqrt(np.mean(errors**2)))


if __name__ == "__main__":
    main(*sys.argv[1:])
