"""The rules of the house that a machine can check: one-way imports, lazy heavy packages, short and plain files."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

import tsplinejax

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT / "tsplinejax"
MODULES = sorted(PACKAGE.rglob("*.py"))

# From the top of the house down: a package imports only from those before it.
LAYERS = [
    "_version",
    "_errors",
    "data",
    "mesh",
    "areal",
    "io",
    "parameterisation",
    "space",
    "surface",
    "fitting",
    "orthogonal",
    "codec",
    "plot",
    "characterise",
    "sampling",
    "filling",
    "filtration",
    "multiresolution",
    "cli",
]
PRIVATE = {"_version", "_errors"}
NEEDS_ONLY_DATA = {"areal", "io"}
HOST_ONLY = {"data", "mesh"}
ON_JAX = {"jax", "jaxlib", "equinox", "lineax", "optimistix", "jaxopt"}
HEAVY = {
    "SurfaceTopography",
    "constriction",
    "dask",
    "jaxopt",
    "matplotlib",
    "optimistix",
    "scipy",
    "skimage",
    "tqdm",
    "trimesh",
}
VAGUE = {"utils", "util", "misc", "helpers", "helper", "common"}
MAX_LINES = 400


def _names(paths: list[Path]) -> list[str]:
    return [path.relative_to(PACKAGE).as_posix() for path in paths]


def _layer(path: Path) -> str:
    """The layer a module belongs to; the package's own `__init__` and `__main__` stand below all layers."""
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def _imported(path: Path, nodes: Iterable[ast.AST] | None = None) -> Iterator[str]:
    """The absolute dotted name of everything that a module's import statements bring (or those among `nodes`)."""
    package = ("tsplinejax", *path.relative_to(PACKAGE).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if nodes is None else nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*base, *((node.module,) if node.module else ())))
            # `from .. import data` imports a module, `from ..data import HeightMap` a name: the longer one covers both.
            yield from (f"{module}.{alias.name}" for alias in node.names)


def _imported_layers(path: Path) -> set[str]:
    names = (name.split(".") for name in _imported(path))
    return {parts[1] for parts in names if parts[0] == "tsplinejax" and len(parts) > 1}


def _run_at_import(node: ast.AST) -> Iterator[ast.AST]:
    """Every node that runs when its module is imported: not the bodies of functions, nor what is for type checkers."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            continue
        if isinstance(child, ast.If) and ast.unparse(child.test).endswith("TYPE_CHECKING"):
            continue
        yield child
        yield from _run_at_import(child)


@pytest.mark.parametrize("path", MODULES, ids=_names(MODULES))
def test_imports_go_one_way(path):
    """A module imports its own package and those above it, never one below."""
    layer = _layer(path)
    if layer in {"__init__", "__main__"}:
        return
    assert layer in LAYERS, f"{layer} has no place in the list of layers"
    allowed = set(LAYERS[: LAYERS.index(layer) + 1])
    if layer in NEEDS_ONLY_DATA:
        allowed = PRIVATE | {"data", layer}
    assert _imported_layers(path) <= allowed


@pytest.mark.parametrize("path", MODULES, ids=_names(MODULES))
def test_files_are_short_and_import_by_name(path):
    """No module is longer than a few screens, and no import hides what it brings."""
    assert len(path.read_text(encoding="utf-8").splitlines()) < MAX_LINES
    assert not [name for name in _imported(path) if name.endswith(".*")]


def test_no_vague_module_names():
    """A module is called after what it does."""
    parts = {part.removesuffix(".py").strip("_") for name in _names(MODULES) for part in name.split("/")}
    assert not parts & VAGUE


@pytest.mark.parametrize("layer", sorted(HOST_ONLY))
def test_host_packages_are_free_of_jax(layer):
    """Data and topology are plain numpy: they neither import JAX nor anything that stands on it."""
    for path in (PACKAGE / layer).rglob("*.py"):
        assert not {name.split(".")[0] for name in _imported(path)} & ON_JAX, path.name


@pytest.mark.parametrize("path", MODULES, ids=_names(MODULES))
def test_heavy_packages_are_imported_in_functions(path):
    """No module imports a heavy package when it is imported itself, except for the type checker; scipy is the ground
    on which packages stand that load on demand.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    at_import = {name.split(".")[0] for name in _imported(path, _run_at_import(tree))}
    assert not at_import & (HEAVY - {"scipy"} if _layer(path) in tsplinejax._ON_DEMAND else HEAVY)


def _loaded_by(statement: str) -> set[str]:
    """The top-level modules that a fresh interpreter holds after one statement."""
    code = f"import sys; {statement}; print(*{{name.split('.')[0] for name in sys.modules}})"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return set(run.stdout.split())


def test_import_loads_nothing_heavy():
    """Library and command line start quickly: scipy, pictures, formats and nonlinear solvers load when first used."""
    assert not _loaded_by("import tsplinejax.cli") & HEAVY


def test_names_on_demand():
    """What a type checker sees of the packages that load on demand is what they give, and each of it is there."""
    tree = ast.parse((PACKAGE / "__init__.py").read_text(encoding="utf-8"))
    (guarded,) = (node for node in tree.body if isinstance(node, ast.If))
    shown = {node.module: {alias.asname for alias in node.names} for node in guarded.body}
    assert shown == {package: set(names) for package, names in tsplinejax._ON_DEMAND.items()}
    for package, names in tsplinejax._ON_DEMAND.items():
        assert getattr(tsplinejax, package).__name__ == f"tsplinejax.{package}"
        assert all(getattr(tsplinejax, name) is not None and name in dir(tsplinejax) for name in names)
    with pytest.raises(AttributeError, match="no attribute 'remove_from'"):
        tsplinejax.remove_from  # noqa: B018 -- a misspelt name


def test_import_leaves_precision_alone():
    """Importing the library changes no global switch of JAX."""
    code = "import tsplinejax, jax; raise SystemExit(jax.config.jax_enable_x64)"
    assert subprocess.run([sys.executable, "-c", code], check=False, cwd=ROOT).returncode == 0


def test_no_machine_paths():
    """No tracked text names a folder of the machine it was written on."""
    home = re.compile(r"(?<![\w.])/(?:work|home|root|Users)/\w")
    listed = subprocess.run(["git", "ls-files", "-z"], capture_output=True, text=True, check=False, cwd=ROOT)
    if listed.returncode != 0 or not listed.stdout:
        pytest.skip("not a git checkout")
    paths = (ROOT / name for name in listed.stdout.split("\0") if name)
    texts = (path for path in paths if path.is_file() and path.suffix in {"", ".py", ".md", ".toml", ".ipynb", ".yml"})
    assert not [path.name for path in texts if home.search(path.read_text(encoding="utf-8"))]
