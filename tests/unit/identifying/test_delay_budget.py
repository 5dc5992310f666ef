"""The delay budget: sums and their standard deviations, worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotorid.identifying.delay_budget import delay_budget
from rotorid.models.library import library_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.uncertainty.cramer_rao import Bounds

STRUCTURE = library_model("axis.pitch").select(outputs=("q", "ax"))
VALUES = {"tau_pitch": 0.021, "T_motor": 0.034, "tau_ax": 0.008}
STD = {"tau_pitch": 0.001, "T_motor": 0.003, "tau_ax": 0.002}
CORRELATION = -0.8
"""Of lag and delay of the input."""


def known(parameters: ParameterSet) -> Bounds:
    names = parameters.free
    std = np.array([STD.get(name, 0.1) for name in names])
    correlation = np.eye(len(names))
    if "T_motor" in names:
        i, j = names.index("tau_pitch"), names.index("T_motor")
        correlation[i, j] = correlation[j, i] = CORRELATION
    return Bounds(
        names=names,
        cramer_rao=2.0 * std,
        insensitivity=std,
        covariance=correlation * np.outer(std, std),
        random=correlation * np.outer(std, std),
        colored=1.0,
    )


def parameters_of(structure: LinearStructure) -> ParameterSet:
    return structure.parameters.free_again("tau_ax").with_values(VALUES)


def test_sums_and_their_deviations() -> None:
    parameters = parameters_of(STRUCTURE)
    budget = delay_budget(STRUCTURE, parameters, known(parameters), np.ones((2, 1), dtype=bool), {"q": 0.004})
    assert list(budget) == ["q/pitch_command", "ax/pitch_command"]
    gyro, accelerometer = budget.values()
    assert (gyro.input_delay_s, gyro.motor_lag_s, gyro.output_delay_s) == (0.021, 0.034, 0.0)
    assert gyro.total_s == pytest.approx(0.055, rel=1e-12)
    shared = 0.001**2 + 0.003**2 + 2.0 * CORRELATION * 0.001 * 0.003
    # An error of delay and lag against each other leaves their sum well known.
    assert gyro.total_std_s == pytest.approx(math.sqrt(shared), rel=1e-9)
    assert accelerometer.output_delay_s == 0.008
    assert accelerometer.total_s == pytest.approx(0.063, rel=1e-12)
    assert accelerometer.total_std_s == pytest.approx(math.sqrt(shared + 0.002**2), rel=1e-9)
    assert (gyro.known_filters_s, accelerometer.known_filters_s) == (0.004, None)


def test_only_fitted_responses_have_one() -> None:
    parameters = parameters_of(STRUCTURE)
    budget = delay_budget(STRUCTURE, parameters, known(parameters), np.array([[False], [True]]), {})
    assert list(budget) == ["ax/pitch_command"]


def test_what_is_held_adds_nothing_to_the_deviation() -> None:
    parameters = parameters_of(STRUCTURE).fix("T_motor", 0.03).fix("tau_pitch", 0.02).fix("tau_ax", 0.0)
    budget = delay_budget(STRUCTURE, parameters, known(parameters), np.ones((2, 1), dtype=bool), {})
    assert budget["q/pitch_command"].total_s == pytest.approx(0.05)
    assert budget["q/pitch_command"].total_std_s is None


def test_a_dropped_lag_is_no_part_of_the_budget() -> None:
    parameters = parameters_of(STRUCTURE).drop("T_motor")
    condensed = STRUCTURE.condensed(parameters)
    budget = delay_budget(condensed, parameters, known(parameters), np.ones((2, 1), dtype=bool), {})
    assert budget["q/pitch_command"].motor_lag_s == 0.0
    assert budget["q/pitch_command"].total_std_s == pytest.approx(0.001, rel=1e-9)


def test_a_delay_tied_to_another_moves_with_it() -> None:
    parameters = parameters_of(STRUCTURE).tie("tau_ax", "2*tau_pitch")
    budget = delay_budget(STRUCTURE, parameters, known(parameters), np.ones((2, 1), dtype=bool), {})
    # tau + T + 2 tau
    variance = 9.0 * 0.001**2 + 0.003**2 + 6.0 * CORRELATION * 0.001 * 0.003
    assert budget["ax/pitch_command"].total_s == pytest.approx(3.0 * 0.021 + 0.034, rel=1e-12)
    assert budget["ax/pitch_command"].total_std_s == pytest.approx(math.sqrt(variance), rel=1e-9)
