"""A bootstrap beside the stated errors: from responses and from outputs, the same from the same seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.checking.response_flight import flight

from rotorid.data.record import Maneuver
from rotorid.documents.result import result_document
from rotorid.errors import UsageError
from rotorid.fits.bootstrapping import Bootstrap, bootstrap
from rotorid.fits.time.fit import TimeFit, fit_in_time
from rotorid.flights.flights import Flight
from rotorid.flights.segments import time_records
from rotorid.identifying.identification import identify
from rotorid.models.library import response_model
from rotorid.results.model import IdentifiedModel
from rotorid.results.summary import BootstrapSummary
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.parsing import parse_segment
from rotorid.uncertainty.resampling import SpreadTable

MODEL = "response.second_order_delay"
SECOND = response_model(MODEL, [("phi_setpoint", "phi")])
RUNS = 200


@pytest.fixture(scope="module")
def by_responses() -> IdentifiedModel:
    settings = IdentifySettings(method="frequency", segments=(parse_segment("roll:3:32.9"),), bootstrap=RUNS, seed=3)
    return identify([flight()], MODEL, settings=settings)


@pytest.fixture(scope="module")
def fitted() -> TimeFit:
    record = flight(samples=800)
    maneuver = Maneuver(axis="roll", kind="other", start_s=record.start_s, stop_s=record.stop_s)
    records = time_records(SECOND, [Flight(record, maneuver)], IdentifySettings())
    return fit_in_time(SECOND, records, IdentifySettings(), method="output_error")


def drawn(fitted: TimeFit, settings: IdentifySettings) -> Bootstrap | None:
    return bootstrap(fitted.problem, fitted.solution, fitted.bounds, settings)


def of(identified: IdentifiedModel) -> BootstrapSummary:
    assert result_document(identified).bootstrap is not None
    return result_document(identified).bootstrap


def test_responses_are_drawn_about_the_fit_that_gave_the_values(by_responses: IdentifiedModel) -> None:
    again, parameters = of(by_responses), result_document(by_responses).parameters
    assert (again.source, again.runs, again.seed) == ("responses", RUNS, 3)
    assert list(again.parameters) == [name for name, one in parameters.items() if one.status == "free"]
    for name, spread in again.parameters.items():
        one = parameters[name]
        assert one.std is not None
        # Of 200 runs a standard deviation is known to 5 % and a mean to 7 % of it: five of these.
        assert spread.std == pytest.approx(one.std, rel=0.25), name
        assert abs(spread.mean - one.value) < 0.35 * one.std, name
        assert spread.low < spread.median < spread.high
        assert spread.relative_percent == pytest.approx(100.0 * spread.std / abs(spread.mean))
    assert "bootstrap_disagrees" not in {finding.kind for finding in by_responses.findings}
    matrix = np.array(again.correlation.matrix)
    assert again.correlation.names == tuple(again.parameters)
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    stated = result_document(by_responses).correlation
    assert stated is not None
    assert np.abs(matrix - np.array(stated.matrix)).max() < 0.3


def test_outputs_are_drawn_with_the_color_of_the_residuals(fitted: TimeFit, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO", logger="rotorid.progress"):
        found = drawn(fitted, IdentifySettings(bootstrap=60))
    assert found is not None
    assert found.source == "outputs"
    # Of 60 runs a standard deviation is known to 9 %: four of these. White noise would be off by its inflation.
    np.testing.assert_allclose(found.table.std, fitted.bounds.random_std, rtol=0.37)
    assert fitted.bounds.inflation > 1.6
    assert caplog.messages[-1] == "bootstrap: 60 of 60 runs"


def test_the_same_seed_gives_the_same_table(fitted: TimeFit) -> None:
    tables = [drawn(fitted, IdentifySettings(bootstrap=6, seed=seed)) for seed in (1, 1, 2)]
    documents = [table and table.summary for table in tables]
    assert documents[0] == documents[1]
    assert documents[0] != documents[2]


def test_none_is_made_unless_it_is_asked_for(fitted: TimeFit) -> None:
    assert drawn(fitted, IdentifySettings()) is None


@pytest.mark.parametrize("method", ["prediction_error", "equation_error"])
def test_a_method_without_a_bootstrap_says_so_before_anything_is_fitted(method: str) -> None:
    settings = IdentifySettings(method=method, bootstrap=50)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=f"{method.replace('_', ' ')}"):
        identify([flight(samples=400)], MODEL, settings=settings)


def test_one_run_is_no_bootstrap() -> None:
    with pytest.raises(UsageError, match="1 is too few;"):
        IdentifySettings(bootstrap=1)


def test_a_spread_that_contradicts_the_stated_errors_is_told(fitted: TimeFit) -> None:
    narrow = replace(fitted, bounds=replace(fitted.bounds, random=0.04 * fitted.bounds.random))
    found = drawn(narrow, IdentifySettings(bootstrap=40))
    assert found is not None
    # Five times as wide as stated.
    assert {one.where for one in found.findings if one.kind == "bootstrap_disagrees"} == set(fitted.bounds.names)


def test_what_does_not_scatter_has_no_relative_spread_and_no_correlation() -> None:
    draws = np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    table = SpreadTable(names=("K", "a"), estimate=np.array([2.0, 0.0]), draws=draws, seed=4, left_out={"no value": 2})
    document = Bootstrap(source="responses", table=table, findings=()).summary
    assert (document.runs, document.left_out) == (5, {"no value": 2})
    assert document.parameters["a"].relative_percent is None
    assert document.correlation.matrix == ((1.0, 0.0), (0.0, 1.0))
