"""Interface of every kind of model for predictions of unseen flights.

A model about trim, the physics of motors and a nonlinear model predict in different ways, and are asked in one: by
``identify`` itself and ``verify`` (:meth:`Predictor.predict`), by ``compare`` (:meth:`Predictor.trials`) and by
``simulate LOG --model`` (:meth:`Predictor.simulations`). :func:`rotorid.checking.predictors.predictor_of` knows the
predictor of a model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, UsageError, reason_of
from rotorid.fitting.time.output_error import TimeData
from rotorid.flights.flights import Flight, longest_flight
from rotorid.flights.selection import Selection, given_flights, require_reached
from rotorid.models.parameter import ParameterSet
from rotorid.results.model import Verifications
from rotorid.results.provenance import Provenance
from rotorid.settings.flying import FlySettings
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.verifying import VerifySettings
from rotorid.typing import FloatArray
from rotorid.verification.driven import Driven
from rotorid.verification.fixed_parameters import FixedParameterScores, OutputScore
from rotorid.verification.verification import Scores

NOTHING_FITTED: Selection = Selection(fitted=(), unseen=())


@dataclass(frozen=True, kw_only=True, eq=False)
class Predictions:
    """Predictions of flights by a model.

    Parameters
    ----------
    found
        Measured and predicted, with remarks.
    flights
        What it was judged on.
    refusals
        Of logs that cannot judge it: the findings behind the remark that says so.
    """

    found: Verifications
    flights: tuple[Flight, ...] = ()
    refusals: tuple[Finding, ...] = ()


Score: TypeAlias = Callable[[float | None, tuple[float, float] | None], tuple[FixedParameterScores, ...]]
"""Scores over a horizon and within a band, for kinds of models that have them; ``None`` leaves the choice to the
model.
"""


class Trial(NamedTuple):
    """A flight on which models can be scored side by side."""

    flight: Flight
    score: Score


def fixed_score(scores: FixedParameterScores) -> Score:
    """Scores of a flight that know neither horizon nor band."""
    return lambda _horizon_s, _band_rad_s: (scores,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulation:
    """A stretch of a flight, ready to be simulated at any values of the parameters.

    Parameters
    ----------
    record
        Name of the log.
    time_s
        Stamps, shape ``(samples,)``.
    inputs
        Shape ``(u, samples)``.
    measured
        Shape ``(y, samples)``; not a number in a row that the log does not hold.
    input_names, output_names
        Names of the rows.
    outputs_at
        From values of all parameters to outputs, shape ``(y, samples)``.
    starts
        Samples at which the simulation begins anew, the first included.
    held
        Whether inputs are constant between their samples.
    moved
        Outputs that the inputs moved, ``None`` where all are judged.
    """

    record: str
    maneuver: Maneuver
    time_s: FloatArray
    inputs: FloatArray
    measured: FloatArray
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    outputs_at: Callable[[Mapping[str, float]], FloatArray]
    starts: tuple[int, ...] = (0,)
    held: bool = False
    moved: Driven | None = None

    def judges(self, output: str, fit_percent: float) -> bool:
        """Whether the flight shows how well an output is predicted."""
        return self.moved is None or math.isfinite(self.moved.judged(output, fit_percent))


class Predictor(Protocol):
    """A model that predicts flights: what was measured of its inputs goes in, and its outputs are compared."""

    @property
    def about_trim(self) -> bool:
        """Whether it counts from a trim: then the trim of a maneuver matters, and constants are estimated for it."""
        ...

    @property
    def parameters(self) -> ParameterSet:
        """Its values."""
        ...

    @property
    def needed(self) -> str:
        """The flights that can judge it, in words."""
        ...

    def predict(
        self, records: Sequence[FlightRecord], settings: VerifySettings, fitted: Selection = NOTHING_FITTED
    ) -> Predictions:
        """Predict unseen flights; a log that cannot judge the model does not affect the others.

        Parameters
        ----------
        fitted
            What the model was fitted to, where that is known, and what of the same logs was kept unseen.

        Raises
        ------
        UsageError
            The model does not have a choice.
        """
        ...

    def trials(self, record: FlightRecord, settings: IdentifySettings) -> Sequence[Trial]:
        """Flights of a log on which the model can be scored.

        Raises
        ------
        InsufficientDataError
            There are none.
        """
        ...

    def simulations(
        self, record: FlightRecord, settings: FlySettings
    ) -> tuple[Sequence[Simulation], Sequence[Finding]]:
        """A whole flight of a log, or given intervals of it, and remarks.

        Raises
        ------
        InsufficientDataError
            The log lacks what the model needs.
        """
        ...


def predict_each(
    records: Sequence[FlightRecord],
    settings: VerifySettings,
    fitted: Selection,
    predict: Callable[[FlightRecord], Predictions],
) -> Predictions:
    """Predict logs one by one.

    Parameters
    ----------
    records, settings, fitted
        As for :meth:`Predictor.predict`.
    predict
        The same of one log; raises :class:`InsufficientDataError` where it cannot judge the model.
    """
    known = {flight.record.source.sha256 for flight in fitted.fitted}
    judged: list[Predictions] = []
    for record in records:
        name = record.source.name
        if record.source.sha256 in known:
            judged.append(
                _remarked(warn("seen_data", name, f"{name} was used for the fit, so it does not count as unseen."))
            )
            continue
        try:
            require_reached(record, settings.segments)
            judged.append(predict(record))
        except Exception as failure:
            # One log that fails, by a fault too, ends no other.
            error = reason_of(failure, f"the prediction of {name}")
            refusals = error.findings if isinstance(error, InsufficientDataError) else ()
            judged.append(_remarked(warn("not_verified", name, f"{name} was not judged: {error}"), refusals))
    return Predictions(
        found=Verifications(
            maneuvers=tuple(check for number in judged for check in number.found.maneuvers),
            findings=tuple(finding for number in judged for finding in number.found.findings),
        ),
        flights=tuple(flight for number in judged for flight in number.flights),
        refusals=tuple(finding for number in judged for finding in number.refusals),
    )


def _remarked(finding: Finding, refusals: tuple[Finding, ...] = ()) -> Predictions:
    return Predictions(found=Verifications(findings=(finding,)), refusals=refusals)


def not_verified(record: FlightRecord, cause: str, *, part: bool = False) -> Finding:
    """The finding on a log, or part of it, that does not judge a model."""
    name = record.source.name
    message = f"{'A part of ' if part else ''}{name} could not verify the model: {cause.rstrip('.')}."
    return (remark if part else warn)("not_verified", name, message)


def refuse_choices_of_responses(model: str, settings: VerifySettings) -> None:
    """Refuse options of models that are judged by responses and short maneuvers."""
    given = {"--band": settings.band_rad_s, "--instrument": settings.instruments, "--controller": settings.controllers}
    if wrong := [name for name, value in given.items() if value]:
        raise UsageError(
            f"{', '.join(wrong)} does not apply to a result of {model}",
            needed="logs, and --segment if excitations are not found",
        )


def whole_flights(records: Sequence[FlightRecord], segments: Sequence[Maneuver]) -> tuple[Flight, ...]:
    """Intervals that were given, in every log that they reach into; else the longest flight of each log.

    Raises
    ------
    UsageError
        No given interval lies inside the logs.
    InsufficientDataError
        A log never flew.
    """
    return given_flights(records, segments) if segments else tuple(_whole(record) for record in records)


def _whole(record: FlightRecord) -> Flight:
    start_s, stop_s = longest_flight(record, guessed=False)
    return Flight(record, Maneuver(axis="roll", kind="other", start_s=start_s, stop_s=stop_s, origin="found"))


def between(maneuver: Maneuver, time_s: FloatArray) -> Maneuver:
    """The simulated part of a maneuver."""
    return replace(maneuver, start_s=float(time_s[0]), stop_s=float(time_s[-1]))


def piece_starts(pieces: Sequence[TimeData]) -> tuple[int, ...]:
    """First sample of each piece of a record."""
    return tuple(int(place) for place in np.cumsum([0, *(piece.samples for piece in pieces[:-1])]))


def not_moved(record: str, outputs: Sequence[str]) -> Finding:
    """A note on outputs of a log that no input of a model moved: how well they are predicted is not known.

    Examples
    --------
    >>> not_moved("a.csv", ["psi"]).message
    'No input of the model moved psi clearly in a.csv, so there is no score of psi.'
    """
    words = listed(outputs)
    message = f"No input of the model moved {words} clearly in {record}, so there is no score of {words}."
    return remark("no_excitation", record, message)


def missing_outputs(outputs: Sequence[str], logged: Sequence[str], record: FlightRecord) -> list[Finding]:
    """Outputs that are simulated with no measurement to compare."""
    name = record.source.name
    return [
        remark(
            "missing_channel", output, f"{output} is not in {name}, so the prediction is shown without a measurement."
        )
        for output in outputs
        if output not in logged
    ]


def plain_scores(scores: Mapping[str, Scores], moved: Collection[str] | None = None) -> dict[str, OutputScore]:
    """Scores without the estimated unknowns; an output that did not move has no fit."""
    return {
        name: OutputScore(
            nrmse_fit_percent=score.nrmse_fit_percent if moved is None or name in moved else -math.inf,
            tic=score.tic,
            rms=score.rms,
        )
        for name, score in scores.items()
    }


def was_fitted(provenance: Provenance, flight: Flight) -> bool:
    """Whether any part of a flight was fitted, by the hash of its log.

    A result that does not list its maneuvers has seen its logs as a whole.

    Parameters
    ----------
    provenance
        Where a result came from.
    flight
        What may have been fitted.
    """
    maneuver, source = flight.maneuver, flight.record.source
    names = {name for name, sha256 in provenance.inputs.items() if sha256 == source.sha256}
    return bool(names) and (
        not provenance.maneuvers
        or any(
            item.record in names and item.start_s < maneuver.stop_s and maneuver.start_s < item.stop_s
            for item in provenance.maneuvers
        )
    )


def fitted_logs(provenance: Provenance) -> frozenset[str]:
    """Hashes of the logs that a result was fitted to, without those that only verified it."""
    names = {maneuver.record for maneuver in provenance.maneuvers}
    return frozenset(sha256 for name, sha256 in provenance.inputs.items() if not names or name in names)


def fitted_before(flight: Flight) -> Finding:
    """The warning on a maneuver given for validation that was used for the fit."""
    name, maneuver = flight.record.source.name, flight.maneuver
    return warn(
        "seen_data",
        name,
        f"{name} from {maneuver.start_s:.1f} to {maneuver.stop_s:.1f} s was at least partly used for the fit, so "
        "it flatters the model and does not count as verification. Give another log.",
        start_s=maneuver.start_s,
        stop_s=maneuver.stop_s,
    )
