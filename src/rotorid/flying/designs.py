"""Plans for a vehicle, each test input as large as limits allow, with the errors of parameters that it will give.

Amplitudes are searched for in the nonlinear simulator, one axis after the other and then the whole plan. Predicted
errors follow from the linear loop about hover. The expected values of the vehicle come from its library entry, or from
a previous result.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from rotorid.autopilots.registry import named
from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.data.findings import Finding, warn
from rotorid.data.flight_plan import Entry, FlightPlan, PlannedInput, Shape, input_unit
from rotorid.data.record import AXES
from rotorid.errors import InsufficientDataError, ModelError, UsageError, reason_of
from rotorid.excitation.plan import planned, sequence, together, uncorrelated_binaries
from rotorid.flying.rehearsals import Rehearsal, failed_rehearsals, rehearsed
from rotorid.flying.settings import DOUBLET_S, DesignSettings, PlanSettings
from rotorid.flying.simulation import truth_of
from rotorid.flying.vehicle_answers import logged_late_s
from rotorid.identifying.scope import INERTIAL
from rotorid.io.registry import log_rate_hz
from rotorid.models.families import family_of, named_model
from rotorid.models.structure import LinearStructure
from rotorid.planning.aircraft import aircraft_loop
from rotorid.planning.amplitude import (
    Amplitude,
    Limits,
    Reached,
    common_amplitude,
    limit_words,
    reached,
    usual_reached,
)
from rotorid.planning.duration import Shortest, shortest
from rotorid.planning.expected import FitSettings
from rotorid.planning.loop import LoopModel
from rotorid.planning.prediction import Prediction, predict
from rotorid.planning.prior import Prior, with_prior
from rotorid.planning.responses import (
    SETPOINTS,
    answers_setpoints,
    predict_responses,
    setpoint_loop,
    setpoint_of,
    with_known,
)
from rotorid.simulation.multirotor_flight import Aircraft, fly_multirotor
from rotorid.simulation.shaping import shaped_plan
from rotorid.typing import Axis
from rotorid.units import require_units

_PROGRESS = logging.getLogger("rotorid.progress")


_SHORTEST_LAG_S = 0.005
"""Where a fit of a motor without lag begins; it drops the lag where the data have none."""


def expected_values(model: LinearStructure, craft: Aircraft, prior: Prior | None = None) -> dict[str, float]:
    """Values of the free parameters of a model: those of the previous result, else those of the aircraft.

    Parameters
    ----------
    model
        Structure whose parameters are looked for.
    craft
        The aircraft that will fly.
    prior
        A previous result, which goes first.

    Raises
    ------
    ModelError
        Neither knows a parameter.
    """
    known = {name: true.value for name, true in truth_of(craft).items()}
    known["T_motor"] = max(known["T_motor"], _SHORTEST_LAG_S)
    # Of models of an axis: height of the accelerometer, and what it is later than the gyroscope.
    known["z_imu"] = -craft.sensors.accelerometer_place_m[2]
    for axis, name in (("pitch", "tau_ax"), ("roll", "tau_ay")):
        known[name] = max(logged_late_s(craft, "thrust") - logged_late_s(craft, axis), 0.0)
    known |= dict(prior.values) if prior is not None else {}
    if missing := [name for name in model.parameters.free if name not in known]:
        raise ModelError(
            f"{craft.name} has no value of {', '.join(missing)}, which {model.name} needs",
            needed="rate.*, axis.* or hover.*",
            remedy="or give the result of an earlier flight with --prior",
        )
    return {name: _inside(model, name, known[name]) for name in model.parameters.free}


def _inside(model: LinearStructure, name: str, value: float) -> float:
    parameter = model.parameters[name]
    return float(np.clip(value, parameter.lower, parameter.upper))


STEPS: tuple[Shape, ...] = ("doublet", "two_one_one", "three_two_one_one")
"""Shapes whose duration is their band."""

_SAMPLE_RATE_HZ = 250.0
_LONGEST_LOOK_S = 400.0
_MARGIN = 0.9

_LARGEST: Mapping[Entry, float] = MappingProxyType(
    {"command": 1.0, "stick": 1.0, "attitude_setpoint": 1.2, "rate_setpoint": 20.0}
)
"""No test input is larger, in the unit of where it is added."""

_REST_S = 4.0
"""Between inputs: as long as an identification wants to look before and after one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Planned(Immutable):
    """A plan with how large its inputs are and why.

    Parameters
    ----------
    amplitudes
        What was found for each shape and axis whose amplitude was searched for.
    reached
        What the whole plan reaches in three of four flights in the simulator.
    """

    plan: FlightPlan
    amplitudes: Mapping[str, Amplitude]
    reached: Reached

    def limited_by(self, part: PlannedInput) -> str:
        """The limit that a larger input would pass; empty where its amplitude was given."""
        found = self.amplitudes.get(f"{part.shape} of {part.axis}")
        return found.limited_by if found is not None else ""


