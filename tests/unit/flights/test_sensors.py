"""What corrected sensors leave in responses: as much as correcting a log a little otherwise moves them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.identifying.small_logs import DURATION_S, log, topic

from rotorid.data.record import FlightRecord
from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.error_shapes import response_error_shapes
from rotorid.flights.sensors import corrected_record, with_sensor_errors
from rotorid.signal.sensor_correction import SensorCorrection
from rotorid.spectral.derived import selected

RATE_HZ = 200.0
LINES = np.arange(5, 60, 3)
OMEGA = 2.0 * np.pi * LINES / DURATION_S
SENSORS = ("p", "q", "r", "ax", "ay", "az")
# So small that products of rates do not count beside their derivatives.
SIZE = {"p": 1e-4, "q": 1e-4, "r": 1e-4, "ax": 1e-2, "ay": 1e-2, "az": 1e-2}
UNKNOWNS = (("p", "p"), ("p", "q"), ("ax", "az"), *(("accelerometer", place) for place in "xyz"))


def periodic(rng: np.random.Generator, size: float) -> np.ndarray:
    time_s = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
    phases = rng.uniform(0.0, 2.0 * np.pi, LINES.size)
    return np.asarray(size * np.sum(np.cos(np.outer(OMEGA, time_s) + phases[:, None]), axis=0))


@pytest.fixture(scope="module")
def flight() -> FlightRecord:
    rng = np.random.default_rng(0)
    channels = {"roll_command": periodic(rng, 0.1)} | {name: periodic(rng, SIZE[name]) for name in SENSORS}
    return log(topic("sensors", RATE_HZ, channels))


def response_of(record: FlightRecord, outputs: tuple[str, ...] = SENSORS) -> FrequencyResponse:
    (held,) = record.topics
    names = [channel.name for channel in held.channels]
    spectra = np.fft.rfft(held.values, axis=1)[:, LINES]
    values = np.stack([spectra[names.index(name)] / spectra[names.index("roll_command")] for name in outputs])[:, None]
    one = np.full(values.shape, 0.9)
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=values,
        coherence=one,
        random_error=0.1 * one,
        covariance=np.zeros((*values.shape, OMEGA.size)),
        inputs=("roll_command",),
        outputs=outputs,
        estimate="direct",
    )


def correction(values: np.ndarray, covariance: np.ndarray | None = None) -> SensorCorrection:
    matrix: dict[str, dict[str, float]] = {}
    place = {}
    for (sensor, term), value in zip(UNKNOWNS, values, strict=True):
        if sensor == "accelerometer":
            place[term] = float(value)
        else:
            matrix.setdefault(sensor, {})[term] = float(value)
    spread = np.zeros((0, 0)) if covariance is None else covariance
    return SensorCorrection(
        matrix=matrix, place_m=place, unknowns=UNKNOWNS if covariance is not None else (), covariance=spread
    )


@pytest.mark.parametrize("place", range(len(UNKNOWNS)))
def test_an_error_moves_responses_as_it_says(flight: FlightRecord, place: int) -> None:
    """A correction that is one standard deviation off, against the one shape that an error of its own has."""
    small = np.zeros(len(UNKNOWNS))
    small[place] = 1e-3
    before = response_of(corrected_record(flight, correction(np.zeros(len(UNKNOWNS)))))
    after = response_of(corrected_record(flight, correction(small)))
    told = with_sensor_errors(before, correction(np.zeros(len(UNKNOWNS)), np.diag(small**2)))
    assert told.sensor_shapes is not None
    shape = told.sensor_shapes[np.abs(told.sensor_shapes).max(axis=(1, 2, 3)) > 0.0]
    assert len(shape) == 1
    moved = (after.values - before.values) / before.values
    sign = np.sign(np.vdot(shape[0], moved).real)
    # Derivatives by splines, whose ends are not periodic, are good to some parts in a thousand.
    np.testing.assert_allclose(sign * shape[0], moved, atol=0.01 * np.abs(moved).max())


def test_errors_that_go_together_stay_together(flight: FlightRecord) -> None:
    rng = np.random.default_rng(1)
    root = 1e-3 * rng.standard_normal((len(UNKNOWNS),) * 2)
    before = response_of(flight)
    told = with_sensor_errors(before, correction(np.zeros(len(UNKNOWNS)), root @ root.T)).sensor_shapes
    alone = [
        with_sensor_errors(before, correction(np.zeros(len(UNKNOWNS)), np.diag(row))).sensor_shapes
        for row in np.eye(len(UNKNOWNS))
    ]
    slopes = np.stack([one[np.abs(one).max(axis=(1, 2, 3)).argmax()] for one in alone if one is not None])
    assert told is not None
    wanted = np.einsum("nyuf,nm,mzuf->yzuf", slopes, root @ root.T, slopes.conj())
    # Each alone has a sign of its own, which the eigenvectors choose: here all are positive.
    np.testing.assert_allclose(np.einsum("kyuf,kzuf->yzuf", told, told.conj()), wanted, rtol=1e-9, atol=1e-18)


def test_a_response_of_other_channels_has_no_such_errors(flight: FlightRecord) -> None:
    other = replace(response_of(flight, ("p",)), outputs=("phi",))
    known = correction(np.zeros(len(UNKNOWNS)), np.eye(len(UNKNOWNS)))
    assert with_sensor_errors(other, known).sensor_shapes is None
    assert with_sensor_errors(response_of(flight), correction(np.zeros(len(UNKNOWNS)))).sensor_shapes is None


def test_selected_responses_keep_them(flight: FlightRecord) -> None:
    known = correction(np.zeros(len(UNKNOWNS)), 1e-6 * np.eye(len(UNKNOWNS)))
    whole = with_sensor_errors(response_of(flight), known)
    part = selected(whole, outputs=["az", "p"], band_rad_s=(OMEGA[2], OMEGA[6]))
    assert whole.sensor_shapes is not None
    np.testing.assert_array_equal(part.sensor_shapes, whole.sensor_shapes[:, [5, 0], :, 2:7])


def test_shapes_of_the_wrong_size_are_refused(flight: FlightRecord) -> None:
    with pytest.raises(ValueError, match="sensor_shapes"):
        replace(response_of(flight), sensor_shapes=np.zeros((2, 1, 1, OMEGA.size)))


def test_they_stand_in_the_errors_of_a_fit() -> None:
    """A scale of 2 % moves every magnitude by 0.02, a turn of the phase every phase."""
    count, zeros = 20, np.zeros(20, dtype=int)
    shapes = response_error_shapes(
        np.geomspace(1.0, 30.0, count),
        zeros,
        zeros,
        np.full(2 * count, 3.0),
        outputs=("p",),
        inputs=("roll_command",),
        clock_error_s=None,
        sensor_shapes=np.stack([np.full(count, 0.02 + 0.0j), np.full(count, 0.01j)]),
    )
    # Behind the scales of input and output.
    np.testing.assert_allclose(shapes.known[:, 2], np.repeat([0.06, 0.0], count))
    np.testing.assert_allclose(shapes.known[:, 3], np.repeat([0.0, 0.03], count))
