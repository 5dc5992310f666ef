"""A vehicle as its flights show it: parameters with bounds, what was predicted, and the same as a linear model.

That model leads from motors to rates and specific force about hover in still air, as that of ``physical.motors`` does.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.base import Immutable
from rotorid.fitting.flight.fit import FlightFit, predicted_force
from rotorid.fitting.flight.motion import motion
from rotorid.fitting.motors.excitation import SLOW_BAND_HZ, in_band
from rotorid.flights.flight_data import FlightMotion
from rotorid.flights.motor_data import MotorFlight
from rotorid.models.flight import FLIGHT_PARAMETERS
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.results.model import SimulatedRecord
from rotorid.results.summary import Derived, DragPoint
from rotorid.signal.kinematics import ACCELERATIONS
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.verification.scores import nrmse_fit_percent, rms, theil_inequality
from rotorid.verification.verification import Scores

_MOVED_M_S2 = 0.5
"""Standard deviation of a slow specific force from which a flight shows what the model makes of it."""

_BY_OUTPUT: Mapping[str, str] = {
    "N s/rad": "N",
    "N s^2/rad^2": "N",
    "N s^2/(m rad)": "N s/m",
    "N s^2/rad": "N s",
    "N m s^2/rad^2": "N m s/rad",
}
"""Units by outputs, a share of the full speed, in place of rad/s."""

_PER_MASS: Mapping[str, str] = {
    "kg": "1",
    "N": "m/s^2",
    "N s": "m/s",
    "N s/m": "1/s",
    "N s/rad": "m/(s rad)",
    "N s^2/m": "1",
    "N s^2/m^2": "1/m",
    "N s^2/m^3": "1/m^2",
    "N s^2/rad": "m/rad",
    "N s^2/rad^2": "m/rad^2",
    "N s^2/(m rad)": "1/rad",
    "N m s": "m^2/s",
    "N m s/rad": "m^2/(s rad)",
    "N m s^2/rad^2": "m^2/rad^2",
    "kg m^2": "m^2",
}
"""Units of a vehicle of which only what it does per kilogram is known."""


def flight_units(*, scaled: bool, speeds: bool) -> dict[str, str]:
    """Unit of each parameter.

    Parameters
    ----------
    scaled
        Whether the mass is known; otherwise all numbers are per kilogram.
    speeds
        Whether the motors are known by measured speeds, and not by outputs.

    Examples
    --------
    >>> flight_units(scaled=True, speeds=True)["k_d"], flight_units(scaled=False, speeds=False)["k_d"]
    ('N s^2/(m rad)', '1/s')
    """
    units = {name: parameter.unit for name, parameter in FLIGHT_PARAMETERS.items()}
    if not speeds:
        units = {name: _BY_OUTPUT.get(unit, unit) for name, unit in units.items()} | {"J_r": "N m s"}
    return units if scaled else {name: _PER_MASS.get(unit, unit) for name, unit in units.items()}


class Predicted(NamedTuple):
    """Specific force of a stretch as measured and as the model makes it, behind the sensor's filter.

    Parameters
    ----------
    flight
        The stretch.
    measured, modeled
        m/s², shape ``(3, n)``.
    velocity
        Through the air, body axes, m/s, shape ``(3, n)``.
    speeds
        Of the rotors, shape ``(rotors, n)``.
    """

    flight: MotorFlight
    measured: FloatArray
    modeled: FloatArray
    velocity: FloatArray
    speeds: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class FittedFlight(Immutable):
    """The physics of a vehicle that its flights determine.

    Parameters
    ----------
    data
        What was flown.
    fit
        How it ended.
    parameters
        The identified values with their units, and what was known.
    bounds
        Their uncertainty.
    """

    data: FlightMotion
    fit: FlightFit
    parameters: ParameterSet
    bounds: Bounds

    @property
    def listed(self) -> ParameterSet:
        """All parameters."""
        return self.parameters

    @property
    def axes(self) -> tuple[str, ...]:
        """Rates whose inertia was identified."""
        needed = {"p": {"I_xx"}, "q": {"I_yy"}, "r": {"I_zz", "kappa"}}
        return tuple(axis for axis in RATES if needed[axis] <= set(self.parameters.names))

    @cached_property
    def predicted(self) -> tuple[Predicted, ...]:
        """Every stretch as measured and as the model makes it."""
        fit, found = self.fit, []
        for flight, wind, skew_s in zip(self.data.motors.stretches, fit.winds, fit.skews_s.tolist(), strict=True):
            driven = motion(flight.record, fit.values, kind=fit.velocity, wind=wind, skew_s=skew_s)
            modeled = predicted_force(fit.values, fit.airframe, flight.record, driven, fit.cutoff_hz)
            found.append(Predicted(flight, flight.record.force, modeled, driven.velocity, driven.speeds))
        return tuple(found)

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """Axes of the accelerometer that move."""
        moved = [
            name
            for row, name in enumerate(ACCELERATIONS)
            if max(float(_slow(flown, flown.measured)[row].std()) for flown in self.predicted) >= _MOVED_M_S2
        ]
        return tuple(moved or ACCELERATIONS[2:])

    @cached_property
    def structure(self) -> LinearStructure:
        """The vehicle about hover, see :func:`hover_structure`."""
        return hover_structure(self)

    @cached_property
    def hover(self) -> dict[str, Derived]:
        """What does not trade as coefficients do, see :class:`rotorid.models.flight.HoverThrust`."""
        units = flight_units(scaled=self.data.given.scaled, speeds=self.data.kind == "speed")
        hover = self.fit.hover
        of_speed = "rad/s" if self.data.kind == "speed" else "1"
        numbers = {
            "thrust_coefficient": (hover.coefficient, units["c_2"]),
            "thrust_slope": (hover.slope_n, units["c_1"]),
            "speed": (hover.speed, of_speed),
            "induced_velocity": (hover.induced_m_s, "m/s"),
        }
        if (k_d := self.fit.values.get("k_d")) is not None:
            numbers["drag"] = k_d * _drag_factor(self) * hover.speed, "1/s"
        stds = _hover_stds(self)
        return {
            name: Derived(value=value, std=stds.get(name, 0.0), unit=unit) for name, (value, unit) in numbers.items()
        }


def _drag_factor(fitted: FittedFlight) -> float:
    """Drag of all rotors over mass, by coefficient and speed."""
    airframe = fitted.fit.airframe
    return airframe.rotors / airframe.mass_kg


def _hover_stds(fitted: FittedFlight) -> dict[str, float]:
    r"""Standard deviations of what holds in hover: thrust, its slope, the speed, and drag over mass.

    .. math:: k = c_2 - c_\lambda v / \Omega, \qquad T' = c_1 + 2 c_2 \Omega - c_\lambda v, \qquad
              D = n k_d \Omega / m

    at the speed and the induced velocity of hover, which follow from weight and disc.
    """
    hover, names = fitted.fit.hover, fitted.bounds.names
    speed, induced = hover.speed, hover.induced_m_s
    ratio = np.array(
        [{"c_0": 1.0, "c_1": speed, "c_2": speed**2, "c_lambda": -speed * induced}.get(n, 0.0) for n in names]
    )
    slope = np.array([{"c_1": 1.0, "c_2": 2.0 * speed, "c_lambda": -induced}.get(n, 0.0) for n in names])
    covariance = fitted.bounds.covariance
    # The speed of hover moves with the thrust at a given speed: the weight stays.
    of_speed = -ratio / hover.slope_n
    moved = slope + 2.0 * fitted.fit.values.get("c_2", 0.0) * of_speed
    of_coefficient = -2.0 * hover.coefficient / speed * of_speed
    by_drag = np.array([speed if name == "k_d" else 0.0 for name in names])
    of_drag = _drag_factor(fitted) * (by_drag + fitted.fit.values.get("k_d", 0.0) * of_speed)

    def std(row: FloatArray) -> float:
        return float(np.sqrt(max(float(row @ covariance @ row), 0.0)))

    return {
        "thrust_coefficient": std(of_coefficient),
        "thrust_slope": std(moved),
        "speed": std(of_speed),
        "drag": std(of_drag),
    }


_BINS, _LEAST_BIN_S = 12, 1.0


def drag_points(fitted: FittedFlight) -> tuple[DragPoint, ...]:
    """Mean force against the airspeed along the discs, in bins of that airspeed with a second of flight and more."""
    parts = [(flown, np.hypot(flown.velocity[0], flown.velocity[1])) for flown in fitted.predicted]
    fastest = max(float(airspeed.max()) for _, airspeed in parts)
    if fitted.fit.velocity == "none" or not fastest > 0.0:
        return ()
    mass, edges = fitted.fit.airframe.mass_kg, np.linspace(0.0, fastest, _BINS + 1)[1:-1]
    sums = np.zeros((4, _BINS))
    for flown, airspeed in parts:
        along = flown.velocity[:2] / np.maximum(airspeed, 1e-9)
        bins = np.searchsorted(edges, airspeed, side="right")
        measured, modeled = (-mass * (rows[:2] * along).sum(axis=0) for rows in (flown.measured, flown.modeled))
        for row, values in enumerate((np.ones_like(airspeed), airspeed, measured, modeled)):
            weighed = values / flown.flight.record.sample_rate_hz
            sums[row] += np.bincount(bins, weights=weighed, minlength=_BINS)
    return tuple(
        DragPoint(airspeed_m_s=v / s, measured_n=a / s, modeled_n=b / s, seconds=s)
        for s, v, a, b in sums.T.tolist()
        if s >= _LEAST_BIN_S
    )


def fitted_parameters(data: FlightMotion, fit: FlightFit, known: Mapping[str, float]) -> ParameterSet:
    """The values of a fit with units and status, in the order of tables."""
    units = flight_units(scaled=data.given.scaled, speeds=data.kind == "speed")
    values = {**known, **fit.values, "m": data.given.airframe.mass_kg}
    if not {"kappa", "I_zz"} <= set(values):
        # One of them alone moves nothing.
        values = {name: value for name, value in values.items() if name not in ("kappa", "I_zz", "J_r")}
    return ParameterSet(
        [
            Parameter(
                name=name,
                value=values[name],
                unit=units[name],
                lower=-np.inf,
                upper=np.inf,
                status="free" if name in fit.free else "fixed",
            )
            for name in FLIGHT_PARAMETERS
            if name in values
        ]
    )


def fitted_bounds(fit: FlightFit, parameters: ParameterSet) -> Bounds:
    """The covariance of a fit as bounds; the usual scatter between flights where it has none."""
    names = parameters.free
    if fit.errors is None:
        usual = np.diag([_usual_scatter(name, parameters[name].value) ** 2 for name in names])
        return bounds_of_covariance(names, usual, usual)
    rows = [fit.errors.names.index(name) for name in names]
    picked = np.ix_(rows, rows)
    return bounds_of_covariance(names, fit.errors.covariance[picked], fit.errors.random[picked])


def _usual_scatter(name: str, value: float) -> float:
    """By how much a number usually differs between flights of one vehicle; its size where nobody knows."""
    about = FLIGHT_PARAMETERS[name]
    share = 1.0 if about.scatter is None else about.scatter
    return share if about.absolute else max(share * abs(value), 1e-12)


def bounds_of_covariance(names: tuple[str, ...], covariance: FloatArray, random: FloatArray) -> Bounds:
    """Bounds by CIFER's rules from covariances: twice the random error, and the error with all others known."""
    size = np.sqrt(np.maximum(random.diagonal(), 1e-300))
    information = np.linalg.pinv(random / np.outer(size, size), hermitian=True).diagonal() / size**2
    return Bounds(
        names=names,
        cramer_rao=2.0 * size,
        insensitivity=1.0 / np.sqrt(np.maximum(information, 1e-300)),
        covariance=covariance,
        random=random,
        colored=1.0,
    )


