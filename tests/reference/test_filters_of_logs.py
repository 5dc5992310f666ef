"""Filters by the noise of ordinary logs, with what is known of their vehicles."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.flights.gyro_noise import gyro_noise
from rotorid.loops.filter_choice import filter_sets


def test_the_third_harmonic_of_three_blades_needs_the_third_notch(unpacked: Callable[[str], Path]) -> None:
    """Its rotors turn 77 to 132 times a second, and the strongest vibration is the passage of the blades."""
    record = rotorid.read(unpacked("everyday/arducopter_462_log_5.bin.xz"), sandbox=False)
    noise = gyro_noise(record)
    assert noise.lines.rotor_hz is not None
    assert noise.lines.rotor_hz[1] == pytest.approx(131.6, abs=2.0)
    flown, *others = filter_sets(record, noise, {})
    alone = {
        one.values["INS_HNTCH_HMNCS"]: one.saves_over(flown)
        for one in others
        if len(one.changes) == 1 and "INS_HNTCH_HMNCS" in one.values
    }
    assert set(alone) == {1.0, 3.0, 7.0}
    assert alone[7.0].lower > alone[1.0].upper
    assert alone[7.0].lower > 50.0
    # The flown notch stays at 80 Hz, and the log cannot show what another one does where nothing is left.
    assert alone[1.0].value < 10.0


def test_freestyle_is_quiet_behind_its_filters(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("everyday/betaflight_431_freestyle.bbl.xz"), sandbox=False)
    flown, *others = filter_sets(record, gyro_noise(record), {})
    assert flown.rms < 0.01
    # Speeds are not logged: no change of the notches that follow them can be judged.
    assert not any(name.startswith("rpm_filter") for one in others for name in one.values)


def test_a_slow_log_says_what_to_set(unpacked: Callable[[str], Path]) -> None:
    record = rotorid.read(unpacked("everyday/px4_115_s500.ulg.xz"), sandbox=False)
    with pytest.raises(InsufficientDataError, match="logged at 47 Hz") as error:
        gyro_noise(record)
    assert "SDLOG_PROFILE" in error.value.remedy
