"""Two simulators agree: flights of PX4's and ArduPilot's own, flown again by ours and measured by the same verb.

What this shows, and what not: thrust, drag and damping of our ArduPilot vehicle were measured in the flights in calm
air that it is compared with here, roll and thrust. There the comparison tests the way of the simulation (loops,
filters, delays, logs) with numbers that fit; the flights in wind, pitch and yaw were not used for them. PX4's vehicle
has the parameters of its own simulator, but for the filter of the gyroscopes.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.reference.two_simulators import (
    SAMPLE_RATE_HZ,
    flown_again_ardupilot,
    flown_again_px4,
    flown_setpoints_ardupilot,
    signal,
)

import rotorid
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.loops.responses import Responses
from rotorid.settings.measuring import ResponseSettings
from rotorid.simulation.wind import CALM, Wind
from rotorid.typing import Axis, BoolArray, FloatArray
from rotorid.verification.scores import theil_inequality

DECIBELS, DEGREES, COHERENCE = 0.5, 3.0, 0.8

KNOWN = 0.02
"""Random error up to which a response of the other simulator's log can be held against the bars: 0.17 dB and 1.1°."""


class Sweep(NamedTuple):
    log: str
    axis: Axis
    output: str
    start_s: float
    stop_s: float
    band_rad_s: tuple[float, float]
    wind: Wind = CALM


PX4 = (
    Sweep("roll.ulg", "roll", "p", 40.54, 122.40, (0.6, 50.0)),
    Sweep("pitch.ulg.xz", "pitch", "q", 39.60, 121.30, (0.6, 50.0)),
    Sweep("yaw.ulg.xz", "yaw", "r", 39.60, 111.20, (0.6, 31.0)),
    Sweep("thrust.ulg.xz", "thrust", "az", 39.60, 111.20, (1.3, 38.0)),
)
BREEZE = Wind(north_m_s=5.0, turbulence_m_s=1.5)
ARDUPILOT = (
    Sweep("x_calm_roll.BIN", "roll", "p", 94.85, 186.33, (0.63, 125.0)),
    Sweep("x_wind_rollpitch.BIN.xz", "pitch", "q", 194.40, 275.89, (0.63, 125.0), BREEZE),
    Sweep("x_wind_yawthrust.BIN.xz", "yaw", "r", 94.81, 176.29, (0.63, 62.0), BREEZE),
    Sweep("x_calm_thrust.BIN.xz", "thrust", "az", 94.91, 186.40, (1.26, 62.0)),
)


def measured(record: FlightRecord, sweep: Sweep) -> Responses:
    given = Maneuver(axis=sweep.axis, kind="sweep", start_s=sweep.start_s, stop_s=sweep.stop_s, origin="given")
    return rotorid.response(
        [record],
        inputs=[f"{sweep.axis}_command"],
        outputs=[sweep.output],
        settings=ResponseSettings(segments=(given,)),
    )


class Difference(NamedTuple):
    """Where both are coherent inside of the excited band: ours against theirs, and how well theirs is known."""

    omega_rad_s: FloatArray
    decibels: FloatArray
    degrees: FloatArray
    random_error: FloatArray

    @property
    def known(self) -> BoolArray:
        return np.asarray(self.random_error <= KNOWN)


def difference(theirs: Responses, ours: Responses, band_rad_s: tuple[float, float]) -> Difference:
    low = max(band_rad_s[0], *(one.response.omega_rad_s[one.used[0, 0]][0] for one in (theirs, ours)))
    high = min(band_rad_s[1], *(one.response.omega_rad_s[one.used[0, 0]][-1] for one in (theirs, ours)))
    omega = np.geomspace(low, high, 60)

    def read_off(found: Responses, name: str) -> FloatArray:
        response = found.response
        values = {
            "size": lambda: np.log(np.abs(response.values[0, 0])),
            "phase": lambda: np.unwrap(np.angle(response.values[0, 0])),
            "coherence": lambda: response.coherence[0, 0],
            "error": lambda: response.random_error[0, 0],
        }[name]()
        return np.interp(np.log(omega), np.log(response.omega_rad_s), values)

    both = np.minimum(read_off(theirs, "coherence"), read_off(ours, "coherence")) > COHERENCE
    size = read_off(ours, "size") - read_off(theirs, "size")
    phase = np.angle(np.exp(1j * (read_off(ours, "phase") - read_off(theirs, "phase"))))
    return Difference(
        omega[both],
        20.0 * np.log10(np.e) * size[both],
        np.degrees(phase[both]),
        read_off(theirs, "error")[both],
    )


