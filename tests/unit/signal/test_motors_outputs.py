"""Motors of made-up flights: the mixer and the curve of an ArduPilot written forward, and found back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.signal.motor_outputs import reconstructed_outputs

from rotorid.autopilots.thrust import Linearization, expo_share, expo_thrust
from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.signal.motors import (
    COMMANDS,
    agreement_of,
    linearization_of,
    logged_outputs,
    logged_speeds,
    motor_channels,
    motor_history,
    on_common_stamps,
    reconstructed_demands,
    voltage_factor,
    with_motors,
)
from rotorid.typing import FloatArray

MOTORS = ("motor_1", "motor_2", "motor_3", "motor_4")
MIXER = np.array([[-0.5, 0.5, 0.5, 1.0], [0.5, -0.5, 0.5, 1.0], [0.5, 0.5, -0.5, 1.0], [-0.5, -0.5, -0.5, 1.0]])
PARAMETERS = {
    "MOT_THST_EXPO": 0.65,
    "MOT_SPIN_MIN": 0.15,
    "MOT_SPIN_MAX": 0.95,
    "MOT_BAT_VOLT_MAX": 12.8,
    "MOT_BAT_VOLT_MIN": 9.6,
}
DENSITY = 0.945
RATE_HZ = 200.0
TIME_S = np.arange(0.0, 60.0, 1.0 / RATE_HZ)


def commands(amplitude: float = 0.1) -> FloatArray:
    """Motion of each axis below 5 Hz around hover."""
    tones = [(1.1, 4.7), (0.7, 3.9), (0.4, 1.3), (0.3, 0.9)]
    moving = [np.sin(2 * np.pi * low * TIME_S) + np.sin(2 * np.pi * high * TIME_S + 1.0) for low, high in tones]
    return amplitude * np.stack([*moving[:3], 0.3 * moving[3]]) / 2.0 + np.array([[0.0], [0.0], [0.0], [0.36]])


def topic(name: str, time_s: FloatArray, names: tuple[str, ...], values: FloatArray) -> Topic:
    return Topic(name=name, time_s=time_s, channels=tuple(Channel(name=one, unit="1") for one in names), values=values)


def flight(*, mixer: FloatArray = MIXER, amplitude: float = 0.1, steps: int = 20, late: int = 0) -> FlightRecord:
    """An ArduPilot's log with slow outputs in whole microseconds and a battery that runs down."""
    volts = 12.6 - 0.01 * TIME_S
    demands = np.clip(mixer @ commands(amplitude) / DENSITY, 0.0, 1.0)
    # The equation of the firmware, written out: nothing of the package.
    share = (0.65 - 1.0 + np.sqrt((1.0 - 0.65) ** 2 + 4.0 * 0.65 * demands)) / (2.0 * 0.65) / (volts / 12.8)
    counts = np.round(1000.0 + 1000.0 * (0.15 + 0.8 * np.clip(share, 0.0, 1.0)))
    outputs = (counts[:, late::steps][:, : -late or None] - 1000.0) / 1000.0
    slow = TIME_S[late::steps][: -late or None] - late / RATE_HZ
    return FlightRecord(
        source=Source(name="flight.BIN", format="ArduPilot DataFlash", sha256=""),
        topics=(
            topic("RATE", TIME_S, COMMANDS, commands(amplitude)),
            topic("RCOU", slow, MOTORS, outputs),
            topic("BAT", TIME_S[::20], ("battery_voltage",), volts[None, ::20]),
        ),
        parameters=PARAMETERS,
    )


def test_the_demands_agree_with_slow_outputs_to_their_rounding() -> None:
    """Rounding to a microsecond is 0.29 of them rms: 3.6e-4 of the 800 between the spins; straight-line voltage adds
    nothing, since it is one."""
    demands, agreement = reconstructed_demands(flight(), MIXER)
    assert agreement is not None
    assert agreement.agrees
    assert agreement.shift == 0
    assert agreement.rms == pytest.approx(1.0 / np.sqrt(12.0) / 800.0, rel=0.1)
    assert agreement.gain == pytest.approx(1.0 / DENSITY, rel=1e-4)
    assert demands.sample_rate_hz == pytest.approx(RATE_HZ)
    np.testing.assert_allclose(demands.values, MIXER @ commands(), atol=1e-15)
    assert [finding.kind for finding in demands.findings] == ["motor_reconstruction"]


