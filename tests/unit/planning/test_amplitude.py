"""Amplitudes from limits: what is found stays within them, and a little more does not."""

import math
from dataclasses import fields, replace

import pytest

from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import UsageError
from rotorid.excitation.plan import planned
from rotorid.planning.amplitude import Limits, Reached, largest_amplitude, reached
from rotorid.simulation.multirotor_flight import fly_multirotor
from rotorid.simulation.wind import Wind
from rotorid.vehicles import px4 as px4_quad

FREE = Limits(
    tilt_rad=10.0, rate_rad_s=1e3, position_m=1e3, height_m=1e3, motor_low=-1.0, motor_high=2.0, saturated=1.0
)


def doublet(amplitude: float) -> FlightPlan:
    one = planned(
        "roll", "doublet", start_s=1.0, amplitude=amplitude, duration_s=0.6, sample_rate_hz=250.0, entry="command"
    )
    return FlightPlan(name="doublet", inputs=(one,), trim_s=2.0)


@pytest.mark.parametrize(
    ("limits", "name"),
    [
        (Limits(tilt_rad=math.radians(15.0)), "tilt_rad"),
        (Limits(rate_rad_s=0.5), "rate_rad_s"),
        (replace(FREE, position_m=0.2), "position_m"),
        (replace(FREE, motor_high=0.6), "motor_high"),
        (replace(FREE, motor_low=0.4), "motor_low"),
    ],
)
def test_the_largest_amplitude_is_within_its_limit_and_a_larger_one_is_not(limits: Limits, name: str) -> None:
    aircraft = px4_quad.aircraft()
    found = largest_amplitude(aircraft, doublet, limits)
    assert found.limited_by == name
    assert found.reached.beyond(limits) == ()
    assert reached(fly_multirotor(aircraft, doublet(found.value))).beyond(limits) == ()
    assert name in reached(fly_multirotor(aircraft, doublet(1.03 * found.value))).beyond(limits)


def test_a_full_command_is_the_largest_that_is_tried() -> None:
    found = largest_amplitude(px4_quad.aircraft(), lambda size: doublet(0.01 * size), FREE)
    assert (found.value, found.limited_by) == (1.0, "")


def test_wind_that_passes_a_limit_by_itself_is_told() -> None:
    with pytest.raises(UsageError, match=r"exceeds its limits of position.* even with a tiny test input"):
        largest_amplitude(
            px4_quad.aircraft(), doublet, Limits(position_m=0.5), wind=Wind(north_m_s=8.0, turbulence_m_s=2.0)
        )


def test_limits_must_leave_room() -> None:
    with pytest.raises(UsageError, match="motor_low below motor_high"):
        replace(Limits(), motor_low=0.9, motor_high=0.5)


AT_THE_LIMITS = Reached(
    tilt_rad=0.4, rate_rad_s=3.0, position_m=10.0, height_m=5.0, motor_low=0.05, motor_high=0.95, saturated=0.0
)
LIMITS = Limits(
    tilt_rad=0.4, rate_rad_s=3.0, position_m=10.0, height_m=5.0, motor_low=0.05, motor_high=0.95, saturated=0.0
)


@pytest.mark.parametrize("name", [field.name for field in fields(Limits)])
def test_every_limit_that_is_passed_is_named_and_no_other(name: str) -> None:
    step = -0.01 if name == "motor_low" else 0.01
    assert AT_THE_LIMITS.beyond(LIMITS) == ()
    assert replace(AT_THE_LIMITS, **{name: getattr(LIMITS, name) + step}).beyond(LIMITS) == (name,)


def test_height_and_saturation_limit_an_amplitude() -> None:
    aircraft = px4_quad.aircraft()
    for limits, name in ((replace(FREE, height_m=0.1), "height_m"), (replace(FREE, saturated=0.0), "saturated")):
        found = largest_amplitude(aircraft, climb if name == "height_m" else doublet, limits)
        assert found.limited_by == name
        assert found.reached.beyond(limits) == ()
        assert getattr(found.reached, name) <= getattr(limits, name)


def climb(amplitude: float) -> FlightPlan:
    one = planned(
        "thrust", "doublet", start_s=1.0, amplitude=amplitude, duration_s=0.6, sample_rate_hz=250.0, entry="command"
    )
    return FlightPlan(name="climb", inputs=(one,), trim_s=2.0)
