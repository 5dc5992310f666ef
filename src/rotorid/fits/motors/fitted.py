"""A vehicle as its motors show it: parameters with bounds, and the same as a linear model around hover.

That model leads from motor outputs to rates and specific force.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding
from rotorid.fits.bootstrapping import Bootstrap
from rotorid.fits.motors.loads import thrust_of_logs, voltage_exponent
from rotorid.fits.motors.motion import CHANNELS, Motion, motions
from rotorid.fits.scatter import Disagreement
from rotorid.fits.searching import Searched
from rotorid.fitting.motors.excitation import band_words
from rotorid.fitting.motors.fit import MotorFit
from rotorid.fitting.motors.inertia import InertiaRegression
from rotorid.fitting.motors.problem import DAMPING, MotorProblem
from rotorid.flights.motor_data import MotorData
from rotorid.models.motors import (
    SPIN_UP,
    YAW_DELAY,
    Curve,
)
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.results.summary import Derived, LogThrust, VoltageExponent
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedMotors(Immutable):
    """Physical parameters of a vehicle that its flights determine.

    Parameters
    ----------
    fit
        How it ended.
    curve
        Thrust of a rotor by its output.
    curve_assumed
        Whether no stretch moved thrust, so that the curve is a guess.
    parameters
        The identified values; one that ended on a bound is held there.
    bounds
        Their uncertainty.
    memory
        Order of the autoregressions that describe the errors.
    both
        Each inertia by regressions both ways.
    hover_output
        Mean output of the motors.
    load_factor
        Mean specific force along the thrust over gravity, as measured.
    derived
        Thrust of a rotor and its slope at that output, at full output, and thrust over weight there.
    left_out
        Axes that were excited and of which nothing is stated, and why.
    disagreeing
        Parameters of which each log alone says something else.
    bootstrap
        Refits to noise drawn anew, where they were asked for. Their spread is that of random errors alone.
    search
        For a start, where one was asked for.
    """

    data: MotorData
    fit: MotorFit
    curve: Curve
    curve_assumed: bool
    parameters: ParameterSet
    bounds: Bounds
    memory: int
    both: tuple[InertiaRegression, ...]
    hover_output: float
    load_factor: float
    derived: Mapping[str, Derived]
    left_out: tuple[Finding, ...] = ()
    disagreeing: tuple[Disagreement, ...] = ()
    bootstrap: Bootstrap | None = None
    search: Searched | None = None

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes that some stretch excites."""
        return tuple(axis for axis in self.fit.problem.axes if axis != "weight")

    def band_words(self, channel: str) -> str:
        """Where the motors explain a channel: ``up to 5 Hz``, or the octaves."""
        axis = next(axis for axis, name in CHANNELS.items() if name == channel)
        return band_words(self.fit.excitations, axis)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of these axes; specific force, where the weight alone was used."""
        return tuple(CHANNELS[axis] for axis in CHANNELS if axis in (self.axes or ("az",)))

    @property
    def listed(self) -> ParameterSet:
        """All parameters."""
        return self.parameters

    @cached_property
    def structure(self) -> LinearStructure:
        """The vehicle around hover, see :func:`hover_model`."""
        return hover_model(self)

    @cached_property
    def moved(self) -> tuple[Motion, ...]:
        """Every stretch as it was measured and as the motors explain it."""
        return motions(self.flown, self.fit.solution.theta, self.data.stretches, self.fit.excitations)

    @cached_property
    def flown(self) -> MotorProblem:
        """The problem on the records as flown, whatever clock the fit was on."""
        fitted = self.fit.problem
        axes = fitted.axes if self.axes else ("az",)
        return MotorProblem(records=self.data.records, levers=fitted.levers, parameters=fitted.parameters, axes=axes)

    @cached_property
    def logs(self) -> tuple[LogThrust, ...]:
        """Thrust over mass of each log, where there are several."""
        found = thrust_of_logs(self.flown, self.fit.solution.theta)
        return found if len(found) > 1 else ()

    @cached_property
    def voltage(self) -> VoltageExponent | None:
        """The power by which thrust follows the battery, where it is known."""
        return voltage_exponent(self.flown, self.fit.solution.theta, self.data.reference_v)


def levers_of(data: MotorData) -> FloatArray:
    """Roll, pitch and yaw moment of a newton of each rotor, shape ``(3, motors)``."""
    arms, torque = data.layout.moment_arms, data.layout.torque_axes
    return np.stack([arms[0], arms[1], torque[2]])


_INERTIA = {"p": "1/I_xx", "q": "1/I_yy", "r": "kappa_per_I_zz"}

_LEAD = "T_lead"
"""By how much the spin-up of rotors leads their torque, where their speed was measured."""


def hover_model(identified: FittedMotors) -> LinearStructure:
    r"""Small motions about hover, with the identified values.

    .. math:: \delta F_i = (c_1 + 2 c_2 x_0) \, \delta x_i

    at the mean output :math:`x_0` of the flights. The delay to the gyros stands for that to the accelerometer too.
    Where the speed of rotors was measured, what yaw takes up of it leads their torque by a time, as its output does:

    .. math:: r = r_0 + T_{lead} \, \dot r_0, \qquad T_{lead} = \frac{h}{\kappa \, dF/dx}
    """
    parameters = identified.parameters
    axes = [axis for axis in RATES if axis in identified.axes]
    motors = range(1, identified.data.layout.rotors + 1)
    lag = "T_motor" in parameters.names
    thrusts = {i: f"x_{i}" if lag else f"motor_{i}" for i in motors}
    equations = [f"T_motor*x_{i}' = -x_{i} + motor_{i}" for i in motors] if lag else []
    leads = "r" in axes and SPIN_UP in parameters.names and not lag
    states = ["r_0" if leads and axis == "r" else axis for axis in axes]
    outputs = [f"r = r_0 + {_LEAD}*r_0'" if leads and axis == "r" else axis for axis in axes]
    for axis, levers in zip(RATES, levers_of(identified.data), strict=True):
        if axis in axes:
            moment = _sum({thrusts[i]: lever for i, lever in zip(motors, levers.tolist(), strict=True)})
            gained = "".join(
                f" - ({lever!r})*{SPIN_UP}*{thrusts[i]}'"
                for i, lever in zip(motors, levers.tolist(), strict=True)
                if axis == "r" and SPIN_UP in parameters.names and lag
            )
            state = states[axes.index(axis)]
            equations.append(f"{state}'{gained} = {DAMPING[axis]}*{state} + {axis}_thrust*({moment})")
    force = f"az_thrust*({_sum(dict.fromkeys(thrusts.values(), -1.0))})"
    heave = "Z_w" in parameters.names
    equations.append(f"w' = {'Z_w*w + ' if heave else ''}{force}")
    names = [*([f"x_{i}" for i in motors] if lag else []), *states, "w"]
    lines = [
        'schema = "rotorid.model/1"',
        'name = "physical.motors"',
        'source = "motor outputs to rates and specific force, linear around hover"',
        f"inputs = [{', '.join(_quoted(f'motor_{i}') for i in motors)}]",
        f"states = [{', '.join(map(_quoted, names))}]",
        "equations = [",
        *(f"    {_quoted(equation)}," for equation in equations),
        "]",
        f"outputs = [{', '.join(map(_quoted, (*outputs, 'az = w' + chr(39))))}]",
        "[delays]",
        *_delays(identified),
        "[constants]",
        f"x_0 = {identified.hover_output!r}",
        *_parameter_tables(identified, axes),
    ]
    return from_toml("\n".join(lines), where="the hover model")


def _quoted(text: str) -> str:
    return f'"{text}"'


def _sum(terms: dict[str, float]) -> str:
    return " + ".join(f"({factor!r})*{name}" for name, factor in terms.items() if factor != 0.0)


def _delays(identified: FittedMotors) -> list[str]:
    """One delay is that of the motors; where yaw has its own, delays are those of what is measured."""
    if YAW_DELAY in identified.parameters.names:
        outputs = {axis: "tau_gyro" for axis in (*identified.axes, "az") if axis != "r"} | {"r": YAW_DELAY}
        return [f'{output} = "{name}"' for output, name in outputs.items()]
    motors = range(1, identified.data.layout.rotors + 1)
    return [f'motor_{i} = "{name}"' for name in _delayed(identified) for i in motors]


def _delayed(identified: FittedMotors) -> tuple[str, ...]:
    """The delay that contains all others: to the gyros, or to the accelerometer if no rate was excited."""
    names = [delay for delay in ("tau_gyro", "tau_accel") if delay in identified.parameters.names]
    return tuple(names[:1])


def _parameter_tables(identified: FittedMotors, axes: Sequence[str]) -> list[str]:
    slope = " + ".join(
        term for name, term in (("c_1", "c_1"), ("c_2", "2*c_2*x_0")) if name in identified.parameters.names
    )
    used = {"m", "c_1", "c_2", "Z_w", "T_motor", *_delayed(identified)}
    used |= {SPIN_UP, YAW_DELAY} if "r" in axes else set()
    used |= {name for axis in axes for name in (DAMPING[axis], _INERTIA[axis].removeprefix("1/"))}
    lines: list[str] = []
    for parameter in identified.parameters:
        if parameter.name not in used:
            continue
        status_lines = ['status = "fixed"'] if parameter.status != "free" else []
        lines += [
            f"[parameters.{parameter.name}]",
            f"value = {parameter.value!r}",
            f'unit = "{parameter.unit}"',
            *status_lines,
        ]
    tied = {f"{axis}_thrust": (f"({slope})*{_INERTIA[axis]}".replace("*1/", "/"), "1/(kg m^2)") for axis in axes}
    tied["az_thrust"] = (f"({slope})/m", "m/s^2")
    if SPIN_UP in used and SPIN_UP in identified.parameters.names and "T_motor" not in identified.parameters.names:
        lines += [f"[parameters.{_LEAD}]", f'tied = "{SPIN_UP}/(({slope})*{_INERTIA["r"]})"', 'unit = "s"']
    for name, (expression, _) in tied.items():
        unit = "m/s^2" if name == "az_thrust" else "rad/(m s^2)" if name != "r_thrust" else "rad/s^2"
        lines += [f"[parameters.{name}]", f'tied = "{expression}"', f'unit = "{unit}"']
    return lines
