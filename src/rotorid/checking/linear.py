"""A model about trim on flights that it was not fitted to.

Short maneuvers are predicted in the time domain (:mod:`rotorid.checking.maneuvers`), sweeps compared in the frequency
domain (:mod:`rotorid.checking.sweeps`); models are scored side by side with their parameters held
(:mod:`rotorid.checking.scores`), and simulated through whole flights about their mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np

from rotorid.checking.candidate import UNFILTERED, Candidate, output_sources
from rotorid.checking.maneuvers import excited_outputs, predict_maneuvers, remarks_on, usual_motion
from rotorid.checking.predictions import (
    NOTHING_FITTED,
    Predictions,
    Simulation,
    Trial,
    missing_outputs,
    not_verified,
    piece_starts,
    whole_flights,
)
from rotorid.checking.scores import score_flights
from rotorid.checking.sweeps import check_sweeps
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.data.trust import RICH_KINDS
from rotorid.errors import InsufficientDataError, ModelError, UsageError, reason_of
from rotorid.fits.frequency.fit import FrequencyFit
from rotorid.fits.time.fit import growth, piece_s, posed_in_pieces
from rotorid.fitting.time.output_error import TimeProblem
from rotorid.flights.flights import Flight
from rotorid.flights.instruments import axes_of, is_command
from rotorid.flights.measure import Measured, default_band
from rotorid.flights.segments import holds, require_channels, time_records
from rotorid.flights.selection import (
    Selection,
    described,
    of_axes,
    require_reached,
    select_records,
    wholly_flown,
)
from rotorid.flights.steady_wind import in_wind_of
from rotorid.models.input_units import require_same_unit
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import connected
from rotorid.results.model import Verifications
from rotorid.settings.flying import FlySettings
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.verifying import VerifySettings
from rotorid.signal.excitations import find_excitations
from rotorid.typing import Axis, FloatArray
from rotorid.verification.driven import driven

_REST_S = 1.5
"""Taken along before and after a short maneuver that models are scored on."""


@dataclass(frozen=True, kw_only=True, eq=False)
class UnseenLog:
    """One log with its unseen parts, or the reason why there are none."""

    record: FlightRecord
    outputs: tuple[str, ...] = ()
    short: tuple[Flight, ...] = ()
    sweeps: tuple[Flight, ...] = ()
    cause: str = ""


@dataclass(frozen=True)
class LinearPredictor:
    """A model about trim."""

    about_trim: ClassVar[bool] = True

    candidate: Candidate

    @property
    def parameters(self) -> ParameterSet:
        """Its values."""
        return self.candidate.structure.parameters

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes of its inputs."""
        return axes_of(self.candidate.structure.inputs, self.candidate.structure.outputs)

    @property
    def needed(self) -> str:
        """The flights that can judge it."""
        return f"a sweep or doublet of {' or '.join(self.axes)} with all channels of the model"

    def predict(
        self, records: Sequence[FlightRecord], settings: VerifySettings, fitted: Selection = NOTHING_FITTED
    ) -> Predictions:
        """Short maneuvers and sweeps, see :class:`rotorid.checking.predictions.Predictor`."""
        logs = [*self._kept_unseen(fitted), *(self._unseen(record, settings.segments, fitted) for record in records)]
        flights = tuple(flight for log in logs for flight in (*log.short, *log.sweeps))
        return Predictions(found=_judged(self.candidate, logs, settings), flights=flights)

    def trials(self, record: FlightRecord, settings: IdentifySettings) -> list[Trial]:
        """Excitations of its axes with the time around them, or whole records where its inputs are set-points."""
        structure = self.candidate.structure
        return [
            Trial(flight, partial(score_flights, *in_wind_of(structure, [flight]), settings))
            for flight in self._scored(record, settings)
        ]

    def simulations(self, record: FlightRecord, settings: FlySettings) -> tuple[list[Simulation], list[Finding]]:
        """Whole flights about their mean, or pieces of them, with the logged inputs and outputs."""
        whole = self.candidate.structure
        inputs = [name for name in whole.inputs if holds(record, name)]
        outputs = [name for name in whole.outputs if holds(record, name)]
        if not inputs or not outputs:
            lacking = whole.inputs if not inputs else whole.outputs
            raise InsufficientDataError(f"it contains none of {', '.join(lacking)}", needed="an input and an output")
        at_trim, flights = in_wind_of(whole, whole_flights([record], settings.segments))
        structure = connected(at_trim.select(inputs=inputs, outputs=outputs))
        records = time_records(structure, flights, IdentifySettings(hold=settings.hold), every_input=False)
        parameters = structure.parameters
        length_s = settings.pieces_s or piece_s(structure, parameters, records.data)
        found = []
        for segment, data in zip(records.segments, records.data, strict=True):
            problem = posed_in_pieces(structure, parameters, records._replace(data=(data,)), length_s)
            found.append(
                Simulation(
                    record=segment.record,
                    maneuver=segment.maneuver,
                    time_s=segment.history.time_s,
                    inputs=data.inputs,
                    measured=data.outputs,
                    input_names=structure.inputs,
                    output_names=structure.outputs,
                    outputs_at=partial(_outputs_at, problem),
                    starts=piece_starts(problem.records),
                    held=records.hold == "zero",
                    moved=driven(structure, data.inputs),
                )
            )
        findings = [*records.findings, *missing_outputs(whole.outputs, structure.outputs, record)]
        rate = growth(structure, parameters)
        if length_s is not None and settings.pieces_s is None:
            message = (
                f"The fastest mode of {whole.name} grows by a factor of e in {1.0 / rate:.2g} s, so over a whole "
                f"flight any error would explode; the simulation restarts every {length_s:.2g} s."
            )
            findings.append(remark("flown_in_pieces", whole.name, message, length_s=length_s, growth_1_s=rate))
        return found, findings

    def _kept_unseen(self, fitted: Selection) -> list[UnseenLog]:
        """Maneuvers of the fitted logs that were not fitted."""
        structure = self.candidate.structure
        logs = []
        for record in {id(flight.record): flight.record for flight in fitted.unseen}.values():
            # A log without some input was fitted for the others, and cannot be predicted.
            cause = _lacking(record, structure.inputs)
            short = () if cause else tuple(flight for flight in fitted.unseen if flight.record is record)
            outputs = tuple(name for name in structure.outputs if holds(record, name))
            logs.append(UnseenLog(record=record, outputs=outputs, short=short, cause=cause))
        return logs

    def _unseen(self, record: FlightRecord, segments: Sequence[Maneuver], fitted: Selection) -> UnseenLog:
        """Unseen parts of a further log: given intervals, or the excitations found."""
        structure, given = self.candidate.structure, of_axes(segments, self.axes)
        there = tuple(name for name in structure.outputs if holds(record, name))
        # Without an input nothing can be predicted; of the outputs those that are there will do.
        if lacking := _lacking(record, (*structure.inputs, *(there or structure.outputs))):
            return UnseenLog(record=record, cause=lacking)
        require_same_unit(structure, record)
        if segments:
            wanted = [described(flight) for m in given if (flight := Flight(record, m)).inside]
        else:
            wanted = [Flight(record, m) for axis in self.axes for m in find_excitations(record, axis)]
        flights = [flight for flight in wanted if not fitted.fits(flight)]
        if not flights:
            axes = " or ".join(self.axes)
            what = "no given segment" if segments else f"no excitation of {axes} beyond what was fitted"
            return UnseenLog(record=record, cause=f"it contains {what}")
        short = tuple(flight for flight in flights if flight.maneuver.kind not in RICH_KINDS)
        return UnseenLog(
            record=record,
            outputs=there,
            short=short if segments else wholly_flown(short),
            sweeps=tuple(flight for flight in flights if flight.maneuver.kind in RICH_KINDS),
        )

    def _scored(self, record: FlightRecord, settings: IdentifySettings) -> list[Flight]:
        """Flights of a log on which the model is scored."""
        structure, axes = self.candidate.structure, self.axes
        require_same_unit(structure, record)
        commands = all(is_command(name) for name in structure.inputs)
        own = tuple(maneuver for maneuver in settings.segments if maneuver.axis in axes or not commands)
        if settings.segments and not own:
            raise InsufficientDataError(f"no given segment is on {' or '.join(axes)}")
        require_reached(record, own)
        if own or not commands:
            return list(select_records(structure, [record], replace(settings, segments=own)).selection.fitted)
        found = wholly_flown([Flight(record, m) for axis in axes for m in find_excitations(record, axis)])
        if not found:
            raise InsufficientDataError(f"it contains no excitation of {' or '.join(axes)}")
        return with_rest(record, found)


