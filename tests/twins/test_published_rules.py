"""Published rules: their printed margins, their plant found again, and where the limit of stability lies."""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.rules import (
    IntegratingPlant,
    amigo,
    integrating_plant,
    px4_angle,
    px4_autotune,
    quicktune,
    simc,
    with_angle,
)

from rotorid.models.controller import RateController
from rotorid.tuning import ControllerParts, Gains, loop_figures

OMEGA = np.geomspace(0.5, 600.0, 1200)
PLANT = IntegratingPlant(gain=1.0, lag_s=0.05, delay_s=0.02)


def parts(**fields: float) -> ControllerParts:
    ones = np.ones(OMEGA.size, dtype=np.complex128)
    controller = RateController(proportional_s=1.0, integral=1.0, derivative_s2=0.01, angle_1_s=1.0, **fields)
    return ControllerParts(controller=controller, omega_rad_s=OMEGA, filters=ones, logged=ones)


# Lambda; crossover times delay, phase margin in degrees, gain margin in dB and M_s, as printed.
PRINTED = [
    (1.0, 0.515, 46.9, 9.4, 1.70),
    (1.5, 0.412, 52.8, 11.5, 1.50),
    (2.0, 0.343, 56.7, 13.1, 1.39),
    (3.0, 0.257, 61.6, 15.7, 1.27),
]


@pytest.mark.parametrize(("wish", "crossover", "phase", "gain_db", "peak"), PRINTED)
def test_simc_has_its_printed_margins(wish: float, crossover: float, phase: float, gain_db: float, peak: float) -> None:
    gains = Gains(**dict(zip("PID", simc(PLANT, wish), strict=True)), A=0.0)
    found = loop_figures(OMEGA, (PLANT.response(OMEGA) * parts().rate(gains))[None])
    assert float(found.crossover_rad_s[0]) * PLANT.delay_s == pytest.approx(crossover, abs=0.001)
    assert float(np.degrees(found.phase_margin_rad[0])) == pytest.approx(phase, abs=0.06)
    assert 20.0 * np.log10(float(found.gain_margin[0])) == pytest.approx(gain_db, abs=0.06)
    assert float(found.sensitivity_peak[0]) == pytest.approx(peak, abs=0.006)


def test_amigo_is_soft() -> None:
    """Of an integrator that is late its M_s is about 1.3 with the filters of a real loop; here it has none."""
    late = IntegratingPlant(gain=1.0, lag_s=1e-4, delay_s=0.07)
    gains = Gains(**dict(zip("PID", amigo(late), strict=True)), A=0.0)
    found = loop_figures(OMEGA, (late.response(OMEGA) * parts(derivative_cutoff_hz=20.0).rate(gains))[None])
    assert float(found.sensitivity_peak[0]) < 1.5
    assert bool(found.stable[0])


def test_the_simple_plant_of_a_vehicle_is_near_it() -> None:
    near = OMEGA[(OMEGA > 10.0) & (OMEGA < 60.0)]
    damped = 113.1 / ((0.048j * near + 1.0) * (1j * near + 1.0)) * np.exp(-0.012j * near)
    found = integrating_plant(near, damped)
    assert found.gain == pytest.approx(113.1, rel=0.05)
    assert found.lag_s == pytest.approx(0.048, rel=0.15)
    assert np.abs(found.response(near) / damped - 1.0).max() < 0.12


def test_px4_autotune_is_calm_on_a_usual_quadrotor() -> None:
    """Its own checks: gain below 0.5, integral below 10, slope below 0.1; M_s about 1.2 to 1.6."""
    plant = IntegratingPlant(gain=113.1, lag_s=0.048, delay_s=0.012)
    slow = (np.pi < OMEGA) & (80.0 * np.pi > OMEGA)
    p, i, d = px4_autotune(plant.response(OMEGA[slow]), OMEGA[slow], step_s=0.00625)
    assert 0.0 < p < 0.5
    assert 0.0 < i / p < 10.0
    assert 0.0 <= d / p < 0.1
    loop = plant.response(OMEGA) * parts(derivative_cutoff_hz=20.0).rate(Gains(P=p, I=i, D=d, A=0.0))
    found = loop_figures(OMEGA, loop[None])
    assert bool(found.stable[0])
    assert 1.1 < float(found.sensitivity_peak[0]) < 1.8
    assert 2.0 <= px4_angle(p) <= 6.5


def test_quicktune_is_two_fifths_of_the_limit() -> None:
    """Of an integrator with a delay the limit of P is pi / (2 k theta)."""
    late = IntegratingPlant(gain=1.0, lag_s=1e-4, delay_s=0.02)
    found = quicktune(parts(), late.response(OMEGA), Gains(P=10.0, I=1e-3, D=0.0, A=4.0))
    assert pytest.approx(0.4 * np.pi / (2.0 * 0.0201), rel=0.06) == found.P
    assert (found.I, found.A) == (found.P, 4.0)


def test_the_angle_gain_is_a_quarter_of_the_crossover() -> None:
    gains = with_angle(simc(PLANT), parts(), PLANT.response(OMEGA))
    assert pytest.approx(0.515 / 0.02 / 4.0, rel=0.01) == gains.A
