"""Motors at their limits: shares and causes that were flown come back from the log of every autopilot."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from rotorid.autopilots.thrust import expo_share
from rotorid.data.flight_plan import SimulatedFlight
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.io.registry import read, write_log
from rotorid.signal.limits import AT_LIMIT, MotorLimits
from rotorid.signal.motors import motor_limits
from rotorid.typing import BoolArray, FloatArray

LOOP_HZ = 400.0
TIME_S = np.arange(0.0, 100.0, 1.0 / LOOP_HZ)
MIXER = np.array([[-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, -1.0]])
SPIN = {"MOT_SPIN_MIN": 0.15, "MOT_SPIN_MAX": 0.95, "MOT_THST_EXPO": 0.65}
PUNCH_S, SHAKE_S = (40.0, 43.0), (60.0, 66.0)


def within(part: tuple[float, float]) -> BoolArray:
    return np.asarray((part[0] <= TIME_S) & (part[1] > TIME_S))


CHOPS = within((20.0, 30.0)) & (TIME_S % 1.0 < 0.8)
"""Ten times for 0.8 s: a log without flags takes a longer one for the ground."""


def flown() -> dict[str, FloatArray]:
    """A flight of 100 s: 8 s at zero throttle, 3 s at full, 6 s in which roll swings by more than the motors can."""
    rng = np.random.default_rng(4)
    thrust = np.where(CHOPS, 0.0, np.where(within(PUNCH_S), 1.0, 0.45 + 0.05 * np.sin(TIME_S)))
    commands = 0.02 * rng.uniform(-1.0, 1.0, (3, TIME_S.size))
    commands[0] += np.where(within(SHAKE_S), 0.7 * np.sign(np.sin(2.0 * np.pi * 3.0 * TIME_S)), 0.0)
    commands[:, CHOPS | within(PUNCH_S)] = 0.0
    columns = {f"{axis}_command": row for axis, row in zip(("roll", "pitch", "yaw"), commands, strict=True)}
    motors = np.clip(thrust + MIXER @ commands, 0.0, 1.0)
    columns |= {f"motor_{number}": row for number, row in enumerate(motors, start=1)}
    columns |= {name: 0.3 * np.sin(4.0 * TIME_S + place) for place, name in enumerate(("p", "q", "r"))}
    return columns | {"thrust_command": thrust, "thrust_stick": thrust}


FORMATS = {"ulg": "px4", "bin": "ardupilot", "bbl": "betaflight", "csv": "simple"}


def logged(folder: Path, format: str, columns: Mapping[str, FloatArray]) -> FlightRecord:
    """The same flight as the logger of an autopilot writes it: ArduPilot moves its motors in a range of its own."""
    own = dict(columns)
    if format == "bin":
        low, high = SPIN["MOT_SPIN_MIN"], SPIN["MOT_SPIN_MAX"]
        for name in columns:
            if name.startswith("motor_"):
                own[name] = low + (high - low) * expo_share(columns[name], SPIN["MOT_THST_EXPO"])
    flight = SimulatedFlight(
        vehicle="demo",
        autopilot=FORMATS[format],
        sample_rate_hz=LOOP_HZ,
        time_s=TIME_S,
        columns=own,
        raw={name: own[name] for name in ("p", "q", "r")},
        parameters=SPIN if format == "bin" else {},
    )
    write_log(folder / f"flight.{format}", flight, format=format)  # type: ignore[arg-type]
    return read(folder / f"flight.{format}", sandbox=False)


def crazyflie(columns: Mapping[str, FloatArray]) -> FlightRecord:
    names = [name for name in columns if "thrust" not in name]
    channels = [Channel(name=name, unit=STANDARD_UNITS[name]) for name in names]
    channels.append(Channel(name="thrust_command", unit="1", source="mean of motor.m1 to motor.m4"))
    counts = [np.rint(65535.0 * columns[name]) / 65535.0 if "motor" in name else columns[name] for name in names]
    mean = np.mean([row for name, row in zip(names, counts, strict=True) if "motor" in name], axis=0)
    topic = Topic(name="event", time_s=TIME_S, channels=tuple(channels), values=np.stack([*counts, mean]))
    return FlightRecord(source=Source(name="log00", format="Crazyflie uSD", sha256=""), topics=(topic,))


def record_of(folder: Path, format: str) -> FlightRecord:
    return crazyflie(flown()) if format == "crazyflie" else logged(folder, format, flown())


@pytest.mark.parametrize("format", [*FORMATS, "crazyflie"])
def test_what_was_flown_comes_back(format: str, tmp_path: Path) -> None:
    limits = motor_limits(record_of(tmp_path, format))
    assert limits.unknown == ""
    chop, punch, shake = (float(np.mean(part)) for part in (CHOPS, within(PUNCH_S), within(SHAKE_S)))
    # ArduPilot logs its outputs at 10 Hz: a sample at each edge may go either way.
    edge = 0.006 if format == "bin" else 0.002
    part = limits.counted.mean()
    assert limits.share * part == pytest.approx(chop + punch + shake, abs=edge)
    assert limits.lower_share * part == pytest.approx(chop + shake, abs=edge)
    assert limits.upper_share * part == pytest.approx(punch + shake, abs=edge)
    assert {cause: share * part for cause, share in limits.causes.items()} == pytest.approx(
        {"idle": chop, "full": punch, "loop": shake}, abs=edge
    )
    assert limits.share == pytest.approx(sum(limits.causes.values()))


def test_a_part_has_its_own_share(tmp_path: Path) -> None:
    limits = motor_limits(record_of(tmp_path, "ulg"))
    start_s = float(limits.time_s[0])
    parts = {
        name: tuple(start_s + end for end in part) for name, part in {"shake": SHAKE_S, "calm": (70.0, 90.0)}.items()
    }
    assert limits.during((parts["shake"],)).share == pytest.approx(1.0, abs=0.01)
    assert limits.during((parts["calm"],)).share == 0.0
    assert np.isnan(limits.during(()).share)


@pytest.mark.parametrize(("away", "counts"), [(0.5 * AT_LIMIT, True), (1.5 * AT_LIMIT, False)])
def test_the_last_step_of_a_pulse_is_at_the_limit(away: float, counts: bool) -> None:
    """ArduPilot rounds down, so that full output is up to one of 700 steps short of its range."""
    columns = {name: np.full(TIME_S.size, 0.5) for name in ("motor_1", "motor_2")}
    columns["motor_1"][1000:2000] = 1.0 - away
    channels = tuple(Channel(name=name, unit="1") for name in columns)
    topic = Topic(name="RCOU", time_s=TIME_S, channels=channels, values=0.15 + 0.8 * np.stack(list(columns.values())))
    source = Source(name="flight.bin", format="ArduPilot DataFlash", sha256="")
    share = motor_limits(FlightRecord(source=source, topics=(topic,), parameters=SPIN)).share
    assert (share > 0.0) == counts


@pytest.mark.parametrize("demanded", [0.0, 1.0])
def test_a_limit_cycle_stays_one_whatever_thrust_its_height_loop_asks_for(demanded: float) -> None:
    """It loses lift, or gains it where the mixer makes room upward: the demand is its consequence."""
    swing = 0.5 + 0.6 * np.sin(2.0 * np.pi * 7.0 * TIME_S)
    rows = {f"motor_{number}": np.clip(swing if number % 2 else 1.0 - swing, 0.0, 1.0) for number in range(1, 5)}
    rows |= {"roll_command": 0.6 * np.sin(2.0 * np.pi * 7.0 * TIME_S), "thrust_command": np.full(TIME_S.size, demanded)}
    channels = tuple(Channel(name=name, unit="1") for name in rows)
    topic = Topic(name="motors", time_s=TIME_S, channels=channels, values=np.stack(list(rows.values())))
    status = Status(in_air=((0.0, 100.0),), flagged_in="flags")
    source = Source(name="flight", format="PX4 ULog", sha256="")
    limits = motor_limits(FlightRecord(source=source, topics=(topic,), status=status))
    assert limits.share > 0.3
    assert limits.causes["loop"] == limits.share


@pytest.mark.parametrize(("throttle", "idle"), [(0.0, True), (0.4, False)])
def test_a_closed_throttle_explains_lower_ends_over_which_the_mixer_makes_room(throttle: float, idle: bool) -> None:
    """Betaflight's airmode: one motor of a pair idles, and the other turns the vehicle; at an upper end a loop does."""
    turning = 0.5 * np.abs(np.sin(3.0 * TIME_S))
    rows = {f"motor_{number}": turning if number % 2 else np.zeros(TIME_S.size) for number in range(1, 5)}
    rows["motor_1"] = np.where(TIME_S > 90.0, 1.0, rows["motor_1"])
    rows |= {"roll_command": turning, "thrust_stick": np.full(TIME_S.size, throttle)}
    channels = [Channel(name=name, unit="1") for name in rows]
    channels.append(Channel(name="thrust_command", unit="1", source="motor mix"))
    values = np.stack([*rows.values(), 0.5 * turning])
    topic = Topic(name="flight 1", time_s=TIME_S, channels=tuple(channels), values=values)
    status = Status(in_air=((0.0, 100.0),), flagged_in="flags")
    source = Source(name="flight", format="Betaflight blackbox", sha256="")
    limits = motor_limits(FlightRecord(source=source, topics=(topic,), status=status))
    assert (limits.share, limits.upper_share) == pytest.approx((1.0, 0.1), abs=1e-3)
    part = limits.during(((0.0, 90.0),))
    assert (part.causes["idle"] > 0.99) == idle
    assert limits.during(((90.1, 100.0),)).causes["loop"] == 1.0