def default_entry(aircraft: Aircraft, axis: Axis) -> Entry:
    """Where a user of this autopilot can add a test input without hands.

    Where that are attitudes, thrust is added to what the mixer receives.
    """
    entry = named(aircraft.autopilot.kind).entry
    return entry if axis != "thrust" or entry == "stick" else "command"


def by_hand(aircraft: Aircraft, axis: Axis) -> Entry:
    """Where steps are added: what no script flies, a pilot does by the stick."""
    return named(aircraft.autopilot.kind).step_entry or default_entry(aircraft, axis)


def sweep_of(aircraft: Aircraft) -> Shape:
    """The sweep that an autopilot can fly by itself."""
    return named(aircraft.autopilot.kind).sweep


def plan_for(aircraft: Aircraft, choices: PlanSettings, *, name: str = "") -> Planned:
    """A plan whose inputs are as large as the limits allow, with a tenth to spare.

    Each axis is tried alone in the simulator, in several draws of noise and gusts, three of four of which keep the
    limits; roll and pitch that are alike share one amplitude. Then the whole plan is flown, and where inputs at the
    same time pass a limit together, all are made smaller by the same factor.

    Parameters
    ----------
    aircraft
        What will fly.
    choices
        What is to be flown.
    name
        Of the plan.
    """
    if choices.shape == "multisine":
        _common_entry(aircraft, choices)
    entries = {axis: _entry(aircraft, choices, axis, choices.shape) for axis in choices.axes}
    require_units(choices.amplitudes, {axis: input_unit(axis, entries[axis]) for axis in entries}, option="--amplitude")
    found: dict[str, Amplitude] = {}
    sizes = dict(choices.amplitudes)
    groups = equal_axes(aircraft, [axis for axis in choices.axes if axis not in sizes])
    for group in groups:
        sizes |= _searched(aircraft, choices, group, choices.shape, choices.length_s, found)
    doublets = dict(sizes)
    if choices.doublets and choices.shape not in STEPS:
        for group in equal_axes(aircraft, choices.axes):
            doublets |= _searched(aircraft, choices, group, "doublet", _doublet_s(choices), found)
    plan = plan_with(aircraft, choices, sizes, doublets=doublets, name=name)
    _PROGRESS.info("flying the whole plan")
    plan = _together(aircraft, plan, choices)
    flights = [fly_multirotor(aircraft, plan, wind=choices.wind, seed=seed) for seed in _seeds(aircraft, choices)]
    return Planned(plan=plan, amplitudes=found, reached=usual_reached([reached(flight) for flight in flights]))


_ALIKE = 0.02
"""Roll and pitch that answer alike within it are one axis with one amplitude."""

_LOOK_RAD_S = np.geomspace(1.0, 100.0, 30)


def equal_axes(aircraft: Aircraft, axes: Sequence[Axis]) -> tuple[tuple[Axis, ...], ...]:
    """Axes in groups that share one amplitude: roll and pitch where vehicle and gains are the same on both.

    Examples
    --------
    >>> from rotorid.vehicles.catalog import aircraft
    >>> equal_axes(aircraft("ardupilot_quad"), ("roll", "pitch", "yaw"))
    (('roll', 'pitch'), ('yaw',))
    """
    level: tuple[Axis, ...] = ("roll", "pitch")
    if not set(level) <= set(axes):
        return tuple((axis,) for axis in axes)
    closed = aircraft_loop(aircraft).at(_LOOK_RAD_S)
    # The loop that is closed, and what it does to the rate, with the signs of neither.
    answers = [
        np.abs([closed.excited[u, u], closed.plant[u, u] * closed.excited[u, u]])
        for u in (AXES.index(axis) for axis in level)
    ]
    if np.abs(np.log(answers[0] / answers[1])).max() > _ALIKE:
        return tuple((axis,) for axis in axes)
    return (level, *((axis,) for axis in axes if axis not in level))


