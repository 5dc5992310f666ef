"""Expressions over named numbers, written as one would on paper: ``-g*cos(theta0)``, ``2.5*L_p - 1``, ``k*D**2/J``.

Values, exact derivatives and texts of one tree of sums, products, quotients, powers and a few functions. Texts are read
by recursive descent, which knows at which column what was needed; they are never evaluated. Python's own parser would
not do: it does not say what was needed, refuses names that engineers use (``lambda``) and numbers such as ``007``,
takes one letter for another (µ for μ), and fails on sums of some thousand terms.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np

from rotorid.errors import ModelError

Kind: TypeAlias = Literal["number", "name", "sum", "product", "quotient", "power", "negative", "function"]


def _real_abs(value: Any) -> Any:
    """The absolute value, continued from the real axis, so that a complex step through it stays exact."""
    return np.where(np.real(value) < 0.0, -value, value)[()]


_SCALAR: Mapping[str, Callable[[float], float]] = {
    "sqrt": math.sqrt,
    "abs": abs,
    "exp": math.exp,
    "log": math.log,
    "sin": math.sin,
    "cos": math.cos,
    "tan": math.tan,
    "sign": lambda value: math.copysign(1.0, value) if value else 0.0,
}
_GENERAL: Mapping[str, Callable[[Any], Any]] = {
    "sqrt": np.sqrt,
    "abs": _real_abs,
    "exp": np.exp,
    "log": np.log,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "sign": lambda value: np.sign(np.real(value)),
}
FUNCTIONS = tuple(_SCALAR)


@dataclass(frozen=True, slots=True, repr=False)
class Expression:
    """An immutable expression; ``Expression()`` is zero.

    Build one with :meth:`parse`, :meth:`symbol`, :meth:`constant` and the operators ``+ - * / **``. Zeros and ones fold
    and signs move out of products; nothing else is rearranged, so that what was written stays recognizable.

    Parameters
    ----------
    kind
        What stands at the top.
    operands
        What it works on.
    number
        Value of a number.
    name
        Symbol of a name, or name of a function.

    Examples
    --------
    >>> entry = Expression.parse("-g*cos(theta0)")
    >>> entry.evaluate({"g": 9.80665, "theta0": 0.0})
    -9.80665
    >>> str(entry.derivative("theta0"))
    'g*sin(theta0)'
    """

    kind: Kind = "number"
    operands: tuple[Expression, ...] = ()
    number: float = 0.0
    name: str = ""
    depth: int = field(init=False, compare=False)
    """Longest chain of operations inside one another."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "depth", 1 + max((operand.depth for operand in self.operands), default=0))

    @classmethod
    def parse(cls, text: str | float) -> Expression:
        """Read a number or a text.

        Parameters
        ----------
        text
            A number, or an expression of numbers, names, ``+ - * / **``, brackets and the functions ``sqrt``, ``abs``,
            ``exp``, ``log``, ``sin``, ``cos``, ``tan`` and ``sign``.

        Raises
        ------
        ModelError
            The text is no such expression, or a number in it is not finite. It says at which column what was needed.

        Examples
        --------
        >>> str(Expression.parse("2 * (L_p - 1)"))
        '2*(L_p - 1)'
        """
        return cls.constant(text) if isinstance(text, (int, float)) else parse_expression(text)

    @classmethod
    def constant(cls, value: float) -> Expression:
        """A finite number."""
        if isinstance(value, bool) or not abs(value) <= sys.float_info.max:
            raise ModelError(f"{str(value)[:40]} cannot be read as an expression", needed="a finite number or a text")
        return cls(number=float(value) + 0.0)

    @classmethod
    def symbol(cls, name: str) -> Expression:
        """A name by itself."""
        return cls(kind="name", name=name)

    @property
    def is_zero(self) -> bool:
        return self.kind == "number" and self.number == 0.0

    @property
    def names(self) -> frozenset[str]:
        """Every name that stands in the expression."""
        if self.kind == "name":
            return frozenset((self.name,))
        return frozenset().union(*(operand.names for operand in self.operands))

    def __add__(self, other: Expression | float) -> Expression:
        terms = [
            term
            for side in (self, _expression(other))
            for term in (side.operands if side.kind == "sum" else (side,))
            if not term.is_zero
        ]
        if len(terms) > 1:
            return Expression(kind="sum", operands=tuple(terms))
        return terms[0] if terms else Expression()

    def __neg__(self) -> Expression:
        if self.kind == "number":
            return Expression(number=0.0 - self.number)
        return self.operands[0] if self.kind == "negative" else Expression(kind="negative", operands=(self,))

    def __sub__(self, other: Expression | float) -> Expression:
        return self + -_expression(other)

    def __mul__(self, other: Expression | float) -> Expression:
        (expression, minus), (two, turned) = self._sign(), _expression(other)._sign()
        if expression.is_zero or two.is_zero:
            return Expression()
        if expression == _ONE or two == _ONE:
            plain = two if expression == _ONE else expression
        else:
            plain = Expression(kind="product", operands=(expression, two))
        return plain if minus == turned else -plain

    def __truediv__(self, other: Expression | float) -> Expression:
        (expression, minus), (two, turned) = self._sign(), _expression(other)._sign()
        plain = (
            expression if expression.is_zero or two == _ONE else Expression(kind="quotient", operands=(expression, two))
        )
        return plain if minus == turned else -plain

    def __pow__(self, other: Expression | float) -> Expression:
        exponent = _expression(other)
        if exponent.is_zero:
            return _ONE
        return self if exponent == _ONE else Expression(kind="power", operands=(self, exponent))

    def _sign(self) -> tuple[Expression, bool]:
        """The expression without the minus sign in front of it, and whether there was one."""
        negative = self.kind == "negative" or (self.kind == "number" and self.number < 0.0)
        return (-self, True) if negative else (self, False)

    def call(self, function: str) -> Expression:
        """A function of the expression, such as ``sqrt``."""
        return Expression(kind="function", operands=(self,), name=function)

    def evaluate(self, values: Mapping[str, Any]) -> Any:
        """The value at given values of the names.

        Parameters
        ----------
        values
            Numbers, complex numbers or arrays that broadcast against each other. Complex ones continue the expression
            from the real axis, ``abs`` too, so that complex steps are exact.

        Raises
        ------
        ModelError
            A name has no value, or the expression has none there: a division by zero, a root of a negative number.
        """
        try:
            with np.errstate(all="ignore"):
                result = self._evaluate(values)
        except KeyError as error:
            raise ModelError(f"{error} in {self} has no value", needed="a value for every name") from None
        except (ArithmeticError, ValueError):
            result = math.nan
        if not np.all(np.isfinite(result)):
            at = ", ".join(f"{name} = {values[name]}" for name in sorted(self.names))
            came = f"the expression {self} has no finite value" + (f" at {at}" if at else "")
            raise ModelError(came, needed="a finite number")
        return result

    def _evaluate(self, values: Mapping[str, Any]) -> Any:
        if self.kind == "number":
            return self.number
        if self.kind == "name":
            value = values[self.name]
            return float(value) if isinstance(value, (int, float)) else value
        operands = [operand._evaluate(values) for operand in self.operands]
        if self.kind == "function":
            (value,) = operands
            return _SCALAR[self.name](value) if isinstance(value, float) else _GENERAL[self.name](value)
        return operate(self.kind, operands)

    def derivative(self, name: str) -> Expression:
        """The exact derivative with respect to one name.

        That of ``abs(x)`` is ``sign(x)``, zero at zero; where ``abs`` has its kink, a product such as ``x*abs(x)`` is
        smooth all the same.
        """
        if self.kind in ("number", "name"):
            return _ONE if self.kind == "name" and self.name == name else Expression()
        operands = self.operands
        slopes = tuple(operand.derivative(name) for operand in operands)
        if self.kind == "sum":
            return sum(slopes, Expression())
        if self.kind == "negative":
            return -slopes[0]
        if self.kind == "product":
            return slopes[0] * operands[1] + operands[0] * slopes[1]
        if self.kind == "quotient":
            return slopes[0] / operands[1] - operands[0] * slopes[1] / operands[1] ** 2.0
        if self.kind == "power":
            return _power_derivative(*operands, *slopes)
        return Expression() if slopes[0].is_zero else _SLOPES[self.name](operands[0]) * slopes[0]

    def substitute(self, values: Mapping[str, Expression | float]) -> Expression:
        """The expression with some names replaced."""
        if self.kind == "name":
            return _expression(values.get(self.name, self))
        operands = tuple(operand.substitute(values) for operand in self.operands)
        if operands == self.operands:
            return self
        if self.kind == "function":
            return operands[0].call(self.name)
        return sum(operands, Expression()) if self.kind == "sum" else operate(self.kind, operands)

    def linear_in(self, symbols: Set[str]) -> tuple[Expression, dict[str, Expression]]:
        """The part without some names, and the factor of each of them that stands in the expression.

        Parameters
        ----------
        symbols
            Names in which the expression should be linear.

        Raises
        ------
        ModelError
            It is not; the part where two of them meet is named.

        Examples
        --------
        >>> rest, factors = Expression.parse("(X_q - W0)*q + 2").linear_in({"q"})
        >>> str(rest), str(factors["q"])
        ('2', 'X_q - W0')
        """
        if not self.names & symbols:
            return self, {}
        if self.kind == "name":
            return Expression(), {self.name: _ONE}
        if self.kind == "sum":
            return _added([operand.linear_in(symbols) for operand in self.operands])
        if self.kind == "negative":
            return _scaled(self.operands[0].linear_in(symbols), lambda factor: -factor)
        if self.kind in ("product", "quotient"):
            expression, two = self.operands
            if not two.names & symbols:
                divide = self.kind == "quotient"
                return _scaled(expression.linear_in(symbols), lambda factor: factor / two if divide else factor * two)
            if self.kind == "product" and not expression.names & symbols:
                return _scaled(two.linear_in(symbols), lambda factor: expression * factor)
        came = ", ".join(sorted(self.names & symbols))
        raise ModelError(f"{self} is not linear in {came}", needed="a sum in which each stands once, times a factor")

    def as_affine(self) -> tuple[float, dict[str, float]] | None:
        """The constant and the factor of each name, where the expression is such a sum.

        Examples
        --------
        >>> Expression.parse("2.5*L_p - 1").as_affine()
        (-1.0, {'L_p': 2.5})
        >>> Expression.parse("a*b").as_affine() is None
        True
        """
        try:
            rest, factors = self.linear_in(self.names)
        except ModelError:
            return None
        return rest.evaluate({}), {name: factor.evaluate({}) for name, factor in factors.items()}

    def __repr__(self) -> str:
        return f"Expression.parse({str(self)!r})"

    def __str__(self) -> str:
        if self.kind == "number":
            return repr(self.number).removesuffix(".0")
        if self.kind == "name":
            return self.name
        if self.kind == "function":
            return f"{self.name}({self.operands[0]})"
        if self.kind == "negative":
            return "-" + self.operands[0]._within("sum")
        if self.kind == "sum":
            signed = [term._sign() for term in self.operands]
            text = " ".join(f"{'-' if minus else '+'} {term._within('sum')}" for term, minus in signed)
            return text[2:] if text.startswith("+") else "-" + text[2:]
        expression, two = self.operands
        if self.kind == "power":
            exponent = str(two) if two.kind == "number" else two._within(*_OPERATIONS)
            base = expression._within(*_OPERATIONS) if expression._sign()[1] is False else f"({expression})"
            return f"{base}**{exponent}"
        sign = "*" if self.kind == "product" else "/"
        return f"{expression._within('sum', 'negative')}{sign}{two._within('sum', 'negative', 'product', 'quotient')}"

    def _within(self, *bracketed: Kind) -> str:
        return f"({self})" if self.kind in bracketed else str(self)


