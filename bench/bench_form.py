"""Is the texture of a freeform found again: on a saddle, on a scanned artefact, and on measured surfaces?

`python bench/bench_form.py [model] [saddle] [artefact] [measured]`, all by default, keeps `form_model` (the paper's
Fig. 1a: one spline of 7 × 7 control points through a steep freeform, fitted in height and by orthogonal distance, both
judged by the distances along normals), `form_saddle` and `form_artefact` (its Fig. 6, the figures it prints beside
ours), and `form_measured` (a polished dome and a patch of a turbine blade, where they are there). The saddle has a
known texture of Sq 0.033 along its normals; the artefact is a cloud of 10⁵ points with three holes, displaced points
and dust, tool marks of Sq 0.139 mm, in any pose, one half twice as dense.
"""

import sys
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from reporting import keep
from scipy.spatial.transform import Rotation
from sheets import BLADE, blade_patch
from surfaces import measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import freeform_artefact, saddle_with_texture  # noqa: E402

TURN = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
POINTS = 120_000


def model(count: int = 90) -> list[dict[str, Any]]:
    """One model, fitted in two ways to a freeform with a steep flank: what is left along the normals."""
    y, x = np.meshgrid(*2 * [np.linspace(-1, 1, count)], indexing="ij")
    height = 0.6 * np.tanh(4 * (x + 0.3 * np.sin(2 * y))) + 0.2 * y**2
    points = np.column_stack([part.ravel() for part in (x, y, height)])
    rows = []
    for way, options in {
        "in height": {"method": "height"},
        "by orthogonal distance, slip held": {},
        "by orthogonal distance, free": {"method": tsj.Joint(slip=0.001)},
        "the same over conformal parameters": {"method": tsj.Joint(slip=0.001), "parameters": "conformal"},
    }.items():
        removal = tsj.remove_form(points, lattice=(4, 4), **options)
        left = np.asarray(tsj.project(removal.form, points).distances)
        rows.append(
            {
                "fitted": way,
                "control points": removal.control_points,
                "rms along normals": float(np.sqrt(np.mean(left**2))),
                "largest": float(np.abs(left).max()),
            }
        )
        print(rows[-1], file=sys.stderr, flush=True)
    return rows


def saddle(count: int = 150) -> Iterator[dict[str, Any]]:
    """The saddle, in every way; the paper's are the ordinary fit, and the parametric one over conformal parameters."""
    cloud = saddle_with_texture((count, count))
    form = saddle_with_texture((count, count), roughness=0.0).points
    normals = np.column_stack([-3 * form[:, 0], 3 * form[:, 1], np.ones(len(form))])
    true = np.einsum("mi,mi->m", cloud.points - form, normals / np.linalg.norm(normals, axis=1, keepdims=True))
    for way, quoted, options in (
        ("height", 0.062, {}),
        ("parametric, conformal", 0.032, {"method": "parametric", "parameters": "conformal"}),
        ("parametric", None, {}),
        ("normal", None, {}),
        ("joint", None, {}),
        ("joint, conformal", None, {"method": "joint", "parameters": "conformal"}),
    ):
        yield row("saddle", way, cloud, (true, np.ones(len(true))), quoted, **{"method": way, **options})


def artefact(count: int = POINTS) -> Iterator[dict[str, Any]]:
    """The artefact: as it lies and turned, even and twice as dense on one half, planar and conformal."""
    for way, density, pose, options in (
        ("planar, even, as it lies", 1.0, None, {}),
        ("planar, even, turned", 1.0, TURN, {}),
        ("planar, one half denser, turned", 2.0, TURN, {}),
        ("conformal, one half denser, turned", 2.0, TURN, {"parameters": "conformal"}),
    ):
        shared: dict[str, Any] = {"points": count, "density": density}
        form = freeform_artefact(**shared, outliers=0, roughness=0)
        offsets = freeform_artefact(**shared, outliers=0).points - form.points
        true = np.linalg.norm(offsets, axis=1) * np.sign(offsets[:, 2])
        weights = np.where(form.points[:, 0] > 0, 1 / density, 1.0)
        scan = freeform_artefact(**shared, rotation=pose, shift=(0, 0, 0) if pose is None else (100, -50, 20))
        up = (0, 0, 1) if pose is None else TURN[:, 2]
        yield row("artefact", way, scan, (true, weights), 0.139, robust=True, outward=up, **options)


def on_measured() -> Iterator[dict[str, Any]]:
    """The polished dome and a patch of the turbine blade, where they are there."""
    for name, data in measured(("mnt-2.mnt",)):
        every = tsj.HeightMap(data.heights[::6, ::6], tuple(6 * step for step in data.spacing), data.unit)
        for form in (None, "sphere", "poly2"):
            yield row(f"{name}, each 6th", form or "joint", every, None, None, robust=True, form=form)
    if BLADE.is_file():
        patch = blade_patch()
        for way, options in {"joint, planar": {}, "joint, conformal": {"parameters": "conformal"}}.items():
            yield row("turbineblade.ply, a patch", way, patch, None, None, **options)


def row(
    surface: str,
    way: str,
    data: Any,
    truth: tuple[np.ndarray, np.ndarray] | None,
    quoted: float | None,
    **options: Any,
) -> dict[str, Any]:
    """One removal's line; `truth` is the texture that was put in, and the area of each sample."""
    removal = tsj.remove_form(data, **options)
    line = {
        "surface": surface,
        "way": way,
        "samples": len(removal.texture),
        "Sq": removal.sq_texture,
        "the paper's": quoted,
    }
    if truth is not None:
        true, weights = truth[0], truth[1] / truth[1].sum()
        kept = ~removal.outliers
        put_in = float(np.sqrt(weights @ (true - weights @ true) ** 2))
        line |= {
            "Sq off %": 100 * (removal.sq_texture / put_in - 1),
            "texture error": float(np.sqrt(np.mean((removal.texture - true)[kept] ** 2))),
            "correlation": float(np.corrcoef(removal.texture[kept], true[kept])[0, 1]),
        }
    line |= {
        "absorbed (estimate)": float(np.sqrt(removal.absorbed_share) * removal.sq_texture),
        "edf": removal.edf,
        "E_u E_v": removal.conformality,
        "set aside": int(removal.outliers.sum()),
        "unit": removal.unit,
    }
    print(line, file=sys.stderr, flush=True)
    return line


PARTS = {"model": model, "saddle": saddle, "artefact": artefact, "measured": on_measured}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        keep(f"form_{part}", list(PARTS[part]()))
