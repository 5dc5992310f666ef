"""Test inputs for a vehicle on a pivot: both motors of an axis swept at once, as far as its angle may go.

One sweep goes upward in frequency while the other goes downward, so that the motors move independently and each shows
its own delay. The rig is held by a slow loop, and answers in proportion: the amplitude follows from the angle that a
small one makes, and the angle of the whole plan is simulated with the noise of the rig. Errors are those of an
identification of one simulated log.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.display import listed
from rotorid.data.findings import Finding, warn
from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.data.record import FlightRecord
from rotorid.errors import RotoridError, UsageError
from rotorid.excitation.plan import sequence
from rotorid.models.input_units import identified_unit
from rotorid.models.library import library_model
from rotorid.models.parameter import no_such
from rotorid.models.state_space import StateSpace
from rotorid.planning.prior import Prior
from rotorid.simulation.hover_flight import STEP_RATE_HZ
from rotorid.typing import Axis, FloatArray
from rotorid.vehicles import rig

PAIRS: Mapping[Axis, tuple[str, str]] = {"pitch": ("motor_1", "motor_2"), "roll": ("motor_3", "motor_4")}
ANGLES: Mapping[Axis, str] = {"pitch": "theta", "roll": "phi"}
USUAL_LIMIT_RAD = math.radians(10.0)
"""Angle of a rig about which the equations of a double integrator hold."""

_LOG_HZ = rig.SAMPLE_RATE_HZ
_MARGIN, _DRAWS, _ROUNDS = 0.9, 3, 3
_REST_S = 4.0
_NOISE = 0.05


@dataclass(frozen=True, kw_only=True)
class BenchSettings(Immutable):
    """Choices of a plan for a rig.

    Parameters
    ----------
    axes
        Swept one after the other.
    band_rad_s, duration_s
        Of each sweep.
    limit_rad
        Angle that the rig may reach.
    amplitudes
        By axis, in the unit of the motors, for those that are not to be searched for.
    prior
        Result of ``rig.roll`` or ``rig.attitude`` whose values replace those of the library.
    changes
        Numbers of the rig that are known otherwise, by the names of ``rig.attitude``.
    seed
        Of what is random in the sweeps, and of the noise.
    """

    axes: tuple[Axis, ...] = ("roll",)
    band_rad_s: tuple[float, float] = rig.BAND_RAD_S
    duration_s: float = rig.DURATION_S
    limit_rad: float = USUAL_LIMIT_RAD
    amplitudes: Mapping[str, float] = field(default_factory=dict)
    prior: Prior | None = None
    changes: Mapping[str, float] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        self._set(axes=tuple(self.axes), amplitudes=self.amplitudes, changes=self.changes)
        if unknown := [name for name in self.changes if name not in rig.ATTITUDE]:
            raise no_such("number of a rig", unknown[0], tuple(rig.ATTITUDE))
        if wrong := [name for name, value in self.changes.items() if not _possible(name, value)]:
            raise UsageError(
                f"{wrong[0]} is {self.changes[wrong[0]]:g}",
                needed="more than 0; delays 0 to 1 s",
                remedy="correct --set",
            )
        if wrong := [axis for axis in self.axes if axis not in PAIRS]:
            raise UsageError(
                f"{wrong[0]} has no pair of motors of its own on a rig",
                needed="roll or pitch",
                remedy="each of them turns the rig in yaw too; identify rig.attitude from a sweep of both",
            )
        periods = self.duration_s * self.band_rad_s[0] / (2.0 * math.pi)
        if periods < 1.0:
            raise UsageError(
                f"{self.duration_s:g} s hold {periods:.2g} periods of {self.band_rad_s[0]:g} rad/s",
                needed="two and more",
                remedy="raise --duration or the lower end of --band",
            )

    @property
    def unit(self) -> str:
        """Unit of the motors."""
        return "V" if self.prior is None else identified_unit(self.prior.structure)

    @property
    def source(self) -> str:
        """Whose rig it is."""
        return "the rig of the library" if self.prior is None else self.prior.source

    @property
    def system(self) -> StateSpace:
        """The rig that will be swept; what a result of one axis does not say is that of its other axis."""
        return library_model("rig.attitude").matrices(self.system_values)

    @property
    def stiffness(self) -> float:
        """Gains of the loop over those of the library's rig, so that both turn as slowly."""
        return _gain(rig.ATTITUDE) / _gain(self.system_values)

    @property
    def system_values(self) -> Mapping[str, float]:
        """All numbers of ``rig.attitude``."""
        return {**self._known, **self.changes}

    @property
    def _known(self) -> Mapping[str, float]:
        if self.prior is None:
            return rig.ATTITUDE
        known = self.prior.values
        if not {"L", "K_f", "J_x"} <= set(known):
            raise UsageError(
                f"{self.prior.source} has {', '.join(known)}",
                needed="a result of rig.roll or rig.attitude",
                remedy="leave --prior out for the rig of the library",
            )
        # One pair of motors is like the other, and yaw as much slower as on the rig of the library.
        slower = _gain({**rig.ATTITUDE, **known}) / _gain(rig.ATTITUDE)
        alike = {"J_y": known["J_x"], "K_t": rig.ATTITUDE["K_t"] * slower}
        delays = {f"tau_{n}": known[f"tau_{n + 2}"] for n in (1, 2) if f"tau_{n + 2}" in known}
        return {**rig.ATTITUDE, **alike, **delays, **known}


