"""Programs and commands in the README and the documentation run as they stand; pages written by scripts are current."""

import importlib.util
import re
import shlex
from contextlib import redirect_stdout
from pathlib import Path
from types import ModuleType

import matplotlib.pyplot as plt
import pytest

from tsplinejax.cli import main
from tsplinejax.cli._main import make_parser

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted(path for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")] if path.is_file())
COMMAND_LINE = ROOT / "docs" / "command-line.md"
LARGEST_PICTURE = 300_000
(_COMMANDS,) = make_parser()._subparsers._group_actions
COMMANDS = [*(name for name in _COMMANDS.choices if name != "batch"), "batch fit"]


def _blocks(path: Path) -> list[tuple[str, int, str]]:
    """The blocks of a document that run, in their order: language, line, text."""
    text = path.read_text(encoding="utf-8")
    found = re.finditer(r"^```(python|console)\n(.*?)^```", text, flags=re.DOTALL | re.M)
    return [(match[1], text.count("\n", 0, match.start(2)), match[2]) for match in found]


def _run_commands(text: str) -> None:
    """Run each line of a console block; `> FILE` at its end is understood."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        assert words[0] == "tsplinejax", f"only tsplinejax is run here, write other commands in a text block: {line}"
        output = Path(words.pop()) if words[-2:-1] == [">"] and words.pop(-2) else Path("standard-output.txt")
        with output.open("w", encoding="utf-8") as stream, redirect_stdout(stream):
            code = main(words[1:])
        assert code == 0, f"exit code {code}: {line}"


@pytest.mark.parametrize("path", [path for path in DOCUMENTS if _blocks(path)], ids=lambda path: path.name)
def test_blocks_run(path, tmp_path, monkeypatch):
    """A reader who types in a page's programs and commands from top to bottom meets no error."""
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}  # later programs use what earlier ones made
    for language, line, text in _blocks(path):
        if language == "console":
            _run_commands(text)
        else:  # blank lines before it make the line of an error the document's own
            exec(compile("\n" * line + text, str(path), "exec"), names)
        plt.close("all")


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    """Every relative link and picture of a document exists."""
    links = re.findall(r"\]\((?!https?:|#)([^)#\s]+)", path.read_text(encoding="utf-8"))
    assert not [link for link in links if not (path.parent / link).exists()]


def test_pages_are_in_the_navigation():
    """Every page can be reached from the site's menu."""
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert not [path.name for path in DOCUMENTS if path.parent.name == "docs" and f": {path.name}" not in menu]


def test_pictures_are_used_and_small():
    """A picture that no page shows, or that a reader waits for, is left out."""
    pages = "".join(path.read_text(encoding="utf-8") for path in DOCUMENTS)
    pictures = sorted((ROOT / "docs" / "images").glob("*"))
    assert not [path.name for path in pictures if path.stat().st_size > LARGEST_PICTURE or path.name not in pages]


def test_tables_are_current(monkeypatch):
    """The tables in the README and in the pages say what the last results say."""
    monkeypatch.syspath_prepend(ROOT / "docs")
    make_tables = _script("make_tables")
    for path, text in make_tables.documents().items():
        assert path.read_text(encoding="utf-8") == text, f"{path.name}: run python docs/make_tables.py"


@pytest.mark.parametrize("command", COMMANDS)
def test_command_line_page_is_complete(command, capsys):
    """The page of commands lists every option that a command's help lists, and no other."""
    assert main([*command.split(), "--help"]) == 0
    page = COMMAND_LINE.read_text(encoding="utf-8")
    written = page.partition(f"### tsplinejax {command}\n")[2].partition("\n### ")[0]
    assert _options(written) == _options(capsys.readouterr().out), "run python docs/make_command_line.py"


def _options(text: str) -> set[str]:
    """Every long option that a text names."""
    return set(re.findall(r"(?<![\w-])--[a-z][a-z-]*", text))


def _script(name: str) -> ModuleType:
    """A script of the documentation as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
