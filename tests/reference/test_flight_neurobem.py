"""Force of three public flights of a racing quadrotor, each predicted by a fit of the two others.

Errors are root mean squares of the length of the vector, pooled over all samples, with predictions behind the filter of
the data's specific force (9 Hz, zero phase). NeuroBEM's own network has 0.32 N on the same flights, a differentiator of
the logged velocities that knows no model 0.19 N on six flights of the set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.reference.neurobem import FLIGHTS, FRAME, neurobem_flights

from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.fit import predicted_force
from rotorid.fitting.flight.ladder import ForceChoices, ForceFit, fit_force
from rotorid.fitting.flight.motion import VelocityClass, motion
from rotorid.frames import earth_to_body

SENSOR_HZ = 9.0
MOMENT_NUMBERS = 5
"""Inertia of three axes, one of kappa and the inertia of a rotor, and one moment of the air."""

WIND = np.array([3.0, -2.0])
ROTOR_DRAG = 4.0e-5
"""N s²/(m rad): the mean over six flights of the set, each alone, of which three are here; they differ by 1.3 %."""


@pytest.fixture(scope="module")
def records(unpacked: Callable[[str], Path]) -> dict[str, MotorRecord]:
    return neurobem_flights(unpacked)


def fitted(*flights: MotorRecord, kind: VelocityClass = "measured") -> ForceFit:
    choices = ForceChoices({}, None, kind, kind == "measured", None, np.zeros(len(flights)), 0.01)
    return fit_force(flights, FRAME, choices)


def error_n(found: ForceFit, record: MotorRecord, kind: VelocityClass = "measured") -> float:
    driven = motion(record, found.values, kind=kind)
    left = record.force - predicted_force(found.values, FRAME, record, driven, SENSOR_HZ)
    return FRAME.mass_kg * float(np.sqrt((left**2).sum(axis=0).mean()))


def left_out(records: Mapping[str, MotorRecord], kind: VelocityClass) -> dict[str, float]:
    return {
        key: error_n(fitted(*(other for name, other in records.items() if name != key), kind=kind), record, kind)
        for key, record in records.items()
    }


def pooled(records: Mapping[str, MotorRecord], errors: Mapping[str, float]) -> float:
    samples = np.array([records[key].samples for key in errors])
    return float(np.sqrt(np.average(np.array(list(errors.values())) ** 2, weights=samples)))


@pytest.fixture(scope="module")
def unseen(records: dict[str, MotorRecord]) -> dict[str, float]:
    return left_out(records, "measured")


@pytest.mark.slow
def test_an_unseen_flight_is_predicted_by_twelve_numbers(
    records: dict[str, MotorRecord], unseen: dict[str, float]
) -> None:
    """.49 N with six numbers of force; 1.26 N with thrust by speed alone."""
    assert pooled(records, unseen) <= 0.50
    assert len(fitted(records["d"], records["h"]).free) + MOMENT_NUMBERS <= 12


@pytest.mark.slow
def test_a_slow_flight_is_predicted_by_fast_ones(unseen: dict[str, float]) -> None:
    assert unseen["g"] <= 0.20


@pytest.mark.slow
@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason=".49 N: what is left is thrust in pull-ups, 0.3 to 1 Hz. Thrust that lags behind all speeds by 40 ms gives "
    ".44 N, but it trades with the accelerometer's place, and faster motion shows no such lag",
)
def test_an_unseen_flight_to_forty_two_hundredths(records: dict[str, MotorRecord], unseen: dict[str, float]) -> None:
    assert pooled(records, unseen) <= 0.42


@pytest.mark.slow
def test_the_attitude_alone_gives_the_velocity(records: dict[str, MotorRecord]) -> None:
    """.52 N with a velocity that is integrated from specific force."""
    assert pooled(records, left_out(records, "attitude")) <= 0.54


@pytest.mark.parametrize("key", FLIGHTS)
def test_an_added_wind_is_found(records: dict[str, MotorRecord], key: str) -> None:
    record = records[key]
    blown = earth_to_body(record.attitude, np.tile(np.array([*WIND, 0.0])[:, None], record.samples))
    found = fitted(replace(record, velocity=record.velocity + blown))
    assert np.abs(found.winds[0] - WIND).max() < 0.3


@pytest.fixture(scope="module")
def drag(records: dict[str, MotorRecord]) -> dict[str, float]:
    """Rotor drag by each flight alone, and by the fast two together, over that of six flights."""
    alone = {key: fitted(record).values["k_d"] for key, record in records.items()}
    both = fitted(records["d"], records["h"]).values["k_d"]
    return {key: value / ROTOR_DRAG for key, value in {**alone, "d, h": both}.items()}


@pytest.mark.slow
def test_rotor_drag_of_every_fast_flight_is_the_same(drag: dict[str, float]) -> None:
    """4.05 and 4.10e-5."""
    assert drag["d"] == pytest.approx(1.0, abs=0.03)
    assert drag["h"] == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="4.23 instead of 4.0e-5: together, the flights have no k_w, because it lowers the error by less than 1 %; "
    "alone, d has it",
)
def test_rotor_drag_of_fast_flights_together_is_that_of_each(drag: dict[str, float]) -> None:
    assert drag["d, h"] == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="3.6 instead of 4.0e-5: the slow flight has a fifth less drag along y than along x, at a coherence of .99",
)
def test_rotor_drag_of_a_slow_flight_is_that_of_fast_ones(drag: dict[str, float]) -> None:
    assert drag["g"] == pytest.approx(1.0, abs=0.03)
