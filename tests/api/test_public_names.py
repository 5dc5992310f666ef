"""The public names: importable, documented down to every argument, and deaf to misspelt keywords."""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Mapping
from typing import Any

import pytest
from pydantic import ValidationError

import rotorid
from rotorid.documents.base import FindingDocument
from rotorid.errors import RotoridError

PUBLIC = {name: getattr(rotorid, name) for name in rotorid.__all__}  # type: ignore[attr-defined]
FUNCTIONS = [name for name, thing in PUBLIC.items() if inspect.isfunction(thing)]
VALUES = [name for name, thing in PUBLIC.items() if dataclasses.is_dataclass(thing)]
ERRORS = [name for name, thing in PUBLIC.items() if isinstance(thing, type) and issubclass(thing, RotoridError)]
COLLECTIONS = ["Findings", "Maneuvers", "ParameterSet"]
"""Of values: constructed from them alone."""


ONE_SENTENCE = {"rate_model"}
"""Functions of one argument that their first sentence says."""


def documented_parameters(thing: Any) -> set[str]:
    """Names in the Parameters section of a numpydoc docstring."""
    text = inspect.cleandoc(thing.__doc__ or "")
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\S[^\n]*\n-{3,}$|\Z)", text, re.DOTALL | re.MULTILINE)
    names = re.findall(r"^((?:\*\*)?\w+(?:, \w+)*)$", section[1] if section else "", re.MULTILINE)
    return {name.removeprefix("**") for line in names for name in line.split(", ")}


def parameters_of(name: str) -> Mapping[str, inspect.Parameter]:
    """Parameters as they are written: fields of settings, shown in place of ``**options``, are documented there."""
    return inspect.signature(inspect.unwrap(PUBLIC[name])).parameters


def test_every_public_name_is_a_function_a_value_or_an_error() -> None:
    assert sorted(FUNCTIONS + VALUES + ERRORS + COLLECTIONS) == sorted(rotorid.__all__)  # type: ignore[attr-defined]
    assert sorted(rotorid.__all__) == list(rotorid.__all__)  # type: ignore[attr-defined]
    assert set(rotorid.__all__) <= set(dir(rotorid))  # type: ignore[attr-defined]


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="identfy"):
        _ = rotorid.identfy  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", rotorid.__all__)  # type: ignore[attr-defined]
def test_is_documented(name: str) -> None:
    first_line = (PUBLIC[name].__doc__ or "").split("\n")[0]
    assert first_line.endswith((".", ","))
    assert not first_line.startswith(f"{name}(")  # what dataclass writes where nobody did


@pytest.mark.parametrize("name", sorted({*FUNCTIONS, *VALUES} - ONE_SENTENCE))
def test_every_argument_is_documented(name: str) -> None:
    assert documented_parameters(PUBLIC[name]) == set(parameters_of(name))


@pytest.mark.parametrize("name", FUNCTIONS + VALUES + ERRORS)
def test_misspelt_keyword_is_refused(name: str) -> None:
    if inspect.isabstract(PUBLIC[name]):
        pytest.skip("its subclasses are constructed")
    # Where options follow by keyword, they are looked at when all else is there.
    parameters = parameters_of(name).values()
    takes_options = any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters)
    needed = [parameter for parameter in parameters if takes_options and parameter.default is parameter.empty]
    given = [()] * sum(parameter.kind is parameter.POSITIONAL_OR_KEYWORD for parameter in needed)
    named = {parameter.name: () for parameter in needed if parameter.kind is parameter.KEYWORD_ONLY}
    with pytest.raises(TypeError, match="misspelt"):
        PUBLIC[name](*given, **named, misspelt=1)


@pytest.mark.parametrize("name", VALUES)
def test_value_objects_are_frozen_and_keyword_only(name: str) -> None:
    assert PUBLIC[name].__dataclass_params__.frozen
    assert all(field.kw_only for field in dataclasses.fields(PUBLIC[name]))


def test_misspelt_field_of_a_document_is_refused() -> None:
    with pytest.raises(ValidationError, match="misspelt"):
        FindingDocument(kind="gap", severity="info", where="p", message="A gap.", misspelt=1)  # type: ignore[call-arg]


@pytest.mark.parametrize("name", ERRORS)
def test_errors_say_what_came_what_was_needed_and_what_to_do(name: str) -> None:
    error = PUBLIC[name]("a cat came", needed="a dog", remedy="ask a neighbor")
    expected = "this needs" if name == "InsufficientDataError" else "expected"
    assert str(error) == f"a cat came; {expected} a dog; ask a neighbor."
    assert (error.came, error.needed, error.remedy) == ("a cat came", "a dog", "ask a neighbor")
    assert error.exit_code == (1 if name == "InsufficientDataError" else 2)
