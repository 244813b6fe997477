"""At equal sample size, how much smaller is the error of a surface recovered from samples that know the T-mesh?

Each surface is fitted to 2 % of its range first, and that T-mesh is known to all. The truth is the fitted T-spline
("model", as in the paper's Fig. 10); the surface that was fitted, measured without noise wherever a strategy wants
("surface"); or a measured map, whose pixels are the samples ("pixels"). Every strategy is reconstructed over the T-mesh
with automatic smoothing. The usual ones (uniform grid, random, Halton, Latin hypercube, curvature-weighted with two
weights, and Wang's element-area and element-curvature sampling) are also reconstructed by cubic triangles, thin-plate
radial functions and, on a grid, the bicubic spline; what is best counts. Ours are Greville, Greville + centres,
Greville-refined, adaptive and T-patch, even and random. Adaptive sampling chooses among pixels by their heights: of a
measured map, and where the truth is the surface of the map that the model was fitted to; the others know that map by
its model. Greville-refined and adaptive bring finer T-meshes of their own; what Wang's samples make of these is told
apart. Errors are rms, in % of the range; those below 10⁻¹⁰ % are round-off, and called exact
(0). The face is Fig. 1c: 1 000 of its 2 205 points, judged at the others.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from peers import radial, triangulated
from reporting import keep
from surfaces import SHARED, measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import laser_textured_disk, plate_with_particles, sparse_bumps  # noqa: E402
from tsplinejax.sampling import Curvature  # noqa: E402

SURFACES: dict[str, Callable[[int], tsj.HeightMap]] = {
    "T1, one bump": lambda size: laser_textured_disk((size, size), bumps=1, scale=3.0),
    "T2, 12 particles": lambda size: plate_with_particles((size, size), particles=12),
    "T6, a quarter": lambda size: sparse_bumps((2 * size, 2 * size)).crop(0.0, 0.0, 0.5, 0.5),
}
OURS = ("greville", "greville-centres", "greville-refined", "adaptive", "t-patch", "t-patch-random")
USUAL = {
    **{name: name for name in ("uniform", "random", "halton", "latin-hypercube", "element-area", "element-curvature")},
    "curvature 0.5": Curvature(0.5),
    "curvature 0.9": Curvature(0.9),
}
KNOW_THE_MESH = ("element-area", "element-curvature")
BRING_A_MESH = ("greville-refined", "adaptive")
ON_OURS = {f"{name} on ours": name for name in KNOW_THE_MESH}
JUDGED = 5_000
EXACT = 1e-10  # %
FINER = 4  # the surface between its pixels: a bicubic spline through a map so many times as fine

Truth = Callable[[np.ndarray], np.ndarray]


def main(size: str = "256", shares: str = "1.2,2,4") -> None:
    """Every surface, truth and size."""
    lines: list[dict[str, Any]] = []
    details: list[dict[str, Any]] = []
    exact: list[dict[str, Any]] = []
    if (SHARED / "face_fran_cut.ply").exists():
        keep("sampling_face", face())
    for name, make in SURFACES.items():
        data = make(int(size))
        model = tsj.fit(data, relative_tolerance=0.02).surface
        exact.append({"surface": name, **recovered(model)})
        keep("sampling_exact", exact)
        truths = (("model", _of_model(model), None), ("surface", _of_surface(make(FINER * int(size)), model), data))
        for kind, truth, known in truths:
            for share in map(float, shares.split(",")):
                add(lines, details, (name, kind, share), model, errors_of(model, truth, share, known))
    for name, data in measured(("tmd-1.tmd",)):
        part = tsj.HeightMap(data.heights[: int(size), : int(size)], data.spacing, data.unit)
        model = tsj.fit(part).surface
        for share in map(float, shares.split(",")):
            add(lines, details, (name, "pixels", share), model, errors_of(model, part, share, part))


def _of_model(model: tsj.TSpline) -> Truth:
    return lambda places: np.asarray(model(places))


def _of_surface(fine: tsj.HeightMap, model: tsj.TSpline) -> Truth:
    """The surface at any place of the model's frame, from a much finer map."""
    from scipy.interpolate import RectBivariateSpline

    rows, columns = fine.shape
    y, x = fine.origin[1] + fine.spacing[1] * np.arange(rows), fine.origin[0] + fine.spacing[0] * np.arange(columns)
    spline = RectBivariateSpline(y, x, fine.heights)

    def heights(places: np.ndarray) -> np.ndarray:
        at = model.frame.xy_of(places)
        return spline(at[:, 1], at[:, 0], grid=False)

    return heights


