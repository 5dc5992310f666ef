"""Models as text: what was written comes back, and every slip of the pen is answered with a sentence."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.letters import visible
from rotorid.models.expression import Expression
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure, answers
from rotorid.models.toml import from_toml, to_toml
from rotorid.models.toml_source import line_of
from rotorid.simulation.linear import simulate_linear

FIELDS = ("name", "inputs", "states", "outputs", "M", "F", "G", "H0", "H1", "input_delays", "output_delays")
MORE = ("gain", "optional", "source", "constants", "parameters")

GOOD = """
name = "lag"
inputs = ["roll_command"]
states = ["p"]
outputs = ["p"]
F = [["L_p"]]
G = [["L_roll"]]
H0 = [[1]]
input_delays = ["tau"]
gain = "L_roll"
[parameters.L_p]
value = -1
upper = 0.0
[parameters.L_roll]
value = 40.0
unit = "rad/s^2"
[parameters.tau]
value = 0.01
unit = "s"
status = "fixed"
"""


EQUATIONS = """# a comment
schema = "rotorid.model/1"
name = "pitch"
inputs = ["pitch_command", "thrust_command"]
states = ["q", "u", "motor"]
equations = [
  "q' = M_q*q + M_u*u + M_pitch*motor",  # moment
  "u' - k*q' = (X_q - W0)*q + X_u*u + thrust_command",
  "T_motor*motor' = -motor + pitch_command",
]
outputs = ["q", "ax = u' - z*q'"]
optional = ["T_motor"]
[delays]
pitch_command = "tau"
ax = 0.002
[constants]
W0 = 0.1
k = 2
[parameters.M_q]
unit = "1/s"
[parameters.M_u]
value = 5
unit = "rad/(m s)"
essential = true
[parameters.M_pitch]
value = 100.0
unit = "rad/s^2"
lower = 1.0
upper = 1e3
starts = [20, 200.0]
[parameters.X_q]
tied = "-M_q/M_u + 2*k"
unit = "m/s"
[parameters.X_u]
tied = "X_q"
unit = "1/s"
[parameters.T_motor]
unit = "s"
lower = 0.01
[parameters.z]
status = "dropped"
unit = "m"
[parameters.tau]
value = 0.02
unit = "s"
status = "fixed"
"""


def assert_same(one: LinearStructure, other: LinearStructure) -> None:
    for name in (*FIELDS, *MORE):
        assert getattr(one, name) == getattr(other, name), name


@pytest.mark.parametrize("name", RATE_AXES)
def test_models_of_the_library_come_back(name: str) -> None:
    structure = rate_model(name)
    assert_same(from_toml(to_toml(structure, structure.parameters, {})), structure)


def test_identified_values_come_back_to_the_last_digit() -> None:
    structure = rate_model("rate.roll")
    values = {"L_roll": 1.0 / 3.0, "L_p": -np.pi, "T_motor": 5e-324, "tau_roll": 1e-17}
    parameters = structure.parameters.with_values(values).fix("tau_roll", 0.1 + 0.2).drop("T_motor")
    text = to_toml(structure, parameters, {"L_p": 0.25, "L_roll": float("inf")})
    again = from_toml(text)
    assert again.parameters == parameters
    assert "std = 0.25" in text


@pytest.mark.parametrize(
    "hostile",
    [
        '"',
        "\\",
        '\\"',
        "a\nb",
        "\r\n",
        "\t",
        "\x00\x1b\x7f",
        "é π µ",
        "\u2028\ufeff",
        "\U000e0001",
        '"""',
        "]\n[x]",
        "#",
    ],
)
def test_hostile_texts_come_back(hostile: str) -> None:
    structure = rate_model("rate.yaw")
    states = (f"r {hostile}", f"motor {hostile}")
    odd = replace(structure, name=hostile, source=f"{hostile} x", states=states)
    assert_same(from_toml(to_toml(odd, odd.parameters, {})), odd)


def test_a_greek_letter_names_a_parameter() -> None:
    structure = from_toml(GOOD)
    renamed = replace(
        structure,
        input_delays=(Expression.parse("t_ω"),),
        parameters=ParameterSet(tuple(replace(p, name=p.name.replace("tau", "t_ω")) for p in structure.parameters)),
    )
    assert_same(from_toml(to_toml(renamed, renamed.parameters, {"t_ω": 0.001})), renamed)


