"""The programs in the README and in the documentation run as they stand."""

import re
from pathlib import Path

import matplotlib.pyplot as plt
import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = sorted(path for path in [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")] if path.is_file())


def _program(path: Path) -> str:
    """All Python blocks of a document, one after the other: later ones use what earlier ones made."""
    return "\n".join(re.findall(r"^```python\n(.*?)^```", path.read_text(encoding="utf-8"), flags=re.DOTALL | re.M))


@pytest.mark.parametrize("path", [path for path in DOCUMENTS if _program(path)], ids=lambda path: path.name)
def test_programs_run(path, tmp_path, monkeypatch):
    """A reader who types in a page's blocks from top to bottom meets no error."""
    monkeypatch.chdir(tmp_path)
    exec(compile(_program(path), path.name, "exec"), {"__name__": "__main__"})
    plt.close("all")


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    """Every relative link and picture of a document exists."""
    links = re.findall(r"\]\((?!https?:|#)([^)#\s]+)", path.read_text(encoding="utf-8"))
    assert not [link for link in links if not (path.parent / link).exists()]
