"""Editors know the options of each verb: the dictionaries of keywords are those of the settings."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import pytest
from tests.api.option_types import STUB, name_of, verbs, written


def test_the_stub_is_of_the_settings_as_they_are() -> None:
    assert STUB.read_text(encoding="utf-8") == written(), "run python -m tests.api.option_types"


@pytest.mark.parametrize("verb", verbs(), ids=lambda verb: verb.__name__)
def test_a_verb_names_its_dictionary(verb: Callable[..., Any]) -> None:
    parameters = inspect.signature(verb).parameters
    (options,) = (one for one in parameters.values() if one.kind is one.VAR_KEYWORD)
    assert options.annotation == f"Unpack[{name_of(verbs()[verb])}]"
