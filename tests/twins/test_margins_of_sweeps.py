"""Margins of rate loops that a sweep shows, against the simulator's own linearization.

The loop is the one that ``review``, ``response`` and ``tune`` state. A number is right when the truth lies inside its
95 % interval, whether it was measured or lies beyond the band.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.twins.test_tuned_loops import fly, mistuned

import rotorid
from rotorid.autopilots.filters import butterworth_low_pass, combined_response
from rotorid.data.record import AXES
from rotorid.flights.controllers import controller_as_logged
from rotorid.loops.plants import drawn_plant
from rotorid.loops.rate_loops import NUMBERS, RateLoop, figures_of, rate_loop, read_margins
from rotorid.simulation.hover_flight import OUTPUTS
from rotorid.simulation.linearization import linearize
from rotorid.spectral.loops import at_points
from rotorid.tuning.loops import loop_figures, quantities

FACTORS = ((0.5, 0.5, 0.5), (1.0, 1.0, 1.0), (0.7, 1.5, 0.4), (1.3, 0.6, 1.2))
VEHICLES = ("px4_quad", "iris", "ardupilot_quad")


class Swept(NamedTuple):
    """A loop as a flight shows it, and what is true of it."""

    found: RateLoop
    truth: Mapping[str, float]


def swept(vehicle: str, factors: tuple[float, float, float], folder: Path, *, seed: int) -> Swept:
    craft = mistuned(vehicle, factors)
    record = rotorid.read(fly(craft, folder, seed=seed))
    found = rate_loop("roll", record)
    acting = controller_as_logged(record, found.controller.rate_loop, source=found.measured.source)
    # The simulated loops of all autopilots add the integral one step late, and read the angle of the same tick.
    acting = replace(acting, controller=replace(acting.controller, late_integral=True, late_angle=False))
    omega = np.geomspace(0.5, min(600.0, 0.9 * math.pi / acting.controller.step_s), 3000)
    motion = linearize(craft.vehicle, craft.autopilot).response(omega)[OUTPUTS.index("p"), AXES.index("roll")]
    # The simulated filter of the gyro runs at the rate of the loop, .7 ms faster than at the rate that the log names.
    gyro = butterworth_low_pass(craft.autopilot.gyro_cutoff_hz, craft.autopilot.rate_hz).response(omega)
    passed = gyro if craft.autopilot.kind == "px4" else combined_response(acting.logged, omega)
    loop = motion * passed * acting.response(omega)
    exact = quantities(loop_figures(omega, loop[None]))
    exact["disturbance_rejection_rad_s"] = exact.pop("rejection_bandwidth_rad_s")
    return Swept(found, {name: exact[name].value for name in NUMBERS if name in exact})


def inside(found: RateLoop, truth: Mapping[str, float]) -> dict[str, bool]:
    """Whether the truth lies in the interval of each number."""
    return {name: one.lower <= truth[name] <= one.upper for name, one in found.numbers.items() if name in truth}


@pytest.mark.parametrize("vehicle", ["px4_quad", "ardupilot_quad"])
def test_a_sweep_shows_all_margins(vehicle: str, tmp_path: Path) -> None:
    found, truth = swept(vehicle, (0.7, 0.7, 0.7), tmp_path, seed=4)
    assert set(found.numbers) == set(NUMBERS)
    assert all(inside(found, truth).values())
    assert found.measured.instrument in ("excitation", "injection")


def test_beyond_the_band_a_margin_is_less_certain_and_says_so(tmp_path: Path) -> None:
    """The same flight with the points above the crossover left out."""
    found, truth = swept("px4_quad", (1.0, 1.0, 1.0), tmp_path, seed=4)
    low = np.flatnonzero(found.measured.response.omega_rad_s < 30.0)
    plant = drawn_plant(replace(found.measured, response=at_points(found.measured.response, low)))
    record = rotorid.read(next(tmp_path.glob("*.ulg")))
    controller = controller_as_logged(record, found.controller.rate_loop, source=found.measured.source)
    numbers, by_model, _ = read_margins(figures_of(plant, controller), plant)
    assert "gain_margin_db" in by_model
    assert numbers["gain_margin_db"].std > 1.5 * found.numbers["gain_margin_db"].std
    assert numbers["gain_margin_db"].lower < truth["gain_margin_db"] < numbers["gain_margin_db"].upper


FLEET = tuple((vehicle, factors, seed) for vehicle in VEHICLES for factors in FACTORS for seed in (11, 31, 51, 71))


@pytest.mark.slow
def test_the_study_of_forty_eight_sweeps(tmp_path: Path) -> None:
    """At least 90 % of the intervals of each number hold the truth."""
    rows = []
    for vehicle, factors, seed in FLEET:
        folder = tmp_path / f"{vehicle}-{seed}-{factors[0]}"
        folder.mkdir()
        found, truth = swept(vehicle, factors, folder, seed=seed)
        rows.append((found, inside(found, truth)))
    print("| number | stated | by model | inside | half width |")
    for name in NUMBERS:
        stated = [(found, held[name]) for found, held in rows if name in held]
        halves = [0.5 * (one.numbers[name].upper - one.numbers[name].lower) for one, _ in stated]
        modeled = sum(name in one.by_model for one, _ in stated)
        share = 100.0 * np.mean([held for _, held in stated])
        print(f"| {name} | {len(stated)} of {len(rows)} | {modeled} | {share:.0f} % | {np.median(halves):.3g} |")
        assert len(stated) == len(rows), name
        assert share >= 90.0, name
