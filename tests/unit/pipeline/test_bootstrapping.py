"""A bootstrap beside the stated errors: from responses and from outputs, the same from the same seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.pipeline.response_flight import flight

from rotorid.data.record import Maneuver
from rotorid.documents.result import BootstrapDocument
from rotorid.errors import UsageError
from rotorid.models.library import response_model
from rotorid.pipeline.assemble import bootstrap_document
from rotorid.pipeline.bootstrapping import Bootstrapped, bootstrap
from rotorid.pipeline.identification import identify
from rotorid.pipeline.results import Identification
from rotorid.pipeline.segments import time_records
from rotorid.pipeline.settings import IdentifySettings, parse_segment
from rotorid.pipeline.time_fit import TimeFitted, fit_in_time
from rotorid.uncertainty.resampling import SpreadTable

MODEL = "response.second_order_delay"
SECOND = response_model(MODEL, [("phi_setpoint", "phi")])
RUNS = 200


@pytest.fixture(scope="module")
def by_responses() -> Identification:
    settings = IdentifySettings(method="frequency", segments=(parse_segment("roll:3:32.9"),), bootstrap=RUNS, seed=3)
    return identify([flight()], MODEL, settings=settings)


@pytest.fixture(scope="module")
def fitted() -> TimeFitted:
    record = flight(samples=800)
    maneuver = Maneuver(axis="roll", kind="other", start_s=record.start_s, stop_s=record.stop_s)
    records = time_records(SECOND, [(record, maneuver)], IdentifySettings())
    return fit_in_time(SECOND, records, IdentifySettings(), method="output_error")


def of(identified: Identification) -> BootstrapDocument:
    assert identified.document.bootstrap is not None
    return identified.document.bootstrap


def test_responses_are_drawn_about_the_fit_that_gave_the_values(by_responses: Identification) -> None:
    again, parameters = of(by_responses), by_responses.document.parameters
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
    matrix = np.array(again.correlation.matrix)
    assert again.correlation.names == list(again.parameters)
    np.testing.assert_allclose(np.diag(matrix), 1.0)
    stated = by_responses.document.correlation
    assert stated is not None
    assert np.abs(matrix - np.array(stated.matrix)).max() < 0.3


def test_outputs_are_drawn_with_the_color_of_the_residuals(
    fitted: TimeFitted, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO", logger="rotorid.progress"):
        found = bootstrap(fitted, IdentifySettings(bootstrap=60))
    assert found is not None
    assert found.source == "outputs"
    # Of 60 runs a standard deviation is known to 9 %: four of these. White noise would be off by its inflation.
    np.testing.assert_allclose(found.table.std, fitted.bounds.std, rtol=0.37)
    assert fitted.bounds.inflation > 1.6
    assert caplog.messages[-1] == "bootstrap: 60 of 60 runs"


def test_the_same_seed_gives_the_same_table(fitted: TimeFitted) -> None:
    tables = [bootstrap(fitted, IdentifySettings(bootstrap=6, seed=seed)) for seed in (1, 1, 2)]
    documents = [bootstrap_document(one) for one in tables]
    assert documents[0] == documents[1]
    assert documents[0] != documents[2]


def test_none_is_made_unless_it_is_asked_for(fitted: TimeFitted) -> None:
    assert bootstrap(fitted, IdentifySettings()) is None
    assert bootstrap_document(None) is None


@pytest.mark.parametrize("method", ["prediction_error", "equation_error"])
def test_a_method_without_a_bootstrap_says_so_before_anything_is_fitted(method: str) -> None:
    settings = IdentifySettings(method=method, bootstrap=50)  # type: ignore[arg-type]
    with pytest.raises(UsageError, match=f"{method.replace('_', ' ')}, which has none"):
        identify([flight(samples=400)], MODEL, settings=settings)


def test_one_run_is_no_bootstrap() -> None:
    with pytest.raises(UsageError, match="1 runs came"):
        IdentifySettings(bootstrap=1)


def test_a_spread_that_contradicts_the_stated_errors_is_told(fitted: TimeFitted) -> None:
    narrow = replace(fitted, bounds=replace(fitted.bounds, covariance=0.04 * fitted.bounds.covariance))
    found = bootstrap(narrow, IdentifySettings(bootstrap=40))
    assert found is not None
    # Five times as wide as stated.
    assert {one.where for one in found.findings if one.kind == "bootstrap_disagrees"} == set(fitted.bounds.names)


def test_what_does_not_scatter_has_no_relative_spread_and_no_correlation() -> None:
    draws = np.array([[1.0, 0.0], [2.0, 0.0], [3.0, 0.0]])
    table = SpreadTable(names=("K", "a"), estimate=np.array([2.0, 0.0]), draws=draws, seed=4, left_out={"no value": 2})
    document = bootstrap_document(Bootstrapped(source="responses", table=table, findings=()))
    assert document is not None
    assert (document.runs, document.left_out) == (5, {"no value": 2})
    assert document.parameters["a"].relative_percent is None
    assert document.correlation.matrix == [[1.0, 0.0], [0.0, 1.0]]
