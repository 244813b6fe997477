"""Do bands add up, are they orthogonal, and does each hold the waves it says?

Peaks with noise (the paper's Fig. 8), the same with a hole, and measured surfaces, in uniform and adaptive bands:
how far the sum of the bands is from the fitted surface, and a band from its transfer to the next space, relative to the
range; the leak |Sq² - Σ Sq_k²| / Sq²; and how high a band but the first gets anywhere, in holes, too. A second table
has a long and a short sine, and the part of the energy of each in the band whose wavelengths hold its own, over the
number of periods: borders take a part of it.
"""

import sys
import time
from typing import Any

import jax
import numpy as np
from reporting import keep
from surfaces import measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import peaks  # noqa: E402


def main(size: str = "256") -> None:
    """Bands, then sines."""
    side = int(size)
    noisy = peaks((side, side), noise=0.02)
    hole = np.zeros(noisy.shape, bool)
    hole[side // 3 : side // 2, side // 4 : side // 2] = True
    rows = []
    for name, data in (("Peaks", noisy), ("Peaks with a hole", noisy.with_mask(hole)), *reduced()):
        rows.append(bands(name, "uniform", data))
        rows.append(bands(name, "adaptive", data, relative_tolerance=0.08))
    keep("multiresolution", rows)
    keep("multiresolution_sines", sines(side))


def reduced() -> list[tuple[str, tsj.HeightMap]]:
    """Measured maps, thinned to at most 200 pixels a side."""
    maps = []
    for name, data in measured(("mnt-2.mnt", "frt-1.frt", "sur-2.sur")):
        every = -(-max(data.shape) // 200)
        spacing = (every * data.spacing[0], every * data.spacing[1])
        maps.append((f"{name}, each {every}th", tsj.HeightMap(data.heights[::every, ::every], spacing, data.unit)))
    return maps


def bands(name: str, way: str, data: tsj.HeightMap, **options: Any) -> dict[str, Any]:
    """One analysis' line."""
    started = time.perf_counter()
    found = tsj.mra(data, **options)
    seconds = time.perf_counter() - started
    places = np.random.default_rng(0).random((2000, 2))
    off = [
        float(
            np.abs(
                np.asarray(tsj.transfer(band.surface, finer.surface.space.mesh)(places) - band.surface(places))
            ).max()
        )
        for band, finer in zip(found.bands, found.bands[1:], strict=False)
    ]
    highest = [float(np.abs(np.asarray(band.surface(places))).max()) for band in found.bands[1:]]
    line = {
        "surface": name,
        "meshes": way,
        "bands": len(found),
        "control points": len(found.surface.control_points),
        "sum off / range": float(np.nanmax(np.abs(found.heights.sum(axis=0) - found.fitted.heights))) / data.range,
        "nesting off / range": max(off, default=0.0) / data.range,
        "leak": found.leak,
        "highest / range": max(highest, default=0.0) / data.range,
        "Sq remainder / range": found.sq_remainder / data.range,
        "seconds": seconds,
    }
    print(line, file=sys.stderr, flush=True)
    return line


def sines(side: int) -> list[dict[str, Any]]:
    """A long sine along x and a short one, of a length in the middle of a band: the last one, or with a finer one."""
    rows = []
    x = np.arange(side) / (side - 1)
    long = np.sin(2 * np.pi * x + 0.3)
    for k, elements in enumerate((24, 48, 96), start=3):
        periods = elements / 2.83  # the middle of 2 h to 4 h
        for levels in (k + 1, k + 2):
            shares = []
            for phase in np.pi * np.arange(8) / 4:
                wave = 0.2 * np.sin(2 * np.pi * periods * x + phase)
                found = tsj.mra(tsj.HeightMap((wave + long) * np.ones((side, 1)), 1 / (side - 1), "mm"), levels=levels)
                shares.append((_share(found.heights[k][0], wave), _share(found.heights[0][0], long)))
            mean, least = np.mean(shares, axis=0), np.min(shares, axis=0)
            rows.append(
                {
                    "short wave: periods": periods,
                    "band from": found.bands[k].shortest,
                    "to": found.bands[k].longest,
                    "finer bands": levels - k - 1,
                    "its energy there": mean[0],
                    "least over phases": least[0],
                    "long wave: band from": found.bands[0].shortest,
                    "its energy in it": mean[1],
                }
            )
    return rows


def _share(part: np.ndarray, wave: np.ndarray) -> float:
    centred = wave - wave.mean()
    return float(part @ centred / (centred @ centred))


if __name__ == "__main__":
    main(*sys.argv[1:])
