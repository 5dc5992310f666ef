"""A fit of ``physical.motors`` on the page: the vehicle in numbers and pictures, its flights, unseen stretches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.data.axes import AXIS_WORDS
from rotorid.data.quantity import MISSING, milliseconds, significant, unit, with_error
from rotorid.documents.result import ResultDocument
from rotorid.fits.motors.motion import CHANNELS
from rotorid.fitting.motors.excitation import LEAST_CORRELATION
from rotorid.models.flight import CURVE_TERMS, speeds_of_outputs
from rotorid.plot.figure import quantity
from rotorid.plot.motors import made_by_motors, rotor_layout, thrust_curve
from rotorid.report.frame import Picture, drawn
from rotorid.report.parts import Shown, points_of
from rotorid.report.words import (
    FULL_OUTPUT,
    motor_warnings,
    no_lag,
    open_questions,
    percent_verdict,
    prediction_verdict,
    scale_sentence,
    status_word,
)
from rotorid.results.summary import Correlation, ExcitedFlight, MotorPhysics, ParameterEstimate
from rotorid.results.verdicts import Verdict
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.verification.verification import Scores

_NAMES = {"m": "Mass", "I_xx": "Roll inertia", "I_yy": "Pitch inertia", "I_zz": "Yaw inertia"}
_STATUS = {"fixed": "given", "tied": "computed from the others", "free": ""}
_WAYS = {"x": "forward", "y": "right"}


@dataclass(frozen=True, kw_only=True, slots=True)
class VehicleRow:
    """A property of the vehicle; ``known`` is false where the flight does not determine it."""

    words: str
    symbol: str
    value: str
    unit: str
    note: str = ""
    known: bool = True


@dataclass(frozen=True, kw_only=True, slots=True)
class ExcitationRow:
    """A stretch: when, how fast, and each axis as correlation and as share of its motion that is explained."""

    record: str
    interval: str
    rate: str
    axes: tuple[tuple[str, Verdict | None], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class UnseenRow:
    """A channel of an unseen stretch."""

    where: str
    channel: str
    verdict: Verdict
    tic: str
    fit: str
    rms: str


def vehicle_rows(document: ResultDocument, motors: MotorPhysics) -> tuple[VehicleRow, ...]:
    """Mass, inertia, thrust, lag and torque, with deviations and units, and whether each was given or found."""
    return (
        *_body(document, motors),
        *_thrust(document, motors),
        *_lag(document, motors),
        *_torque(document),
        *_drag(document),
    )


def _body(document: ResultDocument, motors: MotorPhysics) -> Iterator[VehicleRow]:
    axes = {"I_xx": "p", "I_yy": "q", "I_zz": "r"}
    for name, words in _NAMES.items():
        found = document.parameters.get(name)
        if found is None:
            yield VehicleRow(
                words=words, symbol=name, value=MISSING, unit="", note=_missing(motors, axes[name]), known=False
            )
        elif name == "m" and motors.scale is None:
            yield VehicleRow(
                words=words, symbol=name, value="1", unit="kg", note="assumed; multiply thrust and inertia by your mass"
            )
        else:
            status = status_word(document, name)
            note = _STATUS.get(status, status)
            per = name in ("I_xx", "I_yy") and motors.arm_m is None
            yield _row(words, name, found, note=note or ("for an arm of 1 m" if per else ""))


def _missing(motors: MotorPhysics, axis: str) -> str:
    if any(axis in flight.counted for flight in motors.excitation):
        return "only kappa / I_zz is known"
    return f"{AXIS_WORDS[axis]} was not excited"


def _row(words: str, symbol: str, found: ParameterEstimate, *, note: str = "") -> VehicleRow:
    return VehicleRow(
        words=words, symbol=symbol, value=with_error(found.value, found.std), unit=unit(found.unit), note=note
    )


def _thrust(document: ResultDocument, motors: MotorPhysics) -> Iterator[VehicleRow]:
    speed = motors.outputs == "speed"
    hover = f"{significant(motors.hover_output)}{' rad/s' if speed else ''}"
    hover = f"at the mean output, {hover}" if document.flight is None else f"at {hover}"
    highest = motors.flown_outputs[1]
    beyond = f"extrapolated, flown up to {significant(highest, digits=2)}" if highest < FULL_OUTPUT else ""
    labels = {
        "thrust_hover": ("Rotor thrust near hover", hover),
        "thrust_slope": ("Slope of thrust near hover", "per speed" if speed else "per output from 0 to 1"),
        "thrust_full": ("Rotor thrust at full output", beyond),
        "thrust_to_weight": ("Thrust to weight", beyond),
    }
    for name, (words, note) in labels.items():
        if (found := motors.derived.get(name)) is not None:
            value = with_error(found.value, found.std)
            yield VehicleRow(words=words, symbol="", value=value, unit=unit(found.unit), note=note)


def _lag(document: ResultDocument, motors: MotorPhysics) -> Iterator[VehicleRow]:
    lag = document.parameters.get("T_motor")
    if lag is not None:
        value = milliseconds(lag.value, lag.std)
        status = status_word(document, "T_motor")
        note = _STATUS.get(status, status)
        yield VehicleRow(words="Motor lag", symbol="T_motor", value=value, unit="ms", note=note)
    elif motors.outputs != "speed":
        yield VehicleRow(
            words="Motor lag", symbol="T_motor", value=MISSING, unit="", note=no_lag(document), known=False
        )


def _torque(document: ResultDocument) -> Iterator[VehicleRow]:
    found = document.parameters
    if "kappa" in found:
        note = _STATUS.get(found["kappa"].status, found["kappa"].status)
        yield _row("Rotor torque per thrust", "kappa", found["kappa"], note=note)
    elif "kappa_per_I_zz" in found:
        yield _row("Torque per thrust, over yaw inertia", "kappa_per_I_zz", found["kappa_per_I_zz"])
    if "h_per_I_zz" in found:
        yield _row("Angular momentum of a rotor, over yaw inertia", "h_per_I_zz", found["h_per_I_zz"])


def _drag(document: ResultDocument) -> Iterator[VehicleRow]:
    if document.flight is None:
        for name, words in (("X_u", "Drag forward, over mass"), ("Y_v", "Drag to the right, over mass")):
            if (found := document.parameters.get(name)) is not None:
                yield _row(words, name, found, note=_STATUS.get(found.status, found.status))


def _shown_axes(motors: MotorPhysics) -> dict[str, str]:
    """Axes of the table of excitations and their words; level ones where velocity is known."""
    known = {axis for flight in motors.excitation for axis in flight.correlation}
    return {**AXIS_WORDS, **{axis: words for axis, words in _WAYS.items() if axis in known}}


def excitation_rows(document: ResultDocument, motors: MotorPhysics) -> tuple[ExcitationRow, ...]:
    """Every stretch; an axis that counts has a verdict with the share of its slow motion that the motors explain."""
    records = document.records
    return tuple(
        ExcitationRow(
            record=flight.record,
            interval=f"{flight.start_s:.1f} to {flight.stop_s:.1f} s",
            rate=f"{significant(flight.sample_rate_hz, digits=4)} Hz",
            axes=tuple(_axis(flight, axis, records[row].fit_percent) for axis in _shown_axes(motors)),
        )
        for row, flight in enumerate(motors.excitation)
    )


def _axis(flight: ExcitedFlight, axis: str, percents: Mapping[str, float]) -> tuple[str, Verdict | None]:
    percent = percents.get(CHANNELS[axis])
    counted = axis in flight.counted and percent is not None
    correlation = f"{flight.correlation[axis]:.2f}" if axis in flight.correlation else MISSING
    return correlation, percent_verdict(percent) if counted and percent is not None else None


def unseen_rows(records: Mapping[str, Mapping[str, Scores]]) -> tuple[UnseenRow, ...]:
    """Every channel of every unseen stretch, in the units of paper."""
    return tuple(
        UnseenRow(
            where=where,
            channel=quantity(name).words,
            verdict=prediction_verdict(scores.tic, scores.nrmse_fit_percent),
            tic=significant(scores.tic, digits=2),
            fit=significant(scores.nrmse_fit_percent),
            rms=f"{significant(quantity(name).factor * scores.rms)} {quantity(name).unit}",
        )
        for where, record in records.items()
        for name, scores in record.items()
    )


_POINTS = 201
_BEYOND = 1.15
_OUTPUTS = {
    "output": "motor outputs from 0 to 1",
    "thrust_demand": "thrust commands of the mixer to each motor, from 0 to 1",
    "speed": "measured speeds",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Stretch:
    """A stretch with its picture."""

    title: str
    picture: Picture


@dataclass(frozen=True, kw_only=True, slots=True)
class MotorsShown:
    """What the page shows of motors, rotors and thrust."""

    warnings: tuple[str, ...]
    scale: str
    rows: tuple[VehicleRow, ...]
    open: tuple[str, ...]
    source: str
    layout: Picture
    curve: Picture
    axes: tuple[str, ...]
    excitation: tuple[ExcitationRow, ...]
    least: str
    flights: tuple[Stretch, ...]
    unseen: tuple[UnseenRow, ...]
    unseen_flights: tuple[Stretch, ...]

    @property
    def pictures(self) -> tuple[Picture, ...]:
        """All of its figures."""
        stretches = (*self.flights, *self.unseen_flights)
        return (self.layout, self.curve, *(stretch.picture for stretch in stretches))


def motors_shown(shown: Shown, *, key: str) -> MotorsShown | None:
    """What the page shows of a fit of ``physical.motors``; nothing for another model.

    Parameters
    ----------
    key
        Prefix of the identifiers of its pictures.
    """
    document = shown.document
    motors = document.motors
    if motors is None:
        return None
    return MotorsShown(
        warnings=motor_warnings(document),
        scale=scale_sentence(document),
        rows=vehicle_rows(document, motors),
        open=open_questions(document),
        source=_source(motors),
        layout=Picture(
            key=f"{key}-layout",
            description=f"{len(motors.spins)} rotors from above with motor numbers",
            figure=drawn(
                rotor_layout, np.array(motors.rotors), np.array(motors.spins), in_meters=motors.arm_m is not None
            ),
        ),
        curve=_curve(document, motors, key=f"{key}-curve"),
        axes=tuple(_shown_axes(motors).values()),
        excitation=excitation_rows(document, motors),
        least=f"{LEAST_CORRELATION:g}",
        flights=_flights(shown, motors, key),
        unseen=unseen_rows(document.verification.records),
        unseen_flights=_unseen(shown, motors, key),
    )


def _source(motors: MotorPhysics) -> str:
    rate = significant(motors.outputs_rate_hz, digits=4)
    return (
        f"Motors: {_OUTPUTS.get(motors.outputs, motors.outputs)}, from {motors.source} at {rate} Hz. {motors.layout}."
    )


def _curve(document: ResultDocument, motors: MotorPhysics, *, key: str) -> Picture:
    speed = motors.outputs == "speed"
    outputs = np.linspace(
        0.0, _BEYOND * motors.flown_outputs[1] if speed else max(1.0, motors.flown_outputs[1]), _POINTS
    )
    thrust_n, std_n = curve_with_error(document, outputs)
    mass = document.parameters["m"].value
    return Picture(
        key=key,
        description="Thrust of a rotor over its output, with one standard deviation and the outputs that were flown",
        figure=drawn(
            thrust_curve,
            outputs,
            thrust_n,
            std_n,
            flown=motors.flown_outputs,
            hover=motors.hover_output,
            weight_n=mass * STANDARD_GRAVITY_M_S2 / len(motors.spins),
            axis="Motor speed [rad/s]" if speed else "Motor output",
        ),
    )


def curve_with_error(document: ResultDocument, outputs: FloatArray) -> tuple[FloatArray, FloatArray]:
    r"""Thrust of a rotor and its standard deviation, both of the shape of the outputs.

    .. math:: \sigma^2(x) = \sum_{ij} x^i x^j \, \mathrm{Cov}(c_i, c_j)

    With inflow it is that of hover: the induced velocity grows with the output, so that inflow counts as a square too.

    Parameters
    ----------
    document
        A result with ``c_0``, ``c_1``, ``c_2``, or some of them, and the correlation of what is free.
    outputs
        Shape ``(n,)``.
    """
    rows = {name: outputs**power for power, name in enumerate(CURVE_TERMS)}
    if (flight := document.flight) is not None:
        induced, speed = (flight.hover[name].value for name in ("induced_velocity", "speed"))
        values = {name: estimate.value for name, estimate in document.parameters.items()}
        rows["c_lambda"] = -(speeds_of_outputs(values, outputs) ** 2) * induced / speed
    found = {name: document.parameters[name] for name in rows if name in document.parameters}
    thrust_n = np.zeros(outputs.shape)
    for name, estimate in found.items():
        thrust_n = thrust_n + estimate.value * rows[name]
    free = [name for name, estimate in found.items() if estimate.std]
    if not free:
        return thrust_n, np.zeros(outputs.shape)
    deviations = np.stack([(found[name].std or 0.0) * rows[name] for name in free])
    variance = np.einsum("in,ij,jn->n", deviations, _correlation(document.correlation, free), deviations)
    return thrust_n, np.sqrt(np.maximum(variance, 0.0))


def _correlation(known: Correlation | None, names: Sequence[str]) -> FloatArray:
    if known is None or not set(names) <= set(known.names):
        return np.eye(len(names))
    places = [known.names.index(name) for name in names]
    return np.array(known.matrix, dtype=np.float64)[np.ix_(places, places)]


def _flights(shown: Shown, motors: MotorPhysics, key: str) -> tuple[Stretch, ...]:
    """Stretches with the channels that count; one that excites nothing shows only noise and is left out."""
    document = shown.document
    kept = []
    for number, (simulated, record) in enumerate(zip(shown.data.simulated, document.records, strict=True)):
        rows = [row for row, name in enumerate(document.outputs) if name in record.fit_percent]
        if rows:
            kept.append((number, simulated, rows))
    numbers = sum(simulated.inputs.shape[0] + 2 * len(rows) for _, simulated, rows in kept)
    return tuple(
        Stretch(
            title=f"{simulated.record}, {simulated.time_s[0]:.1f} to {simulated.time_s[-1]:.1f} s",
            picture=Picture(
                key=f"{key}-flight-{number}",
                description=f"Measured and predicted accelerations, and the motors, in {simulated.record}",
                figure=drawn(
                    made_by_motors,
                    simulated.time_s,
                    simulated.inputs,
                    simulated.measured[rows],
                    simulated.simulated[rows],
                    motor_names=document.inputs,
                    channels=[document.outputs[row] for row in rows],
                    held=motors.outputs != "speed",
                    most=points_of(numbers),
                ),
            ),
        )
        for number, simulated, rows in kept
    )


def _unseen(shown: Shown, motors: MotorPhysics, key: str) -> tuple[Stretch, ...]:
    stretches = [verification for verification in shown.verifications.maneuvers if verification.moved]
    numbers = sum(verification.inputs.shape[0] + 2 * len(verification.moved) for verification in stretches)
    found = []
    for number, verification in enumerate(stretches):
        rows = [verification.output_names.index(name) for name in verification.moved]
        picture = Picture(
            key=f"{key}-unseen-{number}",
            description=(f"Measured and predicted accelerations, and the motors, in {verification.record}, unseen"),
            figure=drawn(
                made_by_motors,
                verification.time_s,
                verification.inputs,
                verification.measured[rows],
                verification.predicted[rows],
                motor_names=verification.input_names,
                channels=verification.moved,
                held=motors.outputs != "speed",
                most=points_of(numbers),
            ),
        )
        title = f"{verification.record}, {verification.time_s[0]:.1f} to {verification.time_s[-1]:.1f} s"
        found.append(Stretch(title=title, picture=picture))
    return tuple(found)
