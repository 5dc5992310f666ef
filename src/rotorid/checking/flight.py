"""The physics of flight on logs that it was not identified on.

Motors, rates and the velocity through the air of each moment go in; force and moment come out, and are compared with
accelerometer and gyro in N and N m, per axis. Nothing of the vehicle is adjusted but where its battery sits: of each
log, the wind, the skew between the clocks of motors and gyro, and the center of gravity are found. From states of the
log, the motors alone then fly the vehicle over half a second; position, velocity, attitude and rates are compared with
the log, and with a state that is kept.

``simulate`` flies whole logs so, begun anew every half second. Where a flight leaves the range of those that were
fitted (airspeed, climb, load factor, rotor speed), a finding says for how long.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, ClassVar, NamedTuple

import numpy as np

from rotorid.checking.predictions import Simulation
from rotorid.checking.rotors import (
    Checked,
    RotorPredictor,
    consistent,
    judged_scores,
    known_layout,
    known_parameters,
    place_of,
    poor_predictions,
)
from rotorid.data.axes import ATTITUDE, AXIS_WORDS, RATES
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, Maneuver, MotorRecord
from rotorid.errors import InsufficientDataError
from rotorid.fitting.flight.fit import FlightChoices, FlightRange
from rotorid.fitting.flight.ladder import wind_of
from rotorid.fitting.flight.moment import center_of, turned_axes
from rotorid.fitting.flight.motion import Motion, VelocityClass, motion, rotor_speeds, velocity_class
from rotorid.fitting.motors.excitation import SLOW_BAND_HZ, in_band
from rotorid.flights.flight_data import FlightMotion, flight_data
from rotorid.flights.flight_faults import wind_or_bias
from rotorid.flights.motor_data import MotorFlight
from rotorid.frames import euler_from_quaternion
from rotorid.models.families import FLIGHT
from rotorid.models.flight import Airframe
from rotorid.results.model import IdentifiedModel
from rotorid.settings.flying import FlySettings
from rotorid.signal.kinematics import ACCELERATIONS, VELOCITIES
from rotorid.typing import FloatArray
from rotorid.verification.flight import (
    USUAL_OUTSIDE_PERCENT,
    FlightJudgement,
    FlightLoads,
    differences,
    flight_loads_of,
    load_errors,
    outside_range,
    percents,
)
from rotorid.verification.multistep import (
    FlightState,
    StepErrors,
    measured_states,
    pieces,
    slower,
    step_errors,
    stride,
    to_body,
)
from rotorid.verification.verification import Scores, Verification

_AHEAD_S = 0.5
"""How far motors alone predict a flight, and the length of the pieces of a flown log unless the user chose it.
Without its controller, an airframe turns any error of torque into a tilt that grows with time squared."""

_AHEAD_STEP_S = 0.01
_FLY_STEP_S = 0.02

_MOVED_M_S2 = 0.5
"""Standard deviation of a slow specific force from which a flight judges what the model makes of it."""


_BY_CHANCE = -2.0 * float(np.log(0.05))
"""Squares of two numbers over their variances, in sum, that one of twenty exceeds if both are zero."""


class _Stretch(NamedTuple):
    """A stretch with what was found of it: motion that drives the model, loads, wind, stamps, center of gravity."""

    flight: MotorFlight
    driven: Motion
    loads: FlightLoads
    wind: FloatArray | None
    skew_s: float
    center: Mapping[str, float]


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightPredictor(RotorPredictor):
    """A vehicle with its air, for predictions of a flight.

    Parameters
    ----------
    airframe
        Rotors, mass, discs and air.
    velocity
        How the velocity was had in the fit.
    tested
        What the fitted flights covered; ``None`` where that is not known.
    bands_hz
        Rate to the band in which the motors explain it: there its acceleration judges the model.
    windy
        Whether the fit gave each flight a wind of its own. Then any wind of a log is taken out, else one that is clear.
    cutoff_hz
        Of the low-pass that stands for an unknown filter of the accelerometer.
    """

    model: ClassVar[str] = FLIGHT.name
    needed: ClassVar[str] = "motors, gyros and accelerometer of the vehicle, and ten seconds in the air"

    airframe: Airframe
    velocity: VelocityClass
    tested: FlightRange | None = None
    bands_hz: Mapping[str, tuple[float, float]]
    windy: bool = False
    cutoff_hz: float | None = None
    scaled: bool = True

    def check(self, record: FlightRecord, segments: Sequence[Maneuver]) -> Checked:
        """Force and moment of each stretch, with what it lacks and where it leaves the identified range."""
        data = self.data(record, segments)
        stretches = self._stretches(data)
        checks = [self._verification(stretch) for stretch in stretches]
        findings = [*data.findings]
        for stretch, check in zip(stretches, checks, strict=True):
            findings += _remarks(stretch, check)
        for stretch in stretches:
            findings += self._velocity_remarks(stretch.flight)
        return Checked([(stretch.flight, check) for stretch, check in zip(stretches, checks, strict=True)], findings)

    def simulations(self, record: FlightRecord, settings: FlySettings) -> tuple[list[Simulation], list[Finding]]:
        """Attitude, velocity and rates by the motors alone, begun anew at the measured state every half second."""
        data = self.data(record, settings.segments)
        length_s = settings.pieces_s or _AHEAD_S
        simulated, said = [], [*data.findings]
        for stretch in self._stretches(data):
            said += _beyond(stretch.flight, self._outside(stretch))
            simulated.append(self._simulation(stretch, length_s))
        message = (
            f"The motors alone fly the vehicle through the log, restarted at the measured state every {length_s:.2g} s."
        )
        return simulated, [*said, remark("flown_in_pieces", FLIGHT.name, message, length_s=length_s)]

    def data(self, record: FlightRecord, segments: Sequence[Maneuver]) -> FlightMotion:
        """A log as for a fit, see :meth:`rotorid.checking.rotors.RotorPredictor.read`."""
        return self.read(flight_data, record, segments)

    def _stretches(self, data: FlightMotion) -> list[_Stretch]:
        pairs = zip(data.motors.stretches, data.skews_s, strict=True)
        return [self._judged(flight, skew_s) for flight, skew_s in pairs]

    def _judged(self, flight: MotorFlight, skew_s: float) -> _Stretch:
        """A stretch in its wind, with the loads that the model makes of it."""
        values = self.parameters.values
        kind = self._velocity(flight.record)
        wind = self._wind(flight.record, kind, skew_s)
        driven = motion(flight.record, values, kind=kind, wind=wind, skew_s=skew_s)
        center = center_of(values, self.airframe, flight.record, driven)
        loads = flight_loads_of({**values, **center}, self.airframe, flight.record, driven, cutoff_hz=self.cutoff_hz)
        return _Stretch(flight, driven, loads, wind, skew_s, center)

    def _wind(self, record: MotorRecord, kind: VelocityClass, skew_s: float) -> FloatArray | None:
        """Wind of a log, toward north and east, m/s; ``None`` where it has none or does not show it.

        Calm fits do not make a calm log. Next to them, a wind has to do what it has to in a fit, and to push more than
        a bias of the accelerometer could: at one heading, that would be all that a log without wind shows.
        """
        if kind != "measured" or not record.attitude.size:
            return None
        wind, std = wind_of(
            self.parameters.values,
            self.airframe,
            record,
            kind=kind,
            cutoff_hz=self.cutoff_hz,
            skew_s=skew_s,
            least_gain=0.0 if self.windy else FlightChoices().least_gain,
        )
        if not np.isfinite(wind).all():
            return None
        by_chance = not self.windy and not float(((wind / std) ** 2).sum()) > _BY_CHANCE
        return None if by_chance else wind

    def _velocity(self, record: MotorRecord) -> VelocityClass:
        """How the velocity of a log is had: as in the fit, or as well as this log allows."""
        return velocity_class([record], self.velocity)

    def _velocity_remarks(self, flight: MotorFlight) -> list[Finding]:
        """That a log lacks the velocity which the fitted flights had."""
        kind = self._velocity(flight.record)
        if kind == self.velocity:
            return []
        where = place_of(flight)
        if kind == "attitude":
            message = f"{where} has no velocity: it was integrated from attitude and accelerometer."
            return [remark("velocity_from_attitude", where, message)]
        message = (
            f"{where} has neither velocity nor attitude: force and moment are compared as if it had hovered, and "
            "airspeed with no range. Log the attitude."
        )
        return [warn("velocity_from_attitude", where, message)]

    def _outside(self, stretch: _Stretch) -> tuple[float | None, dict[str, float]]:
        if self.tested is None:
            return None, {}
        known = self._velocity(stretch.flight.record) != "none"
        return percents([outside_range(self.tested, stretch.flight.record, stretch.driven, velocity_known=known)])

    def _verification(self, stretch: _Stretch) -> Verification:
        record = stretch.flight.record
        rows = {**self._forces(stretch), **self._accelerations(stretch)}
        outside_percent, outside = self._outside(stretch)
        turning = turned_axes(self.parameters.values, self.airframe, record, stretch.driven)
        moved = tuple(
            name
            for name, (measured, _) in rows.items()
            if (measured.std() >= _MOVED_M_S2 if name in ACCELERATIONS else name.removesuffix("_dot") in turning)
        )
        return Verification(
            record=record.name,
            maneuver=replace(stretch.flight.maneuver, start_s=record.start_s, stop_s=float(record.time_s[-1])),
            time_s=record.time_s,
            inputs=record.outputs - record.outputs.mean(axis=1, keepdims=True),
            measured=np.stack([measured for measured, _ in rows.values()]),
            predicted=np.stack([modeled for _, modeled in rows.values()]),
            input_names=self.inputs,
            output_names=tuple(rows),
            scores={name: Scores.plain(*rows[name]) for name in rows},
            moved=moved or ("az",),
            flight=FlightJudgement(
                samples=record.samples,
                errors=load_errors(*(differences([stretch.loads]) if self.scaled else ({}, {}))),
                outside_percent=outside_percent,
                outside=outside,
                ahead=self._ahead(stretch),
                wind=None if stretch.wind is None else (float(stretch.wind[0]), float(stretch.wind[1])),
                skew_s=stretch.skew_s,
                center=dict(stretch.center),
            ),
        )

    def _forces(self, stretch: _Stretch) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Slow specific force along each axis, measured and modeled."""
        rate_hz, mass = stretch.flight.record.sample_rate_hz, self.airframe.mass_kg
        measured, modeled = (
            in_band(rows / mass, SLOW_BAND_HZ, rate_hz)
            for rows in (stretch.loads.measured_force, stretch.loads.modeled_force)
        )
        return {name: (measured[row], modeled[row]) for row, name in enumerate(ACCELERATIONS)}

    def _accelerations(self, stretch: _Stretch) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Angular acceleration in the bands in which the motors explain it, measured and modeled."""
        rate_hz, found = stretch.flight.record.sample_rate_hz, {}
        for row, axis in enumerate(stretch.loads.axes):
            if axis in self.bands_hz:
                both = (stretch.loads.measured_turning[row], stretch.loads.modeled_turning[row])
                measured, modeled = (in_band(turning, self.bands_hz[axis], rate_hz) for turning in both)
                found[f"{axis}_dot"] = (measured, modeled)
        return found

    def _ahead(self, stretch: _Stretch) -> StepErrors | None:
        """Predictions over half a second, where the log has states and the model an inertia."""
        record = stretch.flight.record
        if not record.velocity.size or not record.attitude.size or not stretch.loads.axes:
            return None
        step_s = 1.0 / record.sample_rate_hz
        if record.duration_s < 2.0 * _AHEAD_S:
            return None
        states, speeds = slower(_states(stretch), stretch.driven.speeds, step_s=step_s, least_s=_AHEAD_STEP_S)
        step_s *= stride(step_s, _AHEAD_STEP_S)
        return step_errors(
            {**self.parameters.values, **stretch.center},
            self.airframe,
            states,
            speeds,
            step_s=step_s,
            steps=round(_AHEAD_S / step_s),
            wind=stretch.wind,
        )

    def _simulation(self, stretch: _Stretch, length_s: float) -> Simulation:
        record = stretch.flight.record
        if not record.attitude.size:
            raise InsufficientDataError(
                f"{record.name} has no attitude", needed="roll, pitch and heading, in which a flight begins"
            )
        if not stretch.loads.axes:
            raise InsufficientDataError("none of its inertias was identified", needed="motion in roll, pitch or yaw")
        step_s = 1.0 / record.sample_rate_hz
        every = stride(step_s, _FLY_STEP_S)
        logged = _states(stretch)
        states, _ = slower(logged, stretch.driven.speeds, step_s=step_s, least_s=_FLY_STEP_S)
        time_s = record.time_s[::every]
        count = max(1, round((time_s[-1] - time_s[0]) / length_s))
        starts = tuple(int(edge) for edge in np.linspace(0, time_s.size, count + 1).round()[:-1])

        def outputs_at(values: Mapping[str, float]) -> FloatArray:
            known = {name: values.get(name, value) for name, value in self.parameters.values.items()}
            turning = rotor_speeds(record, known, skew_s=stretch.skew_s)
            _, speeds = slower(logged, turning, step_s=step_s, least_s=_FLY_STEP_S)
            flown = pieces(
                {**known, **stretch.center},
                self.airframe,
                states,
                speeds,
                step_s=every * step_s,
                starts=starts,
                wind=stretch.wind,
            )
            return _outputs(flown)

        measured = _outputs(states)
        if not record.velocity.size:
            measured[len(ATTITUDE) : len(ATTITUDE) + len(VELOCITIES)] = np.nan
        return Simulation(
            record=record.name,
            maneuver=stretch.flight.maneuver,
            time_s=time_s,
            inputs=record.outputs[:, ::every],
            measured=measured,
            input_names=self.inputs,
            output_names=(*ATTITUDE, *VELOCITIES, *RATES),
            outputs_at=outputs_at,
            starts=starts,
            held=record.between == "held",
        )


def _states(stretch: _Stretch) -> FlightState:
    """States of a stretch; the velocity is that which drives the model where none was logged."""
    record = stretch.flight.record
    velocity = record.velocity if record.velocity.size else stretch.driven.velocity
    return measured_states(record.attitude, velocity, record.rates, step_s=1.0 / record.sample_rate_hz)


def _outputs(states: FlightState) -> FloatArray:
    """Roll, pitch, heading, velocity in body axes and rates, shape ``(9, n)``."""
    angles = euler_from_quaternion(states.attitude)
    angles[2] = np.unwrap(angles[2])
    return np.concatenate([angles, to_body(states.attitude, states.velocity), states.rates])


def _remarks(stretch: _Stretch, check: Verification) -> list[Finding]:
    """Findings on a stretch: it leaves the identified range, or an axis is predicted poorly."""
    where = place_of(stretch.flight)
    judged = check.flight
    beyond = _beyond(stretch.flight, (judged.outside_percent, dict(judged.outside))) if judged else []
    headings = stretch.flight.record.attitude[2] if stretch.wind is not None else None
    return [
        *beyond,
        *(wind_or_bias(float(np.ptp(np.unwrap(headings))), where) if headings is not None else ()),
        *_unjudged(where, check),
        *poor_predictions(where, judged_scores(check)),
    ]


def _unjudged(where: str, check: Verification) -> list[Finding]:
    """Which outputs do not judge the vehicle in a stretch, and why; none where all do."""
    still, idle = [], []
    for name, measured in zip(check.output_names, check.measured, strict=True):
        if name in check.moved:
            continue
        if name in ACCELERATIONS:
            still.append(f"{name} by {measured.std():.2g} m/s²")
        else:
            idle.append(AXIS_WORDS[name.removesuffix("_dot")])
    reasons = [
        *([f"slow motion varies {listed(still)} only ({_MOVED_M_S2:g} needed)"] if still else []),
        *([f"the motors do not explain {listed(idle)}"] if idle else []),
    ]
    if not reasons:
        return []
    names = listed([name for name in check.output_names if name not in check.moved])
    message = f"{where} does not judge {names}: {'; '.join(reasons)}."
    return [remark("not_verified", where, message)]


_RANGES = {"airspeed": "airspeed", "climb": "climb rate", "load": "load factor", "motors": "rotor speed"}


def _beyond(flight: MotorFlight, outside: tuple[float | None, dict[str, float]]) -> list[Finding]:
    share, each = outside
    return [] if share is None else range_findings(place_of(flight), share, each)


def range_findings(where: str, share: float, each: Mapping[str, float]) -> list[Finding]:
    """A warning where a flight spends longer outside of the identified range than those that were fitted.

    Parameters
    ----------
    where
        The flight.
    share, each
        Percent of its time outside of any range, and of each.
    """
    if share <= USUAL_OUTSIDE_PERCENT:
        return []
    named = ", ".join(
        f"{_RANGES[name]} {percent:.0f} %"
        for name, percent in sorted(each.items(), key=lambda item: -item[1])
        if percent >= 1.0
    )
    message = (
        f"{where} is outside of the identified range for {share:.0f} % of the time ({named}). There the model "
        "extrapolates: identify it on such a flight too."
    )
    return [warn("beyond_range", where, message, outside_percent=share, **each)]


def known_flight(table: Mapping[str, Any]) -> FlightPredictor:
    """The vehicle of a ``result.json`` of ``physical.flight``.

    Parameters
    ----------
    table
        With its ``parameters``, its ``motors`` and its ``flight``.

    Raises
    ------
    UsageError
        Something of it is missing or is no number.
    """
    with consistent("flight"):
        motors, air = table["motors"], table["flight"]
        layout, parameters = known_layout(motors), known_parameters(table)
        limits = air["limits"]
        return FlightPredictor(
            parameters=parameters,
            airframe=Airframe(
                positions=layout.positions,
                spins=layout.spins,
                mass_kg=parameters.values.get("m", 1.0),
                disc_m2=float(air["disc_m2"]),
                density_kg_m3=float(air["density_kg_m3"]),
            ),
            layout=layout,
            kind=str(motors["outputs"]),
            velocity=air["velocity"],
            tested=FlightRange(
                *(_span(limits[name]) for name in ("edge_m_s", "climb_m_s", "motors", "load")),
            ),
            bands_hz=torque_bands(
                (str(octave["axis"]), float(octave["low_hz"]), float(octave["high_hz"]))
                for octave in air.get("octaves") or ()
                if octave["fitted"]
            ),
            windy=any(log.get("wind_m_s") for log in air.get("logs") or ()),
            cutoff_hz=air.get("cutoff_hz"),
            scaled=motors["scale"] is not None,
            reference_v=motors.get("reference_v"),
        )


def _span(pair: Sequence[float]) -> tuple[float, float]:
    low, high = pair
    return float(low), float(high)


def torque_bands(octaves: Iterable[tuple[str, float, float]]) -> dict[str, tuple[float, float]]:
    """Rate to the band of the octaves (rate, low, high in Hz) in which its torque was fitted.

    Examples
    --------
    >>> torque_bands([("p", 2.0, 4.0), ("p", 4.0, 8.0), ("r", 2.0, 4.0)])
    {'p': (2.0, 8.0), 'r': (2.0, 4.0)}
    """
    found: dict[str, tuple[float, float]] = {}
    for axis, low, high in octaves:
        least, most = found.get(axis, (low, high))
        found[axis] = (min(least, low), max(most, high))
    return found


def identified_flight(model: IdentifiedModel) -> FlightPredictor | None:
    """The vehicle of an identified model; ``None`` for one that is not of ``physical.flight``."""
    if model.motors is None or model.flight is None:
        return None
    parameters = {name: asdict(estimate) for name, estimate in model.parameters.items()}
    return known_flight({"parameters": parameters, "motors": asdict(model.motors), "flight": asdict(model.flight)})
