"""The picture of a log: what it holds, that it is self-contained, and that no name in a log can act."""

from __future__ import annotations

import html
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.checking.response_flight import flight as answering_flight
from tests.unit.cli.commands import rotorid

from rotorid.data.findings import Finding
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.errors import UsageError
from rotorid.report import inspection as page_of_log
from rotorid.report.inspection import log_picture, render_inspection, write_inspection
from rotorid.report.inspection_words import good_for, not_for
from rotorid.reviewing.inspection import inspect
from rotorid.settings.parsing import parse_segment

EVIL = "</script><script>alert(1)</script>[bold]"


def topic(name: str, time_s: np.ndarray, **channels: np.ndarray) -> Topic:
    return Topic(
        name=name,
        time_s=time_s,
        channels=tuple(Channel(name=key, unit=STANDARD_UNITS[key]) for key in channels),
        values=np.stack(list(channels.values())),
    )


def flight() -> FlightRecord:
    """Motion of no pattern on roll, a gap in the gyro, a battery; names that try to act."""
    time_s = np.arange(0.0, 40.0, 0.01)
    moving = (time_s > 5.0) & (time_s < 35.0)
    sines = sum(np.sin(2.0 * np.pi * f * time_s + f**2) for f in (0.31, 0.53, 0.82, 1.13))
    motion = np.where(moving, 0.05 * sines, 0.0)
    kept = (time_s < 20.0) | (time_s > 21.0)
    return FlightRecord(
        source=Source(name=f"{EVIL}.csv", format="CSV", sha256="ab"),
        topics=(
            topic(EVIL, time_s, roll_command=motion),
            topic("gyro", time_s[kept], p=motion[kept]),
            topic("battery", time_s[::100], battery_voltage=np.linspace(17.0, 14.0, 40).clip(15.0, 16.0)),
        ),
        parameters={"LOG_BITMASK": 1.0, "UNINTERESTING": 2.0},
        findings=(Finding(kind="gap", severity="warning", where="gyro", message=EVIL),),
    )


@pytest.fixture(scope="module")
def page() -> str:
    record = flight()
    return render_inspection(record, inspect(record))


def test_the_document_names_candidates_battery_and_settings() -> None:
    document = inspect(flight())
    (candidate,) = document.candidates
    segment = parse_segment(candidate.segment)
    assert (segment.axis, segment.start_s) == ("roll", pytest.approx(candidate.start_s, abs=0.005))
    assert f"--segment {candidate.segment}" in document.supports["rate.roll"].remedy
    assert document.battery is not None
    assert (document.battery.start_v, document.battery.stop_v, document.battery.lowest_v) == (16.0, 15.0, 15.0)
    assert document.settings == {"LOG_BITMASK": 1.0}
    needs = {need.need: need.there for need in document.supports["rate.roll"].needs}
    assert list(needs.values()) == [True, True, False, False]
    assert [need.found for need in document.supports["rate.pitch"].needs][:2] == ["not logged", "not logged"]


def test_bars_break_where_a_topic_does() -> None:
    record = flight()
    bars = {bar.row: bar for bar in log_picture(record, inspect(record)).topics}
    (first, second) = bars["gyro"].spans
    assert (first[0], second[1]) == (0.0, pytest.approx(39.99))
    # One sample on either side of the missing second.
    assert (first[1], second[0]) == (pytest.approx(19.99), pytest.approx(21.01))


def test_runs_of_one_channel_are_joined_with_a_break() -> None:
    early, late = np.arange(0.0, 100.0, 0.01), np.arange(200.0, 260.0, 0.01)
    record = FlightRecord(
        source=Source(name="a.BIN", format="CSV", sha256=""),
        topics=tuple(
            topic(f"run {at}", time_s, p=np.sin(time_s), roll_excitation=np.cos(time_s))
            for at, time_s in enumerate((late, early))
        ),
    )
    rate = next(trend for trend in log_picture(record, inspect(record)).trends if trend.channel == "p")
    assert (rate.time_s[0], rate.time_s[-1]) == (0.0, pytest.approx(259.99))
    breaks = np.flatnonzero(np.isnan(rate.values[:-1]))
    assert breaks.size == 1
    assert rate.time_s[breaks[0]] < 100.0 <= 200.0 <= rate.time_s[breaks[0] + 1]


