"""Frequency-domain fits: the cost on paper, its derivatives, usable points, and exact responses recovered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rotorid.data.response import FrequencyResponse
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.frequency.fit import fit_frequency
from rotorid.fitting.frequency.problem import (
    FrequencyProblem,
    coherence_weight,
    log_error,
    pair_costs,
    point_weights,
    usable_points,
)
from rotorid.fitting.frequency.starts import start_values
from rotorid.fitting.least_squares import Outcome
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(1.0, 60.0, 50)
TRUTH = {"L_roll": 60.0, "L_p": -2.0, "T_motor": 0.05, "tau_roll": 0.012}


def measured(
    values: ComplexArray, *, name: str = "rate.roll", coherence: FloatArray | float = 0.95
) -> FrequencyResponse:
    axis, shape = RATE_AXES[name], (1, 1, OMEGA.size)
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values.reshape(shape),
        coherence=np.broadcast_to(coherence, shape),
        random_error=np.full(shape, 0.05),
        covariance=np.zeros((*shape, OMEGA.size)),
        inputs=(axis.input,),
        outputs=(axis.output,),
        estimate="direct",
    )


def problem(data: FrequencyResponse, name: str = "rate.roll", used: np.ndarray | None = None) -> FrequencyProblem:
    structure = rate_model(name)
    chosen = np.ones(data.values.shape, dtype=bool) if used is None else used
    return FrequencyProblem(structure=structure, parameters=structure.parameters, data=data, used=chosen)


def noisy(seed: int = 0) -> FrequencyResponse:
    rng = np.random.default_rng(seed)
    exact = rate_model("rate.roll").response(TRUTH, OMEGA)
    scatter = 0.1 * (rng.standard_normal(exact.shape) + 1j * rng.standard_normal(exact.shape))
    return measured(exact * (1.0 + scatter), coherence=rng.uniform(0.6, 1.0, exact.shape))


def test_weight_is_the_square_with_the_printed_values() -> None:
    np.testing.assert_allclose(coherence_weight(np.array([1.0, 0.6, 0.0])), [0.998, 0.508, 0.0], atol=5e-4)
    # methods, "W(0.6) = 0.51": the exponent is the coherence itself, not its square.
    assert coherence_weight(np.array([0.6]))[0] == pytest.approx((1.58 * (1.0 - np.exp(-0.6))) ** 2, rel=1e-15)


def test_cost_is_the_formula_on_paper() -> None:
    data = noisy()
    model = rate_model("rate.roll").response({**TRUTH, "tau_roll": 0.15, "L_roll": -50.0}, OMEGA)
    used = np.ones(data.values.shape, dtype=bool)
    used[0, 0, [3, 4, 40]] = False
    total, count = 0.0, 0
    for point in np.flatnonzero(used[0, 0]):
        weight = (1.58 * (1.0 - np.exp(-data.coherence[0, 0, point]))) ** 2
        decibel = 20.0 * np.log10(abs(model[0, 0, point])) - 20.0 * np.log10(abs(data.values[0, 0, point]))
        degrees = np.degrees(np.angle(model[0, 0, point]) - np.angle(data.values[0, 0, point]))
        degrees = (degrees + 180.0) % 360.0 - 180.0
        total += weight * (decibel**2 + 0.01745 * degrees**2)
        count += 1
    cost = pair_costs(model, data.values, point_weights(data, used))
    assert cost[0, 0] == pytest.approx(20.0 / count * total, rel=1e-12)


def test_a_phase_of_several_turns_counts_once() -> None:
    data = noisy()
    weights = point_weights(data, np.ones(data.values.shape, dtype=bool))
    turned = data.values * np.exp(2j * np.pi * 3)
    assert pair_costs(turned, data.values, weights)[0, 0] == pytest.approx(0.0, abs=1e-20)
    assert np.abs(log_error(-data.values, data.values).imag) == pytest.approx(np.pi)


def test_joint_weights_follow_the_error_and_keep_the_scale() -> None:
    data = noisy()
    error = np.linspace(0.02, 0.3, OMEGA.size).reshape(1, 1, -1)
    joint = replace(data, estimate="joint", instruments=("roll_excitation",), random_error=error)
    used = np.ones(error.shape, dtype=bool)
    used[0, 0, :5] = False
    weights = point_weights(joint, used)
    assert weights.sum() == pytest.approx(point_weights(data, used).sum(), rel=1e-12)
    ratio = weights[0, 0, 5:] * (error[0, 0, 5:] ** 2 + 0.02**2)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-12)
    assert not weights[0, 0, :5].any()


def test_residuals_square_to_the_cost_and_leave_out_what_is_not_used() -> None:
    used = np.ones((1, 1, OMEGA.size), dtype=bool)
    used[0, 0, 10:13] = False
    posed = problem(noisy(), used=used)
    theta = np.array([40.0, -1.0, 0.02, 0.05])
    residual, jacobian = posed.residuals(theta)
    assert residual.shape == (2 * (OMEGA.size - 3),)
    assert jacobian.shape == (residual.size, 4)
    assert residual @ residual == pytest.approx(float(posed.costs(theta).sum()), rel=1e-12)


@pytest.mark.parametrize("name", RATE_AXES)
@pytest.mark.parametrize("lag", [0.001, 0.04])
def test_jacobian_of_residuals_against_central_differences(name: str, lag: float) -> None:
    axis = RATE_AXES[name]
    truth = {axis.gain: 50.0, axis.damping: -2.0, "T_motor": 0.05, axis.delay: 0.01, "N_spin": 4.0}
    posed = problem(measured(rate_model(name).response(truth, OMEGA), name=name), name)
    begun = {axis.gain: 40.0, axis.damping: -1.0, "T_motor": lag, axis.delay: 0.02, "N_spin": 3.0}
    theta = np.array([begun[one] for one in posed.parameters.free])
    _, jacobian = posed.residuals(theta)
    sizes = {axis.gain: 40.0, axis.damping: 1.0, "T_motor": 0.05, axis.delay: 0.05, "N_spin": 3.0}
    for slot, one in enumerate(posed.parameters.free):
        # Truncation h^2 and rounding eps / h are both near 1e-10 of the slope at h = 1e-5.
        step = 1e-5 * sizes[one] * np.eye(theta.size)[slot]
        difference = (posed.residuals(theta + step)[0] - posed.residuals(theta - step)[0]) / (2.0 * step[slot])
        np.testing.assert_allclose(jacobian[:, slot], difference, rtol=1e-6, atol=1e-6 * np.abs(difference).max())


def test_only_free_parameters_are_fitted() -> None:
    posed = problem(noisy())
    fixed = posed.with_parameters(posed.parameters.fix("T_motor", 0.03))
    solution = fit_frequency(fixed)
    assert solution.theta.shape == (3,)
    assert solution.jacobian.shape[1] == 3
    assert fixed.parameters.unpack(solution.theta).values["T_motor"] == 0.03
    nothing_free = posed.with_parameters(fixed.parameters.fix("L_roll", 60.0).fix("L_p", -2.0).fix("tau_roll", 0.01))
    assert fit_frequency(nothing_free).cost == pytest.approx(float(nothing_free.costs(np.empty(0)).sum()), rel=1e-12)


MAGNITUDES = st.floats(-2.0, 4.0).map(lambda power: 10.0**power)


@given(
    gain=st.tuples(st.sampled_from([-1.0, 1.0]), MAGNITUDES).map(lambda pair: pair[0] * pair[1]),
    damping=st.floats(-8.0, -0.2),
    lag=st.one_of(st.just(0.0), st.floats(0.01, 0.2)),
    delay=st.floats(0.0, 0.1),
    name=st.sampled_from(sorted(RATE_AXES)),
)
@settings(max_examples=60, deadline=None)
def test_exact_responses_give_the_truth_back(gain: float, damping: float, lag: float, delay: float, name: str) -> None:
    # Damping and lag are two poles in a row, and which is which is only known by the motor being the faster one.
    assume(-damping * lag < 0.8)
    axis = RATE_AXES[name]
    truth = {axis.gain: gain, axis.damping: damping, "T_motor": lag, axis.delay: delay, "N_spin": 0.0}
    structure = rate_model(name)
    posed = problem(measured(structure.response(truth, OMEGA), name=name), name)
    if "N_spin" in posed.parameters.names:
        # A lead as long as the lag is none, and neither is seen.
        posed = posed.with_parameters(posed.parameters.fix("N_spin", 0.0))
    found = posed.parameters.unpack(fit_frequency(posed).theta).values
    assert found[axis.gain] == pytest.approx(gain, rel=1e-6)
    assert found[axis.damping] == pytest.approx(damping, rel=1e-6)
    # A lag or delay is seen through its phase at the end of the band: 60 rad/s times 1.7e-8 s is a phase of 1e-6. A lag
    # beside none is told from a delay by its magnitude only, (omega T)^2 / 2.
    apart = np.sqrt(2e-6) if lag == 0.0 else 1e-6
    assert found["T_motor"] == pytest.approx(lag, rel=1e-6, abs=apart / OMEGA[-1])
    assert found[axis.delay] == pytest.approx(delay, rel=1e-6, abs=apart / OMEGA[-1])
    assert found["T_motor"] + found[axis.delay] == pytest.approx(lag + delay, rel=1e-6, abs=1e-6 / OMEGA[-1])


def test_the_best_start_comes_first_and_has_its_gain_solved() -> None:
    posed = problem(measured(rate_model("rate.roll").response({**TRUTH, "L_roll": -3e3}, OMEGA)))
    starts = start_values(posed)
    costs = [float(posed.costs(start).sum()) for start in starts]
    assert len(starts) == 3
    assert costs == sorted(costs)
    assert starts[0][0] < 0.0
    # The gain of a start is the best one: the magnitude part of the cost is at its minimum.
    for factor in (0.99, 1.01):
        moved = starts[0] * np.array([factor, 1.0, 1.0, 1.0])
        assert float(posed.costs(moved).sum()) > costs[0]


def test_given_starts_are_used() -> None:
    posed = problem(noisy())
    solution = fit_frequency(posed, starts=[np.array([50.0, -1.0, 0.04, 0.02])])
    assert solution.outcome is Outcome.CONVERGED
    assert solution.cost == pytest.approx(fit_frequency(posed).cost, rel=1e-8)


def test_too_few_points_are_refused() -> None:
    used = np.zeros((1, 1, OMEGA.size), dtype=bool)
    used[0, 0, :2] = True
    with pytest.raises(InsufficientDataError, match="only 2 usable frequencies; this needs more than 2"):
        fit_frequency(problem(noisy(), used=used))


def test_responses_of_other_channels_are_refused() -> None:
    with pytest.raises(UsageError, match="the data are responses of p to roll_command; expected q to pitch_command"):
        problem(noisy(), "rate.pitch")
    with pytest.raises(UsageError, match=r"selection of shape \(1, 1, 3\)"):
        problem(noisy(), used=np.ones((1, 1, 3), dtype=bool))


@pytest.mark.parametrize(
    ("bad", "expected"),
    [
        ([], range(50)),
        ([20], [k for k in range(50) if k != 20]),
        ([20, 21, 22], [k for k in range(50) if k not in (20, 21, 22)]),
        ([20, 21, 22, 23], range(24, 50)),
        ([30, 31, 32, 33], range(30)),
        (range(50), []),
    ],
)
def test_the_longest_stretch_counts_across_short_dips(bad: list[int], expected: list[int]) -> None:
    coherence = np.full((1, 1, OMEGA.size), 0.9)
    coherence[0, 0, list(bad)] = 0.1
    used = usable_points(measured(np.ones(50, dtype=np.complex128), coherence=coherence), coherence=0.6)
    assert np.flatnonzero(used[0, 0]).tolist() == list(expected)


def test_points_outside_the_band_or_with_large_errors_do_not_count() -> None:
    data = measured(np.ones(50, dtype=np.complex128))
    error = data.random_error.copy()
    error[0, 0, 30:] = 0.31
    band = float(OMEGA[10]), float(OMEGA[40])
    used = usable_points(replace(data, random_error=error), coherence=0.6, band_rad_s=band)
    assert np.flatnonzero(used[0, 0]).tolist() == list(range(10, 30))
