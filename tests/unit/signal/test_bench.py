"""What tells a log of a bench from one of a flight, and its sweeps without a channel that declares them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.signal.airborne import airborne, airborne_by_thrust, not_flown
from rotorid.signal.bench import is_bench
from rotorid.signal.excitations import find_excitations, rich_excitations
from rotorid.signal.motors import motor_limits
from rotorid.typing import FloatArray

TIME_S = np.arange(0.0, 60.0, 0.01)
SWEEP = np.sin(0.5 * TIME_S + 0.1 * TIME_S**2)
ANGLE = 0.1 * np.sin(0.4 * TIME_S)


def log(columns: Mapping[str, FloatArray], units: Mapping[str, str] | None = None) -> FlightRecord:
    names = dict.fromkeys(columns, "1") | dict.fromkeys(("phi", "theta", "az"), "rad") | dict(units or {})
    channels = tuple(Channel(name=name, unit=names[name]) for name in columns)
    topic = Topic(name="t", time_s=TIME_S, channels=channels, values=np.stack(list(columns.values())))
    return FlightRecord(source=Source(name="rig.csv", format="CSV", sha256=""), topics=(topic,))


def driven(unit: str, rest: float, size: float) -> FlightRecord:
    columns = {"motor_3": rest + size * SWEEP, "motor_4": rest + size * SWEEP[::-1], "phi": ANGLE}
    return log(columns, {"motor_3": unit, "motor_4": unit})


@pytest.mark.parametrize(
    ("unit", "rest", "size"), [("V", 6.0, 0.6), ("us", 1500.0, 60.0), ("rad/s", 600.0, 50.0), ("1", 0.5, 0.05)]
)
def test_sweeps_of_a_pair_are_found_in_any_unit(unit: str, rest: float, size: float) -> None:
    record = driven(unit, rest, size)
    (found,) = rich_excitations(record, "roll")
    assert (found.kind, found.signal, found.origin) == ("sweep", "motor_3", "found")
    assert found.band_rad_s is not None
    assert 0.5 < found.band_rad_s[0] < 1.6
    assert found.band_rad_s[1] == pytest.approx(12.5, rel=0.1)
    assert not find_excitations(record, "pitch")


def test_a_sweep_counts_to_the_motor_that_was_swept_not_to_the_one_that_answers_it() -> None:
    # What answers the sweep of motor 4 by feedback follows it slowly: it fades with the frequency.
    frequency = 0.5 + 0.2 * TIME_S
    answer = 0.5 * SWEEP / (1.0 + (frequency / 3.0) ** 4)
    record = log(
        {"motor_3": 6.0 + answer, "motor_4": 6.0 + 0.6 * SWEEP, "phi": ANGLE},
        dict.fromkeys(("motor_3", "motor_4"), "V"),
    )
    (found,) = rich_excitations(record, "roll")
    assert found.signal == "motor_4"
    assert found.duration_s > 50.0


@pytest.mark.parametrize(("unit", "rest", "size"), [("V", 6.0, 0.01), ("us", 1500.0, 2.0), ("rad/s", 600.0, 1.0)])
def test_what_is_as_small_as_noise_is_no_sweep(unit: str, rest: float, size: float) -> None:
    assert not find_excitations(driven(unit, rest, size), "roll")


def test_a_bench_does_not_fly_and_says_what_it_is() -> None:
    record = driven("V", 6.0, 0.6)
    assert is_bench(record)
    with pytest.raises(InsufficientDataError, match=r"is a log of a bench .motor_3 and motor_4 in V, with phi."):
        airborne(record)
    assert airborne_by_thrust(record) is None
    assert [(finding.kind, finding.severity) for finding in not_flown(record)] == [("bench_log", "info")]


def test_volts_are_no_outputs_of_motors() -> None:
    record = driven("V", 6.0, 0.6)
    assert record.outputs == ()
    assert motor_limits(record).unknown


@pytest.mark.parametrize("other", ["az", "thrust_command", "roll_command", "down", "velocity_north", "p_setpoint"])
def test_what_something_that_flies_has_makes_no_bench(other: str) -> None:
    columns = {"motor_3": SWEEP, "phi": ANGLE, other: ANGLE}
    assert not is_bench(log(columns, {"motor_3": "V"}))


def test_shares_of_all_motors_may_be_of_a_flight() -> None:
    motors = {f"motor_{number}": 0.4 + 0.1 * SWEEP for number in (1, 2, 3, 4)}
    assert not is_bench(log({**motors, "phi": ANGLE}))
    assert is_bench(log({**motors, "motor_3_excitation": 0.1 * SWEEP, "phi": ANGLE}))
