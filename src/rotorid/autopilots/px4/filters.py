"""Filters that PX4 runs in front of the channels that it logs.

References
----------
PX4 User Guide, Parameter Reference (``IMU_*``) and *MC Filter Tuning & Control Latency*; the digital forms, and what is
logged from where, are those of ``LowPassFilter2p``, ``NotchFilter``, ``VehicleAngularVelocity`` and ``VehicleIMU``.
"""

from __future__ import annotations

import math

from rotorid.autopilots.filters import KnownFilter, integral_mean, notch
from rotorid.autopilots.passages import NARROWEST, Chain, Passage, second_order, stage, through
from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError

SENSOR_HZ = 8000.0
"""Of a fast sensor, on whose raw samples the filters work."""


def _notch(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    # Its damping is the tangent of the half bandwidth; sine over twice the quality is what `notch` makes of it.
    center_hz, bandwidth_hz = values
    if not (0.0 < center_hz < 0.5 * rate_hz and NARROWEST * center_hz < bandwidth_hz < 0.5 * rate_hz):
        raise UsageError(
            f"got a notch at {center_hz:g} Hz, {bandwidth_hz:g} Hz wide", needed="less than half of its rate"
        )
    quality = math.sin(2.0 * math.pi * center_hz / rate_hz) / (2.0 * math.tan(math.pi * bandwidth_hz / rate_hz))
    return notch(center_hz, quality, rate_hz)


def _integral(values: tuple[float, ...], rate_hz: float) -> KnownFilter:
    if not 1.0 <= values[0] < math.inf:
        raise UsageError(f"got {values[0]:g} integrals per second", needed="one or more")
    # A whole number of samples, the one nearest to the interval asked for.
    return integral_mean(max(round(rate_hz / values[0]), 1) / rate_hz, rate_hz)


_SLEW = ("MOT_SLEW_MAX", *(f"CA_R{index}_SLEW" for index in range(12)))
_GYRO_NOTCHES = (
    stage("IMU_GYRO_NF0_FRQ IMU_GYRO_NF0_BW", _notch),
    stage("IMU_GYRO_NF1_FRQ IMU_GYRO_NF1_BW", _notch),
    stage("IMU_GYRO_NF_FREQ IMU_GYRO_NF_BW", _notch),
)

CHAINS = (
    Chain(
        source=r"vehicle_angular_velocity\.xyz\[\d\]",
        stages=(stage("IMU_GYRO_CUTOFF", second_order, needed=True), *_GYRO_NOTCHES),
        moving=("IMU_GYRO_DNF_EN", "IMU_GYRO_DYN_NF"),
    ),
    Chain(
        source=r"vehicle_acceleration\.xyz\[\d\]",
        stages=(stage("IMU_ACCEL_CUTOFF", second_order, needed=True),),
    ),
    Chain(
        source=r"sensor_combined\.(gyro_rad|accelerometer_m_s2)\[\d\]",
        stages=(stage("IMU_INTEG_RATE", _integral, needed=True),),
    ),
    Chain(
        source=r"(vehicle_torque_setpoint|vehicle_thrust_setpoint|actuator_controls_0|actuator_motors|actuator_outputs)\..*",
        nonlinear=("THR_MDL_FAC", *_SLEW),
    ),
)
"""Sources of a log and what they have passed."""


def passage(record: FlightRecord, source: str, sensor_rate_hz: float | None) -> Passage:
    """What a channel of a log has passed; at the rate of a fast sensor where none is given."""
    return through(CHAINS, source, record.parameters, sensor_rate_hz or SENSOR_HZ)