def test_the_page_is_self_contained_and_nothing_in_a_log_acts(page: str) -> None:
    assert "default-src 'none'" in html.unescape(page)
    assert not re.search(r"<(?:link|img|iframe)\b|<script[^>]+src=", page)
    # Three scripts are ours: the numbers, the library, the drawing. The name of the log adds none.
    assert len(re.findall(r"<script(?: type=\"application/json\" id=\"figures\")?>", page)) == 3
    assert "alert(1)</script>" not in page


def test_the_page_holds_what_was_asked_for(page: str) -> None:
    for words in ("What each model needs", "Channels and rates", "Test inputs", "LOG_BITMASK = 1", "16.00"):
        assert words in page
    assert re.search(r"--segment roll:\d+\.\d\d:\d+\.\d\d", page)
    text = re.search(r'id="figures">(.*?)</script>', page, re.DOTALL)
    assert text is not None
    figure = json.loads(text[1])["pictures"]["log"]
    assert {"candidate", "logged", "input", "output"} <= {trace["name"] for trace in figure["data"]}
    assert all(len(trace["x"]) == len(trace["y"]) for trace in figure["data"])


def test_a_long_log_makes_no_long_page(page: str) -> None:
    time_s = np.arange(0.0, 4000.0, 0.01)
    record = FlightRecord(
        source=Source(name="a.csv", format="CSV", sha256=""),
        topics=(topic("t", time_s, roll_command=np.sin(time_s), p=np.cos(time_s)),),
    )
    # At most 4000 points of two numbers with ten letters for each of two channels, beside the same page.
    assert len(render_inspection(record, inspect(record))) < len(page) + 2 * 4000 * 2 * 10


def test_png_and_html_are_written_by_their_ending(tmp_path: Path) -> None:
    record = flight()
    document = inspect(record)
    write_inspection(tmp_path / "made" / "log.png", record, document)
    assert (tmp_path / "made" / "log.png").read_bytes().startswith(b"\x89PNG")
    write_inspection(tmp_path / "log.HTML", record, document)
    assert (tmp_path / "log.HTML").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    with pytest.raises(UsageError, match=r"expected \.html or \.png"):
        write_inspection(tmp_path / "log.pdf", record, document)


def test_an_empty_log_has_a_page() -> None:
    record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=())
    assert "None found." in render_inspection(record, inspect(record))


def test_the_command_writes_the_picture_beside_pure_json(tmp_path: Path) -> None:
    log, picture = tmp_path / "log.csv", tmp_path / "log.html"
    rows = "\n".join(f"{0.01 * k:.2f},{np.sin(0.05 * k):.4f}" for k in range(1000))
    log.write_text(f"time [s],p [rad/s]\n{rows}\n", encoding="utf-8")
    ran = rotorid("inspect", log, "--plot", picture, "--json")
    assert (ran.code, ran.err) == (0, "")
    assert json.loads(ran.out)["schema"] == "rotorid.inspect/1"
    assert picture.exists()


def test_another_ending_is_refused_before_the_log_is_read(tmp_path: Path) -> None:
    ran = rotorid("inspect", tmp_path / "missing.csv", "--plot", tmp_path / "log.pdf")
    assert ran.code == 2
    assert "log.pdf" in ran.err


