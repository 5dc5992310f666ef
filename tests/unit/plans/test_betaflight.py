from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
from tests.unit.report.plan_sample import chirp, facts, step

from rotorid.data.flight_plan import FlightPlan, PlannedInput
from rotorid.errors import UsageError
from rotorid.plans.betaflight import betaflight_files
from rotorid.typing import Axis


def planned(axis: Axis = "roll", **changes: Any) -> PlannedInput:
    settings: dict[str, Any] = {
        "entry": "rate_setpoint",
        "amplitude": math.radians(200.0),
        "band_hz": (0.5, 60.0),
        "duration_s": 20.0,
        "constant_s": 0.0,
        "fade_in_s": 0.0,
        "fade_out_s": 0.0,
    }
    return chirp(axis, **(settings | changes))


def lines(*inputs: PlannedInput) -> dict[str, str]:
    text = betaflight_files(FlightPlan(name="five inch", inputs=inputs), facts("Betaflight"))["betaflight-cli.txt"]
    commands = [line for line in text.splitlines() if line and not line.startswith("#")]
    assert commands[-1] == "save"
    found = {}
    for line in commands[:-1]:
        match = re.fullmatch(r"set (\w+) = (\S+)", line)
        assert match, line
        found[match[1]] = match[2]
    return found


def test_three_axes_have_their_own_units() -> None:
    found = lines(
        planned("roll"), planned("pitch", start_s=30.0), planned("yaw", start_s=60.0, amplitude=math.radians(150.0))
    )
    assert {name: int(found[name]) for name in found if name.startswith("chirp")} == {
        "chirp_frequency_start_deci_hz": 5,
        "chirp_frequency_end_deci_hz": 600,
        "chirp_time_seconds": 20,
        "chirp_amplitude_roll": 200,
        "chirp_amplitude_pitch": 200,
        "chirp_amplitude_yaw": 150,
        "chirp_lag_freq_hz": 30,
        "chirp_lead_freq_hz": 30,
    }
    assert found["debug_mode"] == "CHIRP"
    assert found["blackbox_disable_debug"] == "OFF"


def test_an_axis_that_is_not_planned_stands_still() -> None:
    found = lines(planned("pitch"))
    assert [found[f"chirp_amplitude_{axis}"] for axis in ("roll", "pitch", "yaw")] == ["0", "200", "0"]


def test_the_lines_make_the_frequency_of_the_planned_sweep() -> None:
    """Betaflight's law, f0 (f1/f0)^(t/T), read back from the lines, against the plan's own zero crossings."""
    sweep = planned("roll", sample_rate_hz=4000.0)
    found = lines(sweep)
    start_hz = int(found["chirp_frequency_start_deci_hz"]) / 10.0
    end_hz = int(found["chirp_frequency_end_deci_hz"]) / 10.0
    duration_s = float(found["chirp_time_seconds"])
    time_s = np.arange(sweep.values.size) / sweep.sample_rate_hz
    growth = math.log(end_hz / start_hz) / duration_s
    # Betaflight's excitation is the cosine of the phase whose sine the plan has.
    phase = 2.0 * math.pi * start_hz / growth * np.expm1(growth * time_s)
    assert math.radians(int(found["chirp_amplitude_roll"])) * np.sin(phase) == pytest.approx(sweep.values, abs=1e-9)


def test_steps_beside_the_sweeps_are_left_to_the_pilot() -> None:
    plan = FlightPlan(name="both", inputs=(planned("roll"), step("pitch", start_s=30.0)))
    text = betaflight_files(plan, facts("Betaflight"))["betaflight-cli.txt"]
    assert "Fly by hand: doublet on pitch." in text
    assert "set chirp_amplitude_pitch = 0" in text


def test_zeros_around_a_sweep_are_no_part_of_its_duration() -> None:
    assert lines(planned("roll", trim_s=3.0))["chirp_time_seconds"] == "20"


@pytest.mark.parametrize(
    ("inputs", "words"),
    [
        ((planned("thrust"),), "Betaflight cannot fly"),
        ((planned("roll", entry="stick"),), "no files for test inputs at the sticks"),
        ((planned("roll", entry="command"),), "rate set-points"),
        ((step("roll", entry="rate_setpoint"),), "logarithmic sweeps"),
        ((planned("pitch"), planned("roll", start_s=30.0)), "order roll, pitch, yaw"),
        ((planned("roll"), planned("pitch", start_s=30.0, band_hz=(1.0, 60.0))), "the same band and duration"),
        ((planned("roll", band_hz=(0.123, 60.0)),), "tenths of a hertz"),
        ((planned("roll", duration_s=300.0),), "duration"),
        ((planned("roll", amplitude=math.radians(600.0)),), "amplitude of roll"),
    ],
)
def test_what_the_generator_cannot_fly_is_refused(inputs: tuple[PlannedInput, ...], words: str) -> None:
    with pytest.raises(UsageError, match=words):
        lines(*inputs)
