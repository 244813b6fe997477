"""The help of every command on a page: `python docs/make_command_line.py` rewrites that part of command-line.md."""

import io
import os
from contextlib import redirect_stdout
from pathlib import Path

os.environ["COLUMNS"] = "100"

from tsplinejax.cli import main as tsplinejax

PAGE = Path(__file__).parent / "command-line.md"
OPENING = "<!-- help: written by docs/make_command_line.py -->"
COMMANDS = (
    "fit",
    "batch fit",
    "form",
    "areal",
    "filter",
    "mra",
    "fill",
    "sample",
    "reconstruct",
    "compress",
    "decompress",
    "evaluate",
    "info",
    "convert",
    "plot",
    "demo",
)


def main() -> None:
    """Write the page anew from the marker on."""
    before = PAGE.read_text(encoding="utf-8").partition(OPENING)[0]
    sections = [f"### tsplinejax {command}\n\n```text\n{_help(command)}```\n" for command in COMMANDS]
    PAGE.write_text("\n".join([before + OPENING + "\n", *sections]), encoding="utf-8")


def _help(command: str) -> str:
    with redirect_stdout(io.StringIO()) as text:
        tsplinejax([*command.split(), "--help"])
    return text.getvalue()


if __name__ == "__main__":
    main()
