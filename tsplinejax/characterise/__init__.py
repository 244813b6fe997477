"""What a measured surface is made of: its form, its texture, and what filters leave of both."""

from ._filters import l_filter as l_filter, level as level, s_filter as s_filter
from ._fit_form import FittedForm as FittedForm, fit_form as fit_form
from ._removal import Distortion as Distortion, FormRemoval as FormRemoval
from ._remove_form import remove_form as remove_form
from ._simple_forms import (
    Cylinder as Cylinder,
    Plane as Plane,
    Polynomial as Polynomial,
    Sphere as Sphere,
    simple_form as simple_form,
)
