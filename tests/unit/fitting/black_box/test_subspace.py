"""Subspaces: exact without noise, consistent with it, unbiased under feedback where they say so."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.black_box.fit import continuous_from_discrete, information_criteria
from rotorid.fitting.black_box.subspace import Subspace, fit_subspace
from rotorid.fitting.time.output_error import TimeData
from rotorid.simulation.linear import Hold, discretize
from rotorid.simulation.linear_kernels import recursion
from rotorid.typing import FloatArray

STEP_S = 0.02
METHODS: tuple[Subspace, ...] = ("moesp", "cva", "predictor")
# Two lightly damped modes, coupled, two inputs, two outputs.
A_CONTINUOUS = np.array([[-3.0, 2.0, 0.0, 0.0], [-20.0, -3.0, 1.0, 0.0], [0.0, 0.0, -1.0, 6.0], [0.5, 0.0, -6.0, -2.0]])
B_CONTINUOUS = np.array([[1.0, 0.0], [5.0, 1.0], [0.0, 4.0], [2.0, 0.0]])
C = np.array([[1.0, 0.0, 0.5, 0.0], [0.0, 0.2, 0.0, 1.0]])
BLOCK = expm(np.block([[A_CONTINUOUS, B_CONTINUOUS], [np.zeros((2, 6))]]) * STEP_S)
A, B = BLOCK[:4, :4], BLOCK[:4, 4:]


def gain() -> FloatArray:
    """A Kalman gain, so that the noise has a stable inverse."""
    Q, R = 0.02 * np.eye(4), 0.05 * np.eye(2)
    P = solve_discrete_are(A.T, C.T, Q, R)
    return np.asarray(A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + R))


def flown(
    rng: np.random.Generator, samples: int, *, noise: float = 0.0, feedback: float = 0.0, begin: bool = True
) -> TimeData:
    """Inputs are random steps less a share of the measured outputs."""
    K, x = gain(), rng.standard_normal(4) if begin else np.zeros(4)
    r = np.repeat(rng.choice([-1.0, 1.0], size=(2, samples // 5 + 1)), 5, axis=1)[:, :samples]
    e = noise * rng.standard_normal((2, samples))
    closed = np.ascontiguousarray(A - feedback * B @ C)
    states = recursion(closed, np.ascontiguousarray((B @ r + (K - feedback * B) @ e).T), x)
    y = C @ states.T + e
    return TimeData(name="twin", inputs=r - feedback * y, outputs=y, sample_rate_hz=1.0 / STEP_S)


def pulses(A: FloatArray, B: FloatArray, C: FloatArray) -> FloatArray:
    return np.array([C @ np.linalg.matrix_power(A, k) @ B for k in range(80)])


def miss(one: FloatArray, true: FloatArray) -> float:
    return float(np.linalg.norm(one - true) / np.linalg.norm(true))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("feedthrough", [False, True])
def test_four_states_to_rounding_without_noise(method: Subspace, feedthrough: bool) -> None:
    rng = np.random.default_rng(3)
    records = [flown(rng, 600), flown(rng, 400)]
    model = fit_subspace(records, 4, method=method, feedthrough=feedthrough)
    assert miss(pulses(model.A, model.B, model.C), pulses(A, B, C)) < 1e-9
    assert np.abs(model.D).max() < 1e-9
    assert model.singular_values[3] > 1e6 * model.singular_values[4]
    # The initial states too: the simulation is the record.
    for record, x in zip(records, model.initial_states, strict=True):
        for k in range(50):
            np.testing.assert_allclose(model.C @ x, record.outputs[:, k], atol=1e-8)
            x = model.A @ x + model.B @ record.inputs[:, k]


@pytest.mark.parametrize("method", METHODS)
def test_the_error_falls_with_the_root_of_the_samples(method: Subspace) -> None:
    errors = []
    for samples in (500, 8000):
        found = []
        for seed in range(4):
            record = flown(np.random.default_rng(seed), samples, noise=0.1)
            model = fit_subspace([record], 4, method=method, horizon=12)
            found.append(miss(pulses(model.A, model.B, model.C), pulses(A, B, C)))
        errors.append(np.mean(found))
    # Sixteen times the samples: a quarter of the error, within what four seeds scatter.
    assert errors[1] < 0.45 * errors[0]


def test_only_the_predictor_is_unbiased_under_feedback() -> None:
    def error(method: Subspace) -> float:
        found = []
        for seed in range(3):
            record = flown(np.random.default_rng(seed), 10000, noise=1.0, feedback=0.8, begin=False)
            model = fit_subspace([record], 4, method=method, horizon=12)
            found.append(pulses(model.A, model.B, model.C))
        return miss(np.mean(found, axis=0), pulses(A, B, C))

    assert error("predictor") < 0.5 * error("cva")


@pytest.mark.parametrize("method", ["cva", "predictor"])
def test_the_noise_model_is_found(method: Subspace) -> None:
    # The slowest mode of A - K C is 0.929: a horizon of 12 samples forgets too little of it, one of 30 does.
    def error(samples: int) -> float:
        records = [flown(np.random.default_rng(seed), samples, noise=0.3) for seed in (1, 2)]
        models = [fit_subspace([record], 4, method=method, horizon=30) for record in records]
        return float(np.mean([miss(pulses(one.A, one.K, one.C), pulses(A, gain(), C)) for one in models]))

    # Ten times the samples: a third of the error, within what two seeds scatter.
    assert error(15000) < 0.55 * error(1500)


def test_units_do_not_matter() -> None:
    record = flown(np.random.default_rng(5), 800, noise=0.05)
    other = TimeData(
        name="other units",
        inputs=record.inputs * np.array([[1e4], [1e-3]]),
        outputs=record.outputs * np.array([[1e-5], [1e3]]),
        sample_rate_hz=record.sample_rate_hz,
    )
    one, two = (fit_subspace([each], 4, method="cva") for each in (record, other))
    back = pulses(two.A, two.B, two.C) * np.array([1e4, 1e-3]) / np.array([[1e-5], [1e3]])
    np.testing.assert_allclose(back, pulses(one.A, one.B, one.C), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("hold", ["zero", "first"])
def test_the_way_back_from_samples_is_exact(hold: Hold) -> None:
    step = discretize(A_CONTINUOUS, B_CONTINUOUS, delays_s=np.zeros(2), step_s=STEP_S, hold=hold)
    start, end = step.taps[1].T, step.taps[2].T
    found = continuous_from_discrete(step.transition, start + step.transition @ end, step_s=STEP_S, hold=hold)
    np.testing.assert_allclose(found.A, A_CONTINUOUS, atol=1e-9)
    np.testing.assert_allclose(found.B, B_CONTINUOUS, atol=1e-9)
    assert found.replaced == 0


def test_a_mode_that_changes_sign_with_every_sample_is_replaced_and_counted() -> None:
    turn = np.linalg.qr(np.random.default_rng(0).standard_normal((3, 3)))[0]
    discrete = turn @ np.diag([0.9, -0.4, 0.0]) @ turn.T
    found = continuous_from_discrete(discrete, np.ones((3, 1)), step_s=STEP_S, hold="zero")
    assert found.replaced == 2
    poles = np.sort(np.linalg.eigvals(found.A).real)
    assert poles[-1] == pytest.approx(np.log(0.9) / STEP_S)
    assert poles[0] == pytest.approx(-np.pi / STEP_S)


def test_wrong_calls_are_refused() -> None:
    record = flown(np.random.default_rng(0), 300)
    with pytest.raises(UsageError, match="n4sid"):
        fit_subspace([record], 2, method="n4sid")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="order 0"):
        fit_subspace([record], 0)
    with pytest.raises(UsageError, match="no record"):
        fit_subspace([], 2)
    with pytest.raises(UsageError, match="horizon of 2"):
        fit_subspace([record], 4, horizon=2)
    with pytest.raises(InsufficientDataError):
        fit_subspace([flown(np.random.default_rng(0), 20)], 4)


def test_criteria_are_what_they_are_by_hand() -> None:
    residuals = np.random.default_rng(0).standard_normal((2, 50))
    found = information_criteria(residuals, 7)
    fit = 50.0 * np.log(np.linalg.det(residuals @ residuals.T / 50.0))
    assert found == pytest.approx((fit + 14.0, fit + 14.0 * 100.0 / 92.0, fit + 7.0 * np.log(50.0)))
    with pytest.raises(InsufficientDataError):
        information_criteria(np.zeros((1, 10)), 1)
    with pytest.raises(UsageError):
        information_criteria(np.full((1, 10), np.nan), 1)


def test_criteria_choose_the_order_that_made_white_residuals() -> None:
    """AR(2): the residuals of higher orders are smaller, and the criteria do not fall for it."""
    rng = np.random.default_rng(2)
    e = rng.standard_normal(4000)
    y = np.zeros(4000)
    for k in range(2, 4000):
        y[k] = 1.5 * y[k - 1] - 0.8 * y[k - 2] + e[k]
    scores = []
    for order in range(1, 9):
        past = np.column_stack([y[10 - lag : -lag] for lag in range(1, order + 1)])
        left = y[10:] - past @ np.linalg.lstsq(past, y[10:], rcond=None)[0]
        scores.append(information_criteria(left[None], order).bic)
    assert 1 + int(np.argmin(scores)) == 2
