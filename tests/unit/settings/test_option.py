"""What a choice is stands on its field: how it is read, refused and held by a provenance."""

from __future__ import annotations

import re
from dataclasses import fields
from typing import Any, get_args

import pytest

import rotorid
from rotorid.cli.app import Commands
from rotorid.errors import UsageError
from rotorid.exports.settings import ExportSettings
from rotorid.exports.targets import TARGETS
from rotorid.fleets import FleetSettings, fleet
from rotorid.flying import StitchSettings
from rotorid.flying.settings import PlanSettings
from rotorid.identifying import TrackSettings
from rotorid.lab.steps import Segment, Step, arguments
from rotorid.planning.amplitude import Limits
from rotorid.proposing import TuneSettings
from rotorid.proposing.settings import GAINS
from rotorid.reviewing import ReviewSettings
from rotorid.settings import FlySettings, IdentifySettings, MeasureSettings, MotorSettings, VerifySettings
from rotorid.settings.identifying import MethodChoice
from rotorid.settings.option import as_settings, option_of
from rotorid.settings.parsing import parse_segments

ALWAYS = {
    MeasureSettings: "band_rad_s windows_s coherence estimate instruments segments shifts",
    FlySettings: "segments pieces_s hold seed",
    TrackSettings: "first_s step_share thrust_exponent",
    TuneSettings: "axes robustness noise keep filters scale draws seed",
    MotorSettings: "known layout arm_m curve rotor_diameter_m segments voltage",
    FleetSettings: "models review seed",
}


@pytest.mark.parametrize("kind", ALWAYS, ids=lambda kind: kind.__name__)
def test_a_provenance_holds_what_every_run_tells_in_the_order_of_the_fields(kind: type[Any]) -> None:
    assert list(kind().as_json()) == ALWAYS[kind].split()


def test_what_few_runs_know_of_is_held_where_it_was_given_at_the_end() -> None:
    asked = IdentifySettings(overlap=0.5, known={"I_zz": (0.012, 0.0004)}, correct_sensors=True).as_json()
    assert list(asked)[-3:] == ["overlap", "known", "correct_sensors"]
    assert asked["known"] == ["I_zz=0.012:0.0004"]
    assert "bootstrap" not in MotorSettings().as_json()
    assert MotorSettings(bootstrap=200).as_json()["bootstrap"] == 200


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("segments", parse_segments(["roll:1.5:20.25", "yaw:1606123456.789:1606123556.25"])),
        ("shifts", {"q": 0.0037}),
        ("input_windows_s", {"roll_command": (14.0, 9.5)}),
        ("pairs", {"q/pitch_command": (3.0, 45.5), "az/thrust_command": None}),
        ("known", {"I_zz": (0.012, 0.0004)}),
        ("fix", {"L_p": -1.23456789012}),
        ("ties", {"tau_pitch": "tau_roll"}),
    ],
)
def test_what_a_provenance_holds_reads_back_as_the_same_choice(field: str, value: Any) -> None:
    (item,) = [item for item in fields(IdentifySettings) if item.name == field]
    option = option_of(item)
    assert option is not None
    assert option.text is not None
    assert option.text.parse(IdentifySettings(**{field: value}).as_json()[field]) == value


@pytest.mark.parametrize("verb", [rotorid.track, rotorid.tune, rotorid.review, rotorid.stitch, fleet])
def test_every_verb_suggests_the_name_of_a_choice(verb: Any) -> None:
    slips = {"track": "frist_s", "tune": "robustnes", "review": "model", "stitch": "sede", "fleet": "worker"}
    with pytest.raises(TypeError, match=r"unknown option '.*'; did you mean "):
        verb({}, **{slips[verb.__name__]: 1})


def test_gains_that_may_change_are_held_as_those_that_stay() -> None:
    settings = TuneSettings(only=("P", "D"))
    assert (settings.keep, settings.only) == (("I", "A"), ())
    assert as_settings(TuneSettings, settings, {"noise": 1.0}).keep == ("I", "A")
    with pytest.raises(UsageError, match="--keep and --only exclude each other"):
        TuneSettings(keep=("P",), only=("D",))
    with pytest.raises(UsageError, match="unknown gain 'X'; use P, I, D or A"):
        TuneSettings(only=("X",))