def candidate_of(fitted: FrequencyFit, measured: Measured) -> Candidate:
    """A model that has just been fitted to responses."""
    return Candidate(
        structure=fitted.structure,
        band_rad_s=fitted.band_rad_s,
        sources=output_sources(measured),
        usual=usual_motion(measured, fitted.band_rad_s),
    )


def with_rest(record: FlightRecord, flights: Sequence[Flight]) -> list[Flight]:
    """Short maneuvers with the time around them, up to half way to their neighbors: what follows one answers to it."""
    ordered = sorted(
        {(flight.maneuver.start_s, flight.maneuver.stop_s): flight.maneuver for flight in flights}.values(),
        key=lambda maneuver: maneuver.start_s,
    )
    wider = []
    for number, m in enumerate(ordered):
        before_s = (ordered[number - 1].stop_s + m.start_s) / 2.0 if number else record.start_s
        after_s = (m.stop_s + ordered[number + 1].start_s) / 2.0 if number + 1 < len(ordered) else record.stop_s
        around = (max(m.start_s - _REST_S, before_s), min(m.stop_s + _REST_S, after_s))
        start_s, stop_s = (m.start_s, m.stop_s) if m.kind in RICH_KINDS else around
        wider.append(Flight(record, replace(m, start_s=min(m.start_s, start_s), stop_s=max(m.stop_s, stop_s))))
    return wider


