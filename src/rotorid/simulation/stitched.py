r"""Linear models at several speeds as one that flies through them: a stitched model.

Stability and control derivatives, trim, lags and delays are tables over the forward speed. With the trim
:math:`(\cdot)_0` at the speed :math:`V`, and gravity and the turning of the axes exact,

.. math::

    \dot u &= g \sin\theta_0 + X_u (u - u_0) + X_w (w - w_0) + X_q q + X_\delta (\delta - \delta_0)
        - g \sin\theta - q w + r v \\
    \dot q &= M_u (u - u_0) + M_w (w - w_0) + M_q q + M_\delta (\delta - \delta_0), \qquad \dots

and alike along all six motions. The tables are read at a filtered speed :math:`\dot V = \omega_f (u - V)`: quick
changes of speed meet the derivatives of speed, slow ones move the trim, and neither is counted twice. At a trim of the
tables, with small motions around it, this is exactly the linear model that stands there. In between it is as good as
the interpolation, and beyond the ends the tables hold their last values.

The state of the art of fixed-wing aircraft and helicopters: Tobias and Tischler, *A Model Stitching Architecture for
Continuous Full Flight-Envelope Simulation of Fixed-Wing Aircraft and Rotorcraft from Discrete-Point Linear Models*,
2016. Their corrections for other weights and altitudes are left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.record import AXES
from rotorid.errors import UsageError
from rotorid.models.controller import STATES as CONTROLLER_STATES
from rotorid.models.controller import SteppedController
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.simulation.stitched_kernels import Loops

SPEED_FILTER_RAD_S = 0.2
"""Of the speed at which the tables are read: slower than the slowest motion that a sweep shows."""

LEAST_RATE_HZ = 250.0
"""Least rate of the steps."""

MOTIONS = ("u", "v", "w", "p", "q", "r")
FORCES = ("X", "Y", "Z", "L", "M", "N")
STATES = (*MOTIONS, "phi", "theta", "psi")
TRIMS = ("u", "v", "w", "phi", "theta", *(f"{axis}_command" for axis in AXES))
"""What a trim says, in the order of its columns."""

_FORCE = ("ax", "ay", "az")


@dataclass(frozen=True, kw_only=True, eq=False)
class StitchedModel(Immutable):
    """Tables over the forward speed, straight between its entries.

    Parameters
    ----------
    speed_m_s
        Rising, shape ``(k,)``.
    derivatives
        Accelerations ``X Y Z L M N`` by ``u v w p q r`` and commands of roll, pitch, yaw, thrust; ``(k, 6, 10)``.
    trim
        Columns of :data:`TRIMS`, shape ``(k, 9)``.
    lag_s, delay_s
        Of each command, shape ``(k, 4)``.

    Raises
    ------
    UsageError
        Shapes do not belong together, speeds do not rise, or a number is none.

    Examples
    --------
    >>> hover = StitchedModel(
    ...     speed_m_s=[0.0], derivatives=np.zeros((1, 6, 10)), trim=np.zeros((1, 9)),
    ...     lag_s=np.full((1, 4), 0.05), delay_s=np.zeros((1, 4)),
    ... )
    >>> hover.speed_m_s.size
    1
    """

    speed_m_s: FloatArray
    derivatives: FloatArray
    trim: FloatArray
    lag_s: FloatArray
    delay_s: FloatArray

    def __post_init__(self) -> None:
        shapes = {"speed_m_s": (), "derivatives": (6, 10), "trim": (9,), "lag_s": (4,), "delay_s": (4,)}
        for name, rest in shapes.items():
            self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1 + len(rest))})
        count = self.speed_m_s.size
        wrong = [name for name, rest in shapes.items() if getattr(self, name).shape != (count, *rest)]
        values = np.concatenate([getattr(self, name).ravel() for name in shapes])
        if wrong or not count or not np.isfinite(values).all() or (np.diff(self.speed_m_s) <= 0.0).any():
            raise UsageError(
                f"the tables over {count} speeds are wrong" + (f" in {', '.join(wrong)}" if wrong else ""),
                needed="rising speeds, and finite tables with an entry for each",
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosedAxis(Immutable):
    """A controller that closes the loop of one command in a simulation.

    Parameters
    ----------
    command
        ``roll_command``, ``pitch_command`` or ``yaw_command``.
    controller
        Made by :func:`rotorid.models.controller.stepped` for the rate of the steps, see :func:`steps_of`.
    setpoint
        Of its angle or rate, at the samples of the simulation, shape ``(samples,)``.
    excitation
        Test signal that is added to its command, the same shape; ``None`` for none.
    """

    command: str
    controller: SteppedController
    setpoint: FloatArray
    excitation: FloatArray | None = None

    def __post_init__(self) -> None:
        added = np.zeros_like(self.setpoint) if self.excitation is None else self.excitation
        self._set(
            setpoint=read_only(self.setpoint, np.float64, ndim=1), excitation=read_only(added, np.float64, ndim=1)
        )


def steps_of(sample_rate_hz: float) -> int:
    """Steps of a simulation in a sample."""
    return max(1, math.ceil(LEAST_RATE_HZ / sample_rate_hz - 1e-9))


def simulate_stitched(
    model: StitchedModel,
    commands: FloatArray,
    *,
    sample_rate_hz: float,
    start: Mapping[str, float],
    closed: Sequence[ClosedAxis] = (),
    speed_filter_rad_s: float = SPEED_FILTER_RAD_S,
) -> dict[str, FloatArray]:
    r"""Fly a stitched model through its speeds.

    Commands enter late by their delays, go straight from step to step and pass the lag of the motors. A multirotor
    without its controllers falls over: in open loop the answer drifts off within seconds, however good the model is.
    With ``closed`` the controllers that flew give the commands, from the set-points of the flight.

    Parameters
    ----------
    model
        What flies.
    commands
        Roll, pitch, yaw and thrust as the log has them, trim included, shape ``(4, samples)``; those of closed loops
        are used at the first sample alone, which starts the integral of the controller.
    sample_rate_hz
        Rate of all signals.
    start
        First values of ``u v w p q r phi theta psi``; zero where one is missing.
    closed
        Controllers, one for each command at most.
    speed_filter_rad_s
        Of the speed at which the tables are read.

    Returns
    -------
    dict
        ``u v w p q r phi theta psi``, ``ax ay az`` at the center of gravity and the four commands, each of shape
        ``(samples,)``; not a number from the moment on at which it fell over.

    Raises
    ------
    UsageError
        Signals do not belong together, or a loop closes no command.

    Examples
    --------
    A vehicle without any derivative but that of thrust falls when thrust is lowered:

    >>> table = np.zeros((1, 6, 10))
    >>> table[0, 2, 9] = -20.0
    >>> trim = np.array([[0, 0, 0, 0, 0, 0, 0, 0, 0.5]])
    >>> model = StitchedModel(
    ...     speed_m_s=[0.0], derivatives=table, trim=trim, lag_s=np.full((1, 4), 0.01), delay_s=np.zeros((1, 4))
    ... )
    >>> commands = np.array([[0.0], [0.0], [0.0], [0.45]]) * np.ones(251)
    >>> flown = simulate_stitched(model, commands, sample_rate_hz=250.0, start={})
    >>> round(float(flown["w"][-1]), 2), round(float(flown["az"][-1]), 2)
    (1.0, -8.81)
    """
    from rotorid.simulation.stitched_kernels import Tables, fly_stitched

    values = np.asarray(commands, dtype=np.float64)
    if values.ndim != 2 or values.shape[0] != len(AXES) or not values.shape[1] or not np.isfinite(values).all():
        raise UsageError(
            f"the commands have shape {values.shape} or are not finite", needed="four rows of finite samples"
        )
    samples = values.shape[1]
    fine = steps_of(sample_rate_hz)
    grid = np.arange((samples - 1) * fine + 1) / fine

    def finer(row: FloatArray) -> FloatArray:
        return np.interp(grid, np.arange(samples), row)

    loops = _loops(closed, values[:, 0], samples, finer)
    given = np.ascontiguousarray(np.array([finer(row) for row in values]).T)
    speed = start.get("u", 0.0)
    start_state = np.array([*(start.get(name, 0.0) for name in STATES), *values[:, 0], speed])
    tables = Tables(*(np.array(getattr(model, name), order="C") for name in Tables._fields))
    states, flown = fly_stitched(start_state, given, tables, loops, 1.0 / (fine * sample_rate_hz), speed_filter_rad_s)
    kept, sent = states[::fine], flown[::fine]
    found = {name: kept[:, place].copy() for place, name in enumerate(STATES)}
    found |= {name: kept[:, 14 + place].copy() for place, name in enumerate(_FORCE)}
    return found | {f"{axis}_command": sent[:, place].copy() for place, axis in enumerate(AXES)}


def _loops(
    closed: Sequence[ClosedAxis], first: FloatArray, samples: int, finer: Callable[[FloatArray], FloatArray]
) -> Loops:
    """Controllers as one recursion, started so that they give the first commands of the flight."""
    from scipy.linalg import block_diag

    from rotorid.simulation.stitched_kernels import Loops

    names = [item.command for item in closed]
    known = [f"{axis}_command" for axis in AXES[:3]]
    lengths = {row.size for item in closed for row in (item.setpoint, item.excitation) if row is not None}
    if len(set(names)) < len(names) or not set(names) <= set(known):
        raise UsageError(
            f"unknown or repeated loops in {', '.join(names)}", needed=f"each of {', '.join(known)} at most once"
        )
    if lengths - {samples}:
        raise UsageError(f"the set-points have {lengths} samples", needed=f"{samples}, as many as the commands")
    if not closed:
        none = np.zeros((0, 0))
        return Loops(
            controlled=np.zeros(0, dtype=np.int64),
            angle=np.zeros(0, dtype=np.int64),
            transition=none,
            drive=none,
            read=none,
            direct=none,
            start=np.zeros(0),
            setpoints=np.zeros((0, 0)),
            excitations=np.zeros((0, 0)),
        )
    controllers = [item.controller for item in closed]

    def wide(name: str) -> FloatArray:
        halves = [block_diag(*(getattr(stepped, name)[:, [side]] for stepped in controllers)) for side in range(2)]
        return np.ascontiguousarray(np.hstack(halves))

    offsets = np.cumsum([0, *(len(stepped.transition) for stepped in controllers)])
    begun = np.zeros(int(offsets[-1]))
    integral = CONTROLLER_STATES.index("integral")
    for item, offset in zip(closed, offsets, strict=False):
        gain = float(item.controller.read[0, integral])
        if gain:
            begun[offset + integral] = first[known.index(item.command)] / gain
    return Loops(
        controlled=np.array([known.index(name) for name in names]),
        angle=np.array([offset + CONTROLLER_STATES.index("angle") for offset in offsets[:-1]]),
        transition=np.ascontiguousarray(block_diag(*(stepped.transition for stepped in controllers))),
        drive=wide("drive"),
        read=np.ascontiguousarray(block_diag(*(stepped.read for stepped in controllers))),
        direct=wide("direct"),
        start=begun,
        setpoints=np.ascontiguousarray(np.array([finer(item.setpoint) for item in closed]).T),
        excitations=np.ascontiguousarray(np.array([finer(cast("FloatArray", item.excitation)) for item in closed]).T),
    )
