"""Outputs that inputs moved, of linear and nonlinear models."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.models.library import nonlinear_model, response_model
from rotorid.verification.driven import driven, undriven_words

PAIRS = [("phi_setpoint", "phi"), ("theta_setpoint", "theta")]


def square(size: float) -> np.ndarray:
    return size * np.sign(np.sin(np.arange(200.0)))


@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_of_a_linear_model_each_input_moves_its_output(offset: float) -> None:
    model = response_model("response.second_order_delay", PAIRS)
    # Less than 0.02 rad is noise and corrections of a pilot.
    found = driven(model, np.stack([offset + square(0.1), offset + square(0.005)]))
    assert (found.outputs, found.clearly) == ({"phi", "theta"}, {"phi"})
    assert found.judged("phi", -40.0) == -40.0
    assert found.judged("theta", 97.0) == 97.0
    assert found.judged("theta", 12.0) == -math.inf


def test_of_a_nonlinear_model_states_carry_the_motion_on() -> None:
    model = nonlinear_model("flight.first_order")
    inputs = np.zeros((len(model.inputs), 200))
    inputs[model.inputs.index("phi_setpoint")] = square(0.1)
    found = driven(model, inputs)
    assert {"phi", "velocity_east", "velocity_north", "north", "east"} == found.clearly
    assert undriven_words(model, "psi", [found]) == "r_setpoint did not move"
    inputs[model.inputs.index("r_setpoint")] = square(0.5)
    assert "psi" in driven(model, inputs).clearly


def test_a_mean_that_was_taken_off_leaves_no_motion() -> None:
    model = response_model("response.first_order", PAIRS)
    rounding = np.full(200, 0.1) - np.full(200, 0.1).mean() + square(1e-17)
    found = driven(model, np.stack([square(0.1), rounding]))
    assert found.outputs == {"phi"}
    assert undriven_words(model, "theta", [found]) == "theta_setpoint did not move"
    little = driven(model, np.stack([square(0.1), square(0.001)]))
    assert undriven_words(model, "theta", [little]) == "theta_setpoint moved too little"
    assert undriven_words(model, "phi", [found]) == "phi did not move"
