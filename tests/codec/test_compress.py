"""Compression: every valid pixel within the bound, missing ones missing, metadata kept; else it is refused."""

import subprocess
import sys
import zlib

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

import tsplinejax as tsj
from tsplinejax.codec import compressed_header, load_header
from tsplinejax.data import peaks


@st.composite
def maps(draw):
    """Maps of any small shape: waves, edges, noise, offsets; float32 or float64; with holes; any spacing."""
    rows, columns = draw(st.integers(1, 40)), draw(st.integers(1, 40))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    y, x = np.mgrid[:rows, :columns] / 20
    heights = np.sin(rng.uniform(-4, 4) * x + rng.uniform(-4, 4) * y)
    heights += draw(st.sampled_from([0, 1])) * (x > rng.uniform(0, 2))
    heights += draw(st.sampled_from([0, 0.01, 1])) * rng.normal(size=heights.shape)
    heights = heights * draw(st.sampled_from([1e-9, 1, 1e6])) + draw(st.sampled_from([0, -3, 1e7]))
    heights = heights.astype(draw(st.sampled_from([np.float32, np.float64])))
    missing = rng.random(heights.shape) < draw(st.sampled_from([0, 0.1, 0.9]))
    missing.flat[rng.integers(missing.size)] = False
    unit = draw(st.sampled_from([None, "µm"]))
    return tsj.HeightMap(np.where(missing, np.nan, heights), (0.5, 0.25), unit, origin=(1.0, -2.0))


def _error(data, decoded):
    """Largest error of the valid pixels, after checking that the others are the missing ones."""
    np.testing.assert_array_equal(decoded.valid, data.valid)
    wide = np.longdouble
    return np.nanmax(np.abs(decoded.heights.astype(wide) - data.heights.astype(wide)))


def _same_place(data, decoded):
    """Everything but the heights."""
    return (decoded.shape, decoded.spacing, decoded.origin, decoded.unit) == (
        data.shape,
        data.spacing,
        data.origin,
        data.unit,
    )


@settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(maps(), st.sampled_from([0.0, 1e-12, 1e-5, 0.001, 0.03, 0.7]), st.sampled_from(["grid", "lossless"]))
def test_bound_holds_at_every_valid_pixel(data, relative, mode):
    """Round trip of random maps with holes: bound, mask, place and dtype, whichever way is taken."""
    bound = relative * data.range
    finest = 200 * np.spacing(np.nanmax(np.abs(data.heights)))
    if mode == "grid" and (bound < finest or relative < 1e-9):  # hardly above the spacing of the numbers themselves
        mode = "smallest"
    content = tsj.compress(data, max_error=bound, mode=mode)
    decoded = tsj.decompress(content)
    assert _error(data, decoded) <= bound
    assert _same_place(data, decoded)
    assert decoded.heights.dtype == data.heights.dtype
    header = compressed_header(content)
    assert header.max_error == float(_error(data, decoded))
    assert header.tolerance == bound


@settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])
@given(maps(), st.sampled_from([1e-5, 0.01, 0.3]))
def test_bound_holds_whichever_way_is_smallest(data, relative):
    """The same where a T-spline is tried, too."""
    content = tsj.compress(data, relative_max_error=relative)
    assert _error(data, tsj.decompress(content)) <= relative * data.range


@settings(max_examples=30, suppress_health_check=[HealthCheck.too_slow])
@given(maps())
def test_bound_of_zero_keeps_every_bit(data):
    """Bound 0: the same bits, the sign of zero included."""
    decoded = tsj.decompress(tsj.compress(data, max_error=0))
    np.testing.assert_array_equal(decoded.heights, data.heights)
    np.testing.assert_array_equal(np.signbit(decoded.heights[data.valid]), np.signbit(data.heights[data.valid]))


@pytest.fixture(scope="module")
def smooth():
    """A smooth map with a hole, of unequal spacing, with a provenance."""
    heights = peaks((120, 150)).heights.copy()
    heights[30:50, 60:80] = np.nan
    return tsj.HeightMap(heights, (0.5, 0.25), "µm", origin=(3.0, -2.0), provenance={"name": "peaks.npz"})


@pytest.fixture(scope="module")
def compressed(smooth):
    """It as a T-spline that keeps the bound alone."""
    return tsj.compress(smooth, relative_max_error=0.01, mode="model")


