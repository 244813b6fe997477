"""Maps that are fitted from disk: `--max-memory`, and what does not go with it."""

import argparse
import re

from .._errors import InputError
from ..data import StoredMap
from ..io import open_stored
from ._outcome import pair, quantity

_SIZE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*([kMGT]?)(i?)B\s*", re.IGNORECASE)
_NEED_MEMORY = {
    "height_unit": "--height-unit",
    "mask": "--mask",
    "crop": "--crop",
    "as_": "--as",
    "robust": "--robust",
    "as_surface": "--as-surface",
    "plot": "--plot",
}


def add_memory_option(parser: argparse.ArgumentParser) -> None:
    """Add `--max-memory`."""
    parser.add_argument(
        "--max-memory",
        metavar="SIZE",
        type=size,
        help="leave a .npy file or .zarr folder on disk and fit it page by page within this memory: 500MB, 4GB",
    )


def size(text: str) -> float:
    """Bytes written with a unit.

    >>> size("4GB"), size("1.5 MiB")
    (4000000000.0, 1572864.0)
    """
    match = _SIZE.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"a size such as 500MB or 4GB is needed, but got {text!r}")
    base = 1024 if match[3] else 1000
    return float(match[1]) * float(base ** " kmgt".index(match[2].lower() or " "))


def stored_data(arguments: argparse.Namespace) -> StoredMap:
    """The input, opened without reading it.

    **Raises:** `InputError` for options that need all of it in memory, before anything is computed.
    """
    given = [option for name, option in _NEED_MEMORY.items() if getattr(arguments, name)]
    if arguments.level != "none":
        given.append("--level")
    if given:
        raise InputError(
            f"{', '.join(given)} would need the whole map in memory, and --max-memory leaves it on disk; leave out one "
            "or the other"
        )
    return open_stored(arguments.input, spacing=arguments.spacing, unit=arguments.unit)


def described_stored(data: StoredMap) -> str:
    """The map in a few words."""
    rows, columns = data.shape
    return (
        f"{rows} rows × {columns} columns, spacing {pair(*data.spacing, data.unit)}, "
        f"range {quantity(data.range, data.unit)}, left on disk"
    )
