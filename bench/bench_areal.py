"""Areal parameters beside two peers', what missing pixels do to them, and the time for 10⁷ pixels.

Peers: the difference from surfalize's value on complete maps, and the largest from SurfaceTopography's. Bias: the
change of each parameter when a fifth of a surface is hidden: pixels at random, or the steepest ones, as an optical
instrument loses flanks. Both in % of the value; in thousandths for Ssk, Sku and Str, in degrees for Std; nothing where
one of the two is not defined or the value is zero.

surfalize (GPL-3) is no dependency of this project, and without it its columns are empty. To compare, install it beside:
`pip install --target DIRECTORY surfalize`, then run with DIRECTORY appended to PYTHONPATH.

    python bench/bench_areal.py [peers] [bias] [time]
"""

import sys
import time
import warnings
from typing import Any

import jax
import numpy as np
from reporting import keep

jax.config.update("jax_enable_x64", True)

from tsplinejax import ArealParameters, HeightMap, areal_parameters  # noqa: E402
from tsplinejax.data import laser_textured_disk  # noqa: E402

HIDDEN = 0.2
PIXELS = (3125, 3200)
REPEATS = 3
#: Parameters whose change is told in their own measure, times the factor: zero is no reference.
ABSOLUTE = {"Ssk": 1000, "Sku": 1000, "Str": 1000, "Std": 1}
IN = {"Ssk": "1/1000", "Sku": "1/1000", "Str": "1/1000", "Std": "°"}


def random_field(shape: tuple[int, int] = (1000, 800), length: float = 6.0, seed: int = 0) -> HeightMap:
    """A Gaussian field with the autocorrelation exp(-r² / 2 ℓ²), ℓ in µm, on pixels of 0.5 µm."""
    return HeightMap(gaussian_field(shape, (length / 0.5, length / 0.5), seed), (0.5, 0.5), "µm")


def gaussian_field(shape: tuple[int, int], lengths: tuple[float, float], seed: int) -> np.ndarray:
    """A Gaussian field of unit variance whose correlation falls as exp(-x² / 2 a² - y² / 2 b²), a and b in pixels."""
    margin = [int(8 * length) for length in lengths[::-1]]
    size = [count + more for count, more in zip(shape, margin, strict=True)]
    rows, columns = (np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])[None])
    filtered = np.exp(-((np.pi * lengths[0] * columns) ** 2) - (np.pi * lengths[1] * rows) ** 2)
    noise = np.random.default_rng(seed).normal(size=size)
    field = np.fft.irfft2(np.fft.rfft2(noise) * filtered, s=size)[: shape[0], : shape[1]]
    return 0.3 * field * 2 * np.sqrt(np.pi * lengths[0] * lengths[1])


def surfaces() -> dict[str, HeightMap]:
    """Waves in one direction, isotropic and anisotropic random fields, plateaus with pits, laser texture."""
    x, y = 0.5 * np.arange(800), 0.5 * np.arange(1000)[:, None]
    turned = np.cos(0.5) * x + np.sin(0.5) * y
    plateau = np.minimum(random_field(seed=1).heights, 0.1) + 0.02 * random_field(length=1.5, seed=2).heights
    return {
        "sine waves": HeightMap(0.4 * np.sin(2 * np.pi * turned / 20), (0.5, 0.5), "µm"),
        "random field": random_field(),
        "anisotropic field": HeightMap(gaussian_field((1000, 800), (8.0, 30.0), 3), (0.5, 0.5), "µm"),
        "plateaus": HeightMap(plateau, (0.5, 0.5), "µm"),
        "laser texture": HeightMap(laser_textured_disk().heights, (0.5, 0.5), "µm"),
    }


def hidden_at_random(surface: HeightMap) -> HeightMap:
    """A fifth of the pixels missing, at random."""
    return surface.with_mask(np.random.default_rng(5).random(surface.shape) < HIDDEN)


def hidden_on_flanks(surface: HeightMap) -> HeightMap:
    """The steepest fifth of the pixels missing."""
    dx, dy = surface.spacing
    slope = np.hypot(*np.gradient(surface.heights, dy, dx))
    return surface.with_mask(slope > np.quantile(slope, 1 - HIDDEN))


def surfalize_values(surface: HeightMap) -> dict[str, float]:
    """The parameters by surfalize; none where it is not installed. Its lengths are in µm."""
    try:
        from surfalize import Surface
    except ImportError:
        return {}
    dx, dy = surface.spacing
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Str of grooves
        peer = Surface(np.array(surface.heights), dx, dy)
        found = {name: getattr(peer, name)() for name in peer_names(peer)}
        # Heights in surfalize's curve are the map's own, not about the mean.
        return {**found, "Smr": peer.Smr(surface.heights.mean()), "Smc": peer.Smc(10) - surface.heights.mean()}