def test_the_screen_groups_motors_and_shows_the_line_to_paste(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    motors = [f"motor_{n}" for n in range(1, 5)]
    time_s = np.arange(0.0, 30.0, 0.01)
    sines = 0.05 * sum(np.sin(2.0 * np.pi * f * time_s + f**2) for f in (0.31, 0.53, 0.82, 1.13))
    header = ",".join(["time [s]", "roll_command [1]", *(f"{name} [1]" for name in motors)])
    table = np.column_stack([time_s, sines, *(np.full(time_s.size, 0.5) for _ in motors)])
    np.savetxt(log, table, delimiter=",", header=header, comments="", fmt="%.5f")
    ran = rotorid("inspect", log)
    assert (ran.code, ran.err) == (0, "")
    assert re.search(r"--segment roll:\d", ran.out)
    assert "motor_1…4" in rotorid("inspect", log, "-v").out


def test_a_table_of_motors_and_rates_is_good_for_their_physics_with_a_layout(tmp_path: Path) -> None:
    """Columns as an engineer writes them: nothing says where the rotors are, and two options do."""
    rng, log = np.random.default_rng(3), tmp_path / "log.csv"
    names = {**{f"motor_{n}": "1" for n in range(1, 5)}, **dict.fromkeys("pqr", "rad/s")}
    names |= dict.fromkeys(("ax", "ay", "az"), "m/s^2")
    time_s = np.arange(0.0, 30.0, 0.01)
    table = [np.repeat(rng.uniform(0.45, 0.55, 300), 10) for _ in range(4)]
    table += [0.2 * rng.standard_normal(time_s.size) for _ in "pqr"]
    table += [0.2 * rng.standard_normal(time_s.size) - level for level in (0.0, 0.0, 9.81)]
    header = ",".join(["time [s]", *(f"{name} [{unit}]" for name, unit in names.items())])
    np.savetxt(log, np.column_stack([time_s, *table]), delimiter=",", header=header, comments="", fmt="%.5f")
    ran = rotorid("inspect", log)
    assert (ran.code, ran.err) == (0, "")
    options = ran.out.partition("good for, with what the log does not say")[2].partition("not for")[0]
    assert "rotorid identify log.csv --model physical.motors --layout quad.x --arm METERS" in options
    assert "physical.motors" not in ran.out.partition("not for")[2]


def test_flights_and_checks_are_shown() -> None:
    record = flight()
    time_s = record.topics[0].time_s
    thrust = np.where((time_s > 4.0) & (time_s < 36.0), 0.4, 0.0)
    rate = np.convolve(np.random.default_rng(0).standard_normal(time_s.size), np.hanning(20), "same")
    late = topic("late", time_s + 0.05, p=rate)
    more = (topic("gyro", time_s, p=rate, phi=np.cumsum(rate) * 0.01), topic("thrust", time_s, thrust_command=thrust))
    flown = replace(record, topics=(*more, late))
    document = inspect(flown)
    (bar,) = (bar for bar in log_picture(flown, document).excitations if bar.group == "flight")
    assert bar.spans == [(pytest.approx(4.01), pytest.approx(35.99))]
    shown = html.unescape(render_inspection(flown, document))
    assert "Do sensors and clocks agree" in shown
    (remedy,) = (row.remedy for row in document.skews if row.nature == "same_channel")
    assert float(remedy.removeprefix("--shift p:")) == pytest.approx(0.05, abs=0.5e-3)
    assert remedy in shown


def test_a_log_that_never_flew_is_refused_in_one_line_that_no_finding_repeats() -> None:
    record = flight()
    time_s = record.topics[0].time_s
    names = [f"{axis}_command" for axis in ("roll", "pitch", "yaw", "thrust")] + [f"motor_{n}" for n in range(1, 5)]
    rows = {**dict.fromkeys(names, 0.0), "az": -9.81}
    still = {name: np.full(time_s.size, value) for name, value in rows.items()}
    noise = 1e-3 * np.random.default_rng(0).standard_normal((3, time_s.size))
    bench = topic("bench", time_s, **still, **dict(zip("pqr", noise, strict=True)))
    grounded = replace(record, topics=(bench,), status=Status(armed=(), in_air=(), flagged_in="arming"))
    inspection = inspect(grounded)
    (row,) = not_for(inspection)
    assert row.what == "any model"
    assert row.why.startswith("the log has no flight of 2 s and more")
    assert "sweep" not in row.remedy
    assert "never_airborne" in {finding.kind for finding in inspection.findings}
    assert (
        html.unescape(render_inspection(grounded, inspection)).count("no flight of 2 s and more") == 2
    )  # answer, table


def test_a_picture_that_fails_leaves_a_sentence_on_its_page(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> None:
        raise KeyError("<panel>")

    monkeypatch.delenv("ROTORID_STRICT", raising=False)
    monkeypatch.setattr(page_of_log, "log_figure", broken)
    record = flight()
    shown = page_of_log.render_inspection(record, inspect(record))
    assert "This picture could not be computed because of a fault in rotorid" in shown
    assert "<panel>" not in shown
    assert "rate.roll" in shown


def test_a_log_of_answers_to_set_points_leads_to_their_model() -> None:
    inspection = inspect(answering_flight())
    assert good_for(inspection) == (("response.first_order_delay", "from its set-points"),)
    assert any("--model response.first_order_delay" in command for command in inspection.next_commands)
    # A set-point that did not move has no answer.
    still = replace(inspection, excitations=(), candidates=())
    assert good_for(still) == ()