_GUSTY_FLIGHTS, _NOISY_FLIGHTS = 8, 4
"""Draws of gusts that an amplitude is looked for with, and draws of noise alone, which move it less."""


def _seeds(aircraft: Aircraft, choices: PlanSettings) -> range:
    """Seeds of the draws; one where nothing that is drawn reaches the motors."""
    sensors = aircraft.sensors
    noisy = sensors.gyro_noise_rad_s or sensors.attitude_noise_rad or sensors.velocity_noise_m_s
    count = _GUSTY_FLIGHTS if choices.wind.turbulence_m_s else _NOISY_FLIGHTS if noisy else 1
    return range(choices.seed, choices.seed + count)


def _searched(
    aircraft: Aircraft,
    choices: PlanSettings,
    group: Sequence[Axis],
    shape: Shape,
    duration_s: float,
    found: dict[str, Amplitude],
) -> dict[str, float]:
    """The amplitude that axes share, as a person would set it; what was found goes into ``found``."""
    _PROGRESS.info(f"looking for the largest {shape.replace('_', ' ')} of {' and '.join(group)}")
    common = _largest(aircraft, choices, group, shape, duration_s)
    found |= {f"{shape} of {axis}": common for axis in group}
    return dict.fromkeys(group, _rounded(_MARGIN * common.value))


def _together(aircraft: Aircraft, plan: FlightPlan, choices: PlanSettings) -> FlightPlan:
    """The whole plan, its inputs smaller by one factor where together they would pass a limit."""
    if choices.amplitudes.keys() >= set(choices.axes):
        return plan
    whole = common_amplitude(
        aircraft,
        [lambda factor: _all_scaled(plan, factor)],
        choices.limits,
        start=1.0,
        wind=choices.wind,
        seeds=_seeds(aircraft, choices),
    )
    if whole.value >= 1.0:
        return plan
    rounded = [_rounded(whole.value * abs(planned.amplitude)) / abs(planned.amplitude) for planned in plan.inputs]
    return replace(plan, inputs=tuple(_scaled(*pair) for pair in zip(plan.inputs, rounded, strict=True)))


def _largest(
    aircraft: Aircraft, choices: PlanSettings, group: Sequence[Axis], shape: Shape, duration_s: float
) -> Amplitude:
    """Largest amplitude of axes that share it, each on its own."""
    length_s = min(duration_s, _LONGEST_LOOK_S)

    # Made once: the phases of a multisine take longer to find than a flight.
    units = [_input(aircraft, choices, axis, shape, length_s, 1.0, repeat=0) for axis in group]

    def single_axis_plan(unit: PlannedInput) -> Callable[[float], FlightPlan]:
        name = f"{shape} of {unit.axis}"
        return lambda amplitude: FlightPlan(name=name, inputs=(_scaled(unit, amplitude),), trim_s=2.0)

    interface = choices.interface
    largest = [_LARGEST[unit.entry] if interface is None else interface.largest[unit.axis] / _MARGIN for unit in units]
    return common_amplitude(
        aircraft,
        [single_axis_plan(unit) for unit in units],
        choices.limits,
        largest=min(largest),
        wind=choices.wind,
        seeds=_seeds(aircraft, choices),
    )


def _all_scaled(plan: FlightPlan, factor: float) -> FlightPlan:
    return replace(plan, inputs=tuple(_scaled(planned, factor) for planned in plan.inputs))


