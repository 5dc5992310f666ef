"""Identification in time on a flight whose answer is known: values, bounds, hold, comparison, verification."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.checking.response_flight import RATE_HZ, TRUTH, binary, flight

from rotorid.data.record import Maneuver
from rotorid.documents.result import result_document
from rotorid.errors import UsageError
from rotorid.fits.time.feedback import following, judge_following
from rotorid.fits.time.fit import fit_in_time
from rotorid.fits.time.frequency_check import judge_agreement
from rotorid.fits.time.remarks import judge_time_fit
from rotorid.fitting.time.output_error import TimeData, TimeProblem, own_starts
from rotorid.flights.flights import Flight
from rotorid.flights.segments import TimeRecords, evenly_stamped, time_records
from rotorid.identifying.families import method_of
from rotorid.identifying.identification import identify
from rotorid.identifying.methods import InTime
from rotorid.models.equations import structure_from_equations
from rotorid.models.families import named_model
from rotorid.models.library import rate_model, response_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.results.model import IdentifiedModel
from rotorid.results.segment import Segment
from rotorid.results.summary import Compared
from rotorid.settings.identifying import IdentifySettings
from rotorid.simulation.linear import simulate_linear

SECOND = response_model("response.second_order_delay", [("phi_setpoint", "phi")])


@pytest.fixture(scope="module")
def result() -> IdentifiedModel:
    return identify([flight()], "response.second_order_delay", verify=[flight(seed=7)])


def test_the_truth_lies_within_the_bounds_that_the_color_of_the_noise_demands(result: IdentifiedModel) -> None:
    for name, value in TRUTH.items():
        found = result_document(result).parameters[name]
        assert found.std is not None
        # Four deviations: one in sixteen thousand by chance.
        assert abs(found.value - value) < 4.0 * found.std, name
    assert result_document(result).residuals is not None
    assert result_document(result).residuals.inflation > 1.2
    assert "colored_residuals" in {finding.kind for finding in result_document(result).findings}


def test_the_document_says_how_the_fit_was_made(result: IdentifiedModel) -> None:
    document = result_document(result)
    assert (document.method, document.hold, document.pieces_s) == ("output_error", "zero", None)
    assert document.fit_percent is not None
    assert document.fit_percent["phi"] > 90.0
    assert [(one.record, one.samples, one.pieces) for one in document.records] == [("flight0.csv", 1500, 1)]
    assert document.records[0].fit_percent["phi"] == pytest.approx(document.fit_percent["phi"])
    # The colored noise of the flight: 4 mrad.
    assert document.noise is not None
    assert document.noise["phi"] == pytest.approx(0.004, rel=0.2)
    assert document.information is not None
    # Four parameters, two initial states, a trim and a variance.
    assert document.information.numbers == 8
    assert document.information.bic > document.information.aic


def test_both_domains_agree_once_the_hold_is_counted(result: IdentifiedModel) -> None:
    beside = result_document(result).frequency_fit
    assert beside is not None
    assert beside["tau_phi"].hold_s == pytest.approx(0.5 / RATE_HZ, rel=1e-6)
    assert beside["tau_phi"].value - TRUTH["tau_phi"] > 0.5 * beside["tau_phi"].hold_s
    assert result_document(result).cost is not None
    assert "methods_disagree" not in {finding.kind for finding in result_document(result).findings}


def test_an_unseen_record_is_simulated_and_scored(result: IdentifiedModel) -> None:
    (check,) = result.verifications.maneuvers
    assert check.record == "flight7.csv"
    assert check.scores["phi"].nrmse_fit_percent > 90.0
    assert check.time_s.size == 1500
    assert result_document(result).verification.records


def test_records_are_handed_on_for_the_pictures(result: IdentifiedModel) -> None:
    (one,) = result.data.simulated
    assert one.measured.shape == one.simulated.shape == (1, 1500)
    assert one.starts == (0,)
    error = one.measured - one.simulated
    assert float(np.std(error)) == pytest.approx((result_document(result).noise or {})["phi"], rel=0.02)


def test_jittery_stamps_leave_the_samples_as_they_are() -> None:
    plain, jittery = flight(), flight(jitter_s=0.004)
    maneuver = Maneuver(axis="roll", kind="other", start_s=plain.start_s - 1.0, stop_s=plain.stop_s + 1.0)
    records = time_records(SECOND, [Flight(jittery, replace(maneuver, start_s=jittery.start_s))], IdentifySettings())
    assert records.hold == "zero"
    np.testing.assert_array_equal(records.data[0].outputs[0], jittery.topics[0].values[1])
    steps = np.diff(evenly_stamped(jittery, maneuver, ("phi", "phi_setpoint")).topics[0].time_s)
    assert np.ptp(steps) < 1e-9
    # Half a step and more is no jitter: then nothing is moved.
    wild = flight(jitter_s=0.03)
    assert evenly_stamped(wild, maneuver, ("phi", "phi_setpoint")) is wild


def test_the_method_follows_the_model_unless_it_is_named() -> None:
    box = named_model("black_box:2", inputs=["u"], outputs=["y"])
    plain = IdentifySettings()

    def kind(structure: LinearStructure, settings: IdentifySettings) -> str:
        method = method_of(structure, (), settings)
        return method.kind if isinstance(method, InTime) else type(method).__name__

    assert [kind(one, plain) for one in (SECOND, box, rate_model("rate.roll"))] == [
        "output_error",
        "output_error",
        "Frequency",
    ]
    assert kind(SECOND, IdentifySettings(method="frequency")) == "Frequency"
    assert kind(rate_model("rate.roll"), IdentifySettings(method="prediction_error")) == "prediction_error"


def test_what_cannot_be_done_in_time_is_refused() -> None:
    box = named_model("black_box:1", inputs=["u"], outputs=["y"])
    with pytest.raises(UsageError, match="output_error or prediction_error"):
        fit_in_time(box, of_rate(-1.0)[0], IdentifySettings(), method="equation_error")


def test_equations_are_fitted_over_the_band_of_the_responses(result: IdentifiedModel) -> None:
    found = identify([flight()], "response.second_order_delay", settings=IdentifySettings(method="equation_error"))
    document = result_document(found)
    assert document.method == "equation_error"
    (equation,) = document.equations
    assert equation.name == "v_phi'"
    assert 0.0 < equation.r_squared < 1.0
    assert equation.press > 0.0
    # The bars of the frequency domain.
    for name, value in TRUTH.items():
        assert document.parameters[name].status == "free"
        near = {"abs": 1e-3} if name == "tau_phi" else {"rel": 0.08}
        assert document.parameters[name].value == pytest.approx(value, **near), name
    # The values are shown by a simulation, which fits no better than the fit that makes it fit best.
    assert found.data.simulated[0].simulated.shape == (1, 1500)
    assert document.fit_percent is not None
    assert 90.0 < document.fit_percent["phi"] <= (result_document(result).fit_percent or {})["phi"]
    assert document.log_likelihood is not None
    assert document.log_likelihood <= (result_document(result).log_likelihood or 0.0)
    assert document.residuals is not None
    assert document.residuals.memory == 0
    assert result_document(result).equations == []


def test_a_band_that_was_asked_for_is_the_one_of_the_equations() -> None:
    records, problem = of_rate(-1.0)
    wide, narrow = (
        fit_in_time(
            problem.structure, records, IdentifySettings(band_rad_s=(0.5, high)), method="equation_error"
        ).equations[0]
        for high in (20.0, 5.0)
    )
    # Of a sum of squares over a band less is left over a part of it.
    assert narrow.press < wide.press


def test_without_responses_equations_are_fitted_sample_by_sample() -> None:
    records, problem = of_rate(-1.0)
    fitted = fit_in_time(problem.structure, records, IdentifySettings(), method="equation_error")
    assert fitted.bounds.names == ("a", "b")
    assert [one.name for one in fitted.equations] == ["y'"]
    assert fitted.pieces_s is None
    white = fitted.bounds.cramer_rao / 2.0
    assert fitted.bounds.inflation == pytest.approx(np.sqrt(np.prod(fitted.bounds.random_std / white)))
    assert (fitted.bounds.insensitivity <= white * (1.0 + 1e-9)).all()


def test_a_growing_model_is_simulated_in_pieces_to_show_its_equations() -> None:
    records, problem = of_rate(1.0)
    fitted = fit_in_time(problem.structure, records, IdentifySettings(), method="equation_error")
    assert fitted.pieces_s is not None
    (finding,) = (one for one in judge_time_fit(fitted, records, {}) if one.kind == "fitted_in_pieces")
    assert "simulated in" in finding.message


def test_what_no_measured_equation_holds_stays_where_it_was() -> None:
    record = flight(samples=400)
    maneuver = Maneuver(axis="roll", kind="other", start_s=record.start_s, stop_s=record.stop_s)
    lagged = structure_from_equations(
        name="lagged",
        inputs=["phi_setpoint"],
        states=["phi", "m"],
        equations=["phi' = a*phi + b*m", "m' = (phi_setpoint - m)/T"],
        outputs=["phi"],
        parameters=ParameterSet(
            [
                Parameter(name="a", value=-1.0, unit="1/s"),
                Parameter(name="b", value=1.0, unit="1/s"),
                Parameter(name="T", value=0.1, unit="s", lower=0.01),
            ]
        ),
    )
    records = time_records(lagged, [Flight(record, maneuver)], IdentifySettings())
    fitted = fit_in_time(lagged, records, IdentifySettings(), method="equation_error")
    assert fitted.bounds.names == ("a", "b")
    assert (fitted.listed["T"].status, fitted.listed["T"].value) == ("fixed", 0.1)
    assert ("not_in_measured_equations", "T") in {(one.kind, one.where) for one in fitted.findings}


def of_rate(growth_1_s: float, *, samples: int = 800, seed: int = 0) -> tuple[TimeRecords, TimeProblem]:
    """A record of x' = a x + b u with a little noise, kept near zero by its input."""
    structure = structure_from_equations(
        name="growing",
        inputs=["u"],
        states=["y"],
        equations=["y' = a*y + b*u"],
        outputs=["y"],
        parameters=ParameterSet(
            [Parameter(name="a", value=0.5, unit="1/s"), Parameter(name="b", value=1.0, unit="1/s")]
        ),
    )
    rng = np.random.default_rng(seed)
    system = structure.matrices({"a": growth_1_s, "b": 2.0})
    gain, state, u, y = 2.0, 0.0, np.zeros(samples), np.zeros(samples)
    for k in range(samples):
        y[k] = state
        u[k] = -gain * state + rng.choice([-1.0, 1.0]) * 0.3
        state = float(simulate_linear(system, np.full((1, 2), u[k]), sample_rate_hz=20.0, x0=np.array([state]))[0, 1])
    data = TimeData(
        name="r", inputs=u[None], outputs=(y + 0.002 * rng.standard_normal(samples))[None], sample_rate_hz=20.0
    )
    problem = TimeProblem(structure=structure, parameters=structure.parameters, records=(data,))
    return TimeRecords((), (data,), "zero", ()), problem


