"""Moments of three public flights of a racing quadrotor, each predicted by a fit of the two others.

Errors are those of angular acceleration in units of moment by the published inertia, behind a low-pass of 25 Hz without
phase: a scale that inertia and moment share moves nothing. Root mean squares of the length of the vector, pooled over
samples. No moment at all would be wrong by 24.4 mN m, what NeuroBEM's network leaves is 9.2 mN m, and a differentiator
of the logged rates that knows no model leaves 12.8 mN m on six flights of the set.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.reference.neurobem import FRAME, neurobem_flights

from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.fit import FlightChoices, FlightFit, fit_flight
from rotorid.fitting.flight.moment import moment_error
from rotorid.fitting.flight.motion import motion
from rotorid.uncertainty.flight_error import flights_alone, usual_scatter, with_errors

pytestmark = pytest.mark.slow

INERTIA = np.array([2.52e-3, 2.14e-3, 4.36e-3])
"""As published, kg m²."""

PLAIN = FlightChoices(terms=("m_f", "m_fx"), predictor=True)


@pytest.fixture(scope="module")
def records(unpacked: Callable[[str], Path]) -> dict[str, MotorRecord]:
    return neurobem_flights(unpacked)


def others(records: Mapping[str, MotorRecord], key: str) -> list[MotorRecord]:
    return [record for name, record in records.items() if name != key]


@pytest.fixture(scope="module")
def fits(records: dict[str, MotorRecord]) -> dict[str, FlightFit]:
    """Fits without the flight of the key."""
    return {key: fit_flight(others(records, key), FRAME, PLAIN) for key in records}


def left_nm(fit: FlightFit, record: MotorRecord, *, predictor: bool = False) -> np.ndarray:
    assert fit.moments is not None
    return moment_error(
        fit.values,
        FRAME,
        record,
        motion(record, fit.values, kind=fit.velocity),
        delay_s=fit.moments.delay_s,
        inertia=INERTIA,
        predictor=fit.predictor if predictor else None,
    )


def pooled_mnm(fits: Mapping[str, FlightFit], records: Mapping[str, MotorRecord], *, predictor: bool = False) -> float:
    left = np.concatenate([left_nm(fits[key], records[key], predictor=predictor) for key in records], axis=1)
    return 1e3 * float(np.sqrt((left**2).sum(axis=0).mean()))


def test_moments_of_an_unseen_flight_by_twelve_numbers(
    fits: dict[str, FlightFit], records: dict[str, MotorRecord]
) -> None:
    """18.4 mN m of the vehicle, not of a predictor; 21.1 with one hub moment for all directions."""
    assert max(len(fit.free) for fit in fits.values()) <= 12
    assert pooled_mnm(fits, records) < 19.0


def test_moments_of_an_unseen_flight_by_the_whole_ladder(records: dict[str, MotorRecord]) -> None:
    """18.1 mN m."""
    whole = {key: fit_flight(others(records, key), FRAME) for key in records}
    assert max(len(fit.free) for fit in whole.values()) <= 25
    assert pooled_mnm(whole, records) < 19.0


def test_the_predictor_is_better_and_another_vehicle(
    fits: dict[str, FlightFit], records: dict[str, MotorRecord]
) -> None:
    """18.1 mN m of 18.4, with 0.46 to 0.70 of the torque of pitch: it took up what forward flight adds before."""
    assert pooled_mnm(fits, records, predictor=True) < pooled_mnm(fits, records)
    assert all(fit.predictor["gain_q"] < 0.75 for fit in fits.values())


@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="18 mN m: below 2 Hz motors and air cancel to a tenth, and what differs is no function of speed and motion",
)
def test_moments_of_an_unseen_flight_to_fifteen(fits: dict[str, FlightFit], records: dict[str, MotorRecord]) -> None:
    assert pooled_mnm(fits, records) < 15.0


@pytest.fixture(scope="module")
def alone(records: dict[str, MotorRecord]) -> dict[str, FlightFit]:
    return {key: fit_flight([record], FRAME, PLAIN) for key, record in records.items()}


def test_every_flight_shows_the_same_inertia(alone: dict[str, FlightFit]) -> None:
    """3.03, 3.28, 3.57 and 3.01, 3.22, 3.38 g m²: eight and six percent."""
    for name in ("I_xx", "I_yy"):
        found = np.array([fit.values[name] for fit in alone.values()])
        assert found.std(ddof=1) / found.mean() < 0.09


@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="3.3 and 3.2 instead of 2.52 and 2.14 g m²: a newton between rotors turns this vehicle by 0.77 "
    "and 0.67 of what published levers and inertia say, alike from 1 to 16 Hz and in all flights",
)
def test_inertia_is_that_which_was_published(records: dict[str, MotorRecord]) -> None:
    every = list(records.values())
    fit = with_errors(fit_flight(every, FRAME, PLAIN), every, PLAIN)
    assert fit.errors is not None
    for name, known in zip(("I_xx", "I_yy"), INERTIA, strict=False):
        assert abs(fit.values[name] - known) < 1.96 * fit.errors.std(name)


class Covered:
    """Numbers of flights that were left out, as alone and as intervals of the others."""

    def __init__(self, records: Mapping[str, MotorRecord]) -> None:
        self.inside: list[bool] = []
        self.widths: list[float] = []
        for key, record in records.items():
            fitted = others(records, key)
            fit = with_errors(fit_flight(fitted, FRAME, PLAIN), fitted, PLAIN)
            assert fit.errors is not None
            same = replace(fit, skews_s=np.zeros(2))
            (one,) = flights_alone(same, [record], PLAIN, fewest=1)
            for name in one.values.keys() & set(fit.errors.names):
                half = 1.96 * fit.errors.std_of_another(name, one.stds[name], one.shared[name])
                self.inside.append(abs(one.values[name] - fit.values[name]) <= half)
                self.widths.append(half / usual_scatter(name, fit.values[name]))


@pytest.fixture(scope="module")
def covered(records: dict[str, MotorRecord]) -> Covered:
    return Covered(records)


def test_intervals_hold_on_a_flight_that_was_left_out(covered: Covered) -> None:
    """24 of 25; drag of the slow flight is outside."""
    assert np.mean(covered.inside) >= 0.90


def test_intervals_of_a_flight_that_was_left_out_are_no_wider_than_flights_differ(covered: Covered) -> None:
    """4.5 times the usual scatter in the median; 8.3 where every source counts for each flight anew."""
    assert np.median(covered.widths) < 5.0


@pytest.mark.xfail(
    raises=AssertionError,
    strict=True,
    reason="4.5: of two flights without errors it is 2.7, by Student's t; place and drag of these three differ by 6 to "
    "10 times the usual scatter",
)
def test_intervals_of_a_flight_that_was_left_out_are_three_times_the_usual_scatter(covered: Covered) -> None:
    assert np.median(covered.widths) <= 3.0
