"""Orthogonal distance fits: exact where they can be, units and places, robust, refined, and misuse."""

import numpy as np
import pytest
from problems import known_surface, saddle

import tsplinejax as tsj
from tsplinejax.mesh import b_lattice
from tsplinejax.orthogonal import OrthogonalStop
from tsplinejax.space import spline_space