def test_a_growing_mode_is_fitted_in_pieces_in_which_it_grows_twice_e_fold() -> None:
    records, problem = of_rate(1.0)
    fitted = fit_in_time(problem.structure, records, IdentifySettings(), method="output_error")
    assert fitted.pieces_s == pytest.approx(2.0, rel=0.1)
    assert len(fitted.problem.records) == pytest.approx(20, abs=2)
    for name, value in (("a", 1.0), ("b", 2.0)):
        row = fitted.bounds.names.index(name)
        assert abs(fitted.parameters[name].value - value) < 4.0 * float(fitted.bounds.std[row])


def test_pieces_that_were_asked_for_are_obeyed() -> None:
    records, problem = of_rate(-1.0)
    whole = fit_in_time(problem.structure, records, IdentifySettings(), method="output_error")
    pieces = fit_in_time(problem.structure, records, IdentifySettings(pieces_s=5.0), method="output_error")
    assert (whole.pieces_s, len(whole.problem.records)) == (None, 1)
    assert (pieces.pieces_s, len(pieces.problem.records)) == (5.0, 8)


def test_starts_respect_bounds() -> None:
    record = flight(samples=400)
    maneuver = Maneuver(axis="roll", kind="other", start_s=record.start_s, stop_s=record.stop_s)
    records = time_records(SECOND, [Flight(record, maneuver)], IdentifySettings())
    problem = TimeProblem(structure=SECOND, parameters=SECOND.parameters, records=records.data)
    low, high = problem.box
    for theta in own_starts(problem):
        assert ((theta >= low) & (theta <= high)).all()


