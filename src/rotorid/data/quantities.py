"""Every figure of merit: what it is called, how it is shown, and by which limit it is judged.

A review, its cards, pages and documents, the table of a fleet, ``response`` and ``tune`` read this table and have none
of their own. A new figure is the function that computes it and its row here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, Protocol, TypeAlias

from rotorid.data.base import Immutable
from rotorid.data.display import CHANNEL_WORDS, listed
from rotorid.data.quantity import (
    Quantity,
    in_decibels,
    rounded_ends,
    significant,
    with_error,
    with_half,
    with_interval,
    with_unit,
)
from rotorid.data.trust import SAFE_PEAK, SAFE_PHASE_MARGIN_DEG
from rotorid.errors import UsageError

Part: TypeAlias = Literal[
    "loops", "tracking", "margins", "noise", "motors", "battery", "wind", "drag", "yaw", "flight", "tuning", "response"
]
"""The part of a review that holds a figure, as its document and the table of a fleet name it, or another verb."""


class Interval(Protocol):
    """A number with the ends of its 95 % interval, as values and documents hold it."""

    @property
    def value(self) -> float: ...
    @property
    def lower(self) -> float | None: ...
    @property
    def upper(self) -> float | None: ...


Judgment: TypeAlias = Literal["good", "look", "cannot"]
"""Good; look here; not enough data, since the limit lies within the interval."""


@dataclass(frozen=True, kw_only=True)
class FigureOfMerit(Immutable):
    """A figure of merit.

    Parameters
    ----------
    words, detail
        What it is called everywhere, and what a table adds.
    unit, factor
        On paper, with the factor from the unit of the number; ``None`` for a factor that is shown in decibels.
    short
        What goes before the number in one line; the words by default.
    good_above, good_below
        Limit, in the unit of the number. It is a habit of the field and no law: trouble is where the whole 95 %
        interval lies beyond it, good where the whole interval keeps to it.
    per
        The number of the same part that the limit is a share of; none by default.
    card
        The card of a review that is judged by it too.
    trouble
        What the card says beyond the limit, with ``{axis}`` and ``{value}``.
    whether, surer
        What is open where the limit lies within the interval, and what would decide it.
    remedy
        What to do where a flight does not show it.
    keeps_sign
        Whether it cannot change its sign by what it is.
    ordinary
        Whether the limit is that of healthy vehicles, beyond which a number is unusual, but no trouble by itself.
    health
        Usual cause of a rise since earlier flights of the vehicle, empty where there is no usual one; ``None`` for what
        depends on the flight more than on the vehicle, and is not compared.
    """

    words: str
    detail: str = ""
    unit: str = ""
    factor: float | None = 1.0
    short: str = ""
    good_above: float = math.nan
    good_below: float = math.nan
    per: str = ""
    card: str = ""
    trouble: str = ""
    whether: str = ""
    surer: str = ""
    remedy: str = ""
    keeps_sign: bool = False
    ordinary: bool = False
    health: str | None = None

    @property
    def label(self) -> str:
        """Head of its row: ``rise time, 10 to 90 % [ms]``."""
        named = f"{self.words}, {self.detail}" if self.detail else self.words
        return f"{named} [{self.unit}]" if self.unit else named

    @property
    def before(self) -> str:
        """What goes before the number in one line."""
        return self.short or self.words

    @property
    def limit(self) -> float:
        """The limit, in the unit of the number; not a number where it has none."""
        return self.good_below if math.isnan(self.good_above) else self.good_above

    @property
    def good_side(self) -> Literal["above", "below"]:
        """Which side of the limit is good."""
        return "below" if math.isnan(self.good_above) else "above"

    def limit_text(self, per: float = 1.0) -> str:
        """The limit on paper, of a share times what it is a share of."""
        return with_unit(significant(self._paper(per * self.limit)), self.unit)

    def scale(self, judgment: Judgment, per: float = 1.0) -> str:
        """The limit in words, for those who do not know the number.

        Examples
        --------
        >>> QUANTITIES["sensitivity_peak"].scale("good"), QUANTITIES["phase_margin_deg"].scale("look")
        ('below 2 is fine', 'below 40° is trouble')
        """
        if judgment == "cannot":
            return f"the limit is {self.limit_text(per)}"
        side = self.good_side if judgment == "good" else "below" if self.good_side == "above" else "above"
        words = ("usual", "unusual") if self.ordinary else ("fine", "trouble")
        return f"{side} {self.limit_text(per)} is {words[judgment == 'look']}"

    def shown(self, quantity: Quantity) -> str:
        """A number with its interval and unit, in one line."""
        return with_half(*self._interval(quantity), unit=self.unit)

    def cells(self, quantity: Interval) -> tuple[str, str]:
        """A number and its interval, for a table whose head has the unit."""
        ends = (quantity.value, quantity.lower, quantity.upper)
        return with_interval(*(None if end is None else self._paper(end) for end in ends))

    def with_ends(self, quantity: Interval) -> str:
        """The same in one line, without the unit."""
        number, interval = self.cells(quantity)
        return f"{number} ({interval})" if interval else number

    def with_error(self, value: float, std: float) -> str:
        """A number with its standard deviation, without the unit."""
        return in_decibels(value, std) if self.factor is None else with_error(self.factor * value, self.factor * std)

    def judged(self, quantity: Quantity, per: float = 1.0) -> Judgment:
        """Whether a number keeps to the limit, by its interval as it is printed."""
        lower, upper = rounded_ends(*self._interval(quantity))
        limit = self._paper(per * self.limit)
        if math.isnan(self.good_above):
            keeps, may_keep = upper <= limit, lower <= limit
        else:
            keeps, may_keep = lower >= limit, upper >= limit
        return "good" if keeps else "cannot" if may_keep else "look"

    def _interval(self, quantity: Quantity) -> tuple[float, float, float]:
        return self._paper(quantity.value), self._paper(quantity.lower), self._paper(quantity.upper)

    def _paper(self, value: float) -> float:
        return value if self.factor is None else self.factor * value


COMPARE = "compare with an earlier flight: rotorid review LOG --baseline FOLDER"
"""What names a cause that one flight cannot."""

UNBALANCED = "a damaged or unbalanced propeller, a bearing or a loose part"
"""Usual cause of more vibration than in earlier flights."""

VIBRATION_BANDS_HZ = ((10, 30), (30, 100), (100, 300))
"""Bands in which vibration is compared between flights."""

_DEGREES = 180.0 / math.pi
_MOVE = "fly longer with the sticks moving"
_FASTER = "move the sticks faster, or log faster"
_HOVER = "hover for 20 s without touching the sticks"
_FAR_FROM_OSCILLATION = "the {axis} loop is far from oscillation"
_AXES = ("roll", "pitch", "yaw")

_LOOPS = {
    "rise_time_s": FigureOfMerit(
        health="",
        words="rise time",
        detail="10 to 90 %",
        unit="ms",
        factor=1e3,
        good_below=0.25,
        card="tracking",
        trouble="{Axis} responds slowly. Raise P to make it quicker.",
        whether="{axis} follows well",
        surer=_MOVE,
        remedy="raise the integral gain, if the droop is not wanted",
        keeps_sign=True,
    ),
    "delay_s": FigureOfMerit(
        health="motors, ESCs or filters",
        words="delay",
        detail="until half of the step",
        unit="ms",
        factor=1e3,
        remedy=_MOVE,
        keeps_sign=True,
    ),
    "overshoot_percent": FigureOfMerit(
        health="",
        words="overshoot",
        unit="%",
        good_below=25.0,
        card="tracking",
        trouble="{Axis} bounces after quick moves. Usual causes: too much P or I, too little D, or a slow filter.",
        whether="{axis} follows well",
        surer=_MOVE,
        remedy=_MOVE,
    ),
    "settling_time_s": FigureOfMerit(
        words="settling time", detail="within 5 %", unit="ms", factor=1e3, keeps_sign=True
    ),
    "bandwidth_3db_rad_s": FigureOfMerit(words="bandwidth at −3 dB", unit="rad/s", remedy=_FASTER, keeps_sign=True),
    "bandwidth_90deg_rad_s": FigureOfMerit(words="bandwidth at −90°", unit="rad/s", remedy=_FASTER, keeps_sign=True),
    "peak_db": FigureOfMerit(words="resonance peak", unit="dB"),
}

# Counted of this flight: they depend on what was flown, and have no limit.
_TRACKING = {
    "error_rms_rad": FigureOfMerit(words="error of the angle, rms", unit="°", factor=_DEGREES),
    "error_95_rad": FigureOfMerit(words="error of the angle for 95 % of the time", unit="°", factor=_DEGREES),
    "error_rms_rad_s": FigureOfMerit(words="error of the rate, rms", unit="°/s", factor=_DEGREES),
    "error_95_rad_s": FigureOfMerit(words="error of the rate for 95 % of the time", unit="°/s", factor=_DEGREES),
    "tracking_delay_s": FigureOfMerit(words="delay behind the set-point", unit="ms", factor=1e3),
}

_MARGINS = {
    "phase_margin_deg": FigureOfMerit(
        health="",
        words="phase margin",
        unit="°",
        good_above=SAFE_PHASE_MARGIN_DEG,
        card="margins",
        trouble="The {axis} loop is close to oscillation. More gain or stronger filters would make it shake.",
        whether=_FAR_FROM_OSCILLATION,
    ),
    "crossover_rad_s": FigureOfMerit(words="crossover", unit="rad/s", keeps_sign=True),
    "gain_margin_db": FigureOfMerit(words="gain margin", unit="dB"),
    "delay_margin_s": FigureOfMerit(words="delay margin", unit="ms", factor=1e3, keeps_sign=True),
    "sensitivity_peak": FigureOfMerit(
        health="a loose part, or more lag",
        words="peak sensitivity M_s",
        short="M_s",
        good_below=SAFE_PEAK,
        card="margins",
        trouble="The {axis} loop amplifies some disturbances {value} times. Lower the gains, or reduce the delay.",
        whether=_FAR_FROM_OSCILLATION,
        keeps_sign=True,
    ),
    "disturbance_rejection_rad_s": FigureOfMerit(
        words="disturbance-rejection bandwidth", unit="rad/s", keeps_sign=True
    ),
}

# Vibration is rms above 10 Hz; more disturbs the estimate of height and position. Noise that passes through D moves
# nothing and heats motors. What share of the samples clipped was counted, and is no estimate.
_NOISE = {
    "vibration_m_s2": FigureOfMerit(
        health=UNBALANCED,
        words="vibration",
        unit="m/s²",
        good_below=30.0,
        card="noise",
        trouble=f"Vibration disturbs height and position. Could be propellers, motors, arms or the mount; {COMPARE}.",
        whether="vibration is low",
        surer="fly longer",
    ),
    **{
        f"vibration_{axis}_{low}_{high}hz": FigureOfMerit(
            words=f"vibration {words} at {low} to {high} Hz",
            unit="m/s²",
            keeps_sign=True,
            health=UNBALANCED,
        )
        for axis, words in (("ax", "forward"), ("ay", "sideways"), ("az", "vertically"))
        for low, high in VIBRATION_BANDS_HZ
    },
    **{
        f"rotor_line_{channel}_db": FigureOfMerit(
            words=f"height of the rotors' line in {words}", unit="dB", health=UNBALANCED
        )
        for channel, words in (
            ("p", "roll rate"),
            ("q", "pitch rate"),
            ("r", "yaw rate"),
            ("ax", "forward acceleration"),
            ("ay", "sideways acceleration"),
            ("az", "vertical acceleration"),
        )
    },
    "clipping_share": FigureOfMerit(
        words="accelerometer at its limits",
        unit="%",
        factor=100.0,
        good_below=1e-3,
        card="noise",
        trouble="The accelerometer hits its limits. Mount it softer, or find what shakes.",
    ),
    "clipping_count": FigureOfMerit(words="accelerometer at its limits, times"),
    "filter_delay_configured_s": FigureOfMerit(words="delay of the gyro filters as configured", unit="ms", factor=1e3),
    "filter_delay_measured_s": FigureOfMerit(
        health="other filters", words="delay of the gyro filters as measured", unit="ms", factor=1e3
    ),
    "filter_attenuation": FigureOfMerit(
        words="attenuation of the gyro filters", detail="noise above 30 Hz, before over after", factor=None
    ),
    **{
        f"{axis}_{term}_noise_share{band}": FigureOfMerit(
            words=f"noise through {term.upper()} of {axis}",
            detail=f"of the motor range{', above 100 Hz' if band else ''}",
            unit="%",
            factor=100.0,
            good_below=0.02 if term == "d" and not band else math.nan,
            card="noise" if term == "d" and not band else "",
            trouble="D of {axis} passes noise to the motors ({value} of their range). The motors may run hot.",
            whether="D of {axis} passes little noise ({value} of the motor range)",
            surer="fly longer",
            health="vibration, or other filters" if not band else None,
        )
        for axis in _AXES
        for term in "pd"
        for band in ("", "_above_100hz")
    },
}

# Imbalance is the distance of a motor from the mean of all; 95 % of healthy vehicles keep to its limit. At full output
# nothing is left for control; that share was counted, and is no estimate. Headroom is that of the busiest motor.
_MOTORS = {
    "imbalance": FigureOfMerit(
        words="imbalance of the motors in steady flight",
        unit="%",
        factor=100.0,
        good_below=0.3,
        ordinary=True,
        card="motors",
        whether="the motors share the work as usual",
        surer=_HOVER,
    ),
    "headroom": FigureOfMerit(
        words="output left above steady flight",
        unit="%",
        factor=100.0,
        good_above=0.15,
        card="motors",
        trouble="Little thrust is left above hover. Make it lighter, or its motors stronger.",
        whether="enough thrust is left above hover ({value} of the motor range)",
        surer=_HOVER,
    ),
    "saturated_high_share": FigureOfMerit(
        words="time with a motor at full output",
        short="at full output",
        unit="%",
        factor=100.0,
        good_below=0.05,
        card="motors",
    ),
    "saturated_low_share": FigureOfMerit(
        words="time with a motor at its lowest", short="at its lowest", unit="%", factor=100.0
    ),
    **{
        f"saturated_by_{axis}_share": FigureOfMerit(
            words=f"time with a motor at a limit while {axis} asked for most", unit="%", factor=100.0
        )
        for axis in (*_AXES, "thrust")
    },
    "motor_#_high_share": FigureOfMerit(words="time of motor # at full output", unit="%", factor=100.0),
    "motor_#_low_share": FigureOfMerit(words="time of motor # at its lowest", unit="%", factor=100.0),
    **{
        f"balance_{axis}": FigureOfMerit(words=f"balance of the motors, {words}", unit="%", factor=100.0)
        for axis, words in (("roll", "right to left"), ("pitch", "front to back"), ("yaw", "by direction"))
    },
    **{
        f"balance_1{other}": FigureOfMerit(
            words=f"balance of motors 1 and {other} against the others", unit="%", factor=100.0
        )
        for other in (2, 3, 4)
    },
    "center_of_gravity_forward": FigureOfMerit(
        words="center of gravity ahead of the middle", detail="over the longest arm"
    ),
    "center_of_gravity_right": FigureOfMerit(
        words="center of gravity right of the middle", detail="over the longest arm"
    ),
    "thrust_coefficient": FigureOfMerit(
        words="thrust coefficient of a rotor",
        detail="thrust over speed squared",
        short="thrust coefficient",
        unit="N s²/rad²",
        keeps_sign=True,
        remedy=_HOVER,
    ),
    "thrust_coefficient_per_mass": FigureOfMerit(
        health="",
        words="thrust coefficient of a rotor over mass",
        detail="thrust over mass and speed squared",
        short="thrust coefficient over mass",
        unit="m/rad²",
        keeps_sign=True,
        remedy=_HOVER,
    ),
    "thrust_by_output": FigureOfMerit(
        words="thrust coefficient of a rotor by its output",
        detail="thrust over output squared, or over the demanded share of thrust",
        unit="N",
        keeps_sign=True,
        remedy=_HOVER,
    ),
    "thrust_by_output_per_mass": FigureOfMerit(
        health="",
        words="thrust coefficient of a rotor by its output, over mass",
        detail="thrust over mass and output squared, or over mass and the demanded share of thrust",
        unit="m/s²",
        keeps_sign=True,
        remedy=_HOVER,
    ),
    "output_delay_s": FigureOfMerit(
        health="motors, ESCs or their settings", words="delay from motor output to gyro", unit="ms", factor=1e3
    ),
}

_BATTERY = {
    "start_v": FigureOfMerit(words="battery at the start", unit="V"),
    "stop_v": FigureOfMerit(words="battery at the end", unit="V"),
    "lowest_v": FigureOfMerit(words="lowest voltage", unit="V"),
    "hover_output_v": FigureOfMerit(
        health="more weight, worn propellers or weak motors",
        words="throttle in hover times voltage",
        unit="V",
        keeps_sign=True,
    ),
    "resistance_ohm": FigureOfMerit(
        health="an old or cold battery", words="internal resistance", unit="mΩ", factor=1e3
    ),
    "sag_v": FigureOfMerit(
        words="sag under load",
        unit="V",
        good_below=0.15,
        per="start_v",
        card="power",
        trouble="The battery sags much under load. It is old, cold or too small.",
        whether="the battery sags little under load",
        surer="raise the throttle a few times",
    ),
}

_FLIGHT = {
    "hover_throttle": FigureOfMerit(
        health="more weight, a weaker battery, worn propellers or weak motors",
        words="throttle in hover",
        unit="%",
        factor=100.0,
        keeps_sign=True,
    ),
    "thrust_to_weight": FigureOfMerit(
        words="full thrust over weight",
        good_above=1.5,
        card="power",
        trouble="There is little thrust.",
        whether="there is enough thrust",
        surer="raise the throttle to full for half a second in a safe climb",
        keeps_sign=True,
    ),
}

_WIND = {
    "speed_m_s": FigureOfMerit(words="wind", unit="m/s"),
    "direction_deg": FigureOfMerit(words="wind from", unit="°"),
}

_DRAG = {
    "drag_1_s": FigureOfMerit(words="drag over mass", unit="1/s", keeps_sign=True),
    "drag_at_rest_1_s": FigureOfMerit(words="drag over mass at low speed", unit="1/s", keeps_sign=True),
    "quadratic_drag_1_m": FigureOfMerit(words="drag over mass by the square of speed", unit="1/m"),
    "top_speed_m_s": FigureOfMerit(words="airspeed in level flight at 30° of tilt", unit="m/s", keeps_sign=True),
}

_YAW = {
    "drift_rad_s": FigureOfMerit(words="yaw drift with a centered stick", unit="°/s", factor=_DEGREES),
    "drift_per_volt": FigureOfMerit(words="yaw drift over battery voltage", unit="°/s/V", factor=_DEGREES),
    "yaw_trim": FigureOfMerit(words="yaw command with a centered stick", unit="%", factor=100.0),
    "yaw_trim_per_volt": FigureOfMerit(words="yaw command over battery voltage", unit="%/V", factor=100.0),
}

_TUNING = {
    "rejection_bandwidth_rad_s": FigureOfMerit(words="disturbance-rejection bandwidth", unit="rad/s"),
    "rejection_peak_db": FigureOfMerit(words="disturbance-rejection peak", unit="dB"),
    "attitude_bandwidth_rad_s": FigureOfMerit(words="attitude bandwidth", unit="rad/s"),
    "phase_delay_s": FigureOfMerit(words="phase delay of the attitude", unit="ms", factor=1e3),
}

_RESPONSE = {
    "phase_margin_rad": FigureOfMerit(words="phase margin", unit="°", factor=_DEGREES),
    "gain_margin_up": FigureOfMerit(words="gain margin upward", unit="dB", factor=None),
    "gain_margin_down": FigureOfMerit(words="gain margin downward", unit="dB", factor=None),
    "modulus_margin": FigureOfMerit(words="modulus margin"),
    "modulus_omega_rad_s": FigureOfMerit(words="modulus margin at", unit="rad/s"),
    "disturbance_rejection_bandwidth_rad_s": FigureOfMerit(words="disturbance-rejection bandwidth", unit="rad/s"),
    "disturbance_rejection_peak": FigureOfMerit(words="disturbance-rejection peak", unit="dB", factor=None),
    "disturbance_rejection_peak_omega_rad_s": FigureOfMerit(words="disturbance-rejection peak at", unit="rad/s"),
    "attitude_phase_bandwidth_rad_s": FigureOfMerit(words="attitude phase bandwidth", unit="rad/s"),
    "attitude_gain_bandwidth_rad_s": FigureOfMerit(words="attitude gain bandwidth", unit="rad/s"),
    "attitude_omega_180_rad_s": FigureOfMerit(words="attitude lag of 180° at", unit="rad/s"),
    "attitude_phase_delay_s": FigureOfMerit(words="attitude phase delay", unit="ms", factor=1e3),
    "attitude_fitted_phase_delay_s": FigureOfMerit(words="fitted attitude phase delay", unit="ms", factor=1e3),
}

BY_PART: Mapping[Part, Mapping[str, FigureOfMerit]] = MappingProxyType(
    {
        "loops": _LOOPS,
        "tracking": _TRACKING,
        "margins": _MARGINS,
        "noise": _NOISE,
        "motors": _MOTORS,
        "battery": _BATTERY,
        "flight": _FLIGHT,
        "wind": _WIND,
        "drag": _DRAG,
        "yaw": _YAW,
        "tuning": _TUNING,
        "response": _RESPONSE,
    }
)
"""Every figure by the part that holds it and by its name in documents, in the order of tables.

