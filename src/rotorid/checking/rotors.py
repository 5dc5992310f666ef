"""What predictors share that the motors of a log drive: rotors and motors as in the fit, stretches and their scores.

A log is read as the fitted ones were. It has to be of the same vehicle, with motors known by the same: outputs, demands
or speeds.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, ClassVar, NamedTuple, Protocol, TypeVar

import numpy as np

from rotorid.checking.predictions import (
    NOTHING_FITTED,
    Predictions,
    Trial,
    fixed_score,
    plain_scores,
    predict_each,
    refuse_choices_of_responses,
)
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, warn
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.flights.flights import Flight
from rotorid.flights.motor_data import MotorFlight, rotors_of
from rotorid.flights.selection import Selection, require_reached
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.rotors import RotorLayout
from rotorid.results.model import Verifications
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings
from rotorid.settings.verifying import VerifySettings
from rotorid.verification.fixed_parameters import FixedParameterScores
from rotorid.verification.scores import GOOD_TIC
from rotorid.verification.verification import Scores, Verification


class _WithMotors(Protocol):
    @property
    def kind(self) -> str: ...


Read = TypeVar("Read", bound=_WithMotors)


class Checked(NamedTuple):
    """Stretches of a log with their verification, and all remarks on the log."""

    stretches: Sequence[tuple[MotorFlight, Verification]]
    findings: Sequence[Finding]


@dataclass(frozen=True, kw_only=True, eq=False)
class RotorPredictor(Immutable):
    """A vehicle whose motors drive its motion, for predictions of a flight.

    Parameters
    ----------
    parameters
        Their values count.
    layout
        The rotors by their name.
    kind
        What the motors are known by: ``output``, ``thrust_demand`` or ``speed``.
    scaled
        Whether the mass is known; without it there are no newtons.
    reference_v
        Battery voltage for which thrust is stated; ``None`` where thrust does not depend on it.
    choices
        How the fitted logs were read; ``None`` where that is not known.
    """

    about_trim: ClassVar[bool] = False
    model: ClassVar[str]

    parameters: ParameterSet
    layout: RotorLayout
    kind: str
    scaled: bool
    reference_v: float | None = None
    choices: MotorSettings | None = None

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the motors."""
        return tuple(f"motor_{number + 1}" for number in range(self.layout.rotors))

    @abstractmethod
    def check(self, record: FlightRecord, segments: Sequence[Maneuver]) -> Checked:
        """Predict every stretch of a log that judges the vehicle."""

    def predict(
        self, records: Sequence[FlightRecord], settings: VerifySettings, fitted: Selection = NOTHING_FITTED
    ) -> Predictions:
        """Predict each log, see :class:`rotorid.checking.predictions.Predictor`."""
        refuse_choices_of_responses(self.model, settings)

        def predict(record: FlightRecord) -> Predictions:
            checked = self.check(record, settings.segments)
            return Predictions(
                found=Verifications(
                    maneuvers=tuple(check for _, check in checked.stretches), findings=tuple(checked.findings)
                ),
                flights=tuple(Flight(record, flight.maneuver) for flight, _ in checked.stretches),
            )

        return predict_each(records, settings, fitted, predict)

    def trials(self, record: FlightRecord, settings: IdentifySettings) -> list[Trial]:
        """Stretches of a log; their scores know neither horizon nor band."""
        require_reached(record, settings.segments)
        return [
            Trial(
                Flight(record, replace(flight.maneuver, start_s=flight.record.start_s)), fixed_score(_compared(check))
            )
            for flight, check in self.check(record, settings.segments).stretches
        ]

    def read(
        self,
        read: Callable[..., Read],
        record: FlightRecord,
        segments: Sequence[Maneuver],
    ) -> Read:
        """A log as for a fit.

        Parameters
        ----------
        read
            Reader of the fit: of records and choices, with ``reference_v`` and ``layout``.

        Raises
        ------
        InsufficientDataError
            It has no motors or no motion, is of another vehicle, or has motors of another kind.
        """
        choices = replace(self.choices or MotorSettings(), segments=tuple(segments))
        needed, name = "a log of the identified vehicle", record.source.name
        try:
            of_log = rotors_of([record], choices)
        except (InsufficientDataError, UsageError, ModelError):
            # A result names its rotors; next to the logs of a fit, a log has to name its own.
            if self.choices is not None:
                raise
            of_log = self.layout
        if not np.array_equal(of_log.spins, self.layout.spins):
            raise InsufficientDataError(
                f"{name} is from {of_log.name}, but the result from {self.layout.name}", needed=needed
            )
        # An arm that was given is not in the log.
        if self.choices is not None and not np.allclose(of_log.positions, self.layout.positions):
            raise InsufficientDataError(f"the rotor positions of {name} differ from those of the result", needed=needed)
        try:
            data = read([record], choices, reference_v=self.reference_v, layout=self.layout)
        except UsageError as error:
            raise InsufficientDataError(error.came, needed=error.needed, remedy=error.remedy) from error
        if data.kind != self.kind:
            raise InsufficientDataError(
                f"{name} logs motors as {data.kind.replace('_', ' ')}",
                needed=f"a log of motors as {self.kind.replace('_', ' ')}, like those of the result",
            )
        return data


