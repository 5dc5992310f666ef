"""Which model a user means, and which of its parameters are held."""

from __future__ import annotations

from pathlib import Path

import pytest

from rotorid.errors import ModelError, UsageError
from rotorid.models.description import to_toml
from rotorid.models.rate import RATE_AXES, rate_model
from rotorid.pipeline.resolve import chosen_parameters, resolve_model
from rotorid.pipeline.settings import IdentifySettings


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
