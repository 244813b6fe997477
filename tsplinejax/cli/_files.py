"""Files that commands read and write: checked before any long computation starts."""

import argparse
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._errors import InputError, require
from ..codec import MODEL_SUFFIX
from ..data import HeightMap, PointCloud
from ..io import read
from ..io._files import existing_file, sha256_of, written_whole
from ._arguments import data_options

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PICTURES = (".png", ".pdf", ".svg")


def read_data(path: str, arguments: argparse.Namespace) -> HeightMap | PointCloud:
    """Read data with the shared options."""
    existing_file(path)
    if is_model(path):
        raise InputError(f"{path} is a model; name the data that it is of, or use info, evaluate or plot on the model")
    return read(path, **data_options(arguments))  # type: ignore[arg-type]


def read_map(arguments: argparse.Namespace, what: str) -> HeightMap:
    """Read the input, which must be a height map; `what` says what is done with it."""
    data = read_data(arguments.input, arguments)
    if not isinstance(data, HeightMap):
        raise InputError(
            f"{what} a height map, but {arguments.input} is a point cloud; read it with --as map where its points are "
            "a full grid, or take its form off first: tsplinejax form"
        )
    return data


def is_model(path: str) -> bool:
    """Whether a file's name says that it is a model."""
    return Path(path).suffix.lower() == MODEL_SUFFIX


def checked_model(path: str) -> str:
    """The path of a model to read."""
    file = existing_file(path)
    if not is_model(path):
        raise InputError(f"a model file ends in {MODEL_SUFFIX}, but got {file.name!r}; make one with: tsplinejax fit")
    return path


def checked_output(path: str, suffixes: tuple[str, ...], *inputs: str | None) -> Path:
    """The path to write, after checking what can be known before there is something to write.

    **Raises:** `InputError` for a suffix that is not among `suffixes`, a folder that is missing or cannot be written
    to, and a file that is one of the inputs.
    """
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise InputError(f"{target.name!r} cannot be written here; use one of the suffixes {' '.join(suffixes)}")
    if not target.parent.is_dir():
        raise InputError(f"the output folder {target.parent} does not exist; create it first")
    if target.is_dir():
        raise InputError(f"{target} is a folder; name a file in it")
    if not os.access(target.parent, os.W_OK):
        raise InputError(f"the output folder {target.parent} cannot be written to; check its permissions")
    for source in inputs:
        if source is not None and target.exists() and Path(source).exists() and target.samefile(source):
            raise InputError(f"{target} is the input, too, and would be lost; write to another file")
    return target


def checked_picture(path: str | None, *inputs: str | None) -> Path | None:
    """The path of a picture to write, if there is to be one; matplotlib must then be there."""
    if path is None:
        return None
    target = checked_output(path, _PICTURES, *inputs)
    # Drawn off screen whatever the machine's settings.
    require("matplotlib", "plot").use("agg")
    return target


def write_picture(target: Path | None, draw: Callable[[], "Figure | Axes"]) -> None:
    """Draw a figure (or axes in one) and write it where there is a path; the file appears whole or not at all."""
    if target is None:
        return
    figure: Any = draw().figure
    # Neither date nor random names: equal figures give equal files.
    metadata: dict[str, Any] = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(target.suffix.lower(), {})
    same_names = require("matplotlib", "plot").rc_context({"svg.hashsalt": "tsplinejax"})
    with same_names, written_whole(target) as stream:
        figure.savefig(stream, format=target.suffix.lower()[1:], metadata=metadata)
    require("matplotlib.pyplot", "plot").close(figure)


def named(path: str | Path) -> dict[str, str]:
    """What tells a file from others: its name and the hash of its bytes."""
    return {"name": Path(path).name, "sha256": sha256_of(Path(path))}