def _possible(name: str, value: float) -> bool:
    return 0.0 <= value <= 1.0 if name.startswith("tau_") else 0.0 < value < math.inf


def _gain(values: Mapping[str, float]) -> float:
    return values["L"] * values["K_f"] / values["J_x"]


@dataclass(frozen=True, kw_only=True)
class ExpectedParameter:
    """A parameter with the error that a log of the plan gives."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True, kw_only=True, eq=False)
class BenchDesign(Immutable):
    """A plan for a rig, what it reaches and what it measures.

    Parameters
    ----------
    settings
        What was asked for.
    plan
        Sweeps of two motors for each axis.
    reached_rad
        Largest angle of all axes in several draws of noise.
    expected
        Free parameters of ``rig.roll`` or ``rig.attitude`` from one simulated log; empty where neither could be fitted.
    findings
        What an engineer would remark.
    """

    settings: BenchSettings
    plan: FlightPlan
    reached_rad: float
    model: str = ""
    expected: Mapping[str, ExpectedParameter] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(expected=self.expected, findings=tuple(self.findings))


def design_bench(settings: BenchSettings) -> BenchDesign:
    """Sweeps of both motors of each axis whose predicted angle stays within the limit.

    Raises
    ------
    UsageError
        Noise alone moves the rig beyond the limit, or its loop does not hold it.

    Examples
    --------
    >>> design = design_bench(BenchSettings(limit_rad=math.radians(5.0), duration_s=60.0))
    >>> [(part.motor, part.unit) for part in design.plan.inputs], math.degrees(design.reached_rad) < 5.0
    ([('motor_3', 'V'), ('motor_4', 'V')], True)
    """
    sizes = {axis: settings.amplitudes.get(axis) or _largest(settings, axis) for axis in settings.axes}
    plan = _plan(settings, sizes)
    reached_rad = _reached(settings, plan)
    findings: list[Finding] = []
    if reached_rad > settings.limit_rad:
        message = (
            f"The plan turns the rig by {math.degrees(reached_rad):.1f}° in simulation; the limit is "
            f"{math.degrees(settings.limit_rad):.1f}°. Lower --amplitude, or leave it out."
        )
        findings.append(warn("beyond_limits", listed(list(settings.axes)), message, tilt_rad=reached_rad))
    model, expected = _expected(settings, plan)
    return BenchDesign(
        settings=settings, plan=plan, reached_rad=reached_rad, model=model, expected=expected, findings=tuple(findings)
    )


def _largest(settings: BenchSettings, axis: Axis) -> float:
    """Amplitude that keeps the limit with a tenth to spare, in two digits.

    The rig is linear: the angle goes with the amplitude but for the noise, which a few rounds take into account.
    """
    size = rig.SWEEP_V * settings.stiffness
    for _ in range(_ROUNDS):
        reached_rad = _reached(settings, _plan(settings, {axis: size}))
        size *= _MARGIN * settings.limit_rad / reached_rad
    place = 10.0 ** (math.floor(math.log10(size)) - 1)
    return round(math.floor(size / place + 1e-9) * place, 9)


def _plan(settings: BenchSettings, sizes: Mapping[Axis, float]) -> FlightPlan:
    parts = [_pair(settings, axis, size) for axis, size in sizes.items()]
    motors = [planned.motor for pair in parts for planned in pair]
    return sequence(f"sweeps of {listed(motors)}", parts, trim_s=_REST_S)


def _pair(settings: BenchSettings, axis: Axis, size: float) -> tuple[PlannedInput, ...]:
    """Both motors of an axis at once: one upward, one downward, each with an irregularity of its own."""
    rng = np.random.default_rng([settings.seed, list(PAIRS).index(axis)])
    stride = round(STEP_RATE_HZ / _LOG_HZ)
    pair = []
    for motor, direction in zip(PAIRS[axis], (1, -1), strict=True):
        swept = rig.sweep(rng, band_rad_s=settings.band_rad_s, duration_s=settings.duration_s)[::direction][::stride]
        pair.append(
            PlannedInput(
                axis=axis,
                shape="pilot_sweep",
                start_s=0.0,
                values=size * swept / np.abs(swept).max(),
                sample_rate_hz=_LOG_HZ,
                amplitude=size,
                band_rad_s=settings.band_rad_s,
                motor=motor,
                motor_unit=settings.unit,
                settings={"noise_fraction": 0.1},
            )
        )
    return tuple(pair)


def usual_sweep(settings: BenchSettings) -> FlightPlan:
    """Sweeps of both motors of roll as large for a rig as those of the library's rig are for that one."""
    return _plan(settings, {"roll": rig.SWEEP_V * settings.stiffness})