def peer_names(peer: Any) -> list[str]:
    """Parameters that take no argument."""
    return [name for name in ArealParameters.__annotations__ if hasattr(peer, name) and name not in ("Smr", "Smc")]


def surface_topography_values(surface: HeightMap) -> dict[str, float]:
    """Sq and the gradient by SurfaceTopography, whose axis 0 is x."""
    from SurfaceTopography import Topography

    size = tuple(count * step for count, step in zip(surface.shape[::-1], surface.spacing, strict=True))
    peer = Topography(surface.heights.T, physical_sizes=size, unit="um")
    return {"Sq": peer.rms_height_from_area(), "Sdq": peer.rms_gradient()}


def change(name: str, value: float, reference: float) -> float | None:
    """By how much a value differs from another, in the measure of the table; nothing where either is undefined."""
    if name in ABSOLUTE:
        change = ABSOLUTE[name] * (value - reference)
        change = (change + 90) % 180 - 90 if name == "Std" else change
    elif value == reference:
        change = 0.0
    else:
        change = 100 * (value - reference) / abs(reference) if reference else np.nan
    return None if np.isnan(change) else float(change)


def peer_columns(complete: dict[str, tuple[HeightMap, dict[str, float]]]) -> dict[str, dict[str, float | None]]:
    """Columns of the peers' table: from surfalize on each surface, the largest from SurfaceTopography."""
    columns = {name: changes(ours, surfalize_values(surface)) for name, (surface, ours) in complete.items()}
    if not any(columns.values()):
        print("surfalize is not installed: its columns are empty; the script's first lines say how to install it")
    others = [changes(ours, surface_topography_values(surface)) for surface, ours in complete.values()]
    largest = {name: max((other[name] or 0.0 for other in others), key=abs) for name in others[0]}
    return {**columns, "SurfaceTopography, largest": largest}


def bias_columns(complete: dict[str, tuple[HeightMap, dict[str, float]]]) -> dict[str, dict[str, float | None]]:
    """Columns of the table of bias: the change of each parameter, for each surface and way of hiding a fifth of it."""
    ways = {"at random": hidden_at_random, "steepest": hidden_on_flanks}
    return {
        f"{name}, {way}": changes(areal_parameters(hide(surface)).values, ours)
        for name, (surface, ours) in complete.items()
        for way, hide in ways.items()
    }


def changes(values: dict[str, float], references: dict[str, float]) -> dict[str, float | None]:
    """By how much values differ from those references that there are."""
    return {name: change(name, values[name], reference) for name, reference in references.items()}


def rows(columns: dict[str, dict[str, float | None]], names: list[str]) -> list[dict[str, Any]]:
    """A row for each parameter; what is no more than rounding is zero."""
    return [
        {
            "parameter": name,
            "in": IN.get(name, "%"),
            **{key: rounded(cells.get(name)) for key, cells in columns.items()},
        }
        for name in names
    ]


def rounded(value: float | None) -> float | None:
    """The value, or zero if it is rounding."""
    return 0.0 if value is not None and abs(value) < 1e-6 else value


def seconds() -> float:
    """Processor seconds of the quickest of several runs on one large map, compiled before; all cores together."""
    surface = HeightMap(np.random.default_rng(0).normal(size=PIXELS), (1.0, 1.0), "µm")
    areal_parameters(surface)
    times = []
    for _ in range(REPEATS):
        start = time.process_time()
        areal_parameters(surface)
        times.append(time.process_time() - start)
    return min(times)


def main() -> None:
    """The parts that are named on the command line, or all."""
    parts = sys.argv[1:] or ["peers", "bias", "time"]
    if "time" in parts:
        keep("areal_time", [{"pixels": PIXELS[0] * PIXELS[1], "processor seconds": seconds()}])
    if not {"peers", "bias"} & set(parts):
        return
    complete = {name: (surface, areal_parameters(surface).values) for name, surface in surfaces().items()}
    names = list(next(iter(complete.values()))[1])
    if "peers" in parts:
        keep("areal_peers", rows(peer_columns(complete), names), peers=("surfalize", "SurfaceTopography"))
    if "bias" in parts:
        keep("areal", rows(bias_columns(complete), names))


if __name__ == "__main__":
    main()
