"""Archives: equal contents give equal bytes, and no declared size is believed."""

import io
import json
import zipfile

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.codec._archive import read_archive, read_header, write_archive

DTYPES = {"numbers": "float64"}


def _written(path, header=None, **arrays):
    with path.open("wb") as stream:
        write_archive(stream, header or {"a": 1}, arrays)
    return path


def _zip(path, members, compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def _npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def test_round_trip(tmp_path):
    """Header and arrays come back as they were, whatever their memory order."""
    numbers = np.arange(6.0).reshape(2, 3).T
    header, arrays = read_archive(_written(tmp_path / "a", {"unit": "µm"}, numbers=numbers), DTYPES)
    assert header == {"unit": "µm"}
    np.testing.assert_array_equal(arrays["numbers"], numbers)


def test_is_a_plain_zip_of_json_and_npy(tmp_path):
    """Anyone can read the file without this library."""
    path = _written(tmp_path / "a.zip", {"a": [1, None]}, numbers=np.arange(3.0))
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        assert json.loads(archive.read("header.json")) == {"a": [1, None]}
        np.testing.assert_array_equal(np.load(archive.open("numbers.npy"), allow_pickle=False), np.arange(3.0))


BAD_MEMBERS = [
    ({"other.txt": b""}, "unknown member 'other.txt'"),
    ({"numbers.npy": _npy(np.arange(3.0))}, "no member 'header.json'"),
    ({"header.json": b"{", "numbers.npy": b""}, "no JSON text"),
    ({"header.json": b"[" * 100_000}, "no JSON text"),
    ({"header.json": b"[]"}, "no JSON object"),
    ({"header.json": b" " * (1 << 23)}, "more than"),
    ({"header.json": b"{}", "numbers.npy": b"text"}, "is no array"),
    ({"header.json": b"{}", "numbers.npy": _npy(np.arange(3))}, "where float64"),
    ({"header.json": b"{}", "numbers.npy": _npy(np.arange(3.0))[:-1]}, "holds 23 bytes"),
    (
        {"header.json": b"{}", "numbers.npy": _npy(np.arange(3.0)).replace(b"(3,)", b"(9999999999999,)")},
        "is no array|holds",
    ),
]


@pytest.mark.parametrize(("members", "message"), BAD_MEMBERS, ids=[message for _, message in BAD_MEMBERS])
def test_bad_members_are_refused(tmp_path, members, message):
    """Each is one clear message."""
    with pytest.raises(InputError, match=message):
        read_archive(_zip(tmp_path / "a", members), DTYPES)


def test_compressed_members_are_refused(tmp_path):
    """A compressed member could declare any size; a model file has none."""
    path = _zip(tmp_path / "a", {"header.json": b" " * 10_000 + b"{}"}, zipfile.ZIP_DEFLATED)
    with pytest.raises(InputError, match=r"header\.json at byte 0 is compressed"):
        read_header(path)


def test_a_damaged_member_is_named_with_its_place(tmp_path):
    """A flipped bit among the numbers is found by the checksum."""
    path = _written(tmp_path / "a", numbers=np.arange(100.0))
    content = bytearray(path.read_bytes())
    content[content.index(np.float64(50.0).tobytes())] ^= 1
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"numbers.npy at byte \d+ is damaged"):
        read_archive(path, DTYPES)


def test_long_lists_of_members_are_not_read(tmp_path):
    """Every member of the list would take memory, and a model file has a handful."""
    path = _zip(tmp_path / "a", {"header.json": b"{}", **{f"{k}.npy": b"" for k in range(2000)}})
    with pytest.raises(InputError, match="list of members"):
        read_header(path)


def test_what_could_not_be_read_is_not_written(tmp_path):
    """A header longer than what is read of one."""
    with pytest.raises(InputError, match="a header holds"):
        _written(tmp_path / "a", {"text": "x" * (1 << 20)})