def test_outputs_come_back_at_the_rate_of_the_commands() -> None:
    record = flight()
    _, outputs = reconstructed_outputs(record, MIXER)
    share = expo_share(MIXER @ commands() / DENSITY, 0.65) / ((12.6 - 0.01 * TIME_S) / 12.8)
    # The gain is known to the rounding over the root of the number of samples.
    np.testing.assert_allclose(outputs, 0.15 + 0.8 * share, atol=1e-4)


def test_an_offset_of_the_clocks_is_found() -> None:
    agreement = reconstructed_demands(flight(late=2), MIXER)[1]
    assert agreement is not None
    assert agreement.shift == 2


@pytest.mark.parametrize("turned", [0, 1, 2])
def test_a_wrong_layout_does_not_agree(turned: int) -> None:
    """One axis the wrong way round: its correlation is negative, and the finding names it."""
    wrong = MIXER * np.where(np.arange(4) == turned, -1.0, 1.0)
    demands, agreement = reconstructed_demands(flight(), wrong)
    assert agreement is not None
    assert not agreement.agrees
    assert agreement.correlations[turned] < -0.9
    assert demands.findings[0].severity == "warning"
    assert f"{('roll', 'pitch', 'yaw')[turned]} do not fit" in demands.findings[0].message
    chosen = motor_history(flight(), wrong)
    assert chosen.kind == "output"
    assert {finding.kind for finding in chosen.findings} == {"rate_too_low", "motor_reconstruction"}


def test_the_fast_and_true_source_is_chosen() -> None:
    record = flight()
    assert motor_history(record).sample_rate_hz == pytest.approx(10.0)
    assert motor_history(record, MIXER).sample_rate_hz == pytest.approx(RATE_HZ)
    fast = flight(steps=1)
    assert motor_history(fast, MIXER).kind == "output"
    speeds = [
        topic(f"ESC[{n}]", TIME_S + 0.001 * n, (f"motor_speed_{n + 1}",), np.full((1, TIME_S.size), 500.0))
        for n in range(4)
    ]
    measured = motor_history(replace(fast, topics=(*fast.topics, *speeds)), MIXER)
    assert (measured.kind, measured.motors) == ("speed", 4)
    assert "saturation" not in {finding.kind for finding in measured.findings}
    assert measured.names[0] == "motor_speed_1"
    turning = [replace(one, values=sign * one.values) for one, sign in zip(speeds, (1.0, 1.0, -1.0, -1.0), strict=True)]
    # A sign is that of the direction.
    signed = motor_history(replace(fast, topics=(*fast.topics, *turning)), MIXER)
    np.testing.assert_array_equal(signed.values, measured.values)


def test_slow_speeds_do_not_replace_fast_outputs() -> None:
    fast = flight(steps=1)
    slow = topic(
        "ESC", TIME_S[::40], tuple(f"motor_speed_{n}" for n in (1, 2, 3, 4)), np.full((4, TIME_S[::40].size), 5e2)
    )
    record = replace(fast, topics=(*fast.topics, slow))
    assert motor_history(record).kind == "output"
    assert [finding.kind for finding in logged_speeds(record).findings] == ["rate_too_low"]


def test_motors_without_logged_ones_are_said_to_be_unchecked() -> None:
    record = flight()
    record = replace(record, topics=record.topics[:1])
    history = motor_history(record, MIXER)
    assert history.kind == "thrust_demand"
    assert "could not be checked" in history.findings[0].message
    with pytest.raises(InsufficientDataError, match="motor_1"):
        motor_history(record)


def test_saturation_is_counted_in_flight() -> None:
    """A demand beyond the limits stands at one of them; the share is that of the samples where any motor does."""
    record = flight(amplitude=1.2, steps=1)
    history = logged_outputs(record)
    expected = np.any((MIXER @ commands(1.2) <= 0.0) | (MIXER @ commands(1.2) / DENSITY >= 1.0), axis=0).mean()
    (finding,) = history.findings
    assert (finding.kind, finding.numbers["share"]) == ("saturation", pytest.approx(expected, abs=0.02))
    assert logged_outputs(flight(steps=1)).findings == ()


def test_a_slow_thrust_command_is_said() -> None:
    record = flight()
    split = (
        topic("RATE", TIME_S, COMMANDS[:3], commands()[:3]),
        topic("CTUN", TIME_S[::20], COMMANDS[3:], commands()[3:, ::20]),
    )
    demands, _ = reconstructed_demands(replace(record, topics=(*split, *record.topics[1:])), MIXER)
    slow = next(finding for finding in demands.findings if finding.kind == "rate_too_low")
    assert slow.where == "thrust_command"
    assert slow.numbers["rate_hz"] == pytest.approx(10.0)


