"""A fit of ``physical.motors`` on the page: the vehicle in numbers and pictures, its flights, unseen ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotorid.fit.motor_excitation import LEAST_CORRELATION
from rotorid.pipeline.document import CorrelationDocument, ResultDocument
from rotorid.pipeline.identification import Identification
from rotorid.pipeline.motor_document import MotorsDocument
from rotorid.plot.motors import made_by_motors, rotor_layout, thrust_curve
from rotorid.report.motor_rows import (
    ExcitationRow,
    UnseenRow,
    VehicleRow,
    excitation_rows,
    unseen_rows,
    vehicle_rows,
)
from rotorid.report.motor_words import AXIS_WORDS, motor_warnings, open_questions, scale_sentence
from rotorid.report.numbers import significant
from rotorid.report.picture import Picture
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_POINTS = 201
_MOST_NUMBERS = 60_000
_LEAST_POINTS = 400
_BEYOND = 1.15
_TERMS = {"c_0": 0, "c_1": 1, "c_2": 2}
_OUTPUTS = {
    "output": "outputs to the motors, from 0 to 1",
    "thrust_demand": "thrust that the mixer demands of each motor, from 0 to 1",
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
        return (self.layout, self.curve, *(one.picture for one in stretches))


def motors_shown(identified: Identification, *, key: str) -> MotorsShown | None:
    """What to show of a fit of ``physical.motors``; nothing for another model.

    Parameters
    ----------
    identified
        What ``identify_motors`` found.
    key
        Prefix of the identifiers of its pictures.
    """
    document = identified.document
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
            description=f"{len(motors.spins)} rotors from above with the numbers of their motors",
            figure=rotor_layout(np.array(motors.rotors), np.array(motors.spins), in_meters=motors.arm_m is not None),
        ),
        curve=_curve(document, motors, key=f"{key}-curve"),
        axes=tuple(AXIS_WORDS.values()),
        excitation=excitation_rows(document, motors),
        least=f"{LEAST_CORRELATION:g}",
        flights=_flights(identified, motors, key),
        unseen=unseen_rows(document.verification.records),
        unseen_flights=_unseen(identified, motors, key),
    )


def _source(motors: MotorsDocument) -> str:
    rate = significant(motors.outputs_rate_hz, digits=4)
    return f"Motors: {_OUTPUTS.get(motors.outputs, motors.outputs)}, of {motors.source} at {rate} Hz. {motors.layout}."


def _curve(document: ResultDocument, motors: MotorsDocument, *, key: str) -> Picture:
    speed = motors.outputs == "speed"
    outputs = np.linspace(
        0.0, _BEYOND * motors.flown_outputs[1] if speed else max(1.0, motors.flown_outputs[1]), _POINTS
    )
    thrust_n, std_n = curve_with_error(document, outputs)
    mass = document.parameters["m"].value
    return Picture(
        key=key,
        description="Thrust of a rotor by its output, with one standard deviation and the outputs that were flown",
        figure=thrust_curve(
            outputs,
            thrust_n,
            std_n,
            flown=motors.flown_outputs,
            hover=motors.hover_output,
            weight_n=mass * STANDARD_GRAVITY_M_S2 / len(motors.spins),
            axis="Speed of the motor [rad/s]" if speed else "Output of the motor",
        ),
    )


def curve_with_error(document: ResultDocument, outputs: FloatArray) -> tuple[FloatArray, FloatArray]:
    r"""Thrust of a rotor and its standard deviation, both of the shape of the outputs.

    .. math:: \sigma^2(x) = \sum_{ij} x^i x^j \, \mathrm{Cov}(c_i, c_j)

    Parameters
    ----------
    document
        A result with ``c_0``, ``c_1``, ``c_2``, or some of them, and the correlation of what is free.
    outputs
        Shape ``(n,)``.
    """
    found = {name: document.parameters[name] for name in _TERMS if name in document.parameters}
    thrust_n = np.zeros(outputs.shape)
    for name, one in found.items():
        thrust_n = thrust_n + one.value * outputs ** _TERMS[name]
    free = [name for name, one in found.items() if one.std]
    if not free:
        return thrust_n, np.zeros(outputs.shape)
    deviations = np.stack([(found[name].std or 0.0) * outputs ** _TERMS[name] for name in free])
    variance = np.einsum("in,ij,jn->n", deviations, _correlation(document.correlation, free), deviations)
    return thrust_n, np.sqrt(np.maximum(variance, 0.0))


def _correlation(known: CorrelationDocument | None, names: Sequence[str]) -> FloatArray:
    if known is None or not set(names) <= set(known.names):
        return np.eye(len(names))
    places = [known.names.index(name) for name in names]
    return np.array(known.matrix, dtype=np.float64)[np.ix_(places, places)]


def _flights(identified: Identification, motors: MotorsDocument, key: str) -> tuple[Stretch, ...]:
    """Stretches with the channels that count; one that excites nothing shows only noise and is left out."""
    document = identified.document
    shown = []
    for number, (one, record) in enumerate(zip(identified.simulated, document.records, strict=True)):
        rows = [row for row, name in enumerate(document.outputs) if name in record.fit_percent]
        if rows:
            shown.append((number, one, rows))
    numbers = sum(one.inputs.shape[0] + 2 * len(rows) for _, one, rows in shown)
    return tuple(
        Stretch(
            title=f"{one.record}, {one.time_s[0]:.1f} to {one.time_s[-1]:.1f} s",
            picture=Picture(
                key=f"{key}-flight-{number}",
                description=f"Accelerations measured and made by the motors, and the motors, in {one.record}",
                figure=made_by_motors(
                    one.time_s,
                    one.inputs,
                    one.measured[rows],
                    one.simulated[rows],
                    motor_names=document.inputs,
                    channels=[document.outputs[row] for row in rows],
                    held=motors.outputs != "speed",
                    most=_most(numbers),
                ),
            ),
        )
        for number, one, rows in shown
    )


def _unseen(identified: Identification, motors: MotorsDocument, key: str) -> tuple[Stretch, ...]:
    stretches = [one for one in identified.verifications if one.moved]
    numbers = sum(one.inputs.shape[0] + 2 * len(one.moved) for one in stretches)
    shown = []
    for number, one in enumerate(stretches):
        rows = [one.output_names.index(name) for name in one.moved]
        picture = Picture(
            key=f"{key}-unseen-{number}",
            description=f"Accelerations measured and made by the motors, and the motors, in {one.record}, unseen",
            figure=made_by_motors(
                one.time_s,
                one.inputs,
                one.measured[rows],
                one.predicted[rows],
                motor_names=one.input_names,
                channels=one.moved,
                held=motors.outputs != "speed",
                most=_most(numbers),
            ),
        )
        title = f"{one.record}, {one.time_s[0]:.1f} to {one.time_s[-1]:.1f} s"
        shown.append(Stretch(title=title, picture=picture))
    return tuple(shown)


def _most(traces: int) -> int:
    return max(_LEAST_POINTS, _MOST_NUMBERS // max(traces, 1))
