"""Errors planted into the sensors of a motion that is known exactly come back, as well known as is stated."""

from __future__ import annotations

import numpy as np
import pytest

from rotorid.data.axes import ATTITUDE, RATES
from rotorid.data.record import STANDARD_UNITS, Channel, TimeHistory
from rotorid.errors import InsufficientDataError
from rotorid.signal.kinematics import ACCELERATIONS, VELOCITIES, derivative
from rotorid.signal.sensor_correction import (
    SensorCorrection,
    corrected_values,
    correction_findings,
    estimate_correction,
)
from rotorid.typing import FloatArray

SAMPLE_RATE_HZ, DURATION_S = 200.0, 90.0
SCALE, BIAS, ANGLE, PLACE = 0.02, 0.05, np.radians(2.0), (0.015, -0.01, 0.015)
TURN = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(ANGLE), np.sin(ANGLE)], [0.0, -np.sin(ANGLE), np.cos(ANGLE)]])
TRUTH = {
    **{f"scale of {name}": SCALE for name in (*RATES, *ACCELERATIONS)},
    **{f"bias of {name}": BIAS for name in (*RATES, *ACCELERATIONS)},
    "r in q": np.sin(ANGLE),
    "q in r": -np.sin(ANGLE),
    "az in ay": np.sin(ANGLE),
    "ay in az": -np.sin(ANGLE),
    **{f"{axis} of accelerometer": meters for axis, meters in zip("xyz", PLACE, strict=True)},
}


