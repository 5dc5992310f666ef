"""Sensors and stamps that are wrong amid a sound log: the model stays within its interval, or there is none.

Each fault is put into the rate of a flight of which the model is known, as a broken sensor, a wrong mapping or a logger
would; what the sound log gives is the truth here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.io.screening import screened
from rotorid.typing import FloatArray

Fault = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Values and stamps of a channel to what the log would hold; a stamp that is no number is a sample that is missing."""

WITHIN = 3.0


def frozen(values: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    middle = 0.5 * (time_s[0] + time_s[-1])
    held = np.abs(time_s - middle) < 1.5
    return np.where(held, values[held][0], values), time_s


def clipped(values: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    end = 0.6 * np.quantile(np.abs(values), 0.97)
    return np.clip(values, -end, end), time_s


def spiky(values: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    rng = np.random.default_rng(0)
    places = rng.choice(values.size, 50, replace=False)
    spoiled = values.copy()
    spoiled[places] += rng.choice([-1.0, 1.0], 50) * 20.0 * np.std(values)
    return spoiled, time_s


def thinned(values: FloatArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    return values, np.where(np.random.default_rng(0).random(time_s.size) < 0.3, np.nan, time_s)


FAULTS: Mapping[str, Fault] = {
    "sign": lambda values, time_s: (-values, time_s),
    "twice": lambda values, time_s: (2.0 * values, time_s),
    "a tenth more": lambda values, time_s: (1.1 * values, time_s),
    "50 ms late": lambda values, time_s: (values, time_s + 0.05),
    "a clock 0.1 % off": lambda values, time_s: (values, time_s[0] + 1.001 * (time_s - time_s[0])),
    "frozen for 3 s": frozen,
    "clipped": clipped,
    "spikes": spiky,
    "30 % missing": thinned,
}
REFUSED = frozenset({"sign", "twice"})
OFTEN = frozenset({"sign", "a tenth more", "50 ms late", "frozen for 3 s"})
NAMED: Mapping[str, str] = {
    "a tenth more": "kinematic_inconsistency",
    "50 ms late": "kinematic_inconsistency",
    "frozen for 3 s": "frozen_sensor",
    "clipped": "sensor_clipping",
}
"""What the findings must say of it."""

CASES = [
    pytest.param(log, name, marks=() if name in OFTEN and log.startswith("px4") else pytest.mark.slow)
    for log in ("px4_sitl/roll.ulg", "ardupilot_sitl/x_calm_roll.BIN")
    for name in FAULTS
]


def with_fault(record: rotorid.FlightRecord, fault: Fault) -> rotorid.FlightRecord:
    """The log as it would be read with a fault in its roll rate."""
    topics = []
    for topic in record.topics:
        row = topic.row("p")
        if row is None:
            topics.append(topic)
            continue
        values = np.array(topic.values)
        values[row], time_s = fault(values[row], np.array(topic.time_s))
        kept = np.isfinite(time_s)
        topics.append(replace(topic, values=values[:, kept], time_s=time_s[kept]))
    return screened(replace(record, topics=tuple(topics)))


@pytest.fixture(scope="module")
def sound(shared_data: Path) -> Callable[[str], tuple[rotorid.FlightRecord, rotorid.IdentifiedModel]]:
    known: dict[str, tuple[rotorid.FlightRecord, rotorid.IdentifiedModel]] = {}

    def of(log: str) -> tuple[rotorid.FlightRecord, rotorid.IdentifiedModel]:
        if log not in known:
            record = rotorid.read(shared_data / log)
            known[log] = record, rotorid.identify(record, "rate.roll")
        return known[log]

    return of


@pytest.mark.parametrize(("log", "name"), CASES)
def test_a_fault_is_left_out_widens_or_refuses(
    log: str, name: str, sound: Callable[[str], tuple[rotorid.FlightRecord, rotorid.IdentifiedModel]]
) -> None:
    record, truth = sound(log)
    try:
        found = rotorid.identify(with_fault(record, FAULTS[name]), "rate.roll")
    except InsufficientDataError:
        assert name in REFUSED or name == "a clock 0.1 % off"
        return
    assert name not in REFUSED
    for parameter in ("L_roll", "T_motor", "tau_roll", "L_p"):
        there, here = truth.parameters[parameter], found.parameters[parameter]
        if here.std and there.std:
            assert abs(here.value - there.value) <= WITHIN * here.std, parameter
    kinds = {finding.kind for finding in found.findings}
    if log.startswith("px4") and name in NAMED:
        assert NAMED[name] in kinds
