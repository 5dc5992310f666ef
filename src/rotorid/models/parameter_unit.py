"""Units of parameters: products, quotients and powers of SI symbols."""

from __future__ import annotations

import re
from functools import lru_cache

from rotorid.errors import ModelError, UsageError
from rotorid.units import parse_unit

UNIT_SYMBOLS = ("rad", "m", "s", "kg", "N", "V", "A")
_FACTOR = re.compile(r"([A-Za-z]+)(?:\^(-?[1-9]))?")


@lru_cache(maxsize=1024)
def is_parameter_unit(text: str) -> bool:
    """Whether a text is a product, a quotient or a power of SI symbols, as parameters have them.

    Parameters
    ----------
    text
        Such as ``1/s``, ``rad/s^2``, ``kg m^2`` or ``rad/(m s)``.

    Examples
    --------
    >>> is_parameter_unit("rad/(m s)"), is_parameter_unit("deg/s")
    (True, False)
    """
    above, *below = text.split("/")
    if len(below) > 1:
        return False
    bracketed = below[0].startswith("(") and below[0].endswith(")") if below else False
    under = below[0][1:-1] if bracketed else below[0] if below else ""
    if below and not bracketed and len(under.split(" ")) > 1:
        return False
    return (above == "1" or _is_product(above)) and (not below or _is_product(under))


def _is_product(text: str) -> bool:
    factors = [_FACTOR.fullmatch(factor) for factor in re.split(r"[ *]", text)]
    return all(factor is not None and factor[1] in UNIT_SYMBOLS for factor in factors)


def check_unit(name: str, unit: str) -> None:
    """Refuse a unit that is not SI.

    Parameters
    ----------
    name
        The parameter, for the message.
    unit
        What its unit is said to be.

    Raises
    ------
    ModelError
        The unit is not known, or is not SI.
    """
    if is_parameter_unit(unit):
        return
    try:
        remedy = f"give its numbers in {parse_unit(unit).si}"
    except UsageError:
        remedy = "write powers as s^2, and several factors below in brackets"
    raise ModelError(
        f"the unit of {name} is {unit!r}",
        needed=f"an SI unit made of {', '.join(UNIT_SYMBOLS)} or 1, such as rad/s^2, kg m^2 or rad/(m s)",
        remedy=remedy,
    )
