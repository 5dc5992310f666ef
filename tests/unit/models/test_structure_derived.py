"""Structures from structures: some channels of one, other constants, without states that follow the input at once."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.equations import structure_from_equations
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure

OMEGA = np.geomspace(0.1, 200.0, 40)
ZERO = Expression()


def pendulum() -> LinearStructure:
    """Two inputs, three outputs, an axis of its own for the second input, a tie that names a constant."""
    units = {"M_q": "1/s", "M_pitch": "rad/s^2", "Z_w": "1/s", "Z_thrust": "m/s^2", "T_motor": "s"}
    values = {"M_q": -2.0, "M_pitch": 30.0, "Z_w": -0.5, "Z_thrust": -9.0, "T_motor": 0.05}
    taus = [Parameter(name=name, value=0.01, unit="s") for name in ("tau_pitch", "tau_thrust", "tau_az")]
    tied = Parameter(name="X_q", unit="1", tied=Expression.parse("g*M_q"))
    return structure_from_equations(
        name="pendulum",
        inputs=["pitch_command", "thrust_command"],
        states=["u", "theta", "q", "w", "motor_pitch", "motor_thrust"],
        equations=[
            "u' = X_q*q - g*theta",
            "theta' = q",
            "q' = M_q*q + M_pitch*motor_pitch",
            "w' = Z_w*w + Z_thrust*motor_thrust",
            "T_motor*motor_pitch' = -motor_pitch + pitch_command",
            "T_motor*motor_thrust' = -motor_thrust + 2*thrust_command",
        ],
        outputs=["q", "u", "az = w'"],
        delays={"pitch_command": "tau_pitch", "thrust_command": "tau_thrust", "az": "tau_az"},
        constants={"g": 9.8},
        parameters=ParameterSet(
            [*(Parameter(name=n, value=values[n], unit=units[n]) for n in units), tied, *taus], {"g": 9.8}
        ),
        gain="M_pitch",
        optional=["T_motor", "tau_az"],
    )


def test_constants_have_other_values_in_another_flight() -> None:
    structure = pendulum()
    assert structure.with_constants({"g": 1.6}).matrices(structure.parameters.values).F[0, 1] == -1.6
    assert structure.matrices(structure.parameters.values).F[0, 1] == -9.8
    with pytest.raises(ModelError, match="no constant 'G'"):
        structure.with_constants({"G": 1.0})
    moved = structure.with_constants({"g": 2.0})
    assert moved.parameters.values["X_q"] == 2.0 * structure.parameters.values["M_q"]


def test_a_selection_has_the_same_responses() -> None:
    structure = pendulum()
    whole = structure.response(structure.parameters.values, OMEGA)
    part = structure.select(outputs=["u", "q"], inputs=["pitch_command"])
    assert part.inputs == ("pitch_command",)
    assert part.outputs == ("u", "q")
    assert part.parameters.names == ("M_q", "M_pitch", "Z_w", "Z_thrust", "T_motor", "X_q", "tau_pitch")
    assert part.optional == ("T_motor",)
    assert part.gain == "M_pitch"
    np.testing.assert_array_equal(part.response(part.parameters.values, OMEGA), whole[[1, 0]][:, :1])
    assert structure.select().parameters == structure.parameters


def test_a_selection_keeps_what_ties_need() -> None:
    structure = pendulum()
    bare = replace(structure, parameters=structure.parameters.tie("tau_pitch", "tau_az/2"))
    assert "tau_az" in bare.select(outputs=["q"]).parameters.names
    assert "tau_az" not in bare.select(outputs=["q"], inputs=["thrust_command"]).parameters.names


@pytest.mark.parametrize(
    ("chosen", "message"),
    [
        ({"outputs": ["qq"]}, "no output 'qq'; expected one of q, u, az; did you mean q?"),
        ({"inputs": ["pitch"]}, "no input 'pitch'.*did you mean pitch_command"),
        ({"outputs": ["q", "q"]}, "the outputs q, q were selected; expected at least one, each once"),
        ({"inputs": []}, r"the inputs \(none\) were selected"),
    ],
)
def test_a_selection_of_what_is_not_there_is_refused(chosen: dict[str, list[str]], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        pendulum().select(**chosen)


def test_states_without_lag_leave_the_structure() -> None:
    structure = pendulum()
    dropped = structure.parameters.drop("T_motor")
    left = structure.condensed(dropped)
    assert left.states == ("u", "theta", "q", "w")
    assert left.parameters == dropped
    assert [str(entry) for entry in left.G[3]] == ["0", "Z_thrust*2"]
    values = dropped.values
    np.testing.assert_allclose(left.response(values, OMEGA), structure.response(values, OMEGA), rtol=1e-12)
    again = left.condensed(dropped)
    assert again.states == left.states


def test_a_lag_fixed_at_zero_leaves_with_its_states() -> None:
    structure = pendulum()
    left = structure.condensed(structure.parameters.fix("T_motor", 0.0))
    assert left.states == ("u", "theta", "q", "w")
    assert "T_motor" not in left.parameters.names
    assert left.optional == ("tau_az",)


@pytest.mark.parametrize("lag", ["free", "fixed"])
def test_states_with_a_lag_stay(lag: str) -> None:
    structure = pendulum()
    parameters = structure.parameters if lag == "free" else structure.parameters.fix("T_motor", 0.02)
    assert structure.condensed(parameters).states == structure.states
    # A free lag of zero may yet grow.
    assert structure.condensed(structure.parameters.with_values({"T_motor": 0.0})).states == structure.states


def test_an_algebraic_state_that_is_seen_stays() -> None:
    structure = pendulum()
    seen = replace(
        structure,
        outputs=("q", "u", "az", "motor"),
        H0=(*structure.H0, (*(ZERO,) * 4, Expression.parse(1), ZERO)),
        H1=(*structure.H1, (ZERO,) * 6),
        output_delays=(*structure.output_delays, ZERO),
    )
    assert seen.condensed(seen.parameters.drop("T_motor")).states == ("u", "theta", "q", "w", "motor_pitch")


def test_algebraic_states_behind_each_other_leave_one_after_the_other() -> None:
    chain = structure_from_equations(
        name="chain",
        inputs=["u"],
        states=["p", "filtered", "motor"],
        equations=["p' = L*filtered", "T_2*filtered' = -filtered + 3*motor", "T_1*motor' = -motor + u"],
        outputs=["p"],
        parameters=ParameterSet([Parameter(name=name, value=1.0, unit="1") for name in ("L", "T_1", "T_2")]),
    )
    both = chain.condensed(chain.parameters.drop("T_1").drop("T_2"))
    assert (both.states, str(both.G[0][0])) == (("p",), "L*3")
    assert chain.condensed(chain.parameters.drop("T_1")).states == ("p", "filtered")
    assert chain.condensed(chain.parameters.drop("T_2")).states == chain.states


def test_a_structure_pickles_with_everything() -> None:
    structure = pendulum()
    again = pickle.loads(pickle.dumps(structure))
    assert again.constants == structure.constants
    assert again.parameters == structure.parameters
    values = structure.parameters.values
    np.testing.assert_array_equal(again.response(values, OMEGA), structure.response(values, OMEGA))
