"""How soon a payload is seen, and how often nothing is taken for one: twelve hours of sticks in wind."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from tests.twins import track_flights as twin

from rotorid.simulation.wind import Wind
from rotorid.typing import FloatArray
from rotorid.verification.tracking import RATE_HZ, Tracking, track_gain

ROLL = {"gain": 113.1, "damping": -1.0, "lag_s": 0.048, "delay_s": 0.0054}
HOURS_FLIGHTS, FLIGHT_S = 18, 600.0
STEPS, BEFORE_S, AFTER_S = 40, 120.0, 90.0


def wind(speed_m_s: float, turbulence_m_s: float) -> Wind:
    return Wind(north_m_s=0.7 * speed_m_s, east_m_s=0.7 * speed_m_s, turbulence_m_s=turbulence_m_s)


def followed(data: dict[str, FloatArray], **options: float | None) -> Tracking:
    chosen = {"thrust_exponent": 0.0, **options}
    return track_gain(
        data["roll_command"],
        data["p"],
        data["roll_stick"],
        predict=partial(twin.prediction, **ROLL),
        thrust=data["thrust_command"],
        **chosen,
    )


def alarms(level: float, air: Wind) -> tuple[int, float]:
    """False alarms, and hours that could tell."""
    found = [
        followed(twin.columns(twin.fly(FLIGHT_S, level=level, wind=air, seed=seed))) for seed in range(HOURS_FLIGHTS)
    ]
    return sum(len(one.steps) for one in found), sum(one.told_s for one in found) / 3600.0


def excited_s(level: float, air: Wind) -> FloatArray:
    """Seconds with a moving stick until a payload was seen, for each flight."""
    found = []
    for seed in range(STEPS):
        data = twin.joined(
            twin.columns(twin.fly(BEFORE_S, level=level, wind=air, seed=100 + seed)),
            twin.columns(twin.fly(AFTER_S, level=level, wind=air, seed=5100 + seed, changes=twin.payload())),
        )
        seen = [step for step in followed(data).steps if step.at_s > BEFORE_S and step.ratio < 1.0]
        if not seen:
            found.append(np.inf)
            continue
        stick = np.abs(data["roll_stick"][round(BEFORE_S * RATE_HZ) : round(seen[0].at_s * RATE_HZ)])
        halves = stick[: stick.size // 25 * 25].reshape(-1, 25).max(axis=1)
        found.append(0.5 * float((halves > 0.1 * level).sum()))
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("level", "speed", "turbulence", "within_s", "alarms_h"),
    [
        (0.5, 3.0, 0.5, 4.0, 1.0),
        (0.15, 3.0, 0.5, 6.0, 1.0),
        (0.5, 6.0, 1.0, 10.0, 2.0),
        pytest.param(
            *(0.15, 6.0, 1.0, 10.0, 2.0),
            marks=pytest.mark.xfail(
                raises=AssertionError, reason="a small stick in strong gusts: 90 % seen within 14 s, 3 alarms an hour"
            ),
        ),
    ],
)
def test_a_payload_is_seen_soon_and_nothing_seldom(
    level: float, speed: float, turbulence: float, within_s: float, alarms_h: float
) -> None:
    air = wind(speed, turbulence)
    count, hours = alarms(level, air)
    seconds = excited_s(level, air)
    shown = np.quantile(seconds, [0.5, 0.75, 0.9], method="higher")
    print(f"stick {level}, wind {speed}: {count} alarms in {hours:.2f} h; seen after {shown} s, bar {within_s}")
    # Whatever is missed, this is kept.
    if np.mean(seconds <= 3.0 * within_s) < 0.9 or count > 2.0 * alarms_h * hours:
        pytest.fail("worse than was measured")
    assert np.mean(seconds <= within_s) >= 0.9
    assert count <= alarms_h * hours


@pytest.mark.slow
@pytest.mark.xfail(
    raises=AssertionError, reason="filters and gain of the reference are those of calm air: 5 alarms an hour of flight"
)
def test_wind_that_rises_is_no_payload() -> None:
    count, hours, silent = 0, 0.0, 0
    for seed in range(12):
        data = twin.joined(
            twin.columns(twin.fly(90.0, level=0.5, wind=wind(1.0, 0.2), seed=seed)),
            twin.columns(twin.fly(510.0, level=0.5, wind=wind(6.0, 1.0), seed=900 + seed)),
        )
        found = followed(data)
        count, hours = count + len(found.steps), hours + found.told_s / 3600.0
        silent += found.cannot_tell.count("air")
    print(f"rising wind: {count} alarms in {hours:.2f} h that told, {silent / 7200:.2f} h that cannot tell")
    # Whatever is missed, this is kept.
    if count > 12 or not silent:
        pytest.fail("worse than was measured")
    assert count == 0


@pytest.mark.slow
@pytest.mark.parametrize("exponent", [1.0, None])
def test_throttle_is_no_payload(exponent: float | None) -> None:
    """On a vehicle whose thrust grows with the square of the command; the power is given, or found in the reference."""
    count, hours, powers = 0, 0.0, []
    for seed in range(6):
        flying = twin.with_quadratic_thrust()
        flight = twin.fly(FLIGHT_S, level=0.5, wind=wind(3.0, 0.5), seed=seed, throttle=0.3, flying=flying)
        data = twin.columns(flight)
        found = followed(data, thrust_exponent=exponent)
        plain = followed(data, thrust_exponent=0.0)
        powers.append(found.thrust_exponent)
        count, hours = count + len(found.steps), hours + found.told_s / 3600.0
        print(found.thrust_exponent, len(found.steps), len(plain.steps), float(np.std(np.log(data["thrust_command"]))))
    print(f"throttle, exponent {exponent}: {count} alarms in {hours:.2f} h, powers {powers}")
    assert count <= max(hours, 1.0)
