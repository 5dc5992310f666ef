"""Flights that nobody has flown yet: planned test inputs, and what a simulation makes of them.

A :class:`FlightPlan` is test inputs at their times. A :class:`SimulatedFlight` is what the autopilot knew at every turn
of its loop while it flew the plan, and what was true.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import Kind, Maneuver
from rotorid.errors import UsageError
from rotorid.typing import Axis, FloatArray

Shape: TypeAlias = Literal[
    "pilot_sweep",
    "logarithmic_sweep",
    "multisine",
    "random_binary",
    "doublet",
    "two_one_one",
    "three_two_one_one",
    "sticks",
]
"""Forms of a test input; ``sticks`` are those of an ordinary flight, which tests nothing."""

Entry: TypeAlias = Literal["command", "rate_setpoint", "attitude_setpoint", "stick"]
"""Where a test input is added: to what the mixer receives, to a set-point of the controllers, or by the pilot."""

LONGEST_S = 4.0 * 3600.0
"""No plan lasts longer: no battery does."""

_KINDS: Mapping[Shape, Kind] = MappingProxyType(
    {
        "pilot_sweep": "sweep",
        "logarithmic_sweep": "sweep",
        "multisine": "multisine",
        "random_binary": "random_binary",
        "doublet": "doublet",
        "two_one_one": "multistep",
        "three_two_one_one": "multistep",
        "sticks": "other",
    }
)

_ENTRY_UNITS: Mapping[Entry, str] = {"command": "1", "rate_setpoint": "rad/s", "attitude_setpoint": "rad", "stick": "1"}


def input_unit(axis: Axis, entry: Entry) -> str:
    """SI unit of a test input; on the axis of thrust everything is a fraction.

    Parameters
    ----------
    entry
        Where it is added.

    Examples
    --------
    >>> input_unit("roll", "attitude_setpoint"), input_unit("thrust", "attitude_setpoint")
    ('rad', '1')
    """
    return "1" if axis == "thrust" else _ENTRY_UNITS[entry]


@dataclass(frozen=True, kw_only=True, eq=False)
class PlannedInput(Immutable):
    """A test input on one axis.

    Parameters
    ----------
    axis
        Where it acts.
    shape
        Its form.
    start_s
        When its first sample is flown, on the clock of the plan.
    values
        Samples, shape ``(samples,)``, in the unit of what they are added to (commands: 1; rates: rad/s; attitude: rad).
        Between samples they go linearly; before and after them they are zero.
    sample_rate_hz
        Rate of the samples.
    amplitude
        Largest value asked for.
    band_rad_s
        Lowest and highest excited frequency; ``None`` for steps.
    entry
        Where it is added.
    motor, motor_unit
        Channel of a single motor that it drives on a bench, such as ``motor_3``, and its unit; empty for an axis.
    settings
        What else made the values, by name and in SI units: ``fade_in_s``, ``pulse_s``, ``seed``.

    Examples
    --------
    >>> step = PlannedInput(axis="roll", shape="doublet", start_s=3.0, values=[0.1, 0.1, -0.1, -0.1], sample_rate_hz=10,
    ...                     amplitude=0.1)
    >>> step.stop_s, step.maneuver.kind
    (3.4, 'doublet')
    """

    axis: Axis
    shape: Shape
    start_s: float
    values: FloatArray
    sample_rate_hz: float
    amplitude: float
    band_rad_s: tuple[float, float] | None = None
    entry: Entry = "command"
    motor: str = ""
    motor_unit: str = ""
    settings: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        values = read_only(self.values, np.float64, ndim=1)
        timed = 0.0 < self.sample_rate_hz < np.inf and 0.0 <= self.start_s <= LONGEST_S
        if not values.size or not np.isfinite([*values, self.amplitude]).all() or not timed:
            raise UsageError(
                f"invalid test input of {values.size} samples at {self.sample_rate_hz:g} Hz from {self.start_s:g} s",
                needed=f"finite samples, a positive rate, a start within {LONGEST_S:g} s",
            )
        self._set(values=values, settings=self.settings)

    @property
    def unit(self) -> str:
        """SI unit of the samples; on the axis of thrust everything is a fraction."""
        return self.motor_unit if self.motor else input_unit(self.axis, self.entry)

    @property
    def stop_s(self) -> float:
        """When its last sample has been flown."""
        return self.start_s + self.values.size / self.sample_rate_hz

    @property
    def signal(self) -> str:
        """Channel in which it shows alone."""
        if self.motor:
            return f"{self.motor}_excitation"
        kinds = {"command": "excitation", "stick": "stick"}
        return f"{self.axis}_{kinds.get(self.entry, 'setpoint_excitation')}"

    @property
    def maneuver(self) -> Maneuver:
        """The interval that it excites."""
        return Maneuver(
            axis=self.axis,
            kind=_KINDS[self.shape],
            start_s=self.start_s,
            stop_s=self.stop_s,
            band_rad_s=self.band_rad_s,
            origin="declared",
            signal=self.signal,
        )

    def at(self, time_s: FloatArray) -> FloatArray:
        """Values at other instants, shape of ``time_s``; zero before and after."""
        stamps = self.start_s + np.arange(self.values.size) / self.sample_rate_hz
        return np.interp(time_s, stamps, self.values, left=0.0, right=0.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightPlan(Immutable):
    """Test inputs of one flight, in the order of their starts; those that overlap add up.

    Parameters
    ----------
    name
        What messages and files call it.
    inputs
        At least one.
    trim_s
        Time of rest after the last one.
    """

    name: str
    inputs: tuple[PlannedInput, ...]
    trim_s: float = 3.0

    def __post_init__(self) -> None:
        if not self.inputs:
            raise UsageError(f"the plan {self.name} has no test inputs", needed="at least one")
        self._set(inputs=tuple(sorted(self.inputs, key=lambda planned: planned.start_s)))
        if not (0.0 <= self.trim_s <= LONGEST_S and self.duration_s <= LONGEST_S):
            raise UsageError(
                f"the plan {self.name} lasts {self.duration_s:g} s with pauses of {self.trim_s:g} s",
                needed=f"at most {LONGEST_S:g} s and no negative pause",
            )

    @property
    def duration_s(self) -> float:
        """Duration from zero to the end of the last pause."""
        return max(planned.stop_s for planned in self.inputs) + self.trim_s

    @property
    def maneuvers(self) -> tuple[Maneuver, ...]:
        """The intervals that are excited on purpose."""
        return tuple(planned.maneuver for planned in self.inputs if planned.shape != "sticks")

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The excited axes, each once, in the order of their starts."""
        return tuple(dict.fromkeys(planned.axis for planned in self.inputs))


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedFlight(Immutable):
    """Signals of a flight at the rate of the control loop, before any logger has thinned them out.

    Parameters
    ----------
    vehicle
        What flew.
    autopilot
        Whose controller flew it: ``px4``, ``ardupilot``, ``betaflight`` or ``simple``.
    sample_rate_hz
        Rate of the control loop.
    time_s
        Its instants, shape ``(n,)``.
    columns
        Channel of the vocabulary (:data:`rotorid.data.record.STANDARD_UNITS`) to samples, SI, FRD/NED, as the
        autopilot had them: commands, motors, excitations, sticks, set-points, filtered rates and accelerations,
        attitude, velocity, position, voltage.
    raw
        ``p q r ax ay az`` as the sensors gave them, before the autopilot's filters.
    truth
        The same names without noise, lag and offset of sensors, and ``wind_north wind_east wind_down``.
    maneuvers
        The excited intervals.
    parameters
        The autopilot's own parameters by its own names, those that a log of it would hold.
    saturated
        Share of the turns at which the motors could not do what was asked of them.

    Examples
    --------
    >>> flown = SimulatedFlight(vehicle="demo", autopilot="px4", sample_rate_hz=2.0, time_s=[0.0, 0.5],
    ...                         columns={"p": [0.0, 1.0]})
    >>> flown.columns["p"].tolist(), flown.samples
    ([0.0, 1.0], 2)
    """

    vehicle: str
    autopilot: str
    sample_rate_hz: float
    time_s: FloatArray
    columns: Mapping[str, FloatArray]
    raw: Mapping[str, FloatArray] = field(default_factory=dict)
    truth: Mapping[str, FloatArray] = field(default_factory=dict)
    maneuvers: tuple[Maneuver, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    saturated: float = 0.0

    def __post_init__(self) -> None:
        time_s = read_only(self.time_s, np.float64, ndim=1)
        signals = {name: _signals(getattr(self, name), time_s.size) for name in ("columns", "raw", "truth")}
        self._set(
            time_s=time_s,
            **signals,
            maneuvers=tuple(self.maneuvers),
            parameters=self.parameters,
        )

    @property
    def samples(self) -> int:
        """Turns of the control loop."""
        return self.time_s.size


def _signals(columns: Mapping[str, FloatArray], samples: int) -> Mapping[str, FloatArray]:
    kept = {name: read_only(values, np.float64, ndim=1) for name, values in columns.items()}
    wrong = [name for name, values in kept.items() if values.size != samples]
    if wrong:
        raise ValueError(f"{', '.join(wrong)} should have {samples} samples")
    return MappingProxyType(kept)
