"""Choices are checked at the border, and written down with all their digits."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest

from rotorid.data.record import Maneuver
from rotorid.data.trust import DIRECT_COHERENCE, JOINT_COHERENCE
from rotorid.errors import UsageError
from rotorid.io.records import as_records
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.option import as_names, as_settings
from rotorid.settings.parsing import (
    parse_band,
    parse_fix,
    parse_input_windows,
    parse_numbers,
    parse_pairs,
    parse_segment,
    parse_shifts,
    parse_ties,
)


@pytest.mark.parametrize(
    ("choice", "says"),
    [
        ({"band_rad_s": (50.0, 1.0)}, "the band 50 to 1 rad/s is empty"),
        ({"band_rad_s": (0.0, 1.0)}, "the band 0 to 1 rad/s is empty"),
        ({"band_rad_s": (1.0, math.inf)}, "the band 1 to inf rad/s is empty"),
        ({"windows_s": (10.0, 0.0)}, "a window of 0 s"),
        ({"windows_s": (math.inf,)}, "a window of inf s"),
        ({"windows_s": (math.nan,)}, "a window of nan s"),
        ({"input_windows_s": {"roll_command": (10.0, -1.0)}}, "a window of -1 s"),
        ({"input_windows_s": {"roll_command": ()}}, "no window length for roll_command"),
        ({"composition": "cifer"}, "unknown composition 'cifer'"),
        ({"taper": "boxcar"}, "unknown taper 'boxcar'"),
        ({"overlap": 1.0}, "--overlap 1 "),
        ({"overlap": math.nan}, "--overlap nan"),
        ({"coherence": 1.0}, "--coherence 1 "),
        ({"coherence": -0.1}, "--coherence -0.1"),
        ({"estimate": "guess"}, "unknown estimate 'guess'"),
        ({"estimate": "direct", "instruments": ("roll_excitation",)}, "has no instrument"),
        ({"segments": (Maneuver(axis="roll", kind="other", start_s=0.0, stop_s=math.inf),)}, "from 0 to inf s"),
    ],
)
def test_impossible_choices_are_refused(choice: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError) as refused:
        IdentifySettings(**choice)
    assert says in str(refused.value)


def test_limit_of_coherence_depends_on_the_estimate_unless_it_is_given() -> None:
    assert IdentifySettings().least_coherence(joint=False) == DIRECT_COHERENCE
    assert IdentifySettings().least_coherence(joint=True) == JOINT_COHERENCE
    assert IdentifySettings(coherence=0.0).least_coherence(joint=True) == 0.0


def test_fixed_values_are_copied_in() -> None:
    fix = {"L_p": -2.0}
    settings = IdentifySettings(fix=fix)
    fix["L_p"] = 0.0
    assert settings.fix == {"L_p": -2.0}


def test_text_of_the_provenance_reads_back_as_the_same_choices() -> None:
    # A segment on a clock of seconds since 1970, and a value that six digits would round.
    settings = IdentifySettings(
        fix={"L_p": -1.23456789012}, segments=(parse_segment("yaw:1606123456.789:1606123556.25"),)
    )
    written = settings.as_json()
    fix, segments = written["fix"], written["segments"]
    assert isinstance(fix, list)
    assert isinstance(segments, list)
    assert parse_fix(tuple(map(str, fix))) == settings.fix
    assert tuple(parse_segment(str(text)) for text in segments) == settings.segments


def test_a_segment_is_given_by_the_user_on_the_clock_of_the_log() -> None:
    segment = parse_segment("thrust:-3:4.5")
    assert (segment.axis, segment.start_s, segment.stop_s) == ("thrust", -3.0, 4.5)
    assert (segment.kind, segment.origin) == ("other", "given")


@pytest.mark.parametrize("text", ["", "roll", "roll:1", "roll:1:2:3", "p:1:2", "roll:a:2", "roll:2:2", "roll:nan:2"])
def test_unreadable_segments_are_quoted(text: str) -> None:
    with pytest.raises(UsageError, match=f"the segment {text!r}"):
        parse_segment(text)


@pytest.mark.parametrize("text", ["", "1", "1:2:3", "a:b", "1-2"])
def test_unreadable_bands_are_quoted(text: str) -> None:
    with pytest.raises(UsageError, match=f"the band {text!r}"):
        parse_band(text)


@pytest.mark.parametrize("text", ["", ",", "1,,2", "1;2", "ten"])
def test_unreadable_lists_are_quoted(text: str) -> None:
    with pytest.raises(UsageError, match=f"the list {text!r}"):
        parse_numbers(text)


def test_readable_texts() -> None:
    assert parse_numbers("20, 14,9") == (20.0, 14.0, 9.0)
    assert parse_fix(("L_p=-2", " tau_roll = 1e-3")) == {"L_p": -2.0, "tau_roll": 1e-3}


@pytest.mark.parametrize("text", ["L_p", "L_p=", "L_p=low", "L_p==1"])
def test_unreadable_values_are_quoted(text: str) -> None:
    with pytest.raises(UsageError, match=f"'{text}' cannot be read"):
        parse_fix((text,))


def test_shifts_are_read_and_written_down() -> None:
    shifts = parse_shifts(("p:0.0037", "roll_command:-4e-3"))
    assert shifts == {"p": 0.0037, "roll_command": -0.004}
    assert IdentifySettings(shifts=shifts).as_json()["shifts"] == ["p:0.0037", "roll_command:-0.004"]


@pytest.mark.parametrize("text", ["p", "p:", ":0.1", "p:nan", "p:inf", "p:soon"])
def test_shifts_that_make_no_sense_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="CHANNEL:SECONDS"):
        parse_shifts((text,))


def test_a_channel_is_shifted_once() -> None:
    with pytest.raises(UsageError, match="p has two shifts"):
        parse_shifts(("p:0.1", "p:0.2"))
    with pytest.raises(UsageError, match="the shift of p is inf s"):
        IdentifySettings(shifts={"p": math.inf})


@pytest.mark.parametrize(
    ("choice", "says"),
    [
        ({"weights": "cifr"}, "unknown weights 'cifr'; did you mean cifer?"),
        ({"speed_damping": "twice"}, "unknown speed damping 'twice'; expected joint, two_step or two_step_force"),
        ({"fix": {"L_p": 1.0}, "ties": {"L_p": "L_roll"}}, "L_p has more than one of --fix, --tie and --free"),
        ({"fix": {"L_p": 1.0}, "free": ("L_p",)}, "L_p has more than one of --fix, --tie and --free"),
        ({"ties": {"L_p": "L_roll"}, "free": ("L_p",)}, "L_p has more than one of --fix, --tie and --free"),
    ],
)
def test_impossible_choices_about_the_fit_are_refused(choice: dict[str, Any], says: str) -> None:
    with pytest.raises(UsageError) as refused:
        IdentifySettings(**choice)
    assert says in str(refused.value)


def test_choices_about_the_fit_are_written_down_and_read_back() -> None:
    settings = IdentifySettings(
        ties={"M_q": "-0.5*L_p"},
        free=("tau_az",),
        constants={"theta0": 0.0123456789012},
        outputs=("q", "az"),
        pairs={"q/pitch_command": (1.23456789012, 45.0), "az/thrust_command": None},
        pair_weights={"q/pitch_command": 0.1},
        weights="cifer",
        reduce=True,
        speed_damping="two_step",
    )
    written = settings.as_json()

    def texts(name: str) -> tuple[str, ...]:
        listed = written[name]
        assert isinstance(listed, list)
        return tuple(map(str, listed))

    assert parse_ties(texts("ties")) == settings.ties
    assert parse_fix(texts("constants")) == settings.constants
    assert parse_pairs(texts("pairs")) == settings.pairs
    assert parse_fix(texts("pair_weights")) == settings.pair_weights
    assert (texts("free"), texts("outputs")) == (settings.free, settings.outputs)
    assert (written["weights"], written["reduce"], written["speed_damping"]) == ("cifer", True, "two_step")


def test_mappings_are_copied_in() -> None:
    ties = {"M_q": "L_p"}
    settings = IdentifySettings(ties=ties)
    ties["M_q"] = "0"
    assert settings.ties == {"M_q": "L_p"}
    with pytest.raises(TypeError):
        settings.ties["M_q"] = "0"  # type: ignore[index]


@pytest.mark.parametrize("text", ["M_q", "=L_p", "M_q=", ""])
def test_unreadable_ties_are_quoted(text: str) -> None:
    with pytest.raises(UsageError, match=f"'{text}' cannot be read"):
        parse_ties((text,))


def test_a_tie_keeps_what_stands_behind_the_first_sign() -> None:
    assert parse_ties((" M_q = L_p*2 ",)) == {"M_q": "L_p*2"}
    with pytest.raises(UsageError, match="M_q is given twice"):
        parse_ties(("M_q=L_p", "M_q=L_r"))


@pytest.mark.parametrize("text", ["q/pitch_command:3", "q/pitch_command:", "q/pitch_command:3:4:5", "q/x:a:b"])
def test_unreadable_bands_of_responses_are_quoted(text: str) -> None:
    with pytest.raises(UsageError, match=r"the band .* cannot be read"):
        parse_pairs((text,))


@pytest.mark.parametrize(
    "wrong", [{"method": "guess"}, {"hold": "second"}, {"starts": "sobol"}, {"starts": "random:0"}, {"pieces_s": 0.0}]
)
def test_impossible_choices_in_time_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UsageError):
        IdentifySettings(**wrong)


@pytest.mark.parametrize("starts", ["default", "central", "sobol:16", "random:3"])
def test_starts_go_into_the_provenance(starts: str) -> None:
    chosen = IdentifySettings(method="output_error", hold="first", starts=starts, pieces_s=1.5).as_json()
    assert (chosen["method"], chosen["hold"], chosen["starts"], chosen["pieces_s"]) == (
        "output_error",
        "first",
        starts,
        1.5,
    )


def test_options_by_name_go_before_the_settings_beside_them() -> None:
    whole = IdentifySettings(band_rad_s=(1.0, 60.0), reduce=True)
    assert as_settings(IdentifySettings, whole, {}) is whole
    assert as_settings(IdentifySettings, whole, {"reduce": False}) == IdentifySettings(band_rad_s=(1.0, 60.0))
    assert as_settings(IdentifySettings, None, {"fix": {"L_p": -2.0}}).fix == {"L_p": -2.0}


def test_an_option_that_there_is_not_is_named_with_the_nearest() -> None:
    with pytest.raises(TypeError, match="unknown option 'band'; did you mean band_rad_s"):
        as_settings(IdentifySettings, None, {"band": (1.0, 60.0)})
    with pytest.raises(UsageError, match="the band 60 to 1 rad/s is empty"):
        as_settings(IdentifySettings, None, {"band_rad_s": (60.0, 1.0)})


def test_one_name_stands_for_a_list_of_one() -> None:
    assert as_names("roll_command") == ("roll_command",)
    assert as_names(name for name in ("p", "ay")) == ("p", "ay")
    settings = IdentifySettings(outputs="ay", free="L_v", instruments="roll_excitation")  # type: ignore[arg-type]
    assert (settings.outputs, settings.free, settings.instruments) == (("ay",), ("L_v",), ("roll_excitation",))


def test_one_record_or_path_stands_for_a_list_of_one(tmp_path: Path) -> None:
    log = tmp_path / "roll.csv"
    log.write_text("time [s],p [rad/s]\n" + "".join(f"{0.01 * k:.2f},0.0\n" for k in range(100)))
    (read_here,) = as_records(log)
    assert as_records(read_here) == (read_here,)
    assert [record.source.name for record in as_records([str(log), read_here])] == ["roll.csv", "roll.csv"]


def test_windows_of_an_input_are_read_and_written_down() -> None:
    read = parse_input_windows(("roll_command:14,9", "yaw_command: 6"))
    assert read == {"roll_command": (14.0, 9.0), "yaw_command": (6.0,)}
    written = IdentifySettings(input_windows_s=read, taper="half_sine", overlap=0.5).as_json()
    assert written["input_windows_s"] == ["roll_command:14.0,9.0", "yaw_command:6.0"]
    assert (written["taper"], written["overlap"]) == ("half_sine", 0.5)
    assert "composition" not in written


@pytest.mark.parametrize("text", ["14,9", "roll_command:", ":9", "roll_command:nine"])
def test_windows_that_cannot_be_read_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="cannot be read"):
        parse_input_windows((text,))


def test_windows_of_an_input_twice_are_refused() -> None:
    with pytest.raises(UsageError, match="are given twice"):
        parse_input_windows(("roll_command:9", "roll_command:5"))
