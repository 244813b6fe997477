"""Options that several commands share, and how their words are read."""

import argparse
import re
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from .._errors import InputError
from ..data import canonical_unit

_COUNTS = re.compile(r"\s*(\d{1,9})\s*[xX×]\s*(\d{1,9})\s*")
_NEGATIVE = re.compile(r"-[\d.]")


class Parser(argparse.ArgumentParser):
    """An argument parser whose errors are `InputError`, one line each."""

    def error(self, message: str) -> NoReturn:
        """Raise what the user did wrong, and where to read on."""
        left = message.removeprefix("unrecognized arguments: ").split()
        if left != message.split() and _is_unit(left[0]):
            message = f"{message}; write a length without a space, as in 5{left[0]}"
        raise InputError(f"{' '.join(message.split())}; see {self.prog} --help")


def _is_unit(word: str) -> bool:
    try:
        return canonical_unit(word) is not None
    except InputError:
        return False


def add_command(
    subparsers: argparse._SubParsersAction, name: str, summary: str, example: str, run: Callable[..., Any]
) -> Parser:
    """Add a command with what all have: what runs it, `--json`, and a help that ends with an example."""
    parser = subparsers.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.",
        epilog=f"example:\n  {example}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.set_defaults(run=run)
    parser.add_argument("--json", action="store_true", help="print one JSON object on standard output, nothing else")
    return parser


def add_input(parser: argparse.ArgumentParser, what: str = "height map", metavar: str = "INPUT") -> None:
    """Add the file that a command reads."""
    parser.add_argument("input", metavar=metavar, help=what)


def add_output(parser: argparse.ArgumentParser, what: str, metavar: str = "OUT") -> None:
    """Add the file that a command writes."""
    parser.add_argument("-o", "--output", metavar=metavar, required=True, help=what)


def add_plot(parser: argparse._ActionsContainer, what: str) -> None:
    """Add a picture to draw."""
    parser.add_argument("--plot", metavar="FILE.png", help=what)


def add_tolerances(parser: argparse._ActionsContainer, what: str, *, noise: str | None = None) -> None:
    """Add the ways to state a tolerance, of which one may be given."""
    one = parser.add_mutually_exclusive_group()
    one.add_argument("--tolerance", metavar="X", help=what)
    one.add_argument(
        "--relative-tolerance", metavar="X", type=share, help="the same as a share of the range: 0.01 or 1%%"
    )
    if noise is not None:
        one.add_argument("--noise", metavar="auto|X", help=noise)


def add_data_options(parser: argparse.ArgumentParser, what: str = "the input") -> None:
    """Add the options that say what a file of data does not say itself."""
    group = parser.add_argument_group(f"what {what} does not say itself")
    group.add_argument("--spacing", metavar="DX[,DY]", help="pixel spacing, in --unit or with a unit, as in 0.5um")
    group.add_argument(
        "--unit", metavar="U", help="unit of x, y and z: nm, um, mm, m, ...; data in another are converted"
    )
    group.add_argument("--height-unit", metavar="U", help="unit of the heights, if it differs from --unit")
    group.add_argument(
        "--mask", metavar="FILE", help="array or image of the map's shape; non-zero marks missing pixels"
    )
    group.add_argument("--crop", metavar="X0,Y0,X1,Y1", help="keep this rectangle, in the data's unit")
    group.add_argument("--as", dest="as_", choices=("map", "cloud"), help="read as a height map or as a point cloud")


def data_options(arguments: argparse.Namespace) -> dict[str, str | None]:
    """The shared options as `read` takes them."""
    return {name: getattr(arguments, name) for name in ("spacing", "unit", "height_unit", "mask", "crop", "as_")}


def joined_negatives(words: Sequence[str]) -> list[str]:
    """Write `--crop -1,0,2,3` as `--crop=-1,0,2,3`: argparse takes a leading minus for an option.

    >>> joined_negatives(["fit", "--tolerance", "-5nm", "-o", "a"])
    ['fit', '--tolerance=-5nm', '-o', 'a']
    """
    joined: list[str] = []
    for word in words:
        if joined and _NEGATIVE.match(word) and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] = f"{joined[-1]}={word}"
        else:
            joined.append(word)
    return joined


def counts(text: str) -> tuple[int, int]:
    """Two counts written `12x8`.

    >>> counts("12x8")
    (12, 8)
    """
    match = _COUNTS.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"two counts such as 12x8 are needed, but got {text!r}")
    return int(match[1]), int(match[2])


def lattice(text: str) -> tuple[int, int] | str:
    """`auto`, or M and N."""
    return text if text == "auto" else counts(text)


def share(text: str) -> float:
    """A share of the range: `0.01` or `1%`.

    >>> share("0.5%")
    0.005
    """
    number = text.strip()
    try:
        value = float(number[:-1]) / 100 if number.endswith("%") else float(number)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"a share such as 0.01 or 1% is needed, but got {text!r}") from error
    if value >= 1:
        raise argparse.ArgumentTypeError(f"a share of the range lies below 1, but got {text!r}; write 1% or 0.01")
    return value


def weight(text: str) -> float | str:
    """`auto`, or a number."""
    if text == "auto":
        return text
    try:
        return float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'auto' or a number is needed, but got {text!r}") from error
