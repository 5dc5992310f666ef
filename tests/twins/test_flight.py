"""Twin of the flight: what comes out of it is the model that went in, in frequency and in time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.signal import csd

from rotorid.data.record import AXES, Maneuver
from rotorid.excitation.sweep import pilot_sweep
from rotorid.models.state_space import StateSpace
from rotorid.simulation.hover_flight import OUTPUTS, SILENT, Excitation, Flight, fly
from rotorid.simulation.linear import simulate_linear
from rotorid.typing import Axis, ComplexArray
from rotorid.vehicles import demo_plan, s500

VEHICLE = s500.vehicle()
RATE_HZ = 200.0
BAND = (2.0 * math.pi * 0.1, 2.0 * math.pi * 8.0)
RESPONSES: dict[Axis, tuple[str, ...]] = {
    "roll": ("p", "phi", "ay"),
    "pitch": ("q", "theta", "ax"),
    "yaw": ("r",),
    "thrust": ("az", "w"),
}


def calm(axis: Axis) -> Flight:
    """One sweep without gusts and noise, with a window of trim on both sides: every moment has the same weight."""
    values = pilot_sweep(amplitude=0.03, band_rad_s=BAND, duration_s=100.0, sample_rate_hz=1000.0, trim_s=20.0)
    maneuver = Maneuver(axis=axis, kind="sweep", start_s=0.0, stop_s=140.0)
    plan = (Excitation(maneuver=maneuver, values=values, sample_rate_hz=1000.0),)
    return fly(VEHICLE, plan, turbulence_m_s=0.0, noise=SILENT, rng=np.random.default_rng(0))


def cross(flight: Flight, axis: Axis, names: Sequence[str]) -> tuple[np.ndarray, ComplexArray]:
    """Cross-spectra of the excitation with the named columns, shape ``(names, f)``, from 8 to 40 rad/s."""
    columns = np.stack([flight.columns[name] for name in names])
    window = {"fs": RATE_HZ, "nperseg": int(20.0 * RATE_HZ), "noverlap": int(15.0 * RATE_HZ), "detrend": "constant"}
    frequency_hz, spectra = csd(flight.columns[f"{axis}_excitation"], columns, **window)
    omega = 2.0 * np.pi * frequency_hz
    band = (omega >= 8.0) & (omega <= 40.0)
    return omega[band], spectra[:, band]


@pytest.fixture(scope="module")
def joint() -> tuple[np.ndarray, dict[str, ComplexArray]]:
    """Responses of all commands by output, shape ``(4, f)``: one flight per axis, excitations as instruments.

    The autopilot answers a sweep of one axis with the commands of the others, so G_ry = G_ru H is solved for all four.
    """
    outputs = sorted({name for names in RESPONSES.values() for name in names})
    commands = [f"{axis}_command" for axis in AXES]
    flights = {axis: calm(axis) for axis in AXES}
    omega, _ = cross(flights["roll"], "roll", commands)
    to_commands = np.stack([cross(flights[axis], axis, commands)[1] for axis in AXES])
    to_outputs = np.stack([cross(flights[axis], axis, outputs)[1] for axis in AXES])
    solved = np.linalg.solve(np.moveaxis(to_commands, -1, 0), np.moveaxis(to_outputs, -1, 0))
    return omega, {name: solved[:, :, row].T for row, name in enumerate(outputs)}  # type: ignore[misc]


@pytest.mark.parametrize(("axis", "output"), [(axis, name) for axis in AXES for name in RESPONSES[axis]])  # type: ignore[index]
def test_calm_flight_shows_the_exact_response(
    axis: Axis, output: str, joint: tuple[np.ndarray, dict[str, ComplexArray]]
) -> None:
    omega, measured = joint
    exact = VEHICLE.system.response(omega)[OUTPUTS.index(output), AXES.index(axis)]
    ratio = measured[output][AXES.index(axis)] / exact
    # A Hann window of length T averages over a variance of (2 pi / T)^2 / 3 in frequency. The curvature of a double
    # integrator makes that an error of 3 / omega^2 times the variance, and the loop's own curvature no more than twice
    # that again. Interpolation over the steps h of the simulation adds (omega h)^2 / 12 in the commands.
    smear = 9.0 / omega**2 * (2.0 * np.pi / 20.0) ** 2 / 3.0
    assert np.all(np.abs(ratio - 1.0) < smear + (omega / 1000.0) ** 2 / 6.0)


@pytest.mark.parametrize(
    ("model", "axes", "outputs"),
    [
        (s500.longitudinal(), ("pitch", "thrust"), ("q", "u", "w", "theta", "ax", "az")),
        (s500.lateral(), ("roll", "yaw"), ("p", "r", "v", "phi", "ay")),
    ],
)
def test_commands_replayed_give_the_flight_back(
    model: StateSpace, axes: tuple[Axis, ...], outputs: tuple[str, ...]
) -> None:
    plan = tuple(part for part in demo_plan(rng=np.random.default_rng(0)) if part.maneuver.kind == "doublet")
    first = plan[0].maneuver.start_s
    plan = tuple(_earlier(part, first - 0.5) for part in plan)
    flight = fly(VEHICLE, plan, sample_rate_hz=1000.0, turbulence_m_s=0.0, noise=SILENT, rng=np.random.default_rng(0))
    start = next(part.maneuver.start_s for part in plan if part.maneuver.axis in axes)
    # From rest before the first doublet, and short: rounding grows with exp(2.9 t).
    span = slice(round((start - 0.2) * 1000.0), round((start + 1.8) * 1000.0))
    trim = {"thrust_command": VEHICLE.hover_thrust, "az": flight.columns["az"][0]}
    u = np.stack([flight.columns[f"{axis}_command"][span] - trim.get(f"{axis}_command", 0.0) for axis in axes])
    y = np.stack([flight.columns[name][span] - trim.get(name, 0.0) for name in outputs])
    states = ("q", "u", "w", "theta") if "q" in outputs else ("p", "r", "v", "phi")
    x0 = np.array([y[outputs.index(name), 0] for name in states])
    replay = simulate_linear(model, u, sample_rate_hz=1000.0, x0=x0, before=u[:, 0], hold="first")
    np.testing.assert_allclose(replay, y, rtol=0.0, atol=1e-9 * np.abs(y).max())


def _earlier(part: Excitation, by_s: float) -> Excitation:
    old = part.maneuver
    maneuver = Maneuver(axis=old.axis, kind=old.kind, start_s=old.start_s - by_s, stop_s=old.stop_s - by_s)
    return Excitation(maneuver=maneuver, values=part.values, sample_rate_hz=part.sample_rate_hz)
