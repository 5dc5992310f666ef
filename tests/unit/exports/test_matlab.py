"""Octave runs the script and answers as rotorid does; the branch of MATLAB is checked by its text."""

from __future__ import annotations

import io
import math
import re
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat
from tests.unit.exports.models import HOVER, OMEGA, ROLL, model, vehicle
from tests.unit.exports.vehicles import sih

from rotorid.errors import UsageError
from rotorid.exports import Exported, ExportSettings
from rotorid.exports.matlab import export
from rotorid.typing import ComplexArray

NONE, STATES = ExportSettings(delay="none"), ExportSettings(delay="states", pade_order=3)
LAG, USUAL = ExportSettings(delay="lag"), ExportSettings()
SAMPLED = ExportSettings(delay="states", sample_rate_hz=200.0)


def script(exported: Exported) -> str:
    text = exported.files["vehicle.m"]
    assert isinstance(text, str)
    return text


def octave(folder: Path, statements: Sequence[str]) -> list[float]:
    """Numbers that Octave prints."""
    program = shutil.which("octave-cli")
    if program is None:
        pytest.skip("Octave is not installed")
    (folder / "ask.m").write_text("\n".join(["1;", *statements]), encoding="ascii")
    done = subprocess.run(
        [program, "--quiet", "--norc", "ask.m"], cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    if "control" in done.stderr and "not" in done.stderr:
        pytest.skip(f"Octave has no package control: {done.stderr.strip()[:200]}")
    assert "error: " not in done.stderr.replace("error: ignoring const execution_exception&", ""), done.stderr
    return [float(text) for text in done.stdout.split()]


def responses(name: str) -> list[str]:
    """Statements that print the response of a system at the frequencies."""
    omega = "[" + " ".join(f"{value:.17g}" for value in OMEGA) + "]"
    return [
        f"H = freqresp({name}, {omega});",
        'printf("%.17g %.17g\\n", [real(H(:)) imag(H(:))].\');',
    ]


def as_response(numbers: Sequence[float], outputs: int, inputs: int) -> ComplexArray:
    pairs = np.array(numbers).reshape(-1, 2) @ np.array([1.0, 1.0j])
    return np.asarray(pairs.reshape((outputs, inputs, OMEGA.size), order="F"))


def test_octave_has_the_same_responses(tmp_path: Path) -> None:
    """Without delays to 1e-9; with them within the error that the file tells; sampled as rotorid samples."""
    found = vehicle()
    kinds = {"none": NONE, "states": STATES, "lag": LAG, "sampled": SAMPLED}
    statements = []
    for kind, choices in kinds.items():
        export(found, choices).write(tmp_path / kind)
        statements += [f"run('{kind}/vehicle.m');", *responses("rate_roll"), *responses("hover_two")]
    # The branch for uncertain parameters runs where there is such a function: here it gives the value.
    (tmp_path / "ureal.m").write_text(
        "function p = ureal(name, value, varargin)\n  p = value;\nend\n", encoding="ascii"
    )
    statements += ["addpath(pwd);", "run('none/vehicle.m');", *responses("hover_two_uncertain")]
    statements += ["H = hover_two_measured.H;", 'printf("%.17g %.17g\\n", [real(H(:)) imag(H(:))].\');']
    numbers = octave(tmp_path, statements)
    roll, hover = 2 * OMEGA.size, 12 * OMEGA.size
    parts = np.split(np.array(numbers), np.cumsum([*[roll, hover] * len(kinds), hover]))
    for index, (kind, choices) in enumerate(kinds.items()):
        for part, one, shape in ((2 * index, found.models[0], (1, 1)), (2 * index + 1, found.models[1], (3, 2))):
            delays = "none" if kind == "none" else choices.delay
            order, rate = choices.pade_order, choices.sample_rate_hz
            expected = one.rational(delays=delays, pade_order=order, sample_rate_hz=rate).response(OMEGA)
            np.testing.assert_allclose(as_response(parts[part], *shape), expected, rtol=1e-9, atol=1e-9)
    told = {
        name: math.radians(float(degrees))
        for name, degrees in re.findall(r"% (\S+): order 3, phase error (\S+) deg", script(export(found, STATES)))
    }
    for index, one, shape in ((2, found.models[0], (1, 1)), (3, found.models[1], (3, 2))):
        exact = one.response(OMEGA)
        there = np.abs(exact) > 0.0
        off = np.abs(as_response(parts[index], *shape) - exact)[there] / np.abs(exact)[there]
        assert told[one.name] > 0.0
        assert off.max() <= 1.05 * told[one.name] + 1e-9
    plant = found.models[1].rational(delays="none").response(OMEGA)
    np.testing.assert_allclose(as_response(parts[-2], 3, 2), plant, rtol=1e-9, atol=1e-9)
    measured = found.models[1].data.response.values
    np.testing.assert_allclose(as_response(parts[-1], 3, 2), measured, rtol=1e-8, atol=1e-12)


def test_the_branch_of_matlab_has_its_own_delays_and_names() -> None:
    text = script(export(vehicle(), USUAL))
    branch = re.search(r"else\n  hover_two = (.*?);\nend", text, re.DOTALL)
    assert branch is not None
    call = branch[1]
    assert call.startswith("ss(A, B, C, D, 'InputDelay', input_delay, 'OutputDelay', output_delay, 'StateName', ")
    assert "'StateName', {'u'; 'q'; 'theta'; 'w'}" in call
    assert "'InputName', {'pitch_command'; 'thrust_command'}" in call
    assert "'OutputName', {'q'; 'ax'; 'az'}" in call
    # What all outputs share is at the inputs.
    assert "input_delay = [0.012999999999999999; 0.0060000000000000001];" in text
    assert re.search(r"output_delay = \[0; 0\.005\d*; 0\.005\d*\];", text)
    assert re.findall(r"pade_order = (\d);", text) == ["2", "5"]
    assert "pade_order = 3;" in script(export(vehicle(), STATES))
    assert "M_q = ureal('M_q', -1.3999999999999999, 'PlusMinus', [-0.027" in text
    assert "F = [[X_u, 0, -g, 0]; [M_u, M_q, 0, 0]; [0, 1, 0, 0]; [0, 0, 0, 2*X_u]];" in text
    assert "ureal('tau" not in text


def test_brackets_and_branches_are_closed() -> None:
    for choices in (NONE, STATES, LAG, SAMPLED):
        code = [line.split("%")[0] for line in script(export(vehicle(), choices)).splitlines()]
        words = [word for line in code for word in re.findall(r"\b(?:if|for|end)\b", line)]
        assert words.count("end") == words.count("if") + words.count("for")
        for opening, closing in ("()", "[]", "{}"):
            assert sum(line.count(opening) - line.count(closing) for line in code) == 0


def test_the_mat_file_holds_everything() -> None:
    found = vehicle()
    raw = export(found, USUAL).files["vehicle.mat"]
    assert isinstance(raw, bytes)
    held = loadmat(io.BytesIO(raw), simplify_cells=True)["hover_two"]
    plant = found.models[1].rational(delays="none")
    for name in "ABCD":
        np.testing.assert_array_equal(held[name], getattr(plant, name))
    np.testing.assert_allclose(held["input_delay"], [0.013, 0.006])
    np.testing.assert_allclose(held["output_delay"], [0.0, 0.005, 0.005], atol=1e-15)
    assert list(held["state_names"]) == ["u", "q", "theta", "w"]
    assert list(held["parameter_names"]) == list(found.models[1].parameters)
    np.testing.assert_array_equal(held["covariance"], found.models[1].bounds.covariance)
    np.testing.assert_array_equal(held["measured"], found.models[1].data.response.values)
    assert held["meta"]["model"] == "hover.two"
    assert held["sample_time"] == 0.0
    roll = loadmat(io.BytesIO(raw))["rate_roll"]
    # One name alone is a cell array too, and not a text.
    assert roll["input_names"][0, 0].dtype == object
    assert raw == export(found, USUAL).files["vehicle.mat"]


def test_what_becomes_of_delays_is_said() -> None:
    said = {kind: " ".join(export(vehicle(), choices).left_out) for kind, choices in (("n", NONE), ("s", STATES))}
    assert "Delays of up to 18 ms are left out (--no-delay)" in said["n"]
    assert "MATLAB keeps delays exactly. In Octave they are Padé approximations: rate.roll: order 3, phase" in said["s"]
    assert "InputDelay" not in script(export(vehicle(), NONE))
    row = next(row for row in export(vehicle(), USUAL).compared if row.name.startswith("rate.roll: delay"))
    assert (row.exported, row.held) == (0.009, "exact")
    row = next(row for row in export(vehicle(), LAG).compared if row.name.startswith("rate.roll: delay"))
    assert row.held == "approximated"
    assert row.exported == pytest.approx(np.arctan(50.0 * 0.009) / 50.0, rel=1e-6)
    assert " ".join(export(vehicle(), SAMPLED).left_out) == "Delays are exact, as memory of past inputs."


def test_names_that_collide_are_refused() -> None:
    with pytest.raises(UsageError, match="have the same name rate_roll"):
        export(vehicle(), ExportSettings(names="rate_roll"))
    with pytest.raises(UsageError, match="two results have the same name rate_roll"):
        export(vehicle(model(ROLL), model(HOVER, name="rate roll")), NONE)
    with pytest.raises(UsageError, match="no model to export"):
        export(sih(), NONE)
