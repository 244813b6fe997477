"""The frame of a compressed file: a mark, a header, the coded sections, and a checksum over all of it.

    8 bytes   mark
    4 bytes   length of the header, little-endian
    header    JSON, deflated; its entry `sections` holds the lengths of what follows
    sections  bytes
    8 bytes   BLAKE2b of everything before

Nothing is unpacked before the checksum is right, and nothing grows beyond a limit that is known beforehand.
"""

import hashlib
import json
import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

from .._errors import InputError
from ._entries import LONGEST_HEADER

#: First bytes of a compressed file; the line ends show what a transfer as text did to it.
MARK = b"\x89TSPL\r\n\x02"
_LENGTH = struct.Struct("<I")
_SUM = 8
_MOST_SECTIONS = 3
#: Text that headers have in common: deflate refers to it instead of repeating it.
_USUAL = (
    b'{"software":"tsplinejax 0.1.0","provenance":{"name":"","sha256":"","operations":[],"notes":[],"input":{}},'
    b'"unit":"nm","unit":"mm","unit":"\xc2\xb5m","unit":null,"origin":[0.0,0.0],"spacing":[1.0,1.0],"missing":0,'
    b'"dtype":"float32","dtype":"float64","shape":[512,512],"tolerance":0.01,"max_error":0.00,"offset":0.0,"step":0.0,'
    b'"mode":"lossless","mode":"grid","mode":"model","model":{"lattice":[8,8],"first_cut":"s","point_step":0.0,'
    b'"control_points":1000,"residual":false},"residual":true,"first_cut":"t","model":null,"sections":[0,0]}'
)


def sealed(header: Mapping[str, Any], sections: Sequence[bytes]) -> bytes:
    """A header and sections as one string of bytes; the same input gives the same bytes."""
    entries = {**header, "sections": [len(section) for section in sections]}
    text = json.dumps(entries, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    if len(text) > LONGEST_HEADER:
        raise InputError(f"the provenance of the data takes {len(text)} bytes; a header holds {LONGEST_HEADER}")
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15, 9, zdict=_USUAL)
    packed = deflate.compress(text) + deflate.flush()
    content = b"".join([MARK, _LENGTH.pack(len(packed)), packed, *sections])
    return content + _checksum(content)


def opened(content: bytes) -> tuple[dict[str, Any], list[memoryview]]:
    """Header and sections of a compressed file.

    **Raises:** `InputError` for bytes that are no such file, or that were damaged.
    """
    start = len(MARK) + _LENGTH.size
    if content[: len(MARK)] != MARK:
        raise InputError(
            "its first bytes are not those of a compressed height map; make one with compress, or turn a model into a "
            "map with evaluate (tsplinejax evaluate)"
        )
    view = memoryview(content)
    if len(content) < start + _SUM or _checksum(view[:-_SUM]) != view[-_SUM:]:
        raise InputError(f"its checksum is wrong ({len(content)} bytes): it is truncated or corrupted; copy it again")
    (length,) = _LENGTH.unpack_from(content, len(MARK))
    if length > len(content) - start - _SUM:
        raise InputError(f"its header of {length} bytes at byte {start} would end after the file")
    header = _header(view[start : start + length])
    return header, _split(view[start + length : -_SUM], header.get("sections"))


def _checksum(content: bytes | memoryview) -> bytes:
    return hashlib.blake2b(content, digest_size=_SUM).digest()


def _header(packed: memoryview) -> dict[str, Any]:
    inflate = zlib.decompressobj(-15, zdict=_USUAL)
    try:
        text = inflate.decompress(packed, LONGEST_HEADER)
        header = json.loads(text, parse_constant=_refused)
    except (zlib.error, ValueError, RecursionError) as error:
        raise InputError(f"its header is no JSON text: {error}") from error
    if not isinstance(header, dict) or not inflate.eof:
        raise InputError("its header is no JSON object, or has more bytes than are read")
    return header


def _refused(word: str) -> None:
    raise ValueError(f"{word} is no number")


def _split(body: memoryview, lengths: Any) -> list[memoryview]:
    few = isinstance(lengths, list) and len(lengths) <= _MOST_SECTIONS
    whole = few and all(type(length) is int and length >= 0 for length in lengths)
    if not whole or sum(lengths) != len(body):
        raise InputError(f"its sections are declared as {str(lengths)[:80]}, but hold {len(body)} bytes together")
    sections, start = [], 0
    for length in lengths:
        sections.append(body[start : start + length])
        start += length
    return sections
