"""Files on disk: they are not trusted when read, and appear whole or not at all when written."""

import hashlib
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from .._errors import InputError, MissingExtraError

#: No file may declare more numbers than this (8 GiB of float64); larger data are read in parts.
MOST_VALUES = 2**30

_LONGEST_REASON = 200


def existing_file(path: str | os.PathLike) -> Path:
    """Return the path of a readable file that is not empty, or raise `InputError`."""
    try:
        file = Path(path)
    except TypeError as error:
        raise InputError(f"a path is text or a pathlib.Path, but got {type(path).__name__}") from error
    if file.is_dir():
        raise InputError(f"{file} is a folder; name a file in it")
    if not file.exists():
        raise InputError(f"{file} does not exist; check the path")
    try:
        with file.open("rb") as stream:
            empty = not stream.read(1)
    except OSError as error:
        raise InputError(f"{file} cannot be opened: {error.strerror}; check its permissions") from error
    if empty:
        raise InputError(f"{file} is empty; copy or export it again")
    return file


def sha256_of(file: Path) -> str:
    """Return the SHA-256 of a file's bytes in hexadecimal."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


@contextmanager
def reading(file: Path) -> Iterator[None]:
    """Turn whatever a reader raises into one line that names the file and the remedy.

    Readers of foreign formats answer bad bytes with nearly any exception, so all are caught; the original one stays
    attached as the cause.
    """
    try:
        yield
    except MissingExtraError:
        raise
    except InputError as error:
        raise InputError(f"{file.name}: {error}") from error
    except (Exception, MemoryError) as error:
        raise InputError(
            f"{file.name} cannot be read as {file.suffix.lower()}: {_reason(error)}; "
            "the file may be truncated, corrupted or of another format: copy or export it again"
        ) from error


def _reason(error: BaseException) -> str:
    if isinstance(error, MemoryError):
        return "it asks for more memory than there is"
    if isinstance(error, KeyError):
        return f"the entry {error} is missing"
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= _LONGEST_REASON else text[:_LONGEST_REASON] + " ..."


def check_count(count: int, what: str, *, available: int | None = None) -> None:
    """Refuse a declared number of values that is absurd, before memory is taken for it.

    **Arguments:**

    - `count`: what the file's header declares.
    - `what`: what is counted, for the message.
    - `available`: how many the rest of the file can hold, where that is known.
    """
    if count < 1:
        raise InputError(f"its header declares {count} {what}; at least one is needed")
    if count > MOST_VALUES:
        raise InputError(f"its header declares {count} {what}, more than the {MOST_VALUES} that are read at once")
    if available is not None and count > available:
        raise InputError(
            f"its header declares {count} {what}, but the file holds at most {available}: "
            "it is truncated or corrupted; copy or export it again"
        )


@contextmanager
def written_whole(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """Open a temporary file beside `path` and move it there once it is complete; on any failure leave nothing.

    **Raises:** `InputError` when the folder does not exist or cannot be written to.
    """
    target = Path(path)
    folder = target.parent
    if not folder.is_dir():
        raise InputError(f"the output folder {folder} does not exist; create it first")
    if target.is_dir():
        raise InputError(f"{target} is a folder; name a file in it")
    temporary = folder / f".{target.name}.{secrets.token_hex(4)}.part"
    try:
        with temporary.open("xb") as stream:
            yield stream
        os.replace(temporary, target)
    except OSError as error:
        raise InputError(
            f"{target} cannot be written: {error.strerror or error}; check space and permissions"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)
