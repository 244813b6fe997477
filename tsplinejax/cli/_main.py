"""The entry point: reads the words, runs the command, says the outcome.

Exit codes: 0, the criterion was met (or the command has none); 1, the fit stopped earlier, and the model was written;
2, bad use or input, and nothing was written. Results go to standard output, everything else to standard error.
"""

import gc
import io
import os
import sys
import warnings
from collections.abc import Sequence
from contextlib import contextmanager

from .._version import __version__
from . import (
    _areal,
    _batch,
    _compress,
    _convert,
    _demo,
    _evaluate,
    _fill,
    _filter,
    _fit,
    _form,
    _info,
    _mra,
    _plot,
    _reconstruct,
    _sample,
)
from ._arguments import Parser, joined_negatives
from ._environment import CACHE_VARIABLE, prepare_jax
from ._outcome import REFUSED, Outcome, as_json, one_line, reason

#: In the order of `--help`.
_MODULES = (
    _fit,
    _batch,
    _form,
    _areal,
    _filter,
    _mra,
    _fill,
    _sample,
    _reconstruct,
    _compress,
    _evaluate,
    _info,
    _convert,
    _plot,
    _demo,
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command of `tsplinejax`.

    **Arguments:**

    - `argv`: the words after the program's name; by default those of the process.

    **Returns:** the exit code.

    >>> main(["--version"])
    tsplinejax ...
    0
    """
    _write_any_character()
    if argv is None:
        _collect_rarely()
    words = joined_negatives(sys.argv[1:] if argv is None else argv)
    try:
        with _plain_warnings():
            arguments = make_parser().parse_args(words)
            prepare_jax()
            outcome = arguments.run(arguments)
    except SystemExit as stop:  # argparse leaves this way after --help and --version
        return int(stop.code or 0)
    except KeyboardInterrupt:
        return _refuse("interrupted before there was a result; nothing was written")
    except Exception as error:
        return _refuse(reason(error))
    _say(outcome, as_object=arguments.json)
    return outcome.code


def _collect_rarely() -> None:
    """Spare a process of its own the search for cycles in all that imports and kernels hold: a twentieth of a start."""
    gc.freeze()
    gc.set_threshold(200_000)


def make_parser() -> Parser:
    """The parser of all commands."""
    parser = Parser(
        prog="tsplinejax",
        description="T-splines for surface metrology: locally refined models of measured surfaces.",
        epilog="exit codes: 0 the criterion was met; 1 the fit stopped earlier, the model is written; 2 bad use or "
        f"input, nothing is written. Compiled kernels are kept in the user's cache folder; {CACHE_VARIABLE} names "
        "another, or is 'off'. Example: tsplinejax fit map.x3p -o map.tspl --tolerance 5nm",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"tsplinejax {__version__}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for module in _MODULES:
        module.add(commands)
    return parser


def _say(outcome: Outcome, *, as_object: bool) -> None:
    """Print warnings to standard error and the outcome to standard output."""
    for warning in outcome.report.get("warnings", ()):
        print(f"tsplinejax: warning: {one_line(warning)}", file=sys.stderr)
    try:
        print(as_json(outcome.report) if as_object else "\n".join(outcome.lines), flush=True)
    except BrokenPipeError:  # the reader, `head` for instance, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refuse(message: str) -> int:
    print(f"tsplinejax: error: {one_line(message)}", file=sys.stderr)
    return REFUSED


@contextmanager
def _plain_warnings():
    """Show Python's warnings as one line each, without the place in the source."""

    def show(message, category, filename, lineno, file=None, line=None) -> None:
        print(f"tsplinejax: warning: {one_line(message)}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.showwarning = show
        # Another process may be writing the very entry of the cache: it is then compiled again.
        warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry", UserWarning)
        yield


def _write_any_character() -> None:
    """Let µ and × through to terminals that have no such letters."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
