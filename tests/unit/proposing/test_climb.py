"""The climb loop scales by the hover thrust, and has ArduPilot's loop around the acceleration inside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import STANDARD_UNITS, Channel, FlightRecord, Source, Topic
from rotorid.errors import InsufficientDataError
from rotorid.models.autopilots.climb import acceleration_loop
from rotorid.proposing.climb import climb_plant, hover_thrust_of
from rotorid.proposing.outer import OuterMaterial, known_outer
from rotorid.tuning.plant import uncertain_plant
from rotorid.typing import ComplexArray, FloatArray

OMEGA = np.geomspace(0.5, 20.0, 12)
PSC = {"PSC_ACCZ_P": 0.5, "PSC_ACCZ_I": 1.0, "PSC_ACCZ_FLTE": 20.0}


def velocity(omega_rad_s: FloatArray) -> ComplexArray:
    """20 m/s² per unit of throttle, behind rotors of 50 ms."""
    s = 1j * omega_rad_s
    return np.asarray(20.0 / (s * (0.05 * s + 1.0)))


PLANT = uncertain_plant(velocity, None, band_rad_s=(0.5, 60.0), draws=60, floor=1e-4)


def log(hover: FloatArray | None = None) -> FlightRecord:
    """A hover of 60 s, with what PX4 estimates of its thrust."""
    time_s = np.arange(0.0, 60.0, 0.1)
    flies = (time_s > 1.0) & (time_s < 59.0)
    columns = {"thrust_command": np.where(flies, 0.5, 0.0)} | ({} if hover is None else {"hover_thrust": hover})
    channels = tuple(Channel(name=name, unit=STANDARD_UNITS[name], source=f"log.{name}") for name in columns)
    topic = Topic(name="all", time_s=time_s, channels=channels, values=np.stack(list(columns.values())))
    source = Source(name="log", format="PX4 ULog", sha256="0")
    return FlightRecord(source=source, topics=(topic,))


def test_all_flown_hover_thrusts_count() -> None:
    """Those of the estimator move the gain of the loop by their own range."""
    record = log(np.linspace(0.4, 0.6, 600))
    found = hover_thrust_of(record, {})
    assert (round(found.low, 2), round(found.usual, 2), round(found.high, 2)) == (0.41, 0.5, 0.59)
    plant = climb_plant(PLANT, record, {}, seed=0)
    assert np.allclose(plant.response(OMEGA), velocity(OMEGA) * 0.5 / 9.80665, rtol=1e-3)
    gains = np.abs(plant.drawn(OMEGA)[:, 4] / plant.response(OMEGA)[4])
    assert 0.80 < gains.min() < 0.87
    assert 1.13 < gains.max() < 1.20


def test_a_hover_thrust_that_is_set_is_exact() -> None:
    found = hover_thrust_of(log(np.full(600, 0.4)), {"MPC_USE_HTE": 0.0, "MPC_THR_HOVER": 0.55})
    assert tuple(found) == (0.55, 0.55, 0.55)


def test_the_loop_around_the_acceleration_is_closed() -> None:
    inner = acceleration_loop(PSC)
    assert inner is not None
    plant = climb_plant(PLANT, log(), PSC, seed=0)
    assert np.allclose(plant.response(OMEGA), inner.closed(velocity(OMEGA), OMEGA), rtol=1e-6)
    # Slowly, the velocity is the integral of what is asked for.
    assert abs(plant.response(np.array([0.5]))[0] * 0.5j) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("velocity_name", "position", "acceleration"),
    [("PSC_VELZ_P", "PSC_POSZ_P", "PSC_ACCZ_"), ("PSC_D_VEL_P", "PSC_D_POS_P", "PSC_D_ACC_")],
)
def test_gains_of_the_acceleration_are_refused_in_one_sentence(
    velocity_name: str, position: str, acceleration: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    gains = {velocity_name: 5.0, position: 1.0, f"{acceleration}P": 0.05, f"{acceleration}I": 0.1}
    flown = replace(log(), parameters=gains)
    monkeypatch.setattr("rotorid.proposing.outer.velocity_by_throttle", lambda *_, **__: PLANT)
    own = OuterMaterial(given=(), logs=(flown,), inner={}, draws=60, seed=0)
    _, findings = known_outer("climb", own, own)
    (kept,) = (one.message for one in findings if one.kind == "tuning_bound")
    assert kept.startswith(f"{acceleration}P and {acceleration}I stay as flown")
    assert kept.count(". ") == 0


def test_an_acceleration_loop_without_margin_is_refused_where_it_flew_and_judged_where_it_is_foreign() -> None:
    hot = {**PSC, "PSC_ACCZ_P": 8.0, "PSC_ACCZ_I": 16.0}
    with pytest.raises(InsufficientDataError, match="acceleration"):
        climb_plant(PLANT, log(), hot, seed=0)
    judged = climb_plant(PLANT, log(), hot, seed=0, judged=True)
    assert np.allclose(judged.misfits.imag.mean(), np.pi, atol=0.5)
