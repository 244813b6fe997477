"""Compressed files are not trusted: whatever was done to one, it decodes or is refused with one line."""

import tracemalloc
from functools import partial

import numpy as np
import pytest

import tsplinejax as tsj
from tsplinejax.data import peaks

from . import peak
from .bombs import bombs
from .mutants import mutant, parts, resealed

MUTANTS = 300


@pytest.fixture(scope="module")
def contents():
    """One file of each kind."""
    heights = peaks((40, 50)).heights.copy()
    heights[10:14, 20:23] = np.nan
    return {
        "grid": tsj.compress(heights, max_error=0.01, mode="grid"),
        "lossless": tsj.compress(heights, max_error=0.0),
        "model": tsj.compress(heights, max_error=0.05, mode="model"),
        "corrected": tsj.compress(peaks((120, 160)).heights, relative_max_error=0.001),
    }


@pytest.mark.parametrize("kind", ["grid", "lossless", "model"])
def test_mutants_decode_or_are_refused(contents, kind):
    """Flipped bits, truncation, splices, and behind a right checksum other headers and other coded numbers."""
    rng, messages = np.random.default_rng(7), []
    for _ in range(MUTANTS):
        try:
            tsj.decompress(mutant(contents[kind], rng))
        except tsj.InputError as error:
            messages.append(str(error))
    assert len(messages) > MUTANTS // 2
    assert not [message for message in messages if "\n" in message]


def test_flipped_bits_are_found(contents):
    """No single flipped bit goes unnoticed."""
    content = contents["grid"]
    for place in np.random.default_rng(1).integers(8 * len(content), size=300):
        damaged = bytearray(content)
        damaged[place // 8] ^= 1 << (place % 8)
        with pytest.raises(tsj.InputError):
            tsj.decompress(bytes(damaged))


@pytest.mark.parametrize("shape", [[1 << 15, 1 << 15], [3000, 3000], [1, 1 << 22], [1 << 22, 1]])
def test_huge_shapes_take_no_memory(contents, shape):
    """Declared pixels that the coded numbers do not fill end before memory is taken for them."""
    header, body = parts(contents["grid"])
    content = resealed({**header, "shape": shape, "missing": 0}, body)
    tracemalloc.start()
    try:
        with pytest.raises(tsj.InputError):
            tsj.decompress(content)
        assert tracemalloc.get_traced_memory()[1] < 2e8
    finally:
        tracemalloc.stop()


@pytest.mark.skipif(not peak.is_known(), reason="only Linux with the GNU C library tells the peak of one call")
def test_bombs_take_little_memory(contents):
    """Small files that ask for much: at most 200 MB beyond the heights that come back, compiled code included."""
    entries = [parts(contents[kind])[0] for kind in ("grid", "model")]
    beyond = {}
    for name, content in bombs(*entries).items():
        need, taken = peak.with_peak(partial(_need, content))
        beyond[name] = taken - need
    assert {name: size for name, size in beyond.items() if size > 200} == {}


@pytest.mark.skipif(not peak.is_known(), reason="only Linux with the GNU C library tells the peak of one call")
def test_corrections_end_before_the_surface_is_evaluated(contents):
    """A larger shape than the corrections of single pixels fill takes no memory for its pixels."""
    header, body = parts(contents["corrected"])
    assert header["model"]["residual"]
    content = resealed({**header, "shape": [4000, 4000]}, body)
    need, taken = peak.with_peak(partial(_need, content))
    assert need == 0
    assert taken < 60  # 128 MB of heights


def _need(content):
    """MB of the heights that a file decodes to; none where it is refused."""
    try:
        return tsj.decompress(content).heights.nbytes / 1e6
    except tsj.InputError:
        return 0.0


def test_file_is_named(contents, tmp_path):
    """The error names the file, and a file of another kind is no compressed map."""
    path = tmp_path / "map.tspl"
    for content in (contents["model"][:-5], b"PK\x03\x04", b"text"):
        path.write_bytes(content)
        with pytest.raises(tsj.InputError, match=r"map\.tspl"):
            tsj.decompress(path)
    with pytest.raises(tsj.InputError, match="does not exist"):
        tsj.decompress(tmp_path / "none.tspl")
