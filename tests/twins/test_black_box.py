"""Black boxes fitted to flights of known systems: the system comes back, its delays and its order too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.fitting.black_box.fit import BlackBoxFit, StartPlan, fit_black_box, fit_black_box_pairs
from rotorid.fitting.time.output_error import TimeData
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import FloatArray

RATE_HZ = 50.0
OMEGA = np.geomspace(0.5, 20.0, 30)
FEW = StartPlan(methods=("cva",), drawn=0)
A = np.array([[0.0, 1.0, 0.0, 0.0], [-9.0, -2.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [2.0, 0.0, -36.0, -5.0]])
B = np.array([[0.0, 0.5], [9.0, 0.0], [0.0, 0.0], [3.0, 36.0]])
C = np.array([[1.0, 0.0, 0.2, 0.0], [0.0, 0.1, 1.0, 0.0]])


def system(delays_s: FloatArray, *, rows: int = 2) -> StateSpace:
    return StateSpace(
        M=np.eye(4),
        F=A,
        G=B[:, : delays_s.size],
        H0=C[:rows],
        H1=np.zeros((rows, 4)),
        input_delays_s=delays_s,
        output_delays_s=np.zeros(rows),
    )


def flown(of: StateSpace, seed: int, *, noise: float, samples: int = 1500) -> TimeData:
    rng = np.random.default_rng(seed)
    count = of.G.shape[1]
    u = np.repeat(rng.choice([-1.0, 1.0], size=(count, samples // 8 + 1)), 8, axis=1)[:, :samples]
    y = simulate_linear(of, u, sample_rate_hz=RATE_HZ, x0=0.3 * rng.standard_normal(4), before=u[:, 0])
    shift = rng.standard_normal((len(y), 1))
    return TimeData(
        name=f"flight {seed}",
        inputs=u,
        outputs=y + shift + noise * rng.standard_normal(y.shape),
        sample_rate_hz=RATE_HZ,
    )


def error_db(found: BlackBoxFit, of: StateSpace) -> float:
    """Largest relative error of the response, over the largest of each pair, in dB."""
    response = found.structure.response(found.parameters.values, OMEGA)
    truth = of.response(OMEGA)
    off = np.abs(response - truth) / np.abs(truth).max(axis=-1, keepdims=True)
    return float(20.0 * np.log10(1.0 + off.max()))


def test_four_states_two_inputs_two_outputs_two_records_to_rounding() -> None:
    truth = system(np.zeros(2))
    records = [flown(truth, seed, noise=0.0, samples=600) for seed in range(2)]
    found = fit_black_box(records, 4, inputs=["a", "b"], outputs=["y", "z"], plan=FEW)
    assert error_db(found, truth) < 1e-6
    # 36 numbers in A, B and C, of which the data can tell 16.
    assert len(found.parameters.free) == 16
    assert found.findings == ()


def test_noisy_error_is_that_of_the_bound() -> None:
    """Scatter over seeds, in units of the standard deviations that white noise predicts, is one."""
    truth = system(np.zeros(2))
    normalized = []
    for seed in range(6):
        record = flown(truth, seed, noise=0.05)
        found = fit_black_box([record], 4, inputs=["a", "b"], outputs=["y", "z"], plan=FEW)
        jacobian = found.fit.solution.jacobian
        covariance = np.linalg.inv(jacobian.T @ jacobian)
        response, slopes = found.structure.response_and_jacobian(
            found.parameters.values, OMEGA[::6], found.parameters.directions
        )
        off = (response - truth.response(OMEGA[::6])).real.ravel()
        moves = slopes.real.reshape(len(slopes), -1)
        normalized.append(off / np.sqrt(np.einsum("ij,ik,kj->j", moves, covariance, moves)))
    # 6 seeds of about 16 independent numbers: the variance scatters by sqrt(2 / 96) = 0.14.
    assert np.mean(np.square(normalized)) == pytest.approx(1.0, abs=4.0 * 0.15)


def test_delays_come_back_as_fractions_of_a_sample() -> None:
    truth = system(np.array([0.033]), rows=1)
    record = flown(truth, 1, noise=0.01)
    found = fit_black_box([record], 4, inputs=["a"], outputs=["y"], delays=True, plan=FEW)
    jacobian = found.fit.solution.jacobian
    slot = found.parameters.free.index("tau")
    deviation = float(np.sqrt(np.linalg.inv(jacobian.T @ jacobian)[slot, slot]))
    assert found.parameters["tau"].value == pytest.approx(0.033, abs=4.0 * deviation)
    assert deviation < 0.25 / RATE_HZ


def test_pairs_are_found_side_by_side() -> None:
    one, two = (
        StateSpace(
            M=np.eye(2),
            F=np.array([[0.0, 1.0], [-(rate**2), -rate]]),
            G=np.array([[0.0], [rate**2]]),
            H0=np.array([[1.0, 0.0]]),
            H1=np.zeros((1, 2)),
            input_delays_s=np.zeros(1),
            output_delays_s=np.zeros(1),
        )
        for rate in (4.0, 9.0)
    )
    rng = np.random.default_rng(0)
    u = np.repeat(rng.choice([-1.0, 1.0], size=(2, 100)), 8, axis=1)
    y = np.vstack([simulate_linear(each, u[[k]], sample_rate_hz=RATE_HZ) for k, each in enumerate((one, two))])
    record = TimeData(name="pairs", inputs=u, outputs=y + 1e-3 * rng.standard_normal(y.shape), sample_rate_hz=RATE_HZ)
    found = fit_black_box_pairs([record], 2, pairs=[("a", "y"), ("b", "z")], plan=FEW, unknowns=("initial_state",))
    values = found.parameters.values
    # A noise of a thousandth moves a frequency by some 1e-3 / sqrt(800) of itself, times a few.
    assert values["a0_1_y"] == pytest.approx(16.0, rel=5e-4)
    assert values["a0_1_z"] == pytest.approx(81.0, rel=5e-4)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda record: fit_black_box([], 2, inputs=["a"], outputs=["y"]),
        lambda record: fit_black_box([record], 2, inputs=["a", "b"], outputs=["y"]),
        lambda record: fit_black_box_pairs([record], 2, pairs=[("a", "y"), ("b", "z")]),
    ],
)
def test_records_must_suit_the_names(wrong: Callable[[TimeData], BlackBoxFit]) -> None:
    record = flown(system(np.zeros(1), rows=1), 0, noise=0.1, samples=100)
    with pytest.raises(UsageError):
        wrong(record)
