"""Equations as a paper prints them: the same system as matrices written by hand, and refused where they say no such."""

from __future__ import annotations

from dataclasses import replace

import pytest

from rotorid.errors import ModelError
from rotorid.models.equations import can_be_equations, structure_from_equations, written_equations, written_outputs
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure

NAMES = ("M_q", "M_u", "X_q", "X_u", "M_pitch", "X_pitch", "T_motor", "z_imu", "tau_pitch", "tau_ax")
EQUATIONS = (
    "q' = M_q*q + M_u*u + M_pitch*motor",
    "u' - 2*z_imu*q' = (X_q - W0)*q + X_u*u - g*cos(theta0)*theta + X_pitch*(motor - pitch_command)",
    "theta' = q",
    "T_motor*motor' = -motor + pitch_command",
)
OUTPUTS = ("q", "ax = u' + g*theta - z_imu*q'", "speed = u")
MATRICES = {
    "M": [["1", "0", "0", "0"], ["-2*z_imu", "1", "0", "0"], ["0", "0", "1", "0"], ["0", "0", "0", "T_motor"]],
    "F": [
        ["M_q", "M_u", "0", "M_pitch"],
        ["X_q - W0", "X_u", "-g*cos(theta0)", "X_pitch"],
        ["1", "0", "0", "0"],
        ["0", "0", "0", "-1"],
    ],
    "G": [["0"], ["-X_pitch"], ["0"], ["1"]],
    "H0": [["1", "0", "0", "0"], ["0", "0", "g", "0"], ["0", "1", "0", "0"]],
    "H1": [["0", "0", "0", "0"], ["-z_imu", "1", "0", "0"], ["0", "0", "0", "0"]],
}


def build(**change: object) -> LinearStructure:
    fields: dict[str, object] = {
        "name": "pitch",
        "inputs": ["pitch_command"],
        "states": ["q", "u", "theta", "motor"],
        "equations": EQUATIONS,
        "outputs": OUTPUTS,
        "delays": {"pitch_command": "tau_pitch", "ax": "tau_ax + 0.001"},
        "constants": {"g": 9.80665, "W0": 0.1, "theta0": 0.02},
        "parameters": ParameterSet([Parameter(name=name, value=0.1, unit="1") for name in NAMES]),
    }
    return structure_from_equations(**{**fields, **change})  # type: ignore[arg-type]


def test_equations_are_the_matrices_written_by_hand() -> None:
    structure = build()
    for name, rows in MATRICES.items():
        assert getattr(structure, name) == tuple(tuple(map(Expression.parse, row)) for row in rows), name
    assert structure.outputs == ("q", "ax", "speed")
    assert [str(delay) for delay in structure.input_delays] == ["tau_pitch"]
    assert [str(delay) for delay in structure.output_delays] == ["0", "tau_ax + 0.001", "0"]


def test_written_equations_say_the_same() -> None:
    structure = build()
    written = written_equations(structure)
    assert written[1] == (
        "-2*z_imu*q' + u' = (X_q - W0)*q + X_u*u - g*cos(theta0)*theta + X_pitch*motor - X_pitch*pitch_command"
    )
    assert written_outputs(structure) == ["q", "ax = -z_imu*q' + u' + g*theta", "speed = u"]
    again = build(equations=written, outputs=written_outputs(structure))
    for name in MATRICES:
        assert getattr(again, name) == getattr(structure, name), name


def test_an_algebraic_equation_has_nothing_on_its_left() -> None:
    parameters = ParameterSet([Parameter(name="K", value=1.0, unit="1")])
    structure = structure_from_equations(
        name="mixer",
        inputs=["a"],
        states=["x", "m"],
        equations=["x' = K*m", "0 = -m + a"],
        outputs=["x"],
        parameters=parameters,
    )
    assert structure.matrices({"K": 2.0}).poles().tolist() == [0.0]
    assert written_equations(structure)[1] == "0 = -m + a"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("theta' = q", "theta' = qq", r"qq in the right side of .* is not known; expected one of q, u, .*mean q\?"),
        ("theta' = q", "theta' == q", "has 2 signs of equality"),
        ("theta' = q", "theta'", "has 0 signs of equality"),
        ("theta' = q", "theta' = q*theta", r"q\*theta is not linear in q, theta"),
        ("theta' = q", "theta' = q/theta", r"q/theta is not linear"),
        ("theta' = q", "theta' = sin(theta)", r"sin\(theta\) is not linear in theta"),
        ("theta' = q", "theta' = q**2", r"q\*\*2 is not linear in q"),
        ("theta' = q", "theta' = q + 1", "1 is alone in the right side"),
        ("theta' = q", "theta' + 1 = q", "1 is alone in the left side"),
        ("theta' = q", "theta = q", "theta is not allowed in the left side .*expected q', u', theta', motor', each"),
        ("theta' = q", "theta' = q'", "q' is not allowed in the right side"),
        ("theta' = q", "theta' = pitch_command'", "pitch_command' is not allowed in .*derivatives of states only"),
        ("theta' = q", "theta' = M_q'*q", "M_q' is not allowed in .*derivatives of states only"),
        ("theta' = q", "theta' = q +", "cannot be read: the end at column"),
        ("theta' = q", "q' = theta", "two equations define q'"),
        ("theta' = q", "2*q' = theta", "two equations define q'"),
    ],
)
def test_an_equation_that_is_none_is_refused(old: str, new: str, message: str) -> None:
    with pytest.raises(ModelError, match=message):
        build(equations=[new if text == old else text for text in EQUATIONS])


def test_every_state_has_one_equation() -> None:
    with pytest.raises(ModelError, match="got 3 equations for 4 states; none defines theta'"):
        build(equations=[text for text in EQUATIONS if not text.startswith("theta")])
    with pytest.raises(ModelError, match="got 5 equations for 4 states; expected one equation for each state"):
        build(equations=[*EQUATIONS, "0 = q - u"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"outputs": ["qq"]}, "no state 'qq'.*did you mean q.*define it"),
        ({"outputs": ["pitch_command"]}, "no state 'pitch_command'"),
        ({"outputs": ["= q"]}, "has no name"),
        ({"outputs": ["a b = q"]}, "has no name"),
        ({"outputs": ["y = q*u"]}, "not linear"),
        ({"outputs": ["y = q == u"]}, "cannot be read"),
        ({"delays": {"pitch": "tau_pitch"}}, "no input or output 'pitch'.*did you mean pitch_command"),
        ({"inputs": ["q"]}, "q means two things"),
        ({"inputs": ["a b"]}, "'a b' is not allowed in an equation"),
        ({"inputs": ["exp"]}, "'exp' is not allowed in an equation"),
        ({"constants": {"M_q": 1.0}}, "M_q means two things"),
        ({"outputs": [*OUTPUTS, "pitch_command = q"]}, "pitch_command is an input and an output"),
    ],
)
def test_what_does_not_fit_the_equations_is_refused(change: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        build(**change)


def test_names_that_are_no_symbols_cannot_be_equations() -> None:
    structure = build()
    assert can_be_equations(structure)
    assert not can_be_equations(replace(structure, states=("q", "u", "the angle", "motor")))
    assert not can_be_equations(replace(structure, inputs=("q",)))
    assert not can_be_equations(replace(structure, outputs=("q", "ax", "pitch_command")))
