"""python-control runs the script and has the same models; SciPy's way is with the models themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit.exports.models import HOVER, OMEGA, ROLL, model, vehicle
from tests.unit.exports.motion import imported

from rotorid.exports import ExportSettings
from rotorid.exports.control import export
from rotorid.exports.state_space import variable_name
from rotorid.typing import ComplexArray
from rotorid.verification.scores import theil_inequality

REASON = "python-control is not installed"
CHOICES = {
    "none": ExportSettings(),
    "states": ExportSettings(delay="states", pade_order=4),
    "lag": ExportSettings(delay="lag"),
    "sampled": ExportSettings(delay="states", sample_rate_hz=100.0),
    "sampled_none": ExportSettings(sample_rate_hz=100.0),
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
        expected = one.rational(delays=choices.delay, pade_order=order, sample_rate_hz=rate).response(OMEGA)
        system = getattr(module, variable_name(one.name))
        np.testing.assert_allclose(answer(system, expected.shape), expected, rtol=1e-9, atol=1e-12)
        assert list(system.input_labels) == list(one.structure.inputs)
        assert list(system.output_labels) == list(one.structure.outputs)
        if kind == "states":
            np.testing.assert_allclose(answer(system, expected.shape), one.response(OMEGA), rtol=1e-4, atol=1e-12)


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
    from dataclasses import replace

    structure = replace(ROLL, parameters=ROLL.parameters.with_values({"tau_roll": -0.002}))
    (finding,) = export(vehicle(model(structure)), CHOICES["states"]).findings
    assert "-2 ms, which is negligible" in finding.message
