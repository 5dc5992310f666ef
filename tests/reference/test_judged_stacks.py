"""Gains that real autopilots flew, judged from another flight: as measured later, as on the exact plant, or refused."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.proposing.axis import KnownAxis, known_axis
from rotorid.proposing.judging import AxisJudgment, JudgedGains, judge_gains
from rotorid.tuning import judged, read_gains
from rotorid.tuning.loops import quantities
from rotorid.typing import Axis, ComplexArray, FloatArray

Response = Callable[[FloatArray], ComplexArray]
Known = Mapping[Axis, KnownAxis]
FIGURES = ("sensitivity_peak", "crossover_rad_s", "phase_margin_deg")


def copter(omega: FloatArray) -> ComplexArray:
    """ArduPilot's simulated X quadrotor in wind, exactly."""
    return np.asarray(437.2 / (1j * omega + 2.15) * np.exp(-0.0025j * omega))


def sih(omega: FloatArray) -> ComplexArray:
    """PX4's simulated quadrotor, exactly."""
    return np.asarray(113.1 / ((0.048j * omega + 1.0) * (1j * omega + 1.0)) * np.exp(-0.0053j * omega))


def known(place: Path) -> Known:
    record = rotorid.read(place)
    axes: tuple[Axis, ...] = ("roll", "pitch")
    return {axis: known_axis(axis, [], [record], filters={}, findings=[], draws=200, seed=0) for axis in axes}


@pytest.fixture(scope="module")
def ardupilot(shared_data: Path) -> Known:
    """A flight with soft gains, 0.3 to 30 Hz."""
    return known(shared_data / "real_stacks/ap_x_wind_soft_wide.BIN.xz")


@pytest.fixture(scope="module")
def px4(shared_data: Path) -> Known:
    return known(shared_data / "real_stacks/px4_sih_offboard_plan.ulg.xz")


def judge(text: str, axes: Known) -> JudgedGains:
    return judge_gains(read_gains(text, name="gains.txt"), axes, {})


def assert_inside(found: AxisJudgment, values: Mapping[str, float]) -> None:
    """Whether figures of the whole loop are inside of what was foretold."""
    foretold = quantities(found.judged.whole)
    for name, value in values.items():
        assert foretold[name].lower < value < foretold[name].upper, (name, value, foretold[name])


def assert_as_exact(found: AxisJudgment, plant: Response) -> float:
    """M_s of the whole loop on the exact plant, which has to be inside of what was foretold, as its other figures."""
    exact = judged(
        found.parts, plant(found.parts.omega_rad_s)[None], found.judged.gains, from_rad_s=found.plant.known_from_rad_s
    ).whole
    peak = float(exact.sensitivity_peak[0])
    margin_deg = float(np.degrees(exact.phase_margin_rad[0]))
    assert_inside(found, dict(zip(FIGURES, (peak, float(exact.crossover_rad_s[0]), margin_deg), strict=True)))
    return peak


def test_the_end_of_ardupilots_autotune_is_not_to_be_flown_and_what_to_lower_is_said(ardupilot: Known) -> None:
    """After 305 to 329 s of AUTOTUNE on this vehicle."""
    found = judge("roll: P=.117 I=.117 D=.0006 A=34\npitch: P=.111 I=.111 D=.0005 A=36", ardupilot)
    assert found.verdict == "do_not_fly"
    for axis, short in (("roll", "RLL"), ("pitch", "PIT")):
        one = found.axes[axis]  # type: ignore[index]
        assert one.verdict == "do_not_fly"
        assert 2.6 < assert_as_exact(one, copter) < 2.8
        assert set(one.lower) == {f"ATC_RAT_{short}_P", f"ATC_RAT_{short}_D"}
        lowered = {name: after for name, (_, after) in one.parameters.items()} | dict(one.lower)
        again = judge("\n".join(f"{name},{value}" for name, value in lowered.items()), ardupilot)
        assert again.axes[axis].found.flies  # type: ignore[index]


def test_the_end_of_px4s_autotune_is_at_the_limit(px4: Known) -> None:
    found = judge("roll: P=.139 I=.187 D=0 A=6.5\npitch: P=.157 I=.202 D=.0003 A=6.1", px4)
    roll, pitch = found.axes["roll"], found.axes["pitch"]
    assert assert_as_exact(roll, sih) == pytest.approx(2.35, abs=0.02)
    assert assert_as_exact(pitch, sih) == pytest.approx(2.20, abs=0.02)
    assert (roll.verdict, pitch.verdict) == ("do_not_fly", "gently")
    assert set(roll.lower) == {"MC_ROLL_P"}
    assert roll.lower["MC_ROLL_P"] == pytest.approx(5.85)


def test_gains_of_another_flight_have_there_the_margins_that_this_one_foretells(
    ardupilot: Known, shared_data: Path
) -> None:
    """Measured there by the injection at the mixer, without model and gains."""
    flown = rotorid.read(shared_data / "real_stacks/ap_x_wind_soft_tuned_card_flight.BIN.xz").parameters
    names = [f"ATC_RAT_{axis}_{letter}" for axis in ("RLL", "PIT") for letter in "PID"]
    names += ["ATC_ANG_RLL_P", "ATC_ANG_PIT_P"]
    found = judge("\n".join(f"{name},{flown[name]:.9g}" for name in names), ardupilot)
    assert found.verdict == "fly"
    assert_inside(found.axes["roll"], dict(zip(FIGURES, (1.25, 16.2, 47.0), strict=True)))
    assert_inside(found.axes["pitch"], dict(zip(FIGURES, (1.51, 32.5, 49.0), strict=True)))


@pytest.mark.parametrize(
    ("gains", "measured"),
    [
        ("P=.0845 I=.816 D=.00036 A=6", (1.66, 40.4, 51.0)),
        ("P=.0789 I=.613 D=.00048 A=12", (1.66,)),
    ],
    ids=["first step", "second step"],
)
def test_both_steps_of_a_proposal_flew_as_foretold(ardupilot: Known, gains: str, measured: tuple[float, ...]) -> None:
    found = judge(f"roll: {gains}\npitch: {gains}", ardupilot)
    assert found.verdict == "fly"
    for one in found.axes.values():
        assert_inside(one, dict(zip(FIGURES, measured, strict=False)))
        assert_as_exact(one, copter)


def test_gains_that_flew_a_limit_cycle_are_refused_beforehand(ardupilot: Known) -> None:
    """They shook at 22.9 Hz, with a motor at a limit for 98.8 % of the time."""
    found = judge("roll: P=.216 I=.216 D=.00576 A=8\npitch: P=.216 I=.216 D=.00576 A=8", ardupilot)
    for one in found.axes.values():
        assert one.verdict == "do_not_fly"
        assert one.found.unstable > 0.5
        # Saturation makes a limit cycle slower than the linear loop.
        assert 22.9 < one.found.breaking.omega_rad_s / (2.0 * np.pi) < 32.0
