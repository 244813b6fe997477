"""Does refinement stop at the noise? Errors against the noise-free truth, and the cases that mislead an estimate."""

import jax
import numpy as np
from reporting import keep
from scipy.ndimage import gaussian_filter
from surfaces import case_study

jax.config.update("jax_enable_x64", True)

import tsplinejax as tsj  # noqa: E402
from tsplinejax.data import plate_with_particles, scattered_peaks  # noqa: E402


def main() -> None:
    """Fit noisy surfaces with the noise known and estimated."""
    rows = []
    cloud, truth = scattered_peaks(), scattered_peaks(sigma=0)
    clean, noisy = case_study("T2"), plate_with_particles(noise=0.01)
    sigma = 0.01 * clean.range
    for noise in (0.05, "auto"):
        rows.append(row("T3, 200 000 scattered", noise, cloud, truth.points[:, 2], "rms 0.0045, 2 000 points"))
    for noise in (sigma, "auto"):
        rows.append(row("T2n, white 1 %", noise, noisy, clean.heights, "rms 0.0105, 10 000 points"))
    rng = np.random.default_rng(0)
    white = rng.normal(size=clean.shape)
    smooth = gaussian_filter(white, 1.5)
    cases = {
        "T2 + 1 % correlated over 1.5 pixels": clean.heights + sigma * smooth / smooth.std(),
        "T2 rounded to 1/256 of the range": np.round(clean.heights / clean.range * 256) * clean.range / 256,
        "T2 + noise growing with slope": clean.heights + growing(clean.heights, clean.range) * white,
        "T2 without noise": clean.heights,
        "T1 without noise": case_study("T1").heights,
        "roughness down to the pixel": gaussian_filter(white, 0.6),
    }
    for name, heights in cases.items():
        against = case_study("T1").heights if name.startswith("T1") else clean.heights
        if name.startswith("roughness"):
            against = heights
        rows.append(row(name, "auto", tsj.HeightMap(heights), against, ""))
    keep("noise", rows)


def growing(heights: np.ndarray, spread: float) -> np.ndarray:
    """A standard deviation of 0.2 % of the range on flats and up to 2 % on the steepest slope."""
    slope = np.hypot(*np.gradient(heights))
    return 0.002 * spread * (1 + 9 * slope / slope.max())


def row(name: str, noise, data, truth: np.ndarray, asked: str) -> dict:
    """One fit to noise."""
    result = tsj.fit(data, noise=noise)
    fitted = np.asarray(result.surface(result.samples.parameters))
    error = fitted - truth.ravel()
    return {
        "case": name,
        "noise": noise if isinstance(noise, str) else round(noise, 5),
        "assumed": result.noise,
        "stop": str(result.stop),
        "control points": result.control_points,
        "rms to truth": float(np.sqrt(np.mean(error**2))),
        "max to truth % of range": float(100 * np.abs(error).max() / np.ptp(truth)),
        "asked": asked,
        "seconds": result.seconds,
        "warnings": len(result.warnings),
    }


if __name__ == "__main__":
    main()
