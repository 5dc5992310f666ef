"""The physics of motors on logs that it was not identified on.

Its inputs are motors, which are made ready from each log as for the fit: outputs, speeds or demands as fast as
the log has them, thrust at the voltage of the result, filters that the log knows. The accelerations that follow are
compared with the measured ones, up to 5 Hz, on the axes that the result identified. Nothing is adjusted but where an
accelerometer has its zero. Rates are integrals of these accelerations, begun anew every two seconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np

from rotorid.checking.predictions import Simulation
from rotorid.checking.rotors import (
    Checked,
    RotorPredictor,
    consistent,
    known_layout,
    known_parameters,
    place_of,
    poor_predictions,
)
from rotorid.data.axes import RATES
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.fits.motors.fitted import levers_of
from rotorid.fits.motors.motion import Motion, motions, scores, simulated_record
from rotorid.fitting.motors.excitation import excitations
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.motors.translation import DRAG, with_translation
from rotorid.flights.motor_data import MotorData, motor_data
from rotorid.models.families import MOTORS
from rotorid.models.flight import INERTIA
from rotorid.models.parameter import ParameterSet
from rotorid.results.model import IdentifiedModel
from rotorid.settings.flying import FlySettings
from rotorid.typing import FloatArray
from rotorid.verification.flight import BODY, FlightJudgement, load_errors, percents
from rotorid.verification.verification import Verification

_AXES = ("az", "p", "q", "r", *DRAG)

_PIECE_S = 2.0
"""Length of the pieces in which rates are integrated, unless the user chose one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorPredictor(RotorPredictor):
    """Motors and rotors of a result, for predictions of a flight.

    Parameters
    ----------
    axes
        Equations that were identified.
    tested
        Least and largest output of the fitted flights; ``None`` where that is not known.
    """

    model: ClassVar[str] = MOTORS.name
    needed: ClassVar[str] = "motors, gyros and accelerometer of the vehicle, and motion on an identified axis"

    axes: tuple[str, ...]
    tested: tuple[float, float] | None = None
    scaled: bool = False

    def check(self, record: FlightRecord, segments: Sequence[Maneuver]) -> Checked:
        """Accelerations of the stretches that move an identified axis; remarks on the others."""
        data = self.data(record, segments)
        moved = self.motions(data, self.parameters)
        remarks = [finding for motion in moved for finding in _remarks(motion)]
        return Checked(
            [(motion.flight, self._verification(motion)) for motion in moved if motion.counted],
            [*data.findings, *remarks],
        )

    def simulations(self, record: FlightRecord, settings: FlySettings) -> tuple[list[Simulation], list[Finding]]:
        """Rates as integrals of the angular accelerations that the motors make, each piece at its measured mean."""
        data = self.data(record, settings.segments)
        moved = self.motions(data, self.parameters)
        length_s = settings.pieces_s or _PIECE_S
        axes = tuple(axis for axis in RATES if all(f"{axis}_dot" in motion.rows for motion in moved if motion.counted))
        if not axes:
            raise InsufficientDataError("none of its rates was identified", needed="motion in roll, pitch or yaw")
        stretches = []
        for motion in moved:
            if not motion.counted:
                continue
            record_of, time_s = motion.flight.record, motion.flight.record.time_s[motion.kept]

            def rates_at(values: Mapping[str, float], motion: Motion = motion) -> FloatArray:
                own = {name: values[name] for name in self.parameters.names if name in values}
                (modeled,) = self.motions(data._replace(stretches=(motion.flight,)), self.parameters.with_values(own))
                return _integrated(motion, modeled, axes, length_s)

            stretches.append(
                Simulation(
                    record=record_of.name,
                    maneuver=motion.flight.maneuver,
                    time_s=time_s,
                    inputs=record_of.outputs[:, motion.kept],
                    measured=_measured_rates(motion, axes),
                    input_names=self.inputs,
                    output_names=axes,
                    outputs_at=rates_at,
                    starts=_edges(time_s, length_s)[:-1],
                    held=True,
                )
            )
        message = (
            f"The motor model predicts accelerations; rates are their integrals, restarted every {length_s:.2g} s."
        )
        remarks = [finding for motion in moved for finding in _remarks(motion)]
        return stretches, [*data.findings, *remarks, remark("flown_in_pieces", MOTORS.name, message, length_s=length_s)]

    def data(self, record: FlightRecord, segments: Sequence[Maneuver]) -> MotorData:
        """A log as for a fit, see :meth:`rotorid.checking.rotors.RotorPredictor.read`."""
        return self.read(partial(motor_data, translation=not set(DRAG).isdisjoint(self.axes)), record, segments)

    def _verification(self, moved: Motion) -> Verification:
        return replace(_verification(moved, self.inputs), flight=self._judged(moved))

    def _judged(self, moved: Motion) -> FlightJudgement:
        """Errors in N and N m where the mass is known, and the time at outputs that no fitted flight had."""
        values = self.parameters.values if self.scaled else {}
        sizes = {"az": values.get("m"), **{f"{axis}_dot": values.get(name) for axis, name in INERTIA.items()}}
        missed = {
            name: size * (measured - modeled)
            for name, (measured, modeled) in moved.rows.items()
            if (size := sizes.get(name)) is not None
        }
        outside_percent: float | None = None
        outside: dict[str, float] = {}
        if self.tested is not None:
            outputs = moved.flight.record.outputs
            beyond = (outputs < self.tested[0]) | (outputs > self.tested[1])
            outside_percent, outside = percents([{"motors": np.asarray(beyond.any(axis=0))}])
        turned = dict(zip((f"{axis}_dot" for axis in INERTIA), BODY, strict=True))
        return FlightJudgement(
            samples=next(iter(moved.rows.values()))[0].size,
            errors=load_errors(
                {"z": missed["az"]} if "az" in missed else {},
                {turned[name]: row for name, row in missed.items() if name in turned},
            ),
            outside_percent=outside_percent,
            outside=outside,
        )

    def motions(self, data: MotorData, parameters: ParameterSet) -> tuple[Motion, ...]:
        """Stretches of a log as measured and as the motors make them, at some values of the parameters."""
        problem = MotorProblem(records=data.records, levers=levers_of(data), parameters=parameters, axes=self.axes)
        found = with_translation(excitations(data.records, problem.levers), data.records)
        return motions(problem, parameters.pack(), data.stretches, found)


