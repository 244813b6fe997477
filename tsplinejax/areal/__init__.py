"""Areal surface texture parameters of ISO 25178-2, of maps with missing pixels and of scattered samples.

[`areal_parameters`][tsplinejax.areal.areal_parameters] gives all of them as plain numbers with units. The function of
each group works on JAX arrays, under `jit` and `vmap`, and is differentiable where the definition is.
"""

from ._functional import FunctionalParameters as FunctionalParameters, functional_parameters as functional_parameters
from ._height import HeightParameters as HeightParameters, height_parameters as height_parameters
from ._hybrid import HybridParameters as HybridParameters, hybrid_parameters as hybrid_parameters
from ._parameters import ArealParameters as ArealParameters, areal_parameters as areal_parameters
from ._spatial import SpatialParameters as SpatialParameters, spatial_parameters as spatial_parameters
