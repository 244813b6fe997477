"""Orthogonal distance fitting: what the texture of a saddle loses, exactness, adaptivity, and speed.

`python bench/bench_orthogonal.py [textures] [slips] [exact] [adaptive] [speed]`, all by default, keeps `orthogonal`
(the saddle of the paper's Fig. 6, by method), `orthogonal_slip` (the default slip on other forms), `orthogonal_exact`
(recovery of a known T-spline, iteration by iteration), `orthogonal_adaptive` (control points to a tolerance) and
`orthogonal_speed` (seconds an iteration, and foot points).
"""

import sys
import time

import jax
import numpy as np
from reporting import keep

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import saddle_with_texture  # noqa: E402
from tsplinejax.fitting import blending  # noqa: E402
from tsplinejax.mesh import b_lattice, refine  # noqa: E402
from tsplinejax.space import spline_space  # noqa: E402

METHODS = {
    "joint (default)": tsj.Joint(),
    "normal": tsj.Normal(),
    "parametric": tsj.Parametric(),
}
SADDLE = {"shape": (150, 150), "roughness": 0.033, "correlation_length": 0.045, "curvature": 1.5}


def lost_part(space, parameters, texture):
    """The projection of a texture onto what a space can follow along normals."""
    functions, values = (np.asarray(part) for part in blending(space, jax.numpy.asarray(parameters)))
    design = np.zeros((len(texture), int(space.n_functions)))
    design[np.arange(len(texture))[:, None], functions] = values
    return design @ np.linalg.lstsq(design, texture, rcond=None)[0]


def rms(values) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