def test_inputs_that_follow_errors_are_found_and_others_are_not() -> None:
    rng = np.random.default_rng(3)
    error = rng.standard_normal(4000)
    free = rng.standard_normal(4000)
    fed = free.copy()
    fed[3:] -= 0.4 * error[:-3]
    names = {"input_names": ["roll_command", "pitch_command"], "output_names": ["p"], "sample_rate_hz": 100.0}
    found = following([error[None]], [np.stack([fed, free])], **names)
    assert [finding.where for finding in judge_following(found)] == ["p/roll_command"]
    # 0.16 of 1.16 of what the command holds.
    assert found[0].share == pytest.approx(0.16 / 1.16, rel=0.25)
    switched = np.stack([binary(4000, rng), binary(4000, rng)])
    assert following([error[None]], [switched], **names) == ()


def test_a_difference_beyond_three_deviations_is_told_with_its_numbers() -> None:
    records, problem = of_rate(-1.0)
    fitted = fit_in_time(problem.structure, records, IdentifySettings(), method="output_error")
    a, std = fitted.parameters["a"].value, float(fitted.bounds.std[fitted.bounds.names.index("a")])
    near, far = (Compared(value=a + off * std, std=std) for off in (2.0, 10.0))
    assert judge_agreement(fitted, {"a": near}) == ()
    (finding,) = judge_agreement(fitted, {"a": far})
    assert (finding.kind, finding.where) == ("methods_disagree", "a")
    assert finding.numbers["distance_std"] == pytest.approx(10.0 / np.sqrt(2.0))


def test_segments_know_their_records(result: IdentifiedModel) -> None:
    (segment,) = result.data.segments
    assert isinstance(segment, Segment)
    assert segment.history.values.shape == (2, 1500)
