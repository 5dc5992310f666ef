"""The controller of a log is one, whoever reads it, and so is whether its gains made the commands."""

from __future__ import annotations

import pickle
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.flights.controller_readers import readings, verdicts
from tests.unit.flights.test_controllers import BETAFLIGHT, NEW, OLD, PX4, flight

from rotorid.data.findings import warn
from rotorid.data.quantity import with_error
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.controller_check import SAME_GAIN, check_controller, check_given, controller_findings
from rotorid.flights.controllers import EXPLAINED, controllers_of
from rotorid.loops.plants import PlantUnavailableError
from rotorid.loops.rate_loops import rate_loop
from rotorid.models.autopilots import axis_controller

ARDUPILOT = {
    **{
        f"ATC_RAT_{axis}_{name}": value
        for axis in ("RLL", "PIT")
        for name, value in {"P": 0.135, "I": 0.135, "D": 0.0036, "FLTT": 20.0, "FLTD": 20.0, "FLTE": 0.0}.items()
    },
    "SCHED_LOOP_RATE": 250.0,
}
RACER = "Betaflight 4.3.0"


def made(
    parameters: Mapping[str, float], firmware: str, *, logged: Mapping[str, float] | None = None, **how: object
) -> FlightRecord:
    """A flight of some gains, whose log names others."""
    record = flight(parameters, flew=firmware, declared=firmware, **how)  # type: ignore[arg-type]
    return record if logged is None else replace(record, parameters=dict(logged))


def scaled(parameters: Mapping[str, float], factor: float, letters: str = "PID") -> dict[str, float]:
    own = tuple(f"RATE_{letter}" for letter in letters) + tuple(f"PID_{letter}" for letter in letters)
    ardupilot = tuple(f"ATC_RAT_{axis}_{letter}" for axis in ("RLL", "PIT") for letter in letters)
    return {
        name: value * factor if name.endswith(own) or name in ardupilot else value for name, value in parameters.items()
    }


FLIGHTS = {
    "PX4 of today": (PX4, NEW, {}),
    "PX4 before 1.12": (PX4, OLD, {}),
    "ArduPilot": (ARDUPILOT, "ArduCopter V4.6.2", {"kind": "ArduPilot DataFlash"}),
    "Betaflight with terms": (BETAFLIGHT, RACER, {"kind": "Betaflight blackbox", "terms": True, "rate_hz": 1000.0}),
    "Betaflight without": (BETAFLIGHT, RACER, {"kind": "Betaflight blackbox", "rate_hz": 1000.0}),
}


@pytest.mark.parametrize("name", FLIGHTS)
def test_all_readers_have_one_controller_and_one_verdict(name: str) -> None:
    parameters, firmware, how = FLIGHTS[name]
    record = made(parameters, firmware, **how)
    for axis in ("roll", "pitch"):
        found = readings(record, axis)  # type: ignore[arg-type]
        assert found["tune"] is not None
        assert len(set(found.values())) == 1, found
        assert set(verdicts(record, axis).values()) == {"made"}  # type: ignore[arg-type]


@pytest.mark.parametrize("name", FLIGHTS)
@pytest.mark.parametrize("factor", [1.2, 0.8, 2.0, 0.5])
def test_gains_that_did_not_fly_are_found_by_all(name: str, factor: float) -> None:
    parameters, firmware, how = FLIGHTS[name]
    record = made(parameters, firmware, logged=scaled(parameters, factor), **how)
    check = check_controller(record, "roll")
    # Without its terms a Betaflight may have moved its gains: that is no proof of others.
    expected = "not checked" if name == "Betaflight without" else "not made"
    assert check.verdict == expected
    assert set(verdicts(record, "roll").values()) == {expected}
    if expected == "not made":
        path = (check.terms or check.paths)["p"]
        assert path.slope == pytest.approx(1.0 / factor, abs=0.03)
        assert f"{with_error(path.slope, max(path.std, 0.005))} times their P" in check.why


