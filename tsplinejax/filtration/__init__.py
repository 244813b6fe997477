"""Filtration: smooth versions of a height map, by tolerance with edges kept or by a cut-off; and peers' filters."""

from ._filter import filter as filter
from ._filtered import Filtered as Filtered
from ._peers import (
    bilateral_filter as bilateral_filter,
    non_local_means_filter as non_local_means_filter,
    spline_filter as spline_filter,
    total_variation_filter as total_variation_filter,
)
from ._transmission import Transmission as Transmission, transmission as transmission
