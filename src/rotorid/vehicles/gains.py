"""A vehicle under the gains that a log holds: one's own controller around a vehicle of the library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from rotorid.errors import UsageError
from rotorid.simulate.autopilot import Autopilot
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.vehicles.ardupilot_quad import ardupilot_rates
from rotorid.vehicles.px4_cascade import PX4_PARAMETERS, px4_autopilot

_PX4 = ("MC_", "IMU_GYRO_CUTOFF", "IMU_DGYRO_CUTOFF", "IMU_ACCEL_CUTOFF", "MPC_MAN_TILT_MAX")
_ARDUPILOT = ("ATC_RAT_", "ATC_ANG_", "INS_GYRO_FILTER", "INS_ACCEL_FILTER")


def with_gains(aircraft: Aircraft, parameters: Mapping[str, float], *, source: str) -> Aircraft:
    """The same vehicle with the gains and filters of rate and attitude that an autopilot's parameters hold.

    What stands above the attitude, the mixer, the delays and the rate of the loop stay those of the vehicle. A
    parameter that the log lacks stays too.

    Parameters
    ----------
    aircraft
        A vehicle whose autopilot is of the same kind.
    parameters
        By PX4's or ArduPilot's names.
    source
        What messages call the log.

    Raises
    ------
    UsageError
        The log holds no gains, or those of another autopilot.

    Examples
    --------
    >>> from rotorid.vehicles.catalog import aircraft
    >>> softer = with_gains(aircraft("x500"), {"MC_ROLLRATE_P": 0.08}, source="flight.ulg")
    >>> softer.autopilot.rates.proportional
    (0.08, 0.15, 0.2)
    """
    own = aircraft.autopilot
    kind = "px4" if "MC_ROLLRATE_P" in parameters else "ardupilot" if "ATC_RAT_RLL_P" in parameters else ""
    if kind != own.kind:
        raise UsageError(
            f"{source} holds {f'gains of {kind}' if kind else 'no gains'}, and {aircraft.name} flies {own.kind}",
            needed=f"a log of {own.kind} with its parameters",
            remedy="name a vehicle whose autopilot is that of the log",
        )
    return replace(aircraft, autopilot=(_px4 if kind == "px4" else _ardupilot)(own, parameters))


def _px4(own: Autopilot, parameters: Mapping[str, float]) -> Autopilot:
    merged = {**PX4_PARAMETERS, **own.parameters, **_chosen(parameters, _PX4)}
    fresh = px4_autopilot(merged, guidance=own.guidance, delay_s=own.delay_s, mixer=own.mixer)
    return replace(fresh, rate_hz=own.rate_hz, linearization=own.linearization, motor_range=own.motor_range)


def _ardupilot(own: Autopilot, parameters: Mapping[str, float]) -> Autopilot:
    merged = {**own.parameters, **_chosen(parameters, _ARDUPILOT)}
    return replace(
        own,
        rates=ardupilot_rates(merged),
        angle_1_s=(merged["ATC_ANG_RLL_P"], merged["ATC_ANG_PIT_P"], merged["ATC_ANG_YAW_P"]),
        gyro_cutoff_hz=merged["INS_GYRO_FILTER"],
        accelerometer_cutoff_hz=merged["INS_ACCEL_FILTER"],
        parameters=merged,
    )


def _chosen(parameters: Mapping[str, float], prefixes: tuple[str, ...]) -> dict[str, float]:
    return {name: value for name, value in parameters.items() if name.startswith(prefixes)}
