"""Entries and parameter sets: read as one would write them on paper, and refused where they say nothing clear."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.entry import Entry, affine_tensor
from rotorid.models.parameter import Parameter, ParameterSet


@pytest.mark.parametrize(
    ("text", "constant", "terms"),
    [
        ("0", 0.0, ()),
        ("-9.81", -9.81, ()),
        (".5", 0.5, ()),
        ("1e-3", 1e-3, ()),
        (3, 3.0, ()),
        ("L_p", 0.0, (("L_p", 1.0),)),
        (" - L_p ", 0.0, (("L_p", -1.0),)),
        ("2 L_p", 0.0, (("L_p", 2.0),)),
        ("2.5*L_p - 1", -1.0, (("L_p", 2.5),)),
        ("1 - 2*a + 3", 4.0, (("a", -2.0),)),
        ("a - a", 0.0, (("a", 1.0), ("a", -1.0))),
        ("2*e5", 0.0, (("e5", 2.0),)),
    ],
)
def test_sums_are_read_as_written(text: str | float, constant: float, terms: tuple[tuple[str, float], ...]) -> None:
    assert Entry.parse(text) == Entry(constant=constant, terms=terms)


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "  ",
            "+",
            "-",
            "L_p L_q",
            "2 3",
            "2*",
            "2*-x",
            "x*2",
            "x*y",
            "2**x",
            "--x",
            "x -",
            "1/x",
            "sin(x)",
            "x;y",
        ),
        *("1e999", float("nan"), float("inf"), True, 10**400),
    ],
)
def test_what_is_no_sum_is_refused(text: str | float) -> None:
    with pytest.raises(ModelError, match="cannot be read"):
        Entry.parse(text)


def test_a_tensor_holds_constants_first_and_adds_repeated_names() -> None:
    rows = [[Entry.parse("2*a + 1"), Entry.parse("a + a - b")]]
    tensor = affine_tensor(rows, ("a", "b"), (1, 2))
    np.testing.assert_array_equal(tensor, [[[1.0, 0.0]], [[2.0, 2.0]], [[0.0, -1.0]]])
    with pytest.raises(ModelError, match="names 'b'"):
        affine_tensor(rows, ("a",), (1, 2))


def three() -> ParameterSet:
    return ParameterSet(
        (
            Parameter(name="L_p", value=-1.0, unit="1/s", upper=0.0),
            Parameter(name="tau_roll", value=0.01, unit="s", status="fixed"),
            Parameter(name="L_roll", value=50.0, unit="rad/s^2"),
        )
    )


def test_only_free_parameters_are_packed() -> None:
    parameters = three()
    assert parameters.free == ("L_p", "L_roll")
    np.testing.assert_array_equal(parameters.pack(), [-1.0, 50.0])
    moved = parameters.unpack(np.array([-2.0, 60.0]))
    assert moved.values == {"L_p": -2.0, "tau_roll": 0.01, "L_roll": 60.0}
    assert parameters == three()


def test_every_change_gives_a_new_set() -> None:
    parameters = three()
    assert parameters.fix("L_roll", 40.0)["L_roll"].status == "fixed"
    assert parameters.drop("L_p")["L_p"].value == 0.0
    assert parameters.drop("L_p").free == ("L_roll",)
    assert parameters == three()


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ModelError, match="did you mean tau_roll"):
        three()["tau_rol"]
    with pytest.raises(ModelError, match="no parameter 'x'"):
        three().with_values({"x": 1.0})


@pytest.mark.parametrize("value", [0.5, float("nan"), float("-inf")])
def test_a_value_outside_its_bounds_is_refused(value: float) -> None:
    with pytest.raises(ModelError, match="outside its bounds"):
        three().with_values({"L_p": value})


def test_a_name_stands_once() -> None:
    with pytest.raises(ModelError, match="two parameters have one name"):
        ParameterSet((*three().parameters, Parameter(name="L_p", value=0.0, unit="1/s")))
