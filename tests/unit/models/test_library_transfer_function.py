"""Transfer functions: the polynomials on paper, for any order and several responses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import freqs

from rotorid.errors import ModelError
from rotorid.models.library import speed_damping, transfer_function
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml, to_toml

OMEGA = np.geomspace(0.2, 60.0, 50)


def drawn(structure: LinearStructure) -> dict[str, float]:
    """Coefficients between 0.5 and 2 in size; delays are small."""
    rng = np.random.default_rng(len(structure.parameters))
    return {
        name: 0.01 + 0.02 * rng.uniform() if name.startswith("tau") else rng.choice([-1, 1]) * rng.uniform(0.5, 2.0)
        for name in structure.parameters.names
    }


@pytest.mark.parametrize(("m", "n"), [(0, 1), (1, 1), (0, 2), (1, 2), (2, 2), (1, 3), (3, 3), (2, 5), (0, 7)])
def test_response_against_scipy(m: int, n: int) -> None:
    structure = transfer_function(numerator=m, denominator=n)
    assert structure.parameters.names == (*(f"b{k}" for k in range(m + 1)), *(f"a{k}" for k in range(n)), "tau")
    values = drawn(structure)
    numerator = [values[f"b{k}"] for k in range(m, -1, -1)]
    denominator = [1.0, *(values[f"a{k}"] for k in range(n - 1, -1, -1))]
    expected = freqs(numerator, denominator, OMEGA)[1] * np.exp(-1j * OMEGA * values["tau"])
    # The powers of s span up to (60 / 0.2)^7: the solve of a badly scaled companion matrix rounds.
    np.testing.assert_allclose(structure.response(values, OMEGA)[0, 0], expected, rtol=1e-9)


def test_several_responses_share_their_denominator() -> None:
    structure = transfer_function(
        numerator=2, denominator=3, inputs=["roll_command", "yaw_command"], outputs=["p", "r"]
    )
    values = drawn(structure)
    response = structure.response(values, OMEGA)
    denominator = [1.0, values["a2"], values["a1"], values["a0"]]
    for i, y in enumerate(structure.outputs):
        for j, u in enumerate(structure.inputs):
            numerator = [values[f"b{k}_{y}_{u}"] for k in (2, 1, 0)]
            expected = freqs(numerator, denominator, OMEGA)[1] * np.exp(-1j * OMEGA * values[f"tau_{u}"])
            np.testing.assert_allclose(response[i, j], expected, rtol=1e-10)
    assert len(structure.parameters) == 4 * 3 + 3 + 2


def test_one_input_and_two_outputs() -> None:
    structure = transfer_function(numerator=0, denominator=1, inputs=["u"], outputs=["a", "b"])
    assert structure.parameters.names == ("b0_a_u", "b0_b_u", "a0", "tau_u")
    assert structure.states == ("x1",)
    assert structure.gain is None


def test_a_gain_is_one_where_nothing_else_scales() -> None:
    assert transfer_function(numerator=0, denominator=2).gain == "b0"
    assert transfer_function(numerator=1, denominator=2).gain is None


def test_a_transfer_function_is_written_and_read() -> None:
    structure = transfer_function(numerator=2, denominator=2)
    again = from_toml(to_toml(structure, structure.parameters, {}))
    values = drawn(structure)
    np.testing.assert_array_equal(again.response(values, OMEGA), structure.response(values, OMEGA))


@pytest.mark.parametrize(("m", "n"), [(2, 1), (-1, 2), (0, 0), (0, 21)])
def test_impossible_orders_are_refused(m: int, n: int) -> None:
    with pytest.raises(ModelError, match=f"orders {m} over {n}"):
        transfer_function(numerator=m, denominator=n)


def test_a_channel_that_is_no_name_is_refused() -> None:
    with pytest.raises(ModelError, match="'the input' is not allowed in an equation"):
        transfer_function(inputs=["the input"])


@pytest.mark.parametrize(("output", "name", "sign"), [("u_dot", "X_u", -1.0), ("v_dot", "Y_v", 1.0)])
def test_speed_damping_is_the_formula_on_paper(output: str, name: str, sign: float) -> None:
    structure = speed_damping(output, {"u_dot": "theta", "v_dot": "phi"}[output])
    s = 1j * OMEGA
    expected = sign * s * 9.80665 / (s + 0.31)
    np.testing.assert_allclose(structure.response({name: -0.31}, OMEGA)[0, 0], expected, rtol=1e-13)
    assert structure.parameters[name].essential


def test_there_is_no_other_speed_damping() -> None:
    with pytest.raises(ModelError, match=r"w_dot / theta; expected u_dot / theta, or v_dot / phi"):
        speed_damping("w_dot", "theta")
