"""Remarks and refusals: where a number would say more than the data do."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError
from rotorid.fits.data_requirements import require_known_gain
from rotorid.fits.frequency.refusals import _pushed_on_by_speed, _reasons_to_refuse
from rotorid.fits.remarks import judge_band, judge_parameters, judge_structure
from rotorid.fitting.least_squares import Outcome
from rotorid.models.library import library_model, rate_model
from rotorid.models.parameter import ParameterSet
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.uncertainty.model_error import Evidence

FOUND = rate_model("rate.roll").parameters
"""L_roll 100, L_p -1, T_motor 0.03, tau_roll 0.01."""


def spread(parameters: ParameterSet, percent: float, *, correlation: float = 0.0) -> Bounds:
    """The same relative uncertainty for all free parameters; lag and delay correlated."""
    std = np.array([abs(parameters[name].value) for name in parameters.free]) * percent / 100.0
    covariance = np.diag(std**2)
    lag, delay = parameters.free.index("T_motor"), parameters.free.index("tau_roll")
    covariance[lag, delay] = covariance[delay, lag] = correlation * std[lag] * std[delay]
    return Bounds(
        names=parameters.free,
        cramer_rao=2.0 * std,
        insensitivity=std,
        covariance=covariance,
        random=covariance,
        colored=1.0,
    )


def test_a_gain_within_two_standard_deviations_of_zero_is_refused() -> None:
    require_known_gain("L_roll", FOUND, spread(FOUND, 49.0))
    with pytest.raises(InsufficientDataError, match=r"the sign of L_roll is uncertain: \d+ ± \d+ rad/s\^2") as refused:
        require_known_gain("L_roll", FOUND, spread(FOUND, 51.0))
    (finding,) = refused.value.findings
    assert (finding.kind, finding.where) == ("not_identifiable", "L_roll")


def test_a_gain_that_was_fixed_is_not_judged() -> None:
    held = FOUND.fix("L_roll", 100.0)
    require_known_gain("L_roll", held, spread(held, 90.0))
    require_known_gain(None, FOUND, spread(FOUND, 90.0))


@pytest.mark.parametrize(
    ("percent", "kinds"),
    [(4.0, set()), (11.0, {"insensitive_parameter"}), (9.99, set())],
    ids=["certain", "insensitive", "at the guideline"],
)
def test_guidelines_of_ten_and_twenty_percent(percent: float, kinds: set[str]) -> None:
    remarks = judge_parameters(FOUND, spread(FOUND, percent))
    assert {finding.kind for finding in remarks if finding.severity == "warning"} == kinds


def test_lag_and_delay_that_are_told_apart_say_so() -> None:
    limits = spread(FOUND, 9.0, correlation=-0.8)
    (remark,) = (finding for finding in judge_parameters(FOUND, limits) if finding.kind == "lag_plus_delay")
    assert (remark.severity, remark.numbers["correlation"]) == ("info", pytest.approx(-0.8))


@pytest.mark.parametrize(("percent", "correlation"), [(9.0, -0.99), (30.0, -0.5)], ids=["opposed", "unknown"])
def test_lag_and_delay_that_are_not_told_apart_are_given_as_their_sum(percent: float, correlation: float) -> None:
    remarks = judge_parameters(FOUND, spread(FOUND, percent, correlation=correlation))
    (remark,) = (finding for finding in remarks if finding.kind == "not_identifiable")
    assert remark.severity == "warning"
    assert "Trust their sum of 40" in remark.message


def test_a_sum_that_is_no_surer_is_not_to_be_trusted() -> None:
    """A lag that is known and a delay that is not: their sum is as unknown as the delay."""
    limits = spread(FOUND, 9.0)
    covariance = np.array(limits.covariance)
    covariance[FOUND.free.index("tau_roll"), FOUND.free.index("tau_roll")] = 0.024**2
    remarks = judge_parameters(FOUND, replace(limits, covariance=covariance, random=covariance))
    (remark,) = (finding for finding in remarks if finding.kind == "not_identifiable")
    assert "barely be separated" in remark.message
    assert "Trust their sum" not in remark.message


def test_lag_and_delay_that_trade_have_a_sum_that_is_known_better() -> None:
    limits = spread(FOUND, 9.0, correlation=-1.0)
    (remark,) = (finding for finding in judge_parameters(FOUND, limits) if finding.kind == "not_identifiable")
    assert remark.numbers["sum_s"] == pytest.approx(0.04, rel=1e-12)
    # Perfectly opposed, the deviations of 2.7 and 0.9 ms subtract.
    assert remark.numbers["std_s"] == pytest.approx(1.8e-3, rel=1e-12)


@pytest.mark.parametrize(("value", "refused"), [(0.09, True), (0.021, True), (0.019, False), (-0.2, False)])
def test_a_vehicle_that_its_own_speed_pushes_on_is_refused(value: float, *, refused: bool) -> None:
    model = library_model("axis.roll")
    fitted = SimpleNamespace(
        problem=SimpleNamespace(structure=model),
        parameters=model.parameters.with_values({"Y_v": value}),
        bounds=SimpleNamespace(names=("L_v", "Y_v"), std=np.array([0.3, 0.01])),
    )
    found = list(_pushed_on_by_speed(fitted))  # type: ignore[arg-type]
    assert [(one.kind, one.where) for one in found] == ([("impossible_physics", "Y_v")] if refused else [])


def a_fit(**changes: Any) -> Any:
    """A sound fit of two outputs to one input, with what a test changes of it."""
    errors = np.array([[[0.01] * 20], [[0.05] * 20]])
    made = {
        "estimate": "joint",
        "outcome": Outcome.CONVERGED,
        "final": Outcome.CONVERGED,
        "poles": [-2.0, -20.0],
        "costs": [[5.0], [6.0]],
        "missed": {"p/roll_command": 0.02, "ay/roll_command": 0.05},
        **changes,
    }
    data = SimpleNamespace(
        outputs=("p", "ay"),
        inputs=("roll_command",),
        random_error=errors,
        estimate=made["estimate"],
        sample_rate_hz=100.0,
    )
    return SimpleNamespace(
        problem=SimpleNamespace(
            structure=rate_model("rate.roll"),
            data=data,
            used=np.ones(errors.shape, dtype=np.bool_),
            weights=np.ones(errors.shape),
        ),
        solution=SimpleNamespace(outcome=made["outcome"], settled=made["outcome"] is Outcome.CONVERGED),
        final=SimpleNamespace(outcome=made["final"], settled=made["final"] is Outcome.CONVERGED),
        system=SimpleNamespace(
            poles=lambda: np.array(made["poles"]),
            proper=lambda: (np.diag(made["poles"]), None, np.ones((2, len(made["poles"]))), None),
        ),
        parameters=FOUND,
        costs=np.array(made["costs"]),
        average_cost=float(np.mean(made["costs"])),
        bounds=SimpleNamespace(
            names=(), std=np.zeros(0), model_error=SimpleNamespace(sizes=made["missed"], deviations=made["missed"])
        ),
    )


@pytest.mark.parametrize(
    ("changes", "kinds"),
    [
        ({}, []),
        ({"outcome": Outcome.OUT_OF_ITERATIONS}, ["not_converged"]),
        ({"outcome": Outcome.STALLED}, ["not_converged"]),
        # The values are those of the second fit.
        ({"final": Outcome.OUT_OF_ITERATIONS}, ["not_converged"]),
        ({"poles": [-2.0, -630.0]}, ["impossible_physics"]),
        ({"poles": [-2.0, -620.0]}, []),
        ({"costs": [[150.0], [51.0]]}, ["poor_fit"]),
        ({"costs": [[150.0], [49.0]]}, []),
        ({"estimate": "direct", "missed": {"p/roll_command": 0.3}}, ["structure_error"]),
        ({"estimate": "direct", "missed": {"p/roll_command": 0.26}}, []),
        ({"estimate": "joint", "missed": {"p/roll_command": 0.3}}, []),
        ({"estimate": "direct", "missed": {"ay/roll_command": 0.3}}, []),
    ],
)
def test_a_fit_that_is_not_sound_is_refused_for_its_reason(changes: dict[str, Any], kinds: list[str]) -> None:
    reasons = _reasons_to_refuse(a_fit(**changes))
    assert [reason.kind for reason in reasons] == kinds
    assert all(reason.severity == "error" for reason in reasons)


CERTAIN, BY_CHANCE, HIDDEN = Evidence(8.0, 40.0), Evidence(2.0, 40.0), Evidence(0.1, 1.0)


@pytest.mark.parametrize(
    ("changes", "evidence", "where"),
    [
        ({}, CERTAIN, []),
        # The response that is known best is the one that tells.
        ({"missed": {"p/roll_command": 0.026, "ay/roll_command": 0.02}}, CERTAIN, ["p/roll_command"]),
        ({"missed": {"p/roll_command": 0.2, "ay/roll_command": 0.02}}, CERTAIN, ["p/roll_command"]),
        ({"missed": {"p/roll_command": 0.09, "ay/roll_command": 0.02}}, BY_CHANCE, []),
        # Above 10 % one that may be chance is no pass.
        ({"missed": {"p/roll_command": 0.2, "ay/roll_command": 0.02}}, BY_CHANCE, ["p/roll_command"]),
        ({"missed": {"p/roll_command": 0.024, "ay/roll_command": 0.3}}, CERTAIN, []),
        ({"costs": [[5.0], [31.0]]}, CERTAIN, []),
        ({"costs": [[1.0], [0.5]]}, CERTAIN, []),
    ],
)
def test_a_structure_that_does_not_hold_is_remarked_on(
    changes: dict[str, Any], evidence: Evidence, where: list[str]
) -> None:
    fitted = a_fit(**changes)
    found = judge_structure(fitted.problem, fitted.costs, fitted.bounds, {"p/roll_command": evidence})
    assert [(one.kind, one.where) for one in found] == [("structure_error", name) for name in where]
    assert all(one.severity == "warning" for one in found)


def test_a_structure_whose_error_would_not_show_is_not_passed() -> None:
    fitted = a_fit()
    (found,) = judge_structure(fitted.problem, fitted.costs, fitted.bounds, {"p/roll_command": HIDDEN})
    assert (found.kind, found.severity) == ("structure_error", "info")
    assert found.message.startswith("Not enough data to judge the structure by p/roll_command")


def test_a_response_that_costs_many_times_the_others_is_remarked_on() -> None:
    fitted = a_fit()
    names = ("p", "phi", "ay")
    fitted.problem.data.outputs = names
    fitted.problem.data.random_error = np.full((3, 1, 20), 0.01)
    fitted.problem.used = np.ones((3, 1, 20), dtype=np.bool_)
    fitted.problem.weights = np.ones((3, 1, 20))
    (found,) = judge_structure(fitted.problem, np.array([[4.0], [5.0], [31.0]]), fitted.bounds, {})
    assert (found.kind, found.where) == ("structure_error", "ay/roll_command")
    assert judge_structure(fitted.problem, np.array([[4.0], [5.0], [29.0]]), fitted.bounds, {}) == ()
    # In gusts: an error of 15 % costs 60 by itself.
    fitted.problem.data.random_error = np.full((3, 1, 20), 0.15)
    assert judge_structure(fitted.problem, np.array([[4.0], [5.0], [63.0]]), fitted.bounds, {}) == ()


@pytest.mark.parametrize(
    ("asked", "given", "words"),
    [
        ((1.0, 50.0), None, ""),
        ((0.1, 50.0), None, "of the band 0.1 to 50 rad/s of p/roll_command could be fitted; above, the coherence"),
        ((0.1, 50.0), (1.0, 40.0), ""),
        (
            (1.0, 50.0),
            (0.5, 100.0),
            "of the band 0.5 to 100 rad/s of p/roll_command could be fitted; the sweeps end at",
        ),
    ],
    ids=["reached", "short", "the given one is reached", "the given one ends with the sweeps"],
)
def test_how_much_of_a_band_was_fitted_is_judged_by_what_was_given(
    asked: tuple[float, float], given: tuple[float, float] | None, words: str
) -> None:
    omega = np.geomspace(1.0, 40.0, 50)
    data = SimpleNamespace(omega_rad_s=omega, outputs=("p",), inputs=("roll_command",))
    measured: Any = SimpleNamespace(
        response=data, asked_rad_s=asked, excited_to_rad_s=50.0 if given else np.inf, trusted_rad_s=(0.1, 40.0)
    )
    found = judge_band(measured, np.ones((1, 1, 50), dtype=bool), {"p/roll_command": given} if given else {})
    assert [words in one.message for one in found] == [True] * bool(words)
