"""What a notebook user has: channels by name, short texts, tables, pictures, pandas and xarray on request."""

from __future__ import annotations

import pickle
import sys
from typing import Any

import numpy as np
import pytest

import rotorid
from rotorid.data.display import MOST_LINES, brief, dataclass_text, html_table
from rotorid.data.findings import Finding, Findings, warn
from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import Channel, FlightRecord, Maneuver, Maneuvers, MotorRecord, Source, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse

SAMPLES = 5000


def record(topics: int = 60) -> FlightRecord:
    """A log of many topics, each with names that nobody wants to read as HTML."""
    time_s = np.arange(SAMPLES) / 100.0
    channels = (Channel(name="p", unit="rad/s"), Channel(name="<b>roll</b>", unit="1"))
    return FlightRecord(
        source=Source(name="flight.BIN", format="dataflash", sha256="0" * 64, firmware="ArduCopter 4.5"),
        topics=tuple(
            Topic(name=f"T{n}", time_s=time_s + n, channels=channels, values=np.full((2, SAMPLES), float(n)))
            for n in range(topics)
        ),
        parameters={f"PARAMETER_{n}": float(n) for n in range(900)},
        declared=tuple(Maneuver(axis="roll", kind="sweep", start_s=n, stop_s=n + 1.0) for n in range(30)),
        findings=tuple(warn("gap", "p", "Samples\nare missing. " * 30, longest_s=n) for n in range(50)),
    )


def history() -> TimeHistory:
    channels = tuple(Channel(name=f"motor_{n}", unit="1") for n in range(40))
    return TimeHistory(values=np.ones((40, SAMPLES)), channels=channels, sample_rate_hz=100.0, start_s=3.0)


def response(outputs: int = 6) -> FrequencyResponse:
    omega = np.geomspace(1.0, 60.0, 90)
    shape = (outputs, 4, omega.size)
    return FrequencyResponse(
        omega_rad_s=omega,
        values=np.ones(shape, complex),
        coherence=np.full(shape, 0.9),
        random_error=np.full(shape, 0.02),
        covariance=np.zeros((*shape, omega.size), complex),
        inputs=tuple(f"motor_{n + 1}" for n in range(4)),
        outputs=tuple(f"y{n}" for n in range(outputs)),
        estimate="direct",
    )


def shown() -> dict[str, Any]:
    flight = SimulatedFlight(
        vehicle="demo",
        autopilot="px4",
        sample_rate_hz=100.0,
        time_s=np.arange(SAMPLES) / 100.0,
        columns={f"c{n}": np.zeros(SAMPLES) for n in range(40)},
    )
    motors = MotorRecord(
        name="m", sample_rate_hz=9.0, outputs=np.ones((4, SAMPLES)), rates=np.ones((3, SAMPLES)), az=np.ones(SAMPLES)
    )
    whole = record()
    return {
        "record": whole,
        "history": history(),
        "response": response(),
        "topic": whole.topics[0],
        "track": whole["p"],
        "findings": whole.findings,
        "finding": whole.findings[0],
        "maneuvers": whole.declared,
        "flight": flight,
        "motors": motors,
    }


@pytest.mark.parametrize("name", shown())
def test_text_has_at_most_twenty_lines(name: str) -> None:
    text = repr(shown()[name])
    assert len(text.splitlines()) <= MOST_LINES
    assert max(map(len, text.splitlines())) <= 240


@pytest.mark.parametrize("name", ["record", "history", "response", "findings", "finding", "maneuvers"])
def test_a_notebook_gets_a_table_of_escaped_text(name: str) -> None:
    table = shown()[name]._repr_html_()
    assert table.count("<table>") == table.count("</table>") >= 1
    assert "<b>roll</b>" not in table


