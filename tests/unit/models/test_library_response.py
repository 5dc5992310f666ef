"""Responses to set-points: the equations on paper, side by side and apart."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.library import RESPONSE_MODELS, response_model, response_pairs
from rotorid.models.toml import from_toml, to_toml
from rotorid.typing import ComplexArray

OMEGA = np.geomspace(0.1, 60.0, 40)
PAIRS = [("phi_setpoint", "phi"), ("velocity_down_setpoint", "velocity_down"), ("r_setpoint", "r")]


def drawn(name: str, seed: int = 0) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    return {parameter: rng.uniform(0.05, 2.0) for parameter in response_model(name, PAIRS).parameters.names}


def on_paper(values: dict[str, float], y: str) -> ComplexArray:
    s = 1j * OMEGA
    late = values[f"K_{y}"] * np.exp(-s * values.get(f"tau_{y}", 0.0))
    if f"T_{y}" in values:
        return np.asarray(late / (1.0 + values[f"T_{y}"] * s))
    omega, zeta = values[f"omega_{y}"], values[f"zeta_{y}"]
    zero = 1.0 + values.get(f"T_zero_{y}", 0.0) * s
    return np.asarray(late * omega**2 * zero / (s**2 + 2.0 * zeta * omega * s + omega**2))


@pytest.mark.parametrize("name", RESPONSE_MODELS)
def test_each_response_is_the_equation_and_no_other(name: str) -> None:
    values = drawn(name)
    response = response_model(name, PAIRS).response(values, OMEGA)
    for row, (_, y) in enumerate(PAIRS):
        np.testing.assert_allclose(response[row, row], on_paper(values, y), rtol=1e-11)
        assert not np.delete(response[row], row, axis=0).any()


@pytest.mark.parametrize("name", RESPONSE_MODELS)
def test_start_values_are_damped_and_stable(name: str) -> None:
    model = response_model(name, PAIRS)
    assert (model.matrices(model.parameters.values).poles().real < 0.0).all()


@pytest.mark.parametrize("name", RESPONSE_MODELS)
def test_a_model_is_written_and_read(name: str) -> None:
    model = response_model(name, PAIRS)
    again = from_toml(to_toml(model, model.parameters, {}))
    values = drawn(name)
    np.testing.assert_array_equal(again.response(values, OMEGA), model.response(values, OMEGA))


def test_a_single_pair_keeps_its_suffixes_and_has_a_gain() -> None:
    one = response_model("response.second_order_zero_delay", PAIRS[:1])
    assert one.parameters.names == ("K_phi", "omega_phi", "zeta_phi", "T_zero_phi", "tau_phi")
    assert one.gain == "K_phi"
    assert response_model("response.first_order", PAIRS).gain is None


def test_damping_above_one_is_two_lags() -> None:
    model = response_model("response.second_order", PAIRS[:1])
    assert model.matrices({"K_phi": 1.0, "omega_phi": 4.0, "zeta_phi": 1.25}).poles().tolist() == [-2.0, -8.0]


def test_units_follow_the_channels() -> None:
    pairs = [("thrust_command", "velocity_down"), ("phi_setpoint", "phi"), ("q_setpoint", "theta")]
    parameters = response_model("response.first_order_delay", pairs).parameters
    units = {name: parameters[name].unit for name in parameters.names}
    assert (units["K_velocity_down"], units["K_phi"]) == ("m/s", "1")
    assert (units["T_phi"], units["tau_phi"]) == ("s", "s")


def test_delays_and_time_constants_cannot_be_negative() -> None:
    parameters = response_model("response.first_order_delay", PAIRS[:1]).parameters
    assert parameters["tau_phi"].lower == 0.0
    assert parameters["T_phi"].lower > 0.0


def test_pairs_of_a_log_come_in_the_order_of_the_vocabulary() -> None:
    names = [
        "velocity_down",
        "velocity_down_setpoint",
        "arm_setpoint",
        "arm",
        "r_setpoint",
        "r",
        "phi",
        "theta_setpoint",
    ]
    found = response_pairs(names)
    assert found == (("r_setpoint", "r"), ("velocity_down_setpoint", "velocity_down"), ("arm_setpoint", "arm"))
    assert response_pairs(["phi", "theta_setpoint"]) == ()


@pytest.mark.parametrize(
    ("name", "pairs", "said"),
    [
        ("response.first_ordr", PAIRS, "did you mean response.first_order"),
        ("response.first_order", [], "no pair"),
        ("response.first_order", [PAIRS[0], ("phi_setpoint", "p")], "phi_setpoint stands twice"),
        ("response.first_order", [("phi", "phi")], "phi stands twice"),
        ("response.first_order", [("roll command", "phi")], "is not allowed in an equation"),
    ],
)
def test_what_is_wrong_is_said(name: str, pairs: list[tuple[str, str]], said: str) -> None:
    with pytest.raises(ModelError, match=said):
        response_model(name, pairs)
