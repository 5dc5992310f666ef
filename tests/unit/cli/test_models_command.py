"""``rotorid models``: the list, and a model as text that ``--model`` reads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid

from rotorid.models.library import (
    RATE_AXES,
    RESPONSE_MODELS,
    library_text,
    model_names,
    nonlinear_model_names,
    rate_model,
)
from rotorid.models.toml import from_toml
from rotorid.settings.resolve import resolve_model

NAMES = (*RATE_AXES, *model_names())


def test_every_name_that_the_model_option_takes_is_listed_with_what_it_is() -> None:
    ran = rotorid("models", "-v")
    assert (ran.code, ran.err) == (0, "")
    lines = {line.split()[0]: line for line in ran.out.splitlines() if line.strip()}
    for name in NAMES:
        structure = resolve_model(name)
        line = lines[name]
        assert f"{' '.join(structure.inputs)} -> {' '.join(structure.outputs)}" in line
        assert f" {len(structure.parameters)} " in line
        assert line.rstrip().endswith(".")
    assert {"transfer:m/n", "black_box:N", "response.*"} <= lines.keys()


def test_what_a_model_is_stands_first_in_its_file() -> None:
    listed = {one["name"]: one["about"] for one in json.loads(rotorid("models", "--json").out)["models"]}
    for name in model_names():
        assert listed[name].endswith(".")
        assert library_text(name).replace("\n# ", " ").startswith(f"# {listed[name]}")


def test_json_holds_the_same_and_nothing_else_comes() -> None:
    ran = rotorid("models", "--json")
    assert (ran.code, ran.err) == (0, "")
    document = json.loads(ran.out)
    assert document["schema"] == "rotorid.models/1"
    assert [one["name"] for one in document["models"]] == [
        *NAMES,
        *RESPONSE_MODELS,
        "physical.motors",
        "physical.flight",
        "motor.speed",
        *nonlinear_model_names(),
        "transfer:m/n",
        "black_box:N",
    ]
    for one in document["models"][: len(NAMES)]:
        structure = resolve_model(one["name"])
        assert one["inputs"] == list(structure.inputs)
        assert one["outputs"] == list(structure.outputs)
        assert one["parameters"] == list(structure.parameters.names)
        assert one["about"]


@pytest.mark.parametrize("name", NAMES)
def test_the_text_of_a_model_is_the_model(name: str, tmp_path: Path) -> None:
    ran = rotorid("models", name)
    assert (ran.code, ran.err) == (0, "")
    file = tmp_path / "mine.toml"
    file.write_text(ran.out, encoding="utf-8")
    mine, library = resolve_model(file), resolve_model(name)
    assert mine.parameters == library.parameters
    assert (mine.inputs, mine.states, mine.outputs) == (library.inputs, library.states, library.outputs)
    assert (mine.M, mine.F, mine.G, mine.H0, mine.H1) == (library.M, library.F, library.G, library.H0, library.H1)
    assert mine.constants == library.constants


def test_comments_of_the_library_come_along() -> None:
    assert rotorid("models", "hover.longitudinal").out == library_text("hover.longitudinal")
    assert rotorid("models", "rate.roll").out.startswith("# Response of one rate")


def test_a_transfer_function_is_written_for_its_channels() -> None:
    ran = rotorid("models", "transfer:1/2", "--inputs", "theta", "--outputs", "u_dot, w_dot")
    structure = from_toml(ran.out)
    assert (structure.inputs, structure.outputs) == (("theta",), ("u_dot", "w_dot"))
    refused = rotorid("models", "transfer:1/2")
    assert (refused.code, refused.out) == (2, "")
    assert "--inputs and --outputs" in refused.err


def test_response_models_and_black_boxes_are_written_for_their_channels() -> None:
    text = rotorid("models", "response.second_order_delay", "--inputs", "phi_setpoint", "--outputs", "phi").out
    assert from_toml(text).parameters.names == ("K_phi", "omega_phi", "zeta_phi", "tau_phi")
    box = rotorid("models", "black_box:3", "--inputs", "u", "--outputs", "y").out
    assert len(from_toml(box).states) == 3


def test_one_model_as_json_has_its_text() -> None:
    (one,) = json.loads(rotorid("models", "rate.roll", "--json").out)["models"]
    assert from_toml(one["toml"]).parameters == rate_model("rate.roll").parameters
    assert one["parameters"] == list(rate_model("rate.roll").parameters.names)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("hover.longitudnal",), "did you mean hover.longitudinal"),
        (("rate.rol",), "did you mean rate.roll"),
        (("transfer:3/1", "--inputs", "u", "--outputs", "y"), "a transfer function of the orders 3 over 1"),
        (("rate.roll", "--outputs", "p"), "rate.roll has its own inputs and outputs"),
        (("mine.toml",), "there is no model 'mine.toml'"),
        (("response.first", "--inputs", "phi_setpoint"), "there is no model 'response.first'"),
        (("black_box:x", "--inputs", "u", "--outputs", "y"), "there is no model 'black_box:x'"),
    ],
)
def test_wrong_names_are_refused_in_one_sentence(arguments: tuple[str, ...], says: str) -> None:
    ran = rotorid("models", *arguments)
    assert (ran.code, ran.out) == (2, "")
    assert says in ran.err
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize(
    ("name", "written"),
    [
        ("physical.motors", "its linear model about hover"),
        ("motor.speed", "its equations for the motors of the log"),
    ],
)
def test_a_model_of_motors_needs_a_log(name: str, written: str) -> None:
    ran = rotorid("models", name)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == (
        f"rotorid: {name} depends on the motors of a log and cannot be printed; "
        f"use rotorid identify LOG --model {name}, which writes {written}.\n"
    )
