"""`tsplinejax batch fit`: every file of a folder fitted, each with a mesh and a model of its own."""

import argparse
import sys
from collections.abc import Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from .._errors import InputError, require
from ..codec import MODEL_SUFFIX, save
from ..fitting import BatchItem, FitResult, fit_batch
from ..io import READABLE
from ..plot import plot_overview
from ._arguments import add_command, add_input, add_output
from ._files import checked_output, checked_picture, write_picture
from ._fit import add_fit_options, fit_options, prepared_data, report_of
from ._outcome import MET, STOPPED_EARLIER, Outcome, quantity, reason, table, written

_EXAMPLE = "tsplinejax batch fit maps -o models --pattern 'scan_*' --tolerance 5nm"
_PICTURE_SUFFIX = ".png"
_NOT_REACHED = "not fitted: the batch was interrupted before its turn"


def add(subparsers: argparse._SubParsersAction) -> None:
    """Add the command to the parser."""
    batch = subparsers.add_parser(
        "batch", help="a command for every file of a folder", epilog=f"example: {_EXAMPLE}", allow_abbrev=False
    )
    actions = batch.add_subparsers(dest="action", metavar="COMMAND", required=True)
    parser = add_command(
        actions,
        "fit",
        "fit every file of a folder, and write one model each",
        _EXAMPLE,
        run,
    )
    add_input(parser, "folder of height maps and point clouds; not those within it", "FOLDER")
    add_output(parser, "folder for the models, NAME.tspl; made if missing", "OUTFOLDER")
    parser.add_argument(
        "--pattern", metavar="GLOB", default="*", help="names of the files to fit, in quotes (default: all)"
    )
    parser.add_argument("--plots", action="store_true", help="draw each fit, too: OUTFOLDER/NAME.png")
    add_fit_options(parser, "a file")


def run(arguments: argparse.Namespace) -> Outcome:
    """Fit file after file; what goes wrong with one is said, and the next has its turn."""
    paths, skipped = _inputs(arguments)
    folder, made = _output_folder(arguments)
    rows: list[dict[str, Any]] = []
    try:
        options = fit_options(arguments)
        for item in fit_batch(paths, read=lambda path: prepared_data(str(path), arguments), **options):
            rows.append(_row(paths[len(rows)], item, folder, arguments))
    except KeyboardInterrupt:
        pass
    interrupted = len(rows) < len(paths)
    written = sum("model" in row for row in rows)
    if not written:
        if made:
            with suppress(OSError):
                folder.rmdir()
        if interrupted:
            raise KeyboardInterrupt
        raise InputError(f"none of the {len(paths)} files in {arguments.input} could be fitted; nothing was written")
    rows += [{"input": str(path), "error": _NOT_REACHED} for path in paths[len(rows) :]]
    report = {
        "output": str(folder),
        "converged": all(row.get("converged", False) for row in rows),
        "fitted": written,
        "failed": len(rows) - written,
        "skipped": [path.name for path in skipped],
        "warnings": _warnings(rows, interrupted),
        "items": rows,
    }
    return Outcome(report, _lines(rows, report), MET if report["converged"] else STOPPED_EARLIER)


def _inputs(arguments: argparse.Namespace) -> tuple[list[Path], list[Path]]:
    """The files to fit in the order of their names, and those that no reader knows; no two may share a model's name."""
    folder = Path(arguments.input)
    if not folder.is_dir():
        raise InputError(
            f"{folder} is no folder that exists; check the path, and for a single file use: tsplinejax fit"
        )
    mask = None if arguments.mask is None else Path(arguments.mask).resolve()
    try:
        names = sorted(folder.iterdir())
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be read: {error.strerror}; check its permissions") from error
    listed = [path for path in names if path.is_file() and not path.name.startswith(".") and path.resolve() != mask]
    matching = [path for path in listed if fnmatchcase(path.name, arguments.pattern)]
    known = [path for path in matching if path.suffix.lower() in READABLE]
    if not known:
        raise InputError(
            f"{folder} holds no data file named {arguments.pattern!r} among its {len(listed)} files; readable are "
            f"{' '.join(READABLE)}"
        )
    by_model: dict[str, Path] = {}
    for path in known:
        # Folders that ignore case hold one of A.tspl and a.tspl.
        other = by_model.setdefault(path.stem.casefold(), path)
        if other is not path:
            raise InputError(
                f"{other.name} and {path.name} would both be written to {path.stem}{MODEL_SUFFIX}; rename one, "
                "or choose with --pattern"
            )
    return known, [path for path in matching if path not in known]


