"""What the prediction-error fit promises: the S500 out of its closed-loop sweeps, unstable as it is."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.reference.s500_records import record_of

import rotorid
from rotorid.fitting.least_squares import Outcome
from rotorid.fitting.time.output_error import TimeData, TimeProblem, fit_output_error
from rotorid.fitting.time.prediction_error import InnovationsProblem, PredictionErrorFit, fit_prediction_error
from rotorid.models.library import library_model
from rotorid.models.parameter import ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.typing import FloatArray
from rotorid.uncertainty.colored import colored_covariance

WITHIN, WEAK_WITHIN, WEAK = 0.015, 0.04, ("X_q", "Y_p")
DELAY_WITHIN_S = 0.5e-3
MOTIONS = {
    "longitudinal": (("pitch_sweeps", "thrust_sweeps"), ("q", "u", "w", "theta", "ax", "az")),
    "lateral": (("roll_sweeps", "yaw_sweeps"), ("p", "r", "v", "phi", "ay")),
}


class Flight(NamedTuple):
    """Sweeps of one motion, its model at the library's own start, and the truth."""

    structure: LinearStructure
    start: ParameterSet
    records: tuple[TimeData, ...]
    truth: Mapping[str, float]

    @property
    def problem(self) -> InnovationsProblem:
        return InnovationsProblem(structure=self.structure, parameters=self.start, records=self.records)

    def errors(self, values: Mapping[str, float]) -> FloatArray:
        return np.array([values[name] - self.truth[name] for name in self.start.free])


@pytest.fixture(scope="module", params=[pytest.param("longitudinal", marks=pytest.mark.slow), "lateral"])
def flight(request: pytest.FixtureRequest, shared_data: Path) -> Flight:
    folder = shared_data / "s500"
    files, outputs = MOTIONS[request.param]
    truth = json.loads((folder / "truth.json").read_text())[request.param]
    whole = library_model(f"hover.{request.param}").select(outputs=outputs)
    parameters = whole.parameters
    for name in parameters.names:
        # What the simulator has not, and the library's lag.
        parameters = parameters if name in truth else parameters.drop(name)
    structure = whole.condensed(parameters)
    records = tuple(record_of(folder / f"{name}.csv", structure.inputs, outputs) for name in files)
    return Flight(structure, structure.parameters, records, truth)


@pytest.fixture(scope="module")
def found(flight: Flight) -> PredictionErrorFit:
    return fit_prediction_error(flight.problem)


def test_every_derivative_is_that_of_the_simulator(flight: Flight, found: PredictionErrorFit) -> None:
    values = found.parameters.values
    off = {n: abs(values[n] / t - 1.0) for n, t in flight.truth.items() if not n.startswith("tau_")}
    assert {n: e for n, e in off.items() if e > (WEAK_WITHIN if n in WEAK else WITHIN)} == {}


def test_delays_are_those_of_the_simulator(flight: Flight, found: PredictionErrorFit) -> None:
    # The thrust acts on az 0.5 ms earlier than on w, and az tells most of its delay.
    values = found.parameters.values
    off = {n: abs(values[n] - t) for n, t in flight.truth.items() if n.startswith("tau_")}
    assert len(off) == 2
    assert max(off.values()) < DELAY_WITHIN_S


def test_the_predictor_is_stable_and_its_innovations_white(flight: Flight, found: PredictionErrorFit) -> None:
    assert found.solution.outcome is Outcome.CONVERGED
    system = flight.structure.matrices(found.parameters.values)
    assert system.poles().real.max() > 1.0
    assert np.abs(found.predictor_poles).max() < 1.0
    # Of white noise 0.05 of the lags lie beyond their limits.
    assert max(one.outside for one in found.whiteness.values()) < 0.2
    assert max(one.largest for one in found.whiteness.values()) < 0.03


@pytest.mark.slow
def test_deviations_are_those_of_fishers_bound(flight: Flight, found: PredictionErrorFit) -> None:
    count = len(flight.start.free)
    corrected = colored_covariance(found.problem.parts(found.solution.theta)).corrected[:count, :count]
    bound = np.array(list(found.std.values()))
    ratio = np.sqrt(np.diag(corrected)) / bound
    assert ratio.max() < 2.0
    assert ratio.min() > 0.5


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_a_wrong_start_of_the_noise_changes_nothing(flight: Flight, found: PredictionErrorFit, factor: float) -> None:
    problem = flight.problem
    wrong = problem.noise_model.theta(
        correlation_s=factor,
        gusts=factor,
        jolts=factor,
        sensors=[factor, *[1.0] * (len(flight.structure.outputs) - 1)],
    )
    other = fit_prediction_error(problem, starts=[problem.theta(wrong)])
    moved = (other.parameters.pack() - found.parameters.pack()) / np.array(list(found.std.values()))
    assert np.abs(moved).max() < 0.1


def test_the_unstable_model_never_diverges_however_wrong_it_is(flight: Flight) -> None:
    problem, rng = flight.problem, np.random.default_rng(0)
    for _ in range(5):
        theta = problem.start * (1.0 + 0.5 * rng.standard_normal(problem.start.size))
        cost = problem.cost(np.clip(theta, *problem.box))
        assert np.isfinite(cost)


def test_output_error_is_further_from_the_truth_than_it_says(flight: Flight, found: PredictionErrorFit) -> None:
    # Pieces of 2 s, in which what grows of an error stays small; from the truth, so that only the bias is left.
    records = tuple(piece for record in flight.records for piece in record.pieces(2.0))
    start = flight.start.with_values(flight.truth)
    simulated = fit_output_error(
        TimeProblem(structure=flight.structure, parameters=start, records=records, hold="first")
    )
    J = simulated.solution.jacobian
    stated = np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
    scaled = np.abs(flight.errors(simulated.parameters.values) / stated)
    # Weak derivatives and delays aside: they are off by the simulator's own half step, whoever looks.
    fair = np.array([name not in WEAK and not name.startswith("tau_") for name in flight.start.free])
    predicted = np.abs(flight.errors(found.parameters.values) / np.array(list(found.std.values())))
    assert predicted[fair].max() < 4.0
    assert np.sqrt(np.mean(scaled[fair] ** 2)) > 1.5 * np.sqrt(np.mean(predicted[fair] ** 2))


def test_a_loop_logged_at_half_its_rate_is_right_within_what_is_stated(shared_data: Path) -> None:
    """What was logged and what the controller saw differ; the gain comes out 2 % high, and the interval says so."""
    record = rotorid.read(shared_data / "ardupilot_sitl" / "x_calm_roll.BIN")
    found = rotorid.identify(record, "rate.roll", method="prediction_error")["L_roll"]
    assert found.std is not None
    assert found.std_random is not None
    assert found.lower is not None
    assert found.upper is not None
    assert found.std > found.std_random
    assert found.lower < 437.2 < found.upper
    assert found.std < 0.03 * found.value
