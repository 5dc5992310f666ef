"""Parameter sets: values never without bounds, ties in any order, derivatives through chains of them."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.expression import Expression
from rotorid.models.parameter import Parameter, ParameterSet, TieError


def three() -> ParameterSet:
    return ParameterSet(
        (
            Parameter(name="L_p", value=-1.0, unit="1/s", upper=0.0),
            Parameter(name="tau_roll", value=0.01, unit="s", status="fixed"),
            Parameter(name="L_roll", value=50.0, unit="rad/s^2"),
        )
    )


def chain() -> ParameterSet:
    """Ties written before what they are tied to: one nonlinear, one of a tie."""
    return ParameterSet(
        (
            Parameter(name="end", unit="1", tied=Expression.parse("middle*scale")),
            Parameter(name="middle", unit="1", tied=Expression.parse("sqrt(start) + 2*held")),
            Parameter(name="start", value=4.0, unit="1", lower=0.0),
            Parameter(name="scale", value=3.0, unit="1"),
            Parameter(name="held", value=0.5, unit="1", status="fixed"),
        )
    )


def test_only_free_parameters_are_packed() -> None:
    parameters = three()
    assert parameters.free == ("L_p", "L_roll")
    np.testing.assert_array_equal(parameters.pack(), [-1.0, 50.0])
    moved = parameters.unpack(np.array([-2.0, 60.0]))
    assert moved.values == {"L_p": -2.0, "tau_roll": 0.01, "L_roll": 60.0}
    assert moved["L_roll"] == Parameter(name="L_roll", value=60.0, unit="rad/s^2")
    assert parameters == three()
    with pytest.raises(ValueError, match="zip"):
        parameters.unpack(np.array([-2.0]))


def test_every_change_gives_a_new_set() -> None:
    parameters = three()
    assert parameters.fix("L_roll", 40.0)["L_roll"].status == "fixed"
    assert parameters.drop("L_p")["L_p"].value == 0.0
    assert parameters.drop("L_p").free == ("L_roll",)
    assert parameters.tie("L_p", "-L_roll").values["L_p"] == -50.0
    assert parameters == three()


@pytest.mark.parametrize("change", ["fix", "drop", "tie"])
def test_a_change_can_be_undone_at_its_present_value(change: str) -> None:
    arguments = {"fix": (40.0,), "drop": (), "tie": ("-20*L_p",)}[change]
    changed = getattr(three(), change)("L_roll", *arguments)
    assert changed.free == ("L_p",)
    again = changed.free_again("L_roll")
    assert again.free == ("L_p", "L_roll")
    assert again["L_roll"].tied is None
    assert again.values == changed.values


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(ModelError, match="did you mean tau_roll"):
        three()["tau_rol"]
    with pytest.raises(ModelError, match="no parameter 'x'"):
        three().with_values({"x": 1.0})
    with pytest.raises(ModelError, match="did you mean L_roll"):
        three().only(["L_rol"])


@pytest.mark.parametrize("value", [0.5, float("nan"), float("-inf")])
def test_a_value_outside_its_bounds_is_refused(value: float) -> None:
    with pytest.raises(ModelError, match=r"L_p = .* outside its bounds; expected a finite value from -inf to 0"):
        three().with_values({"L_p": value})
    with pytest.raises(ModelError, match="outside its bounds"):
        three().unpack(np.array([value, 1.0]))


def test_a_name_stands_once() -> None:
    with pytest.raises(ModelError, match="two parameters have one name, L_p"):
        ParameterSet((*three().parameters, Parameter(name="L_p", value=0.0, unit="1/s")))


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"lower": 1.0, "upper": 0.0}, "the bounds of x go from 1 to 0"),
        ({"lower": float("nan")}, "the bounds of x"),
        ({"lower": 1.0}, "x = 0 1 lies outside its bounds"),
        ({"status": "tied"}, "x is tied and not tied to an expression"),
        ({"status": "fixed", "tied": Expression.parse("y")}, "x is fixed and tied to an expression"),
        ({"unit": "deg/s"}, "the unit of x is 'deg/s'.*give its numbers in rad/s"),
        ({"unit": "parsec"}, "the unit of x is 'parsec'"),
    ],
)
def test_a_parameter_that_contradicts_itself_is_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Parameter(**{"name": "x", "unit": "1", **fields})  # type: ignore[arg-type]


def test_ties_are_computed_in_any_order() -> None:
    assert chain().values == {"end": 9.0, "middle": 3.0, "start": 4.0, "scale": 3.0, "held": 0.5}
    assert chain().free == ("start", "scale")
    assert chain()["end"].status == "tied"
    moved = chain().unpack(np.array([9.0, -1.0]))
    assert moved.values == {"end": -4.0, "middle": 4.0, "start": 9.0, "scale": -1.0, "held": 0.5}
    assert moved["end"].value == -4.0


def test_directions_follow_the_chain_rule() -> None:
    # d end / d start = scale / (2 sqrt(start)), d end / d scale = middle.
    expected = [[0.75, 3.0], [0.25, 0.0], [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]
    np.testing.assert_allclose(chain().directions, expected, rtol=1e-15)
    moved = chain().unpack(np.array([16.0, 2.0]))
    np.testing.assert_allclose(moved.directions[:2], [[0.25, 5.0], [0.125, 0.0]], rtol=1e-15)
    plain = three().directions
    np.testing.assert_array_equal(plain, [[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    assert not plain.flags.writeable


def test_directions_against_the_complex_step() -> None:
    texts = {"b": "a**2*sin(c)", "d": "b/c - a", "e": "exp(-d)*b", "f": "0.5*e - 2"}
    free = {"a": 0.7, "c": 1.3}
    parameters = ParameterSet(
        [
            *(Parameter(name=name, unit="1", tied=Expression.parse(text)) for name, text in reversed(texts.items())),
            *(Parameter(name=name, value=value, unit="1") for name, value in free.items()),
        ]
    )
    for column, name in enumerate(parameters.free):
        values: dict[str, complex] = {**free, name: free[name] + 1e-30j}
        for tied, text in texts.items():
            values[tied] = Expression.parse(text).evaluate(values)
        exact = [np.imag(values[one]) / 1e-30 for one in parameters.names]
        np.testing.assert_allclose(parameters.directions[:, column], exact, rtol=1e-13)


@pytest.mark.parametrize(
    ("ties", "message", "at"),
    [
        ({"a": "a"}, r"the ties go in a loop: a -> a;", "a"),
        ({"a": "2*b", "b": "c", "c": "a - 1"}, r"the ties go in a loop: a -> b -> c -> a;", "a"),
        ({"d": "a", "a": "b", "b": "a"}, r"loop: a -> b -> a;", "a"),
        ({"a": "bb"}, r"a is tied to 'bb', which is no parameter; expected one of a, b, c, d; did you mean b\?", "a"),
    ],
)
def test_ties_that_cannot_stand_are_refused(ties: dict[str, str], message: str, at: str) -> None:
    parameters = [
        Parameter(name=name, unit="1", tied=Expression.parse(ties[name]) if name in ties else None) for name in "abcd"
    ]
    with pytest.raises(TieError, match=message) as caught:
        ParameterSet(parameters)
    assert caught.value.parameter == at


def test_long_chains_of_ties_are_no_deep_recursion() -> None:
    links = [Parameter(name=f"p{k}", unit="1", tied=Expression.parse(f"p{k + 1} + p{k + 1}")) for k in range(1000)]
    parameters = ParameterSet([*links, Parameter(name="p1000", value=1.0, unit="1")])
    assert parameters.values["p0"] == 2.0**1000
    assert parameters.directions[0, 0] == 2.0**1000


def test_a_tied_value_outside_its_bounds_is_refused() -> None:
    parameters = ParameterSet(
        [
            Parameter(name="a", value=1.0, unit="1"),
            Parameter(name="b", unit="s", upper=3.0, tied=Expression.parse("2*a")),
            Parameter(name="c", unit="1", tied=Expression.parse("1/(a - 5)")),
        ]
    )
    with pytest.raises(ModelError, match=r"b = 4 s \(tied to 2\*a\) lies outside its bounds"):
        parameters.unpack(np.array([2.0]))
    with pytest.raises(ModelError, match=r"c is tied, and the expression 1/\(a - 5\) has no finite value at a = 5"):
        parameters.unpack(np.array([5.0]))
    root = ParameterSet(
        [Parameter(name="a", unit="1"), Parameter(name="r", unit="1", tied=Expression.parse("sqrt(a)"))]
    )
    with pytest.raises(ModelError, match="r is tied and has no derivative with respect to a"):
        _ = root.directions


def test_a_value_for_a_tied_parameter_must_be_that_of_its_tie() -> None:
    parameters = three().tie("L_p", "-L_roll/10")
    assert parameters.with_values({"L_roll": 20.0, "L_p": -2.0}).values["L_p"] == -2.0
    with pytest.raises(ModelError, match=r"L_p = -3 was given and its tie -L_roll/10 is -2"):
        parameters.with_values({"L_roll": 20.0, "L_p": -3.0})


def test_ties_may_name_constants() -> None:
    parameters = ParameterSet(three().parameters, {"g": 10.0}).tie("L_p", "-g*L_roll")
    assert parameters.values["L_p"] == -500.0
    assert parameters.with_constants({"g": 2.0}).values["L_p"] == -100.0
    assert parameters.fix("tau_roll", 0.2).unpack(np.array([1.0])).values["L_p"] == -10.0
    assert parameters.only(["L_p"]).names == ("L_p", "L_roll")


def test_a_part_of_a_set_keeps_what_its_ties_need() -> None:
    assert chain().only(["end"]).names == ("end", "middle", "start", "scale", "held")
    assert chain().only(["middle"]).names == ("middle", "start", "held")
    assert chain().only(["scale"]).names == ("scale",)


def test_sets_are_values() -> None:
    parameters = ParameterSet(chain().parameters, {"g": 9.8}).unpack(np.array([1.0, 2.0]))
    again = pickle.loads(pickle.dumps(parameters))
    assert again == parameters
    assert hash(again) == hash(parameters)
    assert dict(again.constants) == {"g": 9.8}
    assert again != chain()
    assert "middle" in repr(again)
