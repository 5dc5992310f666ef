"""Paper 5 on its own records, as far as it reads them without fitting: starts, steps, thrust, couplings, yaw."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.data.record import Channel, TimeHistory
from rotorid.models.state_space import StateSpace
from rotorid.signal.kinematics import derivative, to_heading
from rotorid.signal.step_response import (
    CrossTerms,
    StepResponse,
    cross_terms,
    rise_time_bandwidth,
    step_responses,
    thrust_limit,
    thrust_over_weight,
)
from rotorid.simulation.linear import simulate_linear
from rotorid.simulation.predictor import StateEstimate, kalman_start, least_squares_start
from rotorid.typing import FloatArray
from rotorid.vehicles import bebop
from rotorid.verification.scores import nrmse_fit_percent

RECORDS = ("120935", "121028", "121250", "122633")
COMMANDS = tuple(command for command, _ in bebop.PAIRS)
OUTPUTS = tuple(response for _, response in bebop.PAIRS)
RATE_HZ = 1.0 / bebop.SIMULATED_SAMPLE_S
PRE_ROLL = 20
UNSURE_PERCENT = 0.06
"""The interval is known to 0.1 ms, which moves a score by up to 0.05; numbers are printed to 0.01."""
RAW = """
[clock]
time = { source = "Time_real" }
[channels.north]
source = "log_QuadStatesEstimated"
row = 0
unit = "m"
[channels.east]
source = "log_QuadStatesEstimated"
row = 1
unit = "m"
[channels.psi]
source = "log_QuadStatesEstimated"
row = 5
unit = "rad"
"""
"""Positions and heading before the authors turned them; y is to the left, so east and heading have one sign."""


def history(path: Path, mapping: Path, rate_hz: float) -> TimeHistory:
    """The samples as they are, on a clock of one rate; a channel that lost some has them by the nearest one."""
    first, *others = rotorid.read(path, mapping=mapping).topics
    values = [first.values]
    for topic in others:
        nearest = np.abs(first.time_s[:, None] - topic.time_s).argmin(axis=1)
        values.append(topic.values[:, nearest])
    return TimeHistory(
        values=np.concatenate(values),
        channels=(*first.channels, *(channel for topic in others for channel in topic.channels)),
        sample_rate_hz=rate_hz,
        start_s=float(first.time_s[0]),
    )


@pytest.fixture(scope="module")
def bebop_data(shared_data: Path) -> Path:
    folder = shared_data / "bebop"
    if not folder.is_dir():
        pytest.skip(f"no records of the Bebop at {folder}")
    return folder


def rows(history: TimeHistory, names: tuple[str, ...]) -> FloatArray:
    return np.stack([history[name] for name in names])


def filtered(system: StateSpace, u: FloatArray, y: FloatArray) -> StateEstimate:
    """From the authors' twenty samples of rest, with the unit covariances of their filter."""
    size = len(system.F)
    prior = StateEstimate(state=np.zeros(size), covariance=np.eye(size))
    return kalman_start(
        system,
        u[:, :PRE_ROLL],
        y[:, :PRE_ROLL],
        sample_rate_hz=RATE_HZ,
        output_std=np.ones(3),
        disturbance=RATE_HZ * np.eye(size),
        prior=prior,
    )


def estimated(system: StateSpace, u: FloatArray, y: FloatArray) -> StateEstimate:
    """From the record itself."""
    return least_squares_start(system, u[:, PRE_ROLL:], y[:, PRE_ROLL:], sample_rate_hz=RATE_HZ, output_std=np.ones(3))


START = {"filter": filtered, "estimate": estimated}


def fits(folder: Path, system: StateSpace, start: str) -> FloatArray:
    """Mean fit of the three channels on each record, percent."""
    found = []
    for name in RECORDS:
        record = history(folder / "sim" / f"{name}.mat", folder / "map.toml", RATE_HZ)
        u, y = rows(record, COMMANDS), rows(record, OUTPUTS)
        x0 = START[start](system, u, y).state
        predicted = simulate_linear(system, u[:, PRE_ROLL:], sample_rate_hz=RATE_HZ, x0=x0)
        scores = [nrmse_fit_percent(*pair) for pair in zip(y[:, PRE_ROLL:], predicted, strict=True)]
        found.append(float(np.mean(scores)))
    return np.array(found)


def one_sample_late() -> StateSpace:
    return replace(bebop.first_order_delay(), input_delays_s=np.full(3, bebop.SIMULATED_SAMPLE_S))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("system", "mean"),
    [(bebop.first_order(), 73.46), (one_sample_late(), 76.72)],
    ids=["first order", "with a delay of a sample"],
)
def test_published_first_order_scores_as_it_did(bebop_data: Path, system: StateSpace, mean: float) -> None:
    assert fits(bebop_data, system, "filter").mean() == pytest.approx(mean, abs=UNSURE_PERCENT)


