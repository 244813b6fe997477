"""What a command sets before it computes: double precision, and a cache of compiled kernels between runs."""

import os
import sys
from pathlib import Path

import jax

#: Names a folder for compiled kernels, or is `off`.
CACHE_VARIABLE = "TSPLINEJAX_CACHE"
_OFF = {"off", "no", "0", "false", ""}


def prepare_jax() -> None:
    """Switch x64 mode on, and keep compiled kernels in the user's cache folder unless told otherwise."""
    jax.config.update("jax_enable_x64", True)
    if getattr(jax.config, "jax_compilation_cache_dir", None):
        return
    folder = cache_folder()
    if folder is not None and _usable(folder):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def cache_folder() -> Path | None:
    """The folder for compiled kernels, or `None` where they are not to be kept."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen is not None:
        return None if chosen.strip().lower() in _OFF else Path(chosen)
    try:
        return _user_cache() / "tsplinejax" / "jax"
    except RuntimeError:  # no home folder
        return None


def _user_cache() -> Path:
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    given = os.environ.get("XDG_CACHE_HOME")
    return Path(given) if given and os.path.isabs(given) else Path.home() / ".cache"


def _usable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)
