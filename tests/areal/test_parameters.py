"""All parameters together: units, notes, refusals, scattered samples, invariances, peers, a measured surface."""

import dataclasses
import warnings

import jax
import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax import ArealParameters, HeightMap, InputError, areal_parameters

HEIGHT, HYBRID, SPATIAL = ["Sq", "Sa", "Sz", "Sp", "Sv", "Ssk", "Sku"], ["Sdq", "Sdr"], ["Sal", "Str", "Std"]
FUNCTIONAL = ["Sk", "Spk", "Svk", "Smr1", "Smr2", "Smr", "Smc", "Vmp", "Vmc", "Vvc", "Vvv"]
NAMES = HEIGHT + HYBRID + SPATIAL + FUNCTIONAL
NEIGHBOURS = {*HYBRID, *SPATIAL}
RATIOS = {"Ssk", "Sku", "Sdq", "Sdr", "Str", "Std", "Smr1", "Smr2", "Smr"}


def rough(seed: int = 0) -> np.ndarray:
    """A smooth random map of 120 × 150 pixels, with a skew, and some pixels missing."""
    generator = np.random.default_rng(seed)
    rows, columns = np.fft.fftfreq(160)[:, None], np.fft.rfftfreq(160)
    response = np.exp(-((np.pi * 3) ** 2) * columns**2 - ((np.pi * 5) ** 2) * rows**2)
    heights = 10 * np.fft.irfft2(np.fft.rfft2(generator.normal(size=(160, 160))) * response)[:120, :150]
    heights += 0.3 * heights**2
    heights[generator.random(heights.shape) < 0.05] = np.nan
    return heights


@pytest.fixture(scope="module")
def surface() -> HeightMap:
    """That map with a unit."""
    return HeightMap(rough(), (0.5, 0.8), "µm")


def test_names_and_units(surface):
    """Every parameter has a number, a unit where it has one, and is in the dictionary under its name."""
    found = areal_parameters(surface)
    assert list(found.values) == NAMES
    assert np.isfinite(list(found.values.values())).all()
    assert found.units == {
        **dict.fromkeys(NAMES, "µm"),
        **dict.fromkeys(("Ssk", "Sku", "Sdq", "Str")),
        **dict.fromkeys(("Sdr", "Smr1", "Smr2", "Smr"), "%"),
        **dict.fromkeys(("Vmp", "Vmc", "Vvc", "Vvv"), "µm³/µm²"),
        "Std": "°",
    }
    assert found.as_dict() == {**found.values, "units": dict(found.units), "notes": list(found.notes)}
    assert "Sq   = " in repr(found)
    assert "µm³/µm²" in repr(found)
    with pytest.raises(dataclasses.FrozenInstanceError):
        found.Sq = 1.0


def compared(found: ArealParameters, expected: ArealParameters, factor: float = 1.0, rel: float = 1e-9) -> None:
    """Two sets agree, lengths times a factor."""
    for name, value in found.values.items():
        scale = 1 if name in RATIOS else factor
        assert value == pytest.approx(scale * expected.values[name], rel=rel, abs=rel), name


def test_units_change_numbers_only(surface):
    """In nanometres every length is a thousand times as large, every ratio and angle the same."""
    compared(areal_parameters(surface.to_unit("nm")), areal_parameters(surface), 1000)


def test_datum(surface):
    """A datum changes nothing."""
    compared(areal_parameters(surface.with_heights(surface.heights + 1e3)), areal_parameters(surface), rel=1e-7)


def test_single_precision(surface):
    """Metres in float32 give the numbers of float64 to a tenth of a percent, computed in either precision."""
    plain = areal_parameters(surface)
    single = HeightMap((surface.heights * 1e-6).astype(np.float32), (0.5e-6, 0.8e-6), "m")
    for options in ({}, {"dtype": "float32"}):
        found = areal_parameters(single, **options)
        for name, value in found.values.items():
            scale = 1 if name in RATIOS else 1e6
            assert value * scale == pytest.approx(plain.values[name], rel=1e-3, abs=2e-3), name


def test_scattered_samples_in_any_order():
    """Texture values with areas: shuffled, reversed or rotated about, they have the same parameters, and no others."""
    generator = np.random.default_rng(1)
    values, areas = generator.gamma(2.0, size=5000), generator.random(5000) + 0.1
    order = generator.permutation(5000)
    plain = areal_parameters(values, weights=areas, unit="mm")
    compared_names = set(NAMES) - NEIGHBOURS
    shuffled = areal_parameters(values[order], weights=areas[order], unit="mm")
    for name in compared_names:
        assert shuffled.values[name] == pytest.approx(plain.values[name], rel=1e-9), name
    assert {name for name, value in plain.values.items() if np.isnan(value)} == NEIGHBOURS
    assert any("neighbours" in note for note in plain.notes)
    assert plain.units["Sq"] == "mm"


