"""The gain of a plant at hover, from a rate loop whose thrust slope grows with a throttle that is chopped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Status, Topic
from rotorid.excitation.sticks import everyday_stick
from rotorid.flights.whole_flights import flown as flown_data
from rotorid.loops.plants import MeasuredPlant, drawn_plant, identified_plant, ordinary_plant, whole_flight
from rotorid.loops.throttle import at_hover_throttle

RATE_HZ, DURATION_S = 400.0, 60.0
GAIN, LAG_S, HOVER, PROPORTIONAL = 150.0, 0.02, 0.4, 0.14


def flown(*, slope: float, chopped: bool = True, duration_s: float = DURATION_S) -> FlightRecord:
    """p' = g (1 + slope δ) u behind a lag, held by a rate loop that a stick moves, in gusts."""
    rng = np.random.default_rng(7)
    step_s = 1.0 / RATE_HZ
    count = round(duration_s * RATE_HZ)
    stick = everyday_stick(level=0.8, duration_s=duration_s, sample_rate_hz=RATE_HZ, rng=rng)
    throttle = np.full(count, HOVER)
    at = 2.0
    while chopped and at < duration_s - 2.0:
        span = slice(round(at * RATE_HZ), round((at + rng.uniform(0.3, 1.0)) * RATE_HZ))
        throttle[span] = HOVER * rng.choice([0.35, 1.6])
        at += rng.uniform(1.0, 2.5)
    gusts = rng.standard_normal(count)
    rate, made, blown = 0.0, 0.0, 0.0
    table = np.zeros((4, count))
    for place in range(count):
        asked = 3.0 * stick[place]
        command = PROPORTIONAL * (asked - rate)
        table[:, place] = rate, asked, command, throttle[place]
        made += step_s / LAG_S * ((1.0 + slope * (throttle[place] / HOVER - 1.0)) * command - made)
        blown += step_s / 0.3 * (8.0 * gusts[place] - blown)
        rate += step_s * (GAIN * made + blown)
    names = ("p", "p_setpoint", "roll_command", "thrust_command")
    whole = ((0.0, duration_s - step_s),)
    return FlightRecord(
        source=Source(
            name=f"slope {slope}", format="PX4 ULog", firmware="PX4 1.16.0", sha256=f"{slope}{chopped}{duration_s}"
        ),
        topics=(
            Topic(
                name="loops",
                time_s=np.arange(count) * step_s,
                channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names),
                values=table,
            ),
        ),
        status=Status(vehicle="multirotor", armed=whole, in_air=whole, flagged_in="twin", direct_rates=whole),
        parameters={
            "MC_ROLLRATE_P": PROPORTIONAL,
            "MC_ROLLRATE_I": 0.0,
            "MC_ROLLRATE_D": 0.0,
            "MC_ROLL_P": 4.0,
            "IMU_GYRO_RATEMAX": RATE_HZ,
        },
    )


def over_truth(plant: MeasuredPlant) -> float:
    """Median gain around the crossover over the one at hover."""
    omega = plant.response.omega_rad_s
    inside = (omega > 5.0) & (omega < 40.0)
    truth = GAIN / (1j * omega * (1.0 + 1j * omega * LAG_S))
    return float(np.median(np.abs(plant.response.values[0, 0] / truth)[inside]))


def test_a_chopped_throttle_reads_weak_and_is_corrected() -> None:
    record = flown(slope=1.0)
    mean = identified_plant("roll", [record])
    assert mean is not None
    hover = at_hover_throttle(mean, [record])
    assert over_truth(mean) < 0.95
    assert over_truth(hover) == pytest.approx(1.0, abs=0.03)
    assert hover.gain_error >= 0.5 * abs(over_truth(hover) / over_truth(mean) - 1.0)


def test_intervals_are_wider_by_the_error_of_the_correction() -> None:
    record = flown(slope=1.0)
    hover = at_hover_throttle(identified_plant("roll", [record]), [record])  # type: ignore[arg-type]
    omega = np.array([10.0, 20.0])
    truth = np.abs(GAIN / (1j * omega * (1.0 + 1j * omega * LAG_S)))
    gains = np.median(np.abs(drawn_plant(hover).drawn(omega)) / truth, axis=1)
    assert np.quantile(gains, 0.025) < 1.0 < np.quantile(gains, 0.975)


def test_thrust_that_is_linear_needs_no_correction() -> None:
    record = flown(slope=0.0)
    mean = identified_plant("roll", [record])
    assert mean is not None
    hover = at_hover_throttle(mean, [record])
    assert over_truth(hover) == pytest.approx(over_truth(mean), abs=0.01)
    assert hover.gain_error < 0.01


def test_a_steady_throttle_changes_nothing() -> None:
    record = flown(slope=1.0, chopped=False)
    mean = identified_plant("roll", [record])
    assert mean is not None
    assert at_hover_throttle(mean, [record]) is mean


def over_all(record: FlightRecord) -> tuple[MeasuredPlant, MeasuredPlant]:
    """The plant over the whole flight, and at the throttle of hover."""
    flight = flown_data(record)
    mean = ordinary_plant(flight, whole_flight(flight, "roll"), [])
    return mean, at_hover_throttle(mean, [record], flight=flight)


def test_a_whole_flight_is_corrected_like_the_parts_in_which_the_stick_moves() -> None:
    mean, hover = over_all(flown(slope=1.0))
    assert over_truth(mean) < 0.95
    assert over_truth(hover) == pytest.approx(1.0, abs=0.03)
    assert hover.gain_error >= 0.5 * abs(over_truth(hover) / over_truth(mean) - 1.0)
    mean, hover = over_all(flown(slope=1.0, chopped=False))
    assert hover is mean


def test_a_whole_flight_that_is_too_short_to_be_corrected_is_uncertain() -> None:
    mean, hover = over_all(flown(slope=1.0, duration_s=14.0))
    np.testing.assert_array_equal(hover.response.values, mean.response.values)
    assert hover.gain_error == 0.3


def lead_deg(plant: MeasuredPlant, steady: MeasuredPlant) -> np.ndarray:
    """Phase over that of a flight with a steady throttle, around the crossover."""
    omega = np.array([15.0, 20.0, 25.0, 30.0])
    phases = [
        np.interp(omega, one.response.omega_rad_s, np.unwrap(np.angle(one.response.values[0, 0])))
        for one in (plant, steady)
    ]
    return np.degrees(phases[0] - phases[1])


def test_a_gain_that_moves_bends_the_phase_and_that_is_taken_out() -> None:
    records = [flown(slope=1.0, chopped=chopped) for chopped in (True, False)]
    mean, steady = (identified_plant("roll", [record]) for record in records)
    assert mean is not None
    assert steady is not None
    hover = at_hover_throttle(mean, records[:1])
    before, after = lead_deg(mean, steady), lead_deg(hover, steady)
    assert np.mean(before) > 4.0
    assert abs(np.mean(after)) < 2.0
    assert hover.bend_error is not None
    drawn = drawn_plant(hover).drawn(np.array([20.0]))[:, 0]
    spread, alone = (
        np.std(np.angle(one)) for one in (drawn, drawn_plant(replace(hover, bend_error=None)).drawn(np.array([20.0])))
    )
    assert spread > 1.1 * alone


def test_without_a_known_controller_the_phase_stays() -> None:
    record = replace(flown(slope=1.0), parameters={})
    mean = identified_plant("roll", [record])
    assert mean is not None
    hover = at_hover_throttle(mean, [record])
    np.testing.assert_allclose(np.angle(hover.response.values), np.angle(mean.response.values), atol=1e-12)
