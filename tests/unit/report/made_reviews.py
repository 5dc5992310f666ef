"""Reviews with numbers that were made up: what pages and documents have to carry."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotorid.data.findings import warn
from rotorid.data.quantity import Quantity
from rotorid.data.response import FrequencyResponse
from rotorid.loops.filter_choice import FilterProposal, FilterSet
from rotorid.models.controller import RateController
from rotorid.reviewing.missing import Unavailable
from rotorid.reviewing.values import (
    FlightSummary,
    LoggingReview,
    LoopReview,
    MarginReview,
    MotorReview,
    NoiseMap,
    NoisePeak,
    NoiseReview,
    Review,
    StepCurve,
    VehicleReview,
)
from rotorid.typing import Axis

OMEGA = np.geomspace(0.7, 200.0, 55)


def response(values: np.ndarray, reference: str, answer: str, error: float = 0.02) -> FrequencyResponse:
    shaped = values[None, None]
    return FrequencyResponse(
        omega_rad_s=OMEGA,
        values=shaped,
        coherence=np.full(shaped.shape, 0.95),
        random_error=np.full(shaped.shape, error),
        covariance=np.eye(OMEGA.size) * (np.sqrt(2.0) * error * np.abs(values))[None, None, :, None] ** 2,
        inputs=(reference,),
        outputs=(answer,),
        estimate="joint",
    )


def second_order(omega: float, damping: float) -> np.ndarray:
    s = 1j * OMEGA / omega
    return np.asarray(1.0 / (s**2 + 2.0 * damping * s + 1.0))


def step(omega: float, damping: float) -> StepCurve:
    time_s = np.linspace(0.0, 1.0, 200)
    fast = omega * np.sqrt(1.0 - damping**2)
    value = 1.0 - np.exp(-damping * omega * time_s) * (
        np.cos(fast * time_s) + damping / np.sqrt(1.0 - damping**2) * np.sin(fast * time_s)
    )
    return StepCurve(time_s=time_s, value=value, lower=value - 0.03, upper=value + 0.03)


def loop(name: str, omega: float, damping: float) -> LoopReview:
    return LoopReview(
        name=name,
        reference=f"{name}_setpoint",
        answer=name,
        instrument="stick",
        response=response(second_order(omega, damping), f"{name}_setpoint", name),
        step=step(omega, damping),
        numbers={
            "rise_time_s": Quantity.normal(2.0 / omega, 0.05 / omega, "s"),
            "delay_s": Quantity.normal(1.2 / omega, 0.02 / omega, "s"),
            "overshoot_percent": Quantity(value=9.5, std=1.0, lower=7.6, upper=11.6, unit="%"),
            "bandwidth_90deg_rad_s": Quantity.normal(omega, 0.01 * omega, "rad/s"),
        },
        band_rad_s=(0.7, 120.0),
    )


def margin(axis: str, crossover: float) -> MarginReview:
    broken = crossover / (1j * OMEGA) * np.exp(-0.012j * OMEGA)
    return MarginReview(
        axis=axis,  # type: ignore[arg-type]
        loop=response(broken, f"{axis}_command", f"{axis}_loop"),
        controller=RateController(proportional_s=0.15),
        instrument="stick",
        numbers={
            "crossover_rad_s": Quantity.normal(crossover, 0.5, "rad/s"),
            "phase_margin_deg": Quantity.normal(90.0 - np.rad2deg(0.012 * crossover), 1.1, "deg"),
            "gain_margin_db": Quantity.normal(9.0, 0.8, "dB"),
            "sensitivity_peak": Quantity.normal(1.5, 0.05, "1"),
        },
        by_model=("gain_margin_db",),
    )


def noise_map(stage: str) -> NoiseMap:
    level = np.linspace(0.1, 0.9, 21)
    frequency_hz = np.linspace(2.0, 500.0, 150)
    frame = 10.0 ** (-1.0) * np.exp(-0.5 * ((frequency_hz - 208.0) / 6.0) ** 2)
    rotor = np.exp(-0.5 * ((frequency_hz[None] - (150.0 + 330.0 * level[:, None])) / 12.0) ** 2)
    density = 1e-4 + frame[None] + 0.5 * rotor
    density[:3] = np.nan
    if stage == "after":
        density = density * 0.02
    return NoiseMap(
        channel="p",
        stage=stage,  # type: ignore[arg-type]
        against="throttle",
        level=level,
        frequency_hz=frequency_hz,
        density=density,
        windows=np.full(level.size, 12.0),
        average=np.nanmean(density, axis=0),
        unit="(deg/s)^2/Hz",
    )


def kept_filters() -> FilterProposal:
    """The flown filters of a quiet vehicle."""
    axes: tuple[Axis, ...] = ("roll", "pitch", "yaw")
    flown = FilterSet(changes=(), powers={axis: np.full(10, 9e-6) for axis in axes}, costs_deg={})
    return FilterProposal(
        need="",
        flown=flown,
        proposed=flown,
        offered={"IMU_GYRO_CUTOFF": 40.0},
        parts=(),
        rms=flown.rms,
        saves_percent=Quantity(value=0.0, std=0.0, lower=0.0, upper=0.0, unit="%"),
        verdicts={},
    )


def made_review(name: str = "flight.ulg") -> Review:
    return Review(
        name=name,
        sha256="0" * 64,
        vehicle=VehicleReview(autopilot="PX4", firmware="PX4 1.15", kind="multirotor", frame="X", motors=4),
        flight=FlightSummary(
            flights=((12.0, 95.5),),
            seen_in="vehicle_land_detected",
            battery={"start_v": Quantity.normal(16.4, 0.05, "V"), "lowest_v": Quantity.normal(14.2, 0.05, "V")},
            hover_throttle=Quantity.normal(0.42, 0.01, "1"),
            thrust_to_weight=Quantity.normal(2.1, 0.2, "1"),
        ),
        logging=LoggingReview(
            rates_hz={"p": 250.0, "p_setpoint": 50.0},
            longest_gap_s=0.01,
            change=("Set SDLOG_PROFILE to 19: the set-points of the rates are logged at 50 Hz.",),
        ),
        loops={"p": loop("p", 22.0, 0.6), "q": loop("q", 18.0, 0.5), "phi": loop("phi", 6.0, 0.8)},
        margins={"roll": margin("roll", 21.0), "pitch": margin("pitch", 17.0)},
        calm=("roll", "pitch"),
        models={},
        noise=NoiseReview(
            maps=(noise_map("before"), noise_map("after")),
            peaks=(
                NoisePeak(
                    channel="p",
                    frequency_hz=Quantity.normal(208.0, 0.5, "Hz"),
                    height_db=22.0,
                    source="frame",
                    sentence="It stays where it is while the throttle moves.",
                ),
            ),
            numbers={"vibration_m_s2": Quantity.normal(4.2, 0.2, "m/s^2")},
        ),
        motors=MotorReview(
            means={f"motor_{n}": Quantity.normal(0.4 + 0.02 * n, 0.004, "1") for n in range(1, 5)},
            numbers={"imbalance": Quantity.normal(0.05, 0.006, "1"), "headroom": Quantity.normal(0.5, 0.01, "1")},
        ),
        filters=kept_filters(),
        cannot_tell=(
            Unavailable(
                what="loops.r.rise_time_s",
                why="The yaw stick rested.",
                remedy="move it left and right for 30 s, every second once",
            ),
        ),
        next_commands=("rotorid identify flight.ulg --model rate.roll,rate.pitch",),
        findings=(
            warn("gap", "motors", "A gap of 0.2 s at 14.2 s."),
            warn("gap", "rates", "A gap of 0.1 s at 24.2 s."),
        ),
    )


def untold_review() -> Review:
    """A log that tells nothing."""
    seen = made_review("bench.csv")
    return replace(
        seen,
        flight=FlightSummary(flights=(), seen_in=""),
        loops={},
        margins={},
        noise=NoiseReview(),
        motors=MotorReview(),
        next_commands=(),
    )
