"""What physics allows of identified motor constants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.findings import Finding
from rotorid.data.record import MotorRecord
from rotorid.errors import ModelError
from rotorid.models.motors import check_figure_of_merit, check_motor_constants, yaw_range

LEVERS = np.array([[-0.2, 0.2, 0.2, -0.2], [0.2, -0.2, 0.2, -0.2], [1.0, 1.0, -1.0, -1.0]])
SOUND: Mapping[str, float] = {"m": 1.0, "c_1": 5.0, "I_xx": 0.02, "I_yy": 0.025, "I_zz": 0.04, "kappa": 0.02}


def hover(output: float = 9.80665 / 20.0, swing: float = 0.1) -> MotorRecord:
    outputs = output + swing * np.sin(np.linspace(0.0, 20.0 * np.pi, 400, endpoint=False))
    return MotorRecord(
        name="hover",
        sample_rate_hz=100.0,
        outputs=np.tile(outputs, (4, 1)),
        rates=np.zeros((3, 400)),
        az=np.full(400, -9.81),
    )


def kinds(values: Mapping[str, float], **given: object) -> list[tuple[str, str, str]]:
    found = check_motor_constants(values, records=[hover()], levers=LEVERS, **given)  # type: ignore[arg-type]
    return [(finding.kind, finding.severity, finding.where) for finding in found]


def test_a_sound_vehicle_passes() -> None:
    assert kinds(SOUND) == []


@pytest.mark.parametrize(
    ("changed", "kind", "where"),
    [
        ({"I_xx": -0.02}, "impossible_physics", "I_xx"),
        ({"I_zz": 0.05}, "impossible_physics", "I_zz"),
        ({"I_yy": 0.07, "I_zz": 0.06}, "implausible_physics", "I_yy"),
        ({"c_1": 5.6}, "implausible_physics", "thrust"),
        ({"c_1": 6.1}, "impossible_physics", "thrust"),
        ({"c_1": 3.9}, "impossible_physics", "thrust"),
        ({"c_0": 5.0, "c_1": -5.2}, "impossible_physics", "thrust"),
    ],
)
def test_each_check_sees_what_it_is_for(changed: Mapping[str, float], kind: str, where: str) -> None:
    assert (kind, where) in {(kind, where) for kind, _, where in kinds({**SOUND, **changed})}


def test_an_excess_within_the_interval_is_no_warning() -> None:
    flat = {**SOUND, "I_zz": 0.0451}
    assert ("impossible_physics", "warning", "I_zz") in kinds(flat)
    wide = {("I_zz", "I_zz"): 0.001**2}
    assert kinds(flat, covariance=wide) == [("impossible_physics", "info", "I_zz")]
    together = {**wide, ("I_xx", "I_xx"): 0.001**2, ("I_xx", "I_zz"): 0.001**2}
    assert ("impossible_physics", "warning", "I_zz") in kinds(flat, covariance=together)


@pytest.mark.parametrize(("largest", "weights"), [(2.0, "0.82"), (40.0, "16")])
def test_thrust_at_full_output(largest: float, weights: str) -> None:
    (finding,) = check_motor_constants({"m": 1.0, "c_1": largest})
    assert finding.message == f"Four rotors at full output lift {weights} weights: plausible are 1.2 to 15."
    assert check_motor_constants({"m": 1.0, "c_1": largest}, full_output=None) == []


def test_a_curve_that_bends_down_outside_of_what_was_flown_passes() -> None:
    values = {"m": 1.0, "c_0": 2.4025, "c_1": -5.0, "c_2": 10.1}
    assert ("impossible_physics", "warning", "thrust") not in kinds(values)


def test_a_published_curve_that_falls_where_motors_idle_passes() -> None:
    """Of the Crazyflie: N by its share of full output, falling below 0.0465, where nobody flies."""
    published = {"m": 0.0335, "c_0": 0.02272, "c_1": -0.01194, "c_2": 0.12837}
    flown = hover(output=0.66)
    idle = replace(flown, outputs=np.where(np.arange(400) % 5 == 0, 0.03, flown.outputs))
    assert not falling(check_motor_constants(published, records=[idle]))
    assert falling(check_motor_constants({**published, "c_1": -0.2}, records=[idle]))
    assert not falling(check_motor_constants(published, records=[replace(flown, outputs=np.full((4, 400), 0.02))]))


def test_speeds_are_small_by_the_largest_of_them() -> None:
    flown = hover(output=600.0, swing=100.0)
    slow = replace(flown, outputs=np.where(np.arange(400) % 5 == 0, 20.0, flown.outputs))
    values = {"c_0": 1.0, "c_1": -1e-3, "c_2": 1e-5}
    assert not falling(check_motor_constants(values, records=[slow], full_output=None))
    assert falling(check_motor_constants({**values, "c_1": -0.011}, records=[slow], full_output=None))


def test_a_slope_that_may_be_positive_is_no_warning() -> None:
    values = {**SOUND, "c_0": 5.0, "c_1": -5.2}
    assert falling(check_motor_constants(values, records=[hover()]))
    assert falling(check_motor_constants(values, records=[hover()], covariance={("c_1", "c_1"): 2.6**2}))
    assert not falling(check_motor_constants(values, records=[hover()], covariance={("c_1", "c_1"): 2.7**2}))
    # Coefficients that are uncertain together, so that their sum is not: at an output of 0.5 both count alike.
    level = replace(hover(swing=0.0), outputs=np.full((4, 400), 0.5))
    opposed = {("c_1", "c_1"): 2.7**2, ("c_2", "c_2"): 2.7**2, ("c_1", "c_2"): -(2.7**2)}
    assert falling(check_motor_constants(values, records=[level], covariance=opposed))


def falling(findings: Sequence[Finding]) -> bool:
    return any("falls with the output" in finding.message for finding in findings)


@pytest.mark.parametrize(("load_factor", "climb_m_s"), [(1.0, 0.0), (1.16, 0.0), (2.4, 0.0), (1.0, 4.0), (1.0, -4.0)])
def test_thrust_is_compared_with_the_measured_force(load_factor: float, climb_m_s: float) -> None:
    """Turns and climbs carry more than the weight; what the accelerometer shows decides."""
    damping, gravity = -0.4, 9.80665
    force = gravity * load_factor - damping * climb_m_s
    flown = hover(output=force / 20.0)
    flown = replace(flown, az=np.full(400, -gravity * load_factor), w=np.full(400, -climb_m_s))
    sound = {**SOUND, "Z_w": damping}
    assert check_motor_constants(sound, records=[flown], levers=LEVERS) == []
    (heavy,) = check_motor_constants({"m": 0.75, "c_1": 5.0, "Z_w": damping}, records=[flown])
    assert (heavy.kind, heavy.severity) == ("impossible_physics", "warning")
    assert heavy.numbers["thrust_per_force"] == pytest.approx(1.0 / 0.75, rel=0.06)
    assert "mass and the time stamps" in heavy.message


def test_an_accelerometer_without_gravity_is_named() -> None:
    (finding,) = check_motor_constants({"m": 1.0, "c_1": 5.0}, records=[replace(hover(), az=np.full(400, 0.1))])
    assert finding.message.startswith("The mean specific force along z is 0.1 m/s^2, but the rotors lift")


def test_a_weak_battery_lifts_less() -> None:
    record = hover()
    weak = MotorRecord(
        name="weak",
        sample_rate_hz=100.0,
        outputs=record.outputs,
        rates=record.rates,
        az=record.az,
        strength=np.full(400, 0.8),
    )
    (finding,) = check_motor_constants(SOUND, records=[weak])
    assert finding.numbers["thrust_per_weight"] == pytest.approx(0.8)
    assert finding.numbers["thrust_per_force"] == pytest.approx(0.8, rel=1e-3)


def test_figure_of_merit() -> None:
    # 3.68 N by a disk of 0.25 m: 5.53 m/s of induced speed.
    sound = {"m": 1.5, "kappa": 0.016}
    assert check_figure_of_merit(sound, speed_rad_s=560.0, rotor_diameter_m=0.25) == []
    (wasteful,) = check_figure_of_merit({**sound, "kappa": 0.06}, speed_rad_s=560.0, rotor_diameter_m=0.25)
    assert (wasteful.kind, wasteful.severity) == ("implausible_physics", "info")
    (free,) = check_figure_of_merit({**sound, "kappa": 0.001}, speed_rad_s=560.0, rotor_diameter_m=0.25)
    assert (free.kind, free.severity) == ("impossible_physics", "warning")
    expected = np.sqrt(1.5 * 9.80665 / 4.0 / (2.0 * 1.225 * np.pi * 0.125**2)) / (0.001 * 560.0)
    assert free.numbers["figure_of_merit"] == pytest.approx(expected)
    assert check_figure_of_merit({"m": 1.5}, speed_rad_s=560.0, rotor_diameter_m=0.25) == []


def test_yaw_is_bounded_where_it_is_not_known() -> None:
    found = yaw_range({"I_xx": 0.02, "I_yy": 0.03, "kappa_per_I_zz": 0.5})
    assert found.I_zz == pytest.approx((0.01, 0.05))
    assert found.kappa == pytest.approx((0.005, 0.025))
    turned = yaw_range({"I_xx": 0.02, "I_yy": 0.03, "kappa_per_I_zz": -0.5})
    assert turned.kappa == pytest.approx((-0.025, -0.005))
    with pytest.raises(ModelError, match="kappa_per_I_zz did not come"):
        yaw_range({"I_xx": 0.02, "I_yy": 0.03})