Those of single motors have ``#`` for its number.
"""

QUANTITIES: Mapping[str, FigureOfMerit] = MappingProxyType(
    {name: row for rows in BY_PART.values() for name, row in rows.items()}
)
"""Every figure by its name."""

_MOTOR = re.compile(r"motor_(\d+)_")


def figure(name: str) -> FigureOfMerit | None:
    """The row of a figure; ``None`` for another name.

    Examples
    --------
    >>> figure("rise_time_s").label, figure("motor_3_high_share").unit, figure("L_p")
    ('rise time, 10 to 90 % [ms]', '%', None)
    """
    return QUANTITIES.get(_MOTOR.sub("motor_#_", name))


def figures_of(part: Part) -> Mapping[str, FigureOfMerit]:
    """The rows of a part, in the order of its table.

    Examples
    --------
    >>> list(figures_of("wind"))
    ['speed_m_s', 'direction_deg']
    """
    return BY_PART[part]


def words_of_path(path: str) -> str:
    """What a figure is called by its place in a review; empty for what is none.

    Examples
    --------
    >>> words_of_path("margins.roll.gain_margin_db"), words_of_path("loops.p.rise_time_s"), words_of_path("motors.x")
    ('gain margin of roll', 'rise time of roll rate', '')
    """
    place, _, name = path.rpartition(".")
    part, _, of = place.partition(".")
    row = figure(name)
    if row is None:
        return ""
    number = _MOTOR.search(name)
    words = row.words.replace("#", number[1] if number else "#")
    words += " above 100 Hz" if name.endswith("_above_100hz") else ""
    return words + (f" of {CHANNEL_WORDS.get(of, of) if part == 'loops' else of}" if of else "")


def require_figures(part: Part, numbers: Mapping[str, object]) -> None:
    """Refuse numbers that nothing would show.

    Raises
    ------
    UsageError
        A number has no row in the table.
    """
    if unknown := [name for name in numbers if _MOTOR.sub("motor_#_", name) not in BY_PART[part]]:
        raise UsageError(
            f"{listed(unknown)} of {part} is no known figure of merit",
            needed="a row with words, unit and limit in rotorid.data.quantities",
        )