def test_published_second_order_scores_as_it_did(bebop_data: Path) -> None:
    """Identified on the first record, scored on the others."""
    found = fits(bebop_data, bebop.second_order(), "filter")[1:]
    np.testing.assert_allclose(found, [83.57, 82.31, 82.69], atol=UNSURE_PERCENT)


@pytest.mark.slow
def test_published_third_order_scores_as_it_did(bebop_data: Path) -> None:
    assert fits(bebop_data, bebop.third_order(), "filter")[1:].mean() == pytest.approx(83.48, abs=UNSURE_PERCENT)


@pytest.mark.slow
@pytest.mark.parametrize("system", [bebop.second_order(), bebop.third_order()], ids=["second", "third"])
def test_an_estimated_start_beats_the_filtered_one(bebop_data: Path, system: StateSpace) -> None:
    """The rest in front of the records is the first sample twenty times over: nothing was flown there."""
    found = {start: fits(bebop_data, system, start) for start in START}
    assert (found["estimate"] > found["filter"]).all()
    assert (found["estimate"] - found["filter"]).mean() > 0.3


@pytest.fixture(scope="module")
def steps(bebop_data: Path) -> dict[str, list[StepResponse]]:
    """Answers to the steps of each channel, in order of time of day."""
    found: dict[str, list[StepResponse]] = {name: [] for name in OUTPUTS}
    for path in sorted((bebop_data / "step").glob("*.mat"), key=lambda path: path.stem[-6:]):
        record = history(path, bebop_data / "map.toml", 20.0)
        for command, response in bebop.PAIRS:
            if np.ptp(record[command]) > 0.01:
                found[response] += step_responses(record, command=command, response=response)
    return found


@pytest.mark.slow
def test_rise_time_of_pitch_is_the_published_one(steps: dict[str, list[StepResponse]]) -> None:
    """Table III has five steps and the data six; which are meant is not said. The first five are taken here."""
    mean, spread = bebop.RISE_TIME_S["theta"]
    found = rise_time_bandwidth(steps["theta"][:5])
    assert found.rise_s == pytest.approx(mean, abs=0.5 * spread)
    assert found.rise_std_s == pytest.approx(spread, rel=0.2)
    assert found.bandwidth_hz == pytest.approx(1.35, abs=0.28)


@pytest.mark.slow
def test_rise_time_of_climb_is_the_published_one_where_it_settles(steps: dict[str, list[StepResponse]]) -> None:
    settled = [step for step in steps["velocity_down"] if step.settled]
    assert 4 <= len(settled) < len(steps["velocity_down"])
    assert rise_time_bandwidth(settled).rise_s == pytest.approx(0.313, abs=2.0 * 0.025)


@pytest.mark.slow
def test_roll_is_not_as_slow_as_published(steps: dict[str, list[StepResponse]]) -> None:
    """0.410 ± 0.042 s is printed. Roll is as fast as pitch here, as the fitted models of the paper have it too."""
    roll, pitch = (rise_time_bandwidth(steps[name]) for name in ("phi", "theta"))
    assert roll.rise_s < 0.410 - 2.0 * 0.042
    assert abs(roll.rise_s - pitch.rise_s) < roll.rise_std_s


@pytest.mark.slow
def test_answers_are_late_when_commands_come_too_fast(bebop_data: Path, steps: dict[str, list[StepResponse]]) -> None:
    late = {}
    for path in (bebop_data / "command_rate").glob("*.mat"):
        rate = float(path.name.partition("Hz")[0])
        (step,) = step_responses(
            history(path, bebop_data / "map.toml", rate), command="theta_setpoint", response="theta"
        )
        late[rate] = step.half_s
    slow = np.array([value for rate, value in late.items() if rate <= 30.0])
    fast = np.array([value for rate, value in late.items() if rate >= 50.0])
    spread = float(np.std([step.half_s for step in steps["theta"]], ddof=1))
    assert fast.min() > slow.max()
    # One record for each rate: a difference is sure at 70 Hz alone.
    assert late[70.0] - slow.mean() > 4.0 * spread
    assert sorted(late.values())[-2] - slow.mean() < 2.0 * spread


@pytest.mark.parametrize("name", RECORDS)
def test_thrust_stood_at_no_limit(bebop_data: Path, name: str) -> None:
    ratio = thrust_over_weight(history(bebop_data / "ident" / f"{name}.mat", bebop_data / "map.toml", 20.0))
    found = thrust_limit(ratio, sample_rate_hz=20.0)
    assert not found.saturated
    assert 1.25 < found.highest < 1.4


