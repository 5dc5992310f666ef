"""Many starts at once end where each would end alone, and a fit keeps the minima that it met."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.fitting.known_models import posed

from rotorid.errors import InsufficientDataError
from rotorid.fitting.frequency import fit as many
from rotorid.fitting.frequency.fit import fit_frequency, fit_many, minimize_many
from rotorid.fitting.frequency.problem import FrequencyProblem
from rotorid.fitting.least_squares import LevenbergMarquardt
from rotorid.models.library import library_model, rate_model
from rotorid.models.toml import from_toml

OMEGA = np.geomspace(1.0, 40.0, 30)
RATE = rate_model("rate.roll")
TRUTH = {"L_roll": 60.0, "L_p": -2.0, "T_motor": 0.05, "tau_roll": 0.012}


def scattered(problem: FrequencyProblem, count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    truth = np.array([TRUTH.get(name, 0.1) for name in problem.parameters.free])
    return truth * np.exp(0.7 * rng.standard_normal((count, truth.size)))


def test_together_and_alone_end_in_the_same_places(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = posed(RATE, TRUTH, OMEGA, noise=0.1)
    starts = scattered(problem, 12)
    solver = LevenbergMarquardt(iterations=200)
    together = fit_many(problem, starts, solver=solver)
    for start, minimum in zip(starts, together, strict=True):
        alone = solver.minimize(problem.residuals, start, *problem.box)
        assert minimum.cost == pytest.approx(alone.cost, rel=1e-8)
        np.testing.assert_allclose(minimum.theta, alone.theta, rtol=1e-4, atol=1e-6)
    monkeypatch.setattr(many, "_BLOCK_NUMBERS", 1)
    for one, other in zip(together, fit_many(problem, starts, solver=solver), strict=True):
        np.testing.assert_allclose(one.theta, other.theta, rtol=1e-8)


def test_residuals_of_many_are_those_of_each() -> None:
    """Affine entries and products of parameters take two ways to their derivatives."""
    structure = library_model("rig.roll")
    truth = {"J_x": 0.047, "K_f": 0.109, "L": 0.197, "tau_3": 0.228, "tau_4": 0.177}
    for problem in (posed(RATE, TRUTH, OMEGA), posed(structure, truth, OMEGA)):
        assert problem.parameter_map.affine is (problem.structure is RATE)
        thetas = scattered(problem, 4)
        residuals, jacobians = problem.many_residuals(thetas)
        costs = problem.many_costs(thetas)
        for k, theta in enumerate(thetas):
            values = problem.parameters.unpack(theta).values
            model, slopes = problem.structure.response_and_jacobian(values, OMEGA, problem.parameters.directions)
            relative = np.log(model / problem.data.values)[problem.used]
            magnitude, phase = problem.point_scales
            expected = np.concatenate([magnitude * relative.real, phase * relative.imag])
            np.testing.assert_allclose(residuals[k], expected, rtol=1e-9, atol=1e-9)
            slope = (slopes / model)[:, problem.used]
            expected = np.concatenate([magnitude * slope.real, phase * slope.imag], axis=1)
            np.testing.assert_allclose(jacobians[k], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
            assert costs[k] == pytest.approx(float(residuals[k] @ residuals[k]), rel=1e-12)


POLE = """
name = "pole"
inputs = ["a"]
states = ["x", "y"]
outputs = ["x"]
F = [[0, 1], ["k", "d"]]
G = [[0], ["g"]]
H0 = [[1, 0]]
[parameters.k]
value = -4.0
[parameters.d]
value = -0.5
upper = 0.0
[parameters.g]
value = 1.0
"""


def test_a_pole_at_a_point_stops_neither_the_start_nor_its_neighbors() -> None:
    structure = from_toml(POLE)
    omega = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    problem = posed(structure, structure.parameters.values, omega)
    starts = np.array([[-4.0, 0.0, 1.0], [-3.0, -0.4, 2.0]])
    on_the_pole, beside = fit_many(problem, starts)
    assert on_the_pole.cost == np.inf
    assert beside.cost < 1e-10
    assert fit_frequency(problem, starts=list(starts)).cost < 1e-10
    with pytest.raises(InsufficientDataError, match="pole has no response at any start"):
        fit_frequency(problem, starts=[starts[0]])


TIED = """
name = "tied"
inputs = ["a"]
states = ["x"]
outputs = ["x"]
F = [["d"]]
G = [["g"]]
H0 = [[1]]
[parameters.d]
value = -1.0
[parameters.g]
tied = "-2*d"
upper = 5.0
"""


def test_a_tied_parameter_is_kept_within_its_bounds() -> None:
    """The data ask for d = -4 and g = 8, which its bound forbids: the steps there are taken back."""
    structure = from_toml(TIED)
    free = from_toml(TIED.replace("upper = 5.0", ""))
    data = posed(free, {"d": -4.0, "g": 8.0}, OMEGA).data
    problem = FrequencyProblem(
        structure=structure, parameters=structure.parameters, data=data, used=np.ones(data.values.shape, dtype=bool)
    )
    solution = fit_frequency(problem)
    assert problem.parameters.unpack(solution.theta).values["g"] <= 5.0
    assert solution.cost < float(problem.many_costs(problem.parameters.pack()[None])[0])
    (minimum,) = fit_many(problem, [problem.parameters.pack()])
    assert -2.0 * minimum.theta[0] <= 5.0


def test_a_minimum_found_twice_ends_the_search_and_others_are_kept() -> None:
    problem = posed(RATE, TRUTH, OMEGA, noise=0.05)
    good = np.array([50.0, -1.5, 0.04, 0.02])
    # A quarter of a second late is more than a turn at 40 rad/s: the phase wraps into another minimum.
    late = np.array([50.0, -1.5, 0.04, 0.25])
    solution = fit_frequency(problem, starts=[late, good, 1.1 * good, late])
    assert len(solution.others) == 1
    assert solution.others[0].cost > solution.cost
    assert solution.others[0].theta[3] > 0.1
    assert not solution.others[0].theta.flags.writeable
    assert fit_frequency(problem, starts=[good]).others == ()


def test_each_search_has_data_of_its_own_and_says_whether_it_settled() -> None:
    """Square roots: of 1, where it begins, of 100, which is far off, and of what is no number."""
    data = np.array([1.0, 100.0, np.nan])

    def residuals(thetas: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return thetas**2 - data[which, None], 2.0 * thetas[:, :, None]

    wide = np.array([np.inf])
    found = minimize_many(residuals, np.ones((3, 1)), -wide, wide, size=1)
    assert found.settled.tolist() == [True, True, False]
    np.testing.assert_allclose(found.theta[:2, 0], [1.0, 10.0], rtol=1e-6)
    assert found.cost[2] == np.inf
    brief = minimize_many(residuals, np.ones((3, 1)), -wide, wide, size=1, solver=LevenbergMarquardt(iterations=2))
    assert brief.settled.tolist() == [True, False, False]
