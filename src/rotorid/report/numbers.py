"""Numbers as a reader wants them: no more digits than their standard deviation supports."""

from __future__ import annotations

import math

MISSING = "–"

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MOST_PERCENT = 1000.0
_PLAIN_FROM, _PLAIN_TO = 1e-3, 1e6
_POWERS = {"^2": "²", "^3": "³", "^-1": "⁻¹", "^-2": "⁻²"}


def with_error(value: float | None, std: float | None) -> str:
    """A value with its standard deviation, both rounded at the digit that the deviation supports.

    The deviation keeps one digit, or two when it begins with 1 or 2. Without a deviation four digits are shown.

    Examples
    --------
    >>> with_error(436.83, 3.14), with_error(-4.312, 0.187), with_error(2.5e-5, 1.2e-6), with_error(9.80665, None)
    ('437 ± 3', '−4.31 ± 0.19', '(2.50 ± 0.12)·10⁻⁵', '9.807')
    """
    if std is None or value is None or not math.isfinite(std) or not math.isfinite(value) or std <= 0.0:
        return significant(value, digits=4)
    largest = max(abs(value), std)
    power = 0 if _PLAIN_FROM <= largest < _PLAIN_TO else math.floor(math.log10(largest))
    mantissa, deviation = value / 10.0**power, std / 10.0**power
    decimals = _decimals(deviation)
    both = f"{_fixed(mantissa, decimals)} ± {_fixed(deviation, decimals)}"
    return f"({both})·10{str(power).translate(_SUPERSCRIPTS)}" if power else both


def significant(value: float | None, *, digits: int = 3) -> str:
    """A number with so many significant digits, a dash where there is none.

    Examples
    --------
    >>> significant(0.012345), significant(-2.0), significant(None), significant(1.5e-7)
    ('0.0123', '−2', '–', '1.5·10⁻⁷')
    """
    if value is None or not math.isfinite(value):
        return MISSING
    text = f"{value:.{digits}g}"
    if "e" not in text:
        return _minus(text)
    mantissa, power = text.split("e")
    return f"{_minus(mantissa)}·10{str(int(power)).translate(_SUPERSCRIPTS)}"


def milliseconds(seconds: float | None, std_s: float | None = None) -> str:
    """A time in milliseconds, without the unit.

    Examples
    --------
    >>> milliseconds(0.02791, 0.0006), milliseconds(0.0024)
    ('27.9 ± 0.6', '2.4')
    """
    if seconds is None:
        return MISSING
    return with_error(1e3 * seconds, None if std_s is None else 1e3 * std_s)


def percent(value: float | None) -> str:
    """A percentage without its sign, two digits; beyond a thousand the number says nothing more.

    Examples
    --------
    >>> percent(0.534), percent(158.6), percent(5858.3), percent(None)
    ('0.53', '159', '> 1000', '–')
    """
    if value is None or not math.isfinite(value):
        return MISSING
    if value > _MOST_PERCENT:
        return f"> {_MOST_PERCENT:.0f}"
    return f"{value:.0f}" if value >= 10.0 else significant(value, digits=2)


def unit(text: str) -> str:
    """A unit on paper.

    Examples
    --------
    >>> unit("rad/s^2"), unit("1")
    ('rad/s²', '')
    """
    for written, shown in _POWERS.items():
        text = text.replace(written, shown)
    return "" if text == "1" else text


def _decimals(deviation: float) -> int:
    power = math.floor(math.log10(deviation))
    digits = 2 if deviation / 10.0**power < 3.0 else 1
    return digits - 1 - power


def _fixed(value: float, decimals: int) -> str:
    return _minus(f"{round(value, decimals):.{max(decimals, 0)}f}")


def _minus(text: str) -> str:
    return text.replace("-", "−")
