"""Point clouds of the Point Cloud Library: `.pcd`, as text, binary, or binary compressed with LZF."""

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .._errors import InputError
from ._files import check_count
from ._raw import RawCloud

_KINDS = {"F": "f", "I": "i", "U": "u"}
_MOST_EXPANSION = 100  # LZF turns three bytes into at most 264


@dataclass(frozen=True)
class _Header:
    names: tuple[str, ...]
    dtypes: tuple[np.dtype, ...]
    counts: tuple[int, ...]
    points: int
    encoding: str

    @property
    def record(self) -> np.dtype:
        columns = zip(self.names, self.dtypes, self.counts, strict=True)
        return np.dtype([(f"{k}:{name}", dtype, (count,)) for k, (name, dtype, count) in enumerate(columns)])

    @property
    def axes(self) -> list[int]:
        return [self.names.index(axis) for axis in "xyz"]


def read_pcd(file: Path) -> RawCloud:
    """Read x, y, z of a `.pcd` file; its other fields are left."""
    content = file.read_bytes()
    header, start = _header(content)
    body = content[start:]
    check_count(header.points, "points", available=_most_points(len(body), header))
    columns = _DECODERS[header.encoding](body, header)
    others = [name for name in header.names if name not in "xyz"]
    notes = (f"fields not read: {' '.join(others)}",) if others else ()
    return RawCloud(np.stack([np.asarray(column).reshape(-1) for column in columns], axis=1), notes=notes)


def _most_points(size: int, header: _Header) -> int:
    if header.encoding == "ascii":
        return size // 5  # at least three digits and two separators
    expansion = _MOST_EXPANSION if header.encoding == "binary_compressed" else 1
    return size * expansion // header.record.itemsize


def _header(content: bytes) -> tuple[_Header, int]:
    entries: dict[str, list[str]] = {}
    position = 0
    while "DATA" not in entries:
        end = content.find(b"\n", position, position + 4096)
        if end < 0:
            raise InputError("its header has no DATA line: it is no .pcd file, or truncated")
        words = content[position:end].decode("ascii", "replace").split("#")[0].split()
        if words:
            entries[words[0]] = words[1:]
        position = end + 1
    names = tuple(entries["FIELDS"])
    dtypes = tuple(
        np.dtype(f"<{_KINDS[kind]}{int(size)}") for kind, size in zip(entries["TYPE"], entries["SIZE"], strict=True)
    )
    counts = tuple(int(count) for count in entries.get("COUNT", ["1"] * len(names)))
    width_times_height = int(entries["WIDTH"][0]) * int(entries["HEIGHT"][0])
    points = int(entries.get("POINTS", [str(width_times_height)])[0])
    if not set("xyz") <= set(names) or len(dtypes) != len(names) or len(counts) != len(names):
        raise InputError(f"its fields {' '.join(names)} do not give x, y and z with type and size each")
    if min(counts) < 1 or points != width_times_height or entries["DATA"][0] not in _DECODERS:
        raise InputError(f"its header contradicts itself: {points} points, {width_times_height} in WIDTH × HEIGHT")
    return _Header(names, dtypes, counts, points, entries["DATA"][0]), position


def _decode_text(body: bytes, header: _Header) -> list[np.ndarray]:
    first = [sum(header.counts[:axis]) for axis in header.axes]
    table = np.loadtxt(io.BytesIO(body), usecols=first, ndmin=2) if body.strip() else np.empty((0, 3))
    if len(table) != header.points:
        raise InputError(f"it holds {len(table)} of the {header.points} points its header declares: it is truncated")
    return list(table.T)


def _decode_binary(body: bytes, header: _Header) -> list[np.ndarray]:
    record = header.record
    table = np.frombuffer(body, record, header.points)
    names = list(record.fields or ())
    return [table[names[axis]][:, 0] for axis in header.axes]


def _decode_compressed(body: bytes, header: _Header) -> list[np.ndarray]:
    if len(body) < 8:
        raise InputError("it ends before its data: it is truncated")
    packed, unpacked = np.frombuffer(body, "<u4", 2).tolist()
    if packed > len(body) - 8 or unpacked != header.points * header.record.itemsize:
        raise InputError(
            f"it declares {packed} compressed bytes for {unpacked}, but holds {len(body) - 8} for "
            f"{header.points * header.record.itemsize}: it is truncated or corrupted"
        )
    values = decompress_lzf(body[8 : 8 + packed], unpacked)
    widths = [dtype.itemsize * count for dtype, count in zip(header.dtypes, header.counts, strict=True)]
    columns = []
    for axis in header.axes:
        start = header.points * sum(widths[:axis])
        column = np.frombuffer(values, header.dtypes[axis], header.points * header.counts[axis], start)
        columns.append(column[:: header.counts[axis]])
    return columns


_DECODERS = {"ascii": _decode_text, "binary": _decode_binary, "binary_compressed": _decode_compressed}


def decompress_lzf(packed: bytes, size: int) -> bytes:
    """Expand LZF data: runs of literal bytes, and copies of what went before.

    A control byte below 32 is followed by that many plus one literals. Otherwise its upper three bits are a length
    minus two (7: one more byte follows), its lower five bits with the next byte the distance back minus one.

    **Raises:** `InputError` unless exactly `size` bytes come out.

    >>> decompress_lzf(bytes([0, 97, 0x60, 0]), 6)
    b'aaaaaa'
    """
    result = bytearray()
    position, end = 0, len(packed)
    try:
        while position < end and len(result) <= size:
            control = packed[position]
            position += 1
            if control < 32:
                result += packed[position : position + control + 1]
                position += control + 1
                continue
            length = control >> 5
            if length == 7:
                length += packed[position]
                position += 1
            distance = ((control & 31) << 8) + packed[position] + 1
            position += 1
            _copy_back(result, distance, length + 2)
    except IndexError as error:
        raise InputError(f"its compressed data end within a copy, at byte {position}: it is corrupted") from error
    if len(result) != size:
        raise InputError(f"its compressed data give {len(result)} bytes instead of {size}: it is corrupted")
    return bytes(result)


def _copy_back(result: bytearray, distance: int, length: int) -> None:
    if distance > len(result):
        raise InputError(
            f"its compressed data refer to before their start, at output byte {len(result)}: it is corrupted"
        )
    start = len(result) - distance
    pattern = result[start : start + length]
    repeats = -(-length // len(pattern))
    result += (pattern * repeats)[:length]
