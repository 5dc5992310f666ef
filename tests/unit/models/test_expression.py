"""Expressions: read as written on paper, exact in their derivatives, refused where they say nothing clear."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from rotorid.errors import ModelError
from rotorid.models.compiled import Operations
from rotorid.models.expression import Expression, parse_expression

VALUES = {"a": 1.7, "b": -0.6, "c": 2.3}


@pytest.mark.parametrize(
    ("text", "written", "value"),
    [
        ("0", "0", 0.0),
        ("-9.81", "-9.81", -9.81),
        (".5", "0.5", 0.5),
        ("1e-3", "0.001", 1e-3),
        (3, "3", 3.0),
        ("a", "a", 1.7),
        (" - a ", "-a", -1.7),
        ("2.5*a - 1", "2.5*a - 1", 2.5 * 1.7 - 1.0),
        ("1 - 2*a + 3", "1 - 2*a + 3", 4.0 - 3.4),
        ("a - a", "a - a", 0.0),
        ("2*e5", "2*e5", None),
        ("lambda*in", "lambda*in", None),
        ("007", "7", 7.0),
        ("a\n  + b", "a + b", 1.1),
        ("a*2", "a*2", 3.4),
        ("2*-a", "-2*a", -3.4),
        ("--a", "a", 1.7),
        ("a/b/c", "a/b/c", 1.7 / -0.6 / 2.3),
        ("a/(b*c)", "a/(b*c)", 1.7 / (-0.6 * 2.3)),
        ("a*(b*c)", "a*(b*c)", 1.7 * (-0.6 * 2.3)),
        ("(a - b) - (c - 1)", "a - b - (c - 1)", 1.7 + 0.6 - 1.3),
        ("-a**2", "-a**2", -(1.7**2)),
        ("(-a)**2", "(-a)**2", 1.7**2),
        ("(-2)**2", "(-2)**2", 4.0),
        ("a**-2", "a**-2", 1.7**-2),
        ("c**a**2", "c**(a**2)", 2.3 ** (1.7**2)),
        ("(c**a)**2", "(c**a)**2", (2.3**1.7) ** 2),
        ("sqrt(a)/-b", "-sqrt(a)/b", np.sqrt(1.7) / 0.6),
        ("abs(b)*exp(b)*log(c)", "abs(b)*exp(b)*log(c)", 0.6 * np.exp(-0.6) * np.log(2.3)),
        ("sin(a) + cos(b) - tan(c) + sign(b)", "sin(a) + cos(b) - tan(c) + sign(b)", None),
        ("0*a + 1*b", "b", -0.6),
        ("0/a + b**1 + c**0", "b + 1", 0.4),
    ],
)
def test_what_is_written_is_read(text: str | float, written: str, value: float | None) -> None:
    expression = Expression.parse(text)
    assert str(expression) == written
    assert Expression.parse(str(expression)) == expression
    if value is not None:
        assert expression.evaluate(VALUES) == pytest.approx(value, rel=1e-15, abs=1e-15)


@pytest.mark.parametrize(
    ("text", "column", "needed"),
    [
        ("", 1, "a number, a name or an opening bracket"),
        ("  ", 1, "a number, a name or an opening bracket"),
        ("+", 2, "a number, a name or an opening bracket"),
        ("L_p L_q", 5, "an operator such as"),
        ("2 3", 3, "an operator such as"),
        ("2 L_p", 3, "an operator such as"),
        ("2e", 2, "an operator such as"),
        ("2*", 3, "a number, a name"),
        ("x -", 4, "a number, a name"),
        ("x;y", 2, "an operator such as"),
        ("a*(b + c", 9, "an operator or a closing bracket"),
        ("a)", 2, "an operator such as"),
        ("x***y", 4, "a number, a name"),
        ("1e999", 1, "a finite number"),
        ("sin", 4, "an opening bracket after sin"),
        ("sinh(x)", 1, "one of the functions sqrt, abs"),
        ("__import__('os')", 1, "one of the functions"),
        ("x.y", 2, "an operator such as"),
        ("q'", 1, "a name without a prime"),
        ("a == b", 3, "an operator such as"),
        ("x²", 1, "a name of letters, digits"),
        ("٣", 1, "a number, a name"),
        ("(" * 5000, 61, "at most 60 levels"),
        ("-" * 5000 + "a", 61, "at most 60 levels"),
        ("sqrt(" * 900, 301, "at most 60 levels"),
        ("**".join("a" * 900), 181, "at most 60 levels"),
        ("*".join("a" * 900), None, "at most 60 operations inside one another"),
    ],
)
def test_what_is_no_expression_is_refused(text: str, column: int | None, needed: str) -> None:
    with pytest.raises(ModelError, match="cannot be read") as caught:
        Expression.parse(text)
    assert caught.value.needed.startswith(needed)
    assert len(str(caught.value)) < 400
    if column is not None:
        assert f"at column {column};" in str(caught.value)


@pytest.mark.parametrize("number", [float("nan"), float("inf"), -float("inf"), True, False, 10**400])
def test_what_is_no_finite_number_is_refused(number: float) -> None:
    with pytest.raises(ModelError, match="cannot be read"):
        Expression.parse(number)


def test_a_text_without_end_is_refused() -> None:
    with pytest.raises(ModelError, match="10003 characters"):
        Expression.parse("a" + " + 1" * 2500 + " b")


def test_a_long_sum_is_no_deep_one() -> None:
    expression = Expression.parse(" + ".join(["a"] * 1000))
    assert expression.evaluate({"a": 0.5}) == 500.0
    assert expression.derivative("a").evaluate({}) == 1000.0


@pytest.mark.parametrize("number", [0.1, 1.0 / 3.0, 5e-324, 1.7976931348623157e308, 1e22, 123456789.0])
def test_numbers_keep_every_digit(number: float) -> None:
    assert Expression.parse(str(Expression.parse(number))).evaluate({}) == number
    assert Expression.parse(str(Expression.parse(-number))).evaluate({}) == -number


@pytest.mark.parametrize(
    ("text", "affine"),
    [
        ("2*a - 1", (-1.0, {"a": 2.0})),
        ("a + a - b", (0.0, {"a": 2.0, "b": -1.0})),
        ("(a - 2*b)/4 + cos(0)", (1.0, {"a": 0.25, "b": -0.5})),
        ("-(3 - a)*2", (-6.0, {"a": 2.0})),
        ("7", (7.0, {})),
        ("a*b", None),
        ("1/a", None),
        ("a**2", None),
        ("sin(a)", None),
        ("2**a", None),
    ],
)
def test_affine_expressions_are_known_as_such(text: str, affine: tuple[float, dict[str, float]] | None) -> None:
    assert Expression.parse(text).as_affine() == affine


def test_factors_of_a_linear_expression_keep_their_form() -> None:
    expression = parse_expression("(X_q - W0)*q - g*cos(theta0)*theta + theta/T - q", derivatives=True)
    rest, factors = expression.linear_in({"q", "theta"})
    assert rest.is_zero
    assert {name: str(factor) for name, factor in factors.items()} == {
        "q": "X_q - W0 - 1",
        "theta": "-g*cos(theta0) + 1/T",
    }
    with pytest.raises(ModelError, match=r"q\*theta is not linear in q, theta"):
        parse_expression("1 + 2*(q*theta)").linear_in({"q", "theta"})


@pytest.mark.parametrize(
    ("text", "values", "message"),
    [
        ("1/a", {"a": 0.0}, r"1/a has no finite value at a = 0.0"),
        ("sqrt(a)", {"a": -1.0}, r"sqrt\(a\) has no finite value at a = -1.0"),
        ("log(a)", {"a": 0.0}, "no finite value"),
        ("a**0.5", {"a": -1.0}, "no finite value"),
        ("exp(a)", {"a": 1e4}, "no finite value"),
        ("a*a", {"a": 1e300}, "no finite value"),
        ("1/a", {"a": np.array([1.0, 0.0])}, "no finite value"),
        ("1/0", {}, "1/0 has no finite value"),
        ("a + b", {"a": 1.0}, "'b' in a . b has no value"),
    ],
)
def test_an_expression_without_a_value_says_so(text: str, values: dict[str, float], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        Expression.parse(text).evaluate(values)


DERIVATIVES = [
    "a*b*c",
    "a/b + b/c",
    "a**3 - 2*a**2 + a**-1",
    "c**a",
    "a**b",
    "(a*c)**(b + 1)",
    "sqrt(a*c)",
    "abs(b)*abs(a)",
    "exp(b*a)",
    "log(a + c)",
    "sin(a)*cos(b)*tan(c/4)",
    "sqrt(a*9.8/(4*a*c**4))",
    "sign(b)*a",
    "(a + b*c)/(a - b*c)",
]


@pytest.mark.parametrize("text", DERIVATIVES)
def test_derivatives_against_the_complex_step(text: str) -> None:
    expression, step = Expression.parse(text), 1e-30
    for name in VALUES:
        stepped = expression.evaluate({**VALUES, name: VALUES[name] + 1j * step})
        exact = np.imag(stepped) / step
        assert expression.derivative(name).evaluate(VALUES) == pytest.approx(exact, rel=1e-13, abs=1e-14)


def test_arrays_are_evaluated_at_once() -> None:
    expression = Expression.parse("abs(a)*sqrt(c) + a**2/c - sign(a)")
    a, c = np.array([-1.5, 0.5, 2.0]), 2.0
    each = [expression.evaluate({"a": value, "c": c}) for value in a]
    np.testing.assert_allclose(expression.evaluate({"a": a, "c": c}), each, rtol=1e-15)


def test_a_product_with_a_kink_is_smooth_where_it_vanishes() -> None:
    slope = Expression.parse("z**2*abs(z)").derivative("z")
    assert slope.evaluate({"z": 0.0}) == 0.0


def test_shared_operations_give_what_each_expression_gives() -> None:
    expressions = [Expression.parse(text) for text in DERIVATIVES]
    both = [*expressions, *(expression.derivative("a") for expression in expressions)]
    together = Operations(both, tuple(VALUES))(list(VALUES.values()))
    np.testing.assert_allclose(together, [expression.evaluate(VALUES) for expression in both], rtol=1e-14)


def test_names_may_stand_for_expressions_before_them() -> None:
    definitions = {"b": Expression.parse("2*a"), "c": Expression.parse("b + a")}
    assert Operations([Expression.parse("c*b")], ("a", "b", "c"), definitions)([3.0, np.nan, np.nan]) == [54.0]


def test_substitution_folds_what_has_become_trivial() -> None:
    expression = Expression.parse("k*(a + b) + cos(b)")
    assert str(expression.substitute({"k": 1.0})) == "a + b + cos(b)"
    assert str(expression.substitute({"k": 0.0, "b": Expression.parse("x - y")})) == "cos(x - y)"


def test_expressions_are_values() -> None:
    expression = Expression.parse("a*(b + 1)")
    again = pickle.loads(pickle.dumps(expression))
    assert again == expression
    assert hash(again) == hash(expression)
    assert repr(expression) == "Expression.parse('a*(b + 1)')"
    with pytest.raises(AttributeError):
        expression.number = 2.0  # type: ignore[misc]