def plan_with(
    aircraft: Aircraft,
    choices: PlanSettings,
    sizes: Mapping[str, float],
    *,
    doublets: Mapping[str, float] | None = None,
    name: str = "",
) -> FlightPlan:
    """A plan with given amplitudes by axis; those of its doublets are given separately.

    Parameters
    ----------
    aircraft
        Which flies the plan.
    choices
        Settings of the plan.
    sizes
        Axis to the amplitude of its excitation.
    doublets
        The same for its doublets; as large as ``sizes`` without it.
    name
        Of the plan.
    """
    parts: list[PlannedInput | Sequence[PlannedInput]] = []
    if choices.shape == "random_binary" and choices.together and len(choices.axes) > 1:
        parts += [_binaries(aircraft, choices, sizes, repeat=repeat) for repeat in range(choices.repeats)]
    elif choices.shape == "multisine":
        # Periods in a row are one input: their joints are smooth, and only the first holds a transient.
        parts.append(
            together(
                {axis: sizes[axis] for axis in choices.axes},
                start_s=0.0,
                band_rad_s=choices.band_rad_s,
                period_s=choices.length_s / (choices.repeats + 1),
                periods=choices.repeats + 1,
                sample_rate_hz=_SAMPLE_RATE_HZ,
                entry=_common_entry(aircraft, choices),
                seed=choices.seed,
            )
        )
    else:
        parts += [
            _input(aircraft, choices, axis, choices.shape, choices.length_s, sizes[axis], repeat=repeat)
            for axis in choices.axes
            for repeat in range(choices.repeats)
        ]
    if choices.doublets:
        parts += [
            _input(aircraft, choices, axis, "doublet", _doublet_s(choices), (doublets or sizes)[axis], repeat=repeat)
            for axis in choices.axes
            for repeat in range(2)
        ]
    title = name or f"{choices.shape.replace('_', ' ')} on {', '.join(choices.axes)}"
    return sequence(title, parts, trim_s=_REST_S)


def _binaries(
    aircraft: Aircraft, choices: PlanSettings, sizes: Mapping[str, float], *, repeat: int
) -> tuple[PlannedInput, ...]:
    """Random binary signals of all axes at the same time."""
    return uncorrelated_binaries(
        {axis: sizes[axis] for axis in choices.axes},
        start_s=0.0,
        band_rad_s=choices.band_rad_s,
        duration_s=choices.length_s,
        sample_rate_hz=_rate_hz(aircraft, choices),
        clock_hz=0.0 if choices.interface is None else choices.interface.rate_hz,
        entries={axis: _entry(aircraft, choices, axis, choices.shape) for axis in choices.axes},
        seed=choices.seed + len(AXES) * repeat,
    )


def _entry(aircraft: Aircraft, choices: PlanSettings, axis: Axis, shape: Shape) -> Entry:
    """Where a test input of an axis is added."""
    if choices.entry is not None:
        return choices.entry
    if choices.interface is not None:
        return choices.interface.entries[axis]
    return by_hand(aircraft, axis) if shape in STEPS else default_entry(aircraft, axis)


def _rate_hz(aircraft: Aircraft, choices: PlanSettings) -> float:
    """Sample rate: a held sample has to switch between two turns of the loop."""
    return _SAMPLE_RATE_HZ if choices.interface is None else aircraft.autopilot.rate_hz


_SENT_DOUBLET_S = 1.2
"""Of a vehicle behind set-points, whose rate of climb answers in a third of a second."""


def _doublet_s(choices: PlanSettings) -> float:
    """Length of a doublet, a whole number of what is sent one after the other."""
    return DOUBLET_S if choices.interface is None else _SENT_DOUBLET_S


def _common_entry(aircraft: Aircraft, choices: PlanSettings) -> Entry:
    """Where inputs of several axes at the same time are added."""
    if choices.entry is not None:
        return choices.entry
    if choices.interface is not None:
        entries = {choices.interface.entries[axis] for axis in choices.axes}
    else:
        entries = {default_entry(aircraft, axis) for axis in choices.axes}
    if len(entries) > 1:
        raise UsageError(
            f"{aircraft.name} takes {', '.join(choices.axes)} at different entries: {' and '.join(sorted(entries))}",
            remedy="leave thrust out of --axis, or name one --entry for all axes",
        )
    return entries.pop()


def _input(
    aircraft: Aircraft,
    choices: PlanSettings,
    axis: Axis,
    shape: Shape,
    duration_s: float,
    amplitude: float,
    *,
    repeat: int,
) -> PlannedInput:
    settings = {"noise_fraction": 0.1} if shape == "pilot_sweep" else {}
    if shape == "logarithmic_sweep":
        # As ArduPilot flies it: two cycles of the lowest frequency, and a slow fade.
        constant_s = 4.0 * math.pi / choices.band_of(axis)[0]
        settings = {
            "constant_s": constant_s,
            "fade_in_s": min(5.0, 0.1 * duration_s),
            "fade_out_s": min(2.0, 0.05 * duration_s),
        }
        # Whole samples: the firmware's chirp lasts as long as they do, and half of one shifts its fast end.
        rate_hz = _rate_hz(aircraft, choices)
        duration_s = round((duration_s + constant_s) * rate_hz) / rate_hz
    if shape == "random_binary" and choices.interface is not None:
        settings = {"clock_hz": choices.interface.rate_hz}
    planned_input = planned(
        axis,
        shape,
        start_s=0.0,
        amplitude=-amplitude if shape in STEPS and repeat % 2 else amplitude,
        duration_s=duration_s,
        sample_rate_hz=_rate_hz(aircraft, choices),
        band_rad_s=None if shape in STEPS else choices.band_of(axis),
        entry=_entry(aircraft, choices, axis, shape),
        seed=choices.seed + AXES.index(axis) + len(AXES) * repeat,
        **settings,
    )
    if shape == "pilot_sweep":
        # The noise on top of the sine counts, for limits are kept by what is flown.
        planned_input = replace(
            planned_input, values=planned_input.values * (abs(amplitude) / np.abs(planned_input.values).max())
        )
    return planned_input