def test_px4_logs_demands_that_its_curve_bends_later() -> None:
    record = flight(steps=1)
    source = Source(name="flight.ulg", format="PX4 ULog", sha256="")
    px4 = replace(
        record,
        source=source,
        topics=(
            record.topics[0],
            topic("actuator_motors", TIME_S, MOTORS, MIXER @ commands()),
        ),
    )
    history = motor_history(px4, MIXER)
    assert (history.kind, history.source) == ("thrust_demand", "actuator_motors")
    agreement = agreement_of(px4, reconstructed_demands(px4, MIXER)[0], MIXER)
    assert agreement is not None
    assert agreement.gain == pytest.approx(1.0, abs=1e-12)


def test_the_record_takes_the_motors_first() -> None:
    record = flight()
    richer = with_motors(record, motor_history(record, MIXER))
    first, row = next(richer.holding("motor_3"))
    assert first.sample_rate_hz == pytest.approx(RATE_HZ)
    np.testing.assert_array_equal(first.values[row], (MIXER @ commands())[2])


def test_another_number_of_motors_is_refused() -> None:
    with pytest.raises(UsageError, match="a mixer of 6 motors for a log of 4"):
        reconstructed_demands(flight(), np.ones((6, 4)))


def test_a_missing_motor_is_named() -> None:
    record = flight()
    without = replace(record.topics[1], channels=record.topics[1].channels[1:], values=record.topics[1].values[1:])
    with pytest.raises(InsufficientDataError, match="has only motor_2, motor_3, motor_4 of motor_1"):
        motor_channels(replace(record, topics=(without,)), "motor_")
    with pytest.raises(InsufficientDataError, match="r_speed_1, motor_speed_2 and so on"):
        logged_speeds(record)


def test_channels_of_two_topics_meet_on_the_clock_of_the_first() -> None:
    record = flight()
    time_s, values, source = on_common_stamps(record, ("motor_1", "battery_voltage"))
    np.testing.assert_allclose(values[1], 12.6 - 0.01 * time_s, atol=1e-12)
    assert source == "RCOU, BAT"


@pytest.mark.parametrize("expo", [-0.3, 0.0, 1e-12, 0.5, 1.0])
def test_the_curve_and_its_inverse(expo: float) -> None:
    share = np.linspace(0.0, 1.0, 21)
    np.testing.assert_allclose(expo_share(expo_thrust(share, expo), expo), share, atol=1e-9)


def test_the_linearization_inverts_itself() -> None:
    known = Linearization(expo=0.65, low=0.15, high=0.95, voltage_max=12.8, voltage_min=9.6)
    share = known.voltage_share(np.array([13.5, 12.0, 8.0]))
    np.testing.assert_allclose(share, [1.0, 12.0 / 12.8, 9.6 / 12.8])
    demands = np.array([0.1, 0.35, 0.5])
    np.testing.assert_allclose(known.demands(known.outputs(demands, voltage_share=share), voltage_share=share), demands)


def test_firmware_without_a_curve_has_no_linearization() -> None:
    record = flight()
    assert linearization_of(replace(record, parameters={})) is None
    assert linearization_of(replace(record, source=replace(record.source, format="Crazyflie uSD"))) is None


def test_the_voltage_is_averaged() -> None:
    """The mean over two seconds of a straight line is the line; noise of 0.1 V at 10 Hz goes down by the root of 20."""
    record = flight()
    clean = voltage_factor(record, TIME_S[400:-400], reference_v=12.6)
    line = ((12.6 - 0.01 * TIME_S[400:-400]) / 12.6) ** 2
    np.testing.assert_allclose(clean.values, line, rtol=1e-12)
    assert clean.spread == pytest.approx(line[0] / line[-1] - 1.0)
    noise = 0.1 * np.random.default_rng(1).standard_normal(record.topics[2].time_s.size)
    noisy_topic = replace(record.topics[2], values=record.topics[2].values + noise)
    noisy = voltage_factor(replace(record, topics=(noisy_topic,)), TIME_S[400:-400], reference_v=12.6)
    # A factor goes by the square of the voltage: twice the noise over the voltage.
    expected = 2.0 * 0.1 / 12.6 / np.sqrt(20.0)
    assert float(np.std(noisy.values - line)) == pytest.approx(expected, rel=0.3)


def test_no_voltage_is_said() -> None:
    record = flight()
    with pytest.raises(InsufficientDataError, match="has no battery_voltage"):
        voltage_factor(replace(record, topics=record.topics[:2]), TIME_S)
