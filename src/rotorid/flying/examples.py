"""Small logs to try everything on: a flight of each kind, made by the simulator in seconds.

Each is a flight with test inputs as large as the vehicle bears in calm air, found once with
:func:`rotorid.flying.designs.plan_for`; one seed gives one log.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TYPE_CHECKING

from rotorid.data.base import Immutable
from rotorid.flying.settings import PlanSettings, SimulateSettings
from rotorid.models.parameter import no_such

if TYPE_CHECKING:
    from rotorid.data.flight_plan import Entry, FlightPlan, Shape


@dataclass(frozen=True, kw_only=True)
class Example(Immutable):
    """A flight to try commands on.

    Parameters
    ----------
    about
        A line on what flies and what it shows.
    vehicle
        Of the library.
    file
        Name of its log.
    next
        Commands that it is made for, in the order in which one would try them; ``{log}`` is the log, ``{folder}`` its
        folder.
    sweeps, doublets
        By axis, what is asked of the vehicle at most; none for one that has an experiment of its own.
    shape, entry
        Of the long test inputs.
    duration_s
        Of each of them.
    band_rad_s
        That they excite, of a vehicle that is reached by more than its set-points.
    """

    name: str
    about: str
    vehicle: str
    file: str
    next: tuple[str, ...]
    sweeps: Mapping[str, float] = field(default_factory=dict)
    doublets: Mapping[str, float] = field(default_factory=dict)
    shape: Shape = "pilot_sweep"
    entry: Entry | None = None
    duration_s: float = 40.0
    band_rad_s: tuple[float, float] = (0.6, 50.0)

    def __post_init__(self) -> None:
        self._set(sweeps=self.sweeps, doublets=self.doublets)

    def choices(self, *, seed: int = 0) -> SimulateSettings:
        """What is to be flown, as arguments of ``rotorid simulate``."""
        from rotorid.vehicles.catalog import entry_of

        return SimulateSettings(vehicle=entry_of(self.vehicle), plan=self.plan(seed=seed), seed=seed)

    def plan(self, *, seed: int = 0) -> FlightPlan:
        """The test inputs: one on every axis, and two doublets of each that no model is fitted to.

        Examples
        --------
        >>> plan = EXAMPLES["px4"].plan()
        >>> plan.inputs[0].axis, plan.inputs[0].shape, len(plan.inputs)
        ('roll', 'pilot_sweep', 12)
        """
        from rotorid.flying.designs import plan_with
        from rotorid.vehicles.catalog import entry_of

        entry = entry_of(self.vehicle)
        interface = entry.interface
        choices = PlanSettings(
            shape=self.shape,
            axes=tuple(self.sweeps),  # type: ignore[arg-type]
            band_rad_s=self.band_rad_s if interface is None else interface.band_rad_s,
            duration_s=self.duration_s,
            entry=self.entry,
            doublets=True,
            together=interface is not None,
            interface=interface,
            seed=seed,
        )
        return plan_with(entry.aircraft, choices, self.sweeps, doublets=self.doublets, name=f"example {self.name}")


_ENTRIES = (
    Example(
        name="px4",
        about="PX4's simulated X of 1 kg, swept by stick on four axes; a .ulg",
        vehicle="px4_quad",
        file="flight.ulg",
        next=(
            "rotorid review {log}",
            "rotorid identify {log} --model rate.roll,rate.pitch,rate.yaw,physical.motors --out {folder}/model",
            "rotorid tune {folder}/model --out {folder}/gains",
            "rotorid export {folder}/model --to px4-sih --set m=1 --set arm=0.283 --set I_zz=0.03 --set kappa=0.02 "
            "--out {folder}/sih",
        ),
        sweeps={"roll": 0.75, "pitch": 0.75, "yaw": 0.9, "thrust": 0.7},
        doublets={"roll": 0.65, "pitch": 0.65, "yaw": 0.9, "thrust": 0.6},
        entry="stick",
    ),
    Example(
        name="ardupilot",
        about="ArduPilot's simulated X of 3 kg, its own chirps on four axes; a .BIN",
        vehicle="ardupilot_quad",
        file="flight.BIN",
        next=(
            "rotorid review {log}",
            "rotorid identify {log} --model rate.roll,rate.pitch,rate.yaw --out {folder}/model",
            "rotorid tune {folder}/model {log} --out {folder}/gains",
        ),
        sweeps={"roll": 0.22, "pitch": 0.22, "yaw": 0.43, "thrust": 0.1},
        doublets={"roll": 0.5, "pitch": 0.5, "yaw": 0.36, "thrust": 0.5},
        shape="logarithmic_sweep",
    ),
    Example(
        name="betaflight",
        about="a racing quadrotor of 5 inches under Betaflight, swept by stick on four axes; a .bbl",
        vehicle="betaflight_quad",
        file="flight.bbl",
        next=(
            "rotorid review {log}",
            "rotorid identify {log} --model rate.roll,rate.pitch,rate.yaw --out {folder}/model",
            "rotorid tune {folder}/model --out {folder}/gains",
        ),
        sweeps={"roll": 0.5, "pitch": 0.5, "yaw": 0.35, "thrust": 0.4},
        doublets={"roll": 0.4, "pitch": 0.4, "yaw": 0.35, "thrust": 0.4},
        entry="stick",
        # Its loops cross over near 50 rad/s.
        band_rad_s=(0.6, 150.0),
    ),
    Example(
        name="rig",
        about="a quadrotor on a pivot, driven by the voltages of two motors; a .csv",
        vehicle="rig",
        file="flight.csv",
        next=("rotorid inspect {log}", "rotorid identify {log} --model rig.roll --out {folder}/model"),
    ),
    Example(
        name="bebop",
        about="a Bebop 2 behind its set-points, excited by random binary signals on three axes; a .csv",
        vehicle="bebop",
        file="flight.csv",
        next=(
            "rotorid delay {log}",
            "rotorid identify {log} --model response.second_order_delay --inputs theta_setpoint --outputs theta "
            "--out {folder}/model",
        ),
        sweeps={"roll": 0.1, "pitch": 0.1, "thrust": 0.5},
        doublets={"roll": 0.1, "pitch": 0.1, "thrust": 0.5},
        shape="random_binary",
        duration_s=60.0,
    ),
)

EXAMPLES: Mapping[str, Example] = MappingProxyType({entry.name: entry for entry in _ENTRIES})
"""Every example by its name."""


def example_named(name: str) -> Example:
    """The example of a name.

    Raises
    ------
    ModelError
        There is none; the error lists what there is.

    Examples
    --------
    >>> example_named("rig").vehicle
    'rig'
    """
    if name not in EXAMPLES:
        raise no_such("example", name, tuple(EXAMPLES))
    return EXAMPLES[name]
