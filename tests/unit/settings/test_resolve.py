"""Which model a user means, and which of its parameters are held."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.models.families import black_box_order, family_of, named_model, waits_for_logs
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.models.toml import from_toml, to_toml
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.resolve import chosen_parameters, require_known, resolve_model


@pytest.mark.parametrize("name", RATE_AXES)
def test_a_name_a_structure_and_its_file_are_the_same_model(name: str, tmp_path: Path) -> None:
    structure = rate_model(name)
    text = to_toml(structure, structure.parameters, {})
    file = tmp_path / "model.toml"
    file.write_text(text, encoding="utf-8")
    assert resolve_model(structure) is structure
    for way in (name, file, str(file)):
        meant = resolve_model(way)
        assert to_toml(meant, meant.parameters, {}) == text


def test_an_unknown_name_is_refused_with_the_known_ones() -> None:
    with pytest.raises(ModelError, match=r"rate\.roll, rate\.pitch, rate\.yaw, rate\.vertical"):
        resolve_model("rate.rol")


@pytest.mark.parametrize("name", ["physical.motor", "physical.motorss", "physicalmotors"])
def test_the_physics_of_motors_is_suggested(name: str) -> None:
    with pytest.raises(ModelError, match=r"physical\.motors, .*did you mean physical\.motors\?"):
        resolve_model(name)


def test_the_physics_of_motors_is_no_linear_structure() -> None:
    with pytest.raises(ModelError, match=r"not a linear structure.*rotorid\.identify\(log,"):
        resolve_model("physical.motors")


@pytest.mark.parametrize("content", [None, b"\xff\xfe", b"name = ", b'name = "x"'], ids=["missing", "8", "cut", "bare"])
def test_a_wrong_file_is_named(content: bytes | None, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises((ModelError, UsageError), match=r"mine\.toml"):
        resolve_model(file)


def test_fixed_parameters_are_held_at_their_values() -> None:
    parameters = chosen_parameters(rate_model("rate.roll"), IdentifySettings(fix={"L_p": -2.0}))
    assert parameters["L_p"].value == -2.0
    assert parameters["L_p"].status == "fixed"
    assert parameters.free == ("L_roll", "T_motor", "tau_roll")


def test_nothing_left_to_find_is_wrong_use() -> None:
    everything = {"L_roll": 100.0, "L_p": -2.0, "T_motor": 0.0, "tau_roll": 0.01}
    with pytest.raises(UsageError, match="every parameter is fixed"):
        chosen_parameters(rate_model("rate.roll"), IdentifySettings(fix=everything))


def test_transfer_functions_need_channels() -> None:
    structure = resolve_model("transfer:1/2", inputs=["roll_command"], outputs=["p", "phi"])
    assert (structure.inputs, structure.outputs) == (("roll_command",), ("p", "phi"))
    for channels in ({"inputs": ["roll_command"]}, {"outputs": ["p"]}, {}):
        with pytest.raises(UsageError, match="transfer:1/2 needs channels; expected --inputs and --outputs"):
            resolve_model("transfer:1/2", **channels)  # type: ignore[arg-type]


@pytest.mark.parametrize("orders", ["3/2", "0/0", "0/21", "99999999999999999999/1"])
def test_impossible_orders_are_refused(orders: str) -> None:
    with pytest.raises(ModelError, match="an order of the denominator from 1 to 20"):
        resolve_model(f"transfer:{orders}", inputs=["roll_command"], outputs=["p"])


@pytest.mark.parametrize(
    "name", ["", "transfer:", "transfer:1", "transfer:-1/2", "rate", "/tmp", "hover.longitudinal.tml"]
)
def test_what_is_no_name_is_refused_with_the_names(name: str) -> None:
    with pytest.raises(ModelError, match=r"there is no model.*transfer:m/n, black_box:N, or a \.toml file"):
        named_model(name, inputs=["roll_command"], outputs=["p"])


def test_inputs_of_a_model_that_has_its_own_are_not_ignored() -> None:
    with pytest.raises(UsageError, match=r"inputs pitch_command came with rate\.roll.*transfer"):
        resolve_model("rate.roll", inputs=["pitch_command"])
    # Outputs choose among those of the model.
    assert resolve_model("axis.roll", outputs=["p"]).outputs == ("p", "v", "phi", "ay")


def test_names_are_looked_up_before_anything_is_read() -> None:
    structure = resolve_model("hover.lateral")
    require_known(structure, IdentifySettings(outputs=("p",), pairs={"p/roll_command": None}, constants={"phi0": 0.1}))
    with pytest.raises(ModelError, match=r"no response 'p/roll'.*did you mean p/roll_command"):
        require_known(structure, IdentifySettings(pairs={"p/roll": None}))


def test_start_values_without_a_model_are_refused_unless_they_are_changed() -> None:
    structure = from_toml(
        """
name = "lag"
inputs = ["u"]
states = ["x"]
equations = ["x' = -x/T + b*u"]
outputs = ["x"]
[parameters.T]
value = 0.0
unit = "s"
[parameters.b]
value = 1.0
unit = "1/s"
"""
    )
    with pytest.raises(ModelError, match=r"lag at its start values: .* has no finite value at T = 0"):
        require_known(structure, IdentifySettings())
    require_known(structure, IdentifySettings(fix={"T": 0.1}))
    require_known(structure, IdentifySettings(ties={"T": "0.1*b"}))


def test_a_response_model_finds_its_pairs_in_the_log_or_takes_those_that_are_named() -> None:
    logged = ["phi", "phi_setpoint", "theta", "theta_setpoint", "r"]
    found = named_model("response.second_order", logged=logged)
    assert (found.inputs, found.outputs) == (("phi_setpoint", "theta_setpoint"), ("phi", "theta"))
    assert named_model("response.second_order", outputs=["theta"], logged=logged).inputs == ("theta_setpoint",)
    named = named_model("response.first_order", inputs=["r_setpoint"], outputs=["r"])
    assert named.inputs == ("r_setpoint",)
    assert family_of(named).answers_setpoints
    assert waits_for_logs("response.first_order")
    assert not waits_for_logs("response.first_order", ["r_setpoint"])


def test_a_log_without_set_points_cannot_support_a_response_model() -> None:
    with pytest.raises(InsufficientDataError, match="has a set-point") as caught:
        named_model("response.first_order", logged=["p", "roll_command"])
    assert [finding.kind for finding in caught.value.findings] == ["missing_channel"]
    with pytest.raises(UsageError, match="needs channels"):
        named_model("response.first_order")
    with pytest.raises(UsageError, match="1 inputs and 2 outputs"):
        named_model("response.first_order", inputs=["phi_setpoint"], outputs=["phi", "theta"])


def test_a_black_box_is_one_or_several_side_by_side() -> None:
    channels = {"inputs": ["u", "v"], "outputs": ["y", "z"]}
    coupled = named_model("black_box:2", **channels)
    decoupled = named_model("black_box:2+delay", **channels, decoupled=True)
    assert (len(coupled.states), len(decoupled.states)) == (2, 4)
    assert black_box_order(coupled) == black_box_order(decoupled) == 2
    assert "tau_y" in decoupled.parameters.names
    with pytest.raises(UsageError, match="needs channels"):
        named_model("black_box:2")
    with pytest.raises(ModelError, match=r"did you mean response\.second_order"):
        named_model("response.second_ordre")
