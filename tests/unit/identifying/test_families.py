"""Which method fits a model, and which choices it takes."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import pytest

from rotorid.errors import UsageError
from rotorid.identifying.families import FITTINGS, LINEAR, fitting_of, method_of, own_settings, require_choices
from rotorid.identifying.methods import Frequency, InTime
from rotorid.identifying.motors import Motors
from rotorid.identifying.nonlinear import Nonlinear
from rotorid.models.families import FAMILIES
from rotorid.models.library import library_model, library_text, nonlinear_model, rate_model, response_model
from rotorid.models.nonlinear import linear_of
from rotorid.settings.identifying import IdentifySettings


def test_the_choices_of_a_family_are_fields_of_the_settings() -> None:
    known = {one.name for one in fields(IdentifySettings)}
    assert set(FITTINGS) <= {family.name for family in FAMILIES}
    for fitting in (LINEAR, *FITTINGS.values()):
        assert {*fitting.choices, *fitting.only_with} <= known


@pytest.mark.parametrize(
    ("model", "method"),
    [
        ("rate.roll", Frequency),
        (rate_model("rate.roll"), Frequency),
        (response_model("response.first_order", [("phi_setpoint", "phi")]), InTime),
        ("physical.motors", Motors),
        ("drag.linear", Nonlinear),
        (nonlinear_model("drag.linear"), Nonlinear),
    ],
    ids=str,
)
def test_a_model_by_its_name_or_as_a_structure_has_the_method_of_its_family(model: object, method: type) -> None:
    assert isinstance(method_of(model, [], IdentifySettings()), method)  # type: ignore[arg-type]


def test_a_structure_of_a_family_that_waits_for_logs_is_fitted_as_it_is() -> None:
    assert fitting_of(library_model("physical.hover")) is LINEAR
    assert fitting_of(linear_of(nonlinear_model("flight.first_order"))) is LINEAR


def test_each_family_says_what_it_does_not_take() -> None:
    for model, said in (
        ("rate.roll", "--arm does not apply to rate.roll; leave it out, or use physical.motors"),
        ("rig.roll", "--arm does not apply to rig.roll; leave it out, and give .* with --fix L=VALUE"),
        ("drag.linear", "--arm does not apply to drag.linear, a nonlinear model"),
    ):
        with pytest.raises(UsageError, match=said):
            require_choices(model, IdentifySettings(arm_m=0.2))
    with pytest.raises(UsageError, match=r"--inputs and --decoupled does not apply to drag\.linear, a nonlinear"):
        require_choices("drag.linear", IdentifySettings(), options={"--inputs": "u", "--decoupled": True})
    with pytest.raises(
        UsageError, match=r"^--tie, --inputs, --decoupled does not apply to physical\.motors; leave it out"
    ):
        require_choices(
            "physical.motors", IdentifySettings(ties={"a": "b"}), options={"--inputs": "u", "--decoupled": True}
        )


def test_a_file_is_called_by_its_whole_path(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(library_text("axis.roll"), encoding="utf-8")
    with pytest.raises(UsageError, match=f"--arm does not apply to {re.escape(str(path))}"):
        require_choices(path, IdentifySettings(arm_m=0.2))


def test_a_method_of_motors_alone_is_no_choice_to_leave_out_for_others() -> None:
    asked = IdentifySettings(method="accelerations")
    assert own_settings("physical.motors", asked).method == "accelerations"
    for model in ("rate.roll", "response.first_order"):
        with pytest.raises(UsageError, match="--method accelerations does not apply to"):
            require_choices(model, own_settings(model, asked))


def test_choices_that_a_model_does_not_have_are_left_out_for_it() -> None:
    asked = IdentifySettings(arm_m=0.2, reduce=True, method="output_error", outputs=("p",))
    assert own_settings("rate.roll", asked) == IdentifySettings(reduce=True, method="output_error", outputs=("p",))
    assert own_settings("physical.motors", asked) == IdentifySettings(arm_m=0.2)
