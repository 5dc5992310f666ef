"""A stitched model of exact slopes, against its linear models and the nonlinear vehicle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.errors import UsageError
from rotorid.simulation import PERFECT, StitchedModel, hover_derivatives_of, linearize, simulate_stitched, trimmed
from rotorid.simulation.hover_flight import OUTPUTS
from rotorid.simulation.linear import simulate_linear
from rotorid.simulation.multirotor_flight import piloted
from rotorid.simulation.stitched import FORCES, MOTIONS
from rotorid.vehicles import aircraft

AXES = ("roll", "pitch", "yaw", "thrust")
CRAFT = piloted(replace(aircraft("forward_quad"), sensors=PERFECT))
RATE_HZ = 250.0


def exact(*speeds_m_s: float) -> StitchedModel:
    """Tables of the exact linearization."""
    derivatives, trims = np.zeros((len(speeds_m_s), 6, 10)), np.zeros((len(speeds_m_s), 9))
    for place, speed in enumerate(speeds_m_s):
        found = hover_derivatives_of(CRAFT.vehicle, CRAFT.autopilot, airspeed_m_s=speed)
        derivatives[place] = [[found[f"{force}_{name}"] for name in (*MOTIONS, *AXES)] for force in FORCES]
        trim = trimmed(CRAFT.vehicle, speed)
        mixer = CRAFT.autopilot.mixer_for(CRAFT.vehicle)
        demands = CRAFT.autopilot.linearization.demands(trim.shares)
        trims[place] = [*trim.velocity_m_s, *trim.angles_rad[:2], *np.linalg.lstsq(mixer, demands, rcond=None)[0]]
    count = len(speeds_m_s)
    rotors, autopilot = CRAFT.vehicle.rotors, CRAFT.autopilot
    return StitchedModel(
        speed_m_s=trims[:, 0],
        derivatives=derivatives,
        trim=trims,
        lag_s=np.full((count, 4), rotors.lag_up_s),
        delay_s=np.tile(np.array(autopilot.delay_s) + 0.5 / autopilot.rate_hz, (count, 1)),
    )


def start(model: StitchedModel, place: int) -> dict[str, float]:
    return dict(zip(("u", "v", "w", "phi", "theta"), map(float, model.trim[place, :5]), strict=True))


@pytest.mark.parametrize("place", [0, 1, 2])
def test_it_stays_in_its_trims(place: int) -> None:
    model = exact(0.0, 4.0, 8.0)
    commands = np.outer(model.trim[place, 5:], np.ones(500))
    flown = simulate_stitched(model, commands, sample_rate_hz=RATE_HZ, start=start(model, place))
    for name in ("u", "w", "theta"):
        np.testing.assert_allclose(flown[name], flown[name][0], atol=1e-9)


def test_small_motions_about_a_trim_are_those_of_its_linear_model() -> None:
    speed = 8.0
    model = exact(0.0, 4.0, speed)
    time_s = np.arange(500) / RATE_HZ
    moved = 1e-6 * np.array([np.sin(6.0 * time_s), np.cos(5.0 * time_s) - 1.0, np.sin(4.0 * time_s), np.sin(time_s)])
    flown = simulate_stitched(
        model, model.trim[2, 5:, None] + moved, sample_rate_hz=RATE_HZ, start=start(model, 2), speed_filter_rad_s=1e-9
    )
    system = linearize(CRAFT.vehicle, CRAFT.autopilot, airspeed_m_s=speed)
    linear = simulate_linear(system, moved, sample_rate_hz=RATE_HZ, hold="first")
    for name in ("u", "v", "w", "p", "q", "r", "phi", "theta"):
        row = linear[OUTPUTS.index(name)]
        np.testing.assert_allclose(flown[name] - flown[name][0], row, atol=3e-3 * np.abs(row).max(), err_msg=name)


def test_between_the_trims_it_is_near_the_trim_that_was_left_out() -> None:
    """At 2 and 6 m/s tables of 0, 4 and 8 m/s leave accelerations of a hundredth of gravity."""
    model, left_out = exact(0.0, 4.0, 8.0), exact(2.0, 6.0)
    for place in range(2):
        commands = np.outer(left_out.trim[place, 5:], np.ones(5))
        flown = simulate_stitched(model, commands, sample_rate_hz=RATE_HZ, start=start(left_out, place))
        theta = flown["theta"][0]
        assert abs(flown["ax"][0] - 9.80665 * np.sin(theta)) < 0.1
        assert abs(flown["az"][0] + 9.80665 * np.cos(theta)) < 0.1


def test_one_that_falls_over_is_no_number_from_there_on() -> None:
    model = exact(0.0, 4.0)
    commands = np.outer(model.trim[0, 5:], np.ones(1000))
    commands[0] += 0.1
    flown = simulate_stitched(model, commands, sample_rate_hz=RATE_HZ, start=start(model, 0))
    assert np.isnan(flown["phi"][-1])
    assert np.isfinite(flown["phi"][:50]).all()


def test_tables_that_do_not_belong_together() -> None:
    model = exact(0.0, 4.0)
    with pytest.raises(UsageError, match="rising speeds"):
        replace(model, speed_m_s=model.speed_m_s[::-1])
    with pytest.raises(UsageError, match="wrong in lag_s"):
        replace(model, lag_s=model.lag_s[:1])
    with pytest.raises(UsageError, match="four rows"):
        simulate_stitched(model, np.zeros((3, 9)), sample_rate_hz=RATE_HZ, start={})


def made_up(*, delay_s: float = 0.0) -> StitchedModel:
    """One speed, trimmed while it banks by 0.4 and pitches by 0.5 rad; only the roll command does anything."""
    derivatives = np.zeros((1, 6, 10))
    derivatives[0, FORCES.index("L"), len(MOTIONS) + AXES.index("roll")] = 10.0
    return StitchedModel(
        speed_m_s=[0.0],
        derivatives=derivatives,
        trim=np.array([[0.0, 0.0, 0.0, 0.4, 0.5, 0.0, 0.0, 0.0, 0.5]]),
        lag_s=np.full((1, 4), 0.02),
        delay_s=np.full((1, 4), delay_s),
    )


def test_a_trim_that_banks_and_pitches_stays() -> None:
    model = made_up()
    commands = np.outer(model.trim[0, 5:], np.ones(250))
    flown = simulate_stitched(model, commands, sample_rate_hz=RATE_HZ, start=start(model, 0))
    for name in ("u", "v", "w", "p", "q", "r", "phi", "theta"):
        np.testing.assert_allclose(flown[name], flown[name][0], atol=1e-9, err_msg=name)


def test_a_command_arrives_when_the_delay_of_its_table_has_passed() -> None:
    model = made_up(delay_s=0.1)
    commands = np.outer(model.trim[0, 5:], np.ones(100))
    commands[0, 25:] += 0.1
    p = simulate_stitched(model, commands, sample_rate_hz=RATE_HZ, start=start(model, 0))["p"]
    time_s = np.arange(100) / RATE_HZ
    assert np.abs(p[time_s < 0.195]).max() < 1e-12
    # The lag of the motors comes on top.
    assert p[-1] == pytest.approx(10.0 * 0.1 * (time_s[-1] - 0.2 - 0.02), abs=0.005)
