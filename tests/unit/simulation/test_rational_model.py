"""Delays as states, lags or memory: the same response and the same motion as with them."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.models.state_space import StateSpace
from rotorid.simulation.linear import simulate_linear
from rotorid.simulation.rational_model import Delays, RationalModel, delay_error, pade, rational
from rotorid.typing import FloatArray

OMEGA = np.geomspace(0.1, 60.0, 40)


def system(*, inputs: tuple[float, float] = (0.011, 0.004), outputs: tuple[float, ...] = (0.003, 0.008)) -> StateSpace:
    """Two inputs, two outputs, three states, a direct path, four delays."""
    rng = np.random.default_rng(5)
    return StateSpace(
        M=np.diag([1.0, 0.05, 1.0]),
        F=np.array([[-1.0, 30.0, 0.0], [0.0, -1.0, 0.2], [0.5, 0.0, -2.0]]),
        G=rng.standard_normal((3, 2)),
        H0=rng.standard_normal((2, 3)),
        H1=0.02 * rng.standard_normal((2, 3)),
        input_delays_s=np.array(inputs),
        output_delays_s=np.array(outputs),
    )


def simulated(model: RationalModel, u: FloatArray) -> FloatArray:
    x, outputs = np.zeros(len(model.A)), []
    for column in u.T:
        outputs.append(model.C @ x + model.D @ column)
        x = model.A @ x + model.B @ column
    return np.array(outputs).T


@pytest.mark.parametrize("order", [1, 2, 3, 5, 8, 10])
def test_pade_has_magnitude_one_and_the_phase_of_the_delay(order: int) -> None:
    A, B, C, D = pade(0.02, order)
    model = RationalModel(A=A, B=B, C=C, D=D, states=())
    response = model.response(OMEGA)[0, 0]
    np.testing.assert_allclose(np.abs(response), 1.0, rtol=1e-9)
    # The first neglected term of the phase.
    x = 0.02 * OMEGA
    error = np.abs(response - np.exp(-1j * x))
    factorials = [np.prod(np.arange(1.0, n + 1)) for n in (order, 2 * order, 2 * order + 1)]
    assert np.all(error <= 2.0 * factorials[0] ** 2 / (factorials[1] * factorials[2]) * x ** (2 * order + 1) + 1e-9)


def test_states_hold_delays_within_the_error_that_is_told() -> None:
    model = rational(system(), pade_order=5, states=["a", "b", "c"])
    assert model.states[:3] == ("a", "b", "c")
    assert len(model.states) == 3 + 5 * 3
    assert delay_error(system(), model, OMEGA) < 1e-8
    assert 1e-5 < delay_error(system(), rational(system(), pade_order=1), OMEGA) < 0.05


def test_what_all_outputs_share_is_counted_once() -> None:
    late = system(inputs=(0.01, 0.01), outputs=(0.005, 0.005))
    assert len(rational(late, pade_order=3).states) == 3 + 6
    assert delay_error(late, rational(late, pade_order=6), OMEGA) < 1e-9


def test_lags_are_right_at_low_frequencies() -> None:
    slow, fast = np.array([0.1]), np.array([60.0])
    model = rational(system(), delays="lag")
    assert delay_error(system(), model, slow) < 1e-5
    assert 0.05 < delay_error(system(), model, fast) < 1.0


def test_left_out_means_the_system_alone() -> None:
    model = rational(system(), delays="none")
    exact = system(inputs=(0.0, 0.0), outputs=(0.0, 0.0)).response(OMEGA)
    np.testing.assert_allclose(model.response(OMEGA), exact, rtol=1e-9)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 400.0])
def test_sampled_with_memory_is_the_exact_simulation(rate_hz: float) -> None:
    u = np.random.default_rng(2).standard_normal((2, 120))
    model = rational(system(), sample_rate_hz=rate_hz)
    np.testing.assert_allclose(simulated(model, u), simulate_linear(system(), u, sample_rate_hz=rate_hz), atol=1e-9)
    assert model.sample_time_s == 1.0 / rate_hz


def test_whole_samples_of_delay_and_none() -> None:
    u = np.random.default_rng(2).standard_normal((2, 60))
    whole = system(inputs=(0.02, 0.0), outputs=(0.0, 0.0))
    model = rational(whole, sample_rate_hz=100.0)
    assert model.states[3:] == ("u1_before_1", "u1_before_2")
    np.testing.assert_allclose(simulated(model, u), simulate_linear(whole, u, sample_rate_hz=100.0), atol=1e-9)


@pytest.mark.parametrize("delays", ["lag", "none"])
def test_sampled_lags_are_those_of_a_held_input(delays: Delays) -> None:
    from scipy.signal import cont2discrete

    A, B, C, D = (getattr(rational(system(), delays=delays), name) for name in "ABCD")
    found = rational(system(), delays=delays, sample_rate_hz=100.0)
    expected = cont2discrete((A, B, C, D), 0.01)
    for name, matrix in zip("ABCD", expected, strict=False):
        np.testing.assert_allclose(getattr(found, name), matrix, atol=1e-12)


def test_a_negative_delay_counts_as_none() -> None:
    early = system(inputs=(-0.002, 0.0), outputs=(0.0, 0.0))
    assert delay_error(early, rational(early), OMEGA) < 1e-12


def test_an_algebraic_state_leaves_numbers_for_names() -> None:
    own = system()
    stiff = StateSpace(
        M=np.diag([1.0, 0.0, 1.0]),
        **{name: getattr(own, name) for name in ("F", "G", "H0")},
        H1=np.zeros((2, 3)),
        input_delays_s=own.input_delays_s,
        output_delays_s=own.output_delays_s,
    )
    model = rational(stiff, pade_order=6, states=["a", "b", "c"])
    assert model.states[:2] == ("x1", "x2")
    assert delay_error(stiff, model, OMEGA) < 1e-9


def test_orders_and_rates_have_their_range() -> None:
    with pytest.raises(UsageError, match="Padé order 0"):
        rational(system(), pade_order=0)
    with pytest.raises(UsageError, match="sample rate -1 Hz"):
        rational(system(), sample_rate_hz=-1.0)


def test_an_unknown_treatment_of_delays_is_refused() -> None:
    with pytest.raises(UsageError, match="unknown treatment of delays 'pade'; expected states, lag or none"):
        rational(system(), delays="pade")  # type: ignore[arg-type]
