"""A simulated flight: what the autopilot knew at every turn of its loop, and what was true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.data.maneuver import Maneuver
from rotorid.typing import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class SimulatedFlight(Immutable):
    """Signals of a flight at the rate of the control loop, before any logger has thinned them out.

    Parameters
    ----------
    vehicle
        What flew.
    autopilot
        Whose controller flew it: ``px4``, ``ardupilot`` or ``simple``.
    sample_rate_hz
        Rate of the control loop.
    time_s
        Its instants, shape ``(n,)``.
    columns
        Channel of the vocabulary (:data:`rotorid.data.channel.STANDARD_UNITS`) to samples, SI, FRD/NED, as the
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