def of_motors(values: FloatArray, format: str = "ArduPilot DataFlash") -> MotorLimits:
    """Two motors of a log without parameters."""
    channels = tuple(Channel(name=f"motor_{number}", unit="1") for number in (1, 2))
    topic = Topic(name="RCOU", time_s=TIME_S, channels=channels, values=np.stack([values, 1.0 - values]))
    return motor_limits(FlightRecord(source=Source(name="flight", format=format, sha256=""), topics=(topic,)))


def test_where_the_range_is_not_known_outputs_pile_up_at_its_ends() -> None:
    wave = 0.5 + 0.4 * np.sin(3.0 * TIME_S)
    limits = of_motors(np.clip(wave, 0.25, 0.75))
    assert limits.share == pytest.approx(np.mean((wave <= 0.25) | (wave >= 0.75)), abs=2e-3)
    assert limits.causes == {"idle": 0.0, "full": 0.0, "unknown": limits.share}
    assert of_motors(wave).share == 0.0


def test_unknown_is_not_no() -> None:
    switched = of_motors(np.where(np.sin(3.0 * TIME_S) > 0.0, 0.3, 0.7))
    assert (switched.unknown, np.isnan(switched.share)) == ("does not say in which range its motors move", True)
    none = motor_limits(FlightRecord(source=Source(name="flight", format="PX4 ULog", sha256=""), topics=()))
    assert (none.unknown, np.isnan(none.share)) == ("lacks the outputs of all motors", True)
    assert none.remarks() == ()
