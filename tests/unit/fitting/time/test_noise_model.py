"""The pieces of a prediction-error fit: Riccati equation, noise model, exact gradient, refusals."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from rotorid.errors import ModelError, UsageError
from rotorid.fitting.time.noise_model import NoiseModel, gain_slopes, lyapunov, steady_predictor
from rotorid.fitting.time.output_error import TimeData
from rotorid.fitting.time.prediction_error import InnovationsProblem
from rotorid.models.library import library_model
from rotorid.vehicles import s500


@cache
def problem() -> InnovationsProblem:
    """Two short records of a lateral vehicle, whose outputs are noise: a gradient is far from zero there."""
    outputs = ("p", "r", "v", "phi", "ay")
    whole = library_model("hover.lateral").select(outputs=outputs)
    parameters = whole.parameters
    for name in parameters.names:
        parameters = parameters if s500.LATERAL.get(name) else parameters.drop(name)
    structure = whole.condensed(parameters)
    truth = {name: s500.LATERAL[name] for name in structure.parameters.free}
    rng = np.random.default_rng(0)
    records = tuple(
        TimeData(
            name=str(samples),
            inputs=0.1 * rng.standard_normal((2, samples)),
            outputs=0.1 * np.cumsum(rng.standard_normal((5, samples)), axis=1) + 0.3,
            sample_rate_hz=200.0,
        )
        for samples in (300, 400)
    )
    return InnovationsProblem(structure=structure, parameters=structure.parameters.with_values(truth), records=records)


def unstable(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    transition = np.linalg.qr(rng.standard_normal((5, 5)))[0] @ np.diag([1.05, 1.0, 0.99, 0.9, 0.2])
    root = rng.standard_normal((5, 5))
    return transition, rng.standard_normal((3, 5)), root @ root.T, np.array([0.5, 1.0, 2.0])


def test_riccati_is_that_of_scipy() -> None:
    transition, measured, process, sensor = unstable(np.random.default_rng(0))
    found = steady_predictor(transition, measured, process, sensor)
    expected = solve_discrete_are(transition.T, measured.T, process, np.diag(sensor))
    np.testing.assert_allclose(found.error, expected, rtol=1e-9, atol=1e-9)
    assert np.abs(np.linalg.eigvals(found.closed)).max() < 1.0


def test_slopes_of_the_gain_are_those_of_differences() -> None:
    rng = np.random.default_rng(1)
    transition, measured, process, sensor = unstable(rng)
    moves = rng.standard_normal((4, 5, 5))
    slopes = {
        "dtransition": 0.1 * rng.standard_normal((4, 5, 5)),
        "dmeasured": 0.1 * rng.standard_normal((4, 3, 5)),
        "dprocess": moves + moves.swapaxes(1, 2),
        "dsensor": rng.standard_normal((4, 3)),
    }
    given = (transition, measured, process, sensor)
    exact = gain_slopes(steady_predictor(*given), transition, measured, **slopes)
    for k in range(4):
        high, low = (
            steady_predictor(*(one + sign * 1e-6 * move[k] for one, move in zip(given, slopes.values(), strict=True)))
            for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(exact[k], (high.gain - low.gain) / 2e-6, atol=1e-7)


def test_lyapunov_solves_its_equation() -> None:
    rng = np.random.default_rng(2)
    closed = np.linalg.qr(rng.standard_normal((4, 4)))[0] * 0.97
    forcing = rng.standard_normal((3, 4, 4))
    found = lyapunov(closed, forcing)
    np.testing.assert_allclose(found, closed @ found @ closed.T + forcing, atol=1e-11)


def test_a_motion_that_nothing_shows_has_no_predictor() -> None:
    with pytest.raises(ModelError, match="no stable predictor"):
        steady_predictor(np.diag([1.1, 0.5]), np.array([[0.0, 1.0]]), np.eye(2), np.ones(1))


def test_noise_slopes_are_those_of_differences() -> None:
    noise = problem().noise_model
    theta = noise.start + 0.3 * np.random.default_rng(0).standard_normal(noise.start.size)
    levels = noise.at(theta)
    for k, one in enumerate(1e-6 * np.eye(theta.size)):
        high, low = noise.at(theta + one), noise.at(theta - one)
        for name in ("gusts", "jolts", "sensors", "correlation_s"):
            central = (np.asarray(getattr(high, name)) - np.asarray(getattr(low, name))) / 2e-6
            np.testing.assert_allclose(getattr(levels, f"d{name}")[k], central, rtol=1e-7, atol=1e-9)


def test_noise_acts_where_there_are_forces() -> None:
    noise = problem().noise_model
    assert [problem().structure.states[row] for row in noise.disturbed] == ["p", "r", "v"]
    assert len(noise.names) == noise.start.size
    assert noise.names[0] == "gust_correlation"
    # White sensors: fourth differences of a random walk are not, so only the order of size is asked for.
    assert (noise.at(noise.theta(jolts=2.0)).jolts == 4.0 * noise.at(noise.start).jolts).all()


def test_only_ratios_of_the_sensors_are_parameters() -> None:
    noise = problem().noise_model
    one, other = (noise.theta(sensors=[factor] * 5) for factor in (1.0, 10.0))
    np.testing.assert_allclose(one, other, atol=1e-12)
    ratios = noise.at(noise.theta(sensors=[4.0, 1.0, 1.0, 1.0, 1.0])).sensors / noise.at(noise.start).sensors
    np.testing.assert_allclose(ratios[0] / ratios[1], 16.0)
    np.testing.assert_allclose(np.prod(ratios), 1.0)


def test_gradient_is_that_of_the_likelihood() -> None:
    posed = problem()
    theta = posed.start + 0.01 * np.random.default_rng(0).standard_normal(posed.start.size)
    residual, jacobian = posed.residuals(theta)
    assert float(residual @ residual) == pytest.approx(posed.cost(theta), rel=1e-10)
    gradient = jacobian.T @ residual
    for k, scale in enumerate(np.maximum(np.abs(theta), 1e-2)):
        step = np.zeros(theta.size)
        step[k] = 1e-5 * scale
        central = (posed.cost(theta + step) - posed.cost(theta - step)) / (4.0 * step[k])
        # A difference of costs of 2e5 over a step of 1e-5 rounds at 1e-6; against the longest that a gradient can be.
        assert abs(gradient[k] - central) < 1e-6 * np.linalg.norm(jacobian[:, k]) * np.linalg.norm(residual)


def test_condensed_residuals_have_the_products_of_all() -> None:
    posed = problem()
    residual, jacobian = posed.residuals(posed.start)
    parts = posed.parts(posed.start)
    slopes = np.concatenate([part.slopes.reshape(-1, posed.start.size) for part in parts])
    whole = np.concatenate([part.residual.ravel() for part in parts])
    size = float(residual @ residual) / float(whole @ whole)
    np.testing.assert_allclose(jacobian.T @ residual, size * slopes.T @ whole, rtol=1e-6, atol=1e-6)
    products = jacobian.T @ jacobian
    lengths = np.sqrt(np.outer(products.diagonal(), products.diagonal()))
    np.testing.assert_allclose(products / lengths, size * slopes.T @ slopes / lengths, atol=1e-8)


def test_a_late_output_is_refused() -> None:
    posed = problem()
    late = replace(posed.structure, output_delays=tuple(posed.structure.input_delays[:1]) * 5)
    with pytest.raises(UsageError, match="a delay at an output"):
        replace(posed, structure=late).residuals(posed.start)


def test_wrong_calls_say_what_was_needed() -> None:
    posed = problem()
    with pytest.raises(UsageError, match="at least one"):
        replace(posed, records=())
    with pytest.raises(UsageError, match="2 inputs and 4 outputs"):
        replace(posed, records=(replace(posed.records[0], outputs=posed.records[0].outputs[:4]),))
    with pytest.raises(UsageError, match="wind"):
        replace(posed, unknowns=("wind",))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="output-error fit"):
        NoiseModel(disturbed=(0,), forces=np.ones(1), sensors=np.ones(2), gusts=False, jolts=False)
