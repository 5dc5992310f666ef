"""Reading expressions: a small recursive descent that says at which column what was needed."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

from rotorid.errors import ModelError
from rotorid.models.expression import FUNCTIONS, Expression

_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
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
            raise self.error("a name without a prime; derivatives stand in equations only", token)
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
        return ModelError(f"the expression {shown!r} cannot be read: {came} came at column {at.column}", needed=needed)
