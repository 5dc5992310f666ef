"""Output error: unknowns beside the parameters, several records, covariance of the errors, what cannot be fitted."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import InsufficientDataError, UsageError
from rotorid.fitting.least_squares import Outcome
from rotorid.fitting.time.output_error import InitialCondition, TimeData, TimeProblem, fit_output_error
from rotorid.models.toml import from_toml
from rotorid.simulation.linear import simulate_linear

OSCILLATOR = from_toml(
    """
    name = "oscillator"
    inputs = ["u"]
    states = ["x", "v"]
    equations = ["x' = v", "v' = -k*x - d*v + b*u"]
    outputs = ["x", "v"]
    [delays]
    u = "tau"
    [parameters]
    k = { value = 40.0, unit = "1" }
    d = { value = 5.0, unit = "1" }
    b = { value = 30.0, unit = "1" }
    tau = { value = 0.02, unit = "s", lower = 0.0 }
    """
)
TRUTH = {"k": 30.0, "d": 4.0, "b": 45.0, "tau": 0.0337}
RATE_HZ = 100.0


def flown(
    seed: int, *, samples: int = 600, noise: float = 0.0, start: tuple[float, float] = (0.0, 0.0), shift: float = 0.0
) -> TimeData:
    rng = np.random.default_rng(seed)
    u = np.sign(np.repeat(rng.standard_normal((1, samples // 20)), 20, axis=1))
    y = simulate_linear(OSCILLATOR.matrices(TRUTH), u, sample_rate_hz=RATE_HZ, x0=np.array(start), before=u[:, 0])
    y = y + shift + noise * rng.standard_normal(y.shape)
    return TimeData(name=f"flight {seed}", inputs=u, outputs=y, sample_rate_hz=RATE_HZ)


def problem(
    *records: TimeData, unknowns: tuple[InitialCondition, ...] = ("initial_state", "output_shift")
) -> TimeProblem:
    return TimeProblem(
        structure=OSCILLATOR, parameters=OSCILLATOR.parameters, records=records, hold="zero", unknowns=unknowns
    )


def test_without_noise_the_truth_comes_back_from_two_records_with_unknown_starts_and_shifts() -> None:
    records = flown(0, start=(0.4, -2.0), shift=0.3), flown(1, start=(-1.0, 3.0), shift=-0.2)
    fit = fit_output_error(problem(*records))
    assert fit.solution.outcome is Outcome.CONVERGED
    assert fit.parameters.values == pytest.approx(TRUTH, rel=1e-6)
    for measured, predicted in fit.problem.predicted(fit.solution.theta):
        assert np.allclose(measured.outputs, predicted, rtol=0.0, atol=1e-5)


def test_an_unknown_start_that_is_not_estimated_ends_elsewhere() -> None:
    fit = fit_output_error(problem(flown(0, start=(0.4, -2.0)), unknowns=()))
    assert fit.parameters["d"].value != pytest.approx(TRUTH["d"], rel=1e-3)


def test_the_jacobian_is_that_of_differences_beside_the_unknowns() -> None:
    # At a minimum without noise the term that variable projection leaves out is zero.
    one = problem(flown(0, start=(0.4, -2.0), shift=0.3))
    theta = np.array(list(TRUTH.values()))
    _, jacobian = one.residuals(theta)
    for slot, step in enumerate(1e-6 * theta):
        move = step * np.eye(len(theta))[slot]
        slope = (one.residuals(theta + move)[0] - one.residuals(theta - move)[0]) / (2.0 * step)
        assert np.allclose(jacobian[:, slot], slope, rtol=0.0, atol=1e-5 * np.abs(slope).max())


def test_the_covariance_of_the_errors_is_found() -> None:
    rng = np.random.default_rng(5)
    record = flown(2, samples=4000)
    root = np.array([[0.05, 0.0], [0.03, 0.2]])
    outputs = record.outputs + root @ rng.standard_normal(record.outputs.shape)
    noisy = TimeData(name="noisy", inputs=record.inputs, outputs=outputs, sample_rate_hz=RATE_HZ)
    fit = fit_output_error(problem(noisy))
    # Four standard deviations of a variance over 4000 samples.
    assert np.allclose(fit.noise, root @ root.T, rtol=4.0 * np.sqrt(2.0 / 4000.0), atol=0.0)
    alone = fit_output_error(problem(noisy), correlated=False)
    assert alone.noise[0, 1] == 0.0
    assert alone.log_likelihood < fit.log_likelihood


def test_pieces_of_a_record_know_the_inputs_before_them() -> None:
    record = flown(3, start=(0.4, -2.0))
    pieces = record.pieces(1.5)
    assert sum(piece.samples for piece in pieces) == record.samples
    assert pieces[1].before[0, -1] == record.inputs[0, pieces[0].samples - 1]
    fit = fit_output_error(problem(*pieces))
    # With what is still on its way through a delay of three samples and a half.
    assert fit.parameters.values == pytest.approx(TRUTH, rel=1e-6)


def test_a_diverging_start_is_turned_back_and_others_count() -> None:
    one = problem(flown(0))
    wild, near = np.array([-5e5, -50.0, 1.0, 0.0]), one.parameters.pack()
    fit = fit_output_error(one, starts=[wild, near])
    assert fit.parameters.values == pytest.approx(TRUTH, rel=1e-4)
    with pytest.raises(InsufficientDataError, match="no response"):
        fit_output_error(one, starts=[wild])


def test_records_must_be_those_of_the_structure() -> None:
    record = flown(0)
    other = TimeData(name="other", inputs=record.inputs, outputs=record.outputs[:1], sample_rate_hz=RATE_HZ)
    with pytest.raises(UsageError, match="1 inputs and 1 outputs"):
        problem(other)
    with pytest.raises(UsageError, match="no record"):
        problem()
    with pytest.raises(UsageError, match="unknown"):
        problem(record, unknowns=("drag",))  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="not finite"):
        TimeData(name="gap", inputs=record.inputs, outputs=record.outputs * np.nan, sample_rate_hz=RATE_HZ)
    with pytest.raises(UsageError, match="samples"):
        TimeData(name="short", inputs=record.inputs, outputs=record.outputs[:, 1:], sample_rate_hz=RATE_HZ)
    with pytest.raises(InsufficientDataError, match="pieces"):
        record.pieces(1e-3)


def test_several_starts_are_tried_on_a_part_of_long_records(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rotorid.fitting.time.output_error._SCOUTED", 300)
    one = problem(flown(0), flown(1))
    assert [record.samples for record in one.shortened(300).records] == [150, 150]
    starts = [one.parameters.pack(), np.array([10.0, 1.0, 10.0, 0.0])]
    fit = fit_output_error(one, starts=starts)
    assert fit.parameters.values == pytest.approx(TRUTH, rel=1e-6)
    assert fit.solution.residual.size == 2 * one.samples


def test_pieces_too_short_for_their_unknowns_are_refused() -> None:
    with pytest.raises(InsufficientDataError, match="too few for"):
        fit_output_error(problem(*flown(0).pieces(0.02)))


def test_too_few_samples_are_refused() -> None:
    record = flown(0)
    short = TimeData(name="short", inputs=record.inputs[:, :2], outputs=record.outputs[:, :2], sample_rate_hz=RATE_HZ)
    with pytest.raises(InsufficientDataError, match="4 samples"):
        fit_output_error(problem(short))


def test_a_model_without_free_parameters_is_simulated() -> None:
    parameters = OSCILLATOR.parameters
    for name, value in TRUTH.items():
        parameters = parameters.fix(name, value)
    one = TimeProblem(structure=OSCILLATOR, parameters=parameters, records=(flown(0, shift=0.3),))
    fit = fit_output_error(one)
    assert fit.solution.jacobian.shape == (1200, 0)
    assert np.abs(fit.solution.residual).max() < 1e-3