def errors_of(
    model: tsj.TSpline, truth: Truth | tsj.HeightMap, share: float, known: tsj.HeightMap | None
) -> dict[str, float]:
    """The rms error of every strategy in % of the range, by the best of its reconstructions.

    Without a map that is known the truth is the model, which finer meshes add nothing to.
    """
    number = round(share * int(model.space.n_functions))
    places, values = _judged(truth)
    spread = float(np.ptp(values))
    errors: dict[str, float] = {}
    lent: list[tsj.TSpline] = []
    for name in (*OURS, *USUAL):
        parameters, heights, space = _sampled(model, truth, USUAL.get(name, name), number, known)
        lent += [space] if name in BRING_A_MESH else []
        found = [_over(space, parameters, heights, places, values)]
        if name in KNOW_THE_MESH and known is not None:
            on_ours = min(_over(finer, parameters, heights, places, values) for finer in lent)
            errors[f"{name} on ours"] = 100 * on_ours / spread
        if name in USUAL:
            found += _interpolated(parameters * model.frame.extent, heights, places * model.frame.extent, values)
        if name == "uniform":
            found += _bicubic(number, model, truth, places, values)
        errors[name] = 100 * min(found) / spread
    return errors


def _judged(truth: Truth | tsj.HeightMap) -> tuple[np.ndarray, np.ndarray]:
    """Places all over the surface, and what is true there."""
    rng = np.random.default_rng(1)
    if isinstance(truth, tsj.HeightMap):
        samples = truth.samples()
        chosen = rng.permutation(len(samples))[:JUDGED]
        return samples.parameters[chosen], samples.values[chosen, 0].astype(float)
    places = rng.random((JUDGED, 2))
    return places, truth(places)


def _sampled(
    model: tsj.TSpline, truth: Truth | tsj.HeightMap, strategy: Any, number: int, known: tsj.HeightMap | None
) -> tuple[np.ndarray, np.ndarray, tsj.TSpline]:
    """Places, true values there, and the model over the mesh they are meant for."""
    if isinstance(truth, tsj.HeightMap):
        samples = tsj.sample(truth, model=model, strategy=strategy, size=number)
        return samples.parameters, samples.values[:, 0].astype(float), samples.model
    if known is not None and strategy == "adaptive":
        samples = tsj.sample(known, model=model, strategy=strategy, size=number)
    else:
        samples = tsj.sample(model, strategy=strategy, size=number)
    return samples.parameters, truth(samples.parameters), samples.model


def _over(
    space: tsj.TSpline, parameters: np.ndarray, heights: np.ndarray, places: np.ndarray, values: np.ndarray
) -> float:
    """The error of our reconstruction over a space."""
    return _rms(np.asarray(tsj.reconstruct((parameters, heights), space).surface(places)), values)


def _interpolated(at: np.ndarray, heights: np.ndarray, to: np.ndarray, values: np.ndarray) -> list[float]:
    """Errors of the interpolants that scattered samples usually go to; beyond their hull the nearest one counts."""
    from scipy.interpolate import NearestNDInterpolator

    scale = np.abs(to).max()
    at, to = at / scale, to / scale
    cubic = np.asarray(triangulated(at, heights, to[:8]).evaluate(to))
    beyond = np.isnan(cubic)
    if beyond.any():
        cubic[beyond] = NearestNDInterpolator(at, heights)(to[beyond])
    smooth = np.asarray(radial(at, heights, to[:8]).evaluate(to))
    return [_rms(cubic, values), _rms(smooth, values)]