def _output_folder(arguments: argparse.Namespace) -> tuple[Path, bool]:
    """The folder for the models, and whether it was made here."""
    folder = Path(arguments.output)
    if arguments.plots:
        require("matplotlib", "plot")
        if folder.is_dir() and folder.samefile(arguments.input):
            raise InputError(
                f"pictures in {folder}, the folder of the data, would be read as maps the next time; name another "
                "with -o"
            )
    made = not folder.exists()
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(f"the folder {folder} cannot be made: {error.strerror}; name another with -o") from error
    return folder, made


def _row(path: Path, item: BatchItem, folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Write what came of a file, and tell it; an error is said at once."""
    error = item.error
    if item.result is not None:
        try:
            return {"input": str(path), **_written(path, item.result, folder, arguments), **report_of(item.result)}
        except Exception as raised:
            error = raised
    assert error is not None
    text = reason(error)
    _say_error(text if path.name in text else f"{path.name}: {text}")
    return {"input": str(path), "error": text}


def _written(path: Path, result: FitResult, folder: Path, arguments: argparse.Namespace) -> dict[str, Any]:
    """Write the model and, where asked for, the picture; neither takes the place of a file that was read."""
    target = folder / (path.stem + MODEL_SUFFIX)
    picture = folder / (path.stem + _PICTURE_SUFFIX) if arguments.plots else None
    checked_output(str(target), (MODEL_SUFFIX,), str(path), arguments.mask)
    if picture is not None:
        checked_picture(str(picture), str(path), arguments.mask)
        write_picture(picture, lambda: plot_overview(result))
    save(target, result)
    return written(model=target, plot=picture)


def _say_error(text: str) -> None:
    """One line on standard error, above the progress bar where there is one."""
    from tqdm import tqdm

    tqdm.write(f"tsplinejax: error: {text}", file=sys.stderr)


def _warnings(rows: Sequence[dict[str, Any]], interrupted: bool) -> list[str]:
    """Every file's warnings under its name."""
    found = [f"{Path(row['input']).name}: {warning}" for row in rows for warning in row.get("warnings", ())]
    left = sum(row.get("error") == _NOT_REACHED for row in rows)
    return [*found, f"interrupted; files that were not fitted: {left}"] if interrupted else found


def _lines(rows: Sequence[dict[str, Any]], report: dict[str, Any]) -> tuple[str, ...]:
    """One line a file, then the whole."""
    told = [(Path(row["input"]).name, _told(row)) for row in rows]
    met = sum(row.get("converged", False) for row in rows)
    count = f"models in {report['output']}: {report['fitted']} of {len(rows)}; criterion met: {met}"
    left_out = [("left out", ", ".join(report["skipped"]))] if report["skipped"] else []
    return (*table([*told, *left_out]), count)


def _told(row: dict[str, Any]) -> str:
    """One file's outcome in a few words."""
    if "error" in row:
        return "failed" if row["error"] != _NOT_REACHED else "not fitted"
    outcome = "met" if row["converged"] else f"not met ({row['stop']})"
    error = quantity(row["max_error"], row["unit"])
    return f"{outcome}: {row['control_points']} control points, largest error {error}, {row['seconds']:.1f} s"
