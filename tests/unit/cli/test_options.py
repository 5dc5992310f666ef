"""Options are made from the fields of settings, and read back into them."""

import inspect
from dataclasses import dataclass, field, fields
from typing import Annotated, Any

import pytest
import typer
from typer.testing import CliRunner

from rotorid.cli.app import COMMANDS, Commands
from rotorid.cli.options import ForPaper, Only, Output, with_options
from rotorid.errors import UsageError
from rotorid.exports.settings import DrawSettings, ExportSettings, TargetSettings
from rotorid.fleets.settings import FleetSettings
from rotorid.flying.settings import (
    Air,
    AutopilotSettings,
    DesignSettings,
    PlanSettings,
    SimulateSettings,
    StitchSettings,
    VehicleFileSettings,
)
from rotorid.identifying.settings import TrackSettings
from rotorid.lab.settings import LabSettings
from rotorid.proposing.settings import TuneSettings
from rotorid.reviewing.settings import ReviewSettings
from rotorid.settings.flying import FlySettings
from rotorid.settings.identifying import IdentifySettings, ModelSettings
from rotorid.settings.measuring import MeasureSettings, ResponseSettings
from rotorid.settings.option import Option, option_of
from rotorid.settings.parsing import BAND, FIXED
from rotorid.settings.verifying import VerifySettings

SETTINGS = (
    MeasureSettings, ResponseSettings, VerifySettings, IdentifySettings, ModelSettings, PlanSettings, DesignSettings,
    SimulateSettings, AutopilotSettings, VehicleFileSettings, StitchSettings, FlySettings, TrackSettings, TuneSettings,
    ReviewSettings, ExportSettings, TargetSettings, DrawSettings, FleetSettings, LabSettings, Air, Output, ForPaper,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Choices:
    """Some of everything that an option can be."""

    size: Annotated[int, Option("--size", help="How large.")] = 3
    band_rad_s: Annotated[tuple[float, float], Option("--band", "LO:HI.", text=BAND, default="1:60")] = (
        2.0,
        3.0,
    )
    fix: Annotated[dict[str, float], Option("--fix", "Repeatable.", text=FIXED)] = field(default_factory=dict)
    hidden: float = 1.5


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """A number with a unit."""

    size_m: Annotated[float, Option("--size", help="How large.")] = 1.23456789


def ran(annotation: Any, *words: str) -> Any:
    """What a command is given for an argument of that annotation."""
    found: list[Any] = []

    def command(*, choices: Any) -> None:
        found.append(choices)

    command.__annotations__["choices"] = annotation
    app = typer.Typer()
    app.command()(with_options(command))
    done = CliRunner().invoke(app, list(words), catch_exceptions=False)
    return found[0] if found else done.exit_code


def test_fields_are_options_and_options_are_fields() -> None:
    given = ran(Choices, "--size", "5", "--band", "8:80", "--fix", "L_p=-2", "--fix", "L_v=1")
    assert given == Choices(size=5, band_rad_s=(8.0, 80.0), fix={"L_p": -2.0, "L_v": 1.0})


def test_what_was_not_given_is_left_to_the_settings_or_to_the_default_of_the_option() -> None:
    assert ran(Choices) == Choices(band_rad_s=(1.0, 60.0))
    assert ran(Annotated[dict[str, Any], Choices]) == {"size": 3, "band_rad_s": (1.0, 60.0)}


def test_a_number_comes_with_its_unit_and_its_default_with_all_digits() -> None:
    assert ran(Sizes) == Sizes(size_m=1.23456789)
    assert ran(Sizes, "--size", "20cm") == Sizes(size_m=0.2)
    with pytest.raises(UsageError, match="--size '2s' is in s"):
        ran(Sizes, "--size", "2s")


def test_a_command_may_have_some_of_the_options_alone() -> None:
    assert ran(Annotated[Choices, Only("size")], "--size", "4") == Choices(size=4)
    assert ran(Annotated[Choices, Only("size")], "--band", "1:2") == 2
    assert ran(Choices, "--hidden", "2") == 2


def test_a_text_that_cannot_be_read_is_refused_in_words() -> None:
    with pytest.raises(UsageError, match="the band 'wide' cannot be read"):
        ran(Choices, "--band", "wide")


@pytest.mark.parametrize("kind", SETTINGS, ids=lambda kind: kind.__name__)
def test_every_option_is_named_and_explained_once(kind: type[Any]) -> None:
    options = [option for item in fields(kind) if (option := option_of(item)) is not None]
    assert options
    assert len({option.name for option in options}) == len(options)
    for option in options:
        assert option.name.startswith("--")
        assert option.help.endswith((".", "]"))


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_loaded_by_its_name_and_says_what_it_does(name: str) -> None:
    command = Commands()[name]
    assert command.name == name
    assert inspect.cleandoc(command.help).endswith(".")
    assert len({option for item in command.params for option in item.opts}) == sum(len(p.opts) for p in command.params)
