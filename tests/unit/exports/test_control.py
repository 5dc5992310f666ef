"""python-control runs the script and has the same models; SciPy's way is with the models themselves."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.unit.exports.models import HOVER, OMEGA, ROLL, model, vehicle
from tests.unit.exports.motion import imported

from rotorid.exports import ExportSettings
from rotorid.exports.control import export
from rotorid.exports.state_space import variable_name
from rotorid.typing import ComplexArray, FloatArray
from rotorid.verification.scores import theil_inequality

REASON = "python-control is not installed"
CHOICES = {
    "none": ExportSettings(delay="none"),
    "states": ExportSettings(delay="states", pade_order=4),
    "lag": ExportSettings(delay="lag"),
    "sampled": ExportSettings(delay="states", sample_rate_hz=100.0),
    "sampled_none": ExportSettings(delay="none", sample_rate_hz=100.0),
}


def answer(system: Any, shape: tuple[int, ...]) -> ComplexArray:
    at = 1j * OMEGA if system.dt == 0 else np.exp(1j * OMEGA * system.dt)
    return np.asarray(system(at)).reshape(shape)


@pytest.mark.parametrize("kind", list(CHOICES))
def test_it_has_the_same_responses(kind: str, tmp_path: Path) -> None:
    pytest.importorskip("control", reason=REASON)
    found, choices = vehicle(), CHOICES[kind]
    module = imported(export(found, choices), tmp_path, "vehicle_control.py")
    for one in found.models:
        rate, order = choices.sample_rate_hz, choices.pade_order
        expected = one.rational(delays=choices.model_delay, pade_order=order, sample_rate_hz=rate).response(OMEGA)
        system = getattr(module, variable_name(one.name))
        np.testing.assert_allclose(answer(system, expected.shape), expected, rtol=1e-9, atol=1e-12)
        assert list(system.input_labels) == list(one.structure.inputs)
        assert list(system.output_labels) == list(one.structure.outputs)
        if kind == "states":
            np.testing.assert_allclose(answer(system, expected.shape), one.response(OMEGA), rtol=1e-4, atol=1e-12)


def exact_margins(loop: Callable[[FloatArray], ComplexArray]) -> tuple[float, float, float, float]:
    """Gain and phase margin of a loop with its delay, and their crossovers, by bisection."""
    omega = np.geomspace(1.0, 500.0, 4000)
    gain, turned = np.log(np.abs(loop(omega))), np.unwrap(np.angle(loop(omega))) + np.pi

    def root(values: FloatArray, of: Callable[[ComplexArray], FloatArray]) -> float:
        first = int(np.flatnonzero(np.diff(np.sign(values)) != 0.0)[0])
        return float(brentq(lambda w: of(loop(np.array([w])))[0], omega[first], omega[first + 1], xtol=1e-12))

    crosses = root(gain, lambda value: np.log(np.abs(value)))
    turns = root(turned, lambda value: np.angle(-value))
    margin = float(1.0 / np.abs(loop(np.array([turns])))[0])
    return margin, float(np.degrees(np.angle(-loop(np.array([crosses]))))[0]), turns, crosses


def test_margins_are_those_of_the_loop_with_its_delay(tmp_path: Path) -> None:
    """By default, without a choice: a tenth of a degree at the crossover, for short and long delays."""
    control = pytest.importorskip("control", reason=REASON)
    for late_s in (0.002, 0.009, 0.04):
        structure = replace(ROLL, parameters=ROLL.parameters.with_values({"tau_roll": late_s}))
        found = model(structure)
        exported = export(vehicle(found), ExportSettings())
        module: Any = imported(exported, tmp_path / f"{late_s:g}", "vehicle_control.py")
        gain, phase_deg, turns, crosses = control.margin(module.rate_roll[0, 0])
        expected = exact_margins(lambda omega, found=found: found.response(omega)[0, 0])  # type: ignore[misc]
        assert phase_deg == pytest.approx(expected[1], abs=0.1)
        assert gain == pytest.approx(expected[0], rel=1e-3)
        assert [turns, crosses] == pytest.approx(expected[2:], rel=1e-3)
        kept = exported.delays["rate.roll"]
        assert (kept.kept, kept.longest_s) == ("states", pytest.approx(late_s))
        assert kept.phase_error_deg is not None
        assert kept.phase_error_deg <= 0.01
        assert kept.up_to_rad_s is not None
        assert kept.up_to_rad_s >= 0.99 * max(turns, crosses)
        assert any(f"order {kept.pade_order}, phase error" in sentence for sentence in exported.left_out)


def test_every_crossover_of_every_response_has_its_phase(tmp_path: Path) -> None:
    pytest.importorskip("control", reason=REASON)
    found = model(HOVER)
    module: Any = imported(export(vehicle(found), ExportSettings()), tmp_path, "vehicle_control.py")
    omega = np.geomspace(0.1, 500.0, 2000)
    exact, own = found.response(omega), np.asarray(module.hover_two(1j * omega))
    ratio = np.divide(own, exact, out=np.ones_like(own), where=np.abs(exact) > 1e-9)
    crosses = np.diff(np.sign(np.abs(exact) - 1.0), axis=-1) != 0.0
    assert crosses.any()
    assert np.degrees(np.abs(np.angle(ratio[..., 1:][crosses]))).max() < 0.1
    assert np.degrees(np.abs(np.angle(ratio[..., omega <= 50.0]))).max() < 0.1


def test_no_delay_is_said_aloud() -> None:
    exported = export(vehicle(), CHOICES["none"])
    assert "Delays of up to 18 ms are left out (--no-delay): margins are too large." in exported.left_out
    assert exported.delays["rate.roll"].kept == "none"
    assert exported.delays["rate.roll"].pade_order is None


def test_a_doublet_is_answered_as_rotorid_simulates_it(tmp_path: Path) -> None:
    control = pytest.importorskip("control", reason=REASON)
    found = vehicle()
    module: Any = imported(export(found, CHOICES["sampled"]), tmp_path, "vehicle_control.py")
    u = np.zeros((2, 200))
    u[0, 10:40], u[0, 40:70], u[1, 100:130] = 0.1, -0.1, 0.05
    y = np.asarray(control.forced_response(module.hover_two, inputs=u).outputs)
    np.testing.assert_allclose(y, found.models[1].simulate(u, sample_rate_hz=100.0, hold="zero"), atol=1e-9)
    module = imported(export(found, CHOICES["states"]), tmp_path, "vehicle_control.py")
    # Inputs of a continuous system are straight between their points: the corners are put close together.
    time_s = np.arange(2000) / 1000.0
    fine = np.repeat(u, 10, axis=1)
    y = np.asarray(control.forced_response(module.hover_two, time_s, fine).outputs)
    mine = found.models[1].simulate(fine, sample_rate_hz=1000.0, hold="zero")
    assert max(theil_inequality(a, b) for a, b in zip(mine[:2], y[:2], strict=True)) < 0.02


def test_measured_responses_are_systems_too(tmp_path: Path) -> None:
    pytest.importorskip("control", reason=REASON)
    found = vehicle()
    module: Any = imported(export(found, CHOICES["none"]), tmp_path, "vehicle_control.py")
    measured = found.models[1].data.response.values
    np.testing.assert_allclose(module.hover_two_measured(1j * OMEGA), measured, rtol=1e-8, atol=1e-12)
    assert module.hover_two_coherence.shape == measured.shape
    np.testing.assert_allclose(module.rate_roll_delays_s, [[0.009]])


def test_without_measured_responses_there_are_none(tmp_path: Path) -> None:
    pytest.importorskip("control", reason=REASON)
    found = vehicle(model(HOVER, responses=False), model(ROLL))
    module = imported(export(found, CHOICES["none"]), tmp_path, "vehicle_control.py")
    assert not hasattr(module, "hover_two_measured")


def test_the_script_says_what_it_holds() -> None:
    exported = export(vehicle(), CHOICES["lag"])
    text = exported.files["vehicle_control.py"]
    assert isinstance(text, str)
    assert "# L_roll = 110 +- 1.1 rad/s^2" in text
    assert "# Log: roll.ulg" in text
    assert "a/roll" not in text
    assert "rate.roll: delay at 50 rad/s" in text
    assert "Delays are lags" in text
    rows = {row.name: row for row in exported.compared}
    assert rows["rate.roll: delay at 50 rad/s"].held == "approximated"
    left_out = {row.name: row for row in export(vehicle(), CHOICES["none"]).compared}
    assert left_out["rate.roll: delay at 50 rad/s"].held == "not"
    assert all(row.held == "exact" for name, row in left_out.items() if "delay" not in name)


def test_a_negative_delay_is_told() -> None:
    structure = replace(ROLL, parameters=ROLL.parameters.with_values({"tau_roll": -0.002}))
    (finding,) = export(vehicle(model(structure)), CHOICES["states"]).findings
    assert "-2 ms, which is negligible" in finding.message
