"""A vehicle flies, and its log is written as its autopilot would have; the rig moves on its pivot.

What comes back says what flew, what was true of it (the derivatives of the exact linear model about hover, in still
air), what each flight reached, and where the maneuvers are on the clock of the logs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from rotorid.checking.flight import range_findings
from rotorid.data.axes import ATTITUDE
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn, worst_first
from rotorid.data.flight_plan import FlightPlan, PlannedInput, SimulatedFlight
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.excitation.sticks import everyday_stick
from rotorid.fitting.flight.fit import FlightRange
from rotorid.flying.settings import SimulateSettings
from rotorid.flying.vehicle_answers import logged_late_s
from rotorid.frames import quaternion_from_euler
from rotorid.io.files import sha256_of
from rotorid.io.formats import WRITERS
from rotorid.io.registry import write_log
from rotorid.io.tables.csv import write_csv
from rotorid.models.input_units import in_logged_units
from rotorid.models.library import library_model
from rotorid.planning.amplitude import Reached, reached
from rotorid.results.provenance import LoggedManeuver, Provenance
from rotorid.settings.option import as_settings, require_seed
from rotorid.simulation.linearization import hover_derivatives_of
from rotorid.simulation.multirotor import Rotors
from rotorid.simulation.multirotor_flight import Aircraft, changed, fly_multirotor, number_of, seed_of
from rotorid.typing import Axis
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles import rig
from rotorid.vehicles.catalog import RIG, VEHICLES, Vehicle, VehicleEntry
from rotorid.verification.flight import outside, percents
from rotorid.verification.multistep import to_body

if TYPE_CHECKING:
    from typing import Unpack

    from rotorid.flying.bench_designs import BenchSettings
    from rotorid.settings.option_types import SimulateOptions

_NOTICED = 1e-9
_SEED_BITS_LEFT_OUT = 80
_MODELS = ("hover.full", "hover.longitudinal", "hover.lateral")


@dataclass(frozen=True, kw_only=True)
class TrueValue(Immutable):
    """A number of the vehicle that flew, by the name that an identification would give it."""

    value: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class FlownVehicle(Immutable):
    """A vehicle; ``changed`` holds what the user set otherwise than its source has it."""

    name: str
    description: str
    source: str
    autopilot: str
    control_rate_hz: float | None = None
    changed: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._set(changed=self.changed)


@dataclass(frozen=True, kw_only=True)
class SimulatedLog(Immutable):
    """A log that was written: its seed, the numbers drawn for it (``changed``), and what the flight reached."""

    file: str
    format: str
    sha256: str
    seed: int
    duration_s: float
    changed: Mapping[str, float] = field(default_factory=dict)
    reached: Reached | None = None
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(changed=self.changed, findings=tuple(self.findings))


@dataclass(frozen=True, kw_only=True)
class Simulation(Immutable):
    """The vehicle, its true values, and the logs.

    Parameters
    ----------
    logs
        What was written.
    maneuvers
        On the clock of the logs.
    truth
        Parameter to its true value.
    findings
        Remarks, the grave ones first.
    """

    vehicle: FlownVehicle
    logs: tuple[SimulatedLog, ...]
    maneuvers: tuple[LoggedManeuver, ...]
    truth: Mapping[str, TrueValue]
    provenance: Provenance
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(truth=self.truth)


@dataclass(frozen=True, kw_only=True, eq=False)
class Run(Immutable):
    """One flight: its seed, the numbers drawn for it, and its result."""

    seed: int
    drawn: Mapping[str, float]
    flown: SimulatedFlight


def simulate(vehicle: Vehicle, plan: FlightPlan | None = None, **options: Unpack[SimulateOptions]) -> SimulatedFlight:
    """Fly a vehicle under its autopilot; :func:`rotorid.write_log` makes a log of the flight.

    Parameters
    ----------
    vehicle
        Its name, see :func:`rotorid.vehicles.aircraft_names`, or a vehicle of one's own.
    plan
        What to fly; without one the vehicle hovers for ``duration_s``.
    **options
        Fields of :class:`rotorid.flying.settings.SimulateSettings`: ``wind``, ``seed``, ``duration_s``,
        ``speed_m_s``, ``changes``.

    Raises
    ------
    TypeError
        There is no such option.
    UsageError, ModelError
        A choice is wrong, or the library has no such vehicle.
    LostError
        The flight was lost.

    Examples
    --------
    >>> flight = simulate("x500", duration_s=0.1)  # doctest: +SKIP
    >>> flight.columns["p"].size  # doctest: +SKIP
    100
    """
    chosen: dict[str, Any] = {"vehicle": vehicle, "plan": plan, **options}
    return fly_run(as_settings(SimulateSettings, None, chosen), 0).flown


def fly_run(choices: SimulateSettings, number: int) -> Run:
    """Fly one of the runs, counted from zero; alone with the seed that its log names, it is the same.

    Parameters
    ----------
    choices
        Settings of all runs.
    number
        Which run.
    """
    # Short enough for a number in JSON to be exact.
    seed = choices.seed if choices.runs == 1 else seed_of(choices.seed, number) >> _SEED_BITS_LEFT_OUT
    drawn = _drawn(choices, seed)
    craft = changed(choices.aircraft, drawn)
    flown = fly_multirotor(
        craft,
        choices.plan,
        duration_s=choices.duration_s,
        wind=choices.wind,
        seed=seed,
        speed_m_s=choices.speed_m_s,
    )
    return Run(seed=seed, drawn=drawn, flown=flown)


EVERYDAY_S = 120.0
"""Length of an everyday flight when none is asked for."""

_SHARE_OF_STICK: Mapping[Axis, float] = MappingProxyType({"roll": 1.0, "pitch": 1.0, "yaw": 0.5, "thrust": 0.3})


def everyday_plan(craft: Aircraft, *, duration_s: float = EVERYDAY_S, level: float = 0.5, seed: int = 0) -> FlightPlan:
    """Sticks of an ordinary flight, without maneuvers.

    Parameters
    ----------
    craft
        What flies; its autopilot's turns are those of the sticks.
    level
        Largest deflection of roll and pitch; half of it is yaw's, less the throttle's.
    seed
        Of what the pilot does.

    Raises
    ------
    UsageError
        The level is not above zero and up to one.

    Examples
    --------
    >>> from rotorid.vehicles import aircraft
    >>> plan = everyday_plan(aircraft("x500"), duration_s=20.0)
    >>> plan.axes, plan.maneuvers, round(plan.duration_s, 3)
    (('roll', 'pitch', 'yaw', 'thrust'), (), 20.0)
    """
    rate_hz = craft.autopilot.rate_hz
    inputs = []
    for place, (axis, share) in enumerate(_SHARE_OF_STICK.items()):
        values = everyday_stick(
            level=share * level,
            duration_s=duration_s,
            sample_rate_hz=rate_hz,
            rng=np.random.default_rng([seed, 3, place]),
        )
        inputs.append(
            PlannedInput(
                axis=axis,
                shape="sticks",
                start_s=0.0,
                values=values,
                sample_rate_hz=rate_hz,
                amplitude=float(share * level),
                entry="stick",
                settings={"seed": float(seed)},
            )
        )
    return FlightPlan(name="everyday", inputs=tuple(inputs), trim_s=0.0)


def write_run(path: Path, run: Run, choices: SimulateSettings) -> SimulatedLog:
    """Write the log of a run and describe it.

    Parameters
    ----------
    path
        File of the log; the settings choose its format.
    run
        What was flown.
    choices
        Settings that it was flown with, its autopilot among them.
    """
    shown = choices.entry.shown
    written = run.flown if shown is None else shown(run.flown, np.random.default_rng([run.seed, 2]))
    write_log(path, written, format=choices.log_format)
    return SimulatedLog(
        file=path.name,
        format=choices.log_format,
        sha256=sha256_of(path),
        seed=run.seed,
        duration_s=run.flown.samples / run.flown.sample_rate_hz,
        changed=run.drawn,
        reached=reached(run.flown),
        findings=tuple(beyond_tested(path.name, run.flown, choices.tested, choices.aircraft.vehicle.rotors)),
    )


def beyond_tested(name: str, flown: SimulatedFlight, tested: FlightRange | None, rotors: Rotors) -> list[Finding]:
    """Whether a flight leaves the range that its vehicle was identified on.

    Parameters
    ----------
    name
        Of the flight.
    flown
        What flew.
    tested
        The range, rotors by shares of their full speed; ``None`` where nobody knows.
    rotors
        Of the vehicle.
    """
    if tested is None:
        return []
    truth = flown.truth
    angles = np.stack([truth[name] for name in ATTITUDE])
    over_earth = [truth[f"velocity_{axis}"] - truth[f"wind_{axis}"] for axis in ("north", "east", "down")]
    speeds = [
        truth[f"motor_speed_{number + 1}"] for number in range(sum(key.startswith("motor_speed") for key in truth))
    ]
    share, each = percents(
        [
            outside(
                tested,
                velocity=to_body(quaternion_from_euler(angles), np.stack(over_earth)),
                speeds=rotors.speed_shares(np.stack(speeds)),
                load=-truth["az"] / STANDARD_GRAVITY_M_S2,
            )
        ]
    )
    return range_findings(name, share, each)


def simulation_of(
    choices: SimulateSettings, logs: Sequence[SimulatedLog], *, command: Sequence[str] = ()
) -> Simulation:
    """The vehicle, its true values, and where the logs are."""
    craft = choices.aircraft
    start_s = WRITERS[choices.log_format].start_s
    planned = () if choices.plan is None else choices.plan.maneuvers
    return Simulation(
        vehicle=flown_vehicle(choices.entry, craft, choices.changes),
        logs=tuple(logs),
        maneuvers=tuple(_on_log(maneuver, start_s, logs[0].file) for maneuver in planned),
        truth=truth_of(craft, choices.speed_m_s),
        findings=worst_first(_findings(logs)),
        provenance=Provenance(
            command=tuple(command),
            settings={
                "wind_north_m_s": choices.wind.north_m_s,
                "wind_east_m_s": choices.wind.east_m_s,
                "turbulence_m_s": choices.wind.turbulence_m_s,
                "height_m": choices.wind.height_m,
                **({"speed_m_s": list(choices.speed_m_s)} if any(choices.speed_m_s) else {}),
                "runs": choices.runs,
                **{f"vary_{name}_percent": percent for name, percent in choices.vary.items()},
            },
            seed=choices.seed,
        ),
    )


def truth_of(craft: Aircraft, speed_m_s: tuple[float, float] = (0.0, 0.0)) -> dict[str, TrueValue]:
    """Derivatives, lag and delays of an aircraft about hover in still air, by the names of the hover models.

    About level flight where it flew at one speed; without derivatives where the speed changed.

    A delay is what the log shows: that of the path, half a tick, for which commands are held on average, and what
    stands between the motion and its channel, see :func:`~rotorid.flying.vehicle_answers.logged_late_s`. Rotors
    without lag push at once: the accelerometer shows their thrust at the first tick after the delay of the path.
    """
    first, last = speed_m_s
    derivatives = hover_derivatives_of(craft.vehicle, craft.autopilot, airspeed_m_s=first) if first == last else {}
    units = {parameter.name: parameter.unit for model in _MODELS for parameter in library_model(model).parameters}
    hold_s = 0.5 / craft.autopilot.rate_hz
    delays = dict(zip(("roll", "pitch", "yaw", "thrust"), craft.autopilot.delay_s, strict=True))
    values = derivatives | {f"tau_{axis}": delay_s + hold_s for axis, delay_s in delays.items()}
    if not craft.vehicle.rotors.lag_up_s:
        rate_hz = craft.autopilot.rate_hz
        values["tau_thrust"] = (math.floor(delays["thrust"] * rate_hz + _NOTICED) + 1) / rate_hz
    values |= {f"tau_{axis}": values[f"tau_{axis}"] + logged_late_s(craft, axis) for axis in delays}
    # A rotor that speeds up and slows down with different lags shows the mean of the two.
    values["T_motor"] = craft.vehicle.rotors.mean_lag_s
    return {name: TrueValue(value=_clean(values[name]), unit=unit) for name, unit in units.items() if name in values}


def _clean(value: float) -> float:
    return 0.0 if abs(value) < _NOTICED else value


def flown_vehicle(known: VehicleEntry, craft: Aircraft, changes: Mapping[str, float]) -> FlownVehicle:
    """A vehicle with the numbers that were set otherwise."""
    return FlownVehicle(
        name=known.name,
        description=known.summary,
        source=known.source,
        autopilot=craft.autopilot.kind,
        control_rate_hz=craft.autopilot.rate_hz,
        changed=changes,
    )


def _drawn(choices: SimulateSettings, seed: int) -> dict[str, float]:
    """Numbers of a run: normal about what they are, cut at three deviations."""
    rng = np.random.default_rng([seed, 1])
    base = choices.aircraft
    spread = {name: float(np.clip(rng.standard_normal(), -3.0, 3.0)) for name in choices.vary}
    return {
        name: number_of(base, name) * (1.0 + 0.01 * percent * spread[name]) for name, percent in choices.vary.items()
    }


def _on_log(maneuver: Maneuver, start_s: float, file: str) -> LoggedManeuver:
    later = replace(maneuver, start_s=maneuver.start_s + start_s, stop_s=maneuver.stop_s + start_s)
    return LoggedManeuver(record=file, **asdict(later))


def _findings(logs: Sequence[SimulatedLog]) -> list[Finding]:
    saturated = [
        warn(
            "saturation",
            log.file,
            f"The motors could not do what was asked of them during {100.0 * log.reached.saturated:.1f} % of "
            f"{log.file}: their outputs went from {log.reached.motor_low:.2f} to {log.reached.motor_high:.2f}.",
            share=log.reached.saturated,
        )
        for log in logs
        if log.reached is not None and log.reached.saturated > 0.0
    ]
    return saturated + [finding for log in logs for finding in log.findings]


SWEPT = ("motor_3", "motor_4")
LOG_NAME = "flight.csv"


def move_rig(seed: int, plan: FlightPlan | None = None, *, settings: BenchSettings | None = None) -> FlightRecord:
    """A record of a rig that flies a plan; without one, of 120 s in which the motors of roll are swept.

    Parameters
    ----------
    settings
        Whose rig; that of the library without any.
    """
    require_seed(seed)
    if plan is None and settings is None:
        return rig.fly(SWEPT, np.random.default_rng(seed))
    from rotorid.flying.bench_designs import BenchSettings, flown_on_rig, usual_sweep

    chosen = settings or BenchSettings()
    return flown_on_rig(plan or usual_sweep(chosen), seed, settings=chosen)


def write_rig(path: Path, record: FlightRecord) -> None:
    """Write the record as CSV: motors and what was added to them, angles and rates."""
    topic = record.topics[0]
    columns = {channel.name: topic.values[row] for row, channel in enumerate(topic.channels)}
    write_csv(path, topic.time_s, columns, {channel.name: channel.unit for channel in topic.channels})


def rig_simulation(
    record: FlightRecord,
    path: Path,
    *,
    seed: int,
    command: Sequence[str] = (),
    plan: FlightPlan | None = None,
    settings: BenchSettings | None = None,
) -> Simulation:
    """A rig, its true values, and where the log is."""
    topic, known = record.topics[0], VEHICLES[RIG]
    whole = {maneuver.axis for maneuver in record.declared} == {"roll"}
    structure = library_model("rig.roll" if whole else "rig.attitude")
    truth: Mapping[str, float] = rig.ATTITUDE
    description, source = known.summary, known.source
    if settings is not None:
        structure, truth = in_logged_units(structure, [record]), settings.system_values
        if settings.prior is not None:
            source = settings.prior.source
            description = f"identified: {settings.prior.structure.name}; the rest is that of the rig"
    swept = list(dict.fromkeys(part.motor for part in plan.inputs)) if plan is not None else list(SWEPT)
    return Simulation(
        vehicle=FlownVehicle(
            name=RIG,
            description=description,
            source=source,
            autopilot="simple",
            changed={} if settings is None else settings.changes,
        ),
        logs=(
            SimulatedLog(
                file=path.name,
                format="csv",
                sha256=sha256_of(path),
                seed=seed,
                duration_s=float(topic.time_s[-1] - topic.time_s[0]),
            ),
        ),
        maneuvers=tuple(LoggedManeuver(record=path.name, **asdict(maneuver)) for maneuver in record.declared),
        truth={
            parameter.name: TrueValue(value=truth[parameter.name], unit=parameter.unit)
            for parameter in structure.parameters
            if parameter.name in truth
        },
        provenance=Provenance(command=tuple(command), settings={"swept": swept}, seed=seed),
    )
