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


def test_a_loop_that_leaves_all_numbers_behind_is_as_wrong_as_can_be(flights: dict[Axis, Flight]) -> None:
    wild = scaled(parts("roll")[2], row=0, column=0, factor=-1e4)
    assert not tics(flights["roll"], "roll", wild)["p"] < 0.9


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


DAMPING_1_S, GAIN, HOLD = 2.0, 80.0, 0.1
FINE = 40
"""Steps of the reference for each millisecond."""


def one_rate(input_delay_s: float = 0.0) -> StateSpace:
    one = np.eye(1)
    return StateSpace(
        M=one,
        F=-DAMPING_1_S * one,
        G=GAIN * one,
        H0=one,
        H1=0.0 * one,
        input_delays_s=np.array([input_delay_s]),
        output_delays_s=np.zeros(1),
    )


def flown_exactly(late_s: float, setpoint: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rate and command of a proportional loop around a rate, all of its delay in one place, in small steps."""
    steps, late = (setpoint.size - 1) * FINE, round(late_s * 1000.0 * FINE)
    asked = np.interp(np.arange(steps + 1) / FINE, np.arange(setpoint.size), setpoint).tolist()
    step_s = 1e-3 / FINE
    rate, keep = [0.0] * (steps + 1), float(np.exp(-DAMPING_1_S * step_s))
    for k in range(steps):
        seen = rate[k - late] if k >= late else 0.0
        command = HOLD * ((asked[k - late] if k >= late else 0.0) - seen)
        rate[k + 1] = keep * rate[k] + GAIN / DAMPING_1_S * (1.0 - keep) * command
    # The command as it is given: the rate is read here and now, and all of the delay is behind.
    exact = np.array(rate)[::FINE]
    return exact, HOLD * (setpoint - exact)


def misses(exact: tuple[np.ndarray, np.ndarray], setpoint: np.ndarray, input_delay_s: float, delay_s: float) -> float:
    """Rms of what a loop misses of a rate, over the rms of the rate."""
    rate, command = exact
    loop = Loop(
        command="roll_command",
        rate="p",
        controller=RateController(proportional_s=HOLD, delay_s=delay_s),
        driven="rate",
        setpoint=setpoint,
        excitation=np.zeros(setpoint.size),
    )
    measured, predicted = closed_loop(
        one_rate(input_delay_s),
        command[None],
        loops=[loop],
        input_names=("roll_command",),
        output_names=("p",),
        measured=rate[None],
        commands=command[None],
        filtered=np.asarray,
        sample_rate_hz=1000.0,
    )
    return float(np.sqrt(np.mean((measured[0] - predicted[0]) ** 2) / np.mean(rate**2)))


class TestDelaysInTheLoop:
    """Delays of airframe and controller count as fractions of a step, and none is less than a step."""

    setpoint = np.repeat([0.0, 1.0, -1.0, 0.5, 0.0], 200)

    @pytest.mark.parametrize("late_s", [1.5e-3, 2.25e-3, 3.75e-3])
    def test_a_part_of_a_step_behind_the_command_counts(self, late_s: float) -> None:
        exact = flown_exactly(late_s, self.setpoint)
        right, whole = (misses(exact, self.setpoint, each, 0.0) for each in (late_s, np.floor(late_s * 1e3) / 1e3))
        assert right < 0.2 * whole

    @pytest.mark.parametrize("part_s", [0.25e-3, 0.5e-3, 0.75e-3])
    def test_a_part_of_a_step_in_what_the_controller_reads_counts(self, part_s: float) -> None:
        late, sooner, whole = (self.predicted(2e-3, delay_s) for delay_s in (1e-3 + part_s, 1e-3, 2e-3))
        # Reading between two steps is reading the mean of both, to the order of a step squared.
        between = sooner + part_s / 1e-3 * (whole - sooner)
        assert np.abs(late - between).max() < 0.1 * np.abs(whole - sooner).max()

    def test_less_than_a_step_of_delay_is_a_step(self) -> None:
        none, half, one, two = (self.predicted(delay_s, 0.0) for delay_s in (0.0, 0.5e-3, 1e-3, 2e-3))
        np.testing.assert_allclose(none, one, atol=1e-12)
        np.testing.assert_allclose(half, one, atol=1e-12)
        assert np.abs(two - one).max() > 1e-3
        # The loop of a step's delay, by hand.
        assert misses(flown_exactly(1e-3, self.setpoint), self.setpoint, 0.0, 0.0) < 5e-3

    def predicted(self, input_delay_s: float, delay_s: float) -> np.ndarray:
        """The forced rate, which no adjustment to a measurement changes: nothing is measured but rest."""
        loop = Loop(
            command="roll_command",
            rate="p",
            controller=RateController(proportional_s=HOLD, delay_s=delay_s),
            driven="rate",
            setpoint=self.setpoint,
            excitation=np.zeros(self.setpoint.size),
        )
        exact = flown_exactly(2e-3, self.setpoint)
        _, predicted = closed_loop(
            one_rate(input_delay_s),
            exact[1][None],
            loops=[loop],
            input_names=("roll_command",),
            output_names=("p",),
            measured=exact[0][None],
            commands=exact[1][None],
            filtered=np.asarray,
            sample_rate_hz=1000.0,
        )
        return np.asarray(predicted[0])

    def test_an_output_that_is_late_by_a_part_of_a_step_is_compared_so(self) -> None:
        exact = flown_exactly(2e-3, self.setpoint)
        loop = Loop(
            command="roll_command",
            rate="p",
            controller=RateController(proportional_s=HOLD),
            driven="rate",
            setpoint=self.setpoint,
            excitation=np.zeros(self.setpoint.size),
        )
        late = []
        for delay_s in (3.0e-3, 3.3e-3, 4.0e-3):
            both = replace(
                one_rate(2e-3), H0=np.ones((2, 1)), H1=np.zeros((2, 1)), output_delays_s=np.array([0.0, delay_s])
            )
            _, predicted = closed_loop(
                both,
                exact[1][None],
                loops=[loop],
                input_names=("roll_command",),
                output_names=("p", "late"),
                measured=np.stack([exact[0], exact[0]]),
                commands=exact[1][None],
                filtered=lambda rows: rows - rows.mean(axis=1, keepdims=True),
                sample_rate_hz=1000.0,
            )
            late.append(predicted[1])
        between = late[0] + 0.3 * (late[2] - late[0])
        assert np.abs(late[1] - between).max() < 0.1 * np.abs(late[2] - late[0]).max()
