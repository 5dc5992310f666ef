"""The skew of motors against the gyro, from simulated flights whose stamps were moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.motor_stamps import MotorSkew, motor_skew, stamp_findings
from rotorid.models.rotors import RotorLayout, ardupilot_mixer, library_layout
from rotorid.typing import FloatArray

X = library_layout("quad.x")
ARMS = np.vstack([X.moment_arms[:2], X.spins[None]]) * np.array([[200.0], [150.0], [30.0]])
RATE_HZ, DURATION_S = 200.0, 20.0
MOTOR_LAG_S, DAMPING_1_S = 0.04, 1.5


def smooth(rows: FloatArray, lag_s: float) -> FloatArray:
    made, state, share = np.empty_like(rows), np.zeros(len(rows)), -np.expm1(-1.0 / (lag_s * RATE_HZ))
    for sample in range(rows.shape[1]):
        state += share * (rows[:, sample] - state)
        made[:, sample] = state
    return made


def a_flight(
    *,
    motors_late_s: float = 0.0,
    gyro_late_s: float = 0.0,
    commands: float = 0.01,
    gusts: float = 0.0,
    seed: int = 0,
    prefix: str = "motor_speed_",
) -> FlightRecord:
    """A stabilized quadrotor that is moved by commands and gusts, with stamps that are late on purpose."""
    rng = np.random.default_rng(seed)
    count = round(DURATION_S * RATE_HZ)
    moved = smooth(rng.normal(size=(3, count)), 0.03) * commands * np.sqrt(RATE_HZ / 15.0)
    blown = smooth(rng.normal(size=(3, count)), 0.3) * gusts * np.sqrt(RATE_HZ)
    mixer = ardupilot_mixer(X)[:, :3]
    gyro = 0.02 * rng.normal(size=(3, count))
    rates, thrusts, outputs = np.zeros((3, count)), np.empty((4, count)), np.empty((4, count))
    rate, thrust, share = np.zeros(3), np.full(4, 0.4), -np.expm1(-1.0 / (MOTOR_LAG_S * RATE_HZ))
    for sample in range(count):
        rates[:, sample] = rate + gyro[:, sample]
        outputs[:, sample] = 0.4 + mixer @ (moved[:, sample] - 0.1 * rates[:, sample])
        before, thrust = thrust, thrust + share * (outputs[:, sample] - thrust)
        thrusts[:, sample] = before
        # The mean over the step, so that the motion is neither early nor late by half of it.
        acceleration = ARMS @ (0.5 * (before + thrust) - 0.4) + blown[:, sample] - DAMPING_1_S * rate
        rate = rate + acceleration / RATE_HZ
    time_s = np.arange(count) / RATE_HZ
    values = 1000.0 * np.sqrt(np.maximum(thrusts, 0.0)) if prefix == "motor_speed_" else outputs
    angles = np.cumsum(rates - gyro, axis=1) / RATE_HZ - 0.5 * (rates - gyro) / RATE_HZ
    return record_of(
        topic("motors", [f"{prefix}{number}" for number in range(1, 5)], time_s + motors_late_s, values),
        topic("gyro", ["p", "q", "r"], time_s + gyro_late_s, rates),
        topic("attitude", ["phi", "theta", "psi"], time_s, 0.1 * angles),
    )


def topic(name: str, names: list[str], time_s: FloatArray, values: FloatArray) -> Topic:
    channels = tuple(Channel(name=channel, unit=STANDARD_UNITS[channel]) for channel in names)
    return Topic(name=name, time_s=time_s, channels=channels, values=values)


def record_of(*topics: Topic) -> FlightRecord:
    return FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=""), topics=topics)


def skew_of(record: FlightRecord, layout: RotorLayout = X) -> MotorSkew:
    return motor_skew(record, layout, intervals=((record.start_s + 0.5, record.stop_s - 0.5),))


def refused(record: FlightRecord, layout: RotorLayout = X) -> InsufficientDataError:
    with pytest.raises(InsufficientDataError) as error:
        skew_of(record, layout)
    return error.value


@pytest.mark.parametrize("late_s", [-0.0312, 0.0, 0.0123])
def test_the_skew_of_measured_speeds_comes_back_within_a_millisecond(late_s: float) -> None:
    found = skew_of(a_flight(motors_late_s=-late_s))
    assert found.kind == "speed"
    assert found.late_s.value == pytest.approx(late_s, abs=1e-3)
    assert all(correlation > 0.9 for correlation in found.correlation.values())
    assert abs(found.late_s.value - late_s) < 3.0 * found.late_s.std


def test_gusts_that_return_through_the_controller_cost_milliseconds_and_the_error_says_so() -> None:
    for seed in range(3):
        found = skew_of(a_flight(motors_late_s=-0.0123, gusts=2.0, seed=seed))
        assert found.late_s.std > 5e-4
        assert abs(found.late_s.value - 0.0123) < min(3.0 * found.late_s.std, 5e-3)


def test_the_skew_of_outputs_contains_the_lag_of_motors_and_its_difference_between_logs_does_not() -> None:
    first, second = (skew_of(a_flight(motors_late_s=late_s, prefix="motor_")) for late_s in (0.0, -0.0123))
    assert first.kind == "output"
    assert 0.4 * MOTOR_LAG_S < first.late_s.value < MOTOR_LAG_S
    assert second.late_s.value - first.late_s.value == pytest.approx(0.0123, abs=1e-3)
    assert first.unexplained_s == 0.0


def test_the_attitude_names_the_clock_that_is_wrong() -> None:
    motors, gyro = (
        skew_of(a_flight(**{late: sign * 0.04})) for late, sign in (("motors_late_s", -1), ("gyro_late_s", 1))
    )
    assert (motors.culprit, gyro.culprit) == ("motors", "gyro")
    (finding,) = motors.findings("motors")
    assert (finding.kind, finding.severity) == ("motor_stamps", "warning")
    assert finding.numbers["late_s"] == pytest.approx(0.04, abs=1e-3)
    assert skew_of(a_flight()).findings("motors") == ()


def test_motors_that_are_seconds_late_are_refused_with_the_offset() -> None:
    error = refused(a_flight(motors_late_s=-1.3))
    assert [(found.kind, found.severity) for found in error.findings] == [("motor_stamps", "error")]
    assert error.findings[0].numbers["late_s"] == pytest.approx(1.3, abs=0.02)
    assert "delay the stamps of the motors by 1.30 s" in error.remedy


def test_motors_of_another_flight_are_refused_without_an_offset() -> None:
    flight, other = a_flight(), a_flight(seed=1)
    error = refused(replace(flight, topics=(other.topics[0], *flight.topics[1:])))
    assert error.findings[0].kind == "motor_stamps"
    assert "late_s" not in error.findings[0].numbers


def test_each_kind_of_bad_input_has_its_own_message_and_remedy() -> None:
    flight = a_flight()
    motors, *others = flight.topics
    slow = replace(motors, time_s=motors.time_s[::10], values=motors.values[:, ::10])
    still = replace(motors, values=np.full_like(motors.values, 600.0))
    order = [1, 0, 2, 3]
    claimed = replace(X, positions=X.positions[order], spins=X.spins[order], yaw_weights=None)
    errors = [
        refused(replace(flight, topics=(slow, *others))),
        refused(replace(flight, topics=(still, *others))),
        refused(flight, claimed),
        refused(a_flight(motors_late_s=-1.3)),
    ]
    kinds = [error.findings[0].kind for error in errors]
    assert kinds == ["rate_too_low", "no_excitation", "rotor_order", "motor_stamps"]
    assert all(error.remedy for error in errors)
    assert len({error.remedy for error in errors}) == len(errors)


def test_another_number_of_rotors_is_a_mistake_of_the_call() -> None:
    with pytest.raises(UsageError, match=r"4 motors, but hexa\.x has 6"):
        skew_of(a_flight(), library_layout("hexa.x"))


def test_a_log_without_a_layout_is_judged_by_the_order_that_it_shows() -> None:
    order = [2, 0, 3, 1]
    flight = a_flight(motors_late_s=-0.04)
    motors, *others = flight.topics
    numbered = replace(motors, values=motors.values[order])
    (finding,) = stamp_findings(replace(flight, topics=(numbered, *others)))
    assert (finding.kind, finding.severity) == ("motor_stamps", "warning")
    assert finding.numbers["late_s"] == pytest.approx(0.04, abs=2e-3)
    assert stamp_findings(a_flight()) == ()


def test_a_log_of_slow_or_missing_motors_says_nothing_of_its_stamps() -> None:
    flight = a_flight(motors_late_s=-0.04)
    motors, *others = flight.topics
    slow = replace(motors, time_s=motors.time_s[::10], values=motors.values[:, ::10])
    assert stamp_findings(replace(flight, topics=(slow, *others))) == ()
    assert stamp_findings(replace(flight, topics=tuple(others))) == ()
