"""Loss of control, hard landings and logs that end in the air, and maneuvers that are none of these."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Status, Topic
from rotorid.flying.next_steps import KnownOfLog, next_steps
from rotorid.io.registry import read
from rotorid.signal.airborne import airborne
from rotorid.signal.control import Control, before_loss, control, shows_control
from rotorid.typing import FloatArray

LOST_S, STOP_S = 30.0, 33.0


def crash_rows(rate_hz: float, *, lost: bool = True) -> tuple[FloatArray, dict[str, FloatArray]]:
    """A hover of 30 s; then motor 1 does nothing: full output, a roll to 128°, a fall at full throttle with 3 A."""
    time_s = np.arange(0.0, STOP_S, 1.0 / rate_hz)
    fall = np.clip(time_s - LOST_S, 0.0, None) * lost
    after = fall > 0.0
    sway = 0.05 * np.sin(2.0 * time_s)
    down = np.where(time_s < 5.0, -3.0 * time_s, -15.0) + np.minimum(4.0 * fall**2, 14.0)
    rows = {
        "phi": np.where(after, np.minimum(np.radians(128.0) * fall, np.radians(128.0)), sway),
        "phi_setpoint": sway,
        "theta": sway,
        "theta_setpoint": sway,
        "p": np.where(after, 2.2, 0.1 * np.cos(2.0 * time_s)),
        "p_setpoint": np.where(after, -3.0, 0.1 * np.cos(2.0 * time_s)),
        "q": 0.02 * np.sin(time_s),
        "q_setpoint": 0.02 * np.sin(time_s),
        "az": np.where(after, -2.5, -9.8),
        "ax": 0.1 * sway,
        "ay": 0.1 * sway,
        "down": down,
        "velocity_down": np.gradient(down, time_s),
        "battery_current": np.where(after & (fall > 0.3), 3.0, 20.0),
        "thrust_command": np.where(after, 1.0, 0.55),
        "motor_1": np.where(after, 0.95, 0.45 + sway),
        **{f"motor_{number}": np.where(after, 0.5, 0.45 - sway) for number in (2, 3, 4)},
    }
    return time_s, rows


def record_of(time_s: FloatArray, rows: dict[str, FloatArray], status: Status | None = None) -> FlightRecord:
    channels = tuple(Channel(name=name, unit="1") for name in rows)
    topic = Topic(name="RATE", time_s=time_s, channels=channels, values=np.stack([*rows.values()]))
    source = Source(name="crash.bin", format="dataflash", sha256="")
    return FlightRecord(source=source, topics=(topic,), status=status or Status())


def found(time_s: FloatArray, rows: dict[str, FloatArray], status: Status | None = None) -> Control | None:
    return control(record_of(time_s, rows, status), ((float(time_s[0]) + 2.0, float(time_s[-1])),))


ALL = ("thrust_command", "motor_1", "motor_2", "motor_3", "motor_4", "p", "q", "p_setpoint", "q_setpoint")


@pytest.mark.parametrize("rate_hz", [10.0, 50.0, 400.0])
def test_a_lost_motor_is_found_at_ordinary_rates(rate_hz: float) -> None:
    lost = found(*crash_rows(rate_hz))
    assert lost is not None
    assert lost.lost_at_s == pytest.approx(LOST_S, abs=0.3)
    assert lost.ends_in_air
    assert "motor 1 at its limit" in lost.words
    assert "roll 128°" in lost.words
    assert "current 3.0 A" in lost.words
    assert [finding.kind for finding in lost.findings] == ["control_lost", "ends_in_air"]


@pytest.mark.parametrize(
    "kept",
    [
        ALL,
        ("phi", "theta", "phi_setpoint", "theta_setpoint"),
        ("ax", "ay", "az", "thrust_command"),
        ("velocity_down", "motor_1", "motor_2", "motor_3", "motor_4"),
        ("battery_current", "thrust_command"),
    ],
    ids=["rates", "attitude", "force", "sink", "current"],
)
def test_one_witness_is_enough(kept: tuple[str, ...]) -> None:
    time_s, rows = crash_rows(10.0)
    lost = found(time_s, {name: rows[name] for name in kept})
    assert lost is not None
    assert lost.lost_at_s == pytest.approx(LOST_S, abs=0.8)


def test_tumbling_counts_in_modes_that_hold_attitudes_only() -> None:
    time_s, rows = crash_rows(10.0)
    kept = {name: rows[name] for name in ("phi", "theta", "thrust_command")}
    held = found(time_s, kept, Status(modes=(("loiter", 0.0, STOP_S),)))
    assert held is not None
    assert held.cause == "tumbling"
    for modes in ((), (("acro", 0.0, STOP_S),), (("flip", 0.0, STOP_S),)):
        assert found(time_s, kept, Status(modes=modes)) is None


def test_a_flight_without_a_loss_is_none() -> None:
    time_s, rows = crash_rows(50.0, lost=False)
    assert control(record_of(time_s, rows), ((0.0, STOP_S),)) is None


def test_what_the_vehicle_comes_back_from_is_a_maneuver() -> None:
    time_s, rows = crash_rows(100.0, lost=False)
    flips = (time_s > 20.0) & (time_s < 20.6)
    rows["p"] = np.where(flips, 8.0, rows["p"])
    rows["p_setpoint"] = np.where(flips, 17.0, rows["p_setpoint"])
    rows["phi"] = np.where(flips, np.linspace(0.0, 2.0 * math.pi, flips.size), rows["phi"])
    rows["motor_1"] = np.where(flips, 1.0, rows["motor_1"])
    rows["az"] = np.where(flips, 0.5, rows["az"])
    assert control(record_of(time_s, rows), ((0.0, STOP_S),)) is None


def test_motors_stopped_on_purpose_are_no_loss() -> None:
    time_s, rows = crash_rows(50.0, lost=False)
    stopped = time_s > 31.0
    for name in ("thrust_command", "motor_1", "motor_2", "motor_3", "motor_4"):
        rows[name] = np.where(stopped, 0.0, rows[name])
    rows["az"] = np.where(stopped, 0.0, rows["az"])
    lost = control(record_of(time_s, rows), ((2.0, 31.0),))
    assert lost is None or lost.lost_at_s is None


def test_what_follows_a_loss_is_left_out_of_the_flight() -> None:
    time_s, rows = crash_rows(10.0)
    flight = airborne(record_of(time_s, rows), margin_s=0.0)
    assert flight.control is not None
    assert flight.intervals[-1][1] == flight.control.lost_at_s
    assert flight.findings[0].kind == "control_lost"


def test_a_later_flight_stays() -> None:
    lost = Control(lost_at_s=20.0)
    assert before_loss(((0.0, 25.0), (26.0, 28.0), (60.0, 90.0)), lost) == ((0.0, 20.0), (60.0, 90.0))
    assert before_loss(((0.0, 25.0),), None) == ((0.0, 25.0),)


def landing(sink_m_s: float, size_m_s2: float) -> Control | None:
    time_s, rows = crash_rows(100.0, lost=False)
    rows["velocity_down"] = np.where((time_s > 25.0) & (time_s < 28.0), sink_m_s, 0.0)
    rows["az"] = np.where(np.abs(time_s - 28.0) < 0.02, -size_m_s2, rows["az"])
    return control(record_of(time_s, rows), ((2.0, 28.0),))


def test_a_hard_landing_is_named_with_its_size_and_time() -> None:
    hard = landing(2.5, 100.0)
    assert hard is not None
    (finding,) = hard.findings
    assert finding.kind == "hard_landing"
    assert finding.message.startswith("Hard landing at 28.0 s: 10 g at touchdown")
    assert hard.impact_at_s == pytest.approx(28.0, abs=0.05)


@pytest.mark.parametrize(("sink_m_s", "size_m_s2"), [(0.5, 60.0), (2.5, 30.0)])
def test_a_soft_landing_is_not_named(sink_m_s: float, size_m_s2: float) -> None:
    assert landing(sink_m_s, size_m_s2) is None


def test_a_log_that_begins_in_the_air_may_end_there() -> None:
    time_s, rows = crash_rows(50.0, lost=False)
    record = record_of(time_s, rows)
    assert control(record, ((0.0, STOP_S),)) is None
    cut = control(record, ((2.0, STOP_S),))
    assert cut is not None
    assert [finding.kind for finding in cut.findings] == ["ends_in_air"]


def test_a_log_too_short_for_cells_says_nothing() -> None:
    record = record_of(np.array([0.0, 0.1]), {"p": np.array([0.0, 20.0])})
    assert control(record, ((0.0, 0.1),)) is None
    assert control(record, ()) is None


def test_freestyle_is_no_loss_of_control(shared_data: Path) -> None:
    record = read(shared_data / "everyday" / "betaflight_431_freestyle.bbl.xz")
    flight = airborne(record, margin_s=0.0)
    assert flight.control is None or flight.control.lost_at_s is None


def test_a_real_crash_is_found_at_10_hz(shared_data: Path) -> None:
    flight = airborne(read(shared_data / "ardupilot" / "beast_0036.BIN"), margin_s=0.0)
    assert flight.control is not None
    assert flight.control.lost_at_s == pytest.approx(369.2, abs=0.5)
    assert "motor 1 at its limit" in flight.control.words
    assert flight.control.impact_at_s == pytest.approx(373.5, abs=0.2)


@pytest.mark.parametrize("lost", [True, False])
def test_a_vehicle_that_lost_control_is_not_sent_to_a_sweep(lost: bool) -> None:
    record = record_of(*crash_rows(50.0, lost=lost))
    commands = list(next_steps(KnownOfLog(record=record, wanted_axes=("roll",), reviewed=False)))
    assert any(command.startswith("rotorid review") for command in commands)
    assert any(command.startswith("rotorid design sweep") for command in commands) is not lost


@pytest.mark.parametrize(
    ("names", "shown"),
    [(("motor_1", "down"), False), (("phi", "motor_1"), False), (("phi", "phi_setpoint"), True), (("q",), True)],
)
def test_a_log_without_rates_attitude_and_force_shows_nothing_of_control(names: tuple[str, ...], shown: bool) -> None:
    channels = tuple(Channel(name=name, unit="1") for name in names)
    topic = Topic(name="log", time_s=np.arange(50) * 0.1, channels=channels, values=np.zeros((len(names), 50)))
    record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256=""), topics=(topic,))
    assert shows_control(record) is shown