@pytest.fixture(scope="module")
def flown_again(
    unpacked: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory
) -> Callable[[Sweep], Difference]:
    """Each sweep flown again once."""
    known: dict[Sweep, Difference] = {}

    def of(sweep: Sweep) -> Difference:
        if sweep in known:
            return known[sweep]
        folder = tmp_path_factory.mktemp("again")
        if sweep in PX4:
            record = rotorid.read(unpacked(f"px4_sitl/{sweep.log}"))
            again = flown_again_px4(record, sweep.start_s - 0.5, sweep.stop_s + 0.2, folder / "again.ulg")
        else:
            record = rotorid.read(unpacked(f"ardupilot_sitl/{sweep.log}"))
            span_s = (sweep.start_s - 3.0, sweep.stop_s + 3.0)
            again = flown_again_ardupilot(record, sweep.axis, *span_s, folder / "again.BIN", sweep.wind)
        known[sweep] = difference(measured(record, sweep), measured(again, sweep), sweep.band_rad_s)
        return known[sweep]

    return of


def name_of(sweep: Sweep) -> str:
    return f"{'px4' if sweep in PX4 else 'ardupilot'}-{sweep.axis}"


ROUTINE = (PX4[0], PX4[3], ARDUPILOT[0])
"""One axis of rotation of each simulator, and thrust; doublets of every axis are flown again each time, and in the
studies the other sweeps too."""


def marks(sweep: Sweep, *others: pytest.MarkDecorator) -> list[pytest.MarkDecorator]:
    return [*others, *([] if sweep in ROUTINE else [pytest.mark.slow])]


@pytest.mark.parametrize(
    "sweep", [pytest.param(sweep, id=name_of(sweep), marks=marks(sweep)) for sweep in (*PX4, *ARDUPILOT)]
)
def test_responses_agree_where_the_log_knows_its_own(sweep: Sweep, flown_again: Callable[[Sweep], Difference]) -> None:
    """The bars where the log knows its own response to 2 %, elsewhere what chance allows beside them."""
    found = flown_again(sweep)
    assert found.omega_rad_s.size >= 40
    assert found.known.sum() >= 25
    assert np.abs(found.decibels[found.known]).max() < DECIBELS
    assert np.abs(found.degrees[found.known]).max() < DEGREES
    # Three deviations of some fifty points that share their errors with their neighbors.
    allowed = 3.0 * found.random_error[~found.known]
    assert np.all(np.abs(found.decibels[~found.known]) < DECIBELS + 20.0 * np.log10(1.0 + allowed))
    assert np.all(np.abs(found.degrees[~found.known]) < DEGREES + np.degrees(allowed))


MISSED = {
    "px4-thrust": "1.0 dB and 5.5 degrees where the log knows its own response to 2 to 4 %",
    "ardupilot-roll": "1.9 dB at the low end, where the log knows its own response to 9 %",
    "ardupilot-pitch": "0.8 dB and 3.3 degrees at the low end, where the log knows its own response to 13 %",
}


@pytest.mark.parametrize(
    "sweep",
    [
        pytest.param(
            sweep,
            id=name_of(sweep),
            marks=marks(
                sweep,
                *(
                    [pytest.mark.xfail(strict=True, raises=AssertionError, reason=MISSED[name_of(sweep)])]
                    if name_of(sweep) in MISSED
                    else []
                ),
            ),
        )
        for sweep in (*PX4, *ARDUPILOT)
    ],
)
def test_responses_agree_wherever_both_are_coherent(sweep: Sweep, flown_again: Callable[[Sweep], Difference]) -> None:
    found = flown_again(sweep)
    assert np.abs(found.decibels).max() < DECIBELS
    assert np.abs(found.degrees).max() < DEGREES


@pytest.fixture(scope="module")
def with_the_filter_of_the_log(unpacked: Callable[[str], Path], tmp_path_factory: pytest.TempPathFactory) -> Difference:
    """PX4's pitch flown again with the filter of the gyroscopes that its log names."""
    sweep = PX4[1]
    record = rotorid.read(unpacked(f"px4_sitl/{sweep.log}"))
    again = flown_again_px4(
        record,
        sweep.start_s - 0.5,
        sweep.stop_s + 0.2,
        tmp_path_factory.mktemp("again") / "again.ulg",
        gyro_cutoff_hz=record.parameters["IMU_GYRO_CUTOFF"],
    )
    return difference(measured(record, sweep), measured(again, sweep), sweep.band_rad_s)


