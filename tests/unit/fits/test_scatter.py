"""Logs and maneuvers of one vehicle that disagree say so, and their scatter stands in the interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import fly_roll_sweeps
from tests.unit.identifying.motor_logs import ARM_M, written

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.fits.scatter import LogEstimate, amplitude_dependences, disagreements
from rotorid.identifying.identification import identify, identify_motors
from rotorid.io.registry import read
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.motors import MotorSettings
from rotorid.vehicles.motor_flight import TRUTH, flights


def test_logs_with_honest_errors_rarely_disagree() -> None:
    rng = np.random.default_rng(5)
    told = 0
    for _ in range(400):
        logs = [
            LogEstimate(record=f"{i}", values={"x": 3.0 + 0.2 * rng.standard_normal()}, stds={"x": 0.2})
            for i in range(4)
        ]
        told += len(disagreements(logs))
    # One in a hundred is expected, of 400: four, and three deviations of that.
    assert told <= 4 + 3 * 2


def test_scatter_between_logs_comes_back() -> None:
    rng = np.random.default_rng(6)
    values = 3.0 + 0.5 * rng.standard_normal(200) + 0.1 * rng.standard_normal(200)
    (found,) = disagreements(
        [LogEstimate(record=f"{i}", values={"x": value}, stds={"x": 0.1}) for i, value in enumerate(values.tolist())]
    )
    # Of 200 a standard deviation is known to 5 %.
    assert found.scatter == pytest.approx(0.5, rel=0.15)


@pytest.mark.slow
def test_two_flights_of_vehicles_that_differ_are_told_and_wider(tmp_path: Path) -> None:
    """The second one yaws half as much by the same motors."""
    first, second = flights(2, seed=31, duration_s=12.0)
    rates = second.rates.copy()
    rates[2] *= 0.5
    choices = MotorSettings(known={"m": TRUTH["m"]}, layout="quad.x", arm_m=ARM_M)
    logs = [read(written(first, tmp_path / "a.csv")), read(written(replace(second, rates=rates), tmp_path / "b.csv"))]
    apart = identify_motors(logs, choices)
    told = {one.where for one in apart.findings if one.kind == "logs_disagree"}
    # Yaw alone: inertia and thrust are those of one vehicle, and its damping too.
    assert told == {"kappa_per_I_zz"}
    low, high = apart["kappa_per_I_zz"].lower, apart["kappa_per_I_zz"].upper
    assert low is not None
    assert high is not None
    assert low < 0.5 * TRUTH["kappa_per_I_zz"] * 1.1
    assert high > TRUTH["kappa_per_I_zz"] * 0.9


@pytest.fixture(scope="module")
def sweeps(tmp_path_factory: pytest.TempPathFactory) -> FlightRecord:
    """Two sweeps in roll, from 3 and from 56 s."""
    path = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(path)
    return read(path)


def turning_less(record: FlightRecord, factor: float, *, from_s: float, name: str) -> FlightRecord:
    """Another log, in which commands turned the vehicle less from a moment on: more of them for the same motion."""
    (topic,) = record.topics
    values = topic.values.copy()
    values[topic.row("roll_command")] /= np.where(topic.time_s >= from_s, factor, 1.0)
    source = replace(record.source, name=name, sha256=name)
    return replace(record, topics=(replace(topic, values=values),), source=source)


SETTINGS = IdentifySettings(band_rad_s=(12.0, 50.0))


def test_logs_of_responses_that_disagree_are_told_and_wider(sweeps: FlightRecord) -> None:
    heavy = turning_less(sweeps, 0.7, from_s=0.0, name="heavy.csv")
    alone, other = (identify([record], "rate.roll", settings=SETTINGS)["L_roll"] for record in (sweeps, heavy))
    both = identify([sweeps, heavy], "rate.roll", settings=SETTINGS)
    told = {one.where for one in both.findings if one.kind == "logs_disagree"}
    assert "L_roll" in told
    low, high = both["L_roll"].lower, both["L_roll"].upper
    assert low is not None
    assert high is not None
    assert low < other.value < alone.value < high


def test_repeated_maneuvers_that_disagree_are_told(sweeps: FlightRecord) -> None:
    found = identify([turning_less(sweeps, 0.7, from_s=54.0, name="payload.csv")], "rate.roll", settings=SETTINGS)
    (told,) = (one for one in found.findings if one.kind == "logs_disagree" and one.where == "L_roll")
    assert "payload.csv at 56." in told.message


def test_maneuvers_that_agree_are_not_told_apart(sweeps: FlightRecord) -> None:
    found = identify([sweeps], "rate.roll", settings=SETTINGS)
    assert "logs_disagree" not in {one.kind for one in found.findings}


def swung(swings: Sequence[float], values: Sequence[float], *, random: float = 0.1) -> list[LogEstimate]:
    """Maneuvers of one log, whose deviations are wide and alike."""
    return [
        LogEstimate(
            record=f"at {place} s",
            values={"x": x},
            stds={"x": 5.0 * random},
            random={"x": random},
            asked=swing,
            moved=swing,
        )
        for place, (swing, x) in enumerate(zip(swings, values, strict=True))
    ]


def test_what_grows_with_the_swing_is_told_with_its_value_at_none() -> None:
    (found,) = amplitude_dependences(swung([0.3, 0.1, 0.2], [-4.5, -3.5, -4.0]))
    assert found.at_rest == pytest.approx(-3.0, rel=1e-3)
    assert [swing for _, _, swing in found.estimates.values()] == pytest.approx([1.0, 2.0, 3.0])
    assert "at 0 s (3 times the amplitude)" in found.finding("1/s").message
    assert disagreements(swung([0.3, 0.1, 0.2], [-4.5, -3.5, -4.0])) == ()


@pytest.mark.parametrize(
    ("swings", "values"),
    [([0.1, 0.12], [-3.0, -5.0]), ([0.1, 0.0], [-3.0, -5.0]), ([0.1, 0.3], [-3.0, -3.3]), ([0.2], [-3.0])],
    ids=["alike", "not known", "within errors", "alone"],
)
def test_nothing_is_said_of_swings_that_tell_nothing(swings: list[float], values: list[float]) -> None:
    assert amplitude_dependences(swung(swings, values)) == ()


@pytest.mark.parametrize("other", ["asked", "moved"])
def test_another_vehicle_swings_otherwise_than_it_is_asked_to(other: str) -> None:
    """A payload asks for larger commands of the same motion, or lets the same commands move less."""
    logs = [replace(one, **{other: 0.1}) for one in swung([0.1, 0.3], [-3.0, -5.0])]
    assert amplitude_dependences(logs) == ()


def test_half_a_percent_is_no_dependence() -> None:
    """No instrument is better: with the least of random errors, 1 % of difference is within 2.6 deviations."""
    assert amplitude_dependences(swung([0.1, 0.3], [-100.0, -101.0], random=1e-3)) == ()
    assert amplitude_dependences(swung([0.1, 0.3], [-100.0, -103.0], random=1e-3))


def test_maneuvers_with_honest_errors_rarely_depend_on_swing() -> None:
    rng = np.random.default_rng(7)
    told = sum(len(amplitude_dependences(swung([0.1, 0.2, 0.25], 0.1 * rng.standard_normal(3)))) for _ in range(400))  # type: ignore[misc]
    assert told <= 4 + 3 * 2


RATE_HZ, L_P, L_ROLL, LAG_S = 200.0, -3.0, 100.0, 0.03


def swept_twice(quadratic: float, swings: Sequence[float] = (0.04, 0.1)) -> FlightRecord:
    r"""Sweeps of 0.4 to 8 Hz of :math:`\dot p = L_p p - c |p| p + L_{roll} u`, behind a lag of the motors."""
    time_s = np.arange(0.0, 60.0, 1.0 / RATE_HZ)
    rise = np.log(8.0 / 0.4) / 60.0
    one = np.sin(2.0 * np.pi * 0.4 / rise * np.expm1(rise * time_s)) * np.minimum(
        1.0, np.minimum(time_s, 60 - time_s) / 3
    )
    pause = np.zeros(int(4.0 * RATE_HZ))
    command = np.concatenate([pause, *(part for size in swings for part in (size * one, pause))])
    p, motors, rates, step_s = 0.0, 0.0, np.empty(command.size), 0.2 / RATE_HZ
    for place, asked in enumerate(command.tolist()):
        rates[place] = p
        for _ in range(5):
            motors += step_s * (asked - motors) / LAG_S
            p += step_s * (L_P * p - quadratic * abs(p) * p + L_ROLL * motors)
    rates += 0.01 * np.random.default_rng(1).standard_normal(rates.size)
    return FlightRecord(
        source=Source(name="sweeps.csv", format="CSV", sha256="1"),
        topics=(
            Topic(
                name="log",
                time_s=np.arange(command.size) / RATE_HZ,
                channels=(Channel(name="roll_command", unit="1"), Channel(name="p", unit="rad/s")),
                values=np.stack([command, rates]),
            ),
        ),
    )


@pytest.mark.parametrize("quadratic", [0.1, 0.5, 2.0])
def test_a_drag_that_grows_with_the_square_of_speed_is_told_and_its_interval_reaches_small_motions(
    quadratic: float,
) -> None:
    found = identify([swept_twice(quadratic)], "rate.roll")
    told = {one.where: one for one in found.findings if one.kind == "amplitude_dependent"}
    # Small motions have L_p; the line ends within 5 % of it, and the interval holds it.
    assert told["L_p"].numbers["at_rest"] == pytest.approx(L_P, rel=0.05)
    low, high = found["L_p"].lower, found["L_p"].upper
    assert low is not None
    assert high is not None
    assert low < L_P < high
    assert not {"T_motor", "tau_roll"} & set(told)


def test_logs_that_swing_differently_may_be_of_other_batteries() -> None:
    """What differs between logs is said of the logs, and no line is laid through them."""
    small, large = (swept_twice(0.5, swings=(size,)) for size in (0.04, 0.1))
    other = replace(large, source=replace(large.source, name="other.csv", sha256="2"))
    found = identify([small, other], "rate.roll")
    assert "amplitude_dependent" not in {one.kind for one in found.findings}


def test_a_linear_vehicle_depends_on_no_swing() -> None:
    found = identify([swept_twice(0.0)], "rate.roll")
    assert "amplitude_dependent" not in {one.kind for one in found.findings}
    # The log shows neither attitude nor thrust nor an instrument, whose errors count; a drag that bends counts more.
    straight, bent = found["L_p"].std, identify([swept_twice(0.1)], "rate.roll")["L_p"].std
    assert straight is not None
    assert bent is not None
    assert straight < 0.6 * bent