def _slow(flown: Predicted, rows: FloatArray) -> FloatArray:
    """Slow part of some rows, shape ``(3, n)``."""
    return in_band(rows, SLOW_BAND_HZ, flown.flight.record.sample_rate_hz)


def force_scores(flown: Predicted, channels: tuple[str, ...]) -> dict[str, Scores]:
    """How the force of a stretch is predicted, axis by axis, up to 5 Hz."""
    measured, modeled = (_slow(flown, rows) for rows in (flown.measured, flown.modeled))
    found = {}
    for row, name in enumerate(ACCELERATIONS):
        if name in channels:
            mean = measured[row].mean()
            found[name] = Scores(
                nrmse_fit_percent=nrmse_fit_percent(measured[row], modeled[row]),
                tic=theil_inequality(measured[row] - mean, modeled[row] - mean),
                rms=rms(measured[row] - modeled[row]),
                bias=0.0,
                reference_shift=0.0,
            )
    return found


def fit_percents(fitted: FittedFlight) -> dict[str, float]:
    """Channel to the share of its slow motion that the model explains, of all stretches."""
    percents = {}
    for name in fitted.channels:
        row = ACCELERATIONS.index(name)
        pairs = [(_slow(flown, flown.measured)[row], _slow(flown, flown.modeled)[row]) for flown in fitted.predicted]
        missed = sum(float(np.sum((a - b) ** 2)) for a, b in pairs)
        spread = sum(float(np.sum((a - a.mean()) ** 2)) for a, _ in pairs)
        if spread > 0.0:
            percents[name] = 100.0 * (1.0 - (missed / spread) ** 0.5)
    return percents


