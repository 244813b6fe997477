"""Are holes filled nearer to the truth than by others, and how far off is what the method says of itself?

Real maps of which every pixel was measured get holes of four kinds: random pixels, round blobs, scratches, and dropouts
where the surface is steep, as optical instruments leave them. The pillars of T4 miss a fifth in blobs at edges and
centres (the paper's Fig. 9). Errors are rms over the holes, as shares of the map's range. `ratio` is ours over the best
of the peers, which all see the same pixels: scikit-image's biharmonic inpainting, scipy's linear griddata, its
thin-plate splines among neighbours, and multilevel B-splines. `validated` is the error that the method expects from the
patches it hides, `covered` the share of true errors within twice its standard uncertainty (95 % is right). surfalize's
own fill is scipy's nearest neighbour or linear interpolation, the columns of those names.
"""

import sys
import time
from typing import Any

import jax
import numpy as np
from fillers import PEERS
from reporting import keep
from surfaces import case_study, measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402


def main(side: str = "128", pillars: str = "512") -> None:
    """Fill every map's holes of every kind, and T4's."""
    keep("filling", [*real(int(side))], peers=("scikit-image",))
    keep("filling_pillars", [*structured(int(pillars))], peers=("scikit-image",))


def real(side: int) -> Any:
    """A square part of every measured map, with every kind of hole."""
    for name, data in measured():
        whole = complete_part(data, side)
        if whole is None:
            continue
        for kind, missing in holes(whole).items():
            yield row(name, kind, whole, missing, {})


def structured(side: int) -> Any:
    """T4, filled in each way."""
    partial = case_study("T4", side)
    whole = tsj.HeightMap(tsj.data.structured_with_missing((side, side), missing=0).heights, partial.spacing)
    for label, options in (("default", {}), ("edges", {"edges": True})):
        yield row("T4", label, whole, ~partial.valid, {"border": True, **options})


def complete_part(data: tsj.HeightMap, side: int) -> tsj.HeightMap | None:
    """The square of pixels without a missing one that is nearest the middle."""
    invalid = np.pad(np.cumsum(np.cumsum(~data.valid, axis=0), axis=1), ((1, 0), (1, 0)))
    counts = invalid[side:, side:] - invalid[:-side, side:] - invalid[side:, :-side] + invalid[:-side, :-side]
    corners = np.argwhere(counts == 0)
    if not len(corners):
        return None
    middle = (np.array(data.shape) - side) / 2
    i, j = corners[np.argmin(np.abs(corners - middle).max(axis=1))]
    return tsj.HeightMap(data.heights[i : i + side, j : j + side].astype(float), data.spacing, data.unit)


def holes(whole: tsj.HeightMap) -> dict[str, np.ndarray]:
    """Four kinds of holes, with a measured rim around them."""
    from scipy.ndimage import binary_opening, gaussian_filter

    rng, shape = np.random.default_rng(7), whole.shape
    i, j = np.indices(shape)
    inner = np.zeros(shape, bool)
    inner[3:-3, 3:-3] = True
    blobs, scratches = np.zeros(shape, bool), np.zeros(shape, bool)
    for _ in range(18):
        radius, centre = rng.uniform(3, 11), rng.uniform(0, 1, 2) * shape
        blobs |= np.hypot(i - centre[0], j - centre[1]) < radius
    for _ in range(10):
        angle, offset, width = rng.uniform(0, np.pi), rng.uniform(-0.4, 0.4) * shape[0], rng.uniform(1, 3)
        along = (i - shape[0] / 2) * np.cos(angle) + (j - shape[1] / 2) * np.sin(angle) - offset
        scratches |= np.abs(along) < width
    smooth = gaussian_filter(whole.heights, 2)
    slope = np.hypot(*np.gradient(smooth, *whole.spacing[::-1]))
    steep = binary_opening(gaussian_filter(slope, 1) > np.quantile(slope, 0.88), np.ones((3, 3)))
    return {
        "random pixels": (rng.random(shape) < 0.2) & inner,
        "blobs": blobs & inner,
        "scratches": scratches & inner,
        "steep": steep & inner,
    }


def row(name: str, kind: str, whole: tsj.HeightMap, missing: np.ndarray, options: dict[str, Any]) -> dict[str, Any]:
    """Ours beside the peers on one map with holes."""
    truth, spread = whole.heights[missing], whole.range
    partial = whole.with_mask(missing)
    others = {}
    for peer, fill in PEERS.items():
        others[peer] = float(np.sqrt(np.mean((fill(partial.heights, whole.spacing) - truth) ** 2))) / spread
    started = time.perf_counter()
    filled = tsj.fill_missing(partial, **options)
    seconds = time.perf_counter() - started
    errors = filled.map.heights[missing] - truth
    ours = float(np.sqrt(np.mean(errors**2))) / spread
    overshoot = max(
        filled.map.heights[missing].max() - whole.heights.max(), whole.heights.min() - filled.map.heights[missing].min()
    )
    line = {
        "surface": name,
        "holes": kind,
        "missing %": 100 * float(missing.mean()),
        "ours": ours,
        **others,
        "ratio": ours / min(others.values()),
        "validated": filled.validated_rms / spread,
        "covered %": 100 * float(np.mean(np.abs(errors) <= 2 * filled.uncertainty[missing])),
        "overshoot %": 100 * max(float(overshoot), 0.0) / spread,
        "mostly": max(filled.weights, key=filled.weights.__getitem__),
        "seconds": seconds,
    }
    print({key: f"{value:.3g}" if isinstance(value, float) else value for key, value in line.items()}, file=sys.stderr)
    return line


if __name__ == "__main__":
    main(*sys.argv[1:])