def heading(bebop_data: Path, folder: Path, name: str) -> FloatArray:
    """The logged heading, whose angles turn over by pi together."""
    mapping = folder / "raw.toml"
    mapping.write_text(RAW)
    psi = history(bebop_data / name, mapping, 20.0)["psi"]
    turned = 0.5 * np.unwrap(2.0 * psi)
    return np.asarray(turned - np.pi * np.round(turned.mean() / np.pi))


def coupling(record: TimeHistory, output: str) -> CrossTerms:
    others = [command for command in COMMANDS if command != f"{output}_setpoint"]
    return cross_terms(record, output=output, own=f"{output}_setpoint", others=others, memory_s=0.6)


@pytest.mark.parametrize("name", ["121250", "122633"])
@pytest.mark.parametrize("output", ["phi", "theta"])
def test_dependence_of_roll_and_pitch_is_the_heading(bebop_data: Path, tmp_path: Path, name: str, output: str) -> None:
    """The authors saw none. It is there, and goes when the angles are turned by the heading like the velocities."""
    record = history(bebop_data / "unfiltered" / f"{name}.mat", bebop_data / "map.toml", 20.0)
    psi = heading(bebop_data, tmp_path, f"unfiltered/{name}.mat")
    assert 0.1 < psi.mean() < 0.12
    values = record.values.copy()
    phi, theta = (record.names.index(one) for one in ("phi", "theta"))
    values[phi] = np.cos(psi) * record["phi"] + np.sin(psi) * record["theta"]
    values[theta] = np.cos(psi) * record["theta"] - np.sin(psi) * record["phi"]
    before, after = coupling(record, output), coupling(replace(record, values=values), output)
    assert before.p_shifted < 0.01
    assert after.p_shifted > 0.05
    assert after.added_share < 0.5 * before.added_share
    assert after.own_share > before.own_share


@pytest.mark.parametrize("name", RECORDS)
def test_climb_does_not_depend_on_tilt(bebop_data: Path, name: str) -> None:
    record = history(bebop_data / "unfiltered" / f"{name}.mat", bebop_data / "map.toml", 20.0)
    assert coupling(record, "velocity_down").p_shifted > 0.05


@pytest.mark.slow
def test_derotation_takes_the_sideways_motion_out_of_roll_steps(bebop_data: Path, tmp_path: Path) -> None:
    """A roll step should move the vehicle sideways only."""
    before, after = [], []
    for path in sorted((bebop_data / "step").glob("20Hz_0_62*.mat")):
        psi = heading(bebop_data, tmp_path, f"step/{path.name}")
        raw = history(path, tmp_path / "raw.toml", 20.0)
        moved = TimeHistory(
            values=np.stack([*derivative(rows(raw, ("north", "east")), 20.0), psi]),
            channels=tuple(
                Channel(name=name, unit=unit)
                for name, unit in (("velocity_north", "m/s"), ("velocity_east", "m/s"), ("psi", "rad"))
            ),
            sample_rate_hz=20.0,
            start_s=0.0,
        )
        after_step = slice(49, None)
        before.append(float(np.sqrt(np.mean(moved["velocity_north"][after_step] ** 2))))
        after.append(float(np.sqrt(np.mean(to_heading(moved)["velocity_forward"][after_step] ** 2))))
    assert len(before) == 7
    shrunk = np.array(after) / np.array(before)
    # One of them moved 8 mm/s in all: there is nothing to take out.
    large = np.array(before) > 0.02
    assert large.sum() == 6
    assert (shrunk[large] < 1.0).all()
    # Most of it was heading.
    assert np.median(shrunk[large]) < 0.5


@pytest.mark.parametrize(
    ("name", "rate_hz", "drift_deg"),
    [("0_20Hz_log_09052019_121835", 20.0, (1.5, 4.0)), ("0_100Hz_log_09052019_121929", 100.0, (3.0, 6.0))],
)
def test_the_nose_drifts_in_hover(
    bebop_data: Path, tmp_path: Path, name: str, rate_hz: float, drift_deg: tuple[float, float]
) -> None:
    mapping = tmp_path / "hover.toml"
    mapping.write_text(
        '[clock]\ntime = { source = "Time_real" }\n[channels.psi]\nsource = "psi"\nunit = "rad"\n'
        '[channels.down]\nsource = "z"\nunit = "m"\nscale = -1.0\n'
    )
    hover = history(bebop_data / "yaw_drift" / f"{name}.mat", mapping, rate_hz)
    flying = hover["down"] < -0.3
    assert drift_deg[0] < np.degrees(np.ptp(hover["psi"][flying])) < drift_deg[1]
