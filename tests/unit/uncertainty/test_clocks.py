"""Clocks in time: a step with slopes beside all unknowns is the refit of shifted records."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.fitting.time.nonlinear import NonlinearProblem, fit_nonlinear
from rotorid.fitting.time.output_error import TimeData, TimeProblem
from rotorid.models.library import nonlinear_model, response_model
from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear
from rotorid.typing import FloatArray
from rotorid.uncertainty.clocks import channel_errors, clock_groups, clock_shifts, scale_shifts, shifted

RATE_HZ = 20.0
LATE = 0.15


def tilts(rng: np.random.Generator, samples: int) -> FloatArray:
    """Roll and pitch as an attitude controller answers random binary set-points, at a steady height."""
    binary = np.repeat(0.1 * rng.choice([-1.0, 1.0], (2, samples // 10)), 10, axis=1)
    kernel = np.exp(-np.arange(20) / 4.0)
    smooth = [np.convolve(row, kernel / kernel.sum())[:samples] for row in binary]
    return np.stack([*smooth, np.zeros(samples), np.zeros(samples)])


def drag_problem(seed: int) -> NonlinearProblem:
    """Drag of 400 samples in noise."""
    rng, scheme = np.random.default_rng(seed), Scheme(hold="first")
    model = nonlinear_model("drag.linear")
    u = tilts(rng, 400)
    values = {"k_Dx": 0.25, "k_Dy": 0.33}
    y = simulate_nonlinear(model, values, u, sample_rate_hz=RATE_HZ, before=u[:, 0], scheme=scheme)
    record = TimeData(name="drag", inputs=u, outputs=y + 0.02 * rng.standard_normal(y.shape), sample_rate_hz=RATE_HZ)
    return NonlinearProblem(structure=model, parameters=model.parameters, records=(record,), scheme=scheme)


@pytest.mark.parametrize("seed", range(3))
def test_a_step_is_the_refit(seed: int) -> None:
    fit = fit_nonlinear(drag_problem(seed))
    theta, problem = fit.solution.theta, fit.problem
    found = clock_shifts(problem, theta)
    for row, group in zip(found, clock_groups(problem.structure.inputs, problem.structure.outputs), strict=True):
        late, early = (
            fit_nonlinear(
                replace(problem, records=tuple(shifted(record, group, side) for record in problem.records)),
                start=theta,
                rounds=1,
            ).solution.theta[:2]
            for side in (LATE, -LATE)
        )
        np.testing.assert_allclose(row, 0.5 * (late - early), rtol=0.05, atol=3e-5)


def test_attitudes_against_speeds_move_drag() -> None:
    """To speeds that oscillate with omega a clock that is late by tau is a drag of about omega squared times tau."""
    fit = fit_nonlinear(drag_problem(1))
    attitudes, _, _, speeds = clock_shifts(fit.problem, fit.solution.theta)
    np.testing.assert_allclose(attitudes, -speeds, rtol=0.3)
    assert (np.abs(attitudes) > 1e-3).all()


def test_each_channel_has_the_clock_of_its_message() -> None:
    fit = fit_nonlinear(drag_problem(1))
    usual = clock_shifts(fit.problem, fit.solution.theta)
    quick = clock_shifts(fit.problem, fit.solution.theta, late=lambda name: 0.015 if name == "theta" else LATE)
    np.testing.assert_array_equal(usual, quick)  # roll has the same unit, and is as slow as it was
    names = {"phi": 0.1 * LATE, "theta": 0.1 * LATE}
    quick = clock_shifts(fit.problem, fit.solution.theta, late=lambda name: names.get(name, LATE))
    np.testing.assert_allclose(quick[0], 0.1 * usual[0], rtol=0.2)
    np.testing.assert_array_equal(quick[1:], usual[1:])


def lag_problem() -> tuple[TimeProblem, FloatArray]:
    """A first order with delay that simulates its own record exactly, and its values."""
    lag = response_model("response.first_order_delay", [("phi_setpoint", "phi")])
    values = lag.parameters.with_values({"K_phi": 1.0, "T_phi": 0.2, "tau_phi": 0.07})
    rng = np.random.default_rng(0)
    steps = np.repeat(0.1 * rng.choice([-1.0, 1.0], (1, 20)), 12, axis=1)
    record = TimeData(name="steps", inputs=steps, outputs=0.0 * steps, sample_rate_hz=RATE_HZ)
    problem = TimeProblem(structure=lag, parameters=values, records=(record,), unknowns=("initial_state",))
    return problem.noiseless(values.pack()), values.pack()


def test_a_clock_is_a_delay() -> None:
    asked, answered = clock_shifts(*lag_problem())
    late_s = LATE / RATE_HZ
    assert asked[2] == pytest.approx(-late_s, rel=0.4)
    assert answered[2] == pytest.approx(late_s, rel=0.4)


def test_a_scale_is_a_gain() -> None:
    np.testing.assert_allclose(scale_shifts(*lag_problem()), [[-0.0025, 0, 0], [0.0025, 0, 0]], atol=1e-7)


def test_the_others_move_without_what_is_on_its_bound_and_it_moves_with_them() -> None:
    problem, theta = lag_problem()
    free, held = (channel_errors(problem, theta, {}, held=names) for names in ((), ("tau_phi",)))
    assert [row["tau_phi"] for row in held] == [row["tau_phi"] for row in free]
    assert abs(held[0]["T_phi"]) > 2.0 * abs(free[0]["T_phi"])
    only = channel_errors(problem, theta, {}, held=tuple(problem.parameters.free))
    assert only == free


def test_channels_of_one_unit_share_a_clock() -> None:
    groups = clock_groups(["phi_setpoint", "velocity_down_setpoint", "own"], ["phi", "theta", "velocity_down"])
    assert [group.inputs for group in groups] == [(0,), (1,), (2,), (), ()]
    assert [group.outputs for group in groups] == [(), (), (), (0, 1), (2,)]
