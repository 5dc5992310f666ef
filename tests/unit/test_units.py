"""Units: every string of a log leads to SI by the right factor, or to an error."""

from __future__ import annotations

import math

import pytest

from rotorid.errors import UsageError
from rotorid.units import STANDARD_GRAVITY_M_S2, UNITS, parse_unit


@pytest.mark.parametrize(
    ("text", "value", "si", "value_si"),
    [
        ("deg", 180.0, "rad", math.pi),
        ("cdeg", 18000.0, "rad", math.pi),
        ("deg/s", 180.0, "rad/s", math.pi),
        ("deg/s^2", 180.0, "rad/s^2", math.pi),
        ("mrad/s", 1000.0, "rad/s", 1.0),
        ("rpm", 60.0, "rad/s", 2.0 * math.pi),
        ("Hz", 1.0, "rad/s", 2.0 * math.pi),
        ("g", 1.0, "m/s^2", STANDARD_GRAVITY_M_S2),
        ("km/h", 3.6, "m/s", 1.0),
        ("cm", 100.0, "m", 1.0),
        ("us", 1e6, "s", 1.0),
        ("ns", 1e9, "s", 1.0),
        ("%", 100.0, "1", 1.0),
        ("mV", 1000.0, "V", 1.0),
    ],
)
def test_known_quantities_come_out_in_si(text: str, value: float, si: str, value_si: float) -> None:
    unit = parse_unit(text)
    assert unit.si == si
    assert unit.factor * value == pytest.approx(value_si, rel=1e-15)


@pytest.mark.parametrize("text", ["m/s/s", "m/s2", "m/s²", " m/s^2 "])
def test_other_spellings_mean_the_same(text: str) -> None:
    assert parse_unit(text) == parse_unit("m/s^2")


@pytest.mark.parametrize("text", ["", "-", "1"])
def test_no_unit_is_the_number_one(text: str) -> None:
    assert parse_unit(text) == UNITS["1"]


@pytest.mark.parametrize("name", sorted(UNITS))
def test_si_units_are_their_own(name: str) -> None:
    assert UNITS[UNITS[name].si].factor == 1.0


@pytest.mark.parametrize("text", ["furlong", "DEG", "rad s", "deg/S", "m/s^3"])
def test_an_unknown_unit_is_an_error_that_names_it(text: str) -> None:
    with pytest.raises(UsageError, match="unknown unit") as caught:
        parse_unit(text)
    assert text in caught.value.came
    assert "deg/s" in caught.value.needed or "did you mean" in caught.value.remedy
