"""A number with its error and its unit, and how it is written on every page, in every file and sentence.

One rule for all: an uncertainty keeps one significant digit, or two where it begins with 1 or 2, and the number ends at
the same digit. Both ends of an interval end there too, by the larger of its halves. ``a ± b`` is a number with one
standard deviation (:func:`with_error`), ``a (b to c)`` a number with its 95 % interval (:func:`with_interval`); the
cards of a review write an interval with equal halves as ``a ± half`` (:func:`with_half`). A number without an
uncertainty has the digits that are stated where it is written (:func:`significant`), and one that is not known is
:data:`MISSING`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from rotorid.data.base import Immutable
from rotorid.errors import UsageError

TWO_SIDED_95 = 1.959963984540054
"""Half width of a 95 % interval of a normal error, in standard deviations."""


@dataclass(frozen=True, kw_only=True)
class Quantity(Immutable):
    """An estimate with a 95 % interval, random and model error together.

    Parameters
    ----------
    value
        Best single number.
    std
        One standard deviation; of a skewed error, half of what holds 68 %.
    lower, upper
        Ends of the 95 % interval; infinite where a side has no bound.
    unit
        SI, ``1`` for shares; ``dB``, ``deg``, ``%`` where the field speaks so.

    Raises
    ------
    UsageError
        The value is not a finite number, or lies outside of its interval.

    Examples
    --------
    >>> Quantity.normal(39.7, 1.0, "deg").lower
    37.74003601545995
    """

    value: float
    std: float
    lower: float
    upper: float
    unit: str

    def __post_init__(self) -> None:
        if not math.isfinite(self.value) or not self.lower <= self.value <= self.upper:
            raise UsageError(f"the value {self.value} lies outside its interval of {self.lower} to {self.upper}")

    @classmethod
    def normal(cls, value: float, std: float, unit: str) -> Quantity:
        """A number with a normal error."""
        half = TWO_SIDED_95 * std
        return cls(value=value, std=std, lower=value - half, upper=value + half, unit=unit)


MISSING = "–"
"""Text for an unknown number."""

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_MOST_PERCENT = 1000.0
_ROUNDING = 1e-12
"""A smaller share of a number is the rounding of a computer, and no uncertainty."""

_MOST_DECIMALS = 4
_PLAIN_FROM, _PLAIN_TO = 1e-3, 1e6
_POWERS = {"^2": "²", "^3": "³", "^-1": "⁻¹", "^-2": "⁻²"}
_EVEN = 0.25
"""An interval whose halves differ by less, over their mean, is written by its half."""


def with_error(value: float | None, std: float | None, *, digits: int = 4) -> str:
    """A value with its standard deviation, both rounded at the digit that the deviation supports.

    Without a deviation, or with one that is the rounding of a computer alone, so many ``digits`` are shown.

    Examples
    --------
    >>> with_error(1.0, 1e-16)
    '1'
    >>> with_error(436.83, 3.14), with_error(-4.312, 0.187), with_error(2.5e-5, 1.2e-6), with_error(9.80665, None)
    ('437 ± 3', '−4.31 ± 0.19', '(2.50 ± 0.12)·10⁻⁵', '9.807')
    """
    mantissa, deviation, times = _rounded(value, std, digits)
    if not deviation:
        return f"{mantissa}{times}"
    return f"({mantissa} ± {deviation}){times}" if times else f"{mantissa} ± {deviation}"


def error_columns(value: float | None, std: float | None, *, digits: int = 4) -> tuple[str, str]:
    """The same in two cells of a table; the second is empty without a deviation.

    Examples
    --------
    >>> error_columns(436.83, 3.14), error_columns(2.5e-5, 1.2e-6), error_columns(9.80665, None)
    (('437', '3'), ('2.50·10⁻⁵', '0.12·10⁻⁵'), ('9.807', ''))
    """
    mantissa, deviation, times = _rounded(value, std, digits)
    return f"{mantissa}{times}", f"{deviation}{times}" if deviation else ""


def _rounded(value: float | None, std: float | None, digits: int) -> tuple[str, str, str]:
    """Number, its deviation, empty without one, and the power of ten that both are times of."""
    if value is None or not math.isfinite(value) or std is None or not _ROUNDING * abs(value) < std < math.inf:
        return significant(value, digits=digits), "", ""
    largest = max(abs(value), std)
    power = 0 if _PLAIN_FROM <= largest < _PLAIN_TO else math.floor(math.log10(largest))
    mantissa, deviation = value / 10.0**power, std / 10.0**power
    decimals = _decimals(deviation)
    times = f"·10{superscript(str(power))}" if power else ""
    return _fixed(mantissa, decimals), _fixed(deviation, decimals), times


def with_interval(value: float | None, lower: float | None, upper: float | None) -> tuple[str, str]:
    """A number and its interval in two cells; of a number without one, three digits and an empty cell.

    Examples
    --------
    >>> with_interval(27.04, 26.7, 27.4), with_interval(2.0, 2.0, 2.0), with_interval(None, None, None)
    (('27.0', '26.7 to 27.4'), ('2', ''), ('–', ''))
    >>> with_interval(1.008e-6, 0.976e-6, 1.04e-6)
    ('1.01·10⁻⁶', '0.98·10⁻⁶ to 1.04·10⁻⁶')
    >>> with_interval(0.318, 0.318, math.inf)
    ('0.318', '0.318 to ∞')
    """
    if value is None or lower is None or upper is None:
        return significant(value), ""
    half = _larger_half(value, lower, upper)
    if not half > _ROUNDING * abs(value):
        number = significant(value)
        if math.isfinite(lower) and math.isfinite(upper):
            return number, ""
        # A bound is no exact number.
        return number, " to ".join(number if math.isfinite(end) else _end(end, 0) for end in (lower, upper))
    # A number that is known to be small, and not just nearly zero, keeps its digits.
    power = math.floor(math.log10(abs(value))) if half < abs(value) < _PLAIN_FROM else 0
    scale, times = 10.0**power, f"·10{superscript(str(power))}" if power else ""
    decimals = min(_decimals(half / scale), _MOST_DECIMALS)
    ends = " to ".join(f"{_end(end / scale, decimals)}{times}" for end in (lower, upper))
    return f"{_fixed(value / scale, decimals)}{times}", ends


def with_ends(value: float | None, lower: float | None, upper: float | None, unit: str = "") -> str:
    """The same in a sentence.

    Examples
    --------
    >>> with_ends(27.04, 26.7, 27.4, "ms"), with_ends(40.0, 32.0, math.inf, "°"), with_ends(None, None, None)
    ('27.0 ms (26.7 to 27.4 ms)', '40° (32 to ∞°)', '–')
    """
    number, interval = with_interval(value, lower, upper)
    shown = with_unit(number, unit)
    return f"{shown} ({with_unit(interval, unit)})" if interval else shown


def with_half(value: float, lower: float, upper: float, unit: str = "") -> str:
    """A number with the half of its interval, or with both ends where the halves differ.

    Examples
    --------
    >>> with_half(27.04, 26.7, 27.4, "ms"), with_half(1.54, 1.36, 1.86), with_half(-1.0, -1.5, -0.5, "°")
    ('27.0 ± 0.3 ms', '1.5 (1.4 to 1.9)', '−1.0 ± 0.5°')
    """
    half = 0.5 * (upper - lower)
    if not 0.0 < half < math.inf or abs(upper + lower - 2.0 * value) > _EVEN * half:
        return with_ends(value, lower, upper, unit)
    return with_unit(with_error(value, half), unit)


def rounded_ends(value: float, lower: float, upper: float) -> tuple[float, float]:
    """The ends of an interval as they are printed, so that a limit and the page never contradict each other.

    Examples
    --------
    >>> rounded_ends(31.0, 24.8, 37.2), rounded_ends(2.0, 2.0, 2.0)
    ((25.0, 37.0), (2.0, 2.0))
    """
    half = _larger_half(value, lower, upper)
    if not half > _ROUNDING * abs(value):
        return lower, upper
    decimals = min(_decimals(half), _MOST_DECIMALS)
    ends = (round(end, decimals) if math.isfinite(end) else end for end in (lower, upper))
    return next(ends), next(ends)


def with_unit(number: str, unit: str) -> str:
    """A number with its unit on paper: a degree follows at once, everything else behind a gap.

    Examples
    --------
    >>> with_unit("40", "°"), with_unit("27.0", "ms"), with_unit("1.7", "")
    ('40°', '27.0 ms', '1.7')
    """
    return f"{number}{unit}" if unit in ("", "°") else f"{number} {unit}"


def in_decibels(factor: float, std: float, *, digits: int = 4) -> str:
    """A factor and its standard deviation in decibels.

    Examples
    --------
    >>> in_decibels(2.0, 0.05)
    '6.02 ± 0.22'
    """
    return with_error(20.0 * math.log10(factor), 20.0 / math.log(10.0) * std / factor, digits=digits)


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
    """A percentage without its sign, with two digits; values beyond a thousand are cut.

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