def test_a_map_and_its_samples_agree(surface):
    """Height and functional parameters of a map are those of the list of its heights; equal weights change nothing."""
    whole = areal_parameters(surface)
    listed = areal_parameters(surface.heights.ravel(), unit="µm")
    weighted = areal_parameters(surface, weights=np.full(surface.shape, 0.4))
    for name in set(NAMES) - NEIGHBOURS:
        assert listed.values[name] == pytest.approx(whole.values[name], rel=1e-9), name
    compared(weighted, whole)


def test_reasons(surface):
    """Whatever is NaN is explained."""
    cases = {
        "Str": np.sin(np.arange(100) / 3) * np.ones((60, 1)),
        "Ssk": np.full((40, 40), 2.0),
        "Sdr": np.where(np.indices((40, 40)).sum(axis=0) % 2, np.nan, rough()[:40, :40]),
        "Sal": rough()[:3, :3],
    }
    for name, heights in cases.items():
        found = areal_parameters(tsj.HeightMap(heights, 1.0, "µm"))
        assert np.isnan(found.values[name]), name
        for missing in (key for key, value in found.values.items() if np.isnan(value)):
            assert any(missing in note.partition(":")[0] for note in found.notes), missing


def test_options_are_told(surface):
    """Choices change the numbers and are named in the notes."""
    found = areal_parameters(
        surface, stencil="seven-point", threshold=0.5, cut_height="200nm", material_ratio=50, volume_ratios=(5, 90)
    )
    plain = areal_parameters(surface)
    for name in ("Sdq", "Sdr", "Sal", "Smr", "Smc", "Vmp", "Vvv"):
        assert found.values[name] != plain.values[name], name
    told = " ".join(found.notes)
    assert all(word in told for word in ("seven-point", "s = 0.5", "0.2 µm", "50 %", "5 and 90 %"))


def test_spacing_in_place_of_the_data(surface):
    """A plain array with its spacing, a tuple and a map of that spacing are the same surface."""
    plain = areal_parameters(HeightMap(surface.heights, (0.5, 0.8)))
    compared(areal_parameters(surface.heights, spacing=(0.5, 0.8)), plain)
    compared(areal_parameters((surface.heights, 0.5, 0.8)), plain)
    assert areal_parameters(surface.heights, spacing=(0.5, 0.8), unit="um").units["Sal"] == "µm"


@pytest.mark.parametrize(
    ("data", "options", "message"),
    [
        (rough(), {}, "--spacing"),
        (HeightMap(rough()), {}, "--unit"),
        (np.ones((50, 3)), {}, "point cloud"),
        (np.full((9, 9), np.nan), {"spacing": 1.0}, "nothing to characterise"),
        (HeightMap(rough(), 1.0, "µm"), {"unit": "mm"}, "to_unit"),
        (np.ones(9), {"spacing": 1.0}, "no spacing"),
        (rough(), {"spacing": 0.0}, "positive"),
        (rough(), {"spacing": 1.0, "cut_height": "5nm"}, "names a unit"),
        (rough(), {"spacing": 1.0, "weights": np.ones((2, 2))}, "shape"),
        (rough(), {"spacing": 1.0, "dtype": "int32"}, "float64"),
        (rough(), {"spacing": 1.0, "stencil": "none"}, "stencil"),
        ("map.npy", {}, "read"),
    ],
)
def test_refusals(data, options, message):
    """Unknown spacing, clouds, empty maps and options out of range are refused, with the remedy."""
    with pytest.raises(InputError, match=message):
        areal_parameters(data, **options)


def test_double_precision_is_asked_for(surface):
    """Without JAX's 64-bit mode float64 data are refused, with the remedy, unless float32 is accepted."""
    plain = areal_parameters(surface)
    with jax.enable_x64(False):
        with pytest.raises(InputError, match=r"jax.config.update\('jax_enable_x64', True\)"):
            areal_parameters(surface)
        assert areal_parameters(surface, dtype="float32").Sq == pytest.approx(plain.Sq, rel=1e-5)


def test_surface_topography_agrees():
    """Sq and Sdq by SurfaceTopography, on profiles along x plus profiles along y.

    It takes both differences at the pixels that have both; of such a sum all rows and columns have the same ones.
    """
    topography = pytest.importorskip("SurfaceTopography")
    generator = np.random.default_rng(8)
    heights = generator.normal(size=150) + generator.normal(size=(120, 1))
    peer = topography.Topography(heights.T, physical_sizes=(150 * 0.5, 120 * 0.8), unit="um")
    found = areal_parameters(heights, spacing=(0.5, 0.8))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of its names for ISO's parameters
        height = peer.rms_height_from_area()
    assert found.Sq == pytest.approx(height, rel=1e-12)
    assert found.Sdq == pytest.approx(peer.rms_gradient(), rel=1e-12)


def test_measured_surface(shared_data):
    """A measured surface with missing pixels: every parameter is finite or explained, Sq is numpy's."""
    data = tsj.read(shared_data / "mnt-2.mnt")
    found = areal_parameters(data)
    assert found.Sq == pytest.approx(np.nanstd(data.heights.astype(float)), rel=1e-6)
    for name, value in found.values.items():
        assert np.isfinite(value) or any(name in note for note in found.notes), name
