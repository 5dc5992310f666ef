"""Models as text: what was written comes back, and every slip of the pen is answered with a sentence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.description import from_toml, to_toml
from rotorid.models.entry import Entry
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.rate import RATE_AXES, rate_model
from rotorid.models.structure import LinearStructure

FIELDS = ("name", "inputs", "states", "outputs", "M", "F", "G", "H0", "H1", "input_delays", "output_delays")
MORE = ("gain", "optional", "source", "parameters")

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
    parameters = ParameterSet(tuple(replace(p, unit=f"{hostile}/s") for p in structure.parameters))
    odd = replace(structure, name=hostile, source=f"{hostile} x", states=states, parameters=parameters)
    assert_same(from_toml(to_toml(odd, odd.parameters, {})), odd)


def test_a_greek_letter_names_a_parameter() -> None:
    structure = from_toml(GOOD)
    renamed = replace(
        structure,
        input_delays=(Entry.parse("t_ω"),),
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


SLIPS = [
    ("name = ", "nam = ", r"lacks name and has unknown keys nam"),
    ("H0 = [[1]]\n", "", r"lacks H0"),
    ('name = "lag"', 'name = "lag', r"not valid TOML"),
    ('name = "lag"', "name = 3", r"name is 3; needed: a text in quotes"),
    ('name = "lag"', 'name = "lag"\nschema = "rotorid.model/9"', r"has the schema 'rotorid.model/9'"),
    ('name = "lag"', 'name = "lag"\nsource = [1]', r"source is \[1\]"),
    ('name = "lag"', 'name = "lag"\noptional = "tau"', r"optional is 'tau'; needed: a list"),
    ('name = "lag"', 'name = "lag"\noptional = ["tou"]', r"lag names tou"),
    ('["roll_command"]', '"roll_command"', r"inputs is 'roll_command'; needed: a list of texts"),
    ('["roll_command"]', "7", r"inputs is 7"),
    ('["roll_command"]', "[7]", r"inputs is \[7\]"),
    ('states = ["p"]', 'states = ["p", "p"]', r"states is .*each once"),
    ('states = ["p"]', 'states = ["p", "motor"]', r"matrix F is 1 x 1; needed: 2 rows of 2 entries"),
    ('F = [["L_p"]]', 'F = ["L_p"]', r"F holds something else than entries"),
    ('F = [["L_p"]]', 'F = "L_p"', r"F is no list of rows"),
    ('F = [["L_p"]]', 'F = [["L_p", 0]]', r"matrix F is 1 x 2"),
    ('F = [["L_p"]]', 'F = [["L_p + L_q"]]', r"lag names L_q, which is no parameter of it; needed: one of L_p"),
    ('F = [["L_p"]]', 'F = [["L_p*L_p"]]', r"entry 'L_p\*L_p' cannot be read"),
    ('F = [["L_p"]]', "F = [[[1]]]", r"F holds something else"),
    ('F = [["L_p"]]', "F = [[true]]", r"entry 'True' cannot be read"),
    ('F = [["L_p"]]', "F = [[nan]]", r"entry 'nan' cannot be read"),
    ('F = [["L_p"]]', "F = [[0]]", r"L_p stands in no matrix"),
    ('["tau"]', '"tau"', r"input_delays holds something else"),
    ('["tau"]', '["tau", 0]', r"needed: 1 input and 1 output delays"),
    ('gain = "L_roll"', 'gain = "L_rol"', r"lag names L_rol"),
    ('gain = "L_roll"', "gain = 1", r"gain is 1"),
    ("value = 40.0", 'value = "abc"', r"value of L_roll is 'abc'; needed: a number"),
    ("value = 40.0", "value = true", r"value of L_roll is True"),
    ("value = 40.0", "value = nan", r"L_roll = nan"),
    ("value = 40.0", "value = inf", r"L_roll = inf"),
    ("value = 40.0", "value = [1]", r"value of L_roll is \[1\]"),
    ("value = 40.0", f"value = 1{'0' * 400}", r"value of L_roll is too large"),
    ("value = 40.0", f"value = 1{'0' * 5000}", r"not valid TOML"),
    ("value = 40.0", "unit2 = 40.0", r"parameter L_roll cannot be read; needed: a value"),
    ("value = 40.0", "value = 40.0\nminimum = 0", r"parameter L_roll cannot be read"),
    ("upper = 0.0", "upper = -2.0", r"L_p = -1 1 lies outside its bounds; needed: a finite value from -inf to -2"),
    ("upper = 0.0", 'upper = "0"', r"upper of L_p is '0'"),
    ("upper = 0.0", "starts = 3", r"starts of L_p is 3"),
    ("upper = 0.0", 'starts = ["a"]', r"a start of L_p is 'a'"),
    ('unit = "s"', "unit = 1", r"unit of tau is 1"),
    ('"fixed"', '"frozen"', r"tau has the status 'frozen'; needed: free, fixed, tied or dropped"),
    ('"fixed"', '["fixed"]', r"tau has the status \['fixed'\]"),
    ("[parameters.tau]\n", "[parameters.tau]\n[parameters.tau]\n", r"not valid TOML"),
]


@pytest.mark.parametrize(("old", "new", "message"), SLIPS)
def test_a_slip_is_answered_with_a_sentence(old: str, new: str, message: str) -> None:
    assert old in GOOD
    with pytest.raises(ModelError, match=message) as caught:
        from_toml(GOOD.replace(old, new, 1), where="model.toml")
    assert str(caught.value).endswith(".")
    assert caught.value.needed or caught.value.remedy


@pytest.mark.parametrize("text", ["", "parameters = 3\n" + GOOD[: GOOD.index("[parameters")], "[" * 5000, "\x00"])
def test_what_is_no_model_at_all_is_refused(text: str) -> None:
    with pytest.raises(ModelError):
        from_toml(text)