def saddle(textures: int) -> None:
    """Texture error of each method over many textures, relative to the part that any method loses."""
    bare = saddle_with_texture(**SADDLE | {"roughness": 0.0}).points
    x, y = bare[:, 0], bare[:, 1]
    normal = np.stack([-3 * x, 3 * y, np.ones_like(x)], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    space = spline_space(b_lattice(3, 3))
    found = {name: [] for name in (*METHODS, "height")}
    losses = []
    for seed in range(textures):
        cloud = saddle_with_texture(**SADDLE, seed=seed)
        texture = np.sum((cloud.points - bare) * normal, axis=1)
        losses.append(rms(lost_part(space, (bare[:, :2] + 1) / 2, texture)))
        for name, method in METHODS.items():
            fit = tsj.fit_orthogonal(cloud, method=method)
            found[name].append((rms(fit.distances - texture), rms(fit.distances), rms(texture), fit.edf, fit.converged))
        places = cloud.samples().parameters
        vertical = cloud.points[:, 2] - tsj.make_surface(space, tsj.lstsq(space, places, cloud.points[:, 2]))(places)
        found["height"].append((rms(vertical - texture), rms(vertical), rms(texture), 36.0, True))
        done = {name: round(results[-1][0] / losses[-1], 4) for name, results in found.items()}
        print(f"texture {seed}: {done}", file=sys.stderr, flush=True)
    rows = []
    for name, results in found.items():
        error, sq, truth, edf, settled = np.array(results, float).T
        rows.append(
            {
                "method": name,
                "texture error": error.mean(),
                "over lost part": float(np.mean(error / losses)),
                "Sq": sq.mean(),
                "Sq over truth": float(np.mean(sq / truth)),
                "edf": edf.mean(),
                "settled": int(settled.sum()),
            }
        )
    keep(
        "orthogonal", rows, textures=textures, lost_part=float(np.mean(losses)), lost_part_spread=float(np.std(losses))
    )


def slips(size: float = 0.033) -> None:
    """Texture error over the lost part with the default slip, on forms bent in other ways."""
    generator = np.random.default_rng(0)
    x, y = generator.uniform(-1, 1, (2, 20_000))
    space = spline_space(b_lattice(3, 3))
    forms = {
        "sphere cap, R 1.6": (np.sqrt(1.6**2 - x**2 - y**2), 1.6),
        "cylinder, R 1.2": (np.sqrt(1.2**2 - x**2), 1.2),
    }
    rows = []
    for form, (z, radius) in forms.items():
        normal = np.stack([x, y if "sphere" in form else 0 * y, z], axis=1) / radius
        texture = _waves(x, y, size, generator)
        points = np.stack([x, y, z], axis=1) + texture[:, None] * normal
        lost = rms(lost_part(space, np.stack([(x + 1) / 2, (y + 1) / 2], axis=1), texture))
        for name, method in {**METHODS, "joint, slip 0.001": tsj.Joint(slip=0.001)}.items():
            fit = tsj.fit_orthogonal(points, method=method)
            error = rms(fit.distances - texture)
            rows.append({"form": form, "method": name, "over lost part": error / lost, "edf": fit.edf})
            print(rows[-1], file=sys.stderr, flush=True)
    keep("orthogonal_slip", rows, Sq=size)


def _waves(x, y, size, generator):
    """A Gaussian texture of random waves, correlation exp(-r² / 2 ℓ²) with ℓ = 0.045."""
    frequency = generator.normal(0, 1 / 0.045, (400, 2))
    phase = generator.uniform(0, 2 * np.pi, 400)
    total = np.zeros_like(x)
    for (a, b), shift in zip(frequency, phase, strict=True):
        total += np.cos(a * x + b * y + shift)
    return size * total / rms(total)


def exact() -> None:
    """Distances between a known T-spline and its recovery, iteration by iteration, without held slip."""
    import optimistix as optx

    space = spline_space(refine(b_lattice(3, 3), np.arange(9) == 4).mesh)
    places = np.random.default_rng(5).random((3000, 2))
    s, t = places.T
    shape = np.stack([2 * s + 0.1 * np.sin(3 * t), 1.5 * t + 0.1 * s * t, 0.4 * np.sin(3 * s) * np.cos(2 * t)], axis=1)
    truth = tsj.make_surface(space, tsj.lstsq(space, places, shape))
    points = np.asarray(truth(places))
    wrong = np.clip(places + 0.01 * np.sin(5 * places[:, ::-1]), 0, 1)
    method = tsj.Joint(slip=0.0, solver=optx.GaussNewton(rtol=1e-14, atol=1e-14))
    middle = np.linspace(0.02, 0.98, 30)
    grid = np.stack(np.meshgrid(middle, middle), axis=-1).reshape(-1, 2)
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    rows = []
    before = np.nan
    for count in range(1, 10):
        fit = tsj.fit_orthogonal(points, wrong, space=space, method=method, smoothing=0.0, max_iterations=count)
        apart = np.abs(np.asarray(tsj.project(fit.surface, np.asarray(truth(grid))).distances)).max()
        left = fit.rms_error / size
        rows.append(
            {
                "iterations": count,
                "between surfaces / size": float(apart) / size,
                "rms of points / size": left,
                "over the square of the one before": left / before**2,
            }
        )
        before = left
        print(rows[-1], file=sys.stderr, flush=True)
    keep("orthogonal_exact", rows, points=len(points), control_points=int(space.n_functions))


def adaptive(tolerance: float = 2e-3) -> None:
    """Control points of a freeform with a sharp local feature: refined, and by the smallest uniform lattice found."""
    x, y = np.random.default_rng(0).uniform(-1, 1, (2, 20_000))
    bump = 0.1 * np.exp(-((x - 0.3) ** 2 + (y - 0.2) ** 2) / 0.06**2)
    points = np.column_stack([x, y, 0.3 * x**2 - 0.2 * x * y + bump])
    fit = tsj.fit_orthogonal(points, tolerance=tolerance)
    rows = [{"space": "refined", "control points": fit.control_points, "max error": fit.max_error}]
    for elements in (12, 16, 20, 24, 28, 32, 36, 40, 48):
        lattice = tsj.fit_orthogonal(points, lattice=(elements, elements), method=tsj.Parametric())
        row = {"space": f"{elements} × {elements}", "control points": (elements + 3) ** 2}
        rows.append(row | {"max error": lattice.max_error})
        print(rows[-1], file=sys.stderr, flush=True)
        if lattice.max_error <= tolerance:
            break
    ratio = fit.control_points / rows[-1]["control points"]
    keep("orthogonal_adaptive", rows, tolerance=tolerance, refined_over_uniform=ratio, stop=str(fit.stop))


def speed() -> None:
    """Seconds a warm iteration of the joint fit over 400 control points, and of foot points."""
    from tsplinejax.orthogonal._descent import minimise
    from tsplinejax.orthogonal._prepare import parametric, pose, read_request
    from tsplinejax.orthogonal._round import beginning

    space = spline_space(b_lattice(17, 17))
    rows = []
    for m in (10_000, 100_000, 1_000_000):
        x, y = np.random.default_rng(0).uniform(-1, 1, (2, m))
        points = np.column_stack([x, y, 0.5 * (x**2 - y**2) + 0.01 * np.sin(40 * x) * np.sin(37 * y)])
        request = read_request(points, None)
        surface = parametric(space, request, request.parameters, request.weights, 1e-9)
        extent = request.frame.extent
        problem = pose(surface, request.scaled, request.weights, request.parameters, tsj.Joint(), 1e-9, extent)
        start = beginning(problem, request.parameters)
        minimise(problem, start, None, 1)
        seconds = {}
        for steps in (1, 4):
            began = time.perf_counter()
            minimise(problem, start, None, steps)
            seconds[steps] = time.perf_counter() - began
        tsj.project(surface, request.scaled)
        began = time.perf_counter()
        jax.block_until_ready(tsj.project(surface, request.scaled).distances)
        feet = time.perf_counter() - began
        rows.append({"points": m, "s an iteration": (seconds[4] - seconds[1]) / 3, "foot points s": feet})
        print(rows[-1], file=sys.stderr, flush=True)
    keep("orthogonal_speed", rows, control_points=int(space.n_functions))


PARTS = {"slips": slips, "exact": exact, "adaptive": adaptive, "speed": speed}

if __name__ == "__main__":
    wanted = sys.argv[1:] or ["20", *PARTS]
    for word in wanted:
        PARTS[word]() if word in PARTS else saddle(int(word))
