"""Each model has one family, and what a family says of its models is what they are."""

from __future__ import annotations

import pytest

from rotorid.errors import ModelError, UsageError
from rotorid.models.families import (
    FAMILIES,
    OWN,
    RATE_AXIS,
    Channels,
    Family,
    family_of,
    known_names,
    linear,
    named_model,
    rate_model_of,
)
from rotorid.models.library import RATE_AXES, library_model, model_names, nonlinear_model


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.name)
def test_the_listed_models_of_a_family_are_its_own(family: Family) -> None:
    assert all(family_of(name) is family for name in family.names)


def test_every_file_of_the_library_has_a_family_and_is_listed_once() -> None:
    names = known_names()
    assert set(model_names()) <= set(names)
    assert len(names) == len(set(names))


def test_the_axis_of_a_rate_model_is_that_of_its_command() -> None:
    assert {name: axis.input for name, axis in RATE_AXES.items()} == {
        name: f"{axis}_command" for name, axis in RATE_AXIS.items()
    }
    assert [rate_model_of(axis) for axis in RATE_AXIS.values()] == list(RATE_AXES)


@pytest.mark.parametrize("family", [one for one in FAMILIES if one.outputs], ids=lambda family: family.name)
def test_outputs_of_which_one_is_enough_are_those_of_the_model(family: Family) -> None:
    for name, outputs in family.outputs.items():
        assert set(outputs) <= set(library_model(name).outputs)


def test_a_structure_has_the_family_of_its_name_and_a_nonlinear_one_its_own() -> None:
    assert family_of(library_model("hover.lateral")) is family_of("hover.lateral")
    assert family_of(nonlinear_model("drag.linear")).nonlinear
    with pytest.raises(UsageError, match="is nonlinear"):
        linear(nonlinear_model("drag.linear"))


def test_a_name_of_no_model_is_refused_although_its_beginning_is_that_of_a_family() -> None:
    assert family_of("rate.rol") is family_of("rate.roll")
    with pytest.raises(ModelError, match=r"did you mean rate\.roll"):
        named_model("rate.rol")


def test_a_name_with_a_line_break_has_a_family_and_is_of_no_model() -> None:
    assert family_of("my\nfolder/model.toml") is OWN
    with pytest.raises(ModelError, match="there is no model"):
        named_model("rate.roll\nrate.pitch")


def test_models_with_channels_of_their_own_are_made_by_their_name() -> None:
    for family in FAMILIES:
        if family.make is not None and family.channels == "own":
            for name in family.names:
                assert family.make(name, Channels()).name == name


@pytest.mark.parametrize("wrong", [3, None, ["rate.roll"]])
def test_what_is_no_model_is_refused_in_words(wrong: object) -> None:
    with pytest.raises(
        UsageError, match=rf"type {type(wrong).__name__} is no model; expected one name such as rate.roll"
    ):
        family_of(wrong)  # type: ignore[arg-type]
