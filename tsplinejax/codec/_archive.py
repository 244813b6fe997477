"""Archives of plain arrays: what a model file is made of.

A zip file whose members are stored, not compressed: `header.json`, and numpy's own `.npy` for every array. Stored
members cannot declare more bytes than the file has, so no size is trusted further than that. Names, order, time stamps
and attributes are fixed, so equal contents give equal bytes.
"""

import io
import json
import sys
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format

from .._errors import InputError
from ._entries import LONGEST_HEADER

HEADER = "header.json"
_LONGEST_DIRECTORY = 1 << 16
_EPOCH = (1980, 1, 1, 0, 0, 0)
_UNIX, _READABLE = 3, 0o644 << 16


def write_archive(stream: BinaryIO, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write a header and named arrays; the same input gives the same bytes."""
    text = json.dumps(header, indent=1, ensure_ascii=False, allow_nan=False).encode()
    if len(text) > LONGEST_HEADER:
        raise InputError(f"the provenance of the model takes {len(text)} bytes; a header holds {LONGEST_HEADER}")
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
        _write(archive, HEADER, text)
        for name, array in arrays.items():
            content = io.BytesIO()
            little = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"), copy=False)
            npy_format.write_array(content, little, version=(1, 0), allow_pickle=False)
            _write(archive, f"{name}.npy", content.getvalue())


class _Members(io.BufferedReader):
    """A file whose list of members is not read if it is longer than that of a model file can be."""

    def __init__(self, file: Path) -> None:
        super().__init__(io.FileIO(file))
        self.longest = _LONGEST_DIRECTORY

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > self.longest:
            raise InputError(f"its list of members has {size} bytes; it is no model file")
        return super().read(size)


@contextmanager
def _opened(file: Path) -> Iterator[zipfile.ZipFile]:
    """An archive with few members."""
    with _Members(file) as stream, zipfile.ZipFile(stream) as archive:
        stream.longest = sys.maxsize
        yield archive


def read_header(file: Path) -> dict[str, Any]:
    """Read the header of an archive, which is a JSON object.

    **Raises:** `InputError`, or what the zip reader raises for bytes that are no archive.
    """
    with _opened(file) as archive:
        return _header(archive, file.stat().st_size)


def read_archive(file: Path, dtypes: Mapping[str, str]) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read the header and those of the named arrays that are there; each must have the dtype given for it.

    **Raises:** `InputError`, or what the zip reader raises for bytes that are no archive.
    """
    size = file.stat().st_size
    with _opened(file) as archive:
        names = set(archive.namelist())
        unknown = names - {HEADER} - {f"{name}.npy" for name in dtypes}
        if unknown:
            raise InputError(f"it holds the unknown member {sorted(unknown)[0]!r}; it is no model file")
        header = _header(archive, size)
        arrays = {
            name: _array(archive, f"{name}.npy", size, np.dtype(dtype))
            for name, dtype in dtypes.items()
            if f"{name}.npy" in names
        }
    return header, arrays


def _write(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    member = zipfile.ZipInfo(name, _EPOCH)
    member.create_system, member.external_attr = _UNIX, _READABLE
    archive.writestr(member, content)


def _content(archive: zipfile.ZipFile, name: str, size: int) -> tuple[bytes, int]:
    """A member's bytes and where it starts in the file, after its declared size was compared with the file's."""
    if name not in archive.namelist():
        raise InputError(f"it holds no member {name!r}; it is no model file, or was damaged: copy it again")
    member = archive.getinfo(name)
    place = f"{name} at byte {member.header_offset}"
    if member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 0x1:
        raise InputError(f"{place} is compressed or encrypted, which a model file never is; save the model again")
    if member.file_size != member.compress_size or member.header_offset + member.file_size > size:
        raise InputError(
            f"{place} declares {member.file_size} bytes, but the file has {size}: it is truncated or corrupted; "
            "copy it again"
        )
    try:
        return archive.read(member), member.header_offset
    except (zipfile.BadZipFile, EOFError) as error:
        raise InputError(f"{place} is damaged ({error}); copy the file again") from error


def _header(archive: zipfile.ZipFile, size: int) -> dict[str, Any]:
    content, offset = _content(archive, HEADER, size)
    if len(content) > LONGEST_HEADER:
        raise InputError(f"its header has {len(content)} bytes, more than the {LONGEST_HEADER} that are read")
    try:
        header = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{HEADER} at byte {offset} is no JSON text: {error}") from error
    if not isinstance(header, dict):
        raise InputError(f"{HEADER} at byte {offset} is no JSON object; it is no model file")
    return header


def _array(archive: zipfile.ZipFile, name: str, size: int, dtype: np.dtype) -> np.ndarray:
    content, offset = _content(archive, name, size)
    stream = io.BytesIO(content)
    try:
        version = npy_format.read_magic(stream)
        if version != (1, 0):
            raise ValueError(f"version {version} of the array format is not used here")
        shape, fortran_order, found = npy_format.read_array_header_1_0(stream)
    except ValueError as error:
        raise InputError(f"{name} at byte {offset} is no array: {error}") from error
    if found != dtype.newbyteorder("<") or fortran_order:
        raise InputError(f"{name} at byte {offset} holds {found}, where {dtype} in rows is expected")
    count = int(np.prod([int(length) for length in shape], dtype=object)) if shape else 1
    start = stream.tell()
    if min(shape, default=0) < 0 or count * dtype.itemsize != len(content) - start:
        raise InputError(
            f"{name} at byte {offset} declares the shape {shape}, but holds {len(content) - start} bytes of numbers"
        )
    return np.frombuffer(content, found, offset=start).astype(dtype, copy=False).reshape(shape)