def _outputs_at(problem: TimeProblem, values: Mapping[str, float]) -> FloatArray:
    """Pieces of a record as simulated at some values of the parameters."""
    parameters = problem.parameters
    moved = parameters.with_values({name: values[name] for name in parameters.free})
    return np.hstack([predicted.predicted for predicted in problem.predicted(moved.pack())])


def _lacking(record: FlightRecord, channels: Sequence[str]) -> str:
    """The reason why a record cannot be used, if it lacks a channel."""
    try:
        require_channels(record, channels)
    except InsufficientDataError as error:
        return error.came
    return ""


def _judged(candidate: Candidate, logs: Sequence[UnseenLog], settings: VerifySettings) -> Verifications:
    """Results of the logs; a log that fails does not affect the others."""
    parts: list[Verifications] = []
    judged: list[UnseenLog] = []
    causes = [(log, log.cause) for log in logs if log.cause]
    for members, attempt in _attempts(candidate, logs, settings):
        try:
            parts.append(attempt())
            judged += members
        except (UsageError, ModelError):
            # The model or what was asked is wrong: no other log changes that.
            raise
        except Exception as failure:
            # A log that fails, by a fault of ours too, ends no other: it is listed with its reason.
            error = reason_of(failure, f"the prediction of {listed([log.record.source.name for log in members])}")
            causes += [(log, error.came.rstrip(".")) for log in members]
    frequency: dict[str, float] = {}
    for part in parts:
        frequency |= {pair: max(cost, frequency.get(pair, 0.0)) for pair, cost in part.frequency.items()}
    return Verifications(
        maneuvers=tuple(item for part in parts for item in part.maneuvers),
        frequency=frequency,
        findings=(
            *(finding for part in parts for finding in part.findings),
            *(not_verified(log.record, cause, part=log in judged) for log, cause in causes),
        ),
        sweeps=tuple(item for part in parts for item in part.sweeps),
    )


