"""Are edges kept, at equal noise, and does the linear filter let through what it says?

Steps of height 1 with white noise, at 0°, 17°, 45° and circular (the paper's Fig. 7), are filtered by tolerances of 1/2
to 1/64 of the step. Peers (Gaussian ISO 16610-61, spline ISO 16610-62, scikit-image's bilateral and total variation
filters) are tuned until they leave the same noise on the flats, the bilateral filter by its length, with a height width
of eight standard deviations of the noise. Width of the edge from 10 to 90 %, in pixels (0.8 is the least that an edge
between two rows of pixels has); overshoot of the mean profile; residual Sq within 20 pixels of the edge over that
elsewhere. A second table has the transmission of the linear filter beside its definition.
"""

import sys
import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from edges import Step, edge_width, noise_left, overshoot, steps, unevenness
from reporting import keep

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.filtration import bilateral_filter, spline_filter, total_variation_filter  # noqa: E402

TOLERANCES = (2, 4, 8, 16, 32, 64)
COMPARED = (2, 16, 64)  # of these, with peers tuned to the same noise
CUTOFF = 16.0


def main(size: str = "160", sigma: str = "0.005", halvings: str = "7") -> None:
    """Steps, then transmission, then speed."""
    rows = [
        row
        for step in steps(int(size), float(sigma))
        for parts in TOLERANCES
        for row in lines(step, parts, int(halvings))
    ]
    keep("filtration", rows, peers=("scikit-image",), sigma=float(sigma), size=int(size))
    keep("transmission", transmissions(), cutoff=CUTOFF)
    keep("filtration_speed", speeds(1000 if int(size) > 100 else 200))


def lines(step: Step, parts: int, halvings: int) -> list[dict[str, Any]]:
    """Ours at one tolerance, and every peer at the same noise."""
    started = time.perf_counter()
    ours = tsj.filter(step.height_map, tolerance=1 / parts)
    seconds = time.perf_counter() - started
    left = noise_left(step, ours.filtered.heights)
    shared = {"step": step.name, "tolerance": f"1/{parts}"}
    rows = [
        {**shared, "filter": "T-spline", **figures(step, ours.filtered.heights), "control points": ours.control_points}
        | {"met": ours.converged, "seconds": seconds}
    ]
    for name, make in peers(step).items() if parts in COMPARED else ():
        heights = tuned(step, make, left, halvings)
        if heights is not None:
            rows.append({**shared, "filter": name, **figures(step, heights)})
    print(*rows, sep="\n", file=sys.stderr, flush=True)
    return rows


def figures(step: Step, heights: np.ndarray) -> dict[str, float]:
    """What the heights are worth."""
    return {
        "width": edge_width(step, heights),
        "overshoot %": 100 * overshoot(step, heights),
        "noise left": noise_left(step, heights),
        "near / far": unevenness(step, heights),
    }


def peers(step: Step) -> dict[str, Callable[[tsj.HeightMap, float], np.ndarray]]:
    """Each peer with the one number that takes more and more noise off."""
    sigma = float(np.std(step.noise))
    return {
        "Gaussian": lambda data, x: tsj.s_filter(data, 2.0 * 64**x).heights,
        "spline 62": lambda data, x: spline_filter(data, 2.05 * 64**x).heights,
        "total variation": lambda data, x: total_variation_filter(data, weight=sigma * 10 ** (4 * x - 2)).heights,
        "bilateral": lambda data, x: (
            bilateral_filter(data, sigma_length=0.3 * 20**x, sigma_height=min(8 * sigma, 0.3)).heights
        ),
    }


def tuned(
    step: Step, make: Callable[[tsj.HeightMap, float], np.ndarray], left: float, halvings: int
) -> np.ndarray | None:
    """The peer's heights at this noise, found by halving; `None` where it cannot take as much off."""
    low, high = 0.0, 1.0
    best = None
    for _ in range(halvings):
        middle = (low + high) / 2
        heights = make(step.height_map, middle)
        if noise_left(step, heights) > left:
            low = middle
        else:
            high, best = middle, heights
    return best


def transmissions() -> list[dict[str, Any]]:
    """The linear filter's curve, on square and on oblong pixels."""
    rows = []
    lengths = CUTOFF * np.geomspace(0.25, 4, 9)
    for spacing in ((1.0, 1.0), (1.0, 1.6)):
        chosen = lengths[lengths >= 2 * max(spacing)]
        curve = tsj.transmission(
            lambda data: tsj.filter(data, cutoff=CUTOFF),
            chosen,
            spacing=spacing,
            unit="µm",
            directions=(0, 17, 45, 90),
            phases=8,
            margin=2 * CUTOFF,
        )
        for k, length in enumerate(curve.wavelengths):
            defined = 1 / (1 + (CUTOFF / length) ** 4)
            ratios = curve.ratios[0, k]
            rows.append(
                {
                    "spacing": f"{spacing[0]:g} × {spacing[1]:g}",
                    "wavelength / cut-off": length / CUTOFF,
                    "defined": defined,
                    "mean": float(ratios.mean()),
                    "largest deviation": float(np.abs(ratios - defined).max()),
                }
            )
    return rows


def speeds(size: int) -> list[dict[str, Any]]:
    """Seconds for a large map, first and second run."""
    data = tsj.HeightMap(np.random.default_rng(0).normal(size=(size, size)), 1.0, "µm")
    rows = []
    for cutoff in (8.0, 20.0, 80.0):
        seconds = []
        for _ in range(2):
            started = time.perf_counter()
            filtered = tsj.filter(data, cutoff=cutoff)
            seconds.append(time.perf_counter() - started)
        started = time.perf_counter()
        tsj.s_filter(data, cutoff)
        gaussian = time.perf_counter() - started
        rows.append(
            {
                "pixels": size**2,
                "cut-off (pixels)": cutoff,
                "control points": filtered.control_points,
                "first s": seconds[0],
                "second s": seconds[1],
                "Gaussian s": gaussian,
            }
        )
    return rows


if __name__ == "__main__":
    main(*sys.argv[1:])
