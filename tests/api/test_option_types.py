"""Editors know the options of each verb: the dictionaries of keywords are those of the settings."""

from __future__ import annotations

import inspect

import pytest
from tests.api.option_types import STUB, name_of, verbs, written

import rotorid


def test_the_stub_is_of_the_settings_as_they_are() -> None:
    assert STUB.read_text(encoding="utf-8") == written(), "run python -m tests.api.option_types"


@pytest.mark.parametrize("name", verbs())
def test_a_verb_names_its_dictionary(name: str) -> None:
    parameters = inspect.signature(inspect.unwrap(getattr(rotorid, name))).parameters
    (options,) = (one for one in parameters.values() if one.kind is one.VAR_KEYWORD)
    assert options.annotation == f"Unpack[{name_of(verbs()[name])}]"
