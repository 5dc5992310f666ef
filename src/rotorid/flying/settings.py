"""Choices for planned and simulated flights (inputs, limits, wind, vehicle) and for flown models."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, TypeAlias, get_args

from rotorid.autopilots.autopilot import LogFormat
from rotorid.autopilots.registry import AUTOPILOTS, named
from rotorid.data.base import Immutable
from rotorid.errors import UsageError
from rotorid.settings.option import Option, Seed, Text, require_seed
from rotorid.settings.parsing import (
    BAND,
    CONTROLLERS,
    LISTED,
    NAMES,
    PATHS,
    parse_assignments,
)
from rotorid.units import read_measures

if TYPE_CHECKING:
    from rotorid.data.findings import Finding
    from rotorid.data.flight_plan import Entry, FlightPlan, Shape
    from rotorid.fitting.flight.fit import FlightRange
    from rotorid.flying.user_vehicles import OwnVehicle
    from rotorid.planning.amplitude import Limits
    from rotorid.planning.expected import FitSettings
    from rotorid.planning.prior import Prior
    from rotorid.settings.given_controllers import GivenController
    from rotorid.simulation.multirotor_flight import Aircraft
    from rotorid.simulation.wind import Wind
    from rotorid.typing import Axis
    from rotorid.vehicles.catalog import Interface, Vehicle, VehicleEntry

_MOST_RUNS = 10_000
_FASTEST_M_S = 100.0
_MOST_REPEATS = 20
_LONGEST_PLAN_S = 1800.0

_STEP_S = 0.3
"""Default length of one step."""

UNITS_OF_STEPS: "Mapping[Shape, int]" = MappingProxyType({"doublet": 2, "two_one_one": 4, "three_two_one_one": 7})
"""Length of a maneuver of steps, in units of one step."""

_SWEEP_UNITS = 200
"""An input without steps is by default as long as so many."""

DOUBLET_S = UNITS_OF_STEPS["doublet"] * _STEP_S

BEHIND_SETPOINTS = "response.second_order_delay"
"""What is identified of a vehicle behind set-points unless another model is named."""


_SHAPES = {
    "sweep": "pilot_sweep",
    "log_sweep": "logarithmic_sweep",
    "multisine": "multisine",
    "binary": "random_binary",
    "doublet": "doublet",
    "2-1-1": "two_one_one",
    "3-2-1-1": "three_two_one_one",
}
_LIMITS = {
    "tilt": "tilt_rad",
    "rate": "rate_rad_s",
    "position": "position_m",
    "height": "height_m",
    "motor_low": "motor_low",
    "motor_high": "motor_high",
}
_UNITS_OF_LIMITS = {"tilt": "deg", "rate": "deg/s", "position": "m", "height": "m"}
_DEGREES = ("tilt", "rate")


def parse_changes(texts: Sequence[str]) -> dict[str, float]:
    """Read numbers of a vehicle, ``NAME=VALUE`` once or more.

    Examples
    --------
    >>> parse_changes(["m=1.5kg", "tau=10ms", "arm=20cm", "I_xx=0.02"])
    {'m': 1.5, 'tau': 0.01, 'arm': 0.2, 'I_xx': 0.02}
    """
    from rotorid.flying.vehicle_numbers import UNITS

    lags = dict.fromkeys(("T_motor_up", "T_motor_down", "tau"), "s")
    return parse_assignments(texts, option="--set", units={**UNITS, **lags})


def parse_percents(texts: Sequence[str], *, option: str) -> dict[str, float]:
    """Read ``NAME=PERCENT`` once or more.

    Examples
    --------
    >>> parse_percents(["L_p=5", "tau=10%"], option="--reach")
    {'L_p': 5.0, 'tau': 10.0}
    """
    return parse_assignments(texts, option=option, units={}, otherwise="%")


def parse_limits(texts: Sequence[str]) -> "Limits":
    """Read ``NAME=VALUE`` once or more: what a flight may reach, angles in degrees unless a unit says otherwise."""
    from rotorid.models.parameter import no_such
    from rotorid.planning.amplitude import Limits

    given = parse_assignments(texts, option="--limit", units=_UNITS_OF_LIMITS)
    if wrong := [name for name in given if name not in _LIMITS]:
        raise no_such("limit", wrong[0], tuple(_LIMITS))
    return Limits(
        **{_LIMITS[name]: math.radians(value) if name in _DEGREES else value for name, value in given.items()}
    )


def parse_shape(kind: str) -> "Shape":
    """Read the name of a test input.

    Examples
    --------
    >>> parse_shape("3-2-1-1")
    'three_two_one_one'
    """
    from rotorid.models.parameter import no_such

    known = {**_SHAPES, **{shape: shape for shape in _SHAPES.values()}}
    if kind not in known:
        raise no_such("kind of test input", kind, tuple(_SHAPES))
    return known[kind]  # type: ignore[return-value]


def parse_axes(text: str) -> "tuple[Axis, ...]":
    """Read axes with commas between them; ``all`` is all four.

    Examples
    --------
    >>> parse_axes("roll, yaw")
    ('roll', 'yaw')
    """
    from rotorid.data.record import AXES
    from rotorid.models.parameter import no_such

    names = AXES if text == "all" else tuple(part.strip() for part in text.split(","))
    if wrong := [name for name in names if name not in AXES]:
        raise no_such("axis", wrong[0], AXES)
    return names  # type: ignore[return-value]


def parse_speed(text: str) -> tuple[float, float]:
    """Read ``V``, or ``V:V`` for a flight from one speed to another.

    Examples
    --------
    >>> parse_speed("4"), parse_speed("0:8")
    ((4.0, 4.0), (0.0, 8.0))
    """
    came, needed = f"--speed {text} is not a speed", "V or V:V in m/s, such as --speed 4 or --speed 0:8"
    speeds = read_measures(text, "m/s", ":", came=came, needed=needed)
    if len(speeds) > 2:
        raise UsageError(came, needed=needed)
    return speeds[0], speeds[-1]


def parse_wind(text: str) -> tuple[float, float]:
    """Read ``NORTH`` or ``NORTH,EAST`` in m/s.

    Examples
    --------
    >>> parse_wind("3"), parse_wind("-1,2")
    ((3.0, 0.0), (-1.0, 2.0))
    """
    came, needed = f"--wind {text} is not a wind", "NORTH or NORTH,EAST in m/s, such as --wind 3,-1"
    blows = read_measures(text, "m/s", ",", came=came, needed=needed)
    if len(blows) > 2:
        raise UsageError(came, needed=needed)
    return blows[0], blows[1] if len(blows) > 1 else 0.0


CHANGES = Text("NAME=VALUE", parse_changes, repeats=True)
LIMITS = Text("NAME=VALUE", parse_limits, repeats=True)
AXIS_NAMES = Text("AXIS,...", parse_axes)
SPEED = Text("V|V:V", parse_speed)
WIND = Text("NORTH[,EAST]", parse_wind)


def _read_prior(path: str) -> "Prior":
    from rotorid.planning.prior import read_prior

    return read_prior(Path(path))


def _calm() -> "Wind":
    from rotorid.simulation.wind import CALM

    return CALM


def _usual_limits() -> "Limits":
    from rotorid.planning.amplitude import Limits

    return Limits()


def _usual_fit() -> "FitSettings":
    from rotorid.planning.expected import FitSettings

    return FitSettings()


Changes: TypeAlias = Annotated[
    Mapping[str, float],
    Option(
        "--set",
        "A number of the vehicle: m, I_xx, I_yy, I_zz, T_motor, T_motor_up, T_motor_down, kappa, tau in SI units; "
        "thrust and drag as factors. Repeatable.",
        "Vehicle and autopilot",
        CHANGES,
    ),
]


LIKE_HELP = "Library vehicle that supplies autopilot, sensors and missing numbers for a result."
PLANNED = tuple(autopilot.key for autopilot in AUTOPILOTS if autopilot.has_plan_files)
"""Autopilots that files of a plan are written for."""


def vehicle_names() -> Iterable[str]:
    """Vehicles of the library."""
    from rotorid.vehicles.catalog import VEHICLES

    return VEHICLES


@dataclass(frozen=True, kw_only=True)
class VehicleFileSettings(Immutable):
    """A vehicle file that is to be printed."""

    results: Annotated[
        tuple[Path, ...],
        Option("--from", "Folder or result.json of identify: print a vehicle file. Repeatable.", text=PATHS),
    ] = ()
    like: Annotated[str | None, Option("--like", LIKE_HELP, metavar="NAME", words=vehicle_names)] = None
    known: Annotated[
        Mapping[str, float],
        Option("--set", "A number that you measured, such as m=1.4. Repeatable.", text=CHANGES),
    ] = field(default_factory=dict)
    name: Annotated[str | None, Option("--name", "Name of the vehicle in the file.", metavar="NAME")] = None
    toml: Annotated[bool, Option("--toml", "Print the vehicle as a file.")] = False


@dataclass(frozen=True, kw_only=True)
class AutopilotSettings(Immutable):
    """Options that take gains, noise and wind from a log or result, and name the autopilot for files."""

    gains: Annotated[
        Path | None,
        Option(
            "--gains",
            "Take gains, noise and wind from a log of your own autopilot; --wind goes before its wind.",
            "Vehicle and autopilot",
        ),
    ] = None
    tuned: Annotated[
        Path | None,
        Option(
            "--for-tune",
            "Sweep the band that tune needs, for the gains of a log or a result. Noise and wind of a log are used "
            "as by --gains.",
            "Vehicle and autopilot",
            metavar="LOG|RESULT",
        ),
    ] = None
    autopilot: Annotated[
        str | None,
        Option(
            "--for",
            "The autopilot to write files for. [default: the vehicle's]",
            "Vehicle and autopilot",
            words=PLANNED,
        ),
    ] = None


@dataclass(frozen=True, kw_only=True)
class Air:
    """The wind of a flight in simulation, as the command line has it.

    Parameters
    ----------
    mean_m_s
        Where the air moves, to north and to east.
    """

    mean_m_s: Annotated[
        tuple[float, float],
        Option("--wind", "Velocity of the air in m/s, north and east; one number is north.", "Air", WIND),
    ] = (0.0, 0.0)
    turbulence_m_s: Annotated[
        float, Option("--turbulence", "Standard deviation of horizontal gusts in m/s.", "Air")
    ] = 0.0
    height_m: Annotated[float, Option("--height", "Height above ground in m, which sets the size of gusts.", "Air")] = (
        10.0
    )

    @property
    def wind(self) -> "Wind":
        """The wind of the simulation."""
        from rotorid.simulation.wind import Wind

        north_m_s, east_m_s = self.mean_m_s
        return Wind(north_m_s=north_m_s, east_m_s=east_m_s, turbulence_m_s=self.turbulence_m_s, height_m=self.height_m)


@dataclass(frozen=True, kw_only=True)
class PlanSettings(Immutable):
    """Choices of a plan.

    Parameters
    ----------
    shape
        Form of the test input.
    axes
        Excited one after the other; a multisine excites them at the same time, and so do random binary signals that
        fly ``together``.
    band_rad_s
        Lowest and highest frequency, where the shape has a band.
    duration_s
        Of each test input, of a multisine with all its periods; by default 60 s, and of steps 0.3 s for each unit.
    repeats
        How often each is flown in a row, every time with other noise. Steps alternate in sign.
    entry
        Where they are added; by default see :func:`rotorid.flying.designs.default_entry`.
    amplitudes
        By axis, for those that are not to be searched for.
    limits
        What the flight may reach.
    doublets
        Whether doublets that no model will be fitted to follow, to verify it.
    together
        Whether random binary signals excite all axes at the same time.
    interface
        Of a vehicle that is reached by its set-points alone.
    bands
        By axis, of those that are flown on their own in another band than ``band_rad_s``.
    wind
        The wind that the amplitudes allow for.
    seed
        Of what is random in the inputs, and of wind and noise while amplitudes are searched for.
    """

    shape: "Shape" = "pilot_sweep"
    axes: Annotated[
        "tuple[Axis, ...]",
        Option(
            "--axis",
            "roll, pitch, yaw, thrust or all. [default: those of --inputs; all that a vehicle "
            "behind set-points takes; else roll]",
            "Test inputs",
            AXIS_NAMES,
        ),
    ] = ("roll", "pitch", "yaw", "thrust")
    band_rad_s: Annotated[
        tuple[float, float],
        Option(
            "--band",
            "Band in rad/s, or LO:HIHz. [default: 0.6:50; of a vehicle behind set-points what it follows]",
            "Test inputs",
            BAND,
        ),
    ] = (0.6, 50.0)
    duration_s: Annotated[
        float | None,
        Option(
            "--duration",
            f"Length of each test input. [default: {_SWEEP_UNITS * _STEP_S:g}; of steps {_STEP_S:g} for each unit]",
            "Test inputs",
        ),
    ] = None
    repeats: Annotated[int, Option("--repeats", "How often each test input is flown.", "Test inputs")] = 1
    entry: Annotated[
        "Entry | None",
        Option(
            "--entry",
            "Where the test input is added. [default: what the autopilot can fly]",
            "Test inputs",
            words=("command", "rate_setpoint", "attitude_setpoint", "stick"),
        ),
    ] = None
    amplitudes: Annotated[
        Mapping[str, float],
        Option(
            "--amplitude",
            "Amplitude of an axis: rad of an attitude, rad/s of a rate, else a fraction; or with a unit. "
            "[default: the largest within the limits] Repeatable.",
            "Test inputs",
            Text(
                "AXIS=VALUE", partial(parse_assignments, option="--amplitude", units={}, otherwise=None), repeats=True
            ),
        ),
    ] = field(default_factory=dict)
    limits: Annotated[
        "Limits",
        Option(
            "--limit",
            "What a flight may reach: tilt (deg), rate (deg/s), position (m), height (m), motor_low, motor_high. "
            "[default: tilt=25, rate=180, position=10, height=5, motor_low=0.05, motor_high=0.95] Repeatable.",
            "Test inputs",
            LIMITS,
        ),
    ] = field(default_factory=_usual_limits)
    doublets: Annotated[
        bool, Option("--doublets", "Add two doublets of each axis at the end, to verify the model on.", "Test inputs")
    ] = False
    together: Annotated[
        bool,
        Option(
            "--together",
            "Excite all axes at the same time with uncorrelated random binary signals. Always so for set-points that "
            "are identified together.",
            "Test inputs",
        ),
    ] = False
    interface: "Interface | None" = None
    bands: "Mapping[Axis, tuple[float, float]]" = field(default_factory=dict)
    wind: "Wind" = field(default_factory=_calm)
    seed: Seed = 0

    def __post_init__(self) -> None:
        from rotorid.data.flight_plan import Entry
        from rotorid.data.record import AXES
        from rotorid.models.parameter import no_such

        if self.entry is not None and self.entry not in get_args(Entry):
            raise no_such("entry of a test input", self.entry, get_args(Entry))
        wrong = [axis for axis in self.axes if axis not in AXES] or len(set(self.axes)) < len(self.axes)
        if wrong or not self.axes:
            raise UsageError(
                f"--axis {','.join(self.axes) or '(empty)'} is not a list of axes",
                needed=f"{', '.join(AXES)}, each at most once",
            )
        if not 1 <= self.repeats <= _MOST_REPEATS:
            raise UsageError(f"--repeats {self.repeats} is out of range", needed=f"1 to {_MOST_REPEATS}")
        self._require_taken()
        if not 0.0 < self.length_s <= _LONGEST_PLAN_S:
            raise UsageError(
                f"--duration {self.length_s:g} is out of range", needed=f"more than 0 s, at most {_LONGEST_PLAN_S:g} s"
            )
        for axis, size in self.amplitudes.items():
            if axis not in self.axes or not 0.0 < size < math.inf:
                raise UsageError(
                    f"--amplitude {axis}={size:g} is no amplitude of this plan",
                    needed=f"a positive number for {' or '.join(self.axes)}",
                )
        self._set(axes=tuple(self.axes), amplitudes=self.amplitudes, bands=self.bands)

    def band_of(self, axis: "Axis") -> tuple[float, float]:
        """Lowest and highest frequency of an axis that is flown on its own."""
        return self.bands.get(axis, self.band_rad_s)

    def _require_taken(self) -> None:
        """Refuse test inputs at a place that a vehicle behind its set-points does not have."""
        if self.interface is None:
            return
        taken = self.interface.entries
        missing = [axis for axis in self.axes if axis not in taken]
        missing += [axis for axis in self.axes if axis in taken and self.entry not in (None, taken[axis])]
        if missing:
            where = f" at the {self.entry}" if self.entry is not None else ""
            raise UsageError(
                f"this vehicle accepts set-points only: {missing[0]}{where} cannot be excited",
                needed=", ".join(f"{axis} at the {entry}" for axis, entry in taken.items()),
            )

    @property
    def length_s(self) -> float:
        """Duration of each test input."""
        if self.duration_s is not None:
            return self.duration_s
        return UNITS_OF_STEPS.get(self.shape, _SWEEP_UNITS) * _STEP_S


def plan_settings(
    vehicle: "VehicleEntry", *, inputs: Sequence[str] = (), models: Sequence[str] = (), **wishes: object
) -> PlanSettings:
    """Choices of a plan for a vehicle, what was not asked for as the vehicle and the inputs of a model ask for it.

    Parameters
    ----------
    inputs
        Set-points whose responses will be identified.
    **wishes
        Fields of :class:`PlanSettings` that were given.

    Raises
    ------
    UsageError
        An input is no set-point, or is excited elsewhere than was asked for.

    Examples
    --------
    >>> from rotorid.vehicles import VEHICLES
    >>> plan_settings(VEHICLES["bebop"], shape="random_binary").axes
    ('roll', 'pitch', 'thrust')
    >>> plan_settings(VEHICLES["x500"], inputs=["q_setpoint"]).entry
    'rate_setpoint'
    """
    from rotorid.models.families import family_of
    from rotorid.planning.responses import SETPOINTS

    if wrong := [name for name in inputs if name not in SETPOINTS]:
        raise UsageError(f"{wrong[0]} is not a set-point", needed=f"one of {', '.join(SETPOINTS)}")
    answers = [SETPOINTS[name] for name in inputs]
    given = {name: value for name, value in wishes.items() if value is not None}
    interface = vehicle.interface
    if interface is not None:
        given.setdefault("band_rad_s", interface.band_rad_s)
    elif inputs or any(family_of(name).of_plans for name in models):
        entries = list(dict.fromkeys(answer.entry for answer in answers)) or ["attitude_setpoint"]
        if len(entries) > 1:
            raise UsageError(
                f"{', '.join(inputs)} enter at different places of the cascade",
                needed="set-points of one loop in one plan",
            )
        given.setdefault("entry", entries[0])
    usual = tuple(interface.entries) if interface is not None else ("roll",)
    given.setdefault("axes", tuple(dict.fromkeys(answer.axis for answer in answers)) or usual)
    if interface is not None or any(family_of(name).of_plans for name in models):
        given["together"] = True
    return PlanSettings(interface=interface, **given)  # type: ignore[arg-type]


@dataclass(frozen=True, kw_only=True)
class DesignSettings(Immutable):
    """Choices of ``design``.

    Parameters
    ----------
    vehicle
        Name in the library, or a vehicle of one's own.
    kinds
        Shapes, one plan each.
    plan
        What all plans share: axes, band, duration, limits, wind.
    models
        Names of models whose parameters are to be known; by default the rate model of every axis, and of a vehicle
        behind set-points a response of second order with delay to each.
    inputs, outputs
        Set-points of response models and what answers them, in one order; by default those of the axes.
    reach
        Parameter to the largest standard deviation wanted, in percent: the shortest duration is looked for.
    changes
        Numbers of the vehicle that are to be otherwise.
    prior
        A previous result, whose values replace those of the vehicle.
    gains
        Parameters of an autopilot, whose gains replace those of the vehicle.
    gains_source
        File that they came from.
    firmware
        Of the autopilot that will fly, as its logs name it; empty where it is not known.
    gyro_noise_rad_s
        Of the gyroscopes, as a log shows it; that of the vehicle where it is ``None``.
    hover_throttle
        Thrust command in hover, as a log shows it; that of the vehicle where it is ``None``.
    own
        Where the vehicle came from results: its numbers with their sources.
    remarks
        What was taken from a log, and what it does not show.
    fit
        How the flight will be identified.
    """

    vehicle: "Vehicle"
    kinds: "tuple[Shape, ...]"
    plan: PlanSettings = field(default_factory=PlanSettings)
    models: Annotated[
        tuple[str, ...],
        Option(
            "--model",
            "What will be identified: rate.*, axis.*, hover.*, response.* [default: the rate model of each axis; "
            "behind set-points response.second_order_delay] Repeatable.",
            "Predicted errors",
            LISTED,
        ),
    ] = ()
    inputs: Annotated[
        tuple[str, ...],
        Option(
            "--inputs",
            "For response.*: the set-points to excite.",
            "Predicted errors",
            NAMES,
            metavar="SETPOINT,...",
        ),
    ] = ()
    outputs: Annotated[
        tuple[str, ...],
        Option(
            "--outputs",
            "For response.*: the channel that follows each of --inputs.",
            "Predicted errors",
            NAMES,
            metavar="CHANNEL,...",
        ),
    ] = ()
    reach: Annotated[
        Mapping[str, float],
        Option(
            "--reach",
            "Wanted standard deviation; finds the shortest test input that reaches it. Repeatable.",
            "Predicted errors",
            Text("NAME=PERCENT", partial(parse_percents, option="--reach"), repeats=True),
        ),
    ] = field(default_factory=dict)
    changes: Changes = field(default_factory=dict)
    prior: Annotated[
        "Prior | None",
        Option(
            "--prior",
            "Result of an earlier flight, for the expected values: its folder or result.json.",
            "Predicted errors",
            Text("<path>", _read_prior),
        ),
    ] = None
    gains: Mapping[str, float] = field(default_factory=dict)
    gains_source: str = ""
    firmware: str = ""
    gyro_noise_rad_s: float | None = None
    hover_throttle: float | None = None
    own: "OwnVehicle | None" = None
    remarks: "tuple[Finding, ...]" = ()
    fit: "FitSettings" = field(default_factory=_usual_fit)

    def __post_init__(self) -> None:
        if not self.kinds or len(set(self.kinds)) < len(self.kinds):
            raise UsageError(
                f"the kinds of test input are {', '.join(self.kinds) or 'missing'}", needed="at least one, each once"
            )
        self._set(
            kinds=tuple(self.kinds), models=tuple(self.models), reach=self.reach, changes=self.changes, gains=self.gains
        )
        self._set(inputs=tuple(self.inputs), outputs=tuple(self.outputs))

    @property
    def entry(self) -> "VehicleEntry":
        """The library entry of the vehicle."""
        from rotorid.vehicles.catalog import entry_of

        return entry_of(self.vehicle)

    @property
    def aircraft(self) -> "Aircraft":
        """The vehicle, with a pilot who brings it back."""
        from rotorid.simulation.multirotor_flight import piloted

        # What is sent to a vehicle behind set-points is the test input alone, and nobody leans against drift.
        return self.craft if self.entry.interface is not None else piloted(self.craft)

    @property
    def vehicle_changed(self) -> bool:
        """Whether the vehicle has no name: it was changed, or has gains, noise or rotors of a log or result.

        One behind set-points has no gains, and no file can hold it.
        """
        taken = self.own, self.gyro_noise_rad_s, self.hover_throttle
        other = bool(self.changes or self.gains_source) or any(item is not None for item in taken)
        return other and self.entry.interface is None

    @property
    def craft(self) -> "Aircraft":
        """Body, autopilot and sensors, with all changes."""
        from rotorid.flying.user_vehicles import hovering_at
        from rotorid.simulation.multirotor_flight import changed
        from rotorid.vehicles.px4 import with_gains

        craft = changed(self.entry.aircraft, self.changes)
        if self.gains_source:
            craft = with_gains(craft, self.gains, source=self.gains_source)
        if self.gyro_noise_rad_s is not None:
            craft = replace(craft, sensors=replace(craft.sensors, gyro_noise_rad_s=self.gyro_noise_rad_s))
        if self.hover_throttle is not None:
            own = self.own
            craft = hovering_at(
                craft,
                self.hover_throttle,
                answers=own.answers if own is not None else (),
                slope_known=own is not None and own.has_thrust_slope,
            )
        return craft

    @property
    def earlier(self) -> "Prior | None":
        """The result that the predictions begin from: that of ``--prior``, or a response among those of the vehicle."""
        from rotorid.planning.prior import Prior
        from rotorid.planning.responses import answers_setpoints

        if self.prior is not None or self.own is None:
            return self.prior
        for result in self.own.joined.models:
            if result.motors is None and answers_setpoints(result.structure):
                bounds = result.bounds
                return Prior(
                    structure=result.structure,
                    values={name: parameter.value for name, parameter in result.parameters.items()},
                    source=result.name,
                    std_model=dict(zip(bounds.names, bounds.model_std.tolist(), strict=True)),
                )
        return None

    @property
    def model_names(self) -> tuple[str, ...]:
        """The models in force."""
        from rotorid.models.families import RATE_AXIS

        if self.models:
            return self.models
        if self.earlier is not None:
            return (self.earlier.structure.name,)
        if self.entry.interface is not None:
            return (BEHIND_SETPOINTS,)
        return tuple(name for name, axis in RATE_AXIS.items() if axis in self.plan.axes)


@dataclass(frozen=True, kw_only=True)
class SimulateSettings(Immutable):
    """Choices of ``simulate``.

    Parameters
    ----------
    vehicle
        Name in the library, or a vehicle of one's own.
    plan
        Test inputs; without any, nothing is excited.
    duration_s
        Length of the log; that of the plan when none is given.
    wind
        Steady part and turbulence.
    changes
        Numbers of the vehicle that are to be otherwise, see :func:`rotorid.simulation.multirotor_flight.changed`.
    vary
        Numbers drawn anew for every run, from a normal distribution with this standard deviation in percent.
    runs
        Flights; of several, each has a seed of its own, which follows from ``seed`` and stands in the document.
    format
        Of the logs; by default the autopilot's own.
    stick
        Largest deflection of the sticks in an everyday flight.
    speed_m_s
        Over ground, forward, at the beginning and at the end of the log; straight in between.
    tested
        Range that results of the vehicle were identified on, rotors by shares of full speed; ``None`` where none says.
    seed
        Of wind, noise and what is drawn.
    """

    vehicle: "Vehicle"
    plan: "FlightPlan | None" = None
    duration_s: Annotated[
        float | None, Option("--duration", "Length of the flight in s. [default: that of the plan]", "Flight")
    ] = None
    wind: "Wind" = field(default_factory=_calm)
    changes: Changes = field(default_factory=dict)
    vary: Annotated[
        Mapping[str, float],
        Option(
            "--vary",
            "Draw a number of --set for every run, with this standard deviation in percent. Repeatable.",
            "Flight",
            Text("NAME=PERCENT", partial(parse_percents, option="--vary"), repeats=True),
        ),
    ] = field(default_factory=dict)
    runs: Annotated[int, Option("--runs", "Number of flights, each with its own wind, noise and draws.", "Flight")] = 1
    format: Annotated[
        "LogFormat | None",
        Option(
            "--format",
            "Format of the log. [default: that of the vehicle's autopilot]",
            "Flight",
            words=get_args(LogFormat),
        ),
    ] = None
    stick: Annotated[
        float, Option("--stick", "Largest deflection with --plan everyday; 1 is full stick.", "Flight")
    ] = 0.5
    speed_m_s: Annotated[
        tuple[float, float],
        Option("--speed", "Forward speed in m/s; with two, from the first to the last over the log.", "Flight", SPEED),
    ] = (0.0, 0.0)
    tested: "FlightRange | None" = None
    seed: Seed = 0

    def __post_init__(self) -> None:
        from rotorid.data.flight_plan import LONGEST_S
        from rotorid.simulation.wind import Wind

        require_seed(self.seed)
        if not isinstance(self.wind, Wind):
            raise UsageError(f"wind={self.wind!r} is no Wind", needed="rotorid.Wind(north_m_s=3.0), for instance")
        if self.duration_s is not None and not 0.0 < self.duration_s <= LONGEST_S:
            raise UsageError(
                f"--duration {self.duration_s:g} is out of range", needed=f"more than 0 s, at most {LONGEST_S:g} s"
            )
        if not 1 <= self.runs <= _MOST_RUNS:
            raise UsageError(f"--runs {self.runs} is out of range", needed=f"1 to {_MOST_RUNS}")
        if self.format is not None and self.format not in get_args(LogFormat):
            raise UsageError(f"unknown log format {self.format!r}", needed=f"one of {', '.join(get_args(LogFormat))}")
        if not all(abs(speed) <= _FASTEST_M_S for speed in self.speed_m_s):
            raise UsageError(
                f"--speed {max(self.speed_m_s, key=abs):g} is out of range", needed=f"at most {_FASTEST_M_S:g} m/s"
            )
        if not 0.0 < self.stick <= 1.0:
            raise UsageError(f"--stick {self.stick:g} is out of range", needed="more than 0, at most 1 (full stick)")
        if wrong := [name for name, percent in self.vary.items() if not 0.0 < percent < 100.0]:
            raise UsageError(
                f"--vary {wrong[0]}={self.vary[wrong[0]]:g} is out of range", needed="more than 0 %, less than 100 %"
            )
        self._set(changes=self.changes, vary=self.vary)
        if self.entry.make is not None and self.log_format == "bbl":
            self._require_betaflight()

    def _require_betaflight(self) -> None:
        """Refuse a Betaflight log of a vehicle that Betaflight does not fly: rotors are known by their order."""
        from rotorid.models.rotors import library_layout

        craft = self.entry.aircraft
        turned = craft.autopilot.parameters.get("yaw_motors_reversed") == 1.0
        wanted = library_layout("quad.x.betaflight.reversed" if turned else "quad.x.betaflight")
        rotors = craft.vehicle.rotors.layout
        alike = rotors.rotors == wanted.rotors and bool(
            (rotors.positions[:, :2] * wanted.positions[:, :2] > 0.0).all() and (rotors.spins == wanted.spins).all()
        )
        if named(craft.autopilot.kind).log_format != self.log_format or not alike:
            raise UsageError(
                f"{self.entry.name} cannot write a Betaflight log: it flies {craft.autopilot.kind} with "
                f"{rotors.rotors} rotors{'' if alike else ' in another order'}",
                needed="Betaflight's controllers and four rotors in its order: rear right, front right, rear left, "
                "front left",
                remedy="use --format csv, or the autopilot's own format",
            )

    @property
    def entry(self) -> "VehicleEntry":
        """The library entry of the vehicle."""
        from rotorid.vehicles.catalog import entry_of

        return entry_of(self.vehicle)

    @property
    def aircraft(self) -> "Aircraft":
        """The vehicle, before anything is drawn."""
        from rotorid.simulation.multirotor_flight import changed, piloted

        craft = changed(self.entry.aircraft, self.changes)
        sent = self.plan is not None and any(planned.entry == "attitude_setpoint" for planned in self.plan.inputs)
        return craft if self.entry.interface is not None and sent else piloted(craft)

    @property
    def log_format(self) -> "LogFormat":
        """The format in force."""
        return self.format or named(self.aircraft.autopilot.kind).log_format

    @property
    def file_names(self) -> tuple[str, ...]:
        """Names of the logs."""
        from rotorid.io.formats import WRITERS

        ending = WRITERS[self.log_format].ending
        if self.runs == 1:
            return (f"flight.{ending}",)
        digits = len(str(self.runs))
        return tuple(f"flight_{number:0{digits}d}.{ending}" for number in range(1, self.runs + 1))


@dataclass(frozen=True, kw_only=True)
class StitchSettings(Immutable):
    """Choices of one run of ``stitch``.

    Parameters
    ----------
    controllers
        Gains of those that the logs do not hold.
    seed
        Of the draws behind the spread of a flight.

    Raises
    ------
    UsageError
        The seed is negative.
    """

    controllers: Annotated[
        "Mapping[Axis, GivenController]",
        Option("--controller", "TOML file with gains that the log does not hold.", text=CONTROLLERS),
    ] = field(default_factory=dict)
    seed: Annotated[int, Option("--seed", "Of the draws behind the spread of a flight.")] = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)
        self._set(controllers=self.controllers)