def test_model_keeps_the_bound_alone(smooth, compressed, tmp_path):
    """`load` opens the file as a T-spline, and this is within the bound at every valid pixel."""
    path = tmp_path / "smooth.tspl"
    path.write_bytes(compressed)
    surface, header = tsj.load(path), load_header(path)
    decoded, bound = tsj.decompress(path), 0.01 * smooth.range
    assert _error(smooth, decoded) <= bound
    parameters = smooth.samples().parameters
    heights = np.asarray(surface(parameters))
    assert np.abs(heights - smooth.heights[smooth.valid]).max() <= bound
    assert header.control_points == surface.control_points.shape[0] == compressed_header(path).model.control_points
    assert surface.frame == smooth.frame
    assert header.provenance == {"name": "peaks.npz"} == decoded.provenance
    assert tsj.save(tmp_path / "again.tspl", surface).stat().st_size > 10 * len(compressed)


def test_model_is_smaller_than_the_plain_one(smooth, compressed):
    """Far below the paper's 24 bytes a control point."""
    assert len(compressed) < 2 * compressed_header(compressed).model.control_points


def test_smallest_is_no_larger_than_any_way(smooth):
    """`smallest` compares the T-spline with corrections, pixels and every bit; here the T-spline wins."""
    sizes = {
        mode: len(tsj.compress(smooth, relative_max_error=0.01, mode=mode)) for mode in ("grid", "model", "lossless")
    }
    content = tsj.compress(smooth, relative_max_error=0.01)
    assert _error(smooth, tsj.decompress(content)) <= 0.01 * smooth.range
    assert len(content) <= min(sizes["grid"], sizes["lossless"])
    assert compressed_header(content).mode == "model"


def test_other_resolution(smooth, compressed):
    """A finer grid shows the T-spline; holes stay holes; the own grid is the decoded map."""
    fine = tsj.decompress(compressed, shape=(239, 299))
    own = tsj.decompress(compressed)
    np.testing.assert_allclose(fine.heights[::2, ::2], own.heights, rtol=0, atol=1e-9)
    assert fine.spacing == (0.25, 0.125)
    assert np.isnan(fine.heights[62:96, 122:156]).all()
    grid = tsj.decompress(tsj.compress(smooth, relative_max_error=0.01, mode="grid"), shape=(239, 299))
    np.testing.assert_array_equal(grid.valid, fine.valid)
    assert np.nanmax(np.abs(grid.heights - fine.heights)) < 0.1 * smooth.range


def test_equal_maps_give_equal_bytes(smooth, compressed):
    """Same input, version and machine: byte-identical."""
    assert tsj.compress(smooth, relative_max_error=0.01, mode="model") == compressed


def test_bound_with_a_unit_and_another_dtype(smooth):
    """A bound may be text with a unit, and holds after rounding to float32."""
    content = tsj.compress(smooth, max_error="20nm", dtype="float32", mode="grid")
    decoded = tsj.decompress(content)
    assert decoded.heights.dtype == np.float32
    assert _error(smooth, decoded) <= 0.02


def test_mirrored_metres(smooth):
    """The same map in metres, as float32 and upside down, takes about the same bytes."""
    size = len(tsj.compress(smooth, relative_max_error=0.001, mode="grid"))
    other = tsj.HeightMap((smooth.heights[::-1] * 1e-6).astype(np.float32), (5e-7, 2.5e-7), "m")
    assert len(tsj.compress(other, relative_max_error=0.001, mode="grid")) < 1.05 * size


REFUSED = [
    ({"max_error": -1.0}, "at least zero"),
    ({"max_error": float("nan")}, "finite"),
    ({"max_error": "3 volt"}, "volt"),
    ({}, "either max_error or"),
    ({"max_error": 1.0, "relative_max_error": 0.1}, "either max_error or"),
    ({"max_error": 1.0, "mode": "tiny"}, "mode is one of"),
    ({"max_error": 1.0, "dtype": "float16"}, "float32 or float64"),
    ({"max_error": 1e-12, "dtype": "float32"}, "rounding alone"),
    ({"max_error": 0.0, "mode": "model"}, "no model file keeps the bound"),
]


