"""Quality: shares are those that were planted, and clean maneuvers pass in silence."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from rotorid.data.findings import Finding
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, TimeHistory, Topic
from rotorid.errors import UsageError
from rotorid.signal.limits import limited_share
from rotorid.signal.motors import motor_limits
from rotorid.signal.quality import battery_sag, led_share, quality_findings
from rotorid.typing import FloatArray

RATE_HZ = 200.0
TIME_S = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
SWEEP = np.sin(0.6 * TIME_S + 0.4 * TIME_S**2)


def noise(seed: int, size: float = 1.0) -> FloatArray:
    return np.asarray(size * np.random.default_rng(seed).standard_normal(TIME_S.size))


def findings(axis: str = "roll", **channels: FloatArray) -> Mapping[tuple[str, str], Finding]:
    history = TimeHistory(
        values=np.stack(list(channels.values())),
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in channels),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    found = quality_findings(history, axis=axis)  # type: ignore[arg-type]
    return {(finding.kind, finding.where): finding for finding in found}


CLEAN: Mapping[str, FloatArray] = {
    "sweep": SWEEP,
    "growing": SWEEP * TIME_S,
    "slow": np.sin(0.1 * TIME_S),
    "noise": noise(0),
    "noisy sweep": SWEEP + noise(1, 0.1),
    "quantized": np.round((SWEEP + noise(2, 0.1)) * 100.0) / 100.0,
    "held": np.repeat((SWEEP + noise(3, 0.1))[::8], 8),
    "random binary": np.sign(noise(4)),
    "doublets": np.sign(np.sin(TIME_S)) * (np.abs(np.sin(TIME_S)) > 0.5),
    "ramp": TIME_S,
    "constant": np.ones(TIME_S.size),
    "one spike": noise(5) + 100.0 * (np.arange(TIME_S.size) == 77),
    "empty": TIME_S[:0],
    "absent": np.full(TIME_S.size, np.nan),
}


@pytest.mark.parametrize("name", CLEAN)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_signal_without_a_limit_has_none(name: str, sign: float) -> None:
    assert limited_share(sign * CLEAN[name]) == 0.0


@pytest.mark.parametrize("name", ["sweep", "growing", "noise", "noisy sweep", "quantized", "held"])
@pytest.mark.parametrize("quantile", [0.8, 0.95])
def test_the_share_at_a_limit_is_the_planted_one(name: str, quantile: float) -> None:
    values = CLEAN[name]
    limit = float(np.quantile(values, quantile))
    clipped = np.minimum(values, limit)
    planted = float(np.mean(clipped >= limit))
    # What lies within 0.02 % of the range counts to the limit.
    beside = float(np.mean((clipped < limit) & (clipped >= limit - 2e-4 * np.ptp(clipped))))
    assert planted <= limited_share(clipped) <= planted + beside


def test_both_ends_count() -> None:
    values = np.clip(noise(6), -1.5, 1.0)
    assert limited_share(values) == pytest.approx(np.mean((values == 1.0) | (values == -1.5)), abs=2e-3)


def test_saturated_commands_and_clipped_sensors_are_named_worst_first() -> None:
    command = np.clip(0.6 * noise(7), -1.0, 1.0)
    found = findings(
        roll_command=0.1 * SWEEP,
        yaw_command=command,
        ax=np.clip(10.0 * noise(9), -20.0, 20.0),
        p=SWEEP,
    )
    limited = [(kind, where) for kind, where in found if kind in ("saturation", "sensor_clipping")]
    assert limited == [("saturation", "yaw_command"), ("sensor_clipping", "ax")]
    share = float(np.mean(np.abs(command) == 1.0))
    # What lies within 0.02 % of a limit counts to it: at two ends, with a density of at most 0.4 / 0.6.
    assert found["saturation", "yaw_command"].numbers["share"] == pytest.approx(share, abs=6e-4)
    assert {finding.severity for finding in found.values()} == {"warning"}


def test_few_samples_at_a_limit_are_a_remark() -> None:
    values = 0.3 * SWEEP
    values[1000 : 1000 + round(0.004 * TIME_S.size)] = 1.0
    (finding,) = findings(roll_command=values).values()
    assert (finding.kind, finding.severity) == ("saturation", "info")
    assert finding.numbers["share"] == pytest.approx(0.004, abs=1e-4)


@pytest.mark.parametrize(("ratio", "severity"), [(0.1, None), (0.3, "info"), (0.7, "warning")])
def test_motion_of_other_axes_is_measured(ratio: float, severity: str | None) -> None:
    other = ratio * np.std(0.1 * SWEEP) * noise(10)
    found = findings(roll_command=0.1 * SWEEP, pitch_command=other, yaw_command=np.zeros(TIME_S.size))
    finding = found.get(("off_axis_input", "pitch_command"))
    assert (finding.severity if finding else None) == severity
    if finding:
        # The spread of the spread of 12000 samples is 1/sqrt(24000).
        assert finding.numbers["ratio"] == pytest.approx(ratio, rel=4.0 / np.sqrt(24000))


def test_inputs_that_follow_each_other_are_named() -> None:
    motion = 0.1 * noise(11)
    for size, correlated in ((0.3, True), (3.0, False)):
        follower = 0.3 * motion + size * 0.03 * noise(12)
        found = findings(roll_command=motion, yaw_command=follower)
        assert (("correlated_inputs", "yaw_command/roll_command") in found) is correlated
    tiny = findings(roll_command=motion, yaw_command=0.01 * motion)
    assert not any(kind == "correlated_inputs" for kind, _ in tiny)


@pytest.mark.parametrize(
    ("led", "own", "share"), [(0.5, 0.0, 1.0), (0.5, 0.5, 0.5), (0.2, 1.0, 0.04), (0.04, 0.0, 0.0)]
)
def test_the_share_of_a_command_that_another_one_leads_is_the_planted_one(led: float, own: float, share: float) -> None:
    """Of a command that moves less than a twentieth of the excited one nothing is said."""
    excited = noise(13)
    history = TimeHistory(
        channels=tuple(Channel(name=name, unit="1") for name in ("pitch_command", "thrust_command")),
        values=np.stack([excited, led * excited + own * noise(14)]),
        sample_rate_hz=1.0 / float(TIME_S[1] - TIME_S[0]),
        start_s=0.0,
    )
    assert led_share(history, "pitch_command", "thrust_command") == pytest.approx(share, abs=0.1)


def test_short_or_foreign_maneuvers_are_judged_as_far_as_they_go() -> None:
    assert findings(p=SWEEP, roll_command=np.zeros(TIME_S.size)) == {}
    history = TimeHistory(
        values=np.tile([0.1, -0.1], (2, 30)),
        channels=tuple(Channel(name=f"{axis}_command", unit="1") for axis in ("roll", "pitch")),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    assert [finding.kind for finding in quality_findings(history, axis="roll")] == ["off_axis_input"]
    with pytest.raises(UsageError, match="sideways"):
        quality_findings(history, axis="sideways")  # type: ignore[arg-type]


def flight(voltage: FloatArray) -> FlightRecord:
    channel = Channel(name="battery_voltage", unit="V")
    topic = Topic(name="BAT", time_s=TIME_S[::20], channels=(channel,), values=voltage[None, ::20])
    return FlightRecord(source=Source(name="a", format="b", sha256=""), topics=(topic,))


@pytest.mark.parametrize(("slope", "severity"), [(-0.001, "info"), (-0.05, "warning"), (0.0, "info")])
def test_battery_sag_is_that_of_the_line(slope: float, severity: str) -> None:
    maneuver = Maneuver(axis="roll", kind="sweep", start_s=10.0, stop_s=50.0)
    finding = battery_sag(flight(16.0 + slope * (TIME_S - 30.0)), maneuver)
    assert finding is not None
    assert (finding.kind, finding.severity) == ("battery_sag", severity)
    assert finding.numbers["change_percent"] == pytest.approx(100.0 * slope * 40.0 / 16.0, abs=1e-9)


def test_no_voltage_no_sag() -> None:
    outside = Maneuver(axis="roll", kind="sweep", start_s=100.0, stop_s=150.0)
    assert battery_sag(flight(np.full(TIME_S.size, 16.0)), outside) is None
    inside = Maneuver(axis="roll", kind="sweep", start_s=1.0, stop_s=9.0)
    assert battery_sag(flight(np.zeros(TIME_S.size)), inside) is None


def test_a_command_that_is_an_input_itself_is_not_remarked_on() -> None:
    names = ("roll_command", "yaw_command")
    history = TimeHistory(
        values=np.stack([SWEEP, SWEEP + noise(8, 0.1)]),
        channels=tuple(Channel(name=name, unit="1") for name in names),
        sample_rate_hz=RATE_HZ,
        start_s=0.0,
    )
    others = {"off_axis_input", "correlated_inputs"}
    assert others <= {f.kind for f in quality_findings(history, axis="roll")}
    assert not others & {f.kind for f in quality_findings(history, axis="roll", accounted=names)}


def test_commands_in_steps_of_a_motor_controller_have_no_known_limit() -> None:
    assert ("saturation", "roll_command") not in findings(roll_command=100.0 * SWEEP)


def test_a_random_binary_command_is_not_saturated() -> None:
    assert ("saturation", "roll_command") not in findings(roll_command=np.sign(SWEEP))


def test_a_thrust_that_is_counted_from_hover_has_no_stop_at_zero() -> None:
    assert ("saturation", "thrust_command") not in findings(
        "thrust", thrust_command=0.1 * np.minimum(SWEEP, 0.5) + noise(9, 0.01)
    )
    stuck = np.maximum(0.3 + SWEEP, 0.0)
    assert findings("thrust", thrust_command=stuck)["saturation", "thrust_command"].numbers["share"] > 0.2


def of_motors(**motors: FloatArray) -> Mapping[tuple[str, str], Finding]:
    channels = tuple(Channel(name=name, unit="1") for name in motors)
    topic = Topic(name="rig", time_s=TIME_S, channels=channels, values=np.stack(list(motors.values())))
    record = FlightRecord(source=Source(name="rig.csv", format="CSV", sha256=""), topics=(topic,))
    history = TimeHistory(
        values=SWEEP[None], channels=(Channel(name="roll_command", unit="1"),), sample_rate_hz=RATE_HZ, start_s=0.0
    )
    found = quality_findings(history, axis="roll", limits=motor_limits(record))
    return {(finding.kind, finding.where): finding for finding in found}


def test_motors_at_a_limit_are_remarked_on_once() -> None:
    motor = np.clip(0.5 + 0.3 * noise(7), 0.0, 1.0)
    lower = np.minimum(0.5 + 0.1 * noise(8), 0.72)
    numbers = of_motors(motor_1=motor, motor_2=lower, motor_3=np.zeros(TIME_S.size))["saturation", "motors"].numbers
    share = float(np.mean((motor == 0.0) | (motor == 1.0) | (lower == 0.72)))
    # A motor that never moves shows no end, and what lies within 0.02 % of an end counts to it.
    assert numbers["share"] == pytest.approx(share, abs=1.5e-3)
    assert numbers["upper_share"] == pytest.approx(float(np.mean((motor == 1.0) | (lower == 0.72))), abs=1.5e-3)


def test_voltages_about_a_trim_have_no_stop_at_zero() -> None:
    assert not of_motors(motor_1=0.6 * SWEEP + noise(7, 0.05))
    assert ("saturation", "motors") in of_motors(motor_1=np.clip(0.6 * SWEEP, -0.5, 0.5))
    assert ("saturation", "motors") in of_motors(motor_1=np.clip(0.6 * SWEEP + 0.5, 0.0, 1.0))
