"""Errors of force and moment of a known vehicle, and the time outside of what was identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotorid.data.record import MotorRecord
from rotorid.fitting.flight.fit import covered
from rotorid.fitting.flight.motion import Motion, motion
from rotorid.models.flight import Airframe, felt, flight_loads
from rotorid.typing import FloatArray
from rotorid.verification.flight import (
    USUAL_OUTSIDE_PERCENT,
    differences,
    flight_loads_of,
    load_errors,
    outside_range,
    percents,
)

FRAME = Airframe(
    positions=np.array([[0.1, 0.12, 0.0], [-0.1, -0.12, 0.0], [0.1, -0.12, 0.0], [-0.1, 0.12, 0.0]]),
    spins=np.array([1.0, 1.0, -1.0, -1.0]),
    mass_kg=0.75,
    disc_m2=0.05,
)
VALUES = {"c_2": 1.9e-6, "c_lambda": 2e-4, "k_d": 4e-5, "kappa": 0.014, "J_r": 1e-5, "x_imu": 0.02}
INERTIA = {"I_xx": 2.5e-3, "I_yy": 2.1e-3, "I_zz": 4.3e-3}
RATE_HZ = 200.0


def smooth(rng: np.random.Generator, rows: int, size: float, samples: int) -> FloatArray:
    """Slow sums of sines, which filters and derivatives at 200 Hz pass."""
    time_s = np.arange(samples) / RATE_HZ
    tones = 2.0 * np.pi * rng.uniform(0.2, 2.0, (rows, 5, 1))
    return size * np.sin(tones * time_s + rng.uniform(0.0, 6.0, (rows, 5, 1))).sum(axis=1)


def flight(seed: int = 0, samples: int = 2000, size: float = 1.0) -> tuple[MotorRecord, Motion]:
    """A record whose specific force is that of the vehicle; its rates are whatever they are."""
    rng = np.random.default_rng(seed)
    record = MotorRecord(
        name="flight",
        sample_rate_hz=RATE_HZ,
        outputs=1100.0 + smooth(rng, 4, 20.0, samples),
        rates=smooth(rng, 3, 0.3, samples),
        az=np.zeros(samples),
        force=np.zeros((3, samples)),
        velocity=smooth(rng, 3, size, samples),
        attitude=smooth(rng, 3, 0.1, samples),
        between="lines",
    )
    driven = motion(record)
    loads = flight_loads(
        VALUES, FRAME, speeds=driven.speeds, velocity=driven.velocity, rates=driven.rates, spin_up=driven.spin_up
    )
    force = felt(loads, VALUES, FRAME.mass_kg, driven.rates, driven.acceleration)
    return replace(record, force=force, az=force[2]), driven


def test_the_true_vehicle_has_no_error_of_force() -> None:
    record, driven = flight()
    force, moment = differences([flight_loads_of(VALUES, FRAME, record, driven)])
    found = load_errors(force, moment)
    assert found.force_rms_n == pytest.approx(0.0, abs=1e-9)
    assert found.moment_rms_nm is None
    assert all(axis.moment_rms_nm is None for axis in found.axes.values())


def test_force_that_is_missing_is_the_error() -> None:
    record, driven = flight()
    without = {name: value for name, value in VALUES.items() if name != "k_d"}
    found = load_errors(*differences([flight_loads_of(without, FRAME, record, driven)]))
    drag = VALUES["k_d"] * driven.speeds.sum(axis=0) * driven.velocity[:2]
    # Hubs move through the air by the turning of the body too.
    assert found.axes["x"].force_rms_n == pytest.approx(float(np.sqrt(np.mean(drag[0] ** 2))), rel=0.05)
    assert found.axes["z"].force_rms_n == pytest.approx(0.0, abs=1e-9)
    lengths = [axis.force_rms_n for axis in found.axes.values()]
    assert found.force_rms_n == pytest.approx(np.sqrt(sum((length or 0.0) ** 2 for length in lengths)))


def test_a_moment_is_what_turns_the_vehicle() -> None:
    """Rates that no model made: without motors, all of the moment is an error, that of a rigid body."""
    record, driven = flight()
    still = driven._replace(speeds=np.zeros_like(driven.speeds), spin_up=np.zeros_like(driven.speeds))
    values = {"c_2": VALUES["c_2"], **INERTIA}
    part = flight_loads_of(values, FRAME, record, still)
    inertia = np.array(list(INERTIA.values()))[:, None]
    moment = inertia * driven.acceleration + np.cross(driven.rates, inertia * driven.rates, axis=0)
    assert part.axes == ("p", "q", "r")
    # Below 2 Hz nearly all passes 25 Hz; ends of a record do less.
    assert np.std(part.missed_moment) == pytest.approx(np.std(moment), rel=0.02)
    np.testing.assert_allclose(part.measured_turning, driven.acceleration)


def test_axes_without_inertia_are_no_number() -> None:
    record, driven = flight()
    found = load_errors(*differences([flight_loads_of({**VALUES, "I_yy": 2.1e-3}, FRAME, record, driven)]))
    assert [axis.moment_rms_nm is not None for axis in found.axes.values()] == [False, True, False]
    assert found.moment_rms_nm == found.axes["y"].moment_rms_nm


def test_a_flight_like_those_that_were_fitted_is_inside() -> None:
    fitted = [flight(seed) for seed in range(4)]
    tested = covered([record for record, _ in fitted], [driven for _, driven in fitted])
    share, _ = percents([outside_range(tested, record, driven) for record, driven in fitted])
    assert share < USUAL_OUTSIDE_PERCENT


def test_a_faster_flight_is_outside_and_says_by_what() -> None:
    record, driven = flight()
    fast_record, fast = flight(size=4.0)
    share, each = percents([outside_range(covered([record], [driven]), fast_record, fast)])
    assert share > 30.0
    assert each["airspeed"] > 30.0
    assert each["motors"] < USUAL_OUTSIDE_PERCENT
