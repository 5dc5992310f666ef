"""A fit of ``physical.flight`` on the page: the air of the vehicle in numbers and pictures, and what it rests on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rotorid.data.axes import AXIS_WORDS
from rotorid.data.quantities import QUANTITIES
from rotorid.data.quantity import MISSING, TWO_SIDED_95, Quantity, significant, unit, with_error
from rotorid.documents.result import ResultDocument
from rotorid.flights.tilt_drag import top_speed
from rotorid.models.flight import FLIGHT_PARAMETERS, flight_loads, speeds_of_outputs
from rotorid.plot.flight import drag_by_airspeed, thrust_in_air
from rotorid.report.frame import Picture, drawn
from rotorid.report.motors import VehicleRow
from rotorid.report.parts import Shown
from rotorid.report.words import status_word
from rotorid.results.summary import FlightPhysics, MotorPhysics, airframe_of
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_POINTS = 101
_BEYOND = 1.15
_IN_TABLES = ("m", "I_xx", "I_yy", "I_zz", "kappa", "T_motor")
"""Parameters that the table of the vehicle shows."""

_VELOCITY = {
    "measured": "Velocity was logged",
    "attitude": "Velocity was integrated from attitude and accelerometer",
    "none": "Neither velocity nor attitude was logged",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class LadderRow:
    """Terms that were tried together, the error of force without and with them, and the result."""

    terms: str
    before: str
    after: str
    result: str


@dataclass(frozen=True, kw_only=True, slots=True)
class LogRow:
    """A stretch: wind, skew and errors."""

    record: str
    interval: str
    wind: str
    skew: str
    force: str
    axes: str
    moment: str


@dataclass(frozen=True, kw_only=True, slots=True)
class FlightShown:
    """What the page shows of the air."""

    rows: tuple[VehicleRow, ...]
    source: str
    limits: str
    scatter: str
    ladder: tuple[LadderRow, ...]
    missing: tuple[tuple[str, str], ...]
    octaves: tuple[tuple[str, tuple[tuple[str, bool], ...]], ...]
    bands: tuple[str, ...]
    logs: tuple[LogRow, ...]
    predictor: str
    pictures: tuple[Picture, ...]


def flight_shown(shown: Shown, *, key: str) -> FlightShown | None:
    """What the page shows of a fit of ``physical.flight``; nothing for another model.

    Parameters
    ----------
    key
        Prefix of the identifiers of its pictures.
    """
    document = shown.document
    flight, motors = document.flight, document.motors
    if flight is None or motors is None:
        return None
    bands = tuple(dict.fromkeys((octave.low_hz, octave.high_hz) for octave in flight.octaves))
    return FlightShown(
        rows=air_rows(document, flight),
        source=_source(flight),
        limits=limits_sentence(flight, motors),
        scatter=_SCATTER.get(flight.scatter or "", ""),
        ladder=tuple(
            LadderRow(
                terms=", ".join(step.terms),
                before=significant(step.before_n),
                after=significant(step.after_n),
                result="used" if step.entered else f"left out: {step.why or 'no gain'}",
            )
            for step in flight.ladder
        ),
        missing=tuple(flight.missing.items()),
        octaves=tuple(_octaves(flight, bands)),
        bands=tuple(f"{low:g}–{high:g} Hz" for low, high in bands),
        logs=tuple(_logs(flight)),
        predictor=_predictor(flight),
        pictures=tuple(_pictures(document, flight, motors, key)),
    )


_SCATTER = {
    "flights": "± includes the scatter between these flights.",
    "assumed": (
        "± includes the usual scatter between flights, which one flight cannot show. Fly again at another speed."
    ),
}


def air_rows(document: ResultDocument, flight: FlightPhysics) -> tuple[VehicleRow, ...]:
    """Drag, inflow, flapping and the place of the accelerometer, with deviations and units."""
    found = []
    labels = {
        "drag": ("Drag of the rotors in hover, over mass", drag_words(flight)),
        "induced_velocity": ("Induced velocity in hover", "by momentum theory"),
    }
    for name, (words, note) in labels.items():
        if (number := flight.hover.get(name)) is not None:
            value = with_error(number.value, number.std or None)
            found.append(VehicleRow(words=words, symbol="", value=value, unit=unit(number.unit), note=note))
    for name, about in FLIGHT_PARAMETERS.items():
        estimate = document.parameters.get(name)
        if estimate is not None and name not in _IN_TABLES:
            value = with_error(estimate.value, estimate.std)
            status = status_word(document, name)
            note = {"fixed": "given", "assumed": f"assumed: {flight.missing.get(name)}"}.get(status, "")
            words = about.about[:1].upper() + about.about[1:]
            found.append(VehicleRow(words=words, symbol=name, value=value, unit=unit(estimate.unit), note=note))
    for name, why in flight.missing.items():
        if name in document.parameters:
            continue
        words = FLIGHT_PARAMETERS[name].about if name in FLIGHT_PARAMETERS else name
        words = words[:1].upper() + words[1:]
        found.append(VehicleRow(words=words, symbol=name, value=MISSING, unit="", note=why, known=False))
    return tuple(found)


def drag_words(flight: FlightPhysics) -> str:
    """The top speed at 30° that rotor drag alone allows; empty where drag is not surely there."""
    drag = flight.hover.get("drag")
    if drag is None or not drag.value > TWO_SIDED_95 * drag.std:
        return ""
    found = top_speed(Quantity.normal(drag.value, drag.std, drag.unit), flight.limits.edge_m_s[1])
    return f"top speed at 30° of tilt {QUANTITIES['top_speed_m_s'].shown(found)}"


def _source(flight: FlightPhysics) -> str:
    source = f" ({flight.velocity_source})" if flight.velocity_source else ""
    disc = f"{significant(flight.disc_m2)} m² a rotor{', assumed' if flight.disc_assumed else ''}"
    return f"{_VELOCITY[flight.velocity]}{source}. Area of the discs: {disc}."


def limits_sentence(flight: FlightPhysics, motors: MotorPhysics) -> str:
    """The range of the fitted flights."""
    limits = flight.limits
    speed = " rad/s" if motors.outputs == "speed" else " of the full speed"
    low, high = limits.motors
    return (
        f"Flown: airspeed along the discs up to {significant(limits.edge_m_s[1], digits=2)} m/s, "
        f"climb {significant(limits.climb_m_s[0], digits=2)} to {significant(limits.climb_m_s[1], digits=2)} m/s, "
        f"load factor {significant(limits.load[0], digits=2)} to {significant(limits.load[1], digits=2)}, "
        f"motors {significant(low, digits=4)} to {significant(high, digits=4)}{speed}. "
        "Beyond that the model extrapolates."
    )


def _octaves(
    flight: FlightPhysics, bands: tuple[tuple[float, float], ...]
) -> Iterator[tuple[str, tuple[tuple[str, bool], ...]]]:
    """Axis to the correlation of each octave, and whether it was used."""
    for axis, words in AXIS_WORDS.items():
        own = {(octave.low_hz, octave.high_hz): octave for octave in flight.octaves if octave.axis == axis}
        if own:
            yield (
                words,
                tuple(
                    (f"{own[band].correlation:.2f}", own[band].fitted) if band in own else (MISSING, False)
                    for band in bands
                ),
            )


def _logs(flight: FlightPhysics) -> Iterator[LogRow]:
    for log in flight.logs:
        stds = log.wind_std_m_s or (None, None)
        wind = (
            ", ".join(
                f"{with_error(value, std)} {toward}"
                for value, std, toward in zip(log.wind_m_s, stds, ("north", "east"), strict=True)
            )
            if log.wind_m_s
            else MISSING
        )
        yield LogRow(
            record=log.record,
            interval=f"{log.start_s:.1f} to {log.stop_s:.1f} s",
            wind=wind,
            skew=f"{1e3 * log.skew_s:.1f}" if log.skew_s else MISSING,
            force=significant(log.force_rms_n),
            axes=", ".join(f"{value:.2f}" for value in log.force_axes_n),
            moment=MISSING if log.moment_rms_nm is None else significant(1e3 * log.moment_rms_nm),
        )


def _predictor(flight: FlightPhysics) -> str:
    if not flight.predictor:
        return ""
    numbers = ", ".join(f"{name} {significant(value)}" for name, value in flight.predictor.items())
    return (
        f"These numbers predict this closed loop best over all frequencies: {numbers}. They contain the controller, "
        "are no properties of the vehicle, and are never exported."
    )


def _pictures(document: ResultDocument, flight: FlightPhysics, motors: MotorPhysics, key: str) -> Iterator[Picture]:
    speed = motors.outputs == "speed"
    highest = _BEYOND * motors.flown_outputs[1] if speed else max(1.0, motors.flown_outputs[1])
    speeds = np.linspace(0.0, highest, _POINTS)
    mass = document.parameters["m"].value
    yield Picture(
        key=f"{key}-thrust",
        description="Thrust of a rotor by its speed in hover, in climb and in fast flight",
        figure=drawn(
            thrust_in_air,
            speeds,
            thrust_by_flow(document, flight, motors, speeds),
            flown=motors.flown_outputs,
            weight_n=mass * STANDARD_GRAVITY_M_S2 / len(motors.spins),
            axis="Motor speed [rad/s]" if speed else "Motor output",
        ),
    )
    if flight.drag:
        columns = np.array(
            [(point.airspeed_m_s, point.measured_n, point.modeled_n, point.seconds) for point in flight.drag]
        ).T
        yield Picture(
            key=f"{key}-drag",
            description="Mean force against the airspeed along the discs, measured and modeled",
            figure=drawn(drag_by_airspeed, *columns),
        )


def thrust_by_flow(
    document: ResultDocument, flight: FlightPhysics, motors: MotorPhysics, speeds: FloatArray
) -> dict[str, FloatArray]:
    """Words for a flow to the mean thrust of a rotor in it, N: still air, the fastest climb, the fastest flight.

    Parameters
    ----------
    speeds
        Of the rotors, or outputs, shape ``(n,)``.
    """
    values = {name: estimate.value for name, estimate in document.parameters.items()}
    airframe = airframe_of(motors, flight, values["m"])
    # In descent faster than the induced velocity momentum theory has no answer, so no line is drawn for descent.
    edge, climb = flight.limits.edge_m_s[1], flight.limits.climb_m_s[1]
    flows = {"hover": (0.0, 0.0)}
    if climb >= 1.0:
        flows[f"climb at {climb:.2g} m/s"] = (0.0, -climb)
    if edge >= 1.0:
        flows[f"{edge:.2g} m/s along the discs"] = (edge, 0.0)
    still = np.zeros((3, speeds.size))
    turning = np.tile(speeds_of_outputs(values, speeds), (airframe.rotors, 1))
    found = {}
    for words, (ahead, down) in flows.items():
        velocity = np.tile(np.array([ahead, 0.0, down])[:, None], speeds.size)
        loads = flight_loads(values, airframe, speeds=turning, velocity=velocity, rates=still)
        found[words] = np.asarray(-loads.force[2] / airframe.rotors)
    return found