def _scaled(planned: PlannedInput, factor: float) -> PlannedInput:
    return replace(planned, values=factor * planned.values, amplitude=factor * planned.amplitude)


def _rounded(amplitude: float) -> float:
    """Two digits, downward: what a person would set."""
    place = 10.0 ** (math.floor(math.log10(amplitude)) - 1)
    return round(math.floor(amplitude / place + 1e-9) * place, 9)


_LONGEST_FLIGHT_S = 300.0
_SHORTEST_S = 15.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PlanPrediction(Immutable):
    """Predicted errors of the parameters of a model, or why the plan cannot support it."""

    model: str
    prediction: Prediction | None
    refused: str = ""
    findings: tuple[Finding, ...] = ()
    """Of what is refused; a prediction has its own."""

    def __post_init__(self) -> None:
        self._set(findings=tuple(self.findings))


@dataclass(frozen=True, kw_only=True, eq=False)
class Designed(Immutable):
    """A plan with its predicted errors.

    Parameters
    ----------
    kind
        Its shape.
    planned
        What to fly, with amplitudes and what it reaches.
    told
        One for each model.
    shortest
        By model, where an accuracy was asked for.
    wanted
        By model, what was asked for: parameter to percent.
    findings
        On rehearsals that failed.
    """

    kind: Shape
    planned: Planned
    told: tuple[PlanPrediction, ...]
    shortest: Mapping[str, Shortest]
    wanted: Mapping[str, Mapping[str, float]]
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(findings=tuple(self.findings))

    @property
    def percent(self) -> dict[str, float]:
        """Standard deviations in percent by model and parameter, ``rate.roll L_roll``, of all that will be shown."""
        return {
            f"{predicted.model} {parameter.name}": parameter.percent
            for predicted in self.told
            for parameter in (predicted.prediction.parameters if predicted.prediction is not None else ())
        }


def design(choices: DesignSettings) -> tuple[Designed, ...]:
    """Plans of all kinds, each with its predicted errors.

    Amplitudes are searched for in the nonlinear simulator. Predicted errors follow from the linear loop about hover,
    the noise of the sensors and the turbulence of the wind, without a further flight.

    Parameters
    ----------
    choices
        What is to be designed.

    Raises
    ------
    UsageError
        A wanted parameter is in none of the models, or the limits leave no room for a test input.
    ModelError
        There is no such vehicle or model.
    """
    craft = choices.aircraft
    rate_hz = craft.autopilot.rate_hz
    interface = choices.entry.interface
    logged_hz = log_rate_hz(named(craft.autopilot.kind).log_format, rate_hz) if interface is None else interface.rate_hz
    loop = aircraft_loop(craft, wind=choices.plan.wind, log_rate_hz=logged_hz)
    models = [_model(choices, name) for name in choices.model_names]
    _require_reachable(choices, models)
    if choices.prior is not None and not answers_setpoints(choices.prior.structure):
        loop = with_prior(loop, choices.prior)
    _require_wanted(choices, models)
    return tuple(_designed(choices, craft, loop, models, kind) for kind in choices.kinds)


_HOVER_S = 30.0
_ROTORCRAFT: Mapping[int, str] = MappingProxyType({4: "quadrotor", 6: "hexarotor", 8: "octorotor"})


def has_room(choices: DesignSettings) -> bool:
    """Whether a vehicle hovers within the limits of its plan in one draw of wind and noise, so that a test input fits.

    Parameters
    ----------
    choices
        What would be designed.
    """
    try:
        flight = fly_multirotor(choices.aircraft, duration_s=_HOVER_S, wind=choices.plan.wind, seed=choices.plan.seed)
    except (UsageError, ModelError):
        return False
    return not reached(flight).beyond(choices.plan.limits)