def _bicubic(
    number: int, model: tsj.TSpline, truth: Truth | tsj.HeightMap, places: np.ndarray, values: np.ndarray
) -> list[float]:
    """The bicubic spline through a true grid of at most so many samples."""
    from scipy.interpolate import RectBivariateSpline

    width, height = model.frame.extent
    rows = int(np.sqrt(number * height / width))
    s, t = np.linspace(0, 1, number // rows), np.linspace(0, 1, rows)
    if isinstance(truth, tsj.HeightMap):  # the nearest rows and columns of pixels
        i, j = (np.unique(np.rint(along * (n - 1)).astype(int)) for along, n in zip((t, s), truth.shape, strict=True))
        heights = truth.heights[np.ix_(i, j)]
        if np.isnan(heights).any():
            return []
        s, t = j / (truth.shape[1] - 1), i / (truth.shape[0] - 1)
    else:
        heights = truth(np.stack(np.meshgrid(s, t), axis=-1).reshape(-1, 2)).reshape(len(t), len(s))
    return [_rms(RectBivariateSpline(t, s, heights)(places[:, 1], places[:, 0], grid=False), values)]


def _rms(reached: np.ndarray, values: np.ndarray) -> float:
    return float(np.sqrt(np.mean((reached - values) ** 2)))


def add(
    lines: list[dict[str, Any]],
    details: list[dict[str, Any]],
    where: tuple[str, str, float],
    model: tsj.TSpline,
    errors: dict[str, float],
) -> None:
    """The best of ours beside the best of the usual, and all of them."""
    errors = {name: error if error > EXACT else 0.0 for name, error in errors.items()}
    blind = [name for name in USUAL if name not in KNOW_THE_MESH]
    ours, usual, unaware = (min(names, key=errors.__getitem__) for names in (OURS, USUAL, blind))
    lent = min((errors[name] for name in ON_OURS if name in errors), default=None)
    case = dict(zip(("surface", "truth", "samples / control point"), where, strict=True))
    lines.append(
        {
            **case,
            "control points": int(model.space.n_functions),
            "ours": ours,
            "error %": errors[ours],
            "best usual": usual,
            "its error %": errors[usual],
            "ours / usual": errors[ours] / errors[usual] if errors[usual] else None,
            "best without the mesh": unaware,
            "ours / it": errors[ours] / errors[unaware] if errors[unaware] else None,
            "ours / Wang on our meshes": errors[ours] / lent if lent else None,
        }
    )
    details.append({**case, **errors})
    # Case by case: what is done is kept, whatever comes after it.
    keep("sampling", lines)
    keep("sampling_strategies", details)


def recovered(model: tsj.TSpline) -> dict[str, Any]:
    """From Greville's own number of samples: the largest error of a control point, and the seconds it takes."""
    started = time.perf_counter()
    samples = tsj.sample(model)
    sampled = time.perf_counter()
    result = tsj.reconstruct(samples)
    seconds = time.perf_counter() - sampled
    points = np.asarray(model.control_points)
    return {
        "samples": len(samples),
        "control points": len(points),
        "largest error / range": float(np.abs(result.surface.control_points - points).max() / np.ptp(points)),
        "noise gain": result.noise_gain,
        "seconds to sample": sampled - started,
        "seconds to reconstruct": seconds,
    }


def face(size: int = 1000) -> list[dict[str, Any]]:
    """Fig. 1c, for models of several tolerances; of random samples the median of five draws."""
    cloud = tsj.read(SHARED / "face_fran_cut.ply")
    assert isinstance(cloud, tsj.PointCloud)
    place = tsj.conformal(cloud)
    every = tsj.Samples(place.parameters, cloud.points, None, place.frame)
    rows = []
    for tolerance in (0.02, 0.01, 0.005):
        model = tsj.fit(every, relative_tolerance=tolerance).surface
        found = {
            name: float(np.median([_at_others(every, model, name, size, seed) for seed in range(seeds)]))
            for name, seeds in (("adaptive", 1), ("greville", 1), ("t-patch", 1), ("halton", 5), ("random", 5))
        }
        rows.append(
            {
                "tolerance %": 100 * tolerance,
                "control points": int(model.space.n_functions),
                **{f"{name}: rms at the others": error for name, error in found.items()},
                "adaptive / random": found["adaptive"] / found["random"],
            }
        )
    return rows


def _at_others(every: tsj.Samples, model: Any, strategy: str, size: int, seed: int) -> float:
    samples = tsj.sample(every, model=model, strategy=strategy, size=size, rng=seed)
    reached = np.asarray(tsj.reconstruct(samples).surface(every.parameters))
    errors = np.delete(np.linalg.norm(reached - every.values, axis=1), samples.index)
    return float(np.sqrt(np.mean(errors**2)))


if __name__ == "__main__":
    main(*sys.argv[1:])