_ONE = Expression(number=1.0)
_OPERATIONS: tuple[Kind, ...] = ("sum", "product", "quotient", "power", "negative")

_SLOPES: Mapping[str, Callable[[Expression], Expression]] = {
    "sqrt": lambda x: _ONE / (x.call("sqrt") * 2.0),
    "abs": lambda x: x.call("sign"),
    "exp": lambda x: x.call("exp"),
    "log": lambda x: _ONE / x,
    "sin": lambda x: x.call("cos"),
    "cos": lambda x: -x.call("sin"),
    "tan": lambda x: _ONE / x.call("cos") ** 2.0,
    "sign": lambda _: Expression(),
}


def scalar_function(name: str) -> Callable[[float], float]:
    """A function of one real number; it raises ValueError or OverflowError where there is no value."""
    return _SCALAR[name]


def real_power(base: float, exponent: float) -> float:
    """A real power; ValueError or OverflowError where there is none."""
    return math.pow(base, exponent)


def operate(kind: Kind, operands: Any) -> Any:
    """One operation on numbers, arrays or expressions."""
    if kind == "sum":
        total = operands[0]
        for operand in operands[1:]:
            total = total + operand
        return total
    if kind == "negative":
        return -operands[0]
    one, two = operands
    if kind == "product":
        return one * two
    if kind == "quotient":
        return one / two
    return real_power(one, two) if isinstance(one, float) and isinstance(two, float) else one**two


