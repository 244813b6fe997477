"""The operations that come before and after the form, in the order of ISO 25178."""

import argparse

from .._errors import InputError


def add_operations(parser: argparse.ArgumentParser) -> None:
    """Add `--s-filter`, `--level` and `--l-filter`."""
    group = parser.add_argument_group("operations, in this order (ISO 25178); lengths as 0.8um, or in the data's unit")
    group.add_argument("--s-filter", metavar="L", help="take waves shorter than this off first (height maps)")
    group.add_argument(
        "--level",
        metavar="none|plane|polyN|sphere|cylinder",
        type=_level,
        help="take this off along z next; poly2 is of order 2 (default none)",
    )
    group.add_argument("--l-filter", metavar="L", help="take waves longer than this off last")


def simple_form_name(text: str) -> str:
    """The name of a simple form.

    >>> simple_form_name("poly4")
    'poly4'
    """
    from ..characterise import simple_form

    try:
        return simple_form(text).name
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _level(text: str) -> str | None:
    return None if text == "none" else simple_form_name(text)
