r"""Motion about hover, of a vehicle as it was identified and of a simulator by its own equations, number by number.

A simulator answers forces and moments with accelerations; about hover they are lines,

.. math::

    \begin{pmatrix} \dot V \\ \dot \omega \end{pmatrix} \approx A \begin{pmatrix} V \\ \omega \end{pmatrix}
    + B (x - x_h), \qquad T \dot x = u - x

with the velocity and the rates in body axes, gravity and attitude left out, and the lagged outputs :math:`x` of the
rotors. For a body of mass :math:`m` and inertia :math:`I` under rotors with the effectiveness :math:`W` and the slope
of thrust :math:`F'_h`, that carries linear forces :math:`D`,

.. math:: A = J^{-1} D, \qquad B = J^{-1} W F'_h, \qquad J = \mathrm{diag}(m, m, m, I)

The equations of a target are transcribed where the target is, and linearized here by central differences.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.display import listed
from rotorid.exports.target import Compared, Fidelity
from rotorid.flying.vehicle_air import AIR_UNITS
from rotorid.simulation.linearization import hover_slopes
from rotorid.simulation.multirotor import STATES
from rotorid.typing import FloatArray

if TYPE_CHECKING:
    from rotorid.flying.vehicle_from_results import JoinedVehicle
    from rotorid.simulation.multirotor import Multirotor

Accelerations: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]
"""Lagged outputs, velocity (m/s) and rates (rad/s) in FRD to accelerations without gravity, shape ``(6,)``."""

VERTICAL, ROLL, PITCH, YAW = (f"{word} acceleration per output" for word in ("vertical", "roll", "pitch", "yaw"))
LAG, HOVER, DELAY = "motor lag", "hover output", "delay"

_GAINS: Mapping[str, tuple[int, str]] = {
    VERTICAL: (2, "m/s^2"),
    ROLL: (3, "rad/s^2"),
    PITCH: (4, "rad/s^2"),
    YAW: (5, "rad/s^2"),
}
_DERIVATIVES: Mapping[str, tuple[int, int, str]] = {
    "X_u": (0, 0, "1/s"),
    "Y_v": (1, 1, "1/s"),
    "Z_w": (2, 2, "1/s"),
    "M_u": (4, 0, "1/(m s)"),
    "L_v": (3, 1, "1/(m s)"),
    "L_p": (3, 3, "1/s"),
    "M_q": (4, 4, "1/s"),
    "N_r": (5, 5, "1/s"),
}
"""Rows and columns of ``A``."""

AIR = tuple(name for name in AIR_UNITS if name != "k_d")
"""What moving air does to rotors and body beyond drag that is linear, in the names of `rotorid.models.flight`."""

_STEP = 1e-4
_NOTHING = 1e-9


@dataclass(frozen=True, kw_only=True, eq=False)
class HoverMotion(Immutable):
    """Motion about hover.

    Parameters
    ----------
    by_output
        Accelerations per output of each rotor, shape ``(6, rotors)``: m/s² and rad/s².
    by_motion
        Accelerations per velocity and rate, shape ``(6, 6)``.
    hover_output
        Mean output of the rotors in hover.
    lag_s
        Of the motors; ``None`` where there is none or it is not known.
    """

    by_output: FloatArray
    by_motion: FloatArray
    hover_output: float
    lag_s: float | None = None

    def __post_init__(self) -> None:
        self._set(
            by_output=read_only(self.by_output, np.float64, ndim=2),
            by_motion=read_only(self.by_motion, np.float64, ndim=2),
        )

    def replaced(self, by_output: FloatArray, *, hover_output: float | None = None) -> HoverMotion:
        """The same for other outputs: of other rotors, or of what makes the outputs."""
        hover = self.hover_output if hover_output is None else hover_output
        return replace(self, by_output=by_output, hover_output=hover)


def identified_motion(vehicle: JoinedVehicle, multirotor: Multirotor, *, lag_s: float | None) -> HoverMotion:
    """A vehicle about hover, as its numbers say.

    Parameters
    ----------
    vehicle, multirotor
        What was identified, and the body of it.
    lag_s
        Lag that a simulator should have, the delay included where it stands for that too.
    """
    body = _inertial(multirotor)
    return HoverMotion(
        by_output=np.asarray(np.linalg.solve(body, multirotor.wrench * vehicle.hover_slope_n), dtype=np.float64),
        by_motion=np.asarray(np.linalg.solve(body, hover_air(multirotor)), dtype=np.float64),
        hover_output=vehicle.hover_output,
        lag_s=lag_s,
    )


def _inertial(multirotor: Multirotor) -> FloatArray:
    body = np.zeros((6, 6))
    body[:3, :3] = multirotor.mass_kg * np.eye(3)
    body[3:, 3:] = multirotor.inertia_kg_m2
    return body


def hover_air(multirotor: Multirotor) -> FloatArray:
    """Force (N) and moment (N m) by velocity and rate about hover, of rotors and body together, shape ``(6, 6)``."""
    air = multirotor.aerodynamics
    assert air is not None
    return _inertial(multirotor) @ hover_slopes(multirotor) if multirotor.body().has_air else air


def fastest_m_s(vehicle: JoinedVehicle) -> float | None:
    """Airspeed along the discs up to which a vehicle was identified, in whole m/s; ``None`` where nobody knows."""
    fastest = [model.flight.limits.edge_m_s[1] for model in vehicle.models if model.flight is not None]
    return max(float(np.floor(max(fastest))), 1.0) if fastest else None


def in_flight(
    vehicle: JoinedVehicle,
    multirotor: Multirotor,
    accelerations: Accelerations,
    hover_outputs: FloatArray,
    *,
    drag: Fidelity = "approximated",
    lift: Fidelity = "not",
) -> tuple[Compared, ...]:
    """Rows of forward flight at the outputs of hover, at the largest speed that was identified; none without one.

    Parameters
    ----------
    vehicle, multirotor
        What was identified, and the body of it.
    accelerations
        The equations of the simulator, without gravity.
    hover_outputs
        Of each rotor there.
    drag, lift
        How the target holds both.
    """
    speed = fastest_m_s(vehicle)
    if speed is None:
        return ()
    moving, still = np.array([speed, 0.0, 0.0]), np.zeros(3)
    rows = []
    own = (accelerations_of(multirotor, multirotor.hover_shares, velocity) for velocity in (moving, still))
    theirs = (accelerations(hover_outputs, velocity, still) for velocity in (moving, still))
    differences = [fast - slow for fast, slow in (tuple(own), tuple(theirs))]
    # As sure as the derivatives of hover, which are made of the same products.
    for name, axis, held, cause, like in (("drag", 0, drag, "k_d", "X_u"), ("lift gained", 2, lift, "c_lambda", "Z_w")):
        if cause not in vehicle.numbers:
            continue
        was, now = (-float(difference[axis]) + 0.0 for difference in differences)
        number = vehicle.numbers[like]
        std = abs(was * number.std / number.value) if number.std and number.value else None
        row = Compared(
            name=f"{name} at {speed:g} m/s", unit="m/s^2", identified=was, exported=now, held=held, identified_std=std
        )
        rows.append(row)
    return tuple(rows)


def lost_air(vehicle: JoinedVehicle, *kept: str) -> list[str]:
    """A sentence with the names of what a flight showed of the air and a target has about hover only, or not at all.

    Parameters
    ----------
    vehicle
        Says what was identified.
    kept
        What the target has at speed too.
    """
    lost = [name for name in AIR if name in vehicle.numbers and name not in kept and vehicle.numbers[name].value != 0.0]
    if fastest_m_s(vehicle) is None or not lost:
        return []
    return [f"Away from hover the identified {listed(lost)} {'is' if len(lost) == 1 else 'are'} lost."]


def accelerations_of(multirotor: Multirotor, outputs: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
    """Accelerations of a level vehicle without gravity, FRD, shape ``(6,)``."""
    from rotorid.simulation.flight_kernels import derivative

    state = multirotor.hovering()
    state[3:6], state[STATES:] = velocity_m_s, outputs
    out = np.zeros(state.size + 3)
    derivative(state, state[STATES:].copy(), np.zeros(3), 1.0, multirotor.body(), out)
    return np.concatenate([out[-3:], out[10:13]])


def linearized(
    accelerations: Accelerations, hover_outputs: FloatArray, *, lag_s: float | None, output: float | None = None
) -> HoverMotion:
    """The equations of a simulator about hover, by central differences.

    Parameters
    ----------
    accelerations
        The equations, without gravity.
    hover_outputs
        Of each rotor, shape ``(rotors,)``.
    lag_s
        Time constant of the pole that the lag of the simulator has.
    output
        Output in hover; by default the mean of ``hover_outputs``.

    Examples
    --------
    >>> motion = linearized(lambda x, v, w: np.array([0, 0, -sum(x**2), 0, 0, 0]) - np.r_[v, w], np.ones(2), lag_s=None)
    >>> motion.by_output[2].round(9).tolist(), motion.by_motion[2, 2].round(9).item()
    ([-2.0, -2.0], -1.0)
    """
    x, still = np.asarray(hover_outputs, dtype=np.float64), np.zeros(3)

    def slope(of: Callable[[FloatArray], FloatArray], count: int) -> FloatArray:
        steps = _STEP * np.eye(count)
        return np.stack([(of(step) - of(-step)) / (2.0 * _STEP) for step in steps], axis=1)

    return HoverMotion(
        by_output=slope(lambda step: accelerations(x + step, still, still), len(x)),
        by_motion=slope(lambda step: accelerations(x, step[:3], step[3:]), 6),
        hover_output=float(x.mean()) if output is None else output,
        lag_s=lag_s,
    )


def compared(
    vehicle: JoinedVehicle,
    identified: HoverMotion,
    exported: HoverMotion,
    fidelities: Mapping[str, Fidelity],
    *,
    delay: bool = False,
) -> tuple[Compared, ...]:
    """Rows of the round trip: gains, hover output, lag, delay, and the derivatives that are known.

    A gain is what all rotors together do when each moves in proportion to what it does on that axis, the most effective
    by one output. The output in hover is compared with the mean that the result states of its flights, not with what
    follows from the numbers that were exported.

    Parameters
    ----------
    vehicle
        Says which derivatives are known, and the delay.
    identified, exported
        Motion about hover.
    fidelities
        How the target holds each row, by its name: exactly where nothing is said.
    delay
        Whether the lag of the simulator contains the delay.

    """
    return tuple(_rows(vehicle, identified, exported, fidelities, delay=delay))


def _rows(
    vehicle: JoinedVehicle,
    identified: HoverMotion,
    exported: HoverMotion,
    fidelities: Mapping[str, Fidelity],
    *,
    delay: bool,
) -> Iterable[Compared]:
    spread = _spread(vehicle)

    def row(name: str, unit: str, was: float, is_now: float, usual: Fidelity = "exact") -> Compared:
        kind = fidelities.get(name, usual)
        return Compared(
            name=name, unit=unit, identified=was, exported=is_now, held=kind, identified_std=spread.get(name)
        )

    for name, (axis, unit) in _GAINS.items():
        yield row(name, unit, _gain(identified, axis), float(exported.by_output[axis] @ _pattern(identified, axis)))
    stated = vehicle.stated_hover_output
    close = abs(stated / identified.hover_output - 1.0) <= _SAME_HOVER
    yield row(HOVER, "1", stated, exported.hover_output, "exact" if close else "approximated")
    if identified.lag_s is not None:
        name = f"{LAG} and {DELAY}" if delay and DELAY in vehicle.numbers else LAG
        now = exported.lag_s
        yield Compared(
            name=name,
            unit="s",
            identified=identified.lag_s,
            exported=0.0 if now is None else now,
            held="not" if now is None else fidelities.get(LAG, "exact"),
            identified_std=_std_of(vehicle, "T_motor", *([DELAY] if name != LAG else [])),
        )
    if (late := vehicle.numbers.get(DELAY)) is not None and late.value > 0.0 and not delay:
        yield row(DELAY, "s", late.value, 0.0, "not")
    for name, (i, j, unit) in _DERIVATIVES.items():
        if name in vehicle.numbers:
            yield row(name, unit, float(identified.by_motion[i, j]), float(exported.by_motion[i, j]))


_SAME_HOVER = 0.005
"""Share by which the output of the flights may differ from that by mass and thrust, and is still held exactly."""


def _pattern(motion: HoverMotion, axis: int) -> FloatArray:
    """How much each rotor moves for an axis, the most effective by one."""
    effect = motion.by_output[axis]
    most = float(np.abs(effect).max())
    return effect / most if most > _NOTHING else np.zeros_like(effect)


def _gain(motion: HoverMotion, axis: int) -> float:
    return float(motion.by_output[axis] @ _pattern(motion, axis))


def _std_of(vehicle: JoinedVehicle, *names: str) -> float | None:
    stds = [vehicle.numbers[name].std for name in names if name in vehicle.numbers]
    return float(np.hypot.reduce([std for std in stds if std])) if any(stds) else None


def _spread(vehicle: JoinedVehicle) -> dict[str, float]:
    """One standard deviation of each row: of derivatives their own, of what follows from several over the draws."""
    found = {name: std for name in (*_DERIVATIVES, DELAY) if (std := _std_of(vehicle, name)) is not None}
    bodies = [(draw, draw.multirotor) for draw in vehicle.draws if draw.multirotor is not None]
    if len(bodies) < _FEWEST_DRAWS:
        return found
    motions = [identified_motion(vehicle, body, lag_s=None) for vehicle, body in bodies]
    rows = {name: [_gain(motion, axis) for motion in motions] for name, (axis, _) in _GAINS.items()}
    rows[HOVER] = [motion.hover_output for motion in motions]
    return found | {name: float(np.std(values, ddof=1)) for name, values in rows.items()}


_FEWEST_DRAWS = 20
