"""What a model is judged on: never on what it was fitted to."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.unit.cli.commands import fly_roll_sweeps

from rotorid.checking.linear import LinearPredictor, candidate_of
from rotorid.checking.sweeps import check_sweeps, hold_out
from rotorid.data.findings import Finding
from rotorid.data.record import FlightRecord
from rotorid.documents.result import ResultDocument, result_document
from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.fit import FrequencyFit, fit_with_bounds, pose
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.flights.flights import Flight
from rotorid.flights.measure import Measured, measure
from rotorid.flights.selection import Selection, select_maneuvers
from rotorid.identifying.identification import identify
from rotorid.identifying.methods import judging
from rotorid.io.registry import read
from rotorid.models.library import library_model, rate_model
from rotorid.models.structure import LinearStructure
from rotorid.reduction.guided import Reduced, fit_and_drop
from rotorid.results.model import FrequencyCheck, Verifications
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_segment
from rotorid.typing import Axis

BAND = (12.0, 50.0)


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(path)
    return path


@pytest.fixture(scope="module")
def record(log: Path) -> FlightRecord:
    return read(log)


class Fit(NamedTuple):
    """A model of the first sweep, and the second one that it has not seen."""

    fitted: FrequencyFit
    measured: Measured
    selection: Selection
    settings: IdentifySettings
    second: Flight


@pytest.fixture(scope="module")
def first(record: FlightRecord) -> Fit:
    settings = IdentifySettings(band_rad_s=BAND)
    both = select_maneuvers([record], ["roll"], settings).fitted
    measured = measure(both[:1], inputs=("roll_command",), outputs=("p",), settings=settings)
    fitted = fit_with_bounds(pose(rate_model("rate.roll"), measured, settings), measured)
    return Fit(fitted, measured, Selection(fitted=both[:1], unseen=()), settings, both[1])


def named(record: FlightRecord, name: str) -> FlightRecord:
    """The same data as another log."""
    return replace(record, source=replace(record.source, name=name, sha256=name))


def changed(record: FlightRecord, name: str, **channels: float | None) -> FlightRecord:
    """Another log, with channels multiplied by a factor, or left out where that is ``None``."""
    (topic,) = record.topics
    kept = [row for row, channel in enumerate(topic.channels) if channels.get(channel.name, 1.0) is not None]
    factors = [channels.get(topic.channels[row].name, 1.0) for row in kept]
    values = topic.values[kept] * np.array(factors, dtype=np.float64)[:, None]
    other = replace(topic, values=values, channels=tuple(topic.channels[row] for row in kept))
    return replace(named(record, name), topics=(other,))


def deaf(record: FlightRecord, name: str) -> FlightRecord:
    """Another log, whose rate is noise that no command caused."""
    (topic,) = record.topics
    values = topic.values.copy()
    values[topic.row("p")] = np.random.default_rng(4).standard_normal(topic.time_s.size)
    return replace(named(record, name), topics=(replace(topic, values=values),))


def judged(fit: Fit, flown: Flight, *, band: tuple[float, float] | None = None) -> FrequencyCheck:
    fitted = fit.fitted
    return check_sweeps(
        fitted.structure,
        fitted.parameters,
        [flown],
        band_rad_s=band or fitted.band_rad_s,
        settings=fit.settings,
    )


def checked(fit: Fit, *verify: FlightRecord) -> Verifications:
    predictor = LinearPredictor(candidate_of(fit.fitted, fit.measured))
    return predictor.predict(verify, judging(fit.settings), fit.selection).found


def of_kind(kind: str, findings: tuple[Finding, ...]) -> dict[str, str]:
    """Messages of the findings of a kind, by where they are."""
    return {finding.where: finding.message for finding in findings if finding.kind == kind}


def kinds(document: ResultDocument) -> set[str]:
    return {finding.kind for finding in document.findings}


def test_the_last_of_several_sweeps_is_held_out(record: FlightRecord) -> None:
    document = result_document(identify([record], "rate.roll", settings=IdentifySettings(band_rad_s=BAND)))
    (held_out,) = (finding for finding in document.findings if finding.kind == "held_out")
    # The second sweep starts at 56 s and fades in.
    assert held_out.where.startswith("sweeps.csv at 56.")
    assert document.verification.frequency.keys() == {"p/roll_command"}
    assert document.verification.frequency["p/roll_command"] < 50.0


def test_a_log_given_again_as_unseen_is_not_taken_for_unseen(record: FlightRecord, log: Path) -> None:
    settings = IdentifySettings(band_rad_s=BAND)
    document = result_document(identify([record], "rate.roll", settings=settings, verify=[read(log)]))
    assert document.verification.frequency == {}
    assert document.verification.records == {}
    assert "not_verified" in kinds(document)


def test_the_part_of_a_log_that_was_not_fitted_is_unseen(record: FlightRecord, log: Path) -> None:
    settings = IdentifySettings(band_rad_s=BAND, segments=(parse_segment("roll:3:53"),))
    document = result_document(identify([record], "rate.roll", settings=settings, verify=[read(log)]))
    assert document.verification.frequency.keys() == {"p/roll_command"}
    assert kinds(document).isdisjoint({"not_verified", "poor_verification"})


def test_a_model_that_is_plainly_wrong_is_refused(record: FlightRecord) -> None:
    # A lag of 0.2 s where there is none: wrong by far more than any noise.
    settings = IdentifySettings(band_rad_s=BAND, fix={"T_motor": 0.2, "L_p": -2.0})
    with pytest.raises(InsufficientDataError, match="does not describe these flights") as refused:
        identify([record], "rate.roll", settings=settings)
    assert "poor_fit" in {finding.kind for finding in refused.value.findings}


def ending(flown: Flight, top_rad_s: float) -> Flight:
    return Flight(flown.record, replace(flown.maneuver, band_rad_s=(1.0, top_rad_s)))


def test_a_sweep_is_judged_only_as_far_as_it_goes(first: Fit) -> None:
    short = ending(first.second, 30.0)
    response = measure([short], inputs=("roll_command",), outputs=("p",), settings=first.settings)
    top = response.trusted_rad_s[1]
    assert top < 30.0 < first.fitted.band_rad_s[1]
    (cost,) = judged(first, short).costs.values()
    assert [cost] == list(judged(first, first.second, band=(first.fitted.band_rad_s[0], top)).costs.values())
    assert [cost] != list(judged(first, first.second).costs.values())


def test_a_sweep_below_the_fitted_band_says_so(first: Fit) -> None:
    with pytest.raises(InsufficientDataError, match="do not reach the fitted band of 1"):
        judged(first, ending(first.second, 11.0))


def test_a_response_that_the_model_does_not_have_is_not_judged(first: Fit) -> None:
    """Its parameters were dropped: zero has no decibels."""
    silent = replace(first.fitted, parameters=first.fitted.parameters.fix("L_roll", 0.0))
    with pytest.raises(InsufficientDataError, match="no point of its sweeps"):
        judged(first._replace(fitted=silent), first.second)


def test_a_log_of_another_vehicle_is_said_to_be_missed(first: Fit, record: FlightRecord) -> None:
    found = checked(first, changed(record, "other.csv", p=3.0, phi=3.0))
    # Three times the gain is 9.5 dB everywhere: a cost of about 20 times its square.
    assert found.frequency["p/roll_command"] == pytest.approx(20.0 * (20.0 * np.log10(3.0)) ** 2, rel=0.2)
    assert list(of_kind("poor_verification", found.findings)) == ["other.csv: p/roll_command"]
    assert "not_verified" not in {finding.kind for finding in found.findings}


def test_a_log_whose_rate_contradicts_its_attitude_judges_nothing(first: Fit, record: FlightRecord) -> None:
    found = checked(first, changed(record, "other.csv", p=3.0))
    assert found.frequency == {}
    assert "p is 3.00 times what" in of_kind("not_verified", found.findings)["other.csv"]


def test_every_log_that_adds_nothing_is_named_with_its_cause(first: Fit, record: FlightRecord) -> None:
    quiet = changed(record, "quiet.csv", roll_command=0.0, roll_excitation=0.0, p_setpoint=0.0, phi_setpoint=0.0)
    lacking, useful = changed(record, "lacking.csv", p=None), named(record, "useful.csv")
    found = checked(first, quiet, deaf(record, "deaf.csv"), useful, lacking)
    causes = of_kind("not_verified", found.findings)
    assert causes.keys() == {"quiet.csv", "deaf.csv", "lacking.csv"}
    assert "contains no excitation of roll" in causes["quiet.csv"]
    assert "no point of its sweeps in the fitted band" in causes["deaf.csv"]
    assert "lacking.csv has no p" in causes["lacking.csv"]
    assert found.frequency["p/roll_command"] < 50.0


def test_a_good_log_does_not_hide_a_bad_one(first: Fit, record: FlightRecord) -> None:
    good, bad = named(record, "good.csv"), changed(record, "bad.csv", p=3.0, phi=3.0)
    alone, both = checked(first, bad), checked(first, good, bad)
    assert both.frequency == alone.frequency
    assert list(of_kind("poor_verification", both.findings)) == ["bad.csv: p/roll_command"]


def test_remarks_on_unseen_sweeps_are_kept(first: Fit, record: FlightRecord) -> None:
    # Without an instrument the estimate is a direct one, which is remarked on.
    bare = changed(record, "bare.csv", roll_excitation=None, phi_setpoint=None)
    assert "roll_command" in of_kind("closed_loop_bias", judged(first, Flight(bare, first.second.maneuver)).findings)


def test_the_second_fit_of_a_hold_out_begins_from_nothing(first: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    posed: list[FrequencyProblem] = []

    def seen(problem: FrequencyProblem) -> Reduced:
        posed.append(problem)
        return fit_and_drop(problem)

    monkeypatch.setattr("rotorid.checking.sweeps.fit_and_drop", seen)
    structure = rate_model("rate.roll")
    hold_out(structure, [*first.selection.fitted, first.second], first.settings)
    (problem,) = posed
    # The fit of the result dropped some; the data without the last maneuver have to speak for themselves.
    assert problem.parameters.free == structure.parameters.free
    assert first.fitted.problem.parameters.free != problem.parameters.free
    np.testing.assert_array_equal(problem.data.values, first.measured.response.values)


def test_why_nothing_could_be_held_out_is_said(first: Fit, record: FlightRecord) -> None:
    rest = Flight(record, parse_segment("roll:0.2:2.4"))
    held = hold_out(first.fitted.structure, [rest, first.second], first.settings)
    (message,) = of_kind("not_verified", held.findings).values()
    measured = measure([rest], inputs=("roll_command",), outputs=("p",), settings=first.settings)
    with pytest.raises(InsufficientDataError) as caught:
        pose(first.fitted.structure, measured, first.settings)
    assert caught.value.came.rstrip(".") in message
    assert held.costs == {}


def test_a_single_maneuver_cannot_be_held_out(first: Fit) -> None:
    held = hold_out(first.fitted.structure, [first.second], first.settings)
    assert "All maneuvers were used for the fit" in of_kind("not_verified", held.findings)["verification"]


def of_axis(flown: Flight, axis: Axis) -> Flight:
    return Flight(flown.record, replace(flown.maneuver, axis=axis))


def test_the_only_maneuver_of_an_axis_is_not_held_out(first: Fit) -> None:
    # Relabeled, so that each axis was flown once: without either, its parameters would be those of noise.
    once = [*first.selection.fitted, of_axis(first.second, "pitch")]
    assert "each on its own axis" in of_kind("not_verified", hold_out(*held(first, once)).findings)["verification"]


def of_motor(flown: Flight, motor: str) -> Flight:
    return Flight(flown.record, replace(flown.maneuver, signal=motor))


def test_the_only_sweep_of_a_motor_is_not_held_out(first: Fit) -> None:
    # On a pivot both motors turn one axis, but each has its own delay, which only its own sweep shows.
    once = [of_motor(first.selection.fitted[0], "motor_3_excitation"), of_motor(first.second, "motor_4_excitation")]
    assert "verification" in of_kind("not_verified", hold_out(*held(first, once)).findings)
    twice = [*once, of_motor(first.second, "motor_4_excitation")]
    assert of_kind("held_out", hold_out(*held(first, twice)).findings)


def test_sweeps_of_motors_without_test_inputs_are_not_held_out(first: Fit) -> None:
    bench = library_model("rig.roll"), [*first.selection.fitted, first.second], first.settings
    assert "verification" in of_kind("not_verified", hold_out(*bench).findings)


def test_the_last_maneuver_of_an_axis_flown_twice_is_held_out(first: Fit) -> None:
    flown = [*first.selection.fitted, first.second, of_axis(first.selection.fitted[0], "pitch")]
    (where,) = of_kind("held_out", hold_out(*held(first, flown)).findings)
    assert where == f"sweeps.csv at {first.second.maneuver.start_s:.1f} s"


def held(fit: Fit, flown: list[Flight]) -> tuple[LinearStructure, list[Flight], IdentifySettings]:
    return rate_model("rate.roll"), flown, fit.settings