@pytest.mark.parametrize("letter", "PD")
@pytest.mark.parametrize("factor", [1.2, 0.8])
def test_one_gain_alone_is_found(letter: str, factor: float) -> None:
    record = made(PX4, NEW, logged=scaled(PX4, factor, letter))
    check = check_controller(record, "roll")
    share = check.paths[letter.lower()].share
    assert check.verdict == "not made", (letter, share)
    other = check.paths["d" if letter == "P" else "p"]
    assert other.slope == pytest.approx(1.0, abs=0.5 * SAME_GAIN)


def test_a_derivative_between_its_ends_flew() -> None:
    header = BETAFLIGHT | {"d_min_0": 20.0, "d_min_1": 20.0}
    for share in (0.75, 1.0):
        flew = BETAFLIGHT | {"rollPID_D": 30.0 * share}
        record = made(flew, RACER, logged=header, kind="Betaflight blackbox", terms=True, rate_hz=1000.0)
        check = check_controller(record, "roll")
        assert (check.verdict, round(check.terms["d"].slope, 2)) == ("made", share)
    flew = BETAFLIGHT | {"rollPID_D": 60.0}
    record = made(flew, RACER, logged=header, kind="Betaflight blackbox", terms=True, rate_hz=1000.0)
    assert check_controller(record, "roll").verdict == "not made"


def without(record: FlightRecord, *names: str) -> FlightRecord:
    (topic,) = record.topics
    rows = [row for row, channel in enumerate(topic.channels) if channel.name not in names]
    less = replace(topic, channels=tuple(topic.channels[row] for row in rows), values=topic.values[rows])
    return replace(record, topics=(less,))


def thinned(record: FlightRecord, step: int) -> FlightRecord:
    (topic,) = record.topics
    return replace(record, topics=(replace(topic, time_s=topic.time_s[::step], values=topic.values[:, ::step]),))


def until(record: FlightRecord, stop_s: float) -> FlightRecord:
    (topic,) = record.topics
    kept = topic.time_s < stop_s
    return replace(record, topics=(replace(topic, time_s=topic.time_s[kept], values=topic.values[:, kept]),))


WHOLE = made(PX4, NEW)
OLDER = {name: value for name, value in BETAFLIGHT.items() if not name.startswith("dterm")}


@pytest.mark.parametrize(
    ("record", "why"),
    [
        (without(WHOLE, "p_setpoint"), "The log has no p_setpoint"),
        (without(WHOLE, "roll_command"), "The log has no roll_command"),
        (thinned(WHOLE, 25), "are logged at 10 Hz, below 20 Hz"),
        (until(WHOLE, 8.0), "The flight has no 10 s of roll command and rate without a gap"),
        (made(PX4, NEW, noise=3.0), "Set-point and rate of roll explain too little of its command"),
    ],
)
def test_what_was_not_checked_is_neither_good_nor_bad(record: FlightRecord, why: str) -> None:
    check = check_controller(record, "roll")
    assert check.verdict == "not checked"
    assert why in check.why
    (finding,) = check.findings
    assert finding.kind == "controller_unchecked"
    assert finding.message == f"{check.why}, so the logged gains could not be checked against the flight."
    assert set(verdicts(record, "roll").values()) == {"not checked"}


@pytest.mark.parametrize(
    ("parameters", "firmware", "why"),
    [
        ({}, NEW, "The log has no known gains for the roll controller"),
        ({"MC_ROLLRATE_P": 0.15, "MC_ROLLRATE_D": 0.0}, NEW, "lack MC_ROLLRATE_I"),
        ({"ATC_RAT_RLL_P": 0.1}, "ArduCopter V4.6", "lack ATC_RAT_RLL_D and ATC_RAT_RLL_I"),
        (OLDER, "", "does not name its firmware version"),
        (OLDER, "Betaflight 3.1.5", "older than version 4.0"),
        (OLDER, "INAV 7.1.2", "The roll controller of INAV 7.1.2 is not supported"),
    ],
)
def test_an_unknown_controller_has_one_reason(parameters: dict[str, float], firmware: str, why: str) -> None:
    record = replace(WHOLE, parameters=parameters, source=replace(WHOLE.source, firmware=firmware))
    assert set(readings(record, "roll").values()) == {None}
    assert why in controllers_of(record).unknown_gains("roll")[0]
    assert check_controller(record, "roll").why == controllers_of(record).unknown_gains("roll")[0]


