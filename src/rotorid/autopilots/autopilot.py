"""What the package knows of an autopilot: one value, of which every question has a field.

The answers here are those for an autopilot that is not known, so that nobody has to ask whether it is. Each autopilot
says in its own room what differs. Answers that are functions import what they need when they are asked.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, TypeAlias

if TYPE_CHECKING:
    from rotorid.autopilots.notches import FilterChange, Motion, MovingNotches, NoiseLines
    from rotorid.autopilots.passages import Passage
    from rotorid.autopilots.thrust import Linearization, ThrustParameter
    from rotorid.data.findings import Finding
    from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape
    from rotorid.data.record import FlightRecord
    from rotorid.typing import Axis

LogFormat: TypeAlias = Literal["ulg", "bin", "bbl", "csv"]
"""Formats in which simulated flights are written."""


def _unknown_passage(_record: FlightRecord, _source: str, _sensor_rate_hz: float | None) -> Passage:
    from rotorid.autopilots.passages import UNKNOWN, doubtful

    return doubtful(UNKNOWN)


def _no_notches(_record: FlightRecord, _motion: Motion) -> MovingNotches:
    from rotorid.autopilots.notches import no_notches

    return no_notches()


def _no_changes(_record: FlightRecord, _lines: NoiseLines) -> Sequence[FilterChange]:
    return ()


def _unknown_linearization(_record: FlightRecord) -> Linearization | None:
    return None


def _no_frame(_record: FlightRecord) -> tuple[str, str] | None:
    return None


def _no_cutoff(_record: FlightRecord) -> float:
    return 0.0


@dataclass(frozen=True, kw_only=True)
class Log:
    """What a log of an autopilot holds, and how.

    Parameters
    ----------
    own
        Whether the autopilot wrote it itself.
    telemetry
        Whether it came over the radio, from an autopilot that keeps a faster one.
    thrust_demand
        Whether its motors are demands of thrust, which the autopilot bends on their way out.
    outputs_scaled
        Whether its reader scales outputs from idle, or none, to full ones.
    straightened
        Whether the demands of its mixer are in thrust: the autopilot takes the curve of the motors out.
    hover_by_motors
        Whether the throttle of hover is that of the motors, not of the thrust command.
    rate_source
        Source of the rate that the controller takes; empty where that is not known.
    sensor_rate_logged
        Whether the log says at which rate the filters ran.
    unfiltered_topic
        Topic whose gyro has passed none of the filters of the controllers.
    fields_chosen
        Whether the user chooses the fields that are logged one by one.
    in_one_turn
        Whether inputs and outputs are written in one turn of its loop, so that their stamps show when they were taken.
    topics_listed
        Whether the logger reads a list of topics and rates from the SD card.
    frame
        Name of the frame, and in brackets what the log says instead of one; ``None`` where it names none.
    passage
        What a channel has passed: of the record, the source of the channel and the sensor's rate where one is given.
    moving_notches
        The notches of its gyro that follow something, of the record and of what they follow.
    hidden_filters
        Parameters of filters that a log lacks while they are off, with the values that they begin with.
    filter_changes
        Filters that it offers against lines in the noise.
    linearization
        How demands become the logged outputs; ``None`` where that is not known.
    accelerometer_cutoff_hz
        Low-pass in front of the logged accelerometer; zero where none is known.
    """

    own: bool = False
    telemetry: bool = False
    thrust_demand: bool = False
    outputs_scaled: bool = False
    straightened: bool = False
    hover_by_motors: bool = False
    rate_source: str = ""
    sensor_rate_logged: bool = False
    unfiltered_topic: str = ""
    fields_chosen: bool = False
    in_one_turn: bool = False
    topics_listed: bool = False
    frame: Callable[[FlightRecord], tuple[str, str] | None] = _no_frame
    passage: Callable[[FlightRecord, str, float | None], Passage] = _unknown_passage
    moving_notches: Callable[[FlightRecord, Motion], MovingNotches] = _no_notches
    hidden_filters: Mapping[str, float] = field(default_factory=dict)
    filter_changes: Callable[[FlightRecord, NoiseLines], Sequence[FilterChange]] = _no_changes
    linearization: Callable[[FlightRecord], Linearization | None] = _unknown_linearization
    accelerometer_cutoff_hz: Callable[[FlightRecord], float] = _no_cutoff


def _log_it(_record: FlightRecord, rate_hz: float, _channels: tuple[str, ...]) -> str:
    return "log it faster" if rate_hz > 0.0 else "log it, or name its source with --map"


def _nothing(_record: FlightRecord) -> str:
    return ""


def _log_speeds(_record: FlightRecord) -> str:
    return "log the motors' speeds at 40 Hz and more"


def _log_less(_record: FlightRecord) -> str:
    return "log less"


def _as_all(_record: FlightRecord, _rate_hz: float) -> str:
    return ""


def _fly_a_sweep(_record: FlightRecord, axes: Sequence[Axis]) -> str:
    from rotorid.data.display import listed

    return f"fly a {listed(axes)} sweep, slow to fast, for a minute or more"


@dataclass(frozen=True, kw_only=True)
class Advice:
    """What to change so that the next log of the same vehicle can answer: what its firmware has and is not set.

    Parameters
    ----------
    logging
        How commands and rates are logged, fast enough: of the record, the rate of the slowest channel that is needed
        (zero where it is not logged), and the channels that are not logged, as far as they are known.
    sensors
        How the sensors are logged, fast enough for the vibration of rotors: of the record and their rate.
    raw_gyro, motors
        How the gyro before its filters, and the motor outputs, are logged.
    slow_motors
        How the motor outputs are logged faster than at this rate; empty where as everything else.
    speeds, gains
        How the speeds of the motors, and the gains of the rate controllers, are logged.
    gaps
        How the log has no gaps.
    wind
        How the estimator finds the wind; empty where it has no way.
    flying
        How the vehicle flies an excitation of some axes.
    """

    logging: Callable[[FlightRecord, float, tuple[str, ...]], str] = _log_it
    sensors: Callable[[FlightRecord, float], str] = _as_all
    raw_gyro: Callable[[FlightRecord], str] = _nothing
    motors: Callable[[FlightRecord], str] = _nothing
    slow_motors: Callable[[FlightRecord, float], str] = _as_all
    speeds: Callable[[FlightRecord], str] = _log_speeds
    gains: str = "use the autopilot's own log, which contains its parameters"
    gaps: Callable[[FlightRecord], str] = _log_less
    wind: Callable[[FlightRecord], str] = _nothing
    flying: Callable[[FlightRecord, Sequence[Axis]], str] = _fly_a_sweep


BY_DSHOT = "log the motors' speeds (bidirectional DShot) at 40 Hz and more"
"""Advice where the motor controllers can send them."""


def sweep_by_stick(_record: FlightRecord, axes: Sequence[Axis]) -> str:
    """Advice of an autopilot that adds no excitation by itself."""
    from rotorid.data.display import listed

    return f"sweep the {listed(axes)} stick, slow to fast, for a minute or more"


def _usual_runs(_plan: FlightPlan, _flown: Sequence[PlannedInput], _firmware: str) -> str:
    return "Each run: begin in trimmed hover in the middle of the room, correct drift slowly and gently, end in hover."


@dataclass(frozen=True, kw_only=True)
class Card:
    """Words of the flight card that differ between autopilots.

    Parameters
    ----------
    way_out
        How a test is broken off.
    hand_way_out
        How a plan that is all flown by hand is broken off; empty where that is the same.
    way_height
        Where the throttle belongs on the way out, where a hand keeps the height.
    way_tried
        What is tried in hover before the way out, where a hand keeps the height.
    loaded
        What is checked of parameters and logging; ``{mask}``, ``{profile}`` and ``{rate_hz}`` are filled in.
    ready
        What else has to be so before the start.
    hand_mode
        In which mode runs by hand are flown.
    how
        What the pilot does in the runs that the autopilot flies: of the plan, these inputs and the firmware.
    """

    way_out: str = "end the test, level, hold position"
    hand_way_out: str = ""
    way_height: str = ""
    way_tried: str = ""
    loaded: str = "Commands, rates and attitude logged at {rate_hz:.0f} Hz or more; space on the card"
    ready: str = "Position fix good"
    hand_mode: str = ""
    how: Callable[[FlightPlan, Sequence[PlannedInput], str], str] = _usual_runs


def _no_hand(_plan: FlightPlan) -> bool:
    """Whether a hand keeps the height: never."""
    return False


def _not_checked(_plan: FlightPlan, _firmware: str) -> tuple[Finding, ...] | None:
    """Whether the files fly: not known."""
    return None


@dataclass(frozen=True, kw_only=True)
class Autopilot:
    """An autopilot: its logs, its advice, what it flies by itself, and how its parameters are called.

    Parameters
    ----------
    name
        As it is printed, and as the formats of its own logs begin; empty for one that is not known.
    key
        As the command line and vehicles call it.
    called
        Other first words of its firmware's name.
    log, telemetry
        What its own log holds, and what it sends over the radio.
    advice
        For its next log.
    log_format
        In which simulated flights are written as it would log them.
    frequency
        Unit in which its pilots think of frequencies.
    vehicle
        Of the library, that it flies.
    gain
        A parameter that all of its logs have and no other autopilot's.
    takes_gains
        Whether a simulated vehicle can fly with the gains of a log.
    hover
        The parameter that holds the throttle of hover.
    thrust_parameter
        The parameter that straightens the curve of the motors; ``None`` where it has none.
    gains_by_throttle
        Whether the throttle stick moves its gains and filters.
    waits_for_sensor
        Whether a slow sensor holds its loop back.
    shapes_setpoints
        Whether it smooths attitude set-points (:mod:`rotorid.simulation.shaping`).
    adds_sweeps
        Whether it adds sweeps behind its controllers by itself, and logs fast motion, before its filters, only then.
    entry
        Where a user adds a test input without hands.
    step_entry
        Where steps are added; as ``entry`` where it is ``None``.
    sweep
        The sweep that it flies by itself.
    leaves_steps
        Whether it flies sweeps only, so that steps are flown by hand.
    hand_on_throttle
        Whether a hand keeps the height in the runs of a plan that it flies itself.
    plan_findings
        Whether a firmware flies the files of a plan; ``None`` where that is not known.
    has_plan_files
        Whether plans are written for it.
    loading
        How a pilot loads a file of its parameters.
    card
        Words for its pilot.
    """

    name: str
    key: str
    called: tuple[str, ...] = ()
    log: Log = field(default_factory=Log)
    telemetry: Log = field(default_factory=lambda: Log(telemetry=True))
    advice: Advice = field(default_factory=Advice)
    log_format: LogFormat = "csv"
    frequency: Literal["Hz", "rad/s"] = "rad/s"
    vehicle: str = "px4_quad"
    gain: str = ""
    takes_gains: bool = False
    hover: str = ""
    thrust_parameter: Callable[[], ThrustParameter] | None = None
    gains_by_throttle: bool = False
    waits_for_sensor: bool = False
    shapes_setpoints: bool = False
    adds_sweeps: bool = False
    entry: Entry = "command"
    step_entry: Entry | None = None
    sweep: Shape = "pilot_sweep"
    leaves_steps: bool = False
    hand_on_throttle: Callable[[FlightPlan], bool] = _no_hand
    plan_findings: Callable[[FlightPlan, str], tuple[Finding, ...] | None] = _not_checked
    has_plan_files: bool = False
    loading: str = "Load the file with your ground station."
    card: Card = field(default_factory=Card)