def simulated_record(flown: Predicted) -> SimulatedRecord:
    """A stretch for the pictures of a report."""
    record = flown.flight.record
    return SimulatedRecord(
        record=record.name,
        maneuver=flown.flight.maneuver,
        time_s=record.time_s,
        inputs=record.outputs - record.outputs.mean(axis=1, keepdims=True),
        measured=_slow(flown, flown.measured),
        simulated=_slow(flown, flown.modeled),
    )


_MOMENTS = {"p": "1/I_xx", "q": "1/I_yy", "r": "kappa/I_zz"}


def hover_structure(fitted: FittedFlight) -> LinearStructure:
    r"""Small motions about hover in still air, with the identified values.

    .. math::

        \delta F_i = (c_1 + 2 c_2 \Omega_h - c_\lambda v_h) \, \delta \Omega_i, \qquad
        \dot w = Z_w w - \tfrac{1}{m} \sum \delta F_i, \qquad Z_w = -\tfrac{n}{2 m} c_\lambda \Omega_h

    with the speed and induced velocity of hover; climb takes half of its speed from the induced velocity.
    """
    names, layout, axes = fitted.parameters.names, fitted.data.layout, fitted.axes
    motors = range(1, layout.rotors + 1)
    lag = "T_motor" in names
    speeds = [f"x_{i}" if lag else f"motor_{i}" for i in motors]
    equations = [f"T_motor*x_{i}' = -x_{i} + motor_{i}" for i in motors] if lag else []
    arms, torque = layout.moment_arms, layout.torque_axes
    levers = {"p": arms[0], "q": arms[1], "r": torque[2]}
    for axis in axes:
        terms = " + ".join(
            f"({lever!r})*{speed}" for lever, speed in zip(levers[axis].tolist(), speeds, strict=True) if lever
        )
        spin_up = "".join(
            f" - ({lever!r})*J_r/I_zz*{speed}'"
            for lever, speed in zip(levers[axis].tolist(), speeds, strict=True)
            if axis == "r" and lag and "J_r" in names
        )
        equations.append(f"{axis}'{spin_up} = {axis}_thrust*({terms})")
    inflow = "c_lambda" in names
    equations.append(f"w' = {'Z_w*w ' if inflow else ''}- az_thrust*({' + '.join(speeds)})")
    slope = " + ".join(
        term for name, term in (("c_1", "c_1"), ("c_2", "2*c_2*x_0"), ("c_lambda", "(-c_lambda)*v_0")) if name in names
    )
    states = [*(speeds if lag else []), *axes, "w"]
    lines = [
        'schema = "rotorid.model/1"',
        'name = "physical.flight"',
        'source = "motors to rates and specific force, linear about hover in still air"',
        f"inputs = [{', '.join(_quoted(f'motor_{i}') for i in motors)}]",
        f"states = [{', '.join(map(_quoted, states))}]",
        "equations = [",
        *(f"    {_quoted(equation)}," for equation in equations),
        "]",
        f"outputs = [{', '.join(map(_quoted, (*axes, 'az = w' + chr(39))))}]",
        "[constants]",
        f"x_0 = {fitted.fit.hover.speed!r}",
        f"v_0 = {fitted.fit.hover.induced_m_s!r}",
        *_tables(fitted, slope),
    ]
    return from_toml("\n".join(lines), where="the hover model")


