"""Functional parameters against exact material ratio curves, with missing samples and weights."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar
from scipy.special import ndtri

from tsplinejax import InputError
from tsplinejax.areal import FunctionalParameters, functional_parameters

#: Height at the material ratio p, falling from p = 0 to 1, of distributions of mean zero.
CURVES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "uniform": lambda p: 1 - 2 * p,
    "Gaussian": lambda p: -ndtri(p),
    "triangular": lambda p: np.where(p < 0.5, 1 - np.sqrt(2 * p), np.sqrt(2 * np.maximum(1 - p, 0)) - 1),
    "exponential peaks": lambda p: -np.log(p) - 1,
    "exponential pits": lambda p: 1 + np.log1p(-p),
    "sine": lambda p: np.cos(np.pi * p),
}


def values(parameters: FunctionalParameters) -> dict[str, float]:
    """All of them by name."""
    return {name: float(value) for name, value in parameters._asdict().items()}


def sampled(curve: Callable[[np.ndarray], np.ndarray], count: int = 400_000) -> np.ndarray:
    """Heights with this material ratio curve, shuffled."""
    return np.random.default_rng(0).permutation(curve((np.arange(count) + 0.5) / count))


def exact(curve: Callable[[np.ndarray], np.ndarray]) -> dict[str, float]:
    """The parameters from the curve itself by optimisation and quadrature."""

    def drop(start: float) -> float:
        return float(curve(np.array(start)) - curve(np.array(start + 0.4)))

    def integral(function: Callable[[float], float], low: float, high: float) -> float:
        return quad(function, low, high, limit=200, epsabs=1e-11)[0]

    edge = 1e-12
    inner = minimize_scalar(drop, bounds=(edge, 0.6 - edge), method="bounded", options={"xatol": 1e-10})
    # In order: of equal minima the first counts.
    starts = sorted([edge, float(inner.x), 0.6 - edge])
    first = next(s for s in starts if drop(s) <= min(map(drop, starts)) * (1 + 1e-9))
    middle = first + 0.2
    mean = integral(curve, first, first + 0.4) / 0.4
    slope = 12 / 0.4**3 * integral(lambda p: (p - middle) * curve(p), first, first + 0.4)
    top, bottom = mean - slope * middle, mean + slope * (1 - middle)
    above = 0.0 if curve(edge) <= top + 1e-9 else brentq(lambda p: curve(p) - top, edge, 1 - edge)
    below = 1.0 if curve(1 - edge) >= bottom - 1e-9 else brentq(lambda p: curve(p) - bottom, edge, 1 - edge)
    peaks = integral(lambda p: curve(p) - top, 0, above)
    pits = integral(lambda p: bottom - curve(p), below, 1)
    material = {p: integral(lambda q, p=p: curve(q) - curve(p), 0, p) for p in (0.1, 0.8)}
    void = {p: integral(lambda q, p=p: curve(p) - curve(q), p, 1) for p in (0.1, 0.8)}
    return {
        "Sk": top - bottom,
        "Spk": 2 * peaks / above if above else 0.0,
        "Svk": 2 * pits / (1 - below) if below < 1 else 0.0,
        "Smr1": 100 * above,
        "Smr2": 100 * below,
        "Smr": 100 * brentq(curve, edge, 1 - edge),
        "Smc": float(curve(np.array(0.1))),
        "Vmp": material[0.1],
        "Vmc": material[0.8] - material[0.1],
        "Vvc": void[0.1] - void[0.8],
        "Vvv": void[0.8],
    }


@pytest.mark.parametrize("name", CURVES)
def test_known_distributions(name):
    """Every parameter of known height distributions, to the sampling of 400 000 heights."""
    found, true = values(functional_parameters(sampled(CURVES[name]))), exact(CURVES[name])
    for key, value in true.items():
        assert found[key] == pytest.approx(value, rel=5e-4, abs=5e-4), key


def test_missing_heights_are_left_out():
    """NaN and samples of weight zero change nothing."""
    heights = np.random.default_rng(0).normal(size=(40, 50))
    missing = np.random.default_rng(1).random(heights.shape) < 0.3
    alone = values(functional_parameters(heights[~missing]))
    assert values(functional_parameters(np.where(missing, np.nan, heights))) == pytest.approx(alone, rel=1e-10)
    weighted = values(functional_parameters(heights, (~missing).astype(float)))
    assert weighted == pytest.approx(alone, rel=1e-10)


def test_weights_are_areas():
    """Samples drawn too densely on one side, weighted by their areas, have the parameters of the even surface."""
    u = (np.arange(200_000) + 0.5) / 200_000
    found = values(functional_parameters(CURVES["Gaussian"](u**2), 2 * u))
    assert found == pytest.approx(exact(CURVES["Gaussian"]), rel=2e-3, abs=1e-3)


def test_a_plateau():
    """Three fifths of a surface at one height: the core has no height, what lies deeper is Svk's triangle."""
    heights = np.concatenate([np.zeros(600), -np.linspace(0, 1, 400)])
    found = values(functional_parameters(heights))
    assert found["Sk"] == pytest.approx(0, abs=1e-12)
    assert [found["Svk"], found["Smr2"]] == pytest.approx([1, 60], rel=0.01)


def test_volumes_add_up():
    """What the mean height is above the lowest and below the highest point is what the volumes say at 80 and 10 %."""
    heights = np.random.default_rng(3).gamma(2.0, size=10_000)
    found = values(functional_parameters(heights))
    centred = heights - heights.mean()
    at_80 = values(functional_parameters(heights, material_ratio=80))["Smc"]
    assert found["Vmp"] + found["Vmc"] == pytest.approx(np.maximum(centred - at_80, 0).mean(), rel=1e-9)
    assert found["Vvv"] == pytest.approx(np.maximum(at_80 - centred, 0).mean(), rel=1e-9)


def test_cuts():
    """Smr at a height and Smc at that ratio undo each other; beyond the surface the ratio is 0 or 100 %."""
    heights = sampled(CURVES["Gaussian"], 10_001)
    ratio = values(functional_parameters(heights, cut_height=0.8))["Smr"]
    assert values(functional_parameters(heights, material_ratio=ratio))["Smc"] == pytest.approx(0.8, abs=1e-6)
    assert values(functional_parameters(heights, cut_height=99.0))["Smr"] == 0
    assert values(functional_parameters(heights, cut_height=-99.0))["Smr"] == 100


def test_precision_and_unit(dtype, tolerance_of):
    """Metres give the numbers of nanometres, in single precision, too."""
    heights = sampled(CURVES["Gaussian"], 20_000).astype(dtype)
    plain = values(functional_parameters(heights))
    small = values(functional_parameters(heights * dtype.type(1e-9)))
    for key, value in plain.items():
        factor = 1 if key.startswith("Smr") else 1e9
        assert small[key] * factor == pytest.approx(value, rel=tolerance_of(dtype, 5), abs=tolerance_of(dtype)), key


def test_equal_heights_and_none():
    """A flat surface has no core height and no volumes; nothing present, nothing defined."""
    flat = values(functional_parameters(np.full(10, 3.0)))
    assert [flat[name] for name in ("Sk", "Spk", "Svk", "Vmp", "Vmc", "Vvc", "Vvv")] == [0] * 7
    assert np.isnan(list(values(functional_parameters(np.full(10, np.nan))).values())).all()


def test_bad_ratios():
    """Ratios that do not rise from 0 to 100 are refused."""
    with pytest.raises(InputError, match="rising percentages"):
        functional_parameters(np.arange(10.0), volume_ratios=(80.0, 10.0))
