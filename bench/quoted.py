"""Figures of peers that are not run here, as measured once on the same surfaces; rows that quote them say so.

GoTools 3547095a (LR B-splines, own driver after its PointCloud2LR), G+Smo (pygismo 26.9.0, gsHFitting's loop driven
from Python, cubic), MBA (ddemidov/mba eee21059); the best of several settings of each; CPU seconds of one thread on a
contended machine of two cores, ± 30 %. Errors are largest errors in % of the range; on T3 and T4 what is quoted is the
signal-to-noise ratio to the clean surface and on the hidden samples.
"""

_FIGURES = (
    # surface, method, unknowns, max error %, SNR to truth in dB, seconds, remark
    ("T1", "GoTools, LR B-splines", 26_610, 0.99, None, 3.4, ""),
    ("T1", "G+Smo, THB-splines", 23_361, 0.67, None, 21.0, "from 42 × 42; 32 977 from 32 × 32"),
    ("T1", "MBA, multilevel B-splines", 265_225, 0.60, None, 0.36, ""),
    ("T2", "GoTools, LR B-splines, biquadratic", 8_183, 1.00, None, 3.3, ""),
    ("T2", "GoTools, LR B-splines, bicubic", 10_237, 1.00, None, 5.7, ""),
    ("T2", "G+Smo, THB-splines", 10_774, 0.96, None, 31.0, ""),
    ("T2", "MBA, multilevel B-splines", 265_225, 0.79, None, 0.34, ""),
    ("T3", "GoTools, LR B-splines", 14_979, None, None, None, "to 3 σ; not stopped by the noise"),
    ("T3", "MBA, multilevel B-splines", 4_489, None, 51.8, 0.14, "level 6"),
    ("T4", "GoTools, LR B-splines", 100_896, None, 9.23, 11.0, ""),
    ("T4", "G+Smo, THB-splines", None, None, 8.91, None, ""),
    ("T4", "MBA, multilevel B-splines", None, None, 8.52, 0.23, ""),
    ("T5", "GoTools, LR B-splines", 428_851, 1.0, None, 103.0, "3.0 GB"),
    ("T5", "MBA, multilevel B-splines", 4_206_601, None, None, 6.2, ""),
)  # fmt: skip


def quoted(surface: str) -> list[dict]:
    """The lines of a surface."""
    return [
        {
            "surface": name,
            "method": method,
            "control points": unknowns,
            "max error %": error,
            "SNR to truth dB": snr,
            "seconds": seconds,
            "remark": "quoted" + (f": {remark}" if remark else ""),
            "quoted": True,
        }
        for name, method, unknowns, error, snr, seconds, remark in _FIGURES
        if name == surface
    ]