def test_one_of_few_words_is_refused_by_every_class() -> None:
    for make, said in (
        (lambda: ExportSettings(delay="foo"), "unknown delay 'foo'; expected states, lag or none"),  # type: ignore[arg-type]
        (lambda: FlySettings(hold="second"), "unknown hold 'second'; expected auto, zero or first"),  # type: ignore[arg-type]
        (lambda: VerifySettings(taper="box"), "unknown taper 'box'; expected hann or half_sine"),  # type: ignore[arg-type]
    ):
        with pytest.raises(UsageError, match=said):
            make()


def test_limits_in_the_help_are_those_in_force() -> None:
    (item,) = [item for item in fields(PlanSettings) if item.name == "limits"]
    option = option_of(item)
    assert option is not None
    assert option.text is not None
    written = option.help.partition("[default: ")[2].partition("]")[0]
    assert option.text.parse(written.split(", ")) == Limits()
    assert (StitchSettings().seed, ReviewSettings().models) == (0, True)


def test_old_names_are_deprecated_and_still_there() -> None:
    for old in ("MotorChoices", "ExportChoices"):
        vars(rotorid).pop(old, None)  # a name warns when it is first taken
    with pytest.warns(DeprecationWarning, match=r"use rotorid\.MotorSettings"):
        assert rotorid.MotorChoices is MotorSettings
    with pytest.warns(DeprecationWarning, match=r"use rotorid\.ExportSettings"):
        assert rotorid.ExportChoices is ExportSettings


@pytest.mark.parametrize("verb", ["review", "response", "identify", "verify", "tune", "export"])
def test_a_step_of_a_project_file_has_options_of_its_command(verb: Any) -> None:
    step = Step(
        verb=verb, logs=(1,), verify=(1,), models=("rate.roll",), inputs=("p",), outputs=("q",), instrument=("r",),
        segments=(Segment(axis="roll", start_s=1.0, stop_s=2.0),), band_rad_s=(1.0, 40.0), reduce=True,
        method="frequency", robustness=2.0, noise=1.5, keep=("P",), values={"m": 1.2},
    )  # fmt: skip
    known = {name for item in Commands()[verb].params for name in item.opts}
    assert {word for word in arguments(step, ["a.ulg"], []) if word.startswith("--")} <= known


def test_words_of_a_project_file_are_those_of_the_settings() -> None:
    kinds = {name: get_args(item.annotation) for name, item in Step.model_fields.items()}
    assert kinds["to"] == tuple(TARGETS)
    assert set(kinds["method"]) == {*get_args(MethodChoice)} - {"accelerations"}
    assert get_args(kinds["keep"][0]) == GAINS


def test_keywords_take_the_texts_of_the_command_line() -> None:
    chosen = as_settings(IdentifySettings, None, {"fix": "T_motor=0.05", "segments": ["roll:5:35"], "free": "L_p"})
    assert chosen.fix == {"T_motor": 0.05}
    assert chosen.free == ("L_p",)
    assert [(segment.axis, segment.start_s) for segment in chosen.segments] == [("roll", 5.0)]
    several = as_settings(IdentifySettings, None, {"fix": ["T_motor=50ms", "L_p=-2"], "band_rad_s": "1:60"})
    assert several.fix == {"T_motor": 0.05, "L_p": -2.0}
    assert several.band_rad_s == (1.0, 60.0)


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("fix", "T_motor", "T_motor"),
        ("fix", 0.05, "fix=0.05 cannot be read; expected a mapping of names"),
        ("pieces_s", "ten", "pieces_s='ten' is a text; expected a number"),
        ("reduce", "yes", "reduce='yes' is a text"),
    ],
)
def test_a_keyword_that_cannot_be_read_is_refused_in_words(option: str, value: object, words: str) -> None:
    with pytest.raises(UsageError, match=re.escape(words)):
        as_settings(IdentifySettings, None, {option: value})
