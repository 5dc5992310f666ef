"""An identified vehicle of ``physical.motors`` on logs that it was not identified on.

Its inputs are motors, which are made ready from each log as for the fit: outputs, speeds or demands as fast as
the log tells them, thrust at the voltage of the result, filters that the log knows. The accelerations that follow are
compared with the measured ones, up to 5 Hz, on the axes that the result identified. Nothing is adjusted but where an
accelerometer has its zero.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fits.motors.fitted import levers_of
from rotorid.fits.motors.motion import Motion, motions, scores, simulated_record
from rotorid.fitting.motors.excitation import excitations
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.flights.motor_data import MotorData, motor_data
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.rotors import RotorLayout, layout_of
from rotorid.settings.settings import MotorChoices
from rotorid.typing import FloatArray
from rotorid.verification.fixed_parameters import FixedParameterScores, OutputScore
from rotorid.verification.scores import GOOD_TIC
from rotorid.verification.verification import Verification

_AXES = ("az", "p", "q", "r")


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownMotors(Immutable):
    """What a result says of motors and rotors, as far as predicting a flight needs it.

    Parameters
    ----------
    parameters
        All held at their values.
    layout
        The rotors.
    kind
        What the motors are known by: ``output``, ``thrust_demand`` or ``speed``.
    axes
        Those that were identified.
    reference_v
        Voltage at which thrust is told; ``None`` where it is no matter.
    """

    parameters: ParameterSet
    layout: RotorLayout
    kind: str
    axes: tuple[str, ...]
    reference_v: float | None = None


def known_motors(table: Mapping[str, Any]) -> KnownMotors:
    """From a result as ``result.json`` holds it.

    Parameters
    ----------
    table
        With its ``parameters`` and its ``motors``.

    Raises
    ------
    UsageError
        Something of it is missing or is no number.
    """
    try:
        motors = table["motors"]
        rotors = np.array(motors["rotors"], dtype=np.float64)
        counted = {axis for one in motors["excitation"] for axis in one["counted"]}
        parameters = [
            Parameter(name=name, value=float(one["value"]), unit=str(one["unit"]), status="fixed")
            for name, one in table["parameters"].items()
            if one["status"] != "dropped"
        ]
        return KnownMotors(
            parameters=ParameterSet(parameters),
            layout=RotorLayout(
                name=str(motors["layout"]),
                positions=rotors,
                spins=np.array(motors["spins"], dtype=np.float64),
                arm_known=motors["arm_m"] is not None,
            ),
            kind=str(motors["outputs"]),
            axes=tuple(axis for axis in _AXES if axis in counted),
            reference_v=motors.get("reference_v"),
        )
    except (LookupError, TypeError, ValueError, ModelError) as error:
        raise UsageError(
            f"the result of motors does not hold together: {error}", needed="result.json as identify wrote it"
        ) from error


class Predicted(NamedTuple):
    """Stretches of one unseen log that tell of the model, its data, and remarks on all of them."""

    moved: tuple[Motion, ...]
    data: MotorData
    findings: tuple[Finding, ...]


def predicted_by(known: KnownMotors, record: FlightRecord, segments: Sequence[Maneuver] = ()) -> Predicted:
    """Predict the accelerations of a log.

    Parameters
    ----------
    known
        The vehicle.
    record
        The log.
    segments
        Stretches to use in place of the excitations that are found.

    Raises
    ------
    InsufficientDataError
        The log tells no motors or no motion, is of another vehicle, or tells the motors in another way.
    """
    try:
        of_log = layout_of(record)
    except (InsufficientDataError, UsageError, ModelError):
        of_log = None
    if of_log is not None and not np.array_equal(of_log.spins, known.layout.spins):
        raise InsufficientDataError(
            f"{record.source.name} is of {of_log.name}, and the result of {known.layout.name}",
            needed="a log of the vehicle that was identified",
        )
    try:
        data = motor_data(
            [record], MotorChoices(segments=tuple(segments)), reference_v=known.reference_v, layout=known.layout
        )
    except UsageError as error:
        raise InsufficientDataError(error.came, needed=error.needed, remedy=error.remedy) from error
    if data.kind != known.kind:
        raise InsufficientDataError(
            f"{record.source.name} tells motors as {data.kind.replace('_', ' ')}",
            needed=f"a log that tells them as {known.kind.replace('_', ' ')}, as those of the result did",
        )
    forces = () if "az" in known.axes else ("weight",)
    problem = MotorProblem(
        records=data.records, levers=levers_of(data), parameters=known.parameters, axes=(*forces, *known.axes)
    )
    moved, findings = predicted(problem, np.zeros(0), data)
    return Predicted(moved, data, findings)


def predicted(
    problem: MotorProblem, theta: FloatArray, data: MotorData
) -> tuple[tuple[Motion, ...], tuple[Finding, ...]]:
    """Stretches that move an identified axis, as measured and as the motors make them, and remarks.

    Parameters
    ----------
    problem
        The vehicle on the records of the log.
    theta
        Its free parameters.
    data
        The log.
    """
    found = excitations(data.records, problem.levers)
    moved = motions(problem, theta, data.stretches, found)
    findings = [*data.findings]
    for motion in moved:
        where = f"{motion.flight.record.name} at {motion.flight.record.start_s:.1f} s"
        if not motion.counted:
            message = f"{where} moves no axis that was identified, and tells nothing of the model."
            findings.append(warn("not_verified", where, message))
        findings += [
            warn(
                "poor_verification",
                f"{where}: {name}",
                f"{name} of {where} is predicted with a Theil coefficient of {score.tic:.2f}.",
                tic=score.tic,
                nrmse_fit_percent=score.nrmse_fit_percent,
            )
            for name, score in scores(motion).items()
            if score.tic > GOOD_TIC
        ]
    return tuple(motion for motion in moved if motion.counted), tuple(findings)


def verification_of(moved: Motion, motors: Sequence[str]) -> Verification:
    """An unseen stretch, of which counts what was excited.

    Parameters
    ----------
    moved
        The stretch.
    motors
        Names of the inputs.
    """
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


def motor_scores(moved: Motion) -> FixedParameterScores:
    """The same for a comparison: the excited channels alone, about their means."""
    found = scores(moved)
    rows = [moved.rows[name] for name in moved.counted]
    return FixedParameterScores(
        record=moved.flight.record.name,
        horizon_s=float("inf"),
        scores={
            name: OutputScore(nrmse_fit_percent=one.nrmse_fit_percent, tic=one.tic, rms=one.rms)
            for name, one in found.items()
        },
        time_s=moved.flight.record.time_s[moved.kept] - moved.flight.record.start_s,
        measured=np.stack([measured - measured.mean() for measured, _ in rows]),
        predicted=np.stack([modeled - modeled.mean() for _, modeled in rows]),
    )
