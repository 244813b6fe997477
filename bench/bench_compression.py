"""Bytes at a checked largest error, beside SZ3, SPERR, ZFP, LERC, JPEG 2000, JPEG XL and zstd of the rounded heights.

    python bench/bench_compression.py [SURFACE ...]

Every peer gets the missing pixels filled with the nearest valid height, and its bytes do not count the mask, which
favours the peers; ours count mask and header. A peer that breaks the bound shows its error instead of its bytes. SZ3 is
the better of its default and its interpolation predictor in absolute-bound mode.
"""

import sys
import time
from collections.abc import Callable, Iterator
from importlib import import_module
from types import ModuleType
from typing import Any

import jax
import numpy as np
from reporting import keep
from surfaces import case_study, jacksboro, measured

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.codec import compressed_header  # noqa: E402

CURVE, SHORT = (3.0, 1.0, 0.3, 0.1, 0.03, 0.01), (1.0, 0.1)
Coded = tuple[int, np.ndarray]


def main(*only: str) -> None:
    """All surfaces, or those named."""
    rows = []
    for name, data, shares in surfaces():
        if only and name not in only:
            continue
        for share in shares:
            rows.append(row(name, data, share))
            print(rows[-1], file=sys.stderr, flush=True)
    keep("compression" if not only else "compression_part", rows, peers=("constriction", "pysz", "imagecodecs"))


def surfaces() -> Iterator[tuple[str, tsj.HeightMap, tuple[float, ...]]]:
    """Case studies with the whole curve, the noisy plate and the measured maps at two bounds."""
    for name in ("T6", "T2", "T1"):
        yield name, case_study(name), CURVE
    clean = case_study("T2").heights
    noise = np.random.default_rng(5).normal(0, 0.01 * np.ptp(clean), clean.shape)
    yield "T2n", tsj.HeightMap(clean + noise), SHORT
    for name, data in [*measured(), ("jacksboro", jacksboro())]:
        yield name, data, SHORT


def row(name: str, data: tsj.HeightMap, share: float) -> dict[str, Any]:
    """One map at one bound (in % of its range)."""
    bound = share / 100 * data.range
    started = time.perf_counter()
    content = tsj.compress(data, max_error=bound)
    seconds = time.perf_counter() - started
    header, heights = compressed_header(content), tsj.decompress(content).heights
    line = {
        "map": name,
        "bound %": share,
        "bytes": len(content),
        "mode": header.mode,
        "control points": None if header.model is None else header.model.control_points,
        "error / bound": float(np.nanmax(np.abs(heights - data.heights))) / bound,
        "seconds": seconds,
    }
    filled = _filled(data)
    for peer, code in PEERS.items():
        line[peer] = _peer(code, filled, bound)
    line["ratio to SZ3"] = len(content) / line["SZ3"] if isinstance(line["SZ3"], int) else None
    return line


def _filled(data: tsj.HeightMap) -> np.ndarray:
    """Heights in float64 with the nearest valid one where pixels are missing."""
    from scipy.ndimage import distance_transform_edt

    heights = data.heights.astype(np.float64)
    if data.valid.all():
        return heights
    nearest = distance_transform_edt(~data.valid, return_distances=False, return_indices=True)
    return np.ascontiguousarray(heights[tuple(nearest)])


def _peer(code: Callable[[np.ndarray, float], Coded], heights: np.ndarray, bound: float) -> int | str:
    """A peer's bytes, or why there are none."""
    try:
        size, decoded = code(heights, bound)
    except ImportError:
        return "not installed"
    except Exception as error:  # peers answer maps they cannot code in ways of their own
        return f"failed: {type(error).__name__}"
    worst = float(np.abs(decoded - heights).max())
    # A rounding of the peer's own arithmetic is let through.
    return size if worst <= bound * (1 + 1e-9) else f"error {worst / bound:.3g} bounds"


def _sz3(heights: np.ndarray, bound: float) -> Coded:
    pysz = import_module("pysz")
    best: Coded | None = None
    for algorithm in (pysz.szAlgorithm.INTERP_LORENZO, pysz.szAlgorithm.INTERP):
        config = pysz.szConfig(heights.shape)
        config.errorBoundMode, config.absErrorBound = pysz.szErrorBoundMode.ABS, bound
        config.cmprAlgo = algorithm
        coded, _ = pysz.sz.compress(heights, config)
        decoded, _ = pysz.sz.decompress(coded, np.float64, heights.shape)
        if best is None or coded.nbytes < best[0]:
            best = coded.nbytes, decoded
    assert best is not None
    return best


def _codecs() -> ModuleType:
    return import_module("imagecodecs")


def _sperr(heights: np.ndarray, bound: float) -> Coded:
    coded = _codecs().sperr_encode(heights, bound, mode="pwe")
    return len(coded), _codecs().sperr_decode(coded)


def _zfp(heights: np.ndarray, bound: float) -> Coded:
    coded = _codecs().zfp_encode(heights, level=bound, mode="a")
    return len(coded), _codecs().zfp_decode(coded)


def _lerc(heights: np.ndarray, bound: float) -> Coded:
    coded = _codecs().lerc_encode(heights, level=bound)
    return len(coded), _codecs().lerc_decode(coded)


def _rounded(encode: Callable, decode: Callable) -> Callable[[np.ndarray, float], Coded]:
    """A lossless coder of the heights rounded to steps of twice the bound."""

    def code(heights: np.ndarray, bound: float) -> Coded:
        step, low = 2 * bound * (1 - 1e-12), heights.min()
        whole = np.rint((heights - low) / step).astype(np.uint16)
        coded = encode(_codecs(), whole)
        return len(coded), decode(_codecs(), coded, whole) * step + low

    return code


PEERS: dict[str, Callable[[np.ndarray, float], Coded]] = {
    "SZ3": _sz3,
    "SPERR": _sperr,
    "ZFP": _zfp,
    "LERC": _lerc,
    "JPEG 2000": _rounded(
        lambda c, whole: c.jpeg2k_encode(whole, level=0, reversible=True), lambda c, coded, _: c.jpeg2k_decode(coded)
    ),
    "JPEG XL": _rounded(
        lambda c, whole: c.jpegxl_encode(whole, lossless=True, effort=9), lambda c, coded, _: c.jpegxl_decode(coded)
    ),
    "zstd": _rounded(
        lambda c, whole: c.zstd_encode(whole.tobytes(), level=19),
        lambda c, coded, whole: np.frombuffer(c.zstd_decode(coded), np.uint16).reshape(whole.shape),
    ),
}


if __name__ == "__main__":
    main(*sys.argv[1:])
