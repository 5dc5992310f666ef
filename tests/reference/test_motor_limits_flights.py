"""Motors at a limit in real flights: every command states the same share, and it is the right one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.limit_callers import CALLERS

import rotorid
from rotorid.proposing.flown_gains import require_room
from rotorid.signal.motors import motor_limits

Read = Callable[[str], rotorid.FlightRecord]

SHARES = {
    "px4_sitl/verify.ulg.xz": (0.0, 0.0, 0.0),
    "ardupilot_sitl/x_calm_verify.BIN.xz": (0.0, 0.0, 0.0),
    "real_stacks/ap_x_wind_limit_cycle.BIN.xz": (0.980, 0.0077, 0.980),
    "real_stacks/ap_x_wind_ordinary_hard.BIN.xz": (0.986, 0.0044, 0.986),
    "real_stacks/ap_x_wind_ordinary_soft.BIN.xz": (0.0, 0.0, 0.0),
    "ardupilot/beast_0036.BIN": (0.0, 0.0, 0.0),
    "ardupilot/erle_brain3.BIN": (0.0190, 0.0, 0.0004),
    "betaflight/smooth_tune.BBL": (0.0143, 0.0002, 0.0006),
    "crazyflie/log10": (0.0504, 0.0, 0.0015),
    "everyday/betaflight_431_freestyle.bbl.xz": (0.3145, 0.0207, 0.0137),
    "everyday/betaflight_damaged_test_log.BFL.xz": (0.1262, 0.0630, 0.0789),
    "everyday/arducopter_321_1.BIN.xz": (0.0710, 0.0628, 0.0625),
    "everyday/arducopter_462_log_5.bin.xz": (0.0548, 0.0, 0.0095),
    "everyday/px4_115_s500.ulg.xz": (0.0, 0.0, 0.0),
    "field/maik_00000003.BIN": (0.219, 0.199, 0.164),
}
"""Log to the share of the flight with a motor at a limit, at its upper end, and at one that thrust does not explain.

Counted by hand from the outputs, from lift-off to touch-down: within one step of a pulse of the ends that the
parameters of the log give. The right answer for the limit cycles is 98 and 98.8 %; freestyle chops the throttle for
28 % of the flight, and the tune at its end, between bounces. The beast loses control at 369.2 s, before any motor is at
a limit for long: what follows is no flight."""

STUDIED = frozenset(
    {
        "ardupilot_sitl/x_calm_verify.BIN.xz",
        "real_stacks/ap_x_wind_ordinary_hard.BIN.xz",
        "real_stacks/ap_x_wind_ordinary_soft.BIN.xz",
        "everyday/betaflight_431_freestyle.bbl.xz",
        "everyday/arducopter_462_log_5.bin.xz",
        "everyday/px4_115_s500.ulg.xz",
    }
)
"""Logs of autopilots and shares that others have too: the studies look at them."""

CYCLES = [name for name in SHARES if "limit_cycle" in name or "hard" in name]
SILENT = [name for name in SHARES if SHARES[name][0] < 1e-3]


@pytest.fixture(scope="module")
def read_log(unpacked: Callable[[str], Path]) -> Read:
    records: dict[str, rotorid.FlightRecord] = {}

    def log(name: str) -> rotorid.FlightRecord:
        if name not in records:
            records.clear()
            records[name] = rotorid.read(unpacked(name), sandbox=False)
        return records[name]

    return log


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in STUDIED else name for name in SHARES]
)
def test_every_command_states_the_same_share(read_log: Read, name: str) -> None:
    record = read_log(name)
    limits = motor_limits(record)
    share, upper, loop = SHARES[name]
    assert (limits.share, limits.upper_share) == pytest.approx((share, upper), abs=6e-4)
    assert limits.of(limits.by_loop) == pytest.approx(loop, abs=6e-4)
    assert sum(limits.causes.values()) == pytest.approx(limits.share)
    known = {"share": limits.share, "upper_share": limits.upper_share, "lower_share": limits.lower_share}
    stated = {caller: ask(record) for caller, ask in CALLERS.items()}
    for caller, shares in stated.items():
        assert shares == pytest.approx({one: known[one] for one in shares}, abs=1e-9), caller
    if name not in SILENT:
        assert all(stated[caller] for caller in ("inspect", "identify, motors", "review, motors"))


@pytest.mark.parametrize("name", CYCLES)
def test_a_limit_cycle_pins_its_motors_whatever_the_log_says_of_their_range(read_log: Read, name: str) -> None:
    record = read_log(name)
    without = {key: value for key, value in record.parameters.items() if not key.startswith("MOT_")}
    piled = motor_limits(replace(record, parameters=without))
    assert (piled.unknown, piled.share) == ("", pytest.approx(motor_limits(record).share, abs=0.005))
    with pytest.raises(rotorid.InsufficientDataError, match="oscillate"):
        require_room(record)


def test_chopped_throttle_is_no_reason_to_refuse_a_tune(read_log: Read) -> None:
    """Its plant is the right one: L_roll of the freestyle is 1190 where 1150 is known."""
    assert require_room(read_log("everyday/betaflight_431_freestyle.bbl.xz")) == []


def test_a_vehicle_that_never_flew_is_not_at_its_limits(read_log: Read) -> None:
    (finding,) = require_room(read_log("everyday/arducopter_462_log_4.bin.xz"))
    assert finding.kind == "room_not_checked"
