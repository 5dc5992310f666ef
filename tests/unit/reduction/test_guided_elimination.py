"""Reduction: what the data do not show goes, with its reason; what they show stays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.models.library import library_model, rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.reduction.guided import LARGEST_RISE, Reduced, fit_and_drop
from rotorid.typing import ComplexArray

OMEGA = np.geomspace(2.0, 50.0, 50)
STRUCTURE = rate_model("rate.roll")
TRUTH = {"L_roll": 60.0, "L_p": -3.0, "T_motor": 0.05, "tau_roll": 0.012}


def problem(values: ComplexArray, level: float = 0.0) -> FrequencyProblem:
    rng = np.random.default_rng(2)
    shape = (1, 1, OMEGA.size)
    scatter = level * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    return posed_for(STRUCTURE, values.reshape(shape) * (1.0 + scatter))


def posed_for(structure: LinearStructure, values: ComplexArray) -> FrequencyProblem:
    """Every response that is not zero, with equal errors."""
    data = FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values,
        coherence=np.full(values.shape, 0.95),
        random_error=np.full(values.shape, 0.03),
        covariance=np.zeros((*values.shape, OMEGA.size)),
        inputs=structure.inputs,
        outputs=structure.outputs,
        estimate="direct",
    )
    return FrequencyProblem(structure=structure, parameters=structure.parameters, data=data, used=np.abs(values) > 0.0)


def model(**change: float) -> ComplexArray:
    return STRUCTURE.response({**TRUTH, **change}, OMEGA)


def found(reduced: Reduced) -> dict[str, float]:
    return reduced.problem.parameters.unpack(reduced.solution.theta).values


@pytest.mark.parametrize("level", [0.0, 0.03])
def test_a_lag_that_is_not_there_is_dropped(level: float) -> None:
    reduced = fit_and_drop(problem(model(T_motor=0.0), level))
    assert reduced.problem.parameters["T_motor"].status == "dropped"
    assert found(reduced)["T_motor"] == 0.0
    assert found(reduced)["tau_roll"] == pytest.approx(0.012, abs=2e-3 if level else 1e-8)
    (finding,) = reduced.findings
    assert (finding.kind, finding.where, finding.severity) == ("dropped_parameter", "T_motor", "info")
    assert finding.numbers["cost_rise"] <= finding.numbers["limit"] == LARGEST_RISE


@pytest.mark.parametrize("level", [0.0, 0.03])
def test_a_lag_that_is_there_is_kept(level: float) -> None:
    posed = problem(model(), level)
    reduced = fit_and_drop(posed)
    assert reduced.problem.parameters["T_motor"].status == "free"
    assert reduced.findings == ()
    assert reduced.solution.cost == fit_frequency(posed).cost
    assert found(reduced)["T_motor"] == pytest.approx(0.05, rel=0.2 if level else 1e-6)
    without = posed.with_parameters(posed.parameters.drop("T_motor"))
    assert fit_frequency(without).cost - reduced.solution.cost > LARGEST_RISE


def test_damping_that_would_cross_zero_is_left_out_with_a_warning() -> None:
    # A response that grows by itself: the best damping is positive, and the bound of zero holds it.
    reduced = fit_and_drop(problem(model(L_p=1.0)))
    assert reduced.problem.parameters["L_p"].status == "dropped"
    assert "L_p" not in reduced.problem.parameters.free
    warning = next(finding for finding in reduced.findings if finding.where == "L_p")
    assert (warning.kind, warning.severity) == ("dropped_parameter", "warning")
    assert len(reduced.solution.theta) == len(reduced.problem.parameters.free)


def test_what_the_user_fixed_is_left_alone() -> None:
    posed = problem(model(T_motor=0.0))
    fixed = posed.with_parameters(posed.parameters.fix("T_motor", 0.01))
    reduced = fit_and_drop(fixed)
    assert reduced.problem.parameters["T_motor"].status == "fixed"
    assert found(reduced)["T_motor"] == 0.01
    assert all(finding.where != "T_motor" for finding in reduced.findings)


def test_a_lead_goes_with_the_lag_that_it_works_against() -> None:
    # The spin-up of rotors that react at once would make the rate of yaw jump with the command.
    structure = library_model("axis.yaw")
    truth = {"N_yaw": 20.0, "N_spin": 0.0, "N_r": -0.5, "tau_yaw": 0.02, "T_motor": 0.0}
    posed = posed_for(structure, structure.response(truth, OMEGA))
    reduced = fit_and_drop(posed)
    status = {name: reduced.problem.parameters[name].status for name in ("N_spin", "T_motor")}
    assert status == {"N_spin": "dropped", "T_motor": "dropped"}
    assert reduced.problem.structure.condensed(reduced.problem.parameters).states == ("r",)
    assert {finding.where for finding in reduced.findings} == {"N_spin", "T_motor"}


def test_a_lag_is_not_dropped_alone_while_a_lead_needs_it() -> None:
    structure = library_model("axis.yaw")
    truth = {"N_yaw": 20.0, "N_spin": 0.8, "N_r": -0.5, "tau_yaw": 0.02, "T_motor": 0.0}
    reduced = fit_and_drop(posed_for(structure, structure.response(truth, OMEGA)))
    parameters = reduced.problem.parameters
    assert (parameters["T_motor"].status == "dropped") <= (parameters["N_spin"].status == "dropped")
    states = reduced.problem.structure.condensed(parameters).matrices(found(reduced))
    assert np.linalg.matrix_rank(states.M) == len(states.M)


SHARED = """
name = "roll and pitch"
inputs = ["roll_command", "pitch_command"]
states = ["p", "q", "roll_motor", "pitch_motor"]
outputs = ["p", "q"]
M = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, "T_motor", 0], [0, 0, 0, "T_motor"]]
F = [["L_p", 0, "L_roll", 0], [0, "M_q", 0, "M_pitch"], [0, 0, -1, 0], [0, 0, 0, -1]]
G = [[0, 0], [0, 0], [1, 0], [0, 1]]
H0 = [[1, 0, 0, 0], [0, 1, 0, 0]]
input_delays = ["tau_roll", "tau_pitch"]
optional = ["T_motor"]
"""


@pytest.mark.parametrize("lag_s", [0.0, 0.05])
def test_a_lag_that_two_inputs_share_is_judged_by_both(lag_s: float) -> None:
    truth = {"L_roll": 60.0, "L_p": -3.0, "M_pitch": 40.0, "M_q": -2.0, "tau_roll": 0.012, "tau_pitch": 0.015}
    truth["T_motor"] = lag_s
    text = SHARED + "".join(f"[parameters.{name}]\nvalue = {value}\n" for name, value in truth.items())
    text = text.replace(f"value = {lag_s}\n", 'value = 0.02\nunit = "s"\nlower = 0.0\n')
    structure = from_toml(text)
    posed = posed_for(structure, structure.response(truth, OMEGA))
    reduced = fit_and_drop(posed)
    assert reduced.problem.parameters["T_motor"].status == ("free" if lag_s else "dropped")
    for name, value in truth.items():
        assert found(reduced)[name] == pytest.approx(value, rel=1e-5, abs=1e-9)
    assert [finding.message.endswith("its effect is included in the delays.") for finding in reduced.findings] == (
        [] if lag_s else [True]
    )


def test_an_optional_parameter_that_cannot_be_zero_is_left_alone() -> None:
    posed = problem(model(T_motor=0.002))
    lag = replace(posed.parameters["T_motor"], lower=1e-3, value=0.01)
    bounded = ParameterSet(tuple(lag if p.name == "T_motor" else p for p in posed.parameters))
    reduced = fit_and_drop(posed.with_parameters(bounded))
    assert reduced.problem.parameters["T_motor"].status == "free"


def test_the_problem_itself_is_not_changed() -> None:
    posed = problem(model(T_motor=0.0))
    fit_and_drop(posed)
    assert posed.parameters is STRUCTURE.parameters
