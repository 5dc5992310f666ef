"""Guided reduction: the paper's procedure on the paper's vehicle, and every way in which a parameter stays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import LevenbergMarquardt, Outcome
from rotorid.models.library import rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml
from rotorid.reduction.guided import LARGEST_RISE, Reduction, Step, mean_cost, reduce
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import bounds
from rotorid.vehicles.s500 import LATERAL, LONGITUDINAL, longitudinal

GRAVITY = 9.80665
NOT_THERE = {"X_w", "Z_q", "M_thrust", "X_thrust"}

S500 = f"""
name = "longitudinal"
inputs = ["pitch_command", "thrust_command"]
states = ["q", "u", "w", "theta"]
outputs = ["q", "u", "w", "theta", "ax", "az"]
F = [
  ["M_q", "M_u", "M_w", 0], ["X_q", "X_u", "X_w", {-GRAVITY}], ["Z_q", "Z_u", "Z_w", 0], [1, 0, 0, 0],
]
G = [["M_pitch", "M_thrust"], ["X_pitch", "X_thrust"], ["Z_pitch", "Z_thrust"], [0, 0]]
H0 = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, {GRAVITY}], [0, 0, 0, 0]]
H1 = [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
input_delays = ["tau_pitch", "tau_thrust"]
"""

S500_LATERAL = f"""
name = "lateral"
inputs = ["roll_command", "yaw_command"]
states = ["p", "r", "v", "phi"]
outputs = ["p", "r", "v", "phi", "ay"]
F = [["L_p", "L_r", "L_v", 0], ["N_p", "N_r", "N_v", 0], ["Y_p", "Y_r", "Y_v", {GRAVITY}], [1, 0, 0, 0]]
G = [["L_roll", "L_yaw"], ["N_roll", "N_yaw"], ["Y_roll", "Y_yaw"], [0, 0]]
H0 = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0, 0, {-GRAVITY}]]
H1 = [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0]]
input_delays = ["tau_roll", "tau_yaw"]
"""

RIG = """
name = "rig"
inputs = ["roll_command"]
states = ["p"]
outputs = ["p"]
M = [["J_x"]]
F = [["-d"]]
G = [["K_f"]]
H0 = [[1]]
"""

COUPLED = """
name = "coupled"
inputs = ["roll_command"]
states = ["p", "x"]
outputs = ["p"]
F = [["L_p", "C"], [0, -3]]
G = [["L_roll"], ["B"]]
H0 = [[1, 0]]
"""


def structure(text: str, values: Mapping[str, float], **more: Mapping[str, str]) -> LinearStructure:
    """A structure with start values, and further keys of its parameters as TOML text."""
    for name, value in values.items():
        text += f"[parameters.{name}]\nvalue = {float(value)!r}\n" + (
            'unit = "s"\nlower = 0.0\n' if name.startswith("tau") else ""
        )
        text += "".join(f"{key} = {keys[name]}\n" for key, keys in more.items() if name in keys)
    return from_toml(text)


def problem(
    model: LinearStructure, truth: Mapping[str, float], omega: FloatArray, *, level: float, seed: int = 0
) -> FrequencyProblem:
    """Responses of the true values with independent circular errors of ``level`` in magnitude and in phase."""
    exact = model.response(truth, omega)
    rng = np.random.default_rng(seed)
    values = exact * (1.0 + level * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape)))
    covariance = np.zeros((*exact.shape, omega.size), dtype=np.complex128)
    points = np.arange(omega.size)
    covariance[..., points, points] = 2.0 * level**2 * np.abs(exact) ** 2
    data = FrequencyResponse(
        omega_rad_s=omega,
        values=values,
        coherence=np.full(exact.shape, 0.95),
        random_error=np.full(exact.shape, level),
        covariance=covariance,
        inputs=model.inputs,
        outputs=model.outputs,
        estimate="direct",
    )
    used = np.ones(exact.shape, dtype=bool)
    return FrequencyProblem(structure=model, parameters=model.parameters, data=data, used=used)


def reduced(posed: FrequencyProblem) -> Reduction:
    return reduce(posed, fit_frequency(posed))


def values(reduction: Reduction) -> dict[str, float]:
    return reduction.problem.parameters.unpack(reduction.solution.theta).values


def of(reduction: Reduction, name: str) -> Step:
    (step,) = (step for step in reduction.steps if step.parameter == name)
    return step


@pytest.fixture(scope="module")
def s500() -> Reduction:
    full = structure(S500, LONGITUDINAL)
    return reduced(problem(full, LONGITUDINAL, np.geomspace(1.0, 40.0, 30), level=0.03))


def test_the_structure_is_that_of_the_vehicle() -> None:
    omega = np.geomspace(1.0, 40.0, 5)
    full = structure(S500, LONGITUDINAL)
    np.testing.assert_allclose(full.response(LONGITUDINAL, omega), longitudinal().response(omega), rtol=1e-9)


def test_the_paper_s_parameters_are_dropped_and_the_rest_is_kept(s500: Reduction) -> None:
    assert set(s500.dropped) == NOT_THERE
    assert set(s500.problem.parameters.free) == set(LONGITUDINAL) - NOT_THERE
    assert all(values(s500)[name] == 0.0 for name in NOT_THERE)
    # The order of the procedure: the largest insensitivity of those that are left.
    percents = [step.insensitivity_percent for step in s500.steps if step.action == "dropped"]
    assert min(percents) > 10.0
    assert [finding.where for finding in s500.findings] == list(s500.dropped)
    assert {(finding.kind, finding.severity) for finding in s500.findings} == {("dropped_parameter", "info")}


def test_the_lateral_model_is_reduced_as_in_the_paper() -> None:
    """Table 7: L_p, N_v and Y_r are dropped, and N_p is kept because the cost would rise."""
    reduction = reduced(
        problem(structure(S500_LATERAL, LATERAL), LATERAL, np.geomspace(1.0, 40.0, 30), level=0.03, seed=1)
    )
    assert set(reduction.dropped) == {"L_p", "L_yaw", "N_v", "Y_r", "Y_yaw"}
    assert {step.parameter for step in reduction.steps if step.action == "kept"} <= {"N_p", "L_r"}
    found = reduction.problem.parameters.unpack(reduction.solution.theta)
    without = reduction.problem.with_parameters(found.drop("N_p"))
    smaller = fit_frequency(without, starts=[without.parameters.pack()])
    rise = mean_cost(without, smaller) - mean_cost(reduction.problem, reduction.solution)
    assert rise > LARGEST_RISE


def test_what_is_left_is_the_truth_within_its_bounds(s500: Reduction) -> None:
    limits = bounds(s500.problem, s500.solution)
    errors = np.array([values(s500)[name] - LONGITUDINAL[name] for name in limits.names]) / limits.std
    # Thirteen normal errors: one beyond four happens once in 1200 draws.
    assert np.abs(errors).max() < 4.0


def test_m_q_is_kept_because_the_cost_would_rise_as_in_the_paper(s500: Reduction) -> None:
    step = of(s500, "M_q")
    assert step.action == "kept"
    assert step.cramer_rao_percent > 20.0 > 10.0 > step.insensitivity_percent
    assert step.partner == "M_u"
    assert step.mean_cost_after is not None
    without = s500.problem.with_parameters(s500.problem.parameters.drop("M_q"))
    start = without.parameters.with_values({n: values(s500)[n] for n in without.parameters.free}).pack()
    again = mean_cost(without, fit_frequency(without, starts=[start]))
    assert step.mean_cost_after == pytest.approx(again, rel=1e-6)
    assert step.mean_cost_after - step.mean_cost_before > LARGEST_RISE
    assert "hard to separate from M_u" in step.reason
    assert "without it the mean cost rises" in step.reason


def test_every_step_can_be_undone(s500: Reduction) -> None:
    for index, step in enumerate(s500.steps):
        before = s500.undone(index)
        assert before.parameters[step.parameter].status == "free"
        assert before.parameters[step.parameter].value == step.value_before
        theta = before.parameters.pack()
        assert float(before.costs(theta).sum()) / 12.0 == pytest.approx(step.mean_cost_before, rel=1e-9)
    assert s500.undone(0).parameters.free == tuple(LONGITUDINAL)
    with pytest.raises(UsageError, match=f"there is no step {len(s500.steps)}"):
        s500.undone(len(s500.steps))


def test_each_dropped_parameter_says_why(s500: Reduction) -> None:
    for step in s500.steps:
        if step.action == "dropped":
            assert step.reason.startswith(f"The cost barely depends on {step.parameter}: its insensitivity is ")
            assert step.reason.endswith("so it was dropped.")
            assert not step.doubtful


def test_essential_physics_is_never_dropped() -> None:
    essential = structure(S500, LONGITUDINAL, essential={"X_w": "true"})
    reduction = reduced(problem(essential, LONGITUDINAL, np.geomspace(1.0, 40.0, 20), level=0.03))
    assert of(reduction, "X_w").action == "protected"
    assert of(reduction, "X_w").mean_cost_after is None
    assert "essential physics" in of(reduction, "X_w").reason
    assert set(reduction.dropped) == NOT_THERE - {"X_w"}


def test_a_parameter_that_something_essential_is_tied_to_is_protected() -> None:
    model = structure(S500, LONGITUDINAL, essential={"Z_q": "true"})
    parameters = model.parameters.tie("Z_q", "2*X_w")
    posed = problem(model, LONGITUDINAL, np.geomspace(1.0, 40.0, 20), level=0.03).with_parameters(parameters)
    assert of(reduced(posed), "X_w").action == "protected"


def test_a_response_is_never_reduced_to_nothing() -> None:
    """Only K_f/J_x is seen, so both look uncertain; the one cannot be zero and without the other nothing is left."""
    truth = {"J_x": 0.05, "d": 0.0, "K_f": 0.11}
    rig = structure(RIG, truth, lower={"J_x": "1e-6"}, status={"d": '"fixed"'}, unit={"J_x": '"kg m^2"'})
    reduction = reduced(problem(rig, truth, np.geomspace(1.0, 20.0, 30), level=0.02))
    assert reduction.dropped == ()
    assert {step.parameter: step.action for step in reduction.steps} == {"J_x": "kept", "K_f": "kept"}
    assert "zero lies outside the bounds of J_x" in of(reduction, "J_x").reason
    assert "the response p/roll_command vanishes" in of(reduction, "K_f").reason
    assert of(reduction, "K_f").partner == "J_x"
    assert "or that of J_x" in of(reduction, "K_f").reason


def test_a_parameter_without_any_effect_is_dropped_first() -> None:
    truth = {"L_p": -3.0, "C": 0.0, "L_roll": 50.0, "B": 4.0}
    model = structure(COUPLED, truth, status={"C": '"fixed"'})
    reduction = reduced(problem(model, truth, np.geomspace(1.0, 20.0, 30), level=0.02))
    assert reduction.dropped == ("B",)
    assert reduction.steps[0].reason.startswith("B has no effect on the fitted responses.")
    assert values(reduction)["L_p"] == pytest.approx(-3.0, rel=0.1)


def test_an_essential_parameter_without_any_effect_is_refused() -> None:
    truth = {"L_p": -3.0, "C": 0.0, "L_roll": 50.0, "B": 4.0}
    model = structure(COUPLED, truth, status={"C": '"fixed"'}, essential={"B": "true"})
    with pytest.raises(InsufficientDataError, match="B has no effect on the fitted responses"):
        reduced(problem(model, truth, np.geomspace(1.0, 20.0, 30), level=0.02))


def test_a_parameter_that_something_essential_acts_through_is_kept() -> None:
    truth = {"L_p": -3.0, "C": 1e-3, "L_roll": 50.0, "B": 4.0}
    model = structure(COUPLED, truth, essential={"B": "true"})
    reduction = reduced(problem(model, truth, np.geomspace(1.0, 20.0, 30), level=0.02))
    assert of(reduction, "C").action == "kept"
    assert "B has no effect on the responses" in of(reduction, "C").reason
    assert "C" in reduction.problem.parameters.free


def test_good_data_say_when_a_dropped_parameter_is_real() -> None:
    """CIFER's percents know nothing of the noise: a small damping is insensitive, and certain all the same."""
    model = rate_model("rate.roll")
    parameters = ParameterSet(tuple(replace(p, essential=False) for p in model.parameters)).fix("T_motor", 0.05)
    truth = {"L_roll": 60.0, "L_p": -0.1, "T_motor": 0.05, "tau_roll": 0.012}
    posed = problem(model, truth, np.geomspace(2.0, 50.0, 40), level=0.002).with_parameters(parameters)
    solution = fit_frequency(posed)
    limits = bounds(posed, solution)
    place = limits.names.index("L_p")
    assert abs(solution.theta[place]) > 3.0 * limits.random_std[place]
    reduction = reduce(posed, solution)
    step = of(reduction, "L_p")
    assert step.action == "dropped"
    assert "standard deviations from zero: by these data it is real" in step.reason
    # What it did is now done by the others, further than chance would move them.
    moved = np.abs(reduction.solution.theta - np.delete(solution.theta, place)) / np.delete(limits.random_std, place)
    assert moved.max() > 3.0
    assert step.doubtful
    furthest = reduction.problem.parameters.free[int(np.argmax(moved))]
    assert f"Caution: {furthest} moved by {moved.max():.1f} standard deviations" in step.reason
    assert reduction.findings[0].severity == "warning"


def test_a_fit_that_has_not_converged_is_finished_first() -> None:
    model = rate_model("rate.roll")
    truth = {"L_roll": 60.0, "L_p": -3.0, "T_motor": 0.05, "tau_roll": 0.012}
    posed = problem(model, truth, np.geomspace(2.0, 50.0, 40), level=0.01)
    rough = fit_frequency(posed, solver=LevenbergMarquardt(iterations=1))
    assert rough.outcome is Outcome.OUT_OF_ITERATIONS
    reduction = reduce(posed, rough)
    assert reduction.dropped == ()
    assert reduction.solution.cost == pytest.approx(fit_frequency(posed).cost, rel=1e-6)