def test_what_is_left_out_has_its_plain_meaning() -> None:
    system = from_toml(GOOD).matrices({"L_p": -1.0, "L_roll": 40.0, "tau": 0.01})
    np.testing.assert_array_equal(system.M, [[1.0]])
    np.testing.assert_array_equal(system.H1, [[0.0]])
    np.testing.assert_array_equal(system.output_delays_s, [0.0])
    parameters = from_toml(GOOD).parameters
    assert parameters["L_p"] == Parameter(name="L_p", value=-1.0, unit="1", upper=0.0)
    assert parameters["tau"].status == "fixed"


def test_equations_say_what_matrices_say() -> None:
    matrices = """
name = "pitch"
inputs = ["pitch_command", "thrust_command"]
states = ["q", "u", "motor"]
outputs = ["q", "ax"]
optional = ["T_motor"]
M = [[1, 0, 0], ["-k", 1, 0], [0, 0, "T_motor"]]
F = [["M_q", "M_u", "M_pitch"], ["X_q - W0", "X_u", 0], [0, 0, -1]]
G = [[0, 0], [0, 1], [1, 0]]
H0 = [[1, 0, 0], [0, 0, 0]]
H1 = [[0, 0, 0], ["-z", 1, 0]]
input_delays = ["tau", 0]
output_delays = [0, 0.002]
"""
    structure = from_toml(EQUATIONS)
    assert_same(from_toml(matrices + EQUATIONS[EQUATIONS.index("[constants]") :]), structure)
    assert_same(from_toml(to_toml(structure, structure.parameters, {})), structure)
    assert to_toml(structure, structure.parameters, {}).count("= [") == 6  # no matrix


def test_parameters_of_a_text_have_their_roles() -> None:
    parameters = from_toml(EQUATIONS).parameters
    assert parameters.free == ("M_q", "M_u", "M_pitch", "T_motor")
    assert parameters["M_q"] == Parameter(name="M_q", value=0.0, unit="1/s")
    assert parameters["M_u"].essential
    assert parameters["M_pitch"].starts == (20.0, 200.0)
    assert str(parameters["X_q"].tied) == "-M_q/M_u + 2*k"
    assert parameters.values["X_u"] == parameters.values["X_q"] == 4.0
    # Without a value: the number nearest to zero that the bounds allow.
    assert parameters["T_motor"].value == 0.01
    assert (parameters["z"].status, parameters["tau"].status) == ("dropped", "fixed")


def test_a_model_without_parameters_comes_back() -> None:
    structure = LinearStructure(
        name="integrator",
        inputs=("u",),
        states=("x",),
        outputs=("x",),
        M=((Expression.parse(1),),),
        F=((Expression(),),),
        G=((Expression.parse("2*k"),),),
        H0=((Expression.parse(1),),),
        H1=((Expression(),),),
        input_delays=(Expression(),),
        output_delays=(Expression(),),
        constants={"k": 1.0 / 3.0},
        parameters=ParameterSet(()),
    )
    assert_same(from_toml(to_toml(structure, structure.parameters, {})), structure)


