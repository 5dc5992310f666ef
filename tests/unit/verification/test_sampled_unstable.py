"""Unstable airframes: the right model passes though it diverges in open loop, a wrong one does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.unit.verification.s500_doublets import STOP_S, check, fly_doublet, later, parts, scaled

from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import Flight
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import Axis
from rotorid.vehicles import s500
from rotorid.verification.prediction import _ahead
from rotorid.verification.sampled import bounded_responses, bounded_states, sampled
from rotorid.verification.scores import rms
from rotorid.verification.verification import Verification, judged_horizon, poor_ahead, shortest_horizon, verdict

RATE_HZ = 200.0
AXES: tuple[Axis, ...] = ("pitch", "thrust", "roll", "yaw")

Wrong = Callable[[StateSpace], StateSpace]

# Rows and columns as in s500.longitudinal() and s500.lateral().
WRONG: dict[str, tuple[Axis, Wrong]] = {
    "M_pitch": ("pitch", lambda model: scaled(model, row=0, column=0, factor=1.3)),
    "M_u": ("pitch", lambda model: scaled(model, row=0, column=1, factor=-1.0, of="F")),
    "tau_pitch": ("pitch", lambda model: later(model, 0.05)),
    "L_roll": ("roll", lambda model: scaled(model, row=0, column=0, factor=1.3)),
    "L_v": ("roll", lambda model: scaled(model, row=0, column=2, factor=-1.0, of="F")),
    "tau_roll": ("roll", lambda model: later(model, 0.05)),
}


@pytest.fixture(scope="module")
def flights() -> dict[str, Flight]:
    return {axis: fly_doublet(axis) for axis in AXES}


@pytest.mark.parametrize("axis", AXES)
def test_the_right_model_passes(axis: Axis, flights: dict[str, Flight]) -> None:
    made = check(flights[axis], parts(axis)[2])
    assert made.growth_1_s == pytest.approx(parts(axis)[2].poles().real.max())
    assert verdict(made) == "good"
    # The bar for right models, of what the maneuver moved.
    assert max(made.scores[name].tic for name in made.moved) < 0.12
    horizon = judged_horizon(made)
    assert horizon is not None
    assert min(horizon.scores[name].skill for name in made.moved) > 0.5


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_model_is_poor(name: str, flights: dict[str, Flight]) -> None:
    axis, wrong = WRONG[name]
    made = check(flights[axis], wrong(parts(axis)[2]))
    assert verdict(made) == "poor"
    assert poor_ahead(made)


def test_thirty_percent_too_much_gain_passes_the_open_loop_alone(flights: dict[str, Flight]) -> None:
    """Why the prediction ahead judges: a fitted initial state holds an unstable model to the end of the maneuver."""
    made = check(flights["pitch"], WRONG["M_pitch"][1](s500.longitudinal()))
    assert max(scores.tic for scores in made.scores.values()) < 0.25
    assert made.ahead is not None
    assert max(scores.tic for scores in made.ahead.horizons[0].scores.values()) > 0.25


def test_predictions_of_the_right_model_hold_longer_than_an_error_takes_to_grow(flights: dict[str, Flight]) -> None:
    made, wrong = (check(flights["pitch"], m) for m in (s500.longitudinal(), WRONG["M_pitch"][1](s500.longitudinal())))
    assert made.ahead is not None
    assert wrong.ahead is not None
    assert min(made.ahead.holds_s.values()) > 1.0 / made.growth_1_s
    assert min(wrong.ahead.holds_s.values()) < 1.0 / made.growth_1_s


def test_an_open_loop_that_leaves_the_measurement_is_no_verdict(flights: dict[str, Flight]) -> None:
    made = check(flights["pitch"], s500.longitudinal())
    lost = replace(
        made,
        scores={name: replace(one, tic=0.6, nrmse_fit_percent=-50.0) for name, one in made.scores.items()},
    )
    assert verdict(lost) == "diverges"
    assert verdict(replace(lost, ahead=None)) == "poor"


def test_a_stable_model_is_judged_by_its_open_loop(flights: dict[str, Flight]) -> None:
    made = check(flights["pitch"], s500.longitudinal())
    assert judged_horizon(replace(made, growth_1_s=0.0)) is None


@pytest.mark.parametrize(("growth", "horizon"), [(0.0, 0.5), (1.0, 0.5), (3.0, 0.5), (6.0, 0.25)])
def test_the_horizon_shrinks_with_the_growth(growth: float, horizon: float) -> None:
    assert shortest_horizon(growth) == pytest.approx(horizon)


def test_j_rms_adds_up_degrees_and_feet(flights: dict[str, Flight]) -> None:
    made = check(flights["pitch"], s500.longitudinal())
    factor = np.array([180.0 / np.pi, 1 / 0.3048, 1 / 0.3048, 180.0 / np.pi, 1 / 0.3048, 1 / 0.3048])
    assert made.j_rms == pytest.approx(rms(factor[:, None] * (made.measured - made.predicted)), rel=1e-12)


class TestBounded:
    """Growing motions backward, decaying ones forward: the same equations, without the overflow."""

    u = np.cumsum(0.01 * np.random.default_rng(0).standard_normal((2, 400)), axis=1)

    def responses(self, model: StateSpace, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        made = bounded_responses(sampled(model, u, sample_rate_hz=RATE_HZ, before=u[:, 0]))
        return made.forced, made.free, made.biased

    @pytest.mark.parametrize("make", [s500.longitudinal, s500.lateral])
    def test_spans_every_solution(self, make: Callable[[], StateSpace]) -> None:
        model = make()
        x0, bias = np.array([0.1, 0.2, -0.3, 0.05]), np.array([0.1, 0.0, 0.2, 0.0])
        y = simulate_linear(model, self.u, sample_rate_hz=RATE_HZ, x0=x0, bias=bias, before=self.u[:, 0], hold="first")
        forced, free, biased = self.responses(model, self.u)
        left = (y - forced - np.tensordot(bias, biased, axes=1)).ravel()
        columns = free.reshape(len(free), -1).T
        explained = columns @ np.linalg.lstsq(columns, left, rcond=None)[0]
        # Forward, rounding grows with the unstable motion: by e^(2.9 * 2) in 2 s.
        assert np.abs(left - explained).max() < 1e-15 * np.exp(2.0 * 2.9) * 1e3 * np.abs(y).max()

    def test_a_record_of_two_minutes_stays_finite(self) -> None:
        """Forward, it would have grown by e^350."""
        u = np.tile(self.u, (1, 60))
        forced, free, biased = self.responses(s500.longitudinal(), u)
        assert max(np.abs(part).max() for part in (forced, free, biased)) < 1e6

    def test_a_late_output_shows_the_same_states_later(self) -> None:
        """Sensors of different delays, by whole samples here: each shows what an early one showed before."""
        model = s500.longitudinal()
        late = replace(model, output_delays_s=np.array([3.0, 0.0, 1.0, 0.0, 3.0, 0.0]) / RATE_HZ)
        start = 10
        early, shown = (
            bounded_responses(sampled(one, self.u, sample_rate_hz=RATE_HZ, before=self.u[:, 0]))
            for one in (model, late)
        )
        # Up to a free response that is common to all outputs.
        rows, lags = (0, 2, 4, 1), (3, 1, 3, 0)
        rest, columns = [], []
        for row, lag in zip(rows, lags, strict=True):
            until = self.u.shape[1] - lag
            rest.append(shown.forced[row, start + lag :] - early.forced[row, start:until])
            columns.append(early.free[:, row, start:until])
        a, b = np.concatenate(columns, axis=1).T, np.concatenate(rest)
        assert np.abs(b - a @ np.linalg.lstsq(a, b, rcond=None)[0]).max() < 1e-9

    def test_between_samples_the_error_falls_with_the_fourth_power(self) -> None:
        """A cubic through four states: halving the step divides the error by sixteen."""
        worst = []
        for rate_hz in (50.0, 100.0):
            time_s = np.arange(round(4.0 * rate_hz)) / rate_hz
            u = np.stack([0.1 * np.sin(5.0 * time_s) ** 4, 0.0 * time_s])
            model = replace(s500.lateral(), input_delays_s=np.zeros(2))
            lags = np.array([0.4 / rate_hz, 0.0, 0.0, 0.0, 0.0])
            shown = sampled(replace(model, output_delays_s=lags), u, sample_rate_hz=rate_hz, before=u[:, 0])
            exact = simulate_linear(model, u, sample_rate_hz=rate_hz, hold="first")
            later_u = replace(model, input_delays_s=np.full(2, lags[0]))
            late = simulate_linear(later_u, u, sample_rate_hz=rate_hz, hold="first")[0]
            states = _states(shown)
            assert np.abs(shown.outputs_of(states)[:, 1] - exact[1]).max() < 1e-9 * np.abs(exact[1]).max() + 1e-12
            worst.append(np.abs(shown.outputs_of(states)[:, 0] - late).max())
        assert worst[0] / worst[1] == pytest.approx(16.0, rel=0.4)


def _states(model: object) -> np.ndarray:
    """States from rest, forward."""
    from rotorid.verification.sampled import Sampled

    assert isinstance(model, Sampled)
    states = np.zeros(model.forcing.shape)
    for step in range(len(states) - 1):
        states[step + 1] = model.transition @ states[step] + model.forcing[step]
    return states


def test_what_moved_is_seen(flights: dict[str, Flight]) -> None:
    """A yaw doublet turns the S500, which its lateral model couples into everything; roll hardly turns it."""
    made: Verification = check(flights["yaw"], s500.lateral())
    assert "r" in made.moved
    assert made.time_s[-1] > STOP_S


class TestMoved:
    """What moves clearly more than before, within the band."""

    def moved(self, flight: Flight, *, shaken: float = 0.0, frequency_hz: float = 3.0) -> tuple[str, ...]:
        """What moved of a yaw doublet whose yaw rate swings all the time too, by a multiple of its largest."""
        swing = np.sin(2.0 * np.pi * frequency_hz * flight.time_s)
        rate = flight.columns["r"]
        columns = {**flight.columns, "r": rate + shaken * np.abs(rate).max() * swing}
        return check(replace(flight, columns=columns), s500.lateral()).moved

    def test_what_moves_all_the_time_was_not_moved(self, flights: dict[str, Flight]) -> None:
        assert "r" in self.moved(flights["yaw"])
        assert "r" not in self.moved(flights["yaw"], shaken=10.0)

    def test_vibration_above_the_band_does_not_hide_a_motion(self, flights: dict[str, Flight]) -> None:
        assert "r" in self.moved(flights["yaw"], shaken=10.0, frequency_hz=90.0)

    def test_without_quiet_time_all_count(self, flights: dict[str, Flight]) -> None:
        late = replace(flights["yaw"].maneuvers[0], start_s=0.2)
        assert check(replace(flights["yaw"], maneuvers=(late,)), s500.lateral()).moved == parts("yaw")[1]

    def test_nothing_moves_where_there_is_no_maneuver(self, flights: dict[str, Flight]) -> None:
        still = replace(flights["yaw"], columns={name: 0.0 * v for name, v in flights["yaw"].columns.items()})
        assert check(still, s500.lateral()).moved == ()


def test_predictions_ahead_are_those_simulated_from_every_restart() -> None:
    """One motion of the record serves all restarts; the sum of rounding is that of an unstable motion over 1 s."""
    rng = np.random.default_rng(1)
    model = replace(s500.longitudinal(), output_delays_s=np.array([0.0, 0.013, 0.0, 0.005, 0.0, 0.0]))
    u = np.cumsum(0.01 * rng.standard_normal((2, 500)), axis=1)
    made = sampled(model, u, sample_rate_hz=100.0, before=u[:, 0])
    target = made.outputs_of(_states(made)).T + made.direct.T
    target = target - target.mean(axis=1, keepdims=True) + 0.01 * rng.standard_normal(target.shape)
    window, restart, steps = 30, 200, 100
    ahead = _ahead(made, target, window, furthest=window + steps + 1)
    state = bounded_states(made)[restart] + ahead.start_offsets[restart]
    states = np.empty((made.lead + window + steps + 1, state.size))
    for step in range(len(states)):
        states[step] = state
        state = made.transition @ state + made.forcing[restart + step]
    end = made.outputs_of(states)[-1] + made.direct[restart + window + steps] + ahead.constant[window + steps]
    assert ahead.at(window + steps)[:, restart] == pytest.approx(end, rel=1e-9, abs=1e-9)


def test_gusts_are_not_taken_for_a_wrong_model() -> None:
    """In wind the right model may be undecided, and is hardly ever called poor; a wrong one is never called good."""
    right, wrong = [], []
    for seed in range(8):
        flight = fly_doublet("pitch", seed=seed, turbulence_m_s=0.06)
        right.append(verdict(check(flight, s500.longitudinal())))
        wrong.append(verdict(check(flight, WRONG["M_u"][1](s500.longitudinal()))))
    # One of twenty, for a few outputs that are not independent: 3 of 8 would come by chance less than once in 60.
    assert right.count("poor") < 3
    assert set(wrong) <= {"poor", "disturbed"}
    assert wrong.count("poor") > wrong.count("disturbed")