def flown_on_rig(
    plan: FlightPlan, seed: int, *, settings: BenchSettings | None = None, noise: float = _NOISE
) -> FlightRecord:
    """Log of a rig that flies a plan.

    Parameters
    ----------
    plan
        Of :func:`design_bench`: every input drives a motor.
    settings
        Whose rig; that of the library without any.

    Raises
    ------
    UsageError
        The plan is of commands, or of motors in a unit that the rig does not have.
    """
    chosen = settings or BenchSettings()
    wrong = next((part for part in plan.inputs if part.motor not in rig.MOTORS or part.unit != chosen.unit), None)
    if wrong is not None:
        raise UsageError(
            f"the plan {plan.name} drives {wrong.signal} in {wrong.unit}",
            needed=f"single motors in {chosen.unit}, as of rotorid design sweep --vehicle rig",
            remedy="simulate the result that the plan was made for, in place of the rig, or another vehicle",
        )
    time_s = np.arange(round(plan.duration_s * STEP_RATE_HZ)) / STEP_RATE_HZ
    inputs = np.zeros((len(rig.MOTORS), time_s.size))
    for part in plan.inputs:
        inputs[rig.MOTORS.index(part.motor)] += part.at(time_s)
    band = plan.inputs[0].band_rad_s or rig.BAND_RAD_S
    moved = rig.move(
        inputs,
        np.random.default_rng(seed),
        noise=noise,
        system=chosen.system,
        stiffness=chosen.stiffness,
        unit=chosen.unit,
        band_rad_s=band,
    )
    # One sweep after the other, each with its axis.
    parts = {part.axis: part.maneuver for part in plan.inputs}
    return replace(moved, declared=tuple(replace(maneuver, signal="") for maneuver in parts.values()))


def _reached(settings: BenchSettings, plan: FlightPlan) -> float:
    """Largest angle of roll and pitch in several draws of the noise, rad; of measured angles, without their noise."""
    angles: list[FloatArray] = []
    for seed in range(settings.seed, settings.seed + _DRAWS):
        moved = flown_on_rig(plan, seed, settings=settings, noise=0.0)
        angles += [moved[name].values for name in ANGLES.values()]
    reached_rad = float(np.abs(angles).max())
    if not math.isfinite(reached_rad) or reached_rad > 100.0 * settings.limit_rad + 1e3:
        raise UsageError(
            f"the simulated loop around {settings.source} is not stable",
            needed="delays of motors below about half a second",
            remedy="give --amplitude, small, and sweep with a loop of your own",
        )
    return reached_rad


_OF_ROLL = ("rig.roll", ("phi",), ("J_x",))
_WHOLE = ("rig.attitude", ("phi", "theta", "psi"), ("K_f", "K_t"))
"""Model, outputs and what is known of it, of a sweep of roll alone and of one of both axes."""


def _expected(settings: BenchSettings, plan: FlightPlan) -> tuple[str, dict[str, ExpectedParameter]]:
    """The model that the plan supports, and its free parameters as one simulated log gives them."""
    from rotorid.identifying.identification import identify

    if "roll" not in settings.axes:
        return "", {}
    model, outputs, fixed = _WHOLE if "pitch" in settings.axes else _OF_ROLL
    values = settings.system_values
    fix = {name: values[name] for name in fixed}
    record = flown_on_rig(plan, settings.seed, settings=settings)
    try:
        found = identify([record], model, outputs=outputs, fix=fix)
    except RotoridError:
        return model, {}
    return model, {
        name: ExpectedParameter(value=values[name], std=parameter.std, unit=parameter.unit)
        for name, parameter in found.parameters.items()
        if parameter.std is not None and name in values
    }