def _attempts(
    candidate: Candidate, logs: Sequence[UnseenLog], settings: VerifySettings
) -> list[tuple[list[UnseenLog], Callable[[], Verifications]]]:
    """Ways to judge the model, with the logs of each."""
    axes = set(axes_of(candidate.structure.inputs, candidate.structure.outputs))
    flying = [log for log in logs if log.sweeps]
    # A log that excites every input is scored alone, so that a good one does not hide a bad one in a common average.
    sufficient = [log for log in flying if axes <= {sweep.axis for sweep in log.sweeps}]
    together = [log for log in flying if log not in sufficient]
    groups = [*([log] for log in sufficient), *([together] if together else [])]
    return [
        *(([log], partial(_maneuvers, candidate, log, settings)) for log in logs if log.short),
        *((group, partial(_sweeps, candidate, group, settings)) for group in groups),
    ]


def _maneuvers(candidate: Candidate, log: UnseenLog, settings: VerifySettings) -> Verifications:
    candidate, short = _at_trim_of(candidate, log.short)
    checks, findings = predict_maneuvers(candidate, short, settings, outputs=log.outputs)
    excited = excited_outputs(checks, candidate)
    if not excited:
        raise InsufficientDataError("its short maneuvers move no output more than it moved before")
    # Only maneuvers that test the model are remarked on.
    on_checks = [finding for check in checks for finding in remarks_on(check)]
    data = [finding for finding in findings if finding not in on_checks]
    remarks = [finding for check in excited for finding in remarks_on(check)]
    return Verifications(maneuvers=excited, findings=(*_without(candidate, [log], log.outputs), *data, *remarks))


def _sweeps(candidate: Candidate, logs: Sequence[UnseenLog], settings: VerifySettings) -> Verifications:
    candidate, sweeps = _at_trim_of(candidate, [flight for log in logs for flight in log.sweeps])
    outputs = tuple(name for name in candidate.structure.outputs if all(name in log.outputs for log in logs))
    if not outputs:
        raise InsufficientDataError("the logs have no output of the model in common")
    if any(source.endswith(UNFILTERED) for source in (candidate.sources or {}).values()):
        settings = replace(settings, correct_filters=True)
    judged = check_sweeps(
        candidate.structure if outputs == candidate.structure.outputs else candidate.structure.select(outputs=outputs),
        candidate.structure.parameters,
        sweeps,
        band_rad_s=candidate.band_rad_s or default_band(sweeps, math.inf),
        settings=settings,
    )
    findings = (*_without(candidate, logs, outputs), *judged.findings)
    return Verifications(frequency=judged.costs, findings=findings, sweeps=(judged,))


def _at_trim_of(candidate: Candidate, flights: Sequence[Flight]) -> tuple[Candidate, tuple[Flight, ...]]:
    """A model in the wind of flights that may not be the one in which it was fitted."""
    structure, blown = in_wind_of(candidate.structure, flights)
    return replace(candidate, structure=structure), blown


def _without(candidate: Candidate, logs: Sequence[UnseenLog], outputs: Sequence[str]) -> list[Finding]:
    """Outputs of the model that could not be judged, because a log does not hold them."""
    left_out = [name for name in candidate.structure.outputs if name not in outputs]
    where = ", ".join(log.record.source.name for log in logs)
    return [
        remark(
            "missing_channel",
            f"{where}: {name}",
            f"{where} contains no {name}, so that output of the model was not judged there.",
        )
        for name in left_out
    ]
