"""Is the texture of a freeform found again: on a saddle, on a scanned artefact, and on measured surfaces?

The saddle has a known texture of Sq 0.033 along its normals; the artefact is a cloud of 10⁵ points with three holes,
displaced points and dust, tool marks of Sq 0.139 mm, in any pose, one half twice as dense. What is lost of the saddle's
texture is what looks like form; the paper's own figures for both are in its Fig. 6.
"""

import sys
import time
from typing import Any

import jax
import numpy as np
from reporting import keep
from scipy.spatial.transform import Rotation
from surfaces import measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import freeform_artefact, saddle_with_texture  # noqa: E402

TURN = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()


def main(points: str = "120000", saddle: str = "150") -> None:
    """Remove the form of every surface."""
    rows = [*saddles(int(saddle)), *artefacts(int(points)), *real()]
    keep("form", rows)


def saddles(count: int) -> list[dict[str, Any]]:
    """The saddle, in every way."""
    cloud = saddle_with_texture((count, count))
    form = saddle_with_texture((count, count), roughness=0.0).points
    normals = np.column_stack([-3 * form[:, 0], 3 * form[:, 1], np.ones(len(form))])
    true = np.einsum("mi,mi->m", cloud.points - form, normals / np.linalg.norm(normals, axis=1, keepdims=True))
    ways = ("height", "parametric", "normal", "joint")
    return [row("saddle", way, cloud, true, np.ones(len(true)), method=way) for way in ways]


def artefacts(count: int) -> list[dict[str, Any]]:
    """The artefact: as it lies and turned, even and twice as dense on one half, planar and conformal."""
    rows = []
    for label, density, pose, options in (
        ("planar", 2.0, None, {}),
        ("planar, turned", 2.0, TURN, {}),
        ("planar, even", 1.0, TURN, {}),
        ("conformal, turned", 2.0, TURN, {"parameters": "conformal"}),
    ):
        shared: dict[str, Any] = {"points": count, "density": density}
        clean = freeform_artefact(**shared, outliers=0).points
        form = freeform_artefact(**shared, outliers=0, roughness=0)
        offsets = clean - form.points
        true = np.linalg.norm(offsets, axis=1) * np.sign(offsets[:, 2])
        weights = np.where(form.points[:, 0] > 0, 1 / density, 1.0)
        scan = freeform_artefact(**shared, rotation=pose, shift=(0, 0, 0) if pose is None else (100, -50, 20))
        up = (0, 0, 1) if pose is None else TURN[:, 2]
        rows.append(row("artefact", label, scan, true, weights, robust=True, outward=up, **options))
    return rows


def real() -> list[dict[str, Any]]:
    """The polished dome, where it is there."""
    rows = []
    for name, data in measured():
        if name.startswith("mnt-2"):
            every = tsj.HeightMap(data.heights[::3, ::3], tuple(3 * step for step in data.spacing), data.unit)
            for form in (None, "sphere", "poly2"):
                rows.append(row(f"{name}, each 3rd", form or "T-spline", every, None, None, robust=True, form=form))
    return rows


def row(
    surface: str, way: str, data: Any, true: np.ndarray | None, weights: np.ndarray | None, **options: Any
) -> dict[str, Any]:
    """One removal's line."""
    started = time.perf_counter()
    removal = tsj.remove_form(data, **options)
    seconds = time.perf_counter() - started
    line = {
        "surface": surface,
        "way": way,
        "samples": len(removal.texture),
        "Sq": removal.sq_texture,
        "edf": removal.edf,
        "set aside": int(removal.outliers.sum()),
    }
    if true is not None and weights is not None:
        kept = ~removal.outliers
        weights = weights / weights.sum()
        truth = float(np.sqrt(weights @ (true - weights @ true) ** 2))
        line |= {
            "Sq off %": 100 * (removal.sq_texture / truth - 1),
            "texture error": float(np.sqrt(np.mean((removal.texture - true)[kept] ** 2))),
            "absorbed (estimate)": float(np.sqrt(removal.absorbed_share) * removal.sq_texture),
            "correlation": float(np.corrcoef(removal.texture[kept], true[kept])[0, 1]),
        }
    print({**line, "seconds": seconds}, file=sys.stderr, flush=True)
    return {**line, "seconds": seconds}


if __name__ == "__main__":
    main(*sys.argv[1:])
