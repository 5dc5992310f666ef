"""Linear systems as numbers: response, elimination of algebraic states, poles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import freqresp

from rotorid.errors import ModelError
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.models.state_space import StateSpace
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(0.1, 200.0, 60)


def random_system(states: int = 4, inputs: int = 2, outputs: int = 3, *, delays: bool = True) -> StateSpace:
    rng = np.random.default_rng(5)
    draw = rng.standard_normal
    return StateSpace(
        M=np.eye(states) + 0.2 * draw((states, states)),
        F=draw((states, states)) - 3.0 * np.eye(states),
        G=draw((states, inputs)),
        H0=draw((outputs, states)),
        H1=draw((outputs, states)),
        input_delays_s=rng.uniform(0.0, 0.1, inputs) * delays,
        output_delays_s=rng.uniform(0.0, 0.1, outputs) * delays,
    )


def proper_response(matrices: tuple[FloatArray, ...], omega: FloatArray) -> ComplexArray:
    A, B, C, D = matrices
    eye = np.eye(len(A))
    return np.stack([C @ np.linalg.solve(1j * w * eye - A, B) + D for w in omega], axis=-1)


def test_response_against_scipy() -> None:
    system = random_system()
    A, B, C, D = system.proper()
    ours = system.response(OMEGA)
    for i in range(B.shape[1]):
        _, single = freqresp((A, B[:, [i]], C[[0]], D[[0]][:, [i]]), OMEGA)
        late = np.exp(-1j * OMEGA * (system.input_delays_s[i] + system.output_delays_s[0]))
        # scipy goes through a transfer function of order four, whose coefficients round.
        np.testing.assert_allclose(ours[0, i], single * late, rtol=1e-9)


@pytest.mark.parametrize("name", RATE_AXES)
def test_response_of_rate_models_is_the_formula_on_paper(name: str) -> None:
    axis = RATE_AXES[name]
    K, a, T, tau, lead = -35.0, -2.5, 0.04, 0.013, 2.0 if name == "rate.yaw" else 0.0
    values = {axis.gain: K, axis.damping: a, "T_motor": T, axis.delay: tau, "N_spin": lead}
    response = rate_model(name).response(values, OMEGA)
    s = 1j * OMEGA
    expected = (K + lead * s) / ((s - a) * (T * s + 1.0)) * np.exp(-s * tau)
    np.testing.assert_allclose(response[0, 0], expected * s if name == "rate.vertical" else expected, rtol=1e-12)


def test_proper_form_has_the_same_response() -> None:
    system = random_system(delays=False)
    np.testing.assert_allclose(proper_response(system.proper(), OMEGA), system.response(OMEGA), rtol=1e-10)


@pytest.mark.parametrize("name", RATE_AXES)
def test_a_lag_of_zero_is_the_limit_of_a_small_one(name: str) -> None:
    axis = RATE_AXES[name]
    values = {axis.gain: 80.0, axis.damping: -2.0, axis.delay: 0.0, "N_spin": 0.0}
    structure = rate_model(name)
    without = structure.matrices({**values, "T_motor": 0.0})
    for lag in (1e-5, 1e-7):
        # A lag T turns the response by 1/(1 + j omega T): by no more than omega T.
        small = structure.matrices({**values, "T_motor": lag})
        ratio = proper_response(small.proper(), OMEGA) / proper_response(without.proper(), OMEGA)
        assert np.all(np.abs(ratio - 1.0) <= 1.001 * OMEGA * lag + 1e-9)
    np.testing.assert_allclose(without.response(OMEGA), proper_response(without.proper(), OMEGA), rtol=1e-12)


def test_algebraic_states_are_eliminated_in_any_coordinates() -> None:
    """Mixed equations and states: the null space of M lies askew, and rounding must not look like a derivative."""
    rng = np.random.default_rng(6)
    mix, turn = (np.linalg.qr(rng.standard_normal((4, 4)))[0] for _ in range(2))
    plain = replace(random_system(delays=False), M=np.diag([1.0, 2.0, 3.0, 0.0]))
    plain = replace(plain, H1=plain.H1 @ np.diag([1.0, 1.0, 1.0, 0.0]))
    skew = replace(
        plain,
        M=mix @ plain.M @ turn,
        F=mix @ plain.F @ turn,
        G=mix @ plain.G,
        H0=plain.H0 @ turn,
        H1=plain.H1 @ turn,
    )
    np.testing.assert_allclose(proper_response(skew.proper(), OMEGA), plain.response(OMEGA), rtol=1e-9)
    np.testing.assert_allclose(np.sort_complex(skew.poles()), np.sort_complex(plain.poles()), rtol=1e-9)
    assert skew.poles().size == 3


def test_poles_come_slowest_first() -> None:
    one = np.eye(3)
    system = StateSpace(
        M=one,
        F=np.array([[-30.0, 0.0, 0.0], [0.0, -1.0, 2.0], [0.0, -2.0, -1.0]]),
        G=one[:, :1],
        H0=one[:1],
        H1=0.0 * one[:1],
        input_delays_s=np.zeros(1),
        output_delays_s=np.zeros(1),
    )
    np.testing.assert_allclose(system.poles(), [-1.0 - 2.0j, -1.0 + 2.0j, -30.0], rtol=1e-12)


def test_algebraic_rows_that_say_nothing_are_refused() -> None:
    one = np.eye(2)
    system = StateSpace(
        M=np.diag([1.0, 0.0]),
        F=np.array([[-1.0, 1.0], [1.0, 0.0]]),
        G=one[:, :1],
        H0=one,
        H1=0.0 * one,
        input_delays_s=np.zeros(1),
        output_delays_s=np.zeros(2),
    )
    with pytest.raises(ModelError, match="do not determine their states"):
        system.proper()


def test_the_derivative_of_a_state_that_jumps_is_refused() -> None:
    structure = rate_model("rate.roll")
    system = structure.matrices({"L_roll": 80.0, "L_p": -2.0, "T_motor": 0.0, "tau_roll": 0.0})
    with pytest.raises(ModelError, match="derivative of a state that follows the input at once"):
        replace(system, H1=np.array([[0.0, 1.0]])).proper()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"M": np.eye(3)}, r"matrix M has shape \(3, 3\); expected shape \(4, 4\)"),
        ({"H1": np.zeros((2, 4))}, "matrix H1"),
        ({"G": np.zeros((3, 2))}, "matrix G"),
        ({"input_delays_s": np.zeros(3)}, "2 and 3 delays"),
    ],
)
def test_shapes_that_do_not_fit_are_refused(change: dict[str, FloatArray], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        replace(random_system(), **change)
