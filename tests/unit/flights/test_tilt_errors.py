"""How far a vehicle leant while an input moved at a frequency, and what that makes of its responses."""

from __future__ import annotations

import numpy as np

from rotorid.data.record import Channel, FlightRecord, Maneuver, Source, TimeHistory, Topic
from rotorid.data.response import FrequencyResponse
from rotorid.fitting.frequency.error_shapes import response_error_shapes
from rotorid.flights.flights import Flight
from rotorid.flights.tilt_errors import with_tilt_errors
from rotorid.results.segment import Segment
from rotorid.typing import FloatArray

RATE_HZ, DURATION_S = 50.0, 80.0
TIME_S = np.arange(0.0, DURATION_S, 1.0 / RATE_HZ)
SWEEP = Maneuver(axis="roll", kind="sweep", start_s=0.0, stop_s=DURATION_S)
OMEGA = np.geomspace(1.5, 20.0, 30)


def chirp() -> FloatArray:
    """From 1 to 30 rad/s."""
    phase = DURATION_S / np.log(30.0) * (30.0 ** (TIME_S / DURATION_S) - 1.0)
    return np.asarray(np.sin(phase))


def flown(angles: tuple[str, ...] = ("phi", "theta")) -> tuple[list[Flight], list[Segment]]:
    """A roll sweep whose lean falls from 0.4 rad to nothing, about a trim of 0.2 rad in pitch."""
    values = {"phi": 0.4 * (1.0 - TIME_S / DURATION_S) * chirp(), "theta": np.full(TIME_S.size, 0.2)}
    channels = tuple(Channel(name=name, unit="rad") for name in angles)
    topic = Topic(name="attitude", time_s=TIME_S, channels=channels, values=np.stack([values[name] for name in angles]))
    record = FlightRecord(source=Source(name="a.csv", format="CSV", sha256="0"), topics=(topic,))
    command = Channel(name="roll_command", unit="1")
    history = TimeHistory(values=[chirp()], channels=(command,), sample_rate_hz=RATE_HZ, start_s=0.0)
    return [Flight(record, SWEEP)], [Segment(record="a.csv", maneuver=SWEEP, history=history)]


def response(source: str = "roll_command") -> FrequencyResponse:
    ones = np.ones((1, 1, OMEGA.size))
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=ones.astype(np.complex128),
        coherence=0.99 * ones,
        random_error=0.01 * ones,
        covariance=1e-4 * np.eye(OMEGA.size)[None, None].astype(np.complex128),
        inputs=(source,),
        outputs=("p",),
        estimate="direct",
    )


def test_half_the_square_of_a_swing_stands_where_it_was() -> None:
    """A window of three periods sees a third of an octave around, and a sweep stays longer below than above."""
    known = with_tilt_errors(response(), *flown(), factor=1.0).lean_errors
    assert known is not None
    for omega in (3.0, 8.0):
        at = float(np.interp(np.log(omega), np.log(OMEGA), known[0]))
        assert expected(omega) < at < expected(omega / 2.0 ** (1.0 / 3.0))


def expected(omega_rad_s: float) -> float:
    """Of the swing with which the sweep passed a frequency."""
    swing = 0.4 * (1.0 - np.log(omega_rad_s) / np.log(30.0))
    return float(0.6 * 0.5 * swing**2)


def test_it_is_as_much_as_thrust_bends() -> None:
    plain = response()
    whole, half = (with_tilt_errors(plain, *flown(), factor=factor).lean_errors for factor in (1.0, 0.5))
    assert whole is not None
    assert half is not None
    np.testing.assert_allclose(half, 0.5 * whole)
    assert with_tilt_errors(plain, *flown(), factor=0.0) is plain


def test_without_attitude_or_command_nothing_is_known() -> None:
    plain, asked = response(), response("phi_setpoint")
    assert with_tilt_errors(plain, *flown(("theta",)), factor=1.0) is plain
    # Pitch rests at its trim, so that roll alone shows all of the lean.
    found, whole = (with_tilt_errors(plain, *flown(angles), factor=1.0) for angles in (("phi",), ("phi", "theta")))
    assert found.lean_errors is not None
    assert whole.lean_errors is not None
    np.testing.assert_allclose(found.lean_errors, whole.lean_errors)
    assert with_tilt_errors(asked, *flown(), factor=1.0) is asked


def test_magnitude_and_phase_of_each_response_err_by_themselves() -> None:
    omega, nothing = np.tile(OMEGA, 2), np.zeros(2 * OMEGA.size, dtype=np.int64)
    output = np.repeat([0, 1], OMEGA.size)
    lean = 0.05 / omega
    scale = np.concatenate([np.full(omega.size, 2.0), np.full(omega.size, 3.0)])
    shapes = response_error_shapes(
        omega, output, nothing, scale, outputs=["p", "phi"], inputs=["roll"], clock_error_s=None, lean_errors=lean
    )
    first = (output == 0) * lean
    # Behind the scales of one input and two outputs.
    np.testing.assert_allclose(shapes.known[:, 3], np.concatenate([2.0 * first, 0.0 * first]))
    np.testing.assert_allclose(shapes.known[:, 4], np.concatenate([0.0 * first, 3.0 * first]))
    assert shapes.known.shape == (4 * OMEGA.size, 3 + 4)
