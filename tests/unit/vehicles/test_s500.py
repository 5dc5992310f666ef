"""The S500: the printed equations, the printed eigenvalues, and an autopilot with margins."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import AXES
from rotorid.simulation.hover_flight import MEASURED, OUTPUTS
from rotorid.units import STANDARD_GRAVITY_M_S2 as G
from rotorid.vehicles import s500

VEHICLE = s500.vehicle()
T = s500.TRUTH


def test_longitudinal_equations_are_those_of_the_paper() -> None:
    model = s500.longitudinal()
    np.testing.assert_array_equal(
        model.F,
        [
            [T["M_q"], T["M_u"], T["M_w"], 0.0],
            [T["X_q"], T["X_u"], 0.0, -G],
            [0.0, T["Z_u"], T["Z_w"], 0.0],
            [1.0, 0.0, 0.0, 0.0],
        ],
    )
    np.testing.assert_array_equal(
        model.G, [[T["M_pitch"], 0.0], [T["X_pitch"], 0.0], [T["Z_pitch"], T["Z_thrust"]], [0.0, 0.0]]
    )
    np.testing.assert_array_equal(model.input_delays_s, [T["tau_pitch"], T["tau_thrust"]])


def test_lateral_equations_are_those_of_the_paper() -> None:
    model = s500.lateral()
    np.testing.assert_array_equal(
        model.F,
        [
            [0.0, T["L_r"], T["L_v"], 0.0],
            [T["N_p"], T["N_r"], 0.0, 0.0],
            [T["Y_p"], 0.0, T["Y_v"], G],
            [1.0, 0.0, 0.0, 0.0],
        ],
    )
    np.testing.assert_array_equal(
        model.G, [[T["L_roll"], 0.0], [T["N_roll"], T["N_yaw"]], [T["Y_roll"], 0.0], [0.0, 0.0]]
    )


def test_lateral_eigenvalues_are_the_published_ones() -> None:
    # Printed to two digits; the stable pair differs by its rounding, 0.02.
    printed = np.array([-3.88 - 0.62j, -3.88 + 0.62j, 1.87 - 3.58j, 1.87 + 3.58j])
    np.testing.assert_allclose(s500.lateral().poles(), printed, atol=0.025)


def test_truth_is_that_of_the_shared_flight(shared_data: Path) -> None:
    truth = json.loads((shared_data / "s500" / "truth.json").read_text())
    for name, value in {**truth["longitudinal"], **truth["lateral"]}.items():
        # That simulator holds its commands for 1 ms, and its delays count half of it.
        assert T[name] == pytest.approx(value - 0.0005 if name.startswith("tau") else value, abs=1e-12), name


def test_accelerometer_reads_the_forces() -> None:
    # ax = u' + g theta: gravity drops out, and what remains are the aerodynamic terms.
    _, _, C, D = VEHICLE.system.proper()
    for output, state, force in (("ax", "u", "X"), ("ay", "v", "Y"), ("az", "w", "Z")):
        row = OUTPUTS.index(output)
        expected = [T.get(f"{force}_{name}", 0.0) for name in s500.STATES]
        np.testing.assert_allclose(C[row], expected, atol=1e-14, err_msg=state)
        np.testing.assert_allclose(D[row], [T.get(f"{force}_{axis}", 0.0) for axis in AXES], atol=1e-14)


def test_parts_answer_as_the_whole() -> None:
    omega = np.geomspace(0.1, 60.0, 30)
    whole = VEHICLE.system.response(omega)
    parts = (
        (s500.longitudinal(), ("pitch", "thrust"), ("q", "u", "w", "theta", "ax", "az")),
        (s500.lateral(), ("roll", "yaw"), ("p", "r", "v", "phi", "ay")),
    )
    for part, axes, outputs in parts:
        rows, columns = [OUTPUTS.index(name) for name in outputs], [AXES.index(axis) for axis in axes]
        np.testing.assert_allclose(part.response(omega), whole[np.ix_(rows, columns)], rtol=1e-10, atol=1e-12)


def test_closed_loop_has_margins_in_every_axis() -> None:
    """Distance of each loop, the others closed, from the critical point; 0.5 means 6 dB and 29 degrees at least."""
    omega = np.geomspace(0.01, 300.0, 4000)
    controller = VEHICLE.controller
    gains = controller.proportional[:, None] + controller.integral[:, None] / (1j * omega)
    airframe = VEHICLE.system.response(omega)[: len(MEASURED)]
    loop = -np.einsum("if,iy,yuf->fiu", gains, controller.error, airframe)
    sensitivity = np.linalg.inv(np.eye(4) + loop)
    distance = 1.0 / np.abs(np.einsum("fii->fi", sensitivity)).max(axis=0)
    assert distance.min() > 0.6


def test_closed_loop_returns_to_hover() -> None:
    """Margins say nothing without stability: encirclements of det(I + L) equal the unstable poles, counted here."""
    controller = VEHICLE.controller
    # A contour to the right of the origin, where the integrators are finite, closed at infinity where L vanishes.
    omega = np.concatenate([-np.geomspace(1e4, 1e-5, 20_000), np.geomspace(1e-5, 1e4, 20_000)])
    s = 0.02 + 1j * omega
    A, B, C, D = VEHICLE.system.proper()
    sensors = len(MEASURED)
    values, vectors = np.linalg.eig(A)
    modes = (C[:sensors] @ vectors)[None] / (s[:, None, None] - values)
    airframe = modes @ np.linalg.solve(vectors, B.astype(np.complex128)) + D[:sensors]
    airframe = airframe * np.exp(-s[:, None, None] * VEHICLE.system.input_delays_s)
    gains = controller.proportional + controller.integral / s[:, None]
    loop = -gains[:, :, None] * (controller.error @ airframe)
    angle = np.unwrap(np.angle(np.linalg.det(np.eye(4) + loop)))
    counterclockwise = (angle[-1] - angle[0]) / (2.0 * np.pi)
    # Poles right of the contour: two unstable pairs; the heading and the integrators stand left of it.
    unstable = int(np.sum(values.real > 0.02))
    assert unstable == 4
    assert round(counterclockwise) == unstable
