"""Errors that tell the rule, what was received, and the remedy.

Misuse raises [`InputError`][tsplinejax.InputError]; what an algorithm could not achieve is a named outcome in its
result, never an exception.
"""

from importlib import import_module
from types import ModuleType


class InputError(ValueError):
    """Bad input or bad use: the message gives the rule, what was received and the remedy."""


class MissingExtraError(InputError):
    """A feature needs an optional dependency that is not installed; the message names the command that installs it."""


def require(module: str, extra: str) -> ModuleType:
    """Import an optional dependency, or say how to install it.

    **Arguments:**

    - `module`: the module's dotted name.
    - `extra`: the extra of `tsplinejax` that brings it.

    **Raises:** `MissingExtraError`, with the command to run.

    >>> require("math", "plot").pi > 3
    True
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"this needs the optional package {module.split('.')[0]!r}, which cannot be imported ({error}); "
            f'install it with: pip install "tsplinejax[{extra}]"'
        ) from error