SLIPS = [
    ("name = ", "nam = ", 2, r"no key 'nam'.*did you mean name"),
    ('name = "lag"\n', "", 1, r"lacks name"),
    ("H0 = [[1]]\n", "", 1, r"lacks H0; .*with equations instead of F, G and H0"),
    ('name = "lag"', 'name = "lag', 2, r"not valid TOML"),
    ('name = "lag"', "name = 3", 2, r"name is 3; expected a text in quotes"),
    ('name = "lag"', 'name = "lag"\nschema = "rotorid.model/9"', 3, r"has the schema 'rotorid.model/9'"),
    ('name = "lag"', 'name = "lag"\nsource = [1]', 3, r"source is \[1\]"),
    ('name = "lag"', 'name = "lag"\noptional = "tau"', 3, r"optional is 'tau'; expected a list"),
    ('name = "lag"', 'name = "lag"\noptional = ["tou"]', 3, r"no parameter \(optional\) 'tou'.*did you mean tau"),
    ('name = "lag"', 'name = "lag"\nequations = []', 7, r"has both equations and F"),
    ('name = "lag"', 'name = "lag"\nconstants = 3', 3, r"constants is no table"),
    ('name = "lag"', 'name = "lag"\nconstants = {g = "9"}', 3, r"g is '9'; expected a number"),
    ('name = "lag"', 'name = "lag"\nconstants = {g = inf}', 3, r"g is inf; expected a finite number"),
    ('name = "lag"', 'name = "lag"\nconstants = {tau = 1}', 3, r"tau is a parameter and a constant"),
    ('["roll_command"]', '"roll_command"', 3, r"inputs is 'roll_command'; expected a list of texts"),
    ('["roll_command"]', "7", 3, r"inputs is 7"),
    ('["roll_command"]', "[7]", 3, r"inputs is \[7\]"),
    ('states = ["p"]', 'states = [\n"p",\n"p"]', 6, r"states has 'p' twice"),
    ('states = ["p"]', 'states = ["p", "motor"]', 6, r"matrix F has 1 rows; expected 2 rows of 2 entries"),
    ('F = [["L_p"]]', 'F = ["L_p"]', 6, r"F contains something other than rows of entries"),
    ('F = [["L_p"]]', 'F = "L_p"', 6, r"F is no list of rows"),
    ('F = [["L_p"]]', 'F = [\n["L_p", 0]]', 7, r"row 1 of matrix F has 2 entries; expected 1 entries"),
    ('F = [["L_p"]]', 'F = [["L_p"],\n["L_p"]]', 6, r"matrix F has 2 rows; expected 1 rows"),
    (
        'F = [["L_p"]]',
        'F = [["L_p + L_q"]]',
        6,
        r"no parameter or constant 'L_q'; .*did you mean L_p",
    ),
    ('F = [["L_p"]]', 'F = [["L_p L_p"]]', 6, r"'L_p L_p' cannot be read: 'L_p' at column 5"),
    ('F = [["L_p"]]', 'F = [["L_p/0"]]', 6, "1/0 has no finite value; expected a finite number"),
    ('F = [["L_p"]]', "F = [[[1]]]", 6, r"F contains something other"),
    ('F = [["L_p"]]', "F = [[true]]", 6, r"True cannot be read"),
    ('F = [["L_p"]]', "F = [[nan]]", 6, r"nan cannot be read"),
    ('F = [["L_p"]]', "F = [[0]]", 11, r"L_p stands nowhere in the model"),
    ('["tau"]', '"tau"', 9, r"input_delays is 'tau'"),
    ('["tau"]', '["tau", 0]', 9, r"input_delays has 2 entries; expected 1 entries"),
    ('gain = "L_roll"', 'gain = "L_rol"', 10, r"no parameter \(gain\) 'L_rol'.*did you mean L_roll"),
    ('gain = "L_roll"', "gain = 1", 10, r"gain is 1"),
    ("value = 40.0", 'value = "abc"', 15, r"value of L_roll is 'abc'; expected a number"),
    ("value = 40.0", "value = true", 15, r"value of L_roll is True"),
    ("value = 40.0", "value = nan", 15, r"value of L_roll is not a number"),
    ("value = 40.0", "value = inf", 15, r"L_roll = inf"),
    ("value = 40.0", "value = [1]", 15, r"value of L_roll is \[1\]"),
    ("value = 40.0", f"value = 1{'0' * 400}", 15, r"value of L_roll is too large"),
    ("value = 40.0", f"value = 1{'0' * 5000}", None, r"not valid TOML"),
    ("value = 40.0", "unit2 = 40.0", 15, r"no key of the parameter L_roll called 'unit2'.*did you mean unit"),
    ("value = 40.0", "value = 40.0\nminimum = 0", 16, r"called 'minimum'; expected one of value, unit"),
    ("value = 40.0", "value = 40.0\nessential = 1", 16, r"essential of L_roll is 1; expected true or false"),
    ("upper = 0.0", "upper = -2.0", 12, r"L_p = -1 1 lies outside its bounds; expected a finite value from -inf to -2"),
    ("upper = 0.0", "upper = 0.0\nlower = 1.0", 14, r"the bounds of L_p go from 1 to 0"),
    ("upper = 0.0", "upper = nan", 13, r"upper of L_p is not a number"),
    ("upper = 0.0", 'upper = "0"', 13, r"upper of L_p is '0'"),
    ("upper = 0.0", "starts = 3", 13, r"starts of L_p is 3"),
    ("upper = 0.0", 'starts = ["a"]', 13, r"starts of L_p is 'a'"),
    ('unit = "s"', "unit = 1", 19, r"unit of tau is 1"),
    ('unit = "s"', 'unit = "ms"', 19, r"the unit of tau is 'ms'; .*give its numbers in s"),
    ('unit = "s"', 'unit = "second"', 19, r"the unit of tau is 'second'; expected an SI unit"),
    ('unit = "s"', 'unit = "m"', 19, r"tau is a delay and its unit is 'm'; expected 's'"),
    ('"fixed"', '"frozen"', 20, r"tau has the status 'frozen'; expected free, fixed, tied or dropped"),
    ('"fixed"', '["fixed"]', 20, r"tau has the status \['fixed'\]"),
    ('"fixed"', '"tied"', 20, r"tau is tied and not tied to an expression"),
    ('"fixed"', '"dropped"', 18, r"tau is dropped and is 0.01"),
    ('value = 0.01\nunit = "s"', 'unit = "s"', 19, r"tau is fixed and has no value"),
    ('value = 0.01\nunit = "s"\nstatus = "fixed"', 'tied = "tau"', 18, r"loop: tau -> tau"),
    ('value = 0.01\nunit = "s"\nstatus = "fixed"', 'tied = "tou"', 18, r"tau is tied to 'tou'.*did you mean tau"),
    ('value = 0.01\nunit = "s"\nstatus = "fixed"', 'tied = "2 *"', 18, r"cannot be read: the end at column 4"),
    ('value = 0.01\nunit = "s"\nstatus = "fixed"', "tied = [1]", 18, r"contains something other than entries"),
    ('unit = "s"', 'tied = "L_p"', 20, r"tau is fixed and tied to an expression"),
    ("[parameters.tau]\n", "[parameters.tau]\n[parameters.tau]\n", 18, r"not valid TOML"),
]


