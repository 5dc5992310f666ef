"""Plans that the real ArduPilot and PX4 flew: models and loops are those of the simulated vehicles behind them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.flights.whole_flights import flown
from rotorid.proposing import TuningProposal, tune
from rotorid.reviewing.margins import margins
from rotorid.signal.excitations import find_excitations, rich_excitations, verifying_excitations
from rotorid.typing import Axis, FloatArray

CARD, TUNED, WIDE = (f"ap_x_wind_soft_{name}.BIN.xz" for name in ("card_flight", "tuned_card_flight", "wide"))
GUIDED, OFFBOARD = "ap_x_guided_multisine.BIN.xz", "px4_sih_offboard_plan.ulg.xz"
GAIN = {"roll": "L_roll", "pitch": "M_pitch"}
AXES: tuple[Axis, ...] = ("roll", "pitch")

K_RAD_S2 = (437.2, 440.0)
"""Both axes: the frame's own value, and what wind makes of it."""

LOOP_S = 0.0025
"""The injection enters one loop of the autopilot after its stamp."""


def _contains(draws: FloatArray, truth: float, rounding: float) -> None:
    """The interval of 95 % of some draws contains a value that is known to so much."""
    low, high = np.quantile(draws, [0.025, 0.975])
    assert low - rounding <= truth <= high + rounding


@cache
def _log(folder: Path, name: str) -> rotorid.FlightRecord:
    return rotorid.read(folder / "real_stacks" / name)


@cache
def _model(folder: Path, name: str, axis: Axis) -> rotorid.IdentifiedModel:
    return rotorid.identify(_log(folder, name), f"rate.{axis}")


@cache
def _tuned(folder: Path, name: str) -> TuningProposal:
    return tune([_model(folder, name, axis) for axis in AXES], _log(folder, name), axes=AXES)


@pytest.fixture
def log(shared_data: Path) -> Callable[[str], rotorid.FlightRecord]:
    return lambda name: _log(shared_data, name)


@pytest.fixture
def model(shared_data: Path) -> Callable[[str, Axis], rotorid.IdentifiedModel]:
    return lambda name, axis: _model(shared_data, name, axis)


@pytest.fixture
def tuned(shared_data: Path) -> Callable[[str], TuningProposal]:
    return lambda name: _tuned(shared_data, name)


@pytest.mark.parametrize("name", [CARD, TUNED, WIDE])
@pytest.mark.parametrize("axis", AXES)
def test_only_what_the_log_declares_is_fitted(
    name: str, axis: Axis, log: Callable[[str], rotorid.FlightRecord]
) -> None:
    """The card ends with doublets by hand and a landing, against wind: neither is a random binary signal."""
    flight = log(name)
    (sweep,) = rich_excitations(flight, axis)
    assert (sweep.kind, sweep.origin, sweep.signal) == ("sweep", "declared", f"{axis}_excitation")
    kinds = {maneuver.kind for maneuver in verifying_excitations(flight, axis)}
    assert kinds <= {"doublet", "multistep"}


@pytest.mark.parametrize("name", [CARD, TUNED, WIDE])
@pytest.mark.parametrize("axis", AXES)
def test_the_gain_is_that_of_the_frame(
    name: str,
    axis: Axis,
    log: Callable[[str], rotorid.FlightRecord],
    model: Callable[[str, Axis], rotorid.IdentifiedModel],
) -> None:
    found = model(name, axis)
    gain, delay = found.parameters[GAIN[axis]], found.parameters[f"tau_{axis}"]
    assert gain.std is not None
    assert delay.std is not None
    assert gain.std < 3.0
    assert K_RAD_S2[0] - 2.0 * gain.std < gain.value < K_RAD_S2[1] + 2.0 * gain.std
    assert delay.std < 0.0015
    assert abs(delay.value - LOOP_S) < 2.0 * delay.std
    # What the sweep excited is what is fitted.
    assert found.provenance.instruments == (f"{axis}_excitation",)
    swept, used = rich_excitations(log(name), axis)[0].band_rad_s, found.band_rad_s
    assert swept is not None
    assert used is not None
    assert swept[0] <= used[0] < used[1] <= swept[1]


def test_gains_of_the_card_are_those_of_its_vehicle_on_both_axes(tuned: Callable[[str], TuningProposal]) -> None:
    found = tuned(CARD)
    for axis, stem in (("roll", "RLL"), ("pitch", "PIT")):
        proposed = {name: found.axes[axis].parameters[f"ATC_RAT_{stem}_{name}"][1] for name in "PID"}  # type: ignore[index]
        assert proposed["P"] == pytest.approx(0.070, rel=0.05)
        assert proposed["I"] == pytest.approx(0.67, rel=0.05)
        assert proposed["D"] == pytest.approx(0.0002, rel=0.1)


# Whole loop by injection: its peak sensitivity, crossover and phase margin.
FLOWN = {
    (CARD, "roll"): (1.89, None, 78.0),
    (CARD, "pitch"): (1.89, None, 78.0),
    (TUNED, "roll"): (1.25, 16.2, 47.0),
    (TUNED, "pitch"): (1.51, 32.5, 49.0),
    (WIDE, "roll"): (1.88, 61.0, 78.0),
    (WIDE, "pitch"): (1.88, 61.0, 78.0),
}