@pytest.mark.parametrize(
    ("form", "firmware", "remedy"),
    [
        ("PX4 ULog", NEW, "log the parameters"),
        ("Betaflight blackbox", RACER, "fly Betaflight 4.0 or newer, whose gains are known"),
        ("CSV", "", "use the autopilot's own log, which contains its parameters"),
        ("MAVLink telemetry", NEW, "read the log on the autopilot's SD card: telemetry is only a slow copy"),
    ],
)
def test_what_would_show_the_gains_is_what_this_log_has(form: str, firmware: str, remedy: str) -> None:
    record = replace(WHOLE, parameters={}, source=replace(WHOLE.source, format=form, firmware=firmware))
    assert controllers_of(record).unknown_gains("roll")[1] == check_controller(record, "roll").remedy == remedy
    with pytest.raises(PlantUnavailableError) as refused:
        rate_loop("roll", record)
    assert refused.value.remedy == remedy
    # From a worker of another process too.
    again = pickle.loads(pickle.dumps(refused.value))
    assert (str(again), again.why, again.remedy) == (str(refused.value), refused.value.why, remedy)


def test_unknown_gains_are_the_reason_whatever_the_excitations_show(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(*_: object) -> None:
        raise InsufficientDataError("the sweep is too short")

    monkeypatch.setattr("rotorid.loops.rate_loops.swept_plant", nothing)
    with pytest.raises(PlantUnavailableError, match="no known gains for the roll controller"):
        rate_loop("roll", replace(WHOLE, parameters={}))


def moved(record: FlightRecord, name: str, factor: float) -> FlightRecord:
    """The log with another size of a channel, or on a clock that runs at another rate."""
    (topic,) = record.topics
    if name == "clock":
        return replace(record, topics=(replace(topic, time_s=topic.time_s * factor),))
    values = np.array(topic.values)
    values[topic.row(name)] *= factor
    return replace(record, topics=(replace(topic, values=values),))


@pytest.mark.parametrize(
    ("name", "channel", "factor"), [("PX4 of today", "clock", 1.0003), ("Betaflight with terms", "thrust_stick", 1.2)]
)
def test_gains_are_the_same_whatever_the_clock_and_the_throttle_of_a_flight(
    name: str, channel: str, factor: float
) -> None:
    parameters, firmware, how = FLIGHTS[name]
    first = made(parameters, firmware, **how)
    second = moved(first, channel, factor)
    one, other = (controllers_of(record).axis("roll") for record in (first, second))
    assert one is not None
    assert other is not None
    assert one.controller != other.controller
    with pytest.raises(PlantUnavailableError, match="Only the stick excited roll"):
        rate_loop("roll", [first, second])
    with pytest.raises(PlantUnavailableError, match="The gains changed between the logs"):
        rate_loop("roll", [first, replace(second, parameters=scaled(parameters, 1.2))])


def test_gains_that_contradict_each_other_are_named_with_the_verdict() -> None:
    changed = warn("parameters_changed", "parameters", "MC_ROLLRATE_P 0.15 to 0.3.")
    record = replace(made(PX4, NEW, logged=scaled(PX4, 2.0)), findings=(changed,))
    assert check_controller(record, "roll").why.endswith("; parameters changed during the log")
    (roll, pitch) = controller_findings(record)
    assert (roll.kind, roll.where, pitch.where) == ("controller_unexplained", "roll", "pitch")


def test_a_given_controller_is_checked_alike() -> None:
    own = controllers_of(WHOLE).axis("roll")
    assert own is not None
    for factor, verdict in ((1.0, "made"), (1.2, "not made")):
        given = replace(own.controller, proportional_s=factor * own.controller.proportional_s)
        found = check_given(WHOLE, "roll", given, setpoint="p_setpoint", driven="rate")
        assert found.verdict == verdict


def test_another_filter_shows_in_what_stays_unexplained() -> None:
    own = controllers_of(WHOLE).axis("roll")
    assert own is not None
    late = replace(own.controller, delay_s=0.02)
    found = check_given(WHOLE, "roll", late, setpoint="p_setpoint", driven="rate")
    assert found.verdict == "not made"
    assert found.unexplained is not None
    assert found.unexplained > EXPLAINED
    flew = check_controller(WHOLE, "roll")
    assert flew.unexplained is not None
    assert flew.unexplained < 0.05


def test_an_integral_that_limits_take_back_is_no_other_gain_and_a_larger_one_is() -> None:
    slow = PX4 | {f"MC_{axis}RATE_I": 6.0 for axis in ("ROLL", "PITCH")}
    held = made(slow | {"MC_ROLLRATE_I": 2.0}, NEW, logged=slow)
    assert (check_controller(held, "roll").verdict, check_controller(held, "roll").paths["i"].slope) == (
        "made",
        pytest.approx(1.0 / 3.0, abs=0.05),
    )
    assert check_controller(made(slow, NEW, logged=slow | {"MC_ROLLRATE_I": 2.0}), "roll").verdict == "not made"


def test_a_rate_that_is_logged_in_front_of_a_filter_is_no_other_gain() -> None:
    """The controller sees it most of a sample later; the gains stay as they are."""
    own = controllers_of(WHOLE).axis("roll")
    assert own is not None
    (topic,) = WHOLE.topics
    row = next(row for row, channel in enumerate(topic.channels) if channel.name == "p")
    values = topic.values.copy()
    values[row] = np.interp(topic.time_s + 0.003, topic.time_s, values[row])
    early = replace(WHOLE, topics=(replace(topic, values=values),))
    assert check_controller(early, "roll").verdict == "made"


def test_the_loop_rate_of_betaflight_is_that_of_its_header_and_not_of_its_log() -> None:
    """A blackbox writes every second or fourth step."""
    record = made(BETAFLIGHT | {"looptime": 125.0}, RACER, kind="Betaflight blackbox", terms=True, rate_hz=1000.0)
    found = controllers_of(record).axis("roll")
    assert found is not None
    assert found.loop_rate_hz == pytest.approx(8000.0)


def test_a_slow_swing_is_no_other_integral() -> None:
    """Motion of 1 rad/s fifty times larger than that of 3 rad/s, as a soft yaw in gusts makes it.

    In the windows of one difference it leaks to the lowest frequency and shows twice the integral.
    """
    soft = {"MC_ROLLRATE_P": 0.02, "MC_ROLLRATE_I": 0.06, "MC_ROLLRATE_D": 0.0, "IMU_GYRO_RATEMAX": 100.0}
    count, rate_hz = 6000, 100.0
    rng = np.random.default_rng(5)
    omega = 2.0 * np.pi * np.fft.rfftfreq(count, 1.0 / rate_hz)
    omega[0] = 1e-3
    slow = np.where((omega > 0.5) & (omega < 1.5), 1.0, 0.0) + 0.02 / (1.0 + 1j * omega / 60.0)
    noise = np.fft.rfft(rng.standard_normal(count))
    found = axis_controller(soft, "roll", firmware=NEW, loop_rate_hz=rate_hz)
    assert found is not None
    y = noise * slow
    columns = {
        "p": np.fft.irfft(y, count),
        "p_setpoint": 1e-4 * rng.standard_normal(count),
        "roll_command": np.fft.irfft(-found.controller.rate_loop.response(omega) * y, count),
    }
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=f"log.{name}") for name in columns)
    topic = Topic(
        name="all", time_s=np.arange(count) / rate_hz, channels=channels, values=np.stack(list(columns.values()))
    )
    source = Source(name="log", format="PX4 ULog", sha256="0", firmware=NEW)
    record = FlightRecord(source=source, topics=(topic,), parameters=soft)
    assert check_controller(record, "roll").verdict == "made"
    for factor in (0.7, 1.3):
        other = replace(record, parameters={**soft, "MC_ROLLRATE_P": factor * soft["MC_ROLLRATE_P"]})
        assert check_controller(other, "roll").verdict == "not made"