def flown(seed: int, *, still: tuple[str, ...] = (), planted: bool = True) -> TimeHistory:
    """Angles and velocities of many sines, the rates and forces that follow, and sensors with errors and noise."""
    rng = np.random.default_rng(seed)
    count = int(DURATION_S * SAMPLE_RATE_HZ)
    time_s = np.arange(count) / SAMPLE_RATE_HZ

    def wave(size: float, low: float, high: float) -> FloatArray:
        omega = np.geomspace(low, high, 25)
        phases = rng.uniform(0.0, 2.0 * np.pi, omega.size)
        return np.asarray(size * np.sqrt(0.08) * np.sin(omega[:, None] * time_s + phases[:, None]).sum(axis=0))

    sizes = {"phi": (0.15, 8.0), "theta": (0.15, 8.0), "psi": (0.2, 3.0)}
    sizes |= {"u": (1.5, 2.5), "v": (1.5, 2.5), "w": (0.6, 4.0)}
    moved = {name: wave(0.0 if name in still else size, 0.5, high) for name, (size, high) in sizes.items()}
    slope = {name: derivative(values, SAMPLE_RATE_HZ) for name, values in moved.items()}
    phi, theta = moved["phi"], moved["theta"]
    rates = np.stack(
        [
            slope["phi"] - slope["psi"] * np.sin(theta),
            slope["theta"] * np.cos(phi) + slope["psi"] * np.cos(theta) * np.sin(phi),
            slope["psi"] * np.cos(theta) * np.cos(phi) - slope["theta"] * np.sin(phi),
        ]
    )
    velocity, acceleration = (np.stack([values[name] for name in VELOCITIES]) for values in (moved, slope))
    down = np.stack([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    force = acceleration + np.cross(rates, velocity, axis=0) - 9.80665 * down
    if planted:
        turning = np.stack([derivative(row, SAMPLE_RATE_HZ) for row in rates])
        place = np.array(PLACE)[:, None] * np.ones(count)
        inward = np.cross(rates, np.cross(rates, place, axis=0), axis=0)
        force = force + np.cross(turning, place, axis=0) + inward
        rates, force = ((1.0 + SCALE) * TURN @ values + BIAS for values in (rates, force))
    noise = [0.004, 0.05, 0.0005, 0.005]
    angles = np.stack([moved[name] for name in ATTITUDE])
    shown = [
        values + size * rng.standard_normal(values.shape)
        for values, size in zip((rates, force, angles, velocity), noise, strict=True)
    ]
    names = (*RATES, *ACCELERATIONS, *ATTITUDE, *VELOCITIES)
    return TimeHistory(
        values=np.vstack(shown),
        sample_rate_hz=SAMPLE_RATE_HZ,
        start_s=0.0,
        channels=tuple(Channel(name=name, unit=STANDARD_UNITS[name]) for name in names),
    )


@pytest.fixture(scope="module")
def corrections() -> list[SensorCorrection]:
    return [estimate_correction([flown(seed)]) for seed in range(4)]


def test_planted_errors_come_back_as_well_as_is_stated(corrections: list[SensorCorrection]) -> None:
    distances = np.array([[(t.value - TRUTH.get(t.name, 0.0)) / t.std for t in one.terms] for one in corrections])
    assert distances.shape[1] == 3 * 3 + 3 * 3 + 6 + 3
    # Some hundred distances of a normal distribution: 5 % beyond two, and hardly one beyond four.
    assert np.mean(np.abs(distances) > 2.0) < 0.1
    assert np.abs(distances).max() < 4.0
    assert np.sqrt(np.mean(distances**2)) == pytest.approx(1.0, abs=0.3)
    found = {term.name: term for term in corrections[0].terms}
    for name, largest in (("scale of q", 2e-3), ("r in q", 2e-3), ("bias of q", 1e-3), ("z of accelerometer", 2e-3)):
        assert found[name].value == pytest.approx(TRUTH[name], abs=largest)


def test_corrected_sensors_are_those_without_errors(corrections: list[SensorCorrection]) -> None:
    wrong, right = flown(0), flown(0, planted=False)
    measured = {name: wrong[name] for name in wrong.names}
    rates = {name: corrected_values(corrections[0], name, measured) for name in RATES}
    slopes = {f"{name}_dot": derivative(values, SAMPLE_RATE_HZ) for name, values in rates.items()}
    for name in RATES:
        assert np.std(rates[name] - right[name]) < 2e-3
        assert abs(np.mean(rates[name] - right[name])) < 1e-3
    for name in ACCELERATIONS:
        corrected = corrected_values(corrections[0], name, {**measured, **rates, **slopes})
        assert np.std(corrected - right[name]) < 0.05


def test_what_was_not_flown_is_not_corrected() -> None:
    """In a flight of pitch alone nothing tells the scale of the other rates, nor what they would leak."""
    correction = estimate_correction([flown(1, still=("phi", "psi", "v"))])
    found = {term.name: term for term in correction.terms}
    assert found["scale of q"].value == pytest.approx(SCALE, abs=3.0 * found["scale of q"].std)
    assert {"scale of p", "scale of r", "p in q", "r in q"} <= set(correction.left)
    assert "p" not in correction.matrix.get("q", {})
    said = [finding.kind for finding in correction_findings(correction)]
    assert said[-1] == "sensor_not_corrected"
    assert said.count("sensor_corrected") == len(correction.terms)


def test_one_plane_of_channels_is_enough_for_its_sensors() -> None:
    whole = flown(2, still=("phi", "psi", "v"))
    rows = [whole.names.index(name) for name in ("q", "theta", "u", "w", "ax", "az")]
    plane = TimeHistory(
        values=whole.values[rows],
        sample_rate_hz=SAMPLE_RATE_HZ,
        start_s=0.0,
        channels=tuple(whole.channels[row] for row in rows),
    )
    found = {term.name: term for term in estimate_correction([plane]).terms}
    for name in ("scale of q", "scale of ax"):
        # Of a rotation about x only its cosine is in the plane.
        assert found[name].value == pytest.approx(1.02 * (np.cos(ANGLE) if name.endswith("q") else 1.0) - 1.0, abs=2e-3)
    assert found["z of accelerometer"].value == pytest.approx(PLACE[2], abs=2e-3)


def test_sensors_without_anything_to_compare_are_refused() -> None:
    whole = flown(3)
    rows = [whole.names.index(name) for name in RATES]
    alone = TimeHistory(
        values=whole.values[rows], sample_rate_hz=SAMPLE_RATE_HZ, start_s=0.0, channels=whole.channels[:3]
    )
    with pytest.raises(InsufficientDataError, match="sensors cannot be corrected"):
        estimate_correction([alone])
