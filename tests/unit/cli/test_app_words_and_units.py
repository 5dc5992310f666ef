"""Numbers with units, choices that are listed, options under headings, colors on a terminal, pages on paper."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace
from typing import Any, get_args

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.unit.cli.commands import ROLL, rotorid
from typer.testing import CliRunner

from rotorid.autopilots.autopilot import LogFormat
from rotorid.cli import console
from rotorid.cli.app import COMMANDS, app
from rotorid.data.findings import warn
from rotorid.data.flight_plan import Entry
from rotorid.data.record import Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.errors import UsageError
from rotorid.flights.flights import Flight
from rotorid.flights.measure import _band_outside_excitation
from rotorid.flying.settings import (
    PlanSettings,
    SimulateSettings,
    parse_changes,
    parse_limits,
    parse_percents,
    parse_speed,
    parse_wind,
)
from rotorid.models.motors import Curve
from rotorid.report.printing import BROWSERS, print_pages
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.option import option_of
from rotorid.settings.parsing import (
    parse_band,
    parse_constants,
    parse_fix,
    parse_known,
    parse_low_pass,
    parse_numbers,
    parse_segment,
    parse_shifts,
    parse_weights,
)
from rotorid.signal.excitations import classify
from rotorid.units import read_measure


@pytest.mark.parametrize(
    ("text", "si", "value"),
    [("20cm", "m", 0.2), ("283 mm", "m", 0.283), ("-5e-3", "s", -0.005), ("5ms", "s", 0.005), (".5", None, 0.5),
     ("8Hz", "rad/s", 16.0 * np.pi), ("30 deg", "rad", np.pi / 6.0), ("1.4kg", None, 1.4), ("3°", "rad", np.pi / 60.0)],
)  # fmt: skip
def test_a_number_comes_with_its_unit(text: str, si: str | None, value: float) -> None:
    assert read_measure(text, si) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "si", "said"),
    [("20ms", "m", "is in s"), ("fast", "m", "expected a number in m"), ("5 parsec", "m", "unknown unit"),
     ("", None, "expected a number"), ("1e", "s", "unknown unit"), ("nan", "s", "expected a number"),
     ("1e999", "s", "expected a number"), ("620g", None, "grams or gravity")],
)  # fmt: skip
def test_another_unit_is_refused(text: str, si: str | None, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read_measure(text, si)


def test_the_option_stands_in_the_sentence(tmp_path: Path) -> None:
    words = ["identify", str(tmp_path / "a.ulg"), "--model", "physical.motors", "--arm", "20ms"]
    answer = CliRunner().invoke(app, words)
    assert isinstance(answer.exception, UsageError)
    assert str(answer.exception).startswith("--arm '20ms' is in s")


@pytest.mark.parametrize(
    ("read", "text", "value"),
    [(parse_band, "1Hz:80", (2.0 * np.pi, 160.0 * np.pi)), (parse_band, "0.1 : 8 hz", (0.2 * np.pi, 16.0 * np.pi)),
     (parse_band, "1:10rad/s", (1.0, 10.0)), (parse_band, "1rad/s:10Hz", (1.0, 20.0 * np.pi)),
     (parse_numbers, "10s,5s", (10.0, 5.0)), (parse_numbers, "800ms,1min", (0.8, 60.0)),
     (parse_low_pass, "5Hz", 10.0 * np.pi), (parse_wind, "3.6km/h,0", (1.0, 0.0)), (parse_wind, "7.2 km/h", (2.0, 0.0)),
     (parse_speed, "0:36km/h", (0.0, 10.0)), (parse_speed, "4", (4.0, 4.0))],
)  # fmt: skip
def test_a_list_comes_with_units(read: Callable[[str], Any], text: str, value: Any) -> None:
    assert read(text) == pytest.approx(value, rel=1e-14)


def test_named_numbers_come_with_units() -> None:
    assert parse_shifts(["p:5ms", "q:-0.002"]) == {"p": 0.005, "q": -0.002}
    segment = parse_segment("roll:1min:90s")
    assert (segment.start_s, segment.stop_s) == (60.0, 90.0)
    assert parse_changes(["m=1.2kg", "tau=10ms", "arm=20cm", "drag=80%", "I_xx=0.02"]) == {
        "m": 1.2, "tau": 0.01, "arm": 0.2, "drag": 0.8, "I_xx": 0.02
    }  # fmt: skip
    limits = parse_limits(["tilt=20deg", "rate=1rad/s", "position=200cm"])
    assert (limits.tilt_rad, limits.rate_rad_s) == pytest.approx((np.pi / 9.0, 1.0), rel=1e-14)
    assert limits.position_m == 2.0
    assert parse_limits(["tilt=20"]) == parse_limits(["tilt=20deg"])
    assert parse_known(["D=25cm:1mm", "I_zz=0.01"]) == {"D": (0.25, 0.001), "I_zz": (0.01, 0.0)}
    assert parse_percents(["m=5%", "tau=2"], option="--vary") == {"m": 5.0, "tau": 2.0}
    assert parse_weights(["q/pitch_command=50%"]) == {"q/pitch_command": 0.5}


def test_amplitudes_come_in_the_unit_of_their_entry(tmp_path: Path) -> None:
    """Of an attitude in degrees, say; the vehicle says at what place of the cascade the test input is added."""
    words = ("design", "doublet", "--vehicle", "x500", "--quiet")
    assert rotorid(*words, "--amplitude", "roll=9deg", "--out", tmp_path / "plan").code == 0
    (one,) = json.loads((tmp_path / "plan" / "plan.json").read_text(encoding="utf-8"))["inputs"]
    assert one["amplitude"] == pytest.approx(np.radians(9.0), rel=1e-12)
    refused = rotorid(*words, "--amplitude", "roll=9deg/s", "--out", tmp_path / "none")
    assert refused.code == 2
    assert "--amplitude roll is in rad/s; expected rad." in refused.err
    assert not (tmp_path / "none").exists()


@pytest.mark.parametrize(
    ("read", "text", "said"),
    [(parse_band, "1m:2m", "is in m"), (parse_numbers, "10Hz", "is in rad/s"),
     (parse_segment, "roll:1m:2m", "is in m"), (parse_wind, "3deg", "is in rad"),
     (lambda text: parse_changes([text]), "m=20ms", "is in s; expected .* m in kg"),
     (lambda text: parse_changes([text]), "m=620g", "grams or gravity"),
     (lambda text: parse_changes([text, text]), "m=1", "--set m is given twice"),
     (lambda text: parse_changes([text]), "=1", "expected NAME=VALUE"),
     (lambda text: parse_changes([text]), "I_xx=2s", "is in s"),
     (lambda text: parse_limits([text]), "tilt=2m", "tilt in deg"),
     (lambda text: parse_known([text]), "D=2kg", "is in kg"),
     (lambda text: parse_shifts([text]), "p:2Hz", "is in rad/s"),
     (lambda text: parse_fix([text]), "m=620g", "grams or gravity"), (parse_low_pass, "5ms", "is in s"),
     (lambda text: parse_fix([text]), "m=5parsec", "unknown unit 'parsec'"),
     (lambda text: parse_constants([text]), "theta0=2Hz", "--constant theta0 is in rad/s; expected rad"),
     (lambda text: parse_constants([text]), "speed=2Hz", "expected SI without a unit")],
)  # fmt: skip
def test_a_unit_of_something_else_is_refused_by_name(read: Callable[[str], Any], text: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read(text)


@pytest.mark.parametrize(
    ("model", "fix", "said"),
    [("rate.roll", "L_p=-2Hz", "--fix L_p is in rad/s; expected 1/s"),
     ("rate.roll", "tau_roll=2m", "expected s"),
     ("physical.motors", "m=20ms", "--fix m is in s; expected kg"),
     ("physical.hover", "D=2kg", "expected m"),
     ("hover.lateral,rate.yaw", "L_p=2Hz", "expected 1/s"), ("all", "L_p=2Hz", "expected SI without a unit"),
     ("response.first_order", "tau=2ms", "expected SI without a unit")],
)  # fmt: skip
def test_a_value_to_hold_is_in_the_unit_of_its_parameter(model: str, fix: str, said: str, flight: Path) -> None:
    ran = rotorid("identify", flight, "--model", model, "--fix", fix)
    assert ran.code == 2
    assert said in ran.err


def test_a_value_to_hold_may_have_its_unit(flight: Path, tmp_path: Path) -> None:
    ran = rotorid("identify", flight, *ROLL, "--fix", "tau_roll=10ms", "--json", "--out", tmp_path)
    assert json.loads(ran.out)["parameters"]["tau_roll"]["value"] == 0.01
    assert json.loads(ran.out)["provenance"]["settings"]["fix"] == ["tau_roll=0.01"]


def test_options_of_commands_alone_come_with_units(flight: Path, tmp_path: Path) -> None:
    for words, said in (
        (("track", flight, "--first", "2kg"), "--first '2kg' is in kg"),
        (("export", tmp_path, "--to", "json", "--sample-rate", "2m"), "--sample-rate '2m' is in m"),
        (("simulate", tmp_path, "--log", flight, "--pieces", "2Hz"), "--pieces '2Hz' is in rad/s"),
        (("fleet", flight, "--timeout", "2m"), "--timeout '2m' is in m"),
    ):
        ran = rotorid(*words)
        assert ran.code == 2
        assert said in ran.err
    ran = rotorid("track", flight, "--first", "1min", "--out", tmp_path / "track", "--json")
    assert json.loads(ran.out)["provenance"]["settings"]["first_s"] == 60.0


def test_many_options_stand_under_headings() -> None:
    text = CliRunner().invoke(app, ["identify", "--help-all"], env={"COLUMNS": "200"}).output
    headings = re.findall(r"^(\S.*):$", text, flags=re.MULTILINE)
    models = ["Models", "Models in physical parameters", "Judging"]
    assert sorted(headings[2:-2]) == sorted([*models, "Responses", "Data", "Fit"])
    assert [*headings[:2], *headings[-2:]] == ["Examples", "Arguments", "Results", "Options"]
    assert "--taper hann|half_sine" in text
    assert "--weights auto|cifer|covariance" in text
    assert "--curve auto|linear|quadratic|affine|polynomial" in text
    assert "--arm METERS" in text
    few = CliRunner().invoke(app, ["models", "--help"]).output
    assert "Options:" in few
    assert "Results:" not in few


@pytest.mark.parametrize("command", ["design", "simulate", "tune", "export"])
def test_headings_are_those_of_the_command(command: str) -> None:
    text = CliRunner().invoke(app, [command, "--help-all"], env={"COLUMNS": "200"}).output
    headings = re.findall(r"^(\S.*):$", text, flags=re.MULTILINE)
    assert "Fit" not in headings
    assert "Responses" not in headings
    assert {"--seed", "--help-all", "-h,"} == {
        line.split()[0] for line in text.partition("\nOptions:\n")[2].splitlines() if "-" in line
    }


# What the page of the lab takes is declared beside it.
@pytest.mark.parametrize("command", sorted({*COMMANDS} - {"lab", "run"}))
def test_help_says_what_an_option_takes(command: str) -> None:
    text = CliRunner().invoke(app, [command, "--help-all"], env={"COLUMNS": "200"}).output
    assert not re.findall(r"--\S+ <(?:str|list|text)\S*", text)


@pytest.mark.parametrize(
    ("kind", "field", "words"),
    [(IdentifySettings, "curve", ("auto", *get_args(Curve))), (SimulateSettings, "format", get_args(LogFormat)),
     (PlanSettings, "entry", get_args(Entry))],
)  # fmt: skip
def test_listed_words_are_all_that_there_are(kind: type, field: str, words: tuple[str, ...]) -> None:
    (item,) = [item for item in fields(kind) if item.name == field]
    option = option_of(item)
    assert option is not None
    assert option.words == words


def test_a_terminal_sees_colors_and_a_pipe_does_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    console.say("rotorid: no")
    assert capsys.readouterr().err == "rotorid: no\n"
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    for name in ("NO_COLOR", "FORCE_COLOR", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    for terminal, without, expected in (
        ("xterm", "", "\x1b[1;31mrotorid:\x1b[0m no\n"),
        ("xterm", "1", "\x1b[1mrotorid:\x1b[0m no\n"),
        ("dumb", "", "rotorid: no\n"),
    ):
        monkeypatch.setenv("TERM", terminal)
        monkeypatch.setenv("NO_COLOR", without)
        console.say("rotorid: no")
        assert capsys.readouterr().err == expected


def test_a_finding_has_the_color_of_what_it_says(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("TERM", "xterm")
    for name in ("NO_COLOR", "FORCE_COLOR", "COLORTERM"):
        monkeypatch.delenv(name, raising=False)
    console.print_findings([warn("gaps", "p", "Two gaps."), warn("gaps", "q", "Two gaps.")])
    said = capsys.readouterr().out
    assert said == "\x1b[1;33mwarning\x1b[0m gaps (2 times): Two gaps.\n"


def test_a_band_beside_the_excitation_is_remarked_on() -> None:
    sweep = Maneuver(axis="roll", kind="sweep", start_s=0.0, stop_s=60.0, band_rad_s=(1.0, 64.0), origin="found")
    flights = [SimpleNamespace(maneuver=sweep)]
    (said,) = _band_outside_excitation((0.1, 4.0), flights)  # type: ignore[arg-type]
    assert said.kind == "band_beside_excitation"
    assert said.numbers["kept_percent"] == pytest.approx(100.0 / 3.0)
    assert "--band 0.1:4Hz" in said.message
    for band in ((1.0, 40.0), (2.0, 20.0), None):
        assert _band_outside_excitation(band, flights) == ()  # type: ignore[arg-type]
    for band in ((200.0, 300.0), (32.0, 60.0)):
        # Hz would be still farther off.
        (said,) = _band_outside_excitation(band, flights)  # type: ignore[arg-type]
        assert "--band 1:64." in said.message
        assert "Hz" not in said.message


def test_of_a_binary_signal_the_power_of_the_input_decides() -> None:
    time_s = np.arange(0.0, 60.0, 0.01)
    steps = np.where(np.repeat(np.random.default_rng(3).random(60), 100) > 0.5, 0.2, -0.2)
    torque = np.diff(lfilter([0.1], [1.0, -0.9], steps), prepend=0.0)
    channels = tuple(Channel(name=name, unit="1", source=name) for name in ("theta_setpoint", "pitch_command"))
    topic = Topic(name="clock", time_s=time_s, channels=channels, values=np.stack([steps, torque]))
    record = FlightRecord(source=Source(name="a", format="CSV", sha256="a"), topics=(topic,))
    kind, band = classify(time_s, steps)
    assert kind == "random_binary"
    assert band is not None
    assert band[1] < 4.0
    maneuver = Maneuver(axis="pitch", kind=kind, start_s=0.0, stop_s=59.99, band_rad_s=band, signal="theta_setpoint")
    flights = [Flight(record, maneuver)]
    # Half periods end at 3 rad/s: by them this band keeps nothing, and it holds most of the power of the input.
    assert _band_outside_excitation((4.0, 40.0), flights, ("pitch_command",)) == ()
    (found,) = _band_outside_excitation((0.01, 0.1), flights, ("pitch_command",))
    assert found.numbers["kept_percent"] == 0.0


def test_a_page_is_printed(tmp_path: Path) -> None:
    if not any(shutil.which(name) for name in BROWSERS):
        pytest.skip("no browser that prints")
    (tmp_path / "a.html").write_text("<h1>Flight</h1>", encoding="utf-8")
    (printed,) = print_pages(tmp_path)
    assert printed == tmp_path / "a.pdf"
    assert printed.read_bytes().startswith(b"%PDF")
