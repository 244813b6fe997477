"""Damaged and hostile files: what a transfer, a bad disk or an adversary may make of a compressed file."""

import json
import zlib

import numpy as np

from tsplinejax.codec._sections import _LENGTH, _SUM, _USUAL, MARK, _checksum

NUMBERS = (0, 1, -1, 2, 3, 7, 255, 2**16, 2**20, 2**31 - 1, 2**31, 2**40, 2**63, 10**30, 0.5, -0.5, 1e-320, 1e308, 1e-9)
OTHERS = (None, True, "", "x" * 300, [], {}, [1], [1, 2, 3], [[1]], {"a": 1}, "float16", "grid", "model", "lossless")


def mutant(content: bytes, rng: np.random.Generator) -> bytes:
    """A file that differs from the given one: raw bytes for the most part, else whatever a right checksum covers."""
    kinds = (_flipped, _truncated, _spliced, _other_header, _other_header, _other_sections, _other_bytes)
    return kinds[rng.integers(len(kinds))](content, rng)


def _flipped(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three flipped bits."""
    changed = bytearray(content)
    for place in rng.integers(len(changed), size=rng.integers(1, 4)):
        changed[place] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _truncated(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut off, or with something behind it."""
    end = int(rng.integers(len(content) + 1))
    return content[:end] + rng.bytes(int(rng.integers(0, 20))) * int(rng.integers(0, 2))


def _spliced(content: bytes, rng: np.random.Generator) -> bytes:
    """A piece of it replaced by noise, zeros, or another piece."""
    start, end = sorted(int(place) for place in rng.integers(len(content) + 1, size=2))
    new = (rng.bytes(end - start), bytes(end - start), content[: end - start], b"")[rng.integers(4)]
    return content[:start] + new + content[end:]


def parts(content: bytes) -> tuple[dict, bytes]:
    """The header's entries and everything between header and checksum."""
    start = len(MARK) + _LENGTH.size
    (length,) = _LENGTH.unpack(content[len(MARK) : start])
    inflate = zlib.decompressobj(-15, zdict=_USUAL)
    header = json.loads(inflate.decompress(content[start : start + length]))
    return header, content[start + length : -_SUM]


def resealed(header: object, body: bytes, *, raw: bytes | None = None) -> bytes:
    """A file with a right checksum around any header."""
    deflate = zlib.compressobj(9, zlib.DEFLATED, -15, 9, zdict=_USUAL)
    packed = deflate.compress(json.dumps(header).encode()) + deflate.flush() if raw is None else raw
    content = MARK + _LENGTH.pack(len(packed)) + packed + body
    return content + _checksum(content)


def _other_header(content: bytes, rng: np.random.Generator) -> bytes:
    """One to three other entries in the header, or one less, checksum right."""
    header, body = parts(content)
    for _ in range(rng.integers(1, 4)):
        _change(header, rng)
    return resealed(header, body)


def _change(entries: dict, rng: np.random.Generator) -> None:
    name = list(entries)[rng.integers(len(entries))]
    value = entries[name]
    kind = rng.integers(5)
    if isinstance(value, dict) and value and kind > 0:
        _change(value, rng)
    elif isinstance(value, list) and value and kind > 1:
        value[rng.integers(len(value))] = _number(rng)
    elif kind == 1 and len(entries) > 1:
        del entries[name]
    elif kind == 2:
        entries[name] = OTHERS[rng.integers(len(OTHERS))]
    elif isinstance(value, int | float) and kind == 3:
        entries[name] = value + int(rng.integers(-2, 3))
    else:
        entries[name] = _number(rng)


def _number(rng: np.random.Generator) -> float:
    return NUMBERS[rng.integers(len(NUMBERS))]


def _other_sections(content: bytes, rng: np.random.Generator) -> bytes:
    """Coded numbers that no encoder wrote, checksum and lengths right."""
    header, body = parts(content)
    body = (_flipped, _spliced, _truncated)[rng.integers(3)](body, rng) if body else rng.bytes(30)
    lengths = header["sections"]
    if len(body) >= sum(lengths[:-1]):
        lengths[-1] = len(body) - sum(lengths[:-1])
    if rng.integers(4) == 0:  # the larger the map, the longer it is until the coded numbers end
        header["shape"] = [int(rng.integers(1, 5000)), int(rng.integers(1, 5000))]
    return resealed(header, body)


def _other_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    """A header of noise, of endless zeros or of deep brackets, checksum right."""
    _, body = parts(content)
    texts = (rng.bytes(40), zlib.compress(bytes(5_000_000), 9)[2:-4], zlib.compress(b"[" * 100_000, 9)[2:-4], b"")
    return resealed(None, body, raw=texts[rng.integers(len(texts))])
