"""The command line `tsplinejax`: fit, evaluate, info, convert, plot, demo."""

from ._main import main as main
