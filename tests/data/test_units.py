"""Units of length: one canonical name each, exact factors, and lengths written as text."""

import numpy as np
import pytest

from tsplinejax._errors import InputError
from tsplinejax.data import LENGTH_UNITS, canonical_unit, parse_length, unit_factor


@pytest.mark.parametrize(
    ("alias", "symbol"),
    [
        ("um", "µm"),
        ("μm", "µm"),
        ("µm", "µm"),
        ("micron", "µm"),
        ("in", "inch"),
        ("Angstrom", "Å"),
        (" nm ", "nm"),
        (None, None),
    ],
)
def test_aliases_lead_to_one_symbol(alias, symbol):
    """Every spelling of a unit, both Unicode signs of micro included, is stored as one."""
    assert canonical_unit(alias) == symbol


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("mm", "µm", 1000.0),
        ("µm", "nm", 1000.0),
        ("nm", "m", 1e-9),
        ("inch", "mm", 25.4),
        ("Å", "pm", 100.0),
        ("km", "m", 1000.0),
    ],
)
def test_factors_are_exact(source, target, factor):
    """Factors are the nearest floats to the true ratios."""
    assert unit_factor(source, target) == factor


def test_every_pair_of_units_converts_back():
    """There and back is 1 to rounding for all pairs."""
    for source in LENGTH_UNITS:
        for target in LENGTH_UNITS:
            assert unit_factor(source, target) * unit_factor(target, source) == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5nm", "µm", 0.005),
        ("0.8um", "µm", 0.8),
        ("1e-3mm", "µm", 1.0),
        (" 2 µm ", "nm", 2000.0),
        ("0.25", None, 0.25),
        (0.25, None, 0.25),
        (np.float32(2), "mm", 2.0),
        ("-1e2", "mm", -100.0),
    ],
)
def test_lengths_come_in_the_unit_of_the_data(text, unit, value):
    """A suffix is converted, a bare number is taken as it is."""
    assert parse_length(text, unit) == value


@pytest.mark.parametrize(
    ("text", "unit", "message"),
    [
        ("5nm", None, "the data have none"),
        ("5 volts", "µm", "not a unit of length"),
        ("five", "µm", "a number with an optional unit"),
        ("", "µm", "a number with an optional unit"),
        ("1e999", "µm", "finite"),
        (float("nan"), "µm", "finite"),
        ([1], "µm", "a number or text"),
        ("5V", None, "not a unit of length"),
    ],
)
def test_bad_lengths_are_refused(text, unit, message):
    """Each message says what is wrong."""
    with pytest.raises(InputError, match=message):
        parse_length(text, unit)


def test_unknown_units_are_refused():
    """A unit must be a known length; converting needs both."""
    with pytest.raises(InputError, match="not a unit of length"):
        canonical_unit("volt")
    with pytest.raises(InputError, match="text such as"):
        canonical_unit(3)
    with pytest.raises(InputError, match="needs both units"):
        unit_factor(None, "mm")
