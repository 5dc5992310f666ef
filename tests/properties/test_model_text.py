"""Properties of models as text: whatever can be written is read back as it was."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rotorid.errors import ModelError
from rotorid.models.expression import FUNCTIONS, Expression
from rotorid.models.library import rate_model
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure
from rotorid.models.toml import from_toml, to_toml

NUMBERS = st.floats(allow_nan=False, allow_infinity=False)
NAMES = st.from_regex(r"[A-Za-z_][A-Za-z_0-9]{0,8}", fullmatch=True).filter(lambda name: name not in FUNCTIONS)
TEXTS = st.text(st.characters(codec="utf-8"), max_size=20)


def expressions(leaves: st.SearchStrategy[Expression]) -> st.SearchStrategy[Expression]:
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            st.tuples(inner, inner).map(lambda pair: pair[0] + pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] - pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] * pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] / pair[1]),
            st.tuples(inner, inner).map(lambda pair: pair[0] ** pair[1]),
            inner.map(lambda one: -one),
            st.tuples(inner, st.sampled_from(FUNCTIONS)).map(lambda pair: pair[0].call(pair[1])),
        ),
        max_leaves=12,
    )


EXPRESSIONS = expressions(st.one_of(NUMBERS.map(Expression.constant), NAMES.map(Expression.symbol)))
SMALL = st.floats(0.25, 4.0)
SMOOTH = expressions(st.one_of(SMALL.map(Expression.constant), st.sampled_from("ab").map(Expression.symbol)))


@given(EXPRESSIONS)
def test_an_expression_reads_back_as_it_was_written(expression: Expression) -> None:
    assert Expression.parse(str(expression)) == expression


@given(st.text(alphabet="0123456789.eE+-*/() abL_psqrt'", max_size=14))
def test_a_text_is_read_to_the_last_sign_or_refused(text: str) -> None:
    try:
        expression = Expression.parse(text)
    except ModelError:
        return
    assert Expression.parse(str(expression)) == expression


def largest_part(expression: Expression, values: dict[str, float]) -> float:
    """The largest number on the way to the value: its rounding is what the result cannot be better than."""
    here = abs(expression.evaluate(values))
    return max([here, *(largest_part(operand, values) for operand in expression.operands)])


@given(SMOOTH, SMALL, SMALL)
@settings(max_examples=200)
def test_a_derivative_is_that_of_the_complex_step(expression: Expression, a: float, b: float) -> None:
    values = {"a": a, "b": b}
    slope = expression.derivative("a")
    try:
        analytic = slope.evaluate(values)
        size = max(largest_part(slope, values), largest_part(expression, values))
        exact = np.imag(expression.evaluate({"a": a + 1e-40j, "b": b})) / 1e-40
    except ModelError:
        assume(False)
    # Beyond, a power or a logarithm of what has almost cancelled amplifies rounding without bound.
    assume(size < 1e4 and min_distance(expression, values) > 1e-3)
    assert math.isclose(analytic, exact, rel_tol=1e-9, abs_tol=1e-9 * size)


def min_distance(expression: Expression, values: dict[str, float]) -> float:
    """How far every part stays from zero, where roots, quotients and kinks have their poles."""
    here = abs(expression.evaluate(values))
    inside = [min_distance(operand, values) for operand in expression.operands]
    return min([here if expression.kind != "number" or expression.number else 1.0, *inside])


@given(value=NUMBERS, name=TEXTS, state=TEXTS, source=TEXTS, parameter=NAMES, entry=EXPRESSIONS)
@settings(max_examples=60)
def test_a_model_reads_back_as_it_was_written(
    value: float, name: str, state: str, source: str, parameter: str, entry: Expression
) -> None:
    one, zero = Expression.parse(1), Expression()
    constants = dict.fromkeys(sorted(entry.names - {parameter}), 0.5)
    # An entry of constants alone must have a value, as a user's would.
    with contextlib.suppress(ModelError):
        entry.substitute(constants).as_affine()
        structure = LinearStructure(
            name=name,
            inputs=(f"{name}_in",),
            states=(state,),
            outputs=(source,),
            M=((one,),),
            F=((Expression.parse(-1),),),
            G=((Expression.symbol(parameter),),),
            H0=((one,),),
            H1=((entry,),),
            input_delays=(zero,),
            output_delays=(zero,),
            constants=constants,
            parameters=ParameterSet((Parameter(name=parameter, value=value, unit="rad/s^2"),)),
            gain=parameter,
            source=source,
        )
        text = to_toml(structure, structure.parameters, {parameter: abs(value)})
        check_same(structure, text)


def check_same(structure: LinearStructure, text: str) -> None:
    try:
        again = from_toml(text)
    except ModelError as error:
        raise AssertionError(text) from error
    for field in ("name", "inputs", "states", "outputs", "G", "H1", "constants", "parameters", "gain", "source"):
        assert getattr(again, field) == getattr(structure, field), field


@given(st.data())
@settings(max_examples=150)
def test_a_damaged_text_gives_a_model_or_a_sentence(data: st.DataObject) -> None:
    structure = rate_model("rate.roll")
    text = to_toml(structure, structure.parameters, {})
    start = data.draw(st.integers(0, len(text)))
    stop = data.draw(st.integers(start, min(start + 12, len(text))))
    damaged = text[:start] + data.draw(TEXTS) + text[stop:]
    # Any other error than a ModelError ends the test.
    with contextlib.suppress(ModelError):
        assert from_toml(damaged).parameters.names


@given(st.permutations(["L_roll", "L_p", "T_motor", "tau_roll"]), st.lists(NUMBERS, min_size=4, max_size=4))
def test_the_order_of_parameters_does_not_change_the_system(order: list[str], values: list[float]) -> None:
    structure = rate_model("rate.roll")
    shuffled = replace(structure, parameters=ParameterSet(tuple(structure.parameters[name] for name in order)))
    point = dict(zip(structure.parameters.names, values, strict=True))
    one, other = structure.matrices(point), shuffled.matrices(point)
    for field in ("M", "F", "G", "H0", "H1", "input_delays_s", "output_delays_s"):
        assert (getattr(one, field) == getattr(other, field)).all()