def test_a_channel_comes_with_its_stamps_and_calculates_like_an_array() -> None:
    track = record()["p"]
    assert (track.name, track.unit, track.topic, len(track)) == ("p", "rad/s", "T0", SAMPLES)
    np.testing.assert_array_equal(track.time_s, np.arange(SAMPLES) / 100.0)
    assert isinstance(2.0 * track + track, np.ndarray)
    assert isinstance(np.degrees(track), np.ndarray)
    np.testing.assert_array_equal(np.asarray(track), track.values)
    np.testing.assert_array_equal(track[10:20], track.values[10:20])
    with pytest.raises(ValueError, match="read-only"):
        track.values[0] = 1.0
    assert not pickle.loads(pickle.dumps(track)).values.flags.writeable


def test_an_unknown_channel_is_a_key_error_that_lists_the_others() -> None:
    with pytest.raises(KeyError, match=r"no channel 'rol'; there are p, <b>roll</b>"):
        record()["rol"]
    assert "p" in record()
    assert "motor_1" in history()
    assert "q" not in record()


def test_a_loop_over_a_record_is_refused() -> None:
    for value in (record(), history()):
        with pytest.raises(TypeError, match="not iterable"):
            list(value)  # type: ignore[call-overload]


def test_tuples_that_show_themselves_are_tuples() -> None:
    whole = record()
    assert whole.findings == tuple(whole.findings)
    assert isinstance(whole.declared, tuple)
    assert repr(Findings()) == "0 findings"
    assert repr(Maneuvers()) == "0 maneuvers"
    assert pickle.loads(pickle.dumps(whole)).findings == whole.findings


def test_pictures_of_values() -> None:
    assert len(record(topics=2).plot("p")["data"]) == 1
    assert len(record(topics=2).plot()["data"]) == 1
    assert len(history().plot("motor_1", "motor_2")["data"]) == 2
    assert len(record()["p"].plot()["data"]) == 1
    whole = response()
    assert whole.plot.bode() == whole.plot() == rotorid.bode(whole, output="y0", input="motor_1")
    assert whole.plot.bode("y1", "motor_2", frequency="Hz") != whole.plot()
    for picture in (record(topics=2).plot, history().plot):
        with pytest.raises(rotorid.UsageError, match="has no rol"):
            picture("rol")
    with pytest.raises(rotorid.UsageError, match="unknown output p; expected one of y0"):
        whole.plot.bode("p")


@pytest.mark.parametrize(
    ("package", "ask"),
    [
        ("pandas", lambda: record(topics=1).to_pandas()),
        ("pandas", lambda: record()["p"].to_pandas()),
        ("pandas", lambda: history().to_pandas()),
        ("xarray", lambda: response().to_xarray()),
    ],
    ids=["record", "track", "history", "response"],
)
def test_a_package_that_is_not_installed_is_named(package: str, ask: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(rotorid.UsageError, match=f"{package} is not installed; pip install {package}"):
        ask()


def test_frames_of_pandas() -> None:
    pytest.importorskip("pandas")
    frames = record(topics=2).to_pandas()
    assert list(frames) == ["T0", "T1"]
    assert frames["T1"].index[0] == 1.0
    assert frames["T0"].attrs["units"]["p"] == "rad/s"
    assert history().to_pandas()["motor_1"].shape == (SAMPLES,)
    assert record()["p"].to_pandas().name == "p"


def test_dataset_of_xarray() -> None:
    pytest.importorskip("xarray")
    dataset = response().to_xarray()
    assert dataset["response"].sel(output="y1", input="motor_2").shape == (90,)
    assert dataset.attrs["estimate"] == "direct"


def test_long_values_are_told_by_their_size() -> None:
    assert brief("a" * 1000).endswith("…")
    assert brief({f"p{n}": n for n in range(50)}) == "<50 entries>"
    assert brief((1.0, "a")) == "(1.0, 'a')"
    assert dataclass_text(Finding(kind="gap", severity="info", where="p", message="x" * 500)).startswith("Finding(\n")
    assert "… 1 more" in html_table("three", ["n"], [["1"], ["2"], ["3"]], most=2)
