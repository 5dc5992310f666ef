"""The cost of accelerations: its equations, its exact minimum, its way down where there is no closed form."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.least_squares import Outcome
from rotorid.models.parameter import ParameterSet
from rotorid.models.rotors import RotorLayout
from rotorid.search.acceleration import OUTPUTS, AccelerationProblem, hover_parameters
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2
from rotorid.vehicles import hover_quadrotor
from rotorid.vehicles.hover_quadrotor import ARM_M, SAMPLE_RATE_HZ, TRUTH, HoverFlight

FLIGHT = hover_quadrotor.fly(np.random.default_rng(0))
ALL_FREE = hover_parameters(m=TRUTH["m"], omega_max=TRUTH["omega_max"], T_motor=TRUTH["T_motor"])
KAPPA_HELD = ALL_FREE.fix("kappa", TRUTH["kappa"])
LAG_FREE = KAPPA_HELD.free_again("T_motor")
# Yaw cannot have the gain that suits it best: there is no closed form.
YAW_HELD = KAPPA_HELD.fix("I_zz", TRUTH["I_zz"])


def posed(parameters: ParameterSet = ALL_FREE, flight: HoverFlight = FLIGHT, **changes: Any) -> AccelerationProblem:
    given: dict[str, Any] = {
        "motors": flight.motors,
        "tilt": flight.tilt,
        "accelerations": flight.accelerations,
        "sample_rate_hz": SAMPLE_RATE_HZ,
        "layout": hover_quadrotor.layout(),
        "parameters": parameters,
    }
    return AccelerationProblem(**{**given, **changes})


def truth_of(problem: AccelerationProblem) -> FloatArray:
    return np.array([TRUTH[name] for name in problem.parameters.free])


def starts(problem: AccelerationProblem, count: int = 4) -> FloatArray:
    return problem.search_box.at(np.random.default_rng(5).random((count, problem.search_box.lower.size)))


def as_printed(values: dict[str, float]) -> FloatArray:
    """The four accelerations, equation after equation."""
    kept = np.exp(-1.0 / (SAMPLE_RATE_HZ * values["T_motor"]))
    speed = FLIGHT.motors[:, [0]] * np.ones(FLIGHT.time_s.size)
    for k in range(FLIGHT.time_s.size - 1):
        speed[:, k + 1] = kept * speed[:, k] + (1.0 - kept) * FLIGHT.motors[:, k]
    F1, F2, F3, F4 = values["c_t"] * values["omega_max"] ** 2 * speed
    phi, theta, _ = FLIGHT.attitude
    return np.stack(
        [
            (F1 + F2 + F3 + F4) / values["m"] * np.cos(phi) * np.cos(theta) - STANDARD_GRAVITY_M_S2,
            ARM_M * (F4 - F2) / values["I_xx"],
            ARM_M * (F1 - F3) / values["I_yy"],
            values["kappa"] * (F1 - F2 + F3 - F4) / values["I_zz"],
        ]
    )


@pytest.mark.parametrize("error", ["absolute", "squared"])
@pytest.mark.parametrize("parameters", [ALL_FREE, LAG_FREE], ids=["lag held", "lag free"])
def test_costs_are_those_of_the_equations(parameters: ParameterSet, error: str) -> None:
    problem = posed(parameters, error=error)
    thetas = starts(problem)
    power = 2 if error == "squared" else 1
    moved = FLIGHT.accelerations - FLIGHT.accelerations.mean(axis=1, keepdims=True)
    sizes = np.sum(np.abs(moved) ** power, axis=1)
    for theta, cost, points in zip(thetas, problem.many_costs(thetas), problem.point_costs(thetas), strict=True):
        model = as_printed({**TRUTH, **problem.named(theta)})
        np.testing.assert_allclose(problem.modeled(theta), model, rtol=1e-9, atol=1e-9)
        each = np.abs(FLIGHT.accelerations - model) ** power / sizes[:, None]
        assert cost == pytest.approx(each.sum() / len(OUTPUTS), rel=1e-9)
        np.testing.assert_allclose(points, each.sum(axis=0) / len(OUTPUTS), rtol=1e-6, atol=1e-12)


def test_the_truth_explains_the_flight_but_for_its_noise() -> None:
    problem = posed()
    np.testing.assert_allclose(problem.modeled(truth_of(problem)), FLIGHT.exact, atol=1e-9)
    quiet = posed(flight=hover_quadrotor.fly(np.random.default_rng(0), noise=0.0))
    assert quiet.many_costs(truth_of(quiet)[None])[0] < 1e-9


@pytest.mark.parametrize("parameters", [KAPPA_HELD, LAG_FREE], ids=["lag held", "lag free"])
def test_slopes_are_the_derivatives(parameters: ParameterSet) -> None:
    problem = posed(parameters)
    theta = 1.2 * truth_of(problem)
    step = 1e-5
    for number, slope in enumerate(problem.slopes(theta)):
        away = step * theta * np.eye(theta.size)[number]
        rise = problem.modeled(theta + away) - problem.modeled(theta - away)
        # Central differences are off by the square of the step, and by the rounding of what is subtracted.
        np.testing.assert_allclose(slope * theta[number], rise / (2.0 * step), atol=1e-8 * np.abs(rise).max() / step)


@pytest.mark.parametrize("error", ["absolute", "squared"])
def test_the_closed_form_is_the_minimum_from_wherever_it_begins(error: str) -> None:
    problem = posed(error=error)
    ends = [problem.polish(start) for start in starts(problem)]
    for found in ends:
        assert found.outcome is Outcome.CONVERGED
        assert found.cost == pytest.approx(float(problem.many_costs(found.theta[None])[0]), rel=1e-12)
        assert found.cost == pytest.approx(float(found.residual @ found.residual), rel=1e-12)
        assert found.trace[0] >= found.trace[-1]
        # The cost is convex in each gain, so a place that is lowest among its neighbors is the lowest of all.
        around = found.theta * (1.0 + 1e-4 * np.concatenate([np.eye(5), -np.eye(5)]))
        assert problem.many_costs(around).min() >= found.cost
    # Ends differ in what is not seen, and in nothing else.
    named = [problem.named(found.theta) for found in ends]
    for one in named[1:]:
        assert one["kappa"] / one["I_zz"] == pytest.approx(named[0]["kappa"] / named[0]["I_zz"], rel=1e-9)
        assert [one[n] for n in ("c_t", "I_xx", "I_yy")] == pytest.approx(
            [named[0][n] for n in ("c_t", "I_xx", "I_yy")], rel=1e-9
        )
    assert np.ptp([one["kappa"] for one in named]) > 0.1 * TRUTH["kappa"]


def test_bounds_in_the_way_leave_the_closed_form() -> None:
    """κ and I_zz are seen as a ratio: where one meets its bound, the other makes up for it."""
    problem = posed()
    corners = np.full((4, 5), 0.5)
    corners[:, [problem.parameters.free.index(name) for name in ("kappa", "I_zz")]] = [[0, 0], [0, 1], [1, 0], [1, 1]]
    ends = [problem.polish(start) for start in problem.search_box.at(corners)]
    # Where both begin at the same side of the box, κ comes back to its bound.
    assert [sum(found.at_bound) for found in ends] == [1, 0, 0, 1]
    for found in ends:
        assert found.evaluations == 1
        assert np.all((found.theta >= problem.search_box.lower) & (found.theta <= problem.search_box.upper))
        assert found.cost == pytest.approx(ends[0].cost, rel=1e-9)


@pytest.mark.parametrize("parameters", [LAG_FREE, YAW_HELD], ids=["lag free", "yaw held"])
@pytest.mark.parametrize("error", ["absolute", "squared"])
def test_steps_lead_down_where_there_is_no_closed_form(parameters: ParameterSet, error: str) -> None:
    problem = posed(parameters, error=error)
    ends = [problem.polish(start) for start in starts(problem, 3)]
    truth = truth_of(problem)
    for found in ends:
        assert found.cost == pytest.approx(float(problem.many_costs(found.theta[None])[0]), rel=1e-9)
        assert list(found.trace) == sorted(found.trace, reverse=True)
        assert found.cost <= problem.many_costs(truth[None])[0]
    # Corners rounded over a hundredth of the mean error move the end by about the square of that.
    np.testing.assert_allclose([found.cost for found in ends], ends[0].cost, rtol=1e-6)
    around = ends[0].theta * (1.0 + 1e-2 * np.concatenate([np.eye(truth.size), -np.eye(truth.size)]))
    assert problem.many_costs(around).min() > ends[0].cost
    # Noise leaves a percent.
    np.testing.assert_allclose(ends[0].theta, truth, rtol=0.03)


def test_closed_form_and_steps_agree() -> None:
    problem = posed(KAPPA_HELD)
    tied = posed(KAPPA_HELD.tie("omega_max", "900 + 0*c_t"))
    start = starts(problem, 1)[0]
    exact, stepped = problem.polish(start), tied.polish(start)
    assert tied.free_powers is None
    assert exact.cost <= stepped.cost <= exact.cost * (1.0 + 1e-5)
    np.testing.assert_allclose(stepped.theta, exact.theta, rtol=2e-3)


def test_parameters_may_be_tied() -> None:
    problem = posed(KAPPA_HELD.tie("I_yy", "1.25*I_xx"))
    assert "I_yy" not in problem.parameters.free
    found = problem.polish(starts(problem, 1)[0])
    np.testing.assert_allclose(found.theta, truth_of(problem), rtol=0.03)


def test_what_weighs_nothing_is_not_looked_at() -> None:
    spoiled = FLIGHT.accelerations.copy()
    spoiled[:, 1000:2000] += 30.0
    weights = np.ones(FLIGHT.time_s.size)
    weights[1000:2000] = 0.0
    moved = {}
    for error in ("absolute", "squared"):
        problem, bad = posed(KAPPA_HELD, error=error), posed(KAPPA_HELD, accelerations=spoiled, error=error)
        start = starts(problem, 1)[0]
        np.testing.assert_allclose(
            bad.polish_points(start, weights).theta, problem.polish_points(start, weights).theta, rtol=1e-9
        )
        moved[error] = np.abs(bad.polish(start).theta / problem.polish(start).theta - 1.0).max()
    # The median of a sixth of wrong samples hardly moves; the mean does.
    assert moved["absolute"] < 0.02
    assert moved["squared"] > 0.2


def test_it_comes_back_from_another_process() -> None:
    problem = posed(LAG_FREE)
    again = pickle.loads(pickle.dumps(problem))
    thetas = starts(problem)
    np.testing.assert_array_equal(again.many_costs(thetas), problem.many_costs(thetas))
    assert not again.motors.flags.writeable


def test_the_box_is_that_of_the_bounds() -> None:
    box = posed(LAG_FREE).search_box
    assert box.scales == ("logarithmic",) * 4 + ("linear",)
    near = ParameterSet(replace(p, lower=0.01, upper=0.09) if p.name == "I_xx" else p for p in KAPPA_HELD)
    assert posed(near).search_box.scales[1] == "linear"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"motors": FLIGHT.motors[:3]}, "shape"),
        ({"tilt": FLIGHT.tilt[:-1]}, "shape"),
        ({"tilt": np.full(FLIGHT.time_s.size, np.nan)}, "finite"),
        ({"error": "cubed"}, "absolute"),
        ({"parameters": ALL_FREE.only(["c_t", "m"])}, "kappa"),
        ({"layout": replace(hover_quadrotor.layout(), arm_known=False)}, "meters"),
    ],
)
def test_what_does_not_belong_together_is_refused(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        posed(**changes)


def test_tilted_rotors_are_refused() -> None:
    plus = hover_quadrotor.layout()
    tilted = RotorLayout(
        name="tilted",
        positions=plus.positions,
        spins=plus.spins,
        axes=np.tile([0.1, 0.0, -1.0], (4, 1)),
        arm_known=True,
    )
    with pytest.raises(UsageError, match="straight up"):
        posed(layout=tilted)


def test_a_channel_that_stands_still_is_said() -> None:
    still = FLIGHT.accelerations.copy()
    still[3] = 0.0
    with pytest.raises(InsufficientDataError, match="r_dot"):
        posed(accelerations=still)


@pytest.mark.parametrize("weights", [np.ones(5), -np.ones(FLIGHT.time_s.size)])
def test_weights_fit_the_samples(weights: FloatArray) -> None:
    with pytest.raises(UsageError, match="every sample"):
        posed().polish_points(truth_of(posed()), weights)
