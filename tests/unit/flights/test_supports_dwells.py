"""A dwell at one frequency is refused for what it is; what has a band, or a busy pilot, is no dwell."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import rotorid
from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Maneuver, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.flights.supports import dwells_in, rate_support
from rotorid.signal.excitations import single_frequency
from rotorid.typing import FloatArray

TIME = np.arange(0.0, 60.0, 0.005)
INSIDE = (TIME > 5.0) & (TIME < 55.0)


def flight(command: FloatArray, seed: int = 0) -> FlightRecord:
    """An axis p' = -2 p + 100 command in hover, with noise."""
    rng = np.random.default_rng(seed)
    p = np.zeros(TIME.size)
    for k in range(1, TIME.size):
        p[k] = p[k - 1] + 0.005 * (100.0 * command[k - 1] - 2.0 * p[k - 1])
    columns = {
        "roll_command": command + 0.001 * rng.normal(size=TIME.size),
        "p": p + 0.03 * rng.normal(size=TIME.size),
        "thrust_command": 0.4 + 0.01 * rng.normal(size=TIME.size),
        "az": -9.81 + 0.1 * rng.normal(size=TIME.size),
    }
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in columns)
    topic = Topic(name="log", time_s=TIME, channels=channels, values=np.stack(list(columns.values())))
    return FlightRecord(source=Source(name="flight.csv", format="CSV", sha256=f"{seed}"), topics=(topic,))


@pytest.mark.parametrize("hertz", [0.5, 2.0, 7.3])
def test_a_sine_is_named_with_its_frequency(hertz: float) -> None:
    record = flight(np.where(INSIDE, 0.05 * np.sin(2.0 * np.pi * hertz * TIME), 0.0))
    ((maneuver, omega_rad_s),) = dwells_in(record, "roll")
    assert omega_rad_s == pytest.approx(2.0 * np.pi * hertz, rel=0.01)
    assert maneuver.start_s == pytest.approx(5.0, abs=1.0 / hertz)
    support = rate_support(record, "rate.roll")
    assert not support.possible
    assert f"({hertz:.1f} Hz) alone, and one frequency is one point" in support.because
    assert "--segment" not in support.remedy
    given = Maneuver(axis="roll", kind="other", start_s=6.0, stop_s=54.0, origin="given")
    options: dict[str, Any]
    for options in ({}, {"segments": (given,)}):
        with pytest.raises(InsufficientDataError, match="one frequency is one point of a response") as error:
            rotorid.identify(record, model="rate.roll", **options)
        assert [finding.kind for finding in error.value.findings] == ["no_excitation"]


def test_dwells_at_several_frequencies_are_as_many_points() -> None:
    hertz = np.where(TIME < 30.0, 1.0, 4.0)
    pause = INSIDE & ((TIME < 27.0) | (TIME > 33.0))
    record = flight(np.where(pause, 0.05 * np.sin(2.0 * np.pi * hertz * TIME), 0.0))
    assert len(dwells_in(record, "roll")) == 2
    assert "2 frequencies are as many points" in rate_support(record, "rate.roll").because


SIGNALS = {
    "sweep": np.sin(1.0 * TIME + 0.3 * TIME**2),
    "two sines": np.sin(3.0 * TIME) + np.sin(11.0 * TIME),
    "noise": np.convolve(np.random.default_rng(1).normal(size=TIME.size), np.ones(40) / 40.0, mode="same"),
    "steps": np.sign(np.sin(0.7 * TIME + 2.0 * np.sin(0.31 * TIME))),
    "a few turns": np.where(TIME < 8.0, np.sin(2.0 * TIME), 0.0),
    "rest": np.zeros(TIME.size),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_what_has_a_band_is_no_dwell(name: str) -> None:
    assert single_frequency(TIME, SIGNALS[name]) is None


def test_a_sine_may_fade_and_carry_noise() -> None:
    noise = 0.15 * np.random.default_rng(2).normal(size=TIME.size)
    faded = np.minimum(1.0, TIME / 10.0) * np.sin(8.0 * TIME)
    assert single_frequency(TIME, faded + noise) == pytest.approx(8.0, rel=0.01)