@pytest.mark.xfail(
    strict=True, raises=AssertionError, reason="7.3 degrees: PX4's simulator turns the body 2 ms before ours does"
)
def test_px4s_own_filter_of_the_gyroscopes_gives_its_phase(with_the_filter_of_the_log: Difference) -> None:
    assert np.abs(with_the_filter_of_the_log.degrees).max() < DEGREES


def test_px4s_own_filter_of_the_gyroscopes_is_2_milliseconds_off(with_the_filter_of_the_log: Difference) -> None:
    """What the filter of 56.4 Hz of our vehicle makes up for is a delay, and no more."""
    found = with_the_filter_of_the_log
    late_s = -np.radians(found.degrees) @ found.omega_rad_s / (found.omega_rad_s @ found.omega_rad_s)
    assert late_s == pytest.approx(2e-3, abs=0.7e-3)
    assert np.abs(found.degrees + np.degrees(found.omega_rad_s * late_s)).max() < DEGREES
    assert np.abs(found.decibels).max() < DECIBELS


class Doublet(NamedTuple):
    axis: Axis
    channel: str
    start_s: float
    stop_s: float
    band_hz: float


PX4_DOUBLETS = (
    Doublet("roll", "p", 40.2, 43.0, 8.0),
    Doublet("roll", "p", 46.8, 50.4, 8.0),
    Doublet("pitch", "q", 54.2, 57.0, 8.0),
    Doublet("pitch", "q", 60.8, 64.4, 8.0),
    Doublet("yaw", "r", 68.2, 71.0, 5.0),
    Doublet("yaw", "r", 74.8, 78.4, 5.0),
    Doublet("thrust", "velocity_down", 82.2, 85.0, 6.0),
    Doublet("thrust", "velocity_down", 88.8, 92.4, 6.0),
)
"""In the log of doublets; each with the band that was excited, beyond which the log holds noise alone."""

ARDUPILOT_DOUBLETS = (
    Doublet("roll", "p", 95.6, 98.4, 20.0),
    Doublet("roll", "p", 102.6, 106.4, 20.0),
    Doublet("pitch", "q", 119.6, 122.4, 20.0),
    Doublet("pitch", "q", 126.6, 130.4, 20.0),
    Doublet("yaw", "r", 143.6, 146.4, 10.0),
    Doublet("yaw", "r", 150.6, 154.4, 10.0),
)


def inequality(theirs: FlightRecord, ours: FlightRecord, doublet: Doublet) -> float:
    """Theil's coefficient of the motion within the excited band, both low-passed without phase."""
    from scipy.signal import butter, sosfiltfilt

    # Filtered with some seconds on both sides, so that the ends of the filter are not judged.
    time_s = np.arange(doublet.start_s - 2.0, doublet.stop_s + 2.0, 1.0 / SAMPLE_RATE_HZ)
    section = butter(2, doublet.band_hz, fs=SAMPLE_RATE_HZ, output="sos")
    inside = (time_s >= doublet.start_s) & (time_s <= doublet.stop_s)
    moved = [sosfiltfilt(section, signal(one, doublet.channel, time_s))[inside] for one in (theirs, ours)]
    return theil_inequality(*(one - one.mean() for one in moved))


def test_doublets_are_those_of_px4s_simulator(unpacked: Callable[[str], Path], tmp_path: Path) -> None:
    record = rotorid.read(unpacked("px4_sitl/verify.ulg.xz"))
    again = flown_again_px4(record, 39.6, 95.3, tmp_path / "again.ulg")
    scores = {f"{one.axis} at {one.start_s:g} s": inequality(record, again, one) for one in PX4_DOUBLETS}
    assert max(scores.values()) < 0.1, scores


def test_doublets_are_those_of_ardupilots_simulator(unpacked: Callable[[str], Path], tmp_path: Path) -> None:
    record = rotorid.read(unpacked("ardupilot_sitl/x_calm_verify.BIN.xz"))
    again = flown_setpoints_ardupilot(record, 94.0, 166.0, tmp_path / "again.BIN")
    scores = {f"{one.axis} at {one.start_s:g} s": inequality(record, again, one) for one in ARDUPILOT_DOUBLETS}
    assert max(scores.values()) < 0.1, scores
