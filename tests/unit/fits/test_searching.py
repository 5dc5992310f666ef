"""A search before a fit: the same one from the same seed, all of its minima kept, and other models named."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.checking.response_flight import RATE_HZ, TRUTH, flight
from tests.unit.fitting.known_models import posed

from rotorid.data.record import Maneuver
from rotorid.documents.result import ResultDocument, result_document
from rotorid.errors import UsageError
from rotorid.fits.frequency import fit as fitting
from rotorid.fits.searching import (
    NEARLY_AS_GOOD,
    Searched,
    judge_minima,
    search_summary,
    searched,
    searched_minima,
)
from rotorid.fits.time.fit import fit_in_time
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import same_cost
from rotorid.fitting.time.output_error import TimeProblem
from rotorid.flights.flights import Flight
from rotorid.flights.segments import TimeRecords, time_records
from rotorid.identifying.identification import identify
from rotorid.models.families import named_model
from rotorid.models.library import response_model
from rotorid.models.toml import from_toml
from rotorid.reduction.guided import Reduced, fit_and_drop
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import SearchSummary
from rotorid.search.result import Basin
from rotorid.settings.identifying import EVALUATIONS, IdentifySettings
from rotorid.settings.parsing import parse_segment
from rotorid.uncertainty.cramer_rao import Bounds

MODEL = "response.second_order_delay"
SECOND = response_model(MODEL, [("phi_setpoint", "phi")])
LAGS = from_toml(
    """
    name = "two lags"
    inputs = ["u"]
    states = ["x", "y"]
    equations = ["T_fast*x' = u - x", "T_slow*y' = K*x - y"]
    outputs = ["y"]
    [parameters]
    K = { value = 1.0, unit = "1" }
    T_fast = { value = 0.05, unit = "s", lower = 0.001 }
    T_slow = { value = 0.1, unit = "s", lower = 0.001 }
    """
)
"""Its lags can change places, which no data see."""


WHOLE = (parse_segment("roll:3:32.9"),)


def of_lags(**choices: object) -> Searched:
    problem = posed(LAGS, {"K": 2.0, "T_fast": 0.03, "T_slow": 0.2}, np.geomspace(1.0, 60.0, 30), noise=0.01)
    settings = IdentifySettings(**{"search": "sobol:12", **choices})  # type: ignore[arg-type]
    found = searched(problem, settings)
    assert found is not None
    return found


def bounds_of(std: float) -> Bounds:
    return Bounds(
        names=LAGS.parameters.free,
        cramer_rao=np.full(3, std),
        insensitivity=np.full(3, std),
        covariance=np.diag(np.full(3, std**2)),
        random=np.diag(np.full(3, std**2)),
        colored=1.0,
    )


def with_basins(found: Searched, *basins: Basin) -> Searched:
    return replace(found, result=replace(found.result, basins=basins))


@pytest.fixture(scope="module")
def records() -> TimeRecords:
    record = flight(samples=600)
    maneuver = Maneuver(axis="roll", kind="other", start_s=record.start_s, stop_s=record.stop_s)
    return time_records(SECOND, [Flight(record, maneuver)], IdentifySettings())


@pytest.fixture(scope="module")
def by_responses() -> IdentifiedModel:
    return identify([flight()], MODEL, settings=IdentifySettings(method="frequency", segments=WHOLE, search="sobol:6"))


@pytest.fixture(scope="module")
def by_outputs() -> IdentifiedModel:
    return identify([flight()], MODEL, settings=IdentifySettings(search="evolution", evaluations=75))


def told(document: ResultDocument) -> SearchSummary:
    assert document.search is not None
    return document.search


def near_truth(document: ResultDocument, *, hold_s: float = 0.0) -> None:
    for name, value in TRUTH.items():
        known = value + hold_s * (name == "tau_phi")
        assert document.parameters[name].value == pytest.approx(known, rel=0.15), name


def test_a_fit_of_responses_begins_at_the_best_of_a_search(by_responses: IdentifiedModel) -> None:
    document = result_document(by_responses)
    # A response between samples contains half a step of the held input.
    near_truth(document, hold_s=0.5 / RATE_HZ)
    search = told(document)
    assert (search.name, search.objective, search.local_searches) == ("sobol:6", "frequency", 6)
    assert search.minima[0].cost == min(one.cost for one in search.minima)
    assert sum(one.share for one in search.minima) == pytest.approx(1.0)
    assert [one.cost for one in document.minima] == [one.cost for one in search.minima[1:]]
    assert document.fit is not None
    # Nothing was dropped, so both minimized the same cost.
    assert document.fit.trace[-1] == pytest.approx(search.minima[0].cost, rel=1e-3)


def test_later_fits_to_parts_of_the_data_begin_there_too(
    by_responses: IdentifiedModel, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[FrequencyProblem] = []

    def remembered(problem: FrequencyProblem) -> Reduced:
        begun.append(problem)
        return fit_and_drop(problem)

    monkeypatch.setattr(fitting, "fit_and_drop", remembered)
    settings = IdentifySettings(method="frequency", segments=WHOLE, search="sobol:6")
    assert result_document(identify([flight()], MODEL, settings=settings)) == result_document(by_responses)
    best = told(result_document(by_responses)).minima[0].parameters
    assert begun[0].parameters.values == best
    assert begun[0].structure.parameters.values == best


def test_a_fit_in_time_begins_at_all_minima_of_a_search(by_outputs: IdentifiedModel) -> None:
    near_truth(result_document(by_outputs))
    search = told(result_document(by_outputs))
    assert (search.name, search.objective) == ("evolution", "output_error")
    assert 0 < search.evaluations <= 75
    assert search.polishing > 0
    assert set(search.minima[0].parameters) == set(TRUTH)
    counts, costs = zip(*search.trace, strict=True)
    assert all(one < other for one, other in itertools.pairwise(counts))
    assert all(one >= other for one, other in itertools.pairwise(costs))
    assert search.minima[0].cost <= costs[-1]
    assert (result_document(by_outputs).provenance.settings["search"], result_document(by_outputs).provenance.seed) == (
        "evolution",
        0,
    )


def test_the_same_seed_gives_the_same_result(by_outputs: IdentifiedModel) -> None:
    def again(seed: int) -> ResultDocument:
        return result_document(
            identify([flight()], MODEL, settings=IdentifySettings(search="evolution", evaluations=75, seed=seed))
        )

    assert again(0) == result_document(by_outputs)
    assert told(again(1)).trace != told(result_document(by_outputs)).trace


def test_progress_tells_evaluations_and_the_best_cost(records: TimeRecords, caplog: pytest.LogCaptureFixture) -> None:
    settings = IdentifySettings(search="evolution", evaluations=30)
    with caplog.at_level("INFO", logger="rotorid.progress"):
        fit_in_time(SECOND, records, settings, method="output_error")
    assert [line for line in caplog.messages if line.startswith("searching by evolution: 30 evaluations, best cost ")]


def test_the_budget_has_a_default_and_a_design_of_starts_has_none(records: TimeRecords) -> None:
    assert 0.9 * EVALUATIONS < of_lags(search="evolution").result.evaluations <= EVALUATIONS
    first = response_model("response.first_order", [("phi_setpoint", "phi")])
    problem = TimeProblem(structure=first, parameters=first.parameters, records=records.data).shortened(200)
    sizes = {"central": 2**2 + 2 * 2 + 1, "sobol:4": 4, "random:3": 3}
    for starts, size in sizes.items():
        found = searched(problem, IdentifySettings(starts=starts))
        assert found is not None
        assert (found.name, found.result.local_searches) == (starts, size)
    assert searched(problem, IdentifySettings()) is None


def test_starts_and_the_search_of_their_name_end_in_one_place(records: TimeRecords) -> None:
    ends = [
        fit_in_time(SECOND, records, settings, method="output_error")
        for settings in (IdentifySettings(starts="sobol:2"), IdentifySettings(search="sobol:2", evaluations=10**6))
    ]
    assert ends[0].parameters == ends[1].parameters
    assert search_summary(ends[0].search) == search_summary(ends[1].search)
    # With the start values of the model alone there is no search, and none of its minima.
    plain = fit_in_time(SECOND, records, IdentifySettings(), method="output_error")
    assert plain.search is None
    assert search_summary(plain.search) is None
    assert searched_minima(plain.search) == ()


def test_of_two_minima_with_one_cost_the_one_near_the_model_leads() -> None:
    for seed in range(4):
        first, second = of_lags(seed=seed).minima
        assert same_cost(first.cost, second.cost)
        assert first.theta[1] < first.theta[2]
        assert first.theta[1:] == pytest.approx(second.theta[:0:-1], rel=1e-4)


def test_poles_that_change_places_are_named_and_told() -> None:
    found = of_lags()
    parameters = LAGS.parameters.unpack(found.minima[0].theta)
    (finding,) = judge_minima(found, parameters, bounds_of(1e-3))
    assert (finding.kind, finding.where) == ("other_minimum", "T_fast")
    assert "the same cost" in finding.message
    assert finding.numbers["T_fast"] == pytest.approx(0.2, rel=0.05)
    assert finding.numbers["lowest_cost"] == pytest.approx(finding.numbers["cost"])


@pytest.mark.parametrize(
    ("worse", "away", "std", "told"),
    [
        (0.5 * NEARLY_AS_GOOD, 2.0, 1e-3, 1),
        (2.0 * NEARLY_AS_GOOD, 2.0, 1e-3, 0),  # too high
        (0.5 * NEARLY_AS_GOOD, 1.05, 1e-3, 0),  # hardly elsewhere
        (0.5 * NEARLY_AS_GOOD, 2.0, 1.0, 0),  # within the errors
    ],
)
def test_another_minimum_is_told_where_it_is_nearly_as_good_and_clearly_elsewhere(
    worse: float, away: float, std: float, told: int
) -> None:
    plain = of_lags()
    best = plain.minima[0]
    other = best._replace(cost=best.cost * (1.0 + worse), theta=best.theta * np.array([away, 1.0, 1.0]))
    found = with_basins(plain, best, other)
    findings = judge_minima(found, LAGS.parameters.unpack(best.theta), bounds_of(std))
    assert len(findings) == told
    if told:
        assert f"{100.0 * worse:.1f} % higher, at K = " in findings[0].message
    # A minimum that lies where the result is, which other weights have moved there, is no other model.
    assert judge_minima(found, LAGS.parameters.unpack(other.theta), bounds_of(std)) == ()


def test_of_several_the_best_is_told_and_the_others_are_counted() -> None:
    plain = of_lags()
    best = plain.minima[0]
    moved = [
        best._replace(cost=best.cost * (1.0 + rise), theta=best.theta * (1.0 + 50.0 * rise)) for rise in (0.02, 0.04)
    ]
    (finding,) = judge_minima(with_basins(plain, best, *moved), LAGS.parameters.unpack(best.theta), bounds_of(1e-6))
    assert finding.numbers["more"] == 1
    assert "2.0 % higher" in finding.message
    assert "; 1 more is at most 10 % higher" in finding.message


def test_a_search_finds_what_the_starts_of_a_model_do_not() -> None:
    """A delay that is many times its start value: the phase wraps on the way."""
    late = from_toml(
        """
        name = "late"
        inputs = ["u"]
        states = ["y"]
        equations = ["y' = a*y + b*u"]
        outputs = ["y"]
        delays = { u = "tau" }
        [parameters]
        a = { value = -1.0, unit = "1/s" }
        b = { value = 1.0, unit = "1/s" }
        tau = { value = 0.3, unit = "s", lower = 0.0, upper = 2.0 }
        """
    )
    omega = np.geomspace(2.0, 40.0, 40)
    problem = posed(late, {"a": -2.0, "b": 3.0, "tau": 0.7}, omega, noise=0.01)
    stuck = fit_frequency(problem, starts=[problem.parameters.pack()])
    found = searched(problem, IdentifySettings(search="evolution"))
    assert found is not None
    assert found.minima[0].cost < 0.01 * stuck.cost
    assert found.minima[0].theta == pytest.approx([-2.0, 3.0, 0.7], rel=0.05)


@pytest.mark.parametrize(
    ("choices", "came"),
    [
        ({"search": "evolutoin"}, "did you mean evolution"),
        ({"search": "sobol:0"}, "invalid option '0' of the search sobol"),
        ({"evaluations": 100}, "--evaluations needs a search"),
        ({"search": "cma", "evaluations": 0}, "--evaluations 0 is too few"),
        ({"search": "cma", "starts": "sobol:4"}, "--search and --starts"),
    ],
)
def test_wrong_searches_are_refused(choices: dict[str, object], came: str) -> None:
    with pytest.raises(UsageError, match=came):
        IdentifySettings(**choices)  # type: ignore[arg-type]


def test_what_has_nothing_to_search_is_refused(records: TimeRecords) -> None:
    box = named_model("black_box:1", inputs=["phi_setpoint"], outputs=["phi"])
    for choices in ({"search": "cma"}, {"starts": "sobol:4"}):
        settings = IdentifySettings(**choices)  # type: ignore[arg-type]
        with pytest.raises(UsageError, match="a black box starts from subspace identification"):
            fit_in_time(box, records, settings, method="output_error")
        with pytest.raises(UsageError, match="regression has one minimum"):
            identify([flight(samples=400)], MODEL, settings=replace(settings, method="equation_error"))


def test_a_trace_begins_where_a_cost_is_a_number() -> None:
    found = of_lags()
    first = found.result.trace[0]
    trace = (first._replace(evaluations=1, best=math.inf), *found.result.trace)
    document = search_summary(replace(found, result=replace(found.result, trace=trace)))
    assert document is not None
    assert document.trace[0] == (first.evaluations, first.best)
