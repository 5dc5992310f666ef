"""Measured steps beside those of models: the answer of a review, by a loop whose step is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal
from tests.unit.identifying.response_twins import identified
from tests.unit.reviewing.test_loops import DAMPING, NATURAL, record

from rotorid.documents.compare import compare_document, steps_of
from rotorid.flights.whole_flights import flown
from rotorid.flying.step_responses import StepPair, compared_steps
from rotorid.identifying.comparison import compare
from rotorid.report.compare import render_documents
from rotorid.reviewing.loops import LOOPS, loop_of
from rotorid.reviewing.measured_steps import measured_step, with_measured

ROLL_RATE = LOOPS[0]


def test_a_measured_step_is_that_of_the_loop_and_of_the_review() -> None:
    found = measured_step(record(), ROLL_RATE)
    assert found.rise is not None
    time_s, step = signal.step(
        ([NATURAL**2], [1.0, 2.0 * DAMPING * NATURAL, NATURAL**2]), T=np.linspace(0.0, 1.0, 2001)
    )
    rise_s = float(time_s[np.argmax(step > 0.9)] - time_s[np.argmax(step > 0.1)])
    assert found.rise.lower < rise_s < found.rise.upper
    review, _ = loop_of(flown(record()), ROLL_RATE)
    assert review is not None
    assert review.step is not None
    np.testing.assert_array_equal(found.response, review.step.value)
    assert (found.lower <= found.upper).all()


def test_a_log_without_the_stick_says_why() -> None:
    found = measured_step(record(without=("roll_stick",)), ROLL_RATE)
    assert found.response.size == 0
    assert "roll stick is not logged" in found.why


def pair(input: str, output: str) -> StepPair:
    models = {name: identified(name, 1) for name in ("response.first_order", "response.second_order")}
    (found,) = compared_steps(models)
    return replace(found, input=input, output=output)


def test_only_a_state_and_its_set_point_are_a_loop() -> None:
    pairs = (pair("p_setpoint", "p"), pair("roll_command", "p"))
    loop, plant = with_measured(pairs, (record(),))
    assert [step.rise is not None for step in loop.measured] == [True]
    assert plant.measured == ()


@pytest.mark.parametrize("shown", [True, False])
def test_document_and_page_have_the_measured_step_or_the_reason(shown: bool) -> None:
    compared = compare([identified("response.first_order", 1), identified("response.second_order", 1)])
    (of_models,) = steps_of(compared)
    log = record() if shown else record(without=("roll_stick",))
    steps = [replace(of_models, input="p_setpoint", output="p", measured=(measured_step(log, ROLL_RATE),))]
    document = compare_document(compared, steps)
    (measured,) = document.steps[0].measured
    assert (measured.rise_time_s is not None) == shown
    page = render_documents(document, compared.maneuvers, steps, title="steps")
    assert (f"measured in {log.source.name}" in page) == shown
    assert (f"{log.source.name} shows no step of" in page) != shown
