"""Files are not trusted: each bad one is one clear line, and absurd sizes take no memory."""

import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from tsplinejax import _errors
from tsplinejax._errors import InputError, MissingExtraError
from tsplinejax.io import READABLE, read
from tsplinejax.io._pcd import decompress_lzf


def _npy(shape, descr="<f8", body=b"\0" * 64):
    header = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape!r}, }}"
    header = header.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + body


def _npz(**entries):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in entries.items():
            archive.writestr(f"{name}.npy", content)
    return stream.getvalue()


def _saved(array):
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def _ply(vertices, body=b"\0" * 36, extra=""):
    return (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
property float z\n{extra}end_header\n".encode()
        + body
    )


def _pcd(points, data, body, fields="x y z", size="4 4 4", kind="F F F"):
    count = " ".join("1" for _ in fields.split())
    return (
        f"VERSION 0.7\nFIELDS {fields}\nSIZE {size}\nTYPE {kind}\nCOUNT {count}\nWIDTH {points}\nHEIGHT 1\n\
POINTS {points}\nDATA {data}\n".encode()
        + body
    )


BAD = [
    ("empty.npy", b"", "is empty"),
    ("word.npy", b"this is not an array", "cannot be read"),
    ("huge.npy", _npy((10**9, 10**9)), "more than the"),
    ("short.npy", _npy((100, 100)), "truncated"),
    ("negative.npy", _npy((-3, 4)), "at least one"),
    ("none.npy", _npy((0, 4)), "at least one"),
    ("object.npy", _saved(np.array([[{}, 1]], dtype=object)), "never unpickled"),
    ("text.npy", _saved(np.array([["a", "b"]])), "real numbers"),
    ("bool.npy", _saved(np.zeros((2, 2), bool)), "real numbers"),
    ("complex.npy", _saved(np.zeros((2, 2), complex)), "real part"),
    ("line.npy", _saved(np.zeros(5)), "2-D"),
    ("inf.npy", _saved(np.array([[1.0, np.inf]])), "infinite"),
    ("nan-points.npy", _saved(np.full((4, 3), np.nan)), "4 of 4 hold NaN"),
    ("word.npz", b"PK not a zip", "cannot be read"),
    ("object.npz", _npz(heights=_saved(np.array([[{}]], dtype=object))), "never unpickled"),
    ("huge.npz", _npz(heights=_npy((10**6, 10**6))), "more than the"),
    ("names.npz", _npz(a=_saved(np.zeros((2, 2))), b=_saved(np.zeros((2, 2)))), "'heights' or 'points'"),
    ("unit.npz", _npz(heights=_saved(np.zeros((2, 2))), unit=_saved(np.array("volt"))), "not a unit of length"),
    ("spacing.npz", _npz(heights=_saved(np.zeros((2, 2))), spacing=_saved(np.zeros(2))), "positive"),
    ("latin.csv", "1,2\n3,4 µ\n".encode("latin-1"), "not text"),
    ("word.png", b"not an image", "cannot be read"),
    ("word.tif", b"not an image", "cannot be read"),
    ("word.x3p", b"not a zip", "cannot be read"),
    ("zip.x3p", _npz(heights=_saved(np.zeros((2, 2)))), "cannot be read"),
    ("word.sur", b"DIGITAL SURF but no more", "cannot be read"),
    ("word.gwy", b"GWYP" + b"\xff" * 40, "cannot be read"),
    ("word.frt", b"FRTM_GLIDERV1.00\x05\x00" + b"\0" * 8, "truncated"),
    ("word.al3d", b"nothing", "cannot be read"),
    ("word.plux", b"nothing", "cannot be read"),
    ("word.vk4", b"nothing", "cannot be read"),
    ("word.sdf", b"nothing", "cannot be read"),
    ("word.dat", b"nothing", "cannot be read"),
    ("word.dem", b"x" * 4096, "no USGS elevation model"),
    ("short.dem", b"x" * 100, "at least 2048 bytes"),
    ("word.ply", b"plying", "no PLY header"),
    ("huge.ply", _ply(10**12), "more than the"),
    ("short.ply", _ply(10**6), "truncated"),
    ("none.ply", _ply(0), "at least one"),
    ("faces.ply", _ply(3, extra="element face 1000000000\nproperty list uchar int vertex_indices\n"), "truncated"),
    ("corner.ply", _ply(3, b"\0" * 36 + b"\3" + struct.pack("<3i", 0, 1, 9),
                        "element face 1\nproperty list uchar int vertex_indices\n"), "corner.ply"),
    ("unit.ply", _ply(3, extra="comment unit volt\n"), "not a unit of length"),
    ("word.stl", b"solid nothing", "word.stl"),
    ("huge.stl", b"\0" * 80 + struct.pack("<I", 2**31), "huge.stl"),
    ("word.obj", b"nothing at all", "word.obj"),
    ("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "index.obj"),
    ("word.pcd", b"nothing\n", "no DATA line"),
    ("huge.pcd", _pcd(10**12, "binary", b""), "more than the"),
    ("short.pcd", _pcd(1000, "binary", b"\0" * 24), "truncated"),
    ("text.pcd", _pcd(3, "ascii", b"1 2 3\n4 5 6\n" + b" " * 20), "2 of the 3"),
    ("fields.pcd", _pcd(2, "binary", b"\0" * 24, "x y i"), "do not give x, y and z"),
    ("data.pcd", _pcd(2, "zipped", b"\0" * 24), "contradicts itself"),
    ("size.pcd", _pcd(2, "binary_compressed", struct.pack("<II", 4, 999) + b"\0" * 4), "truncated or corrupted"),
    ("lzf.pcd", _pcd(2, "binary_compressed", struct.pack("<II", 4, 24) + b"\xff\xff\xff\xff"), "before their start"),
    ("nan.pcd", _pcd(2, "ascii", b"1 2 3\n4 nan 6\n"), "1 of 2 hold NaN"),
    ("type.pcd", _pcd(2, "ascii", b"1 2 3\n4 5 6\n", kind="F F Q"), "entry 'Q' is missing"),
    ("unknown.abc", b"something", "the suffix '.abc' is not known"),
    ("unknown", b"something", "is not known"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "content", "message"), BAD, ids=[name for name, _, _ in BAD])
def test_bad_files_are_refused(tmp_path, name, content, message):
    """An `InputError` of one line that names the file."""
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        read(file)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 500


HUGE = [(name, content) for name, content, _ in BAD if name.startswith("huge")]


@pytest.mark.parametrize(("name", "content"), HUGE, ids=[name for name, _ in HUGE])
def test_absurd_sizes_take_no_memory(tmp_path, name, content):
    """A header that declares terabytes is refused before 10 MB are taken."""
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(InputError):
        read(file)
    tracemalloc.start()
    try:
        with pytest.raises(InputError):
            read(file)
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize(
    ("path", "message"), [("absent.npy", "does not exist"), (".", "is a folder"), (None, "a path is text")]
)
def test_absent_files_are_refused(tmp_path, path, message):
    """Missing files, folders and things that are no path."""
    with pytest.raises(InputError, match=message):
        read(path if path is None else tmp_path / path)


@pytest.mark.parametrize(
    ("name", "package", "extra"), [("map.sur", "SurfaceTopography", "formats"), ("mesh.obj", "trimesh", "mesh")]
)
def test_a_missing_package_is_named(tmp_path, monkeypatch, name, package, extra):
    """The message has the command that installs the extra."""
    (tmp_path / name).write_bytes(b"content")

    def absent(module):
        raise ImportError(f"No module named {module!r}")

    monkeypatch.setattr(_errors, "import_module", absent)
    with pytest.raises(MissingExtraError, match=rf'{package}.*pip install "tsplinejax\[{extra}\]"'):
        read(tmp_path / name)


def test_every_suffix_is_lower_case_and_read_in_any_case(tmp_path):
    """`.NPY` is `.npy`."""
    assert all(suffix == suffix.lower() for suffix in READABLE)
    (tmp_path / "MAP.NPY").write_bytes(_saved(np.zeros((2, 2))))
    assert read(tmp_path / "MAP.NPY").shape == (2, 2)


def test_instrument_suffixes_are_those_of_the_package():
    """Each suffix that goes to SurfaceTopography is one that it knows, under the format's name."""
    from tsplinejax.io._instrument import FORMATS, _surface_topography

    _surface_topography()
    from SurfaceTopography.IO import readers

    known = {reader.format(): {f".{suffix}" for suffix in reader.file_extensions()} for reader in readers}
    for suffix, formats in FORMATS.items():
        for name in formats:
            assert suffix in known[name]


def test_lzf_copies_and_literals():
    """Literals, an overlapping copy, a long copy."""
    assert decompress_lzf(bytes([2, 97, 98, 99, 0x20, 2]), 6) == b"abcabc"
    assert decompress_lzf(bytes([0, 97, 0xE0, 10, 0]), 20) == b"a" * 20
    with pytest.raises(InputError, match="within a copy"):
        decompress_lzf(bytes([0, 97, 0xE0]), 20)
    with pytest.raises(InputError, match="instead of"):
        decompress_lzf(bytes([0, 97]), 2)
