"""Intervals of the physics of flight hold the truth, and say where the scatter between flights comes from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.unit.fitting.flight.made_up import FRAME, TRUTH, made_up_flight

from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.fit import FlightChoices, FlightFit, fit_flight
from rotorid.fitting.problem import Part
from rotorid.models.flight import Airframe
from rotorid.uncertainty.flight_error import covariance, flights_alone, usual_scatter, with_errors
from rotorid.uncertainty.sandwich import by_bands, by_blocks

CHOICES = FlightChoices(values={"I_zz": TRUTH["I_zz"]}, wind=False, terms=("m_f",), cutoff_hz=90.0)


@pytest.fixture(scope="module")
def flights() -> list[MotorRecord]:
    return [made_up_flight(seed, gusts_nm=0.003, seconds=14.0) for seed in (1, 2)]


@pytest.fixture(scope="module")
def one(flights: list[MotorRecord]) -> FlightFit:
    return with_errors(fit_flight(flights[:1], FRAME, CHOICES), flights[:1], CHOICES)


@pytest.fixture(scope="module")
def two(flights: list[MotorRecord]) -> FlightFit:
    return with_errors(fit_flight(flights, FRAME, CHOICES), flights, CHOICES)


def test_intervals_hold_the_truth(one: FlightFit, two: FlightFit) -> None:
    for fit in (one, two):
        assert set(fit.errors.names) == set(fit.free) & fit.values.keys()
        missed = [
            name
            for name in set(fit.errors.names) & TRUTH.keys()
            if abs(fit.values[name] - TRUTH[name]) > 1.96 * fit.errors.std(name)
        ]
        assert not missed


def test_a_single_flight_has_the_usual_scatter_and_says_so(one: FlightFit) -> None:
    assert one.errors.how == "assumed"
    for name in ("k_d", "I_xx", "m_f"):
        assert one.errors.std(name) > usual_scatter(name, one.values[name])
    assert one.errors.std("k_d") < 0.05 * one.values["k_d"]


def test_flights_that_agree_say_how_much_they_scatter(one: FlightFit, two: FlightFit) -> None:
    assert two.errors.how == "flights"
    assert two.errors.std("I_xx") < one.errors.std("I_xx")


def test_random_errors_are_a_part(two: FlightFit) -> None:
    assert np.all(two.errors.random.diagonal() < two.errors.covariance.diagonal())
    size = np.sqrt(two.errors.covariance.diagonal())
    assert np.all(np.linalg.eigvalsh(two.errors.covariance / np.outer(size, size)) > 0.0)


def test_another_flight_lies_farther_off_than_the_vehicle(two: FlightFit) -> None:
    assert two.errors.std_of_another("I_xx") > 1.5 * two.errors.std("I_xx")


def test_what_acts_alike_in_all_flights_does_not_separate_them(two: FlightFit) -> None:
    errors = two.errors
    own = errors.shared[errors.names.index("I_xx")]
    assert np.linalg.norm(own) > 0.0
    alike, unlike = (errors.std_of_another("I_xx", shared=row) for row in (own, 0.0 * own))
    assert unlike == pytest.approx(np.hypot(alike, np.linalg.norm(own)))
    assert errors.std_of_another("I_xx") == alike


def test_student_counts_for_scatter_alone(one: FlightFit) -> None:
    for name in ("k_d", "I_xx"):
        place = one.errors.names.index(name)
        random = one.errors.random[place, place]
        scattered = (2.5706 / 1.95996 * usual_scatter(name, one.values[name])) ** 2
        assert one.errors.std(name) ** 2 == pytest.approx(random + scattered, rel=1e-3)


def test_what_a_flight_does_not_show_is_held(two: FlightFit, monkeypatch: pytest.MonkeyPatch) -> None:
    """A slow flight has no hub moment of its own, and inertia and thrust are found with that of all."""
    given = []

    def noted(records: list[MotorRecord], airframe: Airframe, choices: FlightChoices) -> FlightFit:
        given.append(choices.values)
        return fit_flight(records, airframe, choices)

    monkeypatch.setattr("rotorid.uncertainty.flight_error.fit_flight", noted)
    slow = made_up_flight(3, seconds=7.0, speed=0.5, gusts_nm=0.003)
    (alone,) = flights_alone(replace(two, skews_s=np.zeros(1)), [slow], CHOICES, fewest=1)
    assert given[1]["m_f"] == two.values["m_f"]
    assert not given[1].keys() & alone.values.keys()
    assert alone.values["I_xx"] == pytest.approx(TRUTH["I_xx"], rel=0.05)


def test_stretches_of_one_log_are_one_flight(flights: list[MotorRecord]) -> None:
    stretches = [replace(record, name="log") for record in flights]
    assert flights_alone(fit_flight(stretches, FRAME, CHOICES), stretches, CHOICES) == ()


def test_gusts_that_outlast_a_block_count() -> None:
    """Errors of ten seconds' memory, of a number whose column is as slow: blocks of 2 s see a half."""
    rng = np.random.default_rng(0)
    slopes, left = (lfilter([1.0], [1.0, -0.998], rng.normal(size=(2, 3000)))[..., None] for _ in range(2))
    slope, error = slopes[0], left[0]
    error = error - slope * float((slope * error).sum() / (slope**2).sum())
    part = Part(error, slope[..., None], np.zeros((3000, 1, 0)), 50.0)
    assert float(covariance([part])[0, 0]) > 1.5 * float(by_blocks([part])[0, 0])


def test_bands_that_pull_apart_count() -> None:
    """A controller answers what is slow, so that slow and fast motion show another number."""
    rng = np.random.default_rng(0)
    fast, slow = rng.normal(size=3000), lfilter([0.03], [1.0, -0.97], rng.normal(size=3000)) * 10.0
    slope = fast + slow
    error = 0.3 * (slow - slope * float(slow @ slope) / float(slope @ slope)) + 0.1 * rng.normal(size=3000)
    part = Part(error[:, None], slope[:, None, None], np.zeros((3000, 1, 0)), 50.0)
    assert float(covariance([part])[0, 0]) >= float(by_bands([part])[0, 0])