def assert_refused(text: str, line: int | None, message: str) -> None:
    with pytest.raises(ModelError, match=message) as caught:
        from_toml(text, where="model.toml")
    error = str(caught.value)
    assert error.endswith((".", "?"))
    assert caught.value.needed or caught.value.remedy or "loop" in error
    assert error.count("model.toml, line ") == 1
    if line is not None:
        shown = visible((text.splitlines() or [""])[line - 1].strip())
        assert error.startswith(f"model.toml, line {line}{f' ({shown[:100]}' if shown else ''}")


@pytest.mark.parametrize(("old", "new", "line", "message"), SLIPS)
def test_a_slip_is_answered_with_a_sentence(old: str, new: str, line: int | None, message: str) -> None:
    assert old in GOOD
    assert_refused(GOOD.replace(old, new, 1), line, message)


SLIPS_IN_EQUATIONS = [
    ("M_q*q +", "M_qq*q +", 7, r"M_qq in the right side .* is not known; .*did you mean M_q"),
    ("(X_q - W0)*q", "(X_q - W0*q", 8, r"an operator or a closing bracket"),
    ("(X_q - W0)*q", "u*q", 8, r"u\*q is not linear in q, u"),
    ("(X_q - W0)*q", "X_q/0*q", 8, r"no finite value"),
    ("-motor + pitch", "-motor + pitch_command' + pitch", 9, r"derivatives of states only"),
    ("  \"T_motor*motor'", "  \"T_motor*q'", 9, r"two equations define q'"),
    (
        '  "T_motor*motor\' = -motor + pitch_command",\n',
        "",
        6,
        r"2 equations .* 3 states; none defines motor'",
    ),
    ('"T_motor*motor\' = -motor + pitch_command"', "3", 6, r"equations is \["),
    ('"q", "ax = ', '"qq", "ax = ', 11, r"no state 'qq'"),
    ('"q", "ax = ', '"ax = q", "ax = ', 11, r"two outputs are called ax"),
    ('pitch_command = "tau"', 'pitch = "tau"', 14, r"no input or output 'pitch'.*did you mean pitch_command"),
    ('pitch_command = "tau"', 'pitch_command = "tauu"', 14, r"no parameter or constant 'tauu'.*did you mean tau"),
    ('pitch_command = "tau"', "pitch_command = []", 14, r"delays.pitch_command contains something other"),
    ("[constants]", "[[constants]]", 16, r"constants is no table"),
    ("[constants]\n", "[constants]\nsin = 1\n", 17, r"'sin' is not allowed in an equation"),
    ("[constants]\n", "[constants]\nq = 1\n", 5, r"q means two things"),
    ('"X_q"\nunit = "1/s"', '"X_q + X_u"\nunit = "1/s"', 35, r"the ties go in a loop: X_u -> X_u"),
    ('-M_q/M_u + 2*k"', 'X_u"', None, r"the ties go in a loop: X_q -> X_u -> X_q"),
    ('-M_q/M_u + 2*k"', 'k/M_q"', 32, r"X_q is tied, and the expression 2/M_q has no finite value at M_q = 0"),
    ('-M_q/M_u + 2*k"', '-M_q/M_u"\nlower = 9', None, r"X_q = -?0 m/s \(tied to -M_q/M_u\) lies outside its bounds"),
    ('unit = "rad/(m s)"', 'unit = "rad/m s"', 23, r"several factors below in brackets"),
    ("[parameters.z]", "[parameters.y]", 11, r"z in the output .* is not known"),
]


