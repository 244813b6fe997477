"""Orthogonal distance fitting: what the texture of a saddle loses, exactness, adaptivity, and speed.

`python bench/bench_orthogonal.py [textures]` keeps four results: `orthogonal` (the saddle of the paper's Fig. 6, by
method), `orthogonal_slip` (the default slip on other forms), `orthogonal_exact` (recovery of a known T-spline,
iteration by iteration) and `orthogonal_speed` (seconds an iteration, and foot points).
"""

import sys

import jax
import numpy as np
from reporting import keep

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import saddle_with_texture  # noqa: E402
from tsplinejax.fitting import blending  # noqa: E402
from tsplinejax.mesh import b_lattice  # noqa: E402
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


if __name__ == "__main__":
    saddle(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
