"""What a flight card says to the pilot, for each autopilot."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from rotorid.data.flight_plan import FlightPlan, PlannedInput, Shape
from rotorid.plot.bode import COHERENCE_GUIDELINE
from rotorid.report.flight_facts import Autopilot, FlightFacts, excited_s, flown_by_hand
from rotorid.report.numbers import significant
from rotorid.report.plan_ardupilot import plan_log_bitmask
from rotorid.report.plan_px4 import LOG_PROFILE

LEAST_BATTERY_PERCENT = 30
LEAST_CELL_V = 3.5
_SAMPLES_PER_PERIOD = 10.0

_SHAPES: Mapping[Shape, str] = MappingProxyType(
    {
        "pilot_sweep": "sweep, slow to fast",
        "logarithmic_sweep": "sweep",
        "multisine": "multisine",
        "random_binary": "random steps",
        "doublet": "doublet",
        "two_one_one": "2-1-1",
        "three_two_one_one": "3-2-1-1",
    }
)

_UNITS: Mapping[Shape, int] = MappingProxyType({"doublet": 2, "two_one_one": 4, "three_two_one_one": 7})
"""Steps of one unit that a maneuver of steps lasts."""

_WAY_OUT: Mapping[Autopilot, str] = MappingProxyType(
    {
        "ArduPilot": "switch to Loiter",
        "PX4": "switch to Position",
        "Betaflight": "switch CHIRP off, level, land",
        "other": "end the test, level, hold position",
    }
)


def shape_words(planned: PlannedInput) -> str:
    """The form of a test input."""
    return _SHAPES[planned.shape]


def amplitude_words(planned: PlannedInput) -> str:
    """Its size in the pilot's units.

    Examples
    --------
    >>> step = PlannedInput(axis="roll", shape="doublet", start_s=0.0, values=[0.1, -0.1], sample_rate_hz=2.0,
    ...                     amplitude=0.15)
    >>> amplitude_words(step)
    '± 15 % of full control'
    """
    size = abs(planned.amplitude)
    percent, degrees = _short(100.0 * size), _short(math.degrees(size))
    if planned.entry == "stick":
        return f"± {percent} % of the stick"
    if planned.axis == "thrust":
        return f"± {percent} % of full thrust"
    if planned.entry == "command":
        return f"± {percent} % of full control"
    return f"± {degrees}{'°/s' if planned.entry == 'rate_setpoint' else '°'}"


def band_words(planned: PlannedInput) -> str:
    """Its frequencies in hertz, or how long its steps are.

    Examples
    --------
    >>> step = PlannedInput(axis="roll", shape="doublet", start_s=0.0, values=[0.1, -0.1], sample_rate_hz=2.0,
    ...                     amplitude=0.15)
    >>> band_words(step)
    'steps of 0.5 s'
    """
    if planned.band_rad_s is not None:
        low, high = (_short(edge / (2.0 * math.pi)) for edge in planned.band_rad_s)
        return f"{low} to {high} Hz"
    begin_s, end_s = excited_s(planned)
    return f"steps of {_short((end_s - begin_s) / _UNITS.get(planned.shape, 1))} s"


def how_to_fly(plan: FlightPlan, autopilot: Autopilot) -> str:
    """What the pilot does during every run."""
    if len(flown_by_hand(plan, autopilot)) == len(plan.inputs):
        return (
            "Each run: begin and end in trimmed hover. Follow the picture with the stick of that axis"
            f"{_hand_words(plan.inputs)}. Other sticks: small, slow corrections only."
        )
    if autopilot == "ArduPilot" and _by_script(plan):
        return (
            "Hover in the middle in Loiter, switch to Guided, then turn on the switch of the script. Hands off: the "
            "script holds the place slowly, Guided the height. The flight-mode switch takes over at any time. It ends "
            "in Loiter."
        )
    return {
        "ArduPilot": "Each run: hover in the middle, throttle near the middle, then switch to System ID (or let the "
        "script do so). It flies like Stabilize: correct drift slowly and gently, let it shake, and switch back to "
        "Loiter when the run is over.",
        "PX4": "Start the script, hover in the middle in Position mode, then switch to Offboard. Hands off: the script "
        "holds place and height slowly, and moving the sticks ends the test. It hands back in Position mode.",
        "Betaflight": "Each run: steady hover in ANGLE, turn CHIRP on, correct drift slowly and gently until CHIRP IS "
        "FINISHED, then off. Every turn takes the next axis.",
        "other": "Each run: begin in trimmed hover in the middle of the room, correct drift slowly and gently, end in "
        "hover.",
    }[autopilot]


def before(plan: FlightPlan, facts: FlightFacts) -> list[str]:
    """What to check before the flight."""
    mask = plan_log_bitmask(plan)
    logging = {
        "ArduPilot": f"Parameter file loaded; LOG_BITMASK reads {mask}; space on the card",
        "PX4": f"px4.params loaded; SDLOG_PROFILE reads {LOG_PROFILE}; space on the card",
        "Betaflight": "CLI lines pasted; debug_mode reads CHIRP; blackbox empty enough",
        "other": f"Commands, rates and attitude logged at {least_rate_hz(plan):.0f} Hz or more; space on the card",
    }[facts.autopilot]
    return [
        "Propellers undamaged, tight, right way round; battery full and strapped; nothing loose",
        logging,
        f"The way out is on a switch, and was tried in hover: {_WAY_OUT[facts.autopilot]}",
        "Position fix good" if facts.autopilot != "Betaflight" else "ANGLE mode on a switch; failsafe set and tried",
        f"Nobody within {_clear_m(facts):.0f} m of the start; wind as low as can be had",
        "Written down: take-off mass, battery, wind",
    ]


def stops(facts: FlightFacts) -> list[tuple[str, str]]:
    """Limits, large: what, and how much."""
    return [
        ("tilt", f"{math.degrees(facts.stop_tilt_rad):.0f}°"),
        ("rate", f"{math.degrees(facts.stop_rate_rad_s):.0f}°/s"),
        ("from start", f"{facts.stop_room_m:.0f} m"),
        ("height off by", f"{length_words(facts.stop_climb_m)} m"),
        ("battery", f"{LEAST_BATTERY_PERCENT} %"),
    ]


def stop_sentence(facts: FlightFacts) -> str:
    """How to stop, and the reasons that no number covers."""
    way = _WAY_OUT[facts.autopilot]
    return (
        f"{way[0].upper()}{way[1:]}. Also when an oscillation grows, a sound is new, the link is poor, or you are not "
        f"sure; and below {LEAST_CELL_V:g}\u00a0V in any cell under load."
    )


def after(plan: FlightPlan, facts: FlightFacts) -> list[str]:
    """What to look at after the flight."""
    count = f"{len(plan.inputs)} {'maneuver' if len(plan.inputs) == 1 else 'maneuvers'}"
    low, high = (100.0 * edge for edge in facts.motors)
    return [
        f"{count} found on {_and(plan.axes)}, without gaps",
        f"Commands and rates logged at {least_rate_hz(plan):.0f} Hz or more",
        f"Coherence {COHERENCE_GUIDELINE:g} or more over the band",
        f"As predicted: tilt up to {math.degrees(facts.tilt_rad):.0f}°, rates up to "
        f"{math.degrees(facts.rate_rad_s):.0f}°/s, motors {low:.0f} to {high:.0f}\u00a0%",
        "If not: fly again with more amplitude (coherence low) or less (motors at their limits)",
    ]


def least_rate_hz(plan: FlightPlan) -> float:
    """Rate of the log that the plan needs: ten samples in a period of its highest frequency, 50 Hz at least."""
    highest = max((planned.band_rad_s[1] for planned in plan.inputs if planned.band_rad_s), default=0.0)
    wanted = _SAMPLES_PER_PERIOD * highest / (2.0 * math.pi)
    return max(10.0 * math.ceil(wanted / 10.0 - 1e-9), 50.0)


def clock_words(seconds: float) -> str:
    """Minutes and seconds.

    Examples
    --------
    >>> clock_words(65.4), clock_words(9.0)
    ('1:05', '0:09')
    """
    whole = round(seconds)
    return f"{whole // 60}:{whole % 60:02d}"


def length_words(meters: float) -> str:
    """A length without its unit: whole meters from ten up, below in decimeters.

    Examples
    --------
    >>> length_words(145.07), length_words(2.64), length_words(4.0), length_words(0.0)
    ('145', '2.6', '4', '0')
    """
    return f"{meters:.0f}" if meters >= 9.95 else f"{meters:.1f}".removesuffix(".0")


def _hand_words(inputs: Sequence[PlannedInput]) -> str:
    """How the hand moves: sweeps grow faster, steps are held."""
    kinds = {planned.maneuver.kind for planned in inputs}
    if kinds == {"sweep"}:
        return "; go from slow to fast evenly, never faster than your hand stays smooth"
    if kinds <= {"doublet", "multistep"}:
        return ": quickly to each level, hold it still as long as the picture does, then let go to the middle"
    return ", sweeps evenly from slow to fast, steps quickly from level to level" if "sweep" in kinds else ""


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 10.0 else significant(value, digits=2)


def _by_script(plan: FlightPlan) -> bool:
    """Whether ArduPilot's own mode cannot fly the plan."""
    by_hand = flown_by_hand(plan, "ArduPilot")
    return any(planned.shape != "logarithmic_sweep" for planned in plan.inputs if planned not in by_hand)


def _clear_m(facts: FlightFacts) -> float:
    """Room, and as much again as the vehicle may fall away from its height."""
    return facts.stop_room_m + max(facts.height_m, 10.0)


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