def computed_for(choices: DesignSettings) -> str:
    """Which vehicle a plan was computed for, in the words of its card.

    Parameters
    ----------
    choices
        What is designed.

    Examples
    --------
    >>> computed_for(DesignSettings(vehicle="px4_quad", kinds=("pilot_sweep",)))
    'computed for a simulated 1 kg quadrotor (px4_quad)'
    """
    from rotorid.vehicles.catalog import VEHICLES, aircraft

    entry, own = choices.entry, choices.own
    if own is None:
        words = f"a simulated {_kind(entry.aircraft)} ({entry.name})" if entry.name in VEHICLES else entry.name
    else:
        logs = listed(
            list(dict.fromkeys(Path(log).name for model in own.joined.models for log in model.provenance.inputs))
        )
        known = [*(["hover"] if own.has_motors else []), *own.answers]
        like = aircraft(own.like) if own.like in VEHICLES else entry.aircraft
        rest = f"a simulated {_kind(like)} ({own.like})"
        whole = own.has_motors and set(choices.plan.axes) <= {*own.answers, "thrust"}
        words = (
            f"{entry.name} as in {logs}" if whole else f"{rest} with {listed(known)} as in {logs}" if known else rest
        )
    words = f"computed for {words}"
    if not choices.gains_source:
        return words
    hover = " and the hover throttle" if choices.hover_throttle is not None else ""
    return f"{words}, with the gains{hover} of {choices.gains_source}"


def _kind(craft: Aircraft) -> str:
    rotors = craft.vehicle.rotors.layout.rotors
    return f"{craft.vehicle.mass_kg:.2g} kg {_ROTORCRAFT.get(rotors, f'multirotor of {rotors} rotors')}"


def beyond_limits(design: Designed, limits: Limits) -> list[Finding]:
    """The remark that a plan passes limits, as one with amplitudes given by hand may."""
    passed = design.planned.reached.beyond(limits)
    if not passed:
        return []
    reached = {name: float(getattr(design.planned.reached, name)) for name in passed}
    words = ", ".join(
        f"{limit_words([name])} {limits.words(name, value)} (limit {limits.words(name)})"
        for name, value in reached.items()
    )
    message = (
        f"The plan passes its limits in simulation: {words}. Predictions hold for a loop that is linear, "
        "and motors at their limits are not. Fly less, or raise the limits on purpose with --limit."
    )
    return [warn("beyond_limits", design.kind, message, **reached)]


_FOLLOWED = 0.9
"""Correlation of a set-point with what flies of it, below which it is not the test input that was planned."""


def not_followed(design: Designed, craft: Aircraft) -> list[Finding]:
    """The warning that an autopilot smooths the attitude set-points of a plan until another test input flies."""
    shaping = craft.autopilot.shaping
    flown = as_flown(craft, design.planned.plan)
    found: list[Finding] = []
    for asked, flies in zip(design.planned.plan.inputs, flown.inputs, strict=True):
        if flies is asked or asked.axis in {finding.where for finding in found}:
            continue
        follows = flies.values[: asked.values.size]
        correlation = float(np.corrcoef(asked.values, follows)[0, 1])
        if correlation >= _FOLLOWED:
            continue
        sizes = [math.degrees(float(np.std(values))) for values in (asked.values, follows)]
        corner_rad_s = shaping[asked.axis].corner_rad_s
        message = (
            f"The autopilot smooths the {asked.axis} set-point (ATC_INPUT_TC, ATC_ACCEL_{asked.axis[0].upper()}_MAX): "
            f"of {sizes[0]:.1f}° rms that are sent, {sizes[1]:.1f}° fly, with a correlation of {correlation:.2f}. The "
            "predictions are those of the set-point that flies. A sweep in SYSTEMID mode (no --entry) flies as planned"
            f", and so do small attitudes well below {corner_rad_s:.2g} rad/s."
        )
        found.append(
            warn(
                "shaped_setpoint",
                asked.axis,
                message,
                sent_rms_deg=sizes[0],
                flown_rms_deg=sizes[1],
                correlation=correlation,
                corner_rad_s=corner_rad_s,
            )
        )
    return found