def significant(value: float | None, *, digits: int = 3) -> str:
    """A number with so many significant digits, a dash where there is none.

    Examples
    --------
    >>> significant(0.012345), significant(-2.0), significant(None), significant(1.5e-7)
    ('0.0123', '−2', '–', '1.5·10⁻⁷')
    >>> significant(-138.4, digits=2), significant(99960.0), significant(2.5e6)
    ('−140', '100000', '2.5·10⁶')
    """
    if value is None or not math.isfinite(value):
        return MISSING
    text = f"{value:.{digits}g}"
    if "e" in text and 1.0 <= abs(float(text)) < _PLAIN_TO:
        text = f"{float(text):.0f}"
    mantissa, _, power = minus(text).partition("e")
    return f"{mantissa}·10{superscript(str(int(power.replace('−', '-'))))}" if power else mantissa


def superscript(power: str) -> str:
    """An exponent.

    Examples
    --------
    >>> superscript("-12")
    '⁻¹²'
    """
    return power.translate(_SUPERSCRIPTS)


def beyond(value: float, limit: float) -> str:
    """A number above a limit printed next to it, with enough digits to show that it is.

    Examples
    --------
    >>> beyond(20.3, 20.0), beyond(33.3, 20.0), beyond(10.04, 10.0)
    ('20.3', '33', '10.04')
    """
    digits = next((digits for digits in range(3) if round(value, digits) > limit), 0)
    return f"{value:.{digits}f}"


def minus(number: str) -> str:
    """A number with the minus sign of paper.

    Examples
    --------
    >>> minus("-0.5")
    '−0.5'
    """
    return number.replace("-", "−")


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


def _larger_half(value: float, lower: float, upper: float) -> float:
    return max((abs(end - value) for end in (lower, upper) if math.isfinite(end)), default=0.0)


def _end(end: float, decimals: int) -> str:
    return _fixed(end, decimals) if math.isfinite(end) else "∞" if end > 0.0 else "−∞"


def _decimals(deviation: float) -> int:
    """Places behind the point at which a number of this uncertainty ends."""
    power = math.floor(math.log10(deviation))
    digits = 2 if deviation / 10.0**power < 3.0 else 1
    return digits - 1 - power


def _fixed(value: float, decimals: int) -> str:
    return minus(f"{round(value, decimals) + 0.0:.{max(decimals, 0)}f}")