@pytest.mark.parametrize("name", [CARD, TUNED, WIDE])
def test_intervals_of_the_flown_loop_contain_what_was_flown(name: str, tuned: Callable[[str], TuningProposal]) -> None:
    found = tuned(name)
    for axis in AXES:
        whole, (peak, crossover, margin) = found.axes[axis].proposal.flown.whole, FLOWN[name, axis]
        _contains(whole.sensitivity_peak, peak, 0.01)
        _contains(np.degrees(whole.phase_margin_rad), margin, 0.5)
        if crossover is not None:
            _contains(whole.crossover_rad_s, crossover, 0.1)
        if name == WIDE:
            assert found.axes[axis].parameters[f"ATC_RAT_{'RLL' if axis == 'roll' else 'PIT'}_P"][1] == pytest.approx(
                0.0845, rel=0.03
            )
            assert np.median(found.axes[axis].proposal.proposed.whole.sensitivity_peak) == pytest.approx(1.66, abs=0.05)


def test_the_multisine_is_found_in_the_set_points_that_flew(
    log: Callable[[str], rotorid.FlightRecord], model: Callable[[str, Axis], rotorid.IdentifiedModel]
) -> None:
    """The autopilot smooths what it is asked for, so that two periods of 20 s are alike in part only."""
    for axis, signal in (("roll", "phi_setpoint"), ("pitch", "theta_setpoint")):
        (found,) = rich_excitations(log(GUIDED), axis)  # type: ignore[arg-type]
        assert (found.kind, found.origin, found.signal) == ("multisine", "declared", signal)
        assert 75.3 < found.start_s < 82.0
        assert 115.0 < found.stop_s < 123.4
        identified = model(GUIDED, axis)  # type: ignore[arg-type]
        gain = identified.parameters[GAIN[axis]]
        assert identified.provenance.instruments == (signal,)
        assert gain.std is not None
        assert K_RAD_S2[0] - 2.0 * gain.std < gain.value < K_RAD_S2[1] + 2.0 * gain.std
        assert gain.std < 15.0


def test_a_plan_in_offboard_mode_gives_the_simulator_back(
    log: Callable[[str], rotorid.FlightRecord], model: Callable[[str, Axis], rotorid.IdentifiedModel]
) -> None:
    for axis in AXES:
        (found,) = find_excitations(log(OFFBOARD), axis)
        assert found.kind == "sweep"
    found_roll = model(OFFBOARD, "roll")
    for name, truth in {"L_roll": 113.1, "L_p": -1.0, "T_motor": 0.048, "tau_roll": 0.0053}.items():
        estimate = found_roll.parameters[name]
        assert estimate.std is not None
        assert abs(estimate.value - truth) < 2.0 * estimate.std, name


def test_a_short_sweep_reviews_as_a_wide_one_measures(log: Callable[[str], rotorid.FlightRecord]) -> None:
    """One vehicle with the same gains: what lies beyond 50 rad/s follows from the plant and the known gyro filter."""
    short, wide = (margins(flown(log(name)))[0] for name in (CARD, WIDE))
    for axis in AXES:
        assert "sensitivity_peak" in short[axis].by_model
        assert "sensitivity_peak" not in wide[axis].by_model
        for name in ("crossover_rad_s", "phase_margin_deg", "gain_margin_db", "sensitivity_peak"):
            told, measured = short[axis].numbers[name], wide[axis].numbers[name]
            assert abs(told.value - measured.value) < 2.0 * np.hypot(told.std, measured.std), (axis, name)


# By injection: peak sensitivity, crossover in rad/s, phase margin in degrees; one peak lies beyond the band.
INJECTED = {
    (TUNED, "roll"): (1.25, 16.2, 47.0),
    (TUNED, "pitch"): (None, 32.5, 49.0),
    (WIDE, "roll"): (1.88, 61.0, 78.0),
    (WIDE, "pitch"): (1.88, 61.0, 78.0),
}


@pytest.mark.parametrize(("name", "axis"), INJECTED)
def test_the_broken_loop_by_injection_has_the_margins_that_were_flown(
    name: str, axis: Axis, log: Callable[[str], rotorid.FlightRecord]
) -> None:
    found = rotorid.response(log(name), inputs=[f"{axis}_command"], outputs=["p" if axis == "roll" else "q"])
    assert found.loops[axis].scope == "rate"
    loop = found.loops[axis].whole
    assert loop is not None
    assert loop.scope == "whole"
    peak, crossover, margin = INJECTED[name, axis]
    assert abs(loop.numbers["crossover_rad_s"].value - crossover) < 2.0 * loop.numbers["crossover_rad_s"].std + 0.1
    phase = loop.numbers["phase_margin_rad"]
    assert abs(math.degrees(phase.value) - margin) < 2.0 * math.degrees(phase.std) + 0.5
    if peak is None:
        assert "disturbance_rejection_peak" not in loop.numbers
        assert loop.bounds["disturbance_rejection_peak"].value < 1.51
    else:
        seen = loop.numbers["disturbance_rejection_peak"]
        assert abs(seen.value - peak) < 2.0 * seen.std + 0.01
