"""Nonlinear structures: read, checked, compiled, and composed from linear axes."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.compiled import tape
from rotorid.models.equations import structure_from_equations
from rotorid.models.expression import Expression
from rotorid.models.library import nonlinear_library_text, nonlinear_model, nonlinear_model_names
from rotorid.models.nonlinear import AXES, flight_structure, nonlinear_structure
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import nonlinear_from_toml
from rotorid.simulation.nonlinear import simulate_nonlinear

TEXT = """
kind = "nonlinear"
name = "sled"
inputs = ["push"]
states = ["x", "v"]
equations = ["x' = v", "m*v' = push - k*abs(v)*v"]
outputs = ["x", "a = v'"]
[delays]
push = "tau"
[starts]
x = "x"
[constants]
m = 2.0
[parameters.k]
value = 0.3
[parameters.tau]
value = 0.02
unit = "s"
"""


def test_a_description_says_equations_delays_and_starts() -> None:
    sled = nonlinear_from_toml(TEXT)
    assert [str(one) for one in sled.equations] == ["v", "(push - k*abs(v)*v)/m"]
    assert sled.output_equations[1] == sled.equations[1]
    assert sled.delays(sled.parameters.values).tolist() == [0.02]
    start = sled.measured_start(np.array([4.0, 0.0]), np.zeros(1))
    assert start[0] == 4.0
    assert np.isnan(start[1])


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ('"nonlinear"', '"linear"', 2, "kind 'linear'"),
        ("x' = v", "x' = w", 6, 'w in "x\' = w" is not known'),
        ("m*v'", "x'*v'", 6, "not linear"),
        ("m*v'", "m*x'", 6, "two equations define x'"),
        ("push - k", "push' - k", 6, "derivatives of states only"),
        ("x' = v", "x' = v'+v; ", 6, "cannot be read"),
        ('"a = v\'"', '"a"', 7, "there is no state 'a'"),
        ('push = "tau"', 'pusch = "tau"', 9, "did you mean push?"),
        ('push = "tau"', 'push = "x"', 9, "no parameter or constant 'x'"),
        ('x = "x"\n[con', 'x = "z"\n[con', 11, "no output, input or constant 'z'"),
        ("[starts]\nx", "[starts]\ny", 11, "there is no state 'y'"),
        ("m = 2.0", "k = 2.0", 13, "means two things"),
        ("value = 0.3", 'value = "much"', 15, "expected a number"),
        ("[delays]", "[delay]", 8, "did you mean delays?"),
        ('name = "sled"', "name = sled", 3, "not valid TOML"),
    ],
)
def test_errors_name_the_line(old: str, new: str, line: int, message: str) -> None:
    assert old in TEXT
    with pytest.raises(ModelError) as error:
        nonlinear_from_toml(TEXT.replace(old, new), where="sled.toml")
    assert f"sled.toml, line {line}" in str(error.value)
    assert message in str(error.value)


def test_a_parameter_that_stands_nowhere_is_refused() -> None:
    with pytest.raises(ModelError, match="spare is in no equation"):
        nonlinear_from_toml(TEXT + "[parameters.spare]\nvalue = 1.0\n")


def test_derivatives_may_stand_on_the_right_but_not_in_a_loop() -> None:
    def of(*equations: str) -> list[str]:
        model = nonlinear_structure(
            name="n", inputs=[], states=["x", "y"], equations=equations, outputs=["x"], parameters=ParameterSet(())
        )
        return [str(one) for one in model.equations]

    assert of("x' = 2*y'", "y' = -x") == ["-2*x", "-x"]
    with pytest.raises(ModelError, match="loop: x' -> y' -> x'"):
        of("x' = y'", "y' = x'")
    with pytest.raises(ModelError, match="no equation defines y'"):
        of("x' = y")


def test_a_tape_computes_common_parts_once_and_settled_ones_first() -> None:
    texts = ["sin(x)*(a + b)**2", "sin(x)/(a + b)", "-x"]
    both = tape([Expression.parse(text) for text in texts], ["x"], ["a", "b"])
    # a + b and its square; then sin(x), one product, one quotient, one sign.
    assert (len(both.operations), both.settled) == (6, 2)
    again = pickle.loads(pickle.dumps(both))
    assert np.array_equal(again.operations, both.operations)
    assert not again.operations.flags.writeable


@pytest.mark.parametrize("name", nonlinear_model_names())
def test_the_library_survives_pickling_and_is_documented(name: str) -> None:
    model = nonlinear_model(name)
    assert model.name == name
    assert nonlinear_library_text(name).startswith("# ")
    again = pickle.loads(pickle.dumps(model))
    assert again.equations == model.equations
    assert again.parameters == model.parameters


def test_an_unknown_model_suggests_the_nearest() -> None:
    with pytest.raises(ModelError, match=r"did you mean drag\.linear\?"):
        nonlinear_model("drag.linaer")


def test_constants_change_and_outputs_are_selected() -> None:
    sled = nonlinear_from_toml(TEXT)
    assert sled.with_constants({"m": 3.0}).constants == {"m": 3.0}
    with pytest.raises(ModelError, match="no constant 'n'"):
        sled.with_constants({"n": 3.0})
    pushed = sled.select(["a"])
    assert pushed.states == ("v",)
    assert pushed.outputs == ("a",)
    assert dict(pushed.starts) == {}
    with pytest.raises(ModelError, match="no output 'b'"):
        sled.select(["b"])


def test_states_that_no_output_sees_are_left_out() -> None:
    whole = nonlinear_model("flight.first_order")
    part = whole.select(["theta", "velocity_down"])
    assert part.states == ("velocity_down", "theta")
    assert part.inputs == whole.inputs
    assert set(part.parameters.names) == {f"{kind}_{axis}" for kind in ("K", "T", "tau") for axis in ("theta", "down")}
    assert set(whole.select(["velocity_north"]).states) == set(whole.states) - {"north", "east", "down"}
    u, values = commands(60), whole.parameters.values
    every = simulate_nonlinear(whole, values, u, sample_rate_hz=20.0)
    found = simulate_nonlinear(part, values, u, sample_rate_hz=20.0)
    # Without the corners of the other inputs the steps are longer, and the errors other ones.
    assert found == pytest.approx(every[[7, 5]], abs=1e-5)


def lag(command: str, *, gain: float, time_s: float, delay_s: float) -> LinearStructure:
    return structure_from_equations(
        name="lag",
        inputs=[command],
        states=["x"],
        equations=[f"T*x' = -x + K*{command}"],
        outputs=["x"],
        delays={command: "tau"},
        parameters=ParameterSet(
            [
                Parameter(name="K", value=gain, unit="1"),
                Parameter(name="T", value=time_s, unit="s"),
                Parameter(name="tau", value=delay_s, unit="s"),
            ]
        ),
    )


COMMANDS = dict(zip(AXES, ("phi_setpoint", "theta_setpoint", "r_setpoint", "velocity_down_setpoint"), strict=True))


def commands(samples: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.repeat(0.3 * rng.choice([-1.0, 1.0], (4, samples // 10)), 10, axis=1)


def test_a_flight_of_first_order_axes_is_that_of_the_library() -> None:
    library = nonlinear_model("flight.first_order")
    symbols = {"phi": "phi", "theta": "theta", "psi_dot": "psi", "velocity_down": "down"}
    rng = np.random.default_rng(4)
    axes, values = {}, {"k_Dx": 0.2, "k_Dy": 0.4}
    for axis, symbol in symbols.items():
        gain, time_s, delay_s = rng.uniform(0.8, 1.2), rng.uniform(0.1, 0.4), rng.uniform(0.0, 0.1)
        axes[axis] = lag(COMMANDS[axis], gain=gain, time_s=time_s, delay_s=delay_s)
        values |= {f"K_{symbol}": gain, f"T_{symbol}": time_s, f"tau_{symbol}": delay_s}
    built = flight_structure(axes, drag_per_s=(0.2, 0.4))
    assert built.inputs == library.inputs
    assert built.outputs == library.outputs
    u = commands(100)
    expected = simulate_nonlinear(library, values, u, sample_rate_hz=20.0)
    found = simulate_nonlinear(built, built.parameters.values, u, sample_rate_hz=20.0)
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()
    assert set(built.starts) == set(built.states) - {"psi_dot_x"}


def test_a_flight_takes_axes_of_any_order() -> None:
    second = structure_from_equations(
        name="second",
        inputs=["theta_setpoint"],
        states=["a", "b"],
        equations=["a' = b", "b' = -w**2*a - c*b + theta_setpoint"],
        outputs=["theta = w**2*a + z*b"],
        delays={"theta": "late"},
        parameters=ParameterSet(
            [
                Parameter(name="w", value=6.0, unit="rad/s"),
                Parameter(name="c", unit="1/s", tied=Expression.parse("1.4*w")),
                Parameter(name="z", value=0.3, unit="1/s"),
                Parameter(name="late", value=0.03, unit="s"),
            ]
        ),
    )
    axes = {axis: lag(COMMANDS[axis], gain=1.0, time_s=0.2, delay_s=0.0) for axis in AXES} | {"theta": second}
    built = flight_structure(axes)
    assert built.parameters["c_theta"].value == pytest.approx(8.4)
    assert [str(delay) for delay in built.input_delays] == ["tau_phi", "late_theta", "tau_psi_dot", "tau_velocity_down"]
    assert set(built.states) - set(built.starts) == {"theta_a", "theta_b", "psi_dot_x"}
    response = simulate_nonlinear(built, built.parameters.values, commands(100), sample_rate_hz=20.0)
    y = dict(zip(built.outputs, response, strict=True))
    # Nose down is negative pitch, and accelerates to the north while the heading is small.
    assert np.corrcoef(np.gradient(y["velocity_north"])[:40], -y["theta"][:40])[0, 1] > 0.9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"phi": None}, "lacks the axis phi"),
        ({"roll": lag("r", gain=1.0, time_s=1.0, delay_s=0.0)}, "no axis 'roll'"),
    ],
)
def test_a_flight_needs_its_four_axes(change: dict[str, LinearStructure | None], message: str) -> None:
    axes = {axis: lag(COMMANDS[axis], gain=1.0, time_s=0.2, delay_s=0.0) for axis in AXES} | change
    with pytest.raises(ModelError, match=message):
        flight_structure({axis: model for axis, model in axes.items() if model is not None})
