"""The S500 under its own autopilot: the right airframe flies as it did, a wrong one shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.verification.s500_doublets import AMPLITUDES, PULSE_S, START_S, STOP_S, history, later, parts, scaled

from rotorid.data.record import Maneuver, TimeHistory
from rotorid.excitation.switching import doublet
from rotorid.models.controller import RateController
from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import SILENT, STEP_RATE_HZ, Excitation, Flight, fly
from rotorid.typing import Axis
from rotorid.vehicles import s500
from rotorid.verification.closed_loop import ALIKE_TIC, Loop, closed_loop, controller_alone, scored

AXES: tuple[Axis, ...] = ("roll", "pitch")
# The autopilot's own step and ours count the integral one step apart: an error of a step against the fastest motion of
# the loop, some 10 rad/s, of which the Theil coefficient is half.
STEP_TIC = 0.5 * 10.0 / STEP_RATE_HZ


def flight(axis: Axis) -> Flight:
    values = doublet(amplitude=AMPLITUDES[axis], pulse_s=PULSE_S, sample_rate_hz=STEP_RATE_HZ, trim_s=0.0)
    maneuver = Maneuver(axis=axis, kind="doublet", start_s=START_S, stop_s=STOP_S, origin="declared")
    part = Excitation(maneuver=maneuver, values=values, sample_rate_hz=STEP_RATE_HZ)
    calm = np.random.default_rng(0)
    return fly(s500.vehicle(), (part,), sample_rate_hz=STEP_RATE_HZ, turbulence_m_s=0.0, noise=SILENT, rng=calm)


@pytest.fixture(scope="module")
def flights() -> dict[Axis, Flight]:
    return {axis: flight(axis) for axis in AXES}


def cut(flown: Flight, axis: Axis) -> tuple[TimeHistory, Loop]:
    inputs, outputs, _ = parts(axis)
    start_s, stop_s = START_S - 0.5, STOP_S + 1.5
    inside = (flown.time_s >= start_s - 1e-9) & (flown.time_s <= stop_s + 1e-9)
    row, angle = ("roll", "pitch").index(axis), {"roll": "phi", "pitch": "theta"}[axis]
    gains = s500.vehicle().controller
    loop = Loop(
        command=f"{axis}_command",
        rate={"roll": "p", "pitch": "q"}[axis],
        controller=RateController(
            proportional_s=gains.rate_p[row], integral=gains.rate_i[row], angle_1_s=gains.angle_p[row]
        ),
        driven="angle",
        setpoint=flown.columns[f"{angle}_setpoint"][inside],
        excitation=flown.columns[f"{axis}_excitation"][inside],
    )
    return history(flown, (*inputs, *outputs), start_s, stop_s), loop


def tics(flown: Flight, axis: Axis, system: StateSpace | None = None) -> dict[str, float]:
    inputs, outputs, right = parts(axis)
    data, loop = cut(flown, axis)
    u = np.stack([data[name] for name in inputs])
    measured, predicted = closed_loop(
        system or right,
        u - u.mean(axis=1, keepdims=True),
        loops=[loop],
        input_names=inputs,
        output_names=outputs,
        measured=np.stack([data[name] for name in outputs]),
        commands=data[loop.command][None],
        filtered=np.asarray,
        sample_rate_hz=data.sample_rate_hz,
    )
    names = (*outputs, "command")
    return {name: scored(*pair).tic for name, *pair in zip(names, measured, predicted, strict=True)}


@pytest.mark.parametrize("axis", AXES)
def test_the_right_airframe_flies_as_it_did(axis: Axis, flights: dict[Axis, Flight]) -> None:
    assert max(tics(flights[axis], axis).values()) < STEP_TIC


@pytest.mark.parametrize("axis", AXES)
def test_a_wrong_gain_shows_in_the_command_more_than_in_the_rate(axis: Axis, flights: dict[Axis, Flight]) -> None:
    wrong = scaled(parts(axis)[2], row=0, column=0, factor=1.3)
    # The moment stands in the first row of both models.
    found = tics(flights[axis], axis, wrong)
    rate = found["p" if axis == "roll" else "q"]
    assert found["command"] > rate > 10.0 * STEP_TIC


def test_a_late_airframe_shows_in_the_acceleration_more_than_in_the_rate(flights: dict[Axis, Flight]) -> None:
    found = tics(flights["roll"], "roll", later(parts("roll")[2], 0.009))
    assert found["ay"] > found["p"] > 5.0 * STEP_TIC


def test_a_late_output_is_compared_late(flights: dict[Axis, Flight]) -> None:
    _, outputs, right = parts("roll")
    delays = np.array([0.02 if name == "ay" else 0.0 for name in outputs])
    found = tics(flights["roll"], "roll", replace(right, output_delays_s=delays))
    assert found["p"] < STEP_TIC
    assert found["ay"] > 10.0 * STEP_TIC


def test_an_unstable_airframe_can_be_flown_for_long(flights: dict[Axis, Flight]) -> None:
    assert parts("roll")[2].poles().real.max() > 1.0
    assert tics(flights["roll"], "roll")["v"] < STEP_TIC


class TestTheControllerAlone:
    """Whether gains are those that flew shows without any model of the airframe."""

    def tic(self, flown: Flight, **changed: float) -> float:
        data, loop = cut(flown, "roll")
        other = replace(loop, controller=replace(loop.controller, **changed))
        scores = controller_alone(
            other, data["p"], data["roll_command"], filtered=np.asarray, sample_rate_hz=data.sample_rate_hz
        )
        assert scores.alike == (scores.tic <= ALIKE_TIC)
        return scores.tic

    def test_right_gains_make_the_command(self, flights: dict[Axis, Flight]) -> None:
        assert self.tic(flights["roll"]) < STEP_TIC

    @pytest.mark.parametrize("wrong", [{"proportional_s": 0.12}, {"angle_1_s": 8.0}, {"delay_s": 0.08}])
    def test_wrong_ones_do_not(self, wrong: dict[str, float], flights: dict[Axis, Flight]) -> None:
        assert self.tic(flights["roll"], **wrong) > ALIKE_TIC