@pytest.mark.parametrize(("options", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_bad_options_are_refused(options, message):
    """One clear line each."""
    with pytest.raises(tsj.InputError, match=message):
        tsj.compress(peaks((20, 30)), **options)


def test_bad_data_are_refused():
    """Nothing valid, a cloud, no data."""
    for data, message in [([[np.nan] * 4] * 2, "nothing to compress"), (np.ones((5, 3)), "cloud"), ("map", "read")]:
        with pytest.raises(tsj.InputError, match=message):
            tsj.compress(data, max_error=0.1)


def test_pixels_are_no_model(smooth, tmp_path):
    """A file of pixels is no T-spline, and `load` names the remedy."""
    path = tmp_path / "map.tspl"
    path.write_bytes(tsj.compress(smooth, relative_max_error=0.01, mode="grid"))
    for verb in (tsj.load, load_header):
        with pytest.raises(tsj.InputError, match=r"map\.tspl.*mode='model'"):
            verb(path)


def test_flat_and_tiny_maps():
    """Constant maps, one row, one pixel: few bytes, and back."""
    for heights in (
        np.zeros((300, 300)),
        np.full((1, 7), 5.0),
        np.array([[2.5]]),
        np.array([[1.0, 2.0], [3.0, np.nan]]),
    ):
        data = tsj.HeightMap(heights)
        for bound in (0.0, 0.1):
            content = tsj.compress(data, max_error=bound)
            assert _error(data, tsj.decompress(content)) <= bound
            assert len(content) < 1000


@pytest.mark.parametrize("name", ["x3p-2.x3p", "frt-1.frt", "tmd-1.tmd"])
def test_measured_maps(shared_data, name):
    """Real maps, striated, ragged and stepped: within the bound, and well below deflate of the rounded heights."""
    pytest.importorskip("SurfaceTopography")
    data = tsj.read(shared_data / name)
    bound = 0.001 * data.range
    content = tsj.compress(data, max_error=bound, mode="grid")
    assert _error(data, tsj.decompress(content)) <= bound
    rounded = np.nan_to_num(np.rint(data.heights / (2 * bound))).astype(np.int16)
    assert len(content) < 0.8 * len(zlib.compress(rounded.tobytes(), 9))


def test_without_x64(tmp_path):
    """With JAX's 64-bit mode off pixels are coded as ever, and a T-spline is refused with the line that fixes it."""
    code = """
import numpy as np, tsplinejax as tsj
from tsplinejax.data import peaks
print(len(tsj.decompress(tsj.compress(peaks((60, 80)), max_error=0.01, mode="grid")).heights))
try: tsj.compress(peaks((60, 80)), max_error=0.01, mode="model")
except tsj.InputError as error: print(error)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    rows, message = run.stdout.splitlines()
    assert rows == "60"
    assert "jax.config.update('jax_enable_x64', True)" in message
    assert "mode='grid'" in message


EARLIER = (
    "895453504c0d0a025b00000095d2c10d80300c03c08550d5b8719a0cc324a8bb531e88aa5448e4e1879fbe1c7f9ea14d729f5a39b177e0c8652b"
    "ae1ba7db487dd170a6d100342a6a4f51f291420a7798b8b83b3d170c70715d562b202d42566cab95a26cb1b7131526ff6e06192424bc913b0461"
    "ec78a67cd6faf7b65a1388beca881b5a4db53bf05fe2af158086d17eaae6c6dfbdd14e76a1f6d4ebb597c1dc2dfeb0f68c520322d271dbd8d2cb"
    "aa84f638550eba0823623e86b2a7fbce57eb917c4609936aac8b3375b3f9605f961118a3203608"
)


def test_files_written_earlier_are_read():
    """A small map of predicted pixels, with a hole: every bit of its heights as when it was written."""
    row, column = np.mgrid[0:12, 0:17]
    given = (np.sin(row / 3.0) * 4 + (column - 8) ** 2 / 16.0).astype(np.float32)
    given[3:5, 6:9] = np.nan
    content = bytes.fromhex(EARLIER)
    heights = tsj.decompress(content).heights
    np.testing.assert_array_equal(np.isnan(heights), np.isnan(given))
    errors = np.abs(heights.astype(np.float64) - given.astype(np.float64))
    assert np.nanmax(errors) == compressed_header(content).max_error <= 0.05
