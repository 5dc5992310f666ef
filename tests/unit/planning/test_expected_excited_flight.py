"""Flights without gusts and noise, by frequency response, against the simulator."""

from __future__ import annotations

import numpy as np
from tests.unit.planning.plans import sweeps

from rotorid.planning.expected import as_planned, excited_flight
from rotorid.planning.loop import vehicle_loop
from rotorid.simulation.hover_flight import SILENT, Excitation, fly
from rotorid.vehicles import s500


def test_a_quiet_flight_is_that_of_the_simulator() -> None:
    plan = sweeps({"roll": 0.03, "yaw": 0.1}, 20.0)
    vehicle, names = s500.vehicle(), ("roll_command", "yaw_command", "p", "r", "phi", "ay")
    loop = vehicle_loop(vehicle)
    found = excited_flight(loop, as_planned(plan, ["roll", "yaw"], loop.log_rate_hz), names, highest_rad_s=300.0)
    parts = [Excitation(maneuver=one.maneuver, values=one.values, sample_rate_hz=200.0) for one in plan.inputs]
    flown = fly(vehicle, parts, turbulence_m_s=0.0, noise=SILENT, rng=np.random.default_rng(0))
    samples = min(flown.time_s.size, found.values.shape[1])
    slow = np.fft.rfftfreq(samples, 1.0 / loop.log_rate_hz) < 20.0
    for name in names:
        truth, ours = (np.fft.rfft(values[:samples])[slow] for values in (flown.columns[name], found[name]))
        # The autopilot sums in steps of 1 ms where the loop integrates: half a step late, 0.3 % of a swing at 5 rad/s
        # of which the integral is a part.
        assert np.linalg.norm(ours - truth) < 3e-3 * np.linalg.norm(truth)