def best_of(designed: Sequence[Designed]) -> dict[str, str]:
    """The kind with the least error of each parameter, where there are several."""
    if len(designed) < 2:
        return {}
    names = dict.fromkeys(name for design in designed for name in design.percent)
    return {name: min(designed, key=lambda design: design.percent.get(name, np.inf)).kind for name in names}


def _designed(
    choices: DesignSettings,
    craft: Aircraft,
    loop: LoopModel,
    models: Sequence[LinearStructure],
    kind: Shape,
) -> Designed:
    planned = plan_for(craft, replace(choices.plan, shape=kind))
    excited = as_flown(craft, tested(planned.plan, kind))
    predictions = []
    logs = rehearsed(choices, planned.plan)
    rehearsals = {model.name: Rehearsal.of(choices, model, logs) for model in models}
    for model in models:
        _PROGRESS.info(f"predicting errors of {model.name} after the {kind.replace('_', ' ')}")
        predictions.append(_predict_plan(choices, craft, loop, model, excited, rehearsals[model.name]))
    return Designed(
        kind=kind,
        planned=planned,
        told=tuple(predictions),
        shortest=_shortest(choices, craft, loop, models, kind, planned, rehearsals),
        wanted={model.name: _wanted(choices, model) for model in models},
        findings=tuple(failed_rehearsals(kind, len(logs), rehearsals)),
    )


def tested(plan: FlightPlan, kind: Shape) -> FlightPlan:
    """The part of a plan that a model will be fitted to: without the doublets that verify it."""
    if kind in STEPS:
        return plan
    return replace(plan, inputs=tuple(planned for planned in plan.inputs if planned.shape == kind))


def as_flown(craft: Aircraft, plan: FlightPlan) -> FlightPlan:
    """A plan with the set-points that fly, which are those that the log shows."""
    return shaped_plan(plan, craft.autopilot.shaping, craft.autopilot.rate_hz)


def _outside(choices: DesignSettings, loop: LoopModel, model: LinearStructure) -> LoopModel:
    """A loop as the set-points of a response model show it."""
    outside = setpoint_loop(loop, model.inputs, sampled=choices.entry.interface is not None)
    earlier = choices.earlier
    return outside if earlier is None else with_known(outside, earlier.structure, earlier.values)


def _predict_plan(
    choices: DesignSettings,
    craft: Aircraft,
    loop: LoopModel,
    model: LinearStructure,
    plan: FlightPlan,
    rehearsal: Rehearsal,
) -> PlanPrediction:
    try:
        if rehearsal.refused is not None:
            raise rehearsal.refused
        if answers_setpoints(model):
            prediction = predict_responses(
                model,
                _believed(choices, model),
                _outside(choices, loop, model),
                plan,
                choices=choices.fit,
                rehearsed=rehearsal.bounds,
                least_std=rehearsal.least_std,
            )
        else:
            prediction = predict(
                model,
                expected_values(model, craft, choices.prior),
                loop,
                plan,
                choices=_fit(choices, model, loop, rehearsal),
                known_errors=rehearsal.errors,
            )
    except (UsageError, ModelError):
        raise
    except Exception as failure:
        # What one model foretells, all others and the plan itself stand without.
        error = reason_of(failure, f"the prediction for {model.name}")
        findings = error.findings if isinstance(error, InsufficientDataError) else ()
        return PlanPrediction(model=model.name, prediction=None, refused=str(error), findings=findings)
    return PlanPrediction(model=model.name, prediction=prediction)


def _shortest(
    choices: DesignSettings,
    craft: Aircraft,
    loop: LoopModel,
    models: Sequence[LinearStructure],
    kind: Shape,
    planned: Planned,
    rehearsals: Mapping[str, Rehearsal],
) -> dict[str, Shortest]:
    """Shortest durations by model, with the amplitudes of the plan."""
    swept = [planned_input for planned_input in planned.plan.inputs if planned_input.shape == kind]
    sizes: dict[str, float] = {planned.axis: abs(planned.amplitude) for planned in swept}

    def plan_of_duration(duration_s: float) -> FlightPlan:
        wish = replace(choices.plan, shape=kind, duration_s=duration_s, amplitudes=sizes, doublets=False)
        return as_flown(craft, plan_with(craft, wish, sizes))

    found: dict[str, Shortest] = {}
    for model in models:
        wanted = _wanted(choices, model)
        if wanted and kind not in STEPS:
            _PROGRESS.info(f"the shortest {kind.replace('_', ' ')} for {model.name}")
            answers = answers_setpoints(model)
            found[model.name] = shortest(
                model,
                _believed(choices, model) if answers else expected_values(model, craft, choices.prior),
                _outside(choices, loop, model) if answers else loop,
                plan_of_duration,
                wanted,
                shortest_s=_SHORTEST_S,
                longest_s=_LONGEST_FLIGHT_S,
                choices=choices.fit if answers else _fit(choices, model, loop, rehearsals[model.name]),
                foretell=partial(
                    predict_responses,
                    rehearsed=rehearsals[model.name].bounds,
                    of_plan=False,
                    least_std=rehearsals[model.name].least_std,
                )
                if answers
                else partial(predict, known_errors=replace(rehearsals[model.name].errors, of_plan=False)),
            )
    return found


