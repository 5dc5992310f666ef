"""Step responses of several models: rise times by value, and what cannot be drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tests.unit.identifying.response_twins import identified

from rotorid.documents.compare import compare_document, steps_of
from rotorid.flying.step_responses import compared_steps
from rotorid.identifying.comparison import compare
from rotorid.report.compare import render_documents


def test_a_lag_rises_in_its_time_constant_times_ln_nine() -> None:
    first, second = identified("response.first_order", 1), identified("response.second_order", 1)
    (pair,) = compared_steps({"first": first, "second": second})
    assert (pair.input, pair.output, list(pair.models)) == ("phi_setpoint", "phi", ["first", "second"])
    lag, step = first["T_phi"], pair.models["first"]
    assert step.rise_s == pytest.approx(lag.value * math.log(9.0), rel=2e-3)
    assert step.start_s == pytest.approx(lag.value * math.log(1.0 / 0.9), rel=0.05)
    # The band is that of the parameters: rise time and lag have one relative error.
    assert lag.std is not None
    assert step.rise_std_s == pytest.approx(lag.std * math.log(9.0), rel=0.4)
    assert step.response[-1] == pytest.approx(first["K_phi"].value, rel=1e-2)
    assert np.all(step.lower <= step.response)
    assert np.all(step.response <= step.upper)
    # A second order begins flat and then rises faster.
    assert pair.models["second"].response[5] < step.response[5]


def test_models_without_a_pair_in_common_have_no_picture() -> None:
    assert compared_steps({"alone": identified("response.first_order", 1)}) == ()


def test_a_comparison_draws_and_lists_them() -> None:
    found = compare([identified("response.first_order", 1), identified("response.second_order", 1)])
    steps = steps_of(found)
    document = compare_document(found, steps)
    (listed,) = document.steps
    assert list(listed.models) == [entry.label for entry in found.entries]
    page = render_documents(document, found.maneuvers, steps, title="steps")
    assert "Step responses" in page
    assert "To 10 % [ms]" in page
    assert "Step responses" not in render_documents(compare_document(found, ()), found.maneuvers, title="none")