@pytest.mark.parametrize(("old", "new", "line", "message"), SLIPS_IN_EQUATIONS)
def test_a_slip_in_an_equation_is_answered_with_its_line(old: str, new: str, line: int | None, message: str) -> None:
    assert old in EQUATIONS
    assert_refused(EQUATIONS.replace(old, new, 1), line, message)


def test_a_model_of_equations_takes_no_matrix() -> None:
    assert_refused(EQUATIONS.replace("[delays]", "F = [[1]]\n[delays]"), 13, "has both equations and F")
    assert_refused(EQUATIONS.replace("outputs = ", "# "), 1, "lacks outputs")


@pytest.mark.parametrize("text", ["", "parameters = 3\n" + GOOD[: GOOD.index("[parameters")], "[" * 5000, "\x00"])
def test_what_is_no_model_at_all_is_refused(text: str) -> None:
    assert_refused(text, 1, "not valid|lacks|no table")


AWKWARD = (
    """
"quoted.key" = 1 # [not.a.table]
dotted . 'key' = "]"
text = '''
[parameters.fake]
a = 1
'''
more = """
    + '"""a \\" b \\\\"""'
    + """
list = [ # comment ]
  [1, 2],
  "a # b", { x = 1, y = [3,
  4] },
]
[[array]]
[parameters."L p"]
value = 1979-05-27 07:32:00
[ parameters . tau ]
unit = "s"
"""
)


@pytest.mark.parametrize(
    ("path", "line"),
    [
        (("quoted.key",), 2),
        (("dotted", "key"), 3),
        (("text",), 4),
        (("list",), 9),
        (("list", 0, 1), 10),
        (("list", 1), 11),
        (("list", 2, "y"), 11),
        (("list", 2, "y", 1), 12),
        (("array",), 14),
        (("parameters", "L p", "value"), 16),
        (("parameters", "L p", "unit"), 15),
        (("parameters", "tau", "unit"), 18),
        (("nothing",), 1),
        ((), 1),
    ],
)
def test_every_value_has_its_line(path: tuple[str | int, ...], line: int) -> None:
    tomllib.loads(AWKWARD)
    assert line_of(AWKWARD, path) == line


def test_inputs_in_outputs_are_direct_terms() -> None:
    """By value: the response is that of J + C (sI - A)^-1 B behind the delay, and a step begins with J."""
    numbers = {"a": -2.0, "b": 3.0, "c": 1.5, "d": 0.7, "tau": 0.05}
    text = (
        'name = "own"\ninputs = ["u"]\nstates = ["x"]\nequations = ["x\' = a*x + b*u"]\n'
        'outputs = ["x", "y = c*x + d*u"]\ndelays = { u = "tau" }\n'
        + "".join(f'[parameters.{name}]\nvalue = {value}\nunit = "s"\n' for name, value in numbers.items())
    )
    model = from_toml(text)
    omega = np.array([0.3, 1.0, 5.0, 40.0])
    s = 1j * omega
    expected = (0.7 + 1.5 * 3.0 / (s + 2.0)) * np.exp(-0.05 * s)
    np.testing.assert_allclose(model.response(numbers, omega)[1, 0], expected, rtol=1e-12)
    np.testing.assert_allclose(model.matrices(numbers).poles(), [-2.0], rtol=1e-12)
    step = simulate_linear(model.matrices(numbers), np.ones((1, 50)), sample_rate_hz=100.0)[1]
    np.testing.assert_allclose(step[:5], 0.0, atol=1e-12)
    np.testing.assert_allclose(step[5:], 0.7 + 2.25 * (1.0 - np.exp(-0.02 * np.arange(45))), rtol=1e-9)
    # It is written as equations and read back as the same.
    again = from_toml(to_toml(model, model.parameters, {}))
    np.testing.assert_allclose(again.response(numbers, omega), model.response(numbers, omega), rtol=1e-12)
    assert answers(model).tolist() == [[True], [True]]