def _believed(choices: DesignSettings, model: LinearStructure) -> dict[str, float]:
    """Values of a response model that a previous result has; others follow from the loop."""
    known = choices.earlier.values if choices.earlier is not None else {}
    return {name: known[name] for name in model.parameters.free if name in known}


def _require_reachable(choices: DesignSettings, models: Sequence[LinearStructure]) -> None:
    """Refuse models whose inputs the vehicle does not take, or the plan does not move.

    Raises
    ------
    UsageError
        It names the first, and those that there are.
    """
    interface = choices.entry.interface
    inside: tuple[Entry, ...] = ("attitude_setpoint", "rate_setpoint")
    places: list[tuple[Axis, Entry]] = [(axis, entry) for axis in AXES for entry in inside]  # type: ignore[misc]
    if interface is not None:
        places = list(interface.entries.items())
    taken = [name for place in places if (name := setpoint_of(*place)) is not None]
    moved = [setpoint_of(axis, _setpoint_entry(choices, axis)) for axis in choices.plan.axes]
    for model in models:
        if interface is None and not any(name in SETPOINTS for name in model.inputs):
            continue
        wrong = [name for name in model.inputs if name not in taken or name not in moved]
        if wrong:
            why = "the plan does not move" if wrong[0] in taken else f"{choices.entry.name} does not take"
            raise UsageError(
                f"{model.name} has the input {wrong[0]}, which {why}",
                needed=f"inputs among {', '.join(taken)}",
                remedy="name them with --inputs and --outputs, and their axes with --axis",
            )


def _setpoint_entry(choices: DesignSettings, axis: Axis) -> Entry:
    """Where a set-point of an axis enters."""
    plan, interface = choices.plan, choices.entry.interface
    if plan.entry is not None:
        return plan.entry
    return "attitude_setpoint" if interface is None else interface.entries[axis]


def _fit(choices: DesignSettings, model: LinearStructure, loop: LoopModel, rehearsal: Rehearsal) -> FitSettings:
    """How an identification would fit: its outputs in a rehearsal, or those that sensors measure, if none are given."""
    logged = rehearsal.outputs if set(rehearsal.outputs) <= set(loop.outputs) else ()
    measured = logged or tuple(name for name in model.outputs if name in INERTIAL)
    return choices.fit if choices.fit.outputs or not measured else replace(choices.fit, outputs=measured)


def _wanted(choices: DesignSettings, model: LinearStructure) -> dict[str, float]:
    return {name: percent for name, percent in choices.reach.items() if name in model.parameters.free}


def _model(choices: DesignSettings, name: str) -> LinearStructure:
    if choices.earlier is not None and name == choices.earlier.structure.name:
        return choices.earlier.structure
    if family_of(name).of_plans:
        return named_model(name, inputs=choices.inputs, outputs=choices.outputs, logged=_setpoint_channels(choices))
    return named_model(name)


def _setpoint_channels(choices: DesignSettings) -> tuple[str, ...]:
    """Set-points of the excited axes and the channels that follow them, as they will be logged."""
    names = [setpoint_of(axis, _setpoint_entry(choices, axis)) for axis in choices.plan.axes]
    return tuple(channel for name in names if name is not None for channel in (name, SETPOINTS[name].response))


def _require_wanted(choices: DesignSettings, models: Sequence[LinearStructure]) -> None:
    free = {name for model in models for name in model.parameters.free}
    if wrong := [name for name in choices.reach if name not in free]:
        raise UsageError(
            f"--reach {wrong[0]}: no free parameter of {', '.join(model.name for model in models)}",
            needed=", ".join(sorted(free)),
        )
