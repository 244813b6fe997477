"""What tests and docstrings' examples need before anything else: double precision, and pictures drawn off screen."""

import os

import jax

os.environ.setdefault("MPLBACKEND", "Agg")
jax.config.update("jax_enable_x64", True)