def place_of(flight: MotorFlight) -> str:
    """A stretch as findings name it."""
    return f"{flight.record.name} at {flight.record.start_s:.1f} s"


def poor_predictions(where: str, scores: Mapping[str, Scores]) -> list[Finding]:
    """Warnings on the channels of a stretch that are predicted poorly."""
    return [
        warn(
            "poor_verification",
            f"{where}: {name}",
            f"{name} of {where} is predicted with a Theil coefficient of {score.tic:.2f}.",
            tic=score.tic,
            nrmse_fit_percent=score.nrmse_fit_percent,
        )
        for name, score in scores.items()
        if score.tic > GOOD_TIC
    ]


def judged_scores(check: Verification) -> dict[str, Scores]:
    """Scores of the channels that judge the model."""
    return {name: check.scores[name] for name in check.moved}


def _compared(check: Verification) -> FixedParameterScores:
    """A verification for a comparison: the channels that moved, about the mean of the measured ones."""
    scores = judged_scores(check)
    rows = [check.output_names.index(name) for name in scores]
    shifts = np.array([[score.reference_shift] for score in scores.values()])
    mean = check.measured[rows].mean(axis=1, keepdims=True)
    return FixedParameterScores(
        record=check.record,
        horizon_s=float("inf"),
        scores=plain_scores(scores),
        time_s=check.time_s - check.maneuver.start_s,
        measured=check.measured[rows] - mean,
        predicted=check.predicted[rows] + shifts - mean,
    )


@contextmanager
def consistent(what: str) -> Iterator[None]:
    """Say that a part of a ``result.json`` is missing or is no number.

    Raises
    ------
    UsageError
        It is.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, ModelError) as error:
        raise UsageError(
            f"the {what} result is inconsistent: {error}", needed="result.json as written by identify"
        ) from error


def known_parameters(table: Mapping[str, Any]) -> ParameterSet:
    """Parameters of a ``result.json``, those that were dropped left out."""
    return ParameterSet(
        [
            Parameter(name=name, value=float(entry["value"]), unit=str(entry["unit"]), status="fixed")
            for name, entry in table["parameters"].items()
            if entry["status"] != "dropped"
        ]
    )


def known_layout(motors: Mapping[str, Any]) -> RotorLayout:
    """Rotors of the ``motors`` of a ``result.json``."""
    return RotorLayout(
        name=str(motors["layout"]),
        positions=np.array(motors["rotors"], dtype=np.float64),
        spins=np.array(motors["spins"], dtype=np.float64),
        arm_known=motors["arm_m"] is not None,
    )
