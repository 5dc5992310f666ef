"""The curve of filters with gains around a known plant: each point keeps its limits, and none is beaten by another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.twins.filter_flights import SOURCES, fly
from tests.unit.loops.test_filter_choice import ARDUPILOT

from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.controllers import controllers_of
from rotorid.flights.filter_effects import command_powers, filtered_density, noise_of_rate, with_parameters
from rotorid.flights.gyro_noise import gyro_noise
from rotorid.proposing.axis import KnownAxis
from rotorid.proposing.filter_curve import FilterCurve, filter_curve, with_point
from rotorid.proposing.flown_gains import LoggedLoop
from rotorid.proposing.settings import TuneSettings
from rotorid.tuning import Wishes, frequency_grid, uncertain_plant
from rotorid.tuning.firmware import ranges_of
from rotorid.typing import Axis, ComplexArray, FloatArray

LIMIT = 1.7


def vehicle(w: FloatArray) -> ComplexArray:
    return np.asarray(110.0 / ((0.03j * w + 1.0) * (1j * w + 0.5)) * np.exp(-0.006j * w))


def known_axes(record: FlightRecord) -> dict[Axis, KnownAxis]:
    flown = controllers_of(record)
    found: dict[Axis, KnownAxis] = {}
    axes: tuple[Axis, ...] = ("roll",)
    for axis, letter in zip(axes, "R", strict=True):
        controller = flown.axis(axis)
        assert controller is not None
        loop = LoggedLoop(
            axis=axis,
            controller=controller,
            known=flown,
            record=record,
            source=SOURCES[record.source.format].format(letter),
        )
        omega = frequency_grid(controller.controller)
        parts = loop.parts(omega)
        plant = uncertain_plant(vehicle, None, band_rad_s=(1.0, 150.0), draws=20)
        found[axis] = KnownAxis(
            flown=loop,
            plant=plant,
            omega_rad_s=omega,
            flown_parts=parts,
            then=None,
            controller=controller,
            parts=parts,
        )
    return found


def wishes(known: KnownAxis) -> Wishes:
    return Wishes(sensitivity_peak=LIMIT, ranges=ranges_of(known.controller))


@pytest.fixture(scope="module")
def record() -> FlightRecord:
    return fly(ARDUPILOT, seconds=15.0)


@pytest.fixture(scope="module")
def curve(record: FlightRecord) -> FilterCurve:
    return filter_curve(known_axes(record), wishes, {})


@pytest.mark.slow
def test_every_point_keeps_the_limits_on_all_likely_plants(curve: FilterCurve) -> None:
    assert len(curve.points) >= 3
    for point in curve.points:
        for axis in point.axes.values():
            assert np.quantile(axis.judged.rate.sensitivity_peak, 0.9) <= LIMIT
            assert np.quantile(axis.judged.whole.sensitivity_peak, 0.9) <= LIMIT
            assert axis.judged.rate.stable.all()
            assert axis.judged.whole.stable.all()


@pytest.mark.slow
def test_less_noise_is_paid_with_attitude_along_the_curve(curve: FilterCurve) -> None:
    others = [point for point in curve.points if point.number]
    noises, attitudes = ([getattr(point, name) for point in others] for name in ("noise", "attitude"))
    assert noises == sorted(noises)
    assert attitudes == sorted(attitudes, reverse=True)
    kept = curve.point(0)
    assert not kept.filters
    assert not any(point.noise <= kept.noise and point.attitude < 0.99 * kept.attitude for point in [kept])


@pytest.mark.slow
def test_noisy_motors_get_a_notch_and_a_stiffer_attitude(curve: FilterCurve) -> None:
    best = curve.point(curve.recommended)
    kept = curve.point(0)
    assert "INS_HNTCH_ENABLE" in best.filters
    assert best.noise < 0.9 * kept.noise
    assert best.attitude <= 1.02 * kept.attitude


@pytest.mark.slow
def test_a_picked_point_is_what_tune_then_flies(curve: FilterCurve, record: FlightRecord) -> None:
    known = known_axes(record)
    point = curve.point(curve.recommended)
    then = with_point(known, point, {})
    gains = point.axes["roll"].judged.gains
    assert then["roll"].parts.noise(gains) == pytest.approx(point.axes["roll"].judged.noise)
    np.testing.assert_allclose(then["roll"].parts.whole(gains), with_point(known, point, {})["roll"].parts.whole(gains))
    assert then["roll"].then is not None
    assert then["roll"].then.parameters["INS_HNTCH_ENABLE"] == 1.0


def test_plain_tune_counts_the_same_noise_as_the_curve(record: FlightRecord) -> None:
    roll = known_axes(record)["roll"]
    noise = gyro_noise(record)
    density = filtered_density(record, record, noise)["p"]
    power = command_powers(roll.controller.controller, noise, density).mean()
    assert roll.parts.noise(roll.gains) == pytest.approx(np.sqrt(power))


def test_a_result_alone_counts_the_noise_of_its_log(record: FlightRecord) -> None:
    roll = known_axes(record)["roll"]
    alone = replace(record, topics=())
    result = replace(roll.flown, record=alone, kept=noise_of_rate(record, record, gyro_noise(record), "roll"))
    noises = []
    for values in ({}, {"INS_GYRO_FILTER": 25.0}):
        by_result, by_log = (
            loop.parts(roll.omega_rad_s, then=with_parameters(own, values)).noise(roll.gains)
            for loop, own in ((result, alone), (roll.flown, record))
        )
        assert by_result == pytest.approx(by_log)
        noises.append(by_result)
    assert noises[0] != pytest.approx(noises[1], rel=0.02)
    # How fast the motors turned is not in a result.
    notch = {"ENABLE": 1.0, "MODE": 3.0, "FREQ": 90.0, "BW": 45.0, "ATT": 40.0, "REF": 1.0, "HMNCS": 1.0}
    notch = {f"INS_HNTCH_{name}": value for name, value in notch.items()}
    with pytest.raises(InsufficientDataError, match="a notch that moves in flight changes"):
        result.parts(roll.omega_rad_s, then=with_parameters(alone, notch))


def test_a_slow_log_shows_no_noise_of_the_gyro() -> None:
    assert not known_axes(fly(replace(ARDUPILOT, log_hz=50.0), seconds=15.0))["roll"].parts.shows_noise


def test_a_point_that_is_not_there_is_named() -> None:
    with pytest.raises(UsageError, match="--filters 99: no such point"):
        FilterCurve(points=(), recommended=0).point(99)


def test_a_slow_log_has_no_curve() -> None:
    record = fly(replace(ARDUPILOT, log_hz=50.0), seconds=15.0)
    with pytest.raises(InsufficientDataError, match="too slow"):
        filter_curve(known_axes(record), wishes, {})


@pytest.mark.parametrize("text", ["keep", "curve", "propose", "3"])
def test_choices_of_filters(text: str) -> None:
    assert TuneSettings(filter_choice=text).filter_choice == text


@pytest.mark.parametrize("text", ["", "best", "-1", "1.5"])
def test_other_choices_of_filters_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--filters"):
        TuneSettings(filter_choice=text)