def _expression(value: Expression | float) -> Expression:
    return value if isinstance(value, Expression) else Expression.constant(value)


def _power_derivative(base: Expression, exponent: Expression, slope: Expression, turn: Expression) -> Expression:
    if turn.is_zero:
        less = Expression.constant(exponent.number - 1.0) if exponent.kind == "number" else exponent - 1.0
        return Expression() if slope.is_zero else exponent * base**less * slope
    whole = base**exponent
    return whole * (turn * base.call("log") + exponent * slope / base)


_Linear: TypeAlias = tuple[Expression, dict[str, Expression]]


def _added(parts: list[_Linear]) -> _Linear:
    rest: Expression = sum((part for part, _ in parts), Expression())
    factors: dict[str, Expression] = {}
    for _, each in parts:
        for name, factor in each.items():
            factors[name] = factors.get(name, Expression()) + factor
    return rest, factors


def _scaled(part: _Linear, scale: Callable[[Expression], Expression]) -> _Linear:
    return scale(part[0]), {name: scale(factor) for name, factor in part[1].items()}


_TOKEN = re.compile(
    # Spaces between them are passed over by the search itself.
    r"(?:(?P<number>(?:[0-9]++\.?[0-9]*+|\.[0-9]++)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[^\W\d]\w*'?)|(?P<sign>\*\*|[-+*/()])|(?P<other>\S))"
)
_NAME = re.compile(r"[^\W\d]\w*")
_LONGEST = 10_000
_DEEPEST = 60
_SHOWN = 60