def known_motors(table: Mapping[str, Any]) -> MotorPredictor:
    """The motors of a ``result.json``.

    Parameters
    ----------
    table
        With its ``parameters`` and its ``motors``.

    Raises
    ------
    UsageError
        Something of it is missing or is no number.
    """
    with consistent("motor"):
        motors = table["motors"]
        counted = {axis for excitation in motors["excitation"] for axis in excitation["counted"]}
        return MotorPredictor(
            parameters=known_parameters(table),
            layout=known_layout(motors),
            kind=str(motors["outputs"]),
            axes=(*(() if "az" in counted else ("weight",)), *(axis for axis in _AXES if axis in counted)),
            reference_v=motors.get("reference_v"),
            scaled=motors.get("scale") is not None,
            tested=tuple(motors["flown_outputs"]) if motors.get("flown_outputs") else None,
        )


def identified_motors(model: IdentifiedModel) -> MotorPredictor | None:
    """The vehicle of an identified model; ``None`` for one that is not of ``physical.motors``."""
    if model.motors is None or model.flight is not None:
        return None
    parameters = {name: asdict(estimate) for name, estimate in model.parameters.items()}
    return known_motors({"parameters": parameters, "motors": asdict(model.motors)})


def _remarks(motion: Motion) -> list[Finding]:
    """Findings on a stretch: no identified axis moves, or the prediction is poor."""
    where = place_of(motion.flight)
    if not motion.counted:
        message = f"{where} moves no identified axis, so it does not test the model."
        return [warn("not_verified", where, message)]
    return poor_predictions(where, scores(motion))


def _verification(moved: Motion, motors: Sequence[str]) -> Verification:
    """Verification of an unseen stretch by its excited axes."""
    shown, record = simulated_record(moved, tuple(moved.rows)), moved.flight.record
    return Verification(
        record=shown.record,
        maneuver=replace(shown.maneuver, start_s=record.start_s, stop_s=float(record.time_s[-1])),
        time_s=shown.time_s,
        inputs=shown.inputs,
        measured=shown.measured,
        predicted=shown.simulated,
        input_names=tuple(motors),
        output_names=tuple(moved.rows),
        scores=scores(moved),
        moved=moved.counted,
    )


def _measured_rates(motion: Motion, axes: Sequence[str]) -> FloatArray:
    """Rates of a stretch, shape ``(axes, n)``."""
    return np.stack([motion.flight.record.rates[RATES.index(axis)][motion.kept] for axis in axes])


def _edges(time_s: FloatArray, length_s: float) -> tuple[int, ...]:
    """Samples at which pieces of about one length begin, and the end."""
    count = max(1, round((float(time_s[-1]) - float(time_s[0])) / length_s))
    return tuple(int(edge) for edge in np.linspace(0, time_s.size, count + 1).round())


def _integrated(measured: Motion, modeled: Motion, axes: Sequence[str], length_s: float) -> FloatArray:
    """Rates of a stretch from modeled accelerations, each piece about its measured mean."""
    record = measured.flight.record
    rates = _measured_rates(measured, axes)
    step_s = 1.0 / record.sample_rate_hz
    edges = _edges(record.time_s[measured.kept], length_s)
    found = np.zeros(rates.shape)
    for row, axis in enumerate(axes):
        _, acceleration = modeled.rows[f"{axis}_dot"]
        for first, last in pairwise(edges):
            part = acceleration[first:last]
            moved = np.concatenate([[0.0], np.cumsum(0.5 * step_s * (part[1:] + part[:-1]))])
            found[row, first:last] = moved + float(np.mean(rates[row, first:last] - moved))
    return found
