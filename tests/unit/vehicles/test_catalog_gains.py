"""One's own gains around a vehicle of the library."""

import pytest

from rotorid.errors import UsageError
from rotorid.vehicles.catalog import aircraft
from rotorid.vehicles.px4 import with_gains


@pytest.mark.parametrize("name", ["px4_quad", "x500", "iris", "s500", "ardupilot_quad"])
def test_a_vehicles_own_parameters_change_nothing(name: str) -> None:
    before = aircraft(name)
    after = with_gains(before, before.autopilot.parameters, source="own")
    assert (after.autopilot.rates, after.autopilot.angle_1_s) == (before.autopilot.rates, before.autopilot.angle_1_s)
    assert after.autopilot.gyro_cutoff_hz == before.autopilot.gyro_cutoff_hz
    assert after.autopilot.hover_commands(after.vehicle) == pytest.approx(
        before.autopilot.hover_commands(before.vehicle)
    )


def test_gains_of_a_log_are_flown() -> None:
    found = with_gains(aircraft("ardupilot_quad"), {"ATC_RAT_RLL_P": 0.2, "ATC_ANG_RLL_P": 6.0}, source="log")
    assert found.autopilot.rates.proportional[0] == 0.2
    assert found.autopilot.angle_1_s[0] == 6.0
    assert found.autopilot.parameters["ATC_RAT_RLL_P"] == 0.2


@pytest.mark.parametrize(
    ("parameters", "words"), [({"MC_ROLLRATE_P": 0.1}, "gains of px4"), ({"OTHER": 1.0}, "no gains")]
)
def test_gains_of_another_autopilot_are_refused(parameters: dict[str, float], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        with_gains(aircraft("ardupilot_quad"), parameters, source="flight.ulg")
