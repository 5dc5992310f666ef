"""Nonlinear output error: exact Jacobians, several records, nuisances, noise."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.fitting.least_squares import Outcome
from rotorid.fitting.time.nonlinear import NonlinearProblem, NonlinearUnknown, fit_nonlinear
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.nonlinear import nonlinear_structure
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear

SLED = nonlinear_structure(
    name="sled",
    inputs=["push"],
    states=["x", "v"],
    equations=["x' = v", "v' = push - k*abs(v)*v - c*v"],
    outputs=["x", "speed = v"],
    delays={"push": "tau"},
    parameters=ParameterSet(
        [
            Parameter(name="k", value=0.4, unit="1/m", lower=0.0, upper=9.0),
            Parameter(name="c", value=0.2, unit="1/s"),
            Parameter(name="tau", value=0.033, unit="s", lower=0.0, upper=0.5),
        ]
    ),
    starts={"x": "x"},
)
RATE_HZ = 25.0
STARTS = np.array([[0.5, 0.3], [-1.0, 0.8]])


def record(name: str, samples: int, start: np.ndarray, seed: int, *, noise: float, shift: float = 0.0) -> TimeData:
    rng = np.random.default_rng(seed)
    u = np.repeat(2.0 * rng.choice([-1.0, 1.0], (1, samples)), 5, axis=1)[:, :samples]
    y = simulate_nonlinear(SLED, SLED.parameters.values, u, sample_rate_hz=RATE_HZ, x0=start, before=u[:, 0])
    y = y + noise * np.array([[1.0], [3.0]]) * rng.standard_normal(y.shape) + np.array([[0.0], [shift]])
    return TimeData(name=name, inputs=u, outputs=y, sample_rate_hz=RATE_HZ)


def problem(
    *unknowns: NonlinearUnknown, noise: float = 0.0, shift: float = 0.0, samples: int = 120
) -> NonlinearProblem:
    records = tuple(
        record(f"r{i}", samples + 20 * i, start, i, noise=noise, shift=shift) for i, start in enumerate(STARTS)
    )
    return NonlinearProblem(structure=SLED, parameters=SLED.parameters, records=records, unknowns=unknowns)


def test_the_jacobian_is_exact() -> None:
    given = problem("initial_state", "output_shift", noise=0.1)
    given = given.with_noise(np.array([[0.02, 0.01], [0.01, 0.3]]))
    theta = given.start + 0.01
    _, jacobian = given.residuals(theta)
    step = 1e-5
    moved = [
        (given.residuals(theta + step * e)[0] - given.residuals(theta - step * e)[0]) / (2.0 * step)
        for e in np.eye(theta.size)
    ]
    # Truncation of h^2 = 1e-10, rounding of 1e-15 / h = 1e-10, on columns of the size of the largest.
    assert np.abs(jacobian - np.stack(moved, axis=1)).max() < 1e-7 * np.abs(jacobian).max()


def test_parts_hold_what_is_left_beside_the_unknowns() -> None:
    given = problem("initial_state", "output_shift", noise=0.1)
    found = fit_nonlinear(given)
    parts = found.problem.parts(found.solution.theta)
    assert [part.residual.shape for part in parts] == [(120, 2), (140, 2)]
    for part in parts:
        inside = part.unknown.reshape(-1, part.unknown.shape[2])
        # The position has a start and a shift, which are one and the same.
        assert inside.shape[1] == 3
        assert np.abs(inside.T @ part.slopes.reshape(-1, 3)).max() < 1e-9 * np.abs(part.slopes).max()
        assert np.abs(inside.T @ part.residual.ravel()).max() < 1e-3 * np.linalg.norm(part.residual)
    slopes = np.concatenate([part.slopes.reshape(-1, 3) for part in parts])
    assert np.linalg.inv(slopes.T @ slopes) == pytest.approx(found.covariance, rel=1e-6)


def test_a_vector_holds_parameters_then_nuisances_of_each_record() -> None:
    given = problem("initial_state", "output_shift")
    theta = np.arange(3.0 + 2 * 4)
    theta[:3] = 0.1
    estimate = given.unpack(theta)
    assert estimate.starts.tolist() == [[3.0, 4.0], [7.0, 8.0]]
    assert estimate.shifts.tolist() == [[5.0, 6.0], [9.0, 10.0]]
    assert all(bound.shape == theta.shape for bound in given.box)
    assert problem("output_shift").start.size == 3 + 2 * 3


def test_a_measured_start_is_kept_unless_it_is_unknown() -> None:
    given = problem()
    # The speed has no start in the model, so it is searched for all the same.
    assert given.start.size == 3 + 2
    assert given.unpack(given.start).starts[:, 0] == pytest.approx(STARTS[:, 0])


@pytest.mark.parametrize("unknowns", [("initial_state",), ("initial_state", "output_shift"), ()])
def test_truth_comes_back_from_clean_records(unknowns: tuple[NonlinearUnknown, ...]) -> None:
    given = problem(*unknowns, shift=0.2 if "output_shift" in unknowns else 0.0)
    far = given.parameters.with_values({"k": 1.5, "c": 0.0, "tau": 0.1})
    found = fit_nonlinear(given.with_parameters(far), rounds=2)
    assert found.solution.outcome is Outcome.CONVERGED
    truth = SLED.parameters.values
    # What is left is rounding, and a solver that rests at 1e-10 of the first cost.
    assert found.estimate.parameters.values == pytest.approx(truth, rel=1e-5)
    assert found.estimate.starts[:, 1] == pytest.approx(STARTS[:, 1], abs=1e-5)
    if "output_shift" in unknowns:
        assert found.estimate.shifts[:, 1] == pytest.approx([0.2, 0.2], abs=1e-5)


def test_the_noise_is_estimated_until_it_rests() -> None:
    found = fit_nonlinear(problem("initial_state", noise=0.05, samples=1500))
    assert found.settled
    # 3020 samples give a variance to sqrt(2/3020) = 2.6 %; four of these.
    assert np.sqrt(np.diag(found.noise)) == pytest.approx([0.05, 0.15], rel=0.5 * 4 * 0.026)
    assert found.solution.cost == pytest.approx(2 * found.problem.samples, rel=1e-3)


def test_a_model_without_values_turns_the_search_back() -> None:
    root = nonlinear_structure(
        name="root",
        inputs=["u"],
        states=["x"],
        equations=["x' = u - k*sqrt(x)"],
        outputs=["x"],
        parameters=ParameterSet([Parameter(name="k", value=1.0, unit="1")]),
        starts={"x": "x"},
    )
    u = np.full((1, 80), 1.0)
    y = simulate_nonlinear(root, {"k": 0.8}, u, sample_rate_hz=20.0, x0=np.array([0.1]), before=np.ones(1))
    data = TimeData(name="tank", inputs=u, outputs=y, sample_rate_hz=20.0)
    given = NonlinearProblem(structure=root, parameters=root.parameters, records=(data,), unknowns=())
    assert np.isnan(given.residuals(np.array([20.0]))[0]).any()
    assert fit_nonlinear(given).estimate.parameters["k"].value == pytest.approx(0.8, rel=1e-6)


def test_wrong_problems_are_refused() -> None:
    good = problem()
    with pytest.raises(UsageError, match="no record"):
        NonlinearProblem(structure=SLED, parameters=SLED.parameters, records=())
    with pytest.raises(UsageError, match="the parameters lack k of sled"):
        NonlinearProblem(structure=SLED, parameters=SLED.parameters.only(["c", "tau"]), records=good.records)
    with pytest.raises(UsageError, match="has 1 inputs and 2 outputs"):
        NonlinearProblem(structure=SLED.select(["x"]), parameters=SLED.parameters, records=good.records)
    with pytest.raises(UsageError, match="unknown initial condition 'bias'"):
        problem("bias")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="noise has shape"):
        good.with_noise(np.eye(3))
    with pytest.raises(UsageError, match="rounds"):
        fit_nonlinear(good, rounds=0)
    with pytest.raises(UsageError, match="hold"):
        Scheme(hold="second")  # type: ignore[arg-type]
