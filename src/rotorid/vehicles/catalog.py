"""The vehicles by name: what they are, where their numbers come from, and what flies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

import numpy as np

from rotorid.data.base import Immutable
from rotorid.data.flight_plan import Entry, SimulatedFlight
from rotorid.errors import ModelError, UsageError
from rotorid.models.parameter import no_such
from rotorid.simulation.multirotor_flight import Aircraft
from rotorid.typing import Axis
from rotorid.vehicles import ardupilot as ardupilot_quad
from rotorid.vehicles import bebop as bebop_flight
from rotorid.vehicles import betaflight as betaflight_quad
from rotorid.vehicles import crazyflie, forward, gazebo
from rotorid.vehicles import hummingbird as hummingbird_flight
from rotorid.vehicles import px4 as px4_quad
from rotorid.vehicles import s500 as s500_flight

RIG = "rig"
"""Name of the test stand that turns about one axis."""

_RIG_SOURCE = "Frequency-domain identification of a quadrotor with composite windows and K-means clustering"


@dataclass(frozen=True, kw_only=True)
class Interface(Immutable):
    """The interface of a vehicle that accepts set-points only, at a rate of their own.

    Parameters
    ----------
    entries
        The axes that have a set-point, and where it enters; ``stick`` on the axis of thrust is a speed of climb.
    rate_hz
        How often they are sent, and the vehicle is seen.
    band_rad_s
        What test inputs excite unless another band is asked for.
    largest
        By axis, what is asked of the vehicle at most unless an amplitude is given: as far as it answers in proportion.
    """

    entries: Mapping[Axis, Entry]
    rate_hz: float
    band_rad_s: tuple[float, float]
    largest: Mapping[Axis, float]

    def __post_init__(self) -> None:
        self._set(entries=self.entries, largest=self.largest)


@dataclass(frozen=True, kw_only=True, slots=True)
class VehicleEntry(Immutable):
    """A vehicle of the library.

    Parameters
    ----------
    name
        What it is called.
    summary
        A line on what it is.
    source
        Where its numbers come from, and which ones are ours.
    make
        What makes it; ``None`` for one that does not fly freely.
    shown
        What its log shows of a flight, with a generator for the jitter of its stamps; ``None`` for everything.
    interface
        Of a vehicle that is reached by its set-points alone.
    """

    name: str
    summary: str
    source: str
    make: Callable[[], Aircraft] | None = None
    shown: Callable[[SimulatedFlight, np.random.Generator], SimulatedFlight] | None = None
    interface: Interface | None = None

    @property
    def aircraft(self) -> Aircraft:
        """What flies.

        Raises
        ------
        ModelError
            It does not fly freely.
        """
        if self.make is None:
            raise ModelError(
                f"{self.name} turns on a pivot and does not fly",
                needed=f"one of {', '.join(aircraft_names())}",
                remedy="rotorid simulate rig writes a log of the pivot",
            )
        return self.make()


_ENTRIES: tuple[VehicleEntry, ...] = (
    VehicleEntry(
        name="ardupilot_quad",
        summary="ArduPilot's simulated X of 3 kg, with Copter's controllers at 400 Hz",
        source=ardupilot_quad.SOURCE,
        make=ardupilot_quad.aircraft,
    ),
    VehicleEntry(
        name="bebop",
        summary="Parrot Bebop 2 of 0.5 kg, behind set-points of attitude and vertical speed",
        source=bebop_flight.SOURCE,
        make=bebop_flight.aircraft,
        shown=lambda flight, rng: bebop_flight.interface(flight, rng=rng),
        interface=Interface(
            entries={"roll": "attitude_setpoint", "pitch": "attitude_setpoint", "thrust": "stick"},
            rate_hz=1.0 / bebop_flight.SAMPLE_S,
            band_rad_s=bebop_flight.BAND_RAD_S,
            largest=bebop_flight.LARGEST,
        ),
    ),
    VehicleEntry(
        name="betaflight_quad",
        summary="racing quadrotor of 5 inches and 0.62 kg, with Betaflight's controllers at 1 kHz",
        source=betaflight_quad.SOURCE,
        make=betaflight_quad.aircraft,
    ),
    VehicleEntry(
        name="crazyflie",
        summary="Crazyflie 2.x of 27 g, with its firmware's rate controllers at 500 Hz",
        source=crazyflie.SOURCE,
        make=crazyflie.aircraft,
    ),
    VehicleEntry(
        name="forward_quad",
        summary="X of 1 kg that feels the air, for forward flight up to 13 m/s, with PX4's controllers at 250 Hz",
        source=forward.SOURCE,
        make=forward.aircraft,
    ),
    VehicleEntry(
        name="hummingbird",
        summary="AscTec Hummingbird, a plus of 0.5 kg whose rotors feel the air",
        source=hummingbird_flight.SOURCE,
        make=hummingbird_flight.aircraft,
    ),
    VehicleEntry(
        name="iris",
        summary="iris of Gazebo classic, 1.5 kg, with PX4's controllers at 250 Hz",
        source=gazebo.IRIS_SOURCE,
        make=gazebo.iris,
    ),
    VehicleEntry(
        name="px4_quad",
        summary="PX4's simulated X of 1 kg (SIH), with PX4's controllers at 250 Hz",
        source=px4_quad.SOURCE,
        make=px4_quad.aircraft,
    ),
    VehicleEntry(
        name=RIG,
        summary="3-DOF rig: a quadrotor on a pivot, driven by voltages; it turns and does not fly",
        source=_RIG_SOURCE,
    ),
    VehicleEntry(
        name="s500",
        summary="S500 of 1.4 kg with the published derivatives of hover, and PX4's controllers at 250 Hz",
        source=s500_flight.SOURCE,
        make=s500_flight.aircraft,
    ),
    VehicleEntry(
        name="x500",
        summary="x500 of Gazebo, 2 kg, with PX4's controllers at 250 Hz",
        source=gazebo.X500_SOURCE,
        make=gazebo.x500,
    ),
)

VEHICLES: Mapping[str, VehicleEntry] = MappingProxyType({entry.name: entry for entry in _ENTRIES})
"""Every vehicle by its name, sorted."""


Vehicle: TypeAlias = str | VehicleEntry | Aircraft
"""A vehicle by its name in the library, one of a file or of results, or what flies itself."""


def entry_of(vehicle: Vehicle) -> VehicleEntry:
    """The entry of a vehicle by its name or file.

    Parameters
    ----------
    vehicle
        A name of the library, or a vehicle of one's own.

    Raises
    ------
    ModelError
        The library has no such vehicle.
    UsageError
        It is neither a name nor a vehicle.

    Examples
    --------
    >>> entry_of(entry_of("x500").aircraft).name
    'x500'
    """
    if isinstance(vehicle, Aircraft):
        return VehicleEntry(name=vehicle.name, summary="", source=vehicle.vehicle.source, make=lambda: vehicle)
    if isinstance(vehicle, VehicleEntry):
        return vehicle
    if not isinstance(vehicle, str):
        raise UsageError(f"{type(vehicle).__name__} is no vehicle", needed="a name such as x500, or an Aircraft")
    if vehicle not in VEHICLES:
        raise no_such("vehicle", vehicle, aircraft_names())
    return VEHICLES[vehicle]


def aircraft_names() -> tuple[str, ...]:
    """Names of the vehicles that fly freely, sorted.

    Examples
    --------
    >>> aircraft_names()[:5]
    ('ardupilot_quad', 'bebop', 'betaflight_quad', 'crazyflie', 'forward_quad')
    """
    return tuple(name for name, entry in VEHICLES.items() if entry.make is not None)


def aircraft(name: str) -> Aircraft:
    """A vehicle of the library with its autopilot and its sensors.

    Parameters
    ----------
    name
        One of :func:`aircraft_names`.

    Raises
    ------
    ModelError
        There is no such vehicle, or it does not fly freely.

    Examples
    --------
    >>> aircraft("x500").vehicle.mass_kg
    2.0
    """
    return entry_of(name).aircraft