def _tables(fitted: FittedFlight, slope: str) -> list[str]:
    names, axes, rotors = fitted.parameters.names, fitted.axes, fitted.data.layout.rotors
    used = {"m", "c_1", "c_2", "c_lambda", "T_motor"}
    used |= {name for axis in axes for name in _MOMENTS[axis].removeprefix("1/").split("/")}
    used |= {"J_r"} if "r" in axes and "T_motor" in names else set()
    lines: list[str] = []
    for parameter in fitted.parameters:
        if parameter.name in used:
            lines += [
                f"[parameters.{parameter.name}]",
                f"value = {parameter.value!r}",
                f'unit = "{parameter.unit}"',
                *(['status = "fixed"'] if parameter.status != "free" else []),
            ]
    tied = {f"{axis}_thrust": f"({slope})*{_MOMENTS[axis]}".replace("*1/", "/") for axis in axes}
    tied["az_thrust"] = f"({slope})/m"
    if "c_lambda" in names:
        tied["Z_w"] = f"(-{0.5 * rotors!r})*c_lambda*x_0/m"
    units = {"p_thrust": "rad/(m s^2)", "q_thrust": "rad/(m s^2)", "r_thrust": "rad/s^2", "az_thrust": "m/s^2"}
    for name, expression in tied.items():
        lines += [f"[parameters.{name}]", f'tied = "{expression}"', f'unit = "{units.get(name, "1/s")}"']
    return lines


def _quoted(text: str) -> str:
    return f'"{text}"'
