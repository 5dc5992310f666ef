"""The page of a fit in time: records, residuals, the frequency domain beside, other minima."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit.checking.response_flight import flight
from tests.unit.report.sample import HOSTILE, shown_with

from rotorid.identifying.identification import identify
from rotorid.report.identification import render_sections
from rotorid.report.parts import Shown
from rotorid.report.time import time_fits
from rotorid.report.words import time_sentences
from rotorid.results.summary import Minimum


@pytest.fixture(scope="module")
def fitted() -> Shown:
    return Shown.of(identify([flight(samples=700)], "response.second_order_delay"))


def test_every_record_has_a_picture_and_the_residuals_one(fitted: Shown) -> None:
    shown = time_fits(fitted, key="t")
    assert shown is not None
    assert [picture.key for picture in shown.all_pictures] == ["t-0", "t-memory"]
    traces = shown.pictures[0].figure["data"]
    assert [trace["name"] for trace in traces] == ["measured", "simulated", "input"]
    # A command that was held is drawn as it was: in steps.
    assert traces[2]["line"]["shape"] == "hv"
    assert shown.memory is not None
    assert shown.memory.figure["data"][0]["y"][0] == 1.0


def test_long_records_are_thinned_for_display(fitted: Shown) -> None:
    (one,) = fitted.data.simulated
    long = dataclasses.replace(
        one,
        time_s=np.arange(120_000) / 400.0,
        inputs=np.tile(one.inputs, 200)[:, :120_000],
        measured=np.tile(one.measured, 200)[:, :120_000],
        simulated=np.tile(one.simulated, 200)[:, :120_000],
    )
    shown = time_fits(shown_with(fitted, simulated=(long,)), key="t")
    assert shown is not None
    assert sum(len(trace["x"]) for trace in shown.pictures[0].figure["data"]) <= 60_000


def test_the_page_says_what_was_done_and_compares(fitted: Shown) -> None:
    minimum = Minimum(cost=12.0, parameters=dict.fromkeys(fitted.document.parameters, 1.0))
    document = fitted.document.model_copy(update={"minima": [minimum]})
    page = render_sections([shown_with(fitted, document=document)], title="t")
    for words in (
        "Measured and simulated",
        "Comparison with the fit in the frequency domain",
        "half a sample of delay",
        "1 other local minimum",
        "constant between samples (zero-order hold), as the commands were sent",
        "Standard deviation of the output errors",
    ):
        assert words in page, words
    assert document.fit is not None
    assert time_sentences(document, document.fit)[0].startswith("Output error")


def test_names_of_a_log_do_not_act(fitted: Shown) -> None:
    hostile = tuple(dataclasses.replace(one, record=HOSTILE) for one in fitted.data.simulated)
    records = [dataclasses.replace(one, record=HOSTILE) for one in fitted.document.records]
    document = fitted.document.model_copy(update={"records": records})
    page = render_sections([shown_with(fitted, simulated=hostile, document=document)], title="t")
    assert HOSTILE not in page


def test_a_fit_in_the_frequency_domain_shows_none_of_it(fitted: Shown) -> None:
    assert time_fits(shown_with(fitted, simulated=()), key="t") is None