def is_symbol(name: str) -> bool:
    """Whether a name can stand in an expression by itself.

    Examples
    --------
    >>> is_symbol("M_q"), is_symbol("the angle"), is_symbol("sin")
    (True, False, False)
    """
    return _NAME.fullmatch(name) is not None and name.isidentifier() and name not in FUNCTIONS


class _Token(NamedTuple):
    kind: str
    text: str
    column: int


def parse_expression(text: str, *, derivatives: bool = False) -> Expression:
    """The expression that a text says.

    Parameters
    ----------
    text
        What was written.
    derivatives
        Whether names may carry a prime, as in equations: ``q'`` is then a name of its own.

    Raises
    ------
    ModelError
        The text is no expression; column and what was needed are named.

    Examples
    --------
    >>> sorted(parse_expression("u' + g*theta", derivatives=True).names)
    ['g', 'theta', "u'"]
    """
    if len(text) > _LONGEST:
        raise ModelError(f"an expression of {len(text)} characters cannot be read", needed=f"at most {_LONGEST}")
    return _Reading(text, derivatives).whole()


class _Reading:
    """One text on its way to an expression."""

    def __init__(self, text: str, derivatives: bool) -> None:
        self.text = text
        self.derivatives = derivatives
        self.tokens = [
            _Token(match.lastgroup or "other", match[match.lastgroup or 0], match.start(match.lastgroup or 0) + 1)
            for match in _TOKEN.finditer(text)
        ]
        self.tokens.append(_Token("end", "the end", len(text.rstrip()) + 1))
        self.position = 0
        self.nesting = 0

    def whole(self) -> Expression:
        result = self.sum()
        if self.token.kind != "end":
            raise self.error("an operator such as + or *, or the end")
        return result

    @property
    def token(self) -> _Token:
        return self.tokens[self.position]

    def take(self, *signs: str) -> str:
        """The next sign where it is one of these, else nothing."""
        token = self.token
        if token.kind != "sign" or token.text not in signs:
            return ""
        self.position += 1
        return token.text

    def sum(self) -> Expression:
        result = self.term()
        while sign := self.take("+", "-"):
            term = self.term()
            result = result + term if sign == "+" else result - term
        return result

    def term(self) -> Expression:
        result = self.signed()
        while sign := self.take("*", "/"):
            factor = self.signed()
            result = self.bounded(result * factor if sign == "*" else result / factor)
        return result

    def signed(self) -> Expression:
        self.nesting += 1
        if self.nesting > _DEEPEST:
            raise self.error(f"at most {_DEEPEST} levels of brackets and signs")
        sign = self.take("+", "-")
        result = self.signed() if sign else self.power()
        self.nesting -= 1
        return -result if sign == "-" else result

    def power(self) -> Expression:
        base = self.atom()
        return self.bounded(base ** self.signed()) if self.take("**") else base

    def atom(self) -> Expression:
        token = self.token
        if token.kind == "number":
            self.position += 1
            value = float(token.text)
            if not math.isfinite(value):
                raise self.error("a finite number", token)
            return Expression.constant(value)
        if token.kind == "name":
            self.position += 1
            return self.named(token)
        if self.take("("):
            result = self.sum()
            self.close()
            return result
        raise self.error("a number, a name or an opening bracket")

    def named(self, token: _Token) -> Expression:
        if token.text in FUNCTIONS:
            if not self.take("("):
                raise self.error(f"an opening bracket after {token.text}")
            result = self.bounded(self.sum().call(token.text))
            self.close()
            return result
        if not token.text.rstrip("'").isidentifier():
            raise self.error("a name of letters, digits and underscores; powers are written x**2", token)
        if token.text.endswith("'") and not self.derivatives:
            raise self.error("a name without a prime; derivatives belong in equations only", token)
        if self.token.text == "(":
            raise self.error(f"one of the functions {', '.join(FUNCTIONS)}, or an operator after the name", token)
        return Expression.symbol(token.text)

    def close(self) -> None:
        if not self.take(")"):
            raise self.error("an operator or a closing bracket")

    def bounded(self, result: Expression) -> Expression:
        if result.depth > _DEEPEST:
            raise self.error(f"at most {_DEEPEST} operations inside one another")
        return result

    def error(self, needed: str, token: _Token | None = None) -> ModelError:
        at = token or self.token
        shown = self.text if len(self.text) <= _SHOWN else f"{self.text[:_SHOWN]}…"
        came = at.text if at.kind == "end" else repr(at.text[:_SHOWN])
        return ModelError(f"the expression {shown!r} cannot be read: {came} at column {at.column}", needed=needed)
