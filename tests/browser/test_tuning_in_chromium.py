"""Gains by hand on the page of ``tune``: the script's margins are those of Python, and sliders move them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.chromium import SETTLED, asked

from rotorid.data.quantity import Quantity
from rotorid.models.autopilots import axis_controller
from rotorid.proposing.axis_tuning import AxisTuning, _loops, _responses
from rotorid.proposing.filter_curve import AxisPoint, FilterCurve, FilterPoint
from rotorid.proposing.proposal import TuningProposal
from rotorid.report.tune import render_tune
from rotorid.results.provenance import Provenance
from rotorid.tuning import ControllerParts, Gains, attitude_rms, frequency_grid, loop_figures, propose, uncertain_plant

READY = 'document.documentElement.dataset.sliders === "ready"'
PROBE = (
    f"async () => {{{SETTLED}"
    + """
  const place = document.querySelector("[data-axis]");
  await openAll([place, ...place.querySelectorAll("details")]);
  const figures = () => Object.fromEntries(
    Array.from(place.querySelectorAll("[data-figure]"), (cell) => [cell.dataset.figure, cell.textContent]));
  const before = figures();
  const slider = place.querySelector("input[name=P]");
  slider.value = 1.5 * Number(slider.value);
  const pValue = Number(slider.value);
  slider.dispatchEvent(new Event("input"));
  await settled();
  const after = figures();
  const steps = place.querySelector("[data-picture]").data.map((line) => Array.from(line.y));
  const integral = place.querySelector("input[name=I]");
  place.querySelector("input[name=P]").value = place.querySelector("input[name=P]").min;
  place.querySelector("input[name=A]").value = place.querySelector("input[name=A]").max;
  integral.value = integral.max;
  integral.dispatchEvent(new Event("input"));
  await settled();
  const swinging = figures();
  const inputs = Array.from(place.querySelectorAll("input"));
  const chosen = Object.fromEntries(inputs.map((input) => [input.name, Number(input.value)]));
  return { before, after, steps, p: pValue, swinging, chosen };
}
"""
)
PARAMETERS = {
    "MC_ROLLRATE_P": 0.1,
    "MC_ROLLRATE_I": 0.15,
    "MC_ROLLRATE_D": 0.002,
    "MC_ROLL_P": 5.0,
    "IMU_DGYRO_CUTOFF": 30.0,
    "IMU_GYRO_RATEMAX": 400.0,
}


def vehicle(w: np.ndarray) -> np.ndarray:
    return np.asarray(113.1 / ((0.048j * w + 1.0) * (1j * w + 1.0)) * np.exp(-0.012j * w))


def proposed() -> TuningProposal:
    """A proposal without any log."""
    axis = axis_controller(PARAMETERS, "roll", firmware="PX4 1.16.0")
    assert axis is not None
    plant = uncertain_plant(vehicle, None, band_rad_s=(1.0, 100.0), draws=20)
    omega = frequency_grid(axis.controller)
    ones = np.ones(omega.size, dtype=np.complex128)
    parts = ControllerParts(controller=axis.controller, omega_rad_s=omega, filters=ones, logged=ones)
    found = propose("roll", plant, axis.controller, parts=parts)
    drawn = plant.drawn(omega)
    sets = {"flown": (drawn, parts, found.flown.gains), "proposed": (drawn, parts, found.proposed.gains)}
    time_s = np.linspace(0.0, 2.0, 50)
    tuning = AxisTuning(
        controller=axis,
        plant=plant,
        omega_rad_s=omega,
        proposal=found,
        parameters={name: (value, value) for name, value in PARAMETERS.items()},
        loops=_loops(sets),
        responses=_responses(omega, sets),
        step_s=time_s,
        steps={name: np.ones((20, 50)) for name in sets},
        parts=parts,
    )
    return TuningProposal(
        autopilot="PX4",
        firmware="PX4 1.16.0",
        axes={"roll": tuning},
        thrust=None,
        scale=16.0,
        files={},
        rollback_files={},
        findings=(),
        provenance=Provenance(version="0", inputs={}, settings={"robustness": 1.7}, seed=0),
    )


def number(text: str) -> float:
    (found, *_) = re.findall(r"-?\d+(?:\.\d+)?", text)
    return float(found)


@pytest.fixture(scope="module")
def moved(alone: Any, tmp_path_factory: pytest.TempPathFactory) -> tuple[AxisTuning, dict[str, Any]]:
    """An axis, and what its page shows while sliders are moved."""
    proposal, folder = proposed(), tmp_path_factory.mktemp("sliders")
    seen, said = asked(alone, render_tune(proposal, title="t"), folder, PROBE, ready=READY)
    assert said == []
    return proposal.axes["roll"], seen


def test_sliders_show_what_python_says(moved: tuple[AxisTuning, dict[str, Any]]) -> None:
    one, seen = moved
    gains = one.proposal.proposed.gains
    nominal = one.plant.response(one.omega_rad_s)
    # Sliders stand on whole steps of the proposed gains.
    for told, factor in (("before", 1.0), ("after", seen["p"] / gains.P)):
        held = Gains(P=gains.P * factor, I=gains.I, D=gains.D, A=gains.A)
        figures = loop_figures(one.omega_rad_s, (nominal * one.parts.rate(held))[None])
        assert number(seen[told]["crossover"]) == pytest.approx(
            float(figures.crossover_rad_s[0]) / (2.0 * np.pi), rel=0.02
        )
        assert number(seen[told]["phase"]) == pytest.approx(float(np.degrees(figures.phase_margin_rad[0])), abs=1.0)
        assert number(seen[told]["peak"]) == pytest.approx(float(figures.sensitivity_peak[0]), rel=0.02)
        assert number(seen[told]["noise"]) / 100.0 == pytest.approx(
            one.parts.noise(held) / one.parts.noise(one.proposal.flown.gains), rel=0.02
        )
        quiet, chosen = (
            float(attitude_rms(one.omega_rad_s, nominal[None], (nominal * one.parts.whole(each))[None])[0])
            for each in (one.proposal.flown.gains, held)
        )
        assert "times less than" in seen[told]["disturbance"]
        assert number(seen[told]["disturbance"]) == pytest.approx(quiet / chosen, rel=0.05)
    for line in seen["steps"]:
        assert line[0] == pytest.approx(0.0, abs=0.01)
        assert line[-1] == pytest.approx(1.0, abs=0.1)


def test_sliders_call_a_loop_unstable_that_python_calls_unstable(moved: tuple[AxisTuning, dict[str, Any]]) -> None:
    """Nearly no P, much I and A: a phase that never rises above -180 degrees."""
    one, seen = moved
    chosen = seen["chosen"]
    gains = Gains(P=chosen["P"], I=chosen["I"], D=chosen["D"], A=chosen["A"])
    loop = (one.plant.response(one.omega_rad_s) * one.parts.whole(gains))[None]
    assert not loop_figures(one.omega_rad_s, loop, from_rad_s=one.plant.known_from_rad_s).stable[0]
    assert "with the angle loop unstable" in seen["swinging"]["peak"]
    assert seen["swinging"]["worst"].startswith("unstable")


PICK = (
    f"async () => {{{SETTLED}"
    + """
  await settled();
  const opened = () => Array.from(document.querySelectorAll("details[id^=choice-]"))
    .filter((one) => one.open).map((one) => one.id);
  const before = opened();
  document.querySelector('[data-picture="filters-curve"]').emit("plotly_click", { points: [{ text: "1" }] });
  const clicked = opened();
  document.querySelector('a[href="#choice-0"]').click();
  const text = document.getElementById("choice-1").innerText;
  return { before, clicked, linked: opened(), text };
}
"""
)


def exact(value: float, unit: str) -> Quantity:
    return Quantity(value=value, std=0.0, lower=value, upper=value, unit=unit)


def point(number: int, filters: dict[str, tuple[float | None, float]], judged: Any) -> FilterPoint:
    one = AxisPoint(
        judged=judged,
        parameters={"MC_ROLLRATE_P": 0.12},
        sensitivity_peak=exact(1.5, "1"),
        attitude_ratio=exact(1.0 - 0.1 * number, "1"),
    )
    saved = exact(20.0 * number, "%")
    return FilterPoint(number=number, filters=filters, noise_limit=1.0, axes={"roll": one}, saves_percent=saved)


def test_a_point_of_the_curve_is_picked_by_a_click(alone: Any, tmp_path: Path) -> None:
    proposal = proposed()
    judged = proposal.axes["roll"].proposal.flown
    points = (point(1, {"IMU_GYRO_CUTOFF": (80.0, 40.0)}, judged), point(0, {}, judged))
    run = replace(proposal.provenance, command=("rotorid", "tune", "a b.ulg", "--filters=curve", "--out", "here"))
    shown = replace(proposal, curve=FilterCurve(points=points, recommended=1), provenance=run)
    seen, said = asked(alone, render_tune(shown, title="t"), tmp_path, PICK, ready=READY)
    assert said == []
    assert (seen["before"], seen["clicked"], seen["linked"]) == ([], ["choice-1"], ["choice-1", "choice-0"])
    assert "rotorid tune 'a b.ulg' --filters 1" in seen["text"]
    assert re.search(r"IMU_GYRO_CUTOFF\s+80\s+40", seen["text"])
    assert re.search(r"MC_ROLLRATE_P\s+0\.1\s+0\.12", seen["text"])
