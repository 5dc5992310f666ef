"""Real and simulated flights: which measured responses are vehicles, and which are controllers."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

import rotorid
from rotorid.data.record import Maneuver
from rotorid.errors import InsufficientDataError
from rotorid.fits.frequency.inverse import Screened, pose_screened
from rotorid.flights.measure import measure
from rotorid.flights.selection import select_maneuvers
from rotorid.identifying.identification import identify
from rotorid.models.library import RATE_AXES, rate_model
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.measuring import EstimateChoice
from rotorid.settings.parsing import parse_segment
from rotorid.signal.airborne import airborne
from rotorid.typing import Axis

ZMR250 = "px4/zmr250"
YAW_THRUST = "ardupilot_sitl/x_wind_yawthrust.BIN.xz"
ROLL_PITCH = "ardupilot_sitl/x_wind_rollpitch.BIN.xz"
HOVER_S = (60.5, 93.5)
"""Hovering in wind, before any chirp of the two flights."""

Screen = Callable[..., Screened]


class Vehicle(NamedTuple):
    """A maneuver whose response is known to be the vehicle."""

    log: str
    axis: Axis
    segment_s: tuple[float, float] | None = None
    band_rad_s: tuple[float, float] | None = None


VEHICLES = (
    Vehicle("ardupilot_sitl/x_calm_roll.BIN", "roll"),
    Vehicle("ardupilot_sitl/x_calm_thrust.BIN.xz", "thrust"),
    Vehicle(ROLL_PITCH, "roll"),
    Vehicle(ROLL_PITCH, "pitch"),
    Vehicle(YAW_THRUST, "yaw"),
    Vehicle(YAW_THRUST, "thrust"),
    Vehicle("px4_sitl/roll.ulg", "roll"),
    Vehicle("px4_sitl/pitch.ulg.xz", "pitch"),
    Vehicle("px4_sitl/yaw.ulg.xz", "yaw"),
    Vehicle("px4_sitl/thrust.ulg.xz", "thrust"),
    Vehicle("s500/roll_sweeps.csv", "roll"),
    Vehicle("s500/pitch_sweeps.csv", "pitch"),
    Vehicle("s500/yaw_sweeps.csv", "yaw"),
    Vehicle("s500/thrust_sweeps.csv", "thrust"),
    Vehicle("antx/prbs.mat", "pitch", (50.0, 76.0), (8.0, 80.0)),
    Vehicle(YAW_THRUST, "roll", HOVER_S, (0.5, 60.0)),
    Vehicle(YAW_THRUST, "pitch", HOVER_S, (0.5, 60.0)),
)


@pytest.fixture(scope="module")
def record(unpacked: Callable[[str], Path], shared_data: Path) -> Callable[[str], rotorid.FlightRecord]:
    """Each log read once."""
    known: dict[str, rotorid.FlightRecord] = {}

    def read(name: str) -> rotorid.FlightRecord:
        if name not in known:
            mapping = shared_data / "antx" / "map.toml" if name.startswith("antx") else None
            known[name] = rotorid.read(unpacked(name), mapping=mapping)
        return known[name]

    return read


@pytest.fixture(scope="module")
def screened(record: Callable[[str], rotorid.FlightRecord]) -> Screen:
    """Everything before the fit, as the pipeline does it."""

    def screen(
        log: str,
        axis: Axis,
        segment_s: tuple[float, float] | None = None,
        band_rad_s: tuple[float, float] | None = None,
        *,
        estimate: EstimateChoice = "auto",
    ) -> Screened:
        given = [(axis, *segment_s)] if segment_s else []
        segments = tuple(
            Maneuver(axis=name, kind="other", start_s=start, stop_s=stop, origin="given") for name, start, stop in given
        )
        settings = IdentifySettings(segments=segments, band_rad_s=band_rad_s, estimate=estimate)
        flown = select_maneuvers([record(log)], [axis], settings).fitted
        model = next(name for name, item in RATE_AXES.items() if item.input == f"{axis}_command")
        structure = rate_model(model)
        measured = measure(flown, inputs=structure.inputs, outputs=structure.outputs, settings=settings)
        return pose_screened(structure, measured, settings, flown)

    return screen


@pytest.fixture(scope="module")
def aloft_s(record: Callable[[str], rotorid.FlightRecord]) -> tuple[float, float]:
    """The airborne part of the flight that has no excitation at all."""
    return airborne(record(ZMR250)).longest


@pytest.mark.parametrize("estimate", ["auto", "direct"])
def test_the_real_yaw_of_a_racing_frame_is_its_controller(
    screened: Screen, aloft_s: tuple[float, float], estimate: EstimateChoice
) -> None:
    # With the rate set-point as instrument nothing is coherent; the direct estimate shows why.
    with pytest.raises(InsufficientDataError, match="is the inverse of the controller") as refusal:
        screened(ZMR250, "yaw", aloft_s, (0.5, 80.0), estimate=estimate)
    finding = refusal.value.findings[0]
    assert finding.kind == "inverse_controller"
    numbers = finding.numbers
    assert numbers["gain"] == pytest.approx(0.15, rel=0.02)
    assert numbers["known_cost"] < 5.0
    assert numbers["fitted_cost"] < 5.0
    assert numbers["low_rad_s"] < 1.7
    assert numbers["high_rad_s"] > 37.0


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_its_roll_and_pitch_are_the_vehicle(screened: Screen, aloft_s: tuple[float, float], axis: Axis) -> None:
    result = screened(ZMR250, axis, aloft_s, (0.5, 80.0), estimate="direct")
    assert result.findings == ()
    omega = result.problem.data.omega_rad_s[result.problem.used[0, 0]]
    assert omega[0] < 5.0
    assert omega[-1] > 35.0


@pytest.mark.parametrize("log", [YAW_THRUST, ROLL_PITCH])
def test_yaw_hovering_in_wind_is_the_controller_above_five_and_not_below_three(screened: Screen, log: str) -> None:
    with pytest.raises(InsufficientDataError, match="is the inverse of the controller") as refusal:
        screened(log, "yaw", HOVER_S, (0.5, 60.0))
    numbers = refusal.value.findings[0].numbers
    assert 3.0 < numbers["low_rad_s"] < 5.0
    assert numbers["high_rad_s"] == pytest.approx(60.0)
    assert numbers["known_cost"] < 5.0


def test_heave_hovering_in_wind_is_the_controller_too(screened: Screen) -> None:
    with pytest.raises(InsufficientDataError, match="is the inverse of the controller") as refusal:
        screened(YAW_THRUST, "thrust", HOVER_S, (0.5, 60.0))
    assert refusal.value.findings[0].numbers["fitted_cost"] < 5.0


@pytest.mark.parametrize("estimate", [pytest.param("auto", marks=pytest.mark.slow), "direct"])
@pytest.mark.parametrize("vehicle", VEHICLES, ids=lambda vehicle: f"{Path(vehicle.log).name}-{vehicle.axis}")
def test_no_vehicle_is_taken_for_its_controller(screened: Screen, vehicle: Vehicle, estimate: EstimateChoice) -> None:
    result = screened(*vehicle, estimate=estimate)
    assert result.findings == ()
    assert np.count_nonzero(result.problem.used) > 20


@pytest.mark.parametrize(
    ("start_s", "duration_s"),
    [
        # Here 30 to 80 rad/s are coherent, and neither the controller nor any vehicle explains them well.
        *((59.5, 5.0), (61.6, 5.0), (59.5, 6.0), (61.6, 6.0), (57.4, 8.0), (59.5, 8.0), (61.6, 8.0), (57.4, 12.0)),
        *(
            pytest.param(start_s, duration_s, marks=pytest.mark.slow)
            for duration_s in (5.0, 6.0, 8.0, 12.0, 18.0, 25.0, 35.0, 40.0)
            for start_s in np.arange(13.3, 106.9 - duration_s, 2.1)
        ),
    ],
)
def test_no_window_of_its_yaw_is_a_plant(screened: Screen, start_s: float, duration_s: float) -> None:
    with pytest.raises(InsufficientDataError):
        screened(ZMR250, "yaw", (start_s, start_s + duration_s), (0.5, 80.0), estimate="direct")


@pytest.mark.parametrize(
    ("start_s", "band_rad_s"),
    [(59.0, (10.0, 80.0)), (58.6, (20.0, 80.0)), (59.0, (3.0, 20.0))],
)
def test_no_band_of_its_yaw_is_a_plant(
    record: Callable[[str], rotorid.FlightRecord], start_s: float, band_rad_s: tuple[float, float]
) -> None:
    """Asked for what looks coherent, it lies between the vehicle and its controller and fits neither."""
    segment = parse_segment(f"yaw:{start_s}:{start_s + 6.0}")
    with pytest.raises(InsufficientDataError):
        identify(
            [record(ZMR250)],
            "rate.yaw",
            settings=IdentifySettings(band_rad_s=band_rad_s, segments=(segment,), estimate="direct"),
        )
