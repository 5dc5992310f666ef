r"""Where the rotors of a vehicle sit, which way they turn, and what their thrusts and its mixer do with that.

Rotor :math:`i` at :math:`r_i` pushes along the unit vector :math:`a_i` with the thrust :math:`T_i`, and its drag turns
the vehicle the other way round than it turns itself:

.. math::

    F = \sum_i a_i T_i, \qquad M = \sum_i (r_i \times a_i - s_i \kappa a_i) \, T_i

with :math:`s = +1` for a rotor that turns counterclockwise seen from above and :math:`-1` for a clockwise one, and
:math:`\kappa` the ratio of torque to thrust in meters. Axes are forward, right, down, so that for rotors that push
straight up (:math:`a = (0, 0, -1)`)

.. math:: F_z = -\sum T_i, \quad L = -\sum y_i T_i, \quad M = \sum x_i T_i, \quad N = \kappa \sum s_i T_i

A counterclockwise rotor turns the nose to the right, which is a positive yaw moment.

A layout comes from the library by name, from a user's TOML, or from the parameters in a log. The mixers of the
autopilots follow from it; their columns are those of `rotorid.signal.motors.COMMANDS`: roll, pitch, yaw, thrust. A
matrix in print need not belong to a layout: :func:`check_mixer` says of any

.. math:: U = B F, \qquad U = (U_1, U_2, U_3, U_4)

of thrust and moments U and motor thrusts F whether the four can be had independently.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, warn
from rotorid.errors import ModelError
from rotorid.io.documents import DocumentError, parse_toml
from rotorid.models.parameter import no_such
from rotorid.typing import FloatArray

UP = (0.0, 0.0, -1.0)
"""Thrust of a rotor that is not tilted, in body axes."""

_TYPICAL_KAPPA = 0.1
"""Torque over thrust and arm, for judging rank alone: a rotor's is 0.02 to 0.2 of its arm."""

_SMALLEST = 1e-6
_LARGEST = 1e3


@dataclass(frozen=True, kw_only=True, eq=False)
class RotorLayout(Immutable):
    """Positions, thrust axes and directions of rotation, in the order in which the vehicle numbers its motors.

    Parameters
    ----------
    name
        What messages call it.
    positions
        Forward, right and down of the center of gravity, shape ``(rotors, 3)``; meters when ``arm_known``, else in
        units of the arm, the horizontal distance of the farthest rotor.
    spins
        +1 for a rotor that turns counterclockwise seen from above (and turns the nose right), -1 for a clockwise one,
        shape ``(rotors,)``.
    axes
        Direction of the thrust, shape ``(rotors, 3)``; straight up when none is given. They are made unit vectors.
    arm_known
        Whether the positions are in meters.
    yaw_weights
        The weights of yaw in the autopilot's mixer where they are not the spins, shape ``(rotors,)``.
    source
        Source of the layout.
    findings
        What an engineer should know of it.

    Examples
    --------
    >>> layout = RotorLayout(name="quad.x", positions=[[1, 1, 0], [-1, -1, 0], [1, -1, 0], [-1, 1, 0]],
    ...                      spins=[1, 1, -1, -1])
    >>> layout.motor_names, layout.uncontrollable
    (('motor_1', 'motor_2', 'motor_3', 'motor_4'), ())
    >>> layout.scaled(0.25).moment_arms[0].round(4).tolist()
    [-0.1768, 0.1768, 0.1768, -0.1768]
    """

    name: str
    positions: FloatArray
    spins: FloatArray
    axes: FloatArray | None = None
    arm_known: bool = False
    yaw_weights: FloatArray | None = None
    source: str = ""
    findings: tuple[Finding, ...] = field(default=())

    def __post_init__(self) -> None:
        positions = read_only(self.positions, np.float64, ndim=2)
        spins = read_only(self.spins, np.float64, ndim=1)
        axes = np.tile(UP, (spins.size, 1)) if self.axes is None else np.array(self.axes, dtype=np.float64)
        weights = spins if self.yaw_weights is None else read_only(self.yaw_weights, np.float64, ndim=1)
        if not spins.size or not positions.shape == axes.shape == (spins.size, 3) or weights.size != spins.size:
            raise ModelError(
                f"the layout {self.name} has positions of shape {positions.shape}, axes of shape {axes.shape}, "
                f"{spins.size} spins and {weights.size} weights of yaw",
                needed="three coordinates, an axis, a spin and a weight for each rotor",
            )
        length = np.linalg.norm(axes, axis=1)
        if not (np.isfinite(positions).all() and np.isin(spins, (-1.0, 1.0)).all() and (length > _SMALLEST).all()):
            raise ModelError(
                f"the layout {self.name} has a position that is not a number, a spin that is not +1 or -1, or an axis "
                "without a direction",
                needed="finite positions, spins of +1 (ccw) or -1 (cw), axes that are not zero",
            )
        self._set(
            positions=positions,
            spins=spins,
            axes=read_only(axes / length[:, None], np.float64, ndim=2),
            yaw_weights=weights,
            findings=tuple(self.findings),
        )

    @property
    def rotors(self) -> int:
        return int(self.spins.size)

    @property
    def motor_names(self) -> tuple[str, ...]:
        """Names of the channels of the motors."""
        return tuple(f"motor_{number}" for number in range(1, self.rotors + 1))

    @property
    def arm(self) -> float:
        """Horizontal distance of the farthest rotor from the center of gravity: meters, or one when it is unknown."""
        return float(np.hypot(self.positions[:, 0], self.positions[:, 1]).max())

    @property
    def thrust_axes(self) -> FloatArray:
        """Force on the vehicle per newton of thrust, shape ``(3, rotors)``."""
        assert self.axes is not None
        return self.axes.T

    @property
    def moment_arms(self) -> FloatArray:
        """Moment per newton of thrust by the positions alone, shape ``(3, rotors)``, in the unit of the positions."""
        return np.cross(self.positions, self.thrust_axes.T).T

    @property
    def torque_axes(self) -> FloatArray:
        r"""Moment per newton of thrust and per meter of :math:`\kappa` by the drag of the rotors, ``(3, rotors)``."""
        return -self.spins * self.thrust_axes

    def effectiveness(self, kappa: float) -> FloatArray:
        r"""Forces x, y, z and moments L, M, N per newton of thrust of each rotor, shape ``(6, rotors)``.

        Parameters
        ----------
        kappa
            Torque over thrust, in the unit of the positions.
        """
        return np.concatenate([self.thrust_axes, self.moment_arms + kappa * self.torque_axes])

    @property
    def uncontrollable(self) -> tuple[str, ...]:
        """Those of thrust, roll, pitch and yaw that the rotors cannot make without the others; empty for a good layout.

        An axis is controllable when it adds to the rank of the four: a plus whose rotors all turn the same way has no
        yaw, a row of rotors no moment about the row.
        """
        rows = self.effectiveness(_TYPICAL_KAPPA * self.arm)[2:]
        names = ("thrust", "roll", "pitch", "yaw")
        size = np.linalg.norm(rows, axis=1)
        scaled = rows / np.where(size > _SMALLEST * max(self.arm, _SMALLEST), size, np.inf)[:, None]
        rank = np.linalg.matrix_rank(scaled, tol=_SMALLEST)
        return tuple(
            name
            for row, name in enumerate(names)
            if np.linalg.matrix_rank(np.delete(scaled, row, axis=0), tol=_SMALLEST) == rank
        )

    def scaled(self, arm_m: float) -> RotorLayout:
        """The same layout with the farthest rotor at the horizontal distance ``arm_m``.

        Raises
        ------
        ModelError
            The length is not positive, or all rotors sit on the axis of yaw.
        """
        if not 0.0 < arm_m < np.inf or self.arm < _SMALLEST:
            raise ModelError(
                f"an arm of {arm_m:g} m contradicts the layout {self.name}, whose arm is {self.arm:g}",
                needed="a positive length and rotors away from the axis of yaw",
            )
        return replace(self, positions=self.positions * (arm_m / self.arm), arm_known=True)


SPINS: Mapping[str, float] = MappingProxyType({"ccw": 1.0, "cw": -1.0})
"""Sense of rotation seen from above to the sign of the yaw moment on the vehicle."""

_NEEDED = (
    'tables [[rotor]], each with position_m = [forward, right, down] and spin = "ccw" or "cw" seen from above, '
    "in the order of the motors; axis = [x, y, z] for a tilted rotor"
)


@cache
def _library() -> Mapping[str, Mapping[str, Any]]:
    text = files("rotorid.models").joinpath("rotor_layouts.toml").read_text(encoding="utf-8")
    return MappingProxyType(tomllib.loads(text))


def layout_names() -> tuple[str, ...]:
    """Names of the layouts in the library, sorted.

    Examples
    --------
    >>> [name for name in layout_names() if name.startswith("quad.x")]
    ['quad.x', 'quad.x.betaflight', 'quad.x.betaflight.reversed', 'quad.x.clockwise', 'quad.x.crazyflie', 'quad.x.dji']
    """
    return tuple(sorted(_library()))


def library_layout(name: str) -> RotorLayout:
    """A layout of the library, in units of the arm.

    The order of the motors is that of ArduPilot and PX4 unless the name says otherwise. Real frames are often longer
    than wide; the library knows the pattern and not the ratio.

    Parameters
    ----------
    name
        One of :func:`layout_names`.

    Raises
    ------
    ModelError
        There is no such layout.

    Examples
    --------
    >>> layout = library_layout("quad.plus")
    >>> layout.positions.round(12).tolist()[0], layout.spins.tolist()
    ([0.0, 1.0, 0.0], [1.0, 1.0, -1.0, -1.0])
    """
    if name not in _library():
        raise no_such("rotor layout", name, layout_names())
    entry = _library()[name]
    if "angles_deg" in entry:
        angles = np.radians(entry["angles_deg"])
        flat = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    else:
        flat = np.array(entry["positions"], dtype=np.float64)
        flat /= np.hypot(flat[:, 0], flat[:, 1]).max()
    return RotorLayout(
        name=name,
        positions=np.column_stack([flat, np.zeros(len(flat))]),
        spins=np.array([SPINS[spin] for spin in entry["spin"].split()]),
        yaw_weights=None if "yaw" not in entry else np.array(entry["yaw"]),
        source="the library",
    )


def named_by(key: str, value: Any) -> str | None:
    """The layout whose ``ardupilot`` or ``px4`` list holds ``value``, or ``None``."""
    return next((name for name, entry in _library().items() if value in entry.get(key, ())), None)


def layout_from_toml(text: str, *, where: str) -> RotorLayout:
    """A layout from a description: one table ``[[rotor]]`` for each motor, in the order of the log's motors.

    Parameters
    ----------
    text
        The description. ``name`` is optional.
    where
        What the messages call it.

    Raises
    ------
    ModelError
        It is no TOML, or a rotor lacks what it needs.

    Examples
    --------
    >>> text = '''
    ... [[rotor]]
    ... position_m = [0.1, 0.12, 0.0]
    ... spin = "ccw"
    ... [[rotor]]
    ... position_m = [-0.1, -0.12, 0.0]
    ... spin = "cw"
    ... axis = [0.0, 0.1, -1.0]
    ... '''
    >>> layout = layout_from_toml(text, where="frame.toml")
    >>> layout.arm_known, round(layout.arm, 4)
    (True, 0.1562)
    """
    try:
        table = parse_toml(text)
    except DocumentError as error:
        raise ModelError(f"{where} is no TOML: {error}", needed=_NEEDED) from error
    unknown = sorted(set(table) - {"name", "rotor"})
    rotors = table.get("rotor")
    if unknown or not isinstance(rotors, list) or not all(isinstance(rotor, dict) for rotor in rotors) or not rotors:
        available = ", ".join(unknown) or "no tables [[rotor]]"
        raise ModelError(f"{where} has {available}", needed=_NEEDED)
    rows = [_rotor(rotor, f"{where}, rotor {number}") for number, rotor in enumerate(rotors, start=1)]
    return RotorLayout(
        name=_name_of(table, where),
        positions=np.array([position for position, _, _ in rows]),
        spins=np.array([spin for _, spin, _ in rows]),
        axes=np.array([axis for _, _, axis in rows]),
        arm_known=True,
        source=where,
    )


def _name_of(table: Mapping[str, Any], where: str) -> str:
    name = table.get("name", where)
    if not isinstance(name, str):
        raise ModelError(f"{where} has the name {name!r}", needed="a text in quotes")
    return name


def _rotor(rotor: Mapping[str, Any], where: str) -> tuple[FloatArray, float, FloatArray]:
    unknown = sorted(set(rotor) - {"position_m", "spin", "axis"})
    if unknown:
        raise ModelError(f"{where} has {', '.join(unknown)}", needed=_NEEDED)
    if not isinstance(rotor.get("spin"), str) or rotor["spin"] not in SPINS:
        raise ModelError(f"{where} has the spin {rotor.get('spin')!r}", needed='"ccw" or "cw", seen from above')
    return (
        _vector(rotor.get("position_m"), f"{where}, position_m"),
        SPINS[rotor["spin"]],
        _vector(rotor.get("axis", UP), f"{where}, axis"),
    )


def _vector(value: Any, where: str) -> FloatArray:
    numbers = value if isinstance(value, Sequence) and not isinstance(value, str) else ()
    if len(numbers) != 3 or not all(
        isinstance(number, int | float) and not isinstance(number, bool) for number in numbers
    ):
        raise ModelError(f"{where} is {value!r}", needed="three numbers: forward, right, down")
    vector = np.array(numbers, dtype=np.float64)
    if np.any(np.abs(vector) > _LARGEST):
        raise ModelError(f"{where} is {value!r}", needed=f"three numbers of at most {_LARGEST:g}")
    return vector


_ANY_KAPPA = 0.05


def ardupilot_mixer(layout: RotorLayout) -> FloatArray:
    r"""Share of full thrust that ArduPilot asks of each motor per unit of roll, pitch, yaw and thrust, ``(rotors, 4)``.

    .. math:: m_i = -\frac{y_i}{2 \max|y|}, \; \frac{x_i}{2 \max|x|}, \; \frac{w_i}{2 \max|w|}, \; 1

    with the weights of yaw :math:`w`, which are the spins for most frames. Each axis is normalized for itself, so that
    the length and width of the frame do not matter. Tilted rotors are mixed as if they were not.

    Parameters
    ----------
    layout
        Places and spins of the rotors.

    References
    ----------
    ArduPilot, AP_MotorsMatrix: factors of the motors, normalized to one half.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> ardupilot_mixer(library_layout("quad.x")).round(12).tolist()[0]
    [-0.5, 0.5, 0.5, 1.0]
    """
    assert layout.yaw_weights is not None
    factors = np.stack([-layout.positions[:, 1], layout.positions[:, 0], layout.yaw_weights], axis=1)
    largest = np.abs(factors).max(axis=0)
    return np.column_stack([0.5 * factors / np.where(largest > 0.0, largest, 1.0), np.ones(layout.rotors)])


def px4_mixer(layout: RotorLayout) -> FloatArray:
    r"""Actuator of each motor per unit of torque set-point (roll, pitch, yaw) and of thrust, shape ``(rotors, 4)``.

    PX4 (1.13 and later) inverts the effectiveness, :math:`B = E^+`, and divides the columns: roll and pitch by the
    larger of :math:`\sqrt{2 \sum_i b_i^2 / n}` of the two, with :math:`n` the motors that take part; yaw by its largest
    element; thrust by the mean of its absolute values. The rows of the effectiveness may then have any scale, so that
    neither the arm nor the torque of the rotors matters. Holds while no actuator is at a limit.

    Parameters
    ----------
    layout
        Places, spins and tilts of the rotors.

    References
    ----------
    PX4, ControlAllocationPseudoInverse and ActuatorEffectivenessRotors.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> px4_mixer(library_layout("quad.x")).round(4).tolist()[0]
    [-0.7071, 0.7071, 1.0, 1.0]
    """
    rows = layout.effectiveness(_ANY_KAPPA * layout.arm)
    inverse = np.linalg.pinv(rows)[:, [3, 4, 5, 2]]
    inverse[:, 3] *= -1.0
    largest = np.abs(inverse).max(axis=0)
    used = np.abs(inverse) > 1e-3 * np.where(largest > 0.0, largest, np.inf)
    root = np.sqrt(2.0 * np.sum(inverse**2, axis=0) / np.maximum(used.sum(axis=0), 1))
    tilt = max(root[0], root[1])
    mean = np.sum(np.abs(inverse[:, 3])) / max(int(used[:, 3].sum()), 1)
    scale = np.array([tilt, tilt, inverse[:, 2].max(), mean])
    return np.asarray(inverse / np.where(scale > 0.0, scale, 1.0))


MOMENTS = ("U1", "U2", "U3", "U4")
"""Rows of a mixer: thrust in N; moments of roll, pitch and yaw in N m."""

_SINGULAR = 1e-9


def check_mixer(matrix: FloatArray) -> list[Finding]:
    """A remark if thrust and moments cannot be had independently of each other.

    Parameters
    ----------
    matrix
        Shape ``(4, k)``: thrust, moments of roll, pitch and yaw of every motor.

    Raises
    ------
    ModelError
        The matrix has other rows.

    Examples
    --------
    One that is found in print, with motors in a plus and the yaw of an X:

    >>> l, kappa = 0.23, 0.05
    >>> printed = np.array([[1, 1, 1, 1], [0, -l, 0, l], [l, 0, -l, 0], [kappa, kappa, -kappa, -kappa]])
    >>> check_mixer(printed)[0].message
    'The mixer is singular, of rank 3: U4 = -0.2174 U2 + 0.2174 U3 whatever the motors do.'
    """
    mixer = np.asarray(matrix, dtype=np.float64)
    if mixer.ndim != 2 or len(mixer) != len(MOMENTS):
        raise ModelError(f"got a mixer of shape {mixer.shape}", needed="shape (4, motors): thrust, roll, pitch, yaw")
    length = np.linalg.norm(mixer, axis=1)
    scaled = mixer / np.where(length > 0.0, length, 1.0)[:, None]
    rank = int(np.sum(np.linalg.svd(scaled, compute_uv=False) > _SINGULAR))
    if rank == len(MOMENTS):
        return []
    message = f"The mixer is singular, of rank {rank}: {_dependence(mixer, scaled)} whatever the motors do."
    return [warn("singular_mixer", "mixer", message, rank=float(rank))]


def _dependence(mixer: FloatArray, scaled: FloatArray) -> str:
    """The first moment that those before it already give, as a sum of them."""
    for row in range(len(MOMENTS)):
        before = mixer[:row]
        shares = np.linalg.lstsq(scaled[:row].T, scaled[row], rcond=None)[0]
        if np.linalg.norm(shares @ scaled[:row] - scaled[row]) <= _SINGULAR:
            length = np.where((norm := np.linalg.norm(before, axis=1)) > 0.0, norm, 1.0)
            factors = shares * np.linalg.norm(mixer[row]) / length
            terms = [
                f"{'-' if factor < 0 else '+'} {abs(factor):.4g} {name}"
                for factor, name in zip(factors.tolist(), MOMENTS, strict=False)
                if abs(factor) > _SINGULAR
            ]
            return f"{MOMENTS[row]} = {_joined(terms)}"
    raise AssertionError("a matrix without full rank has a row that the others give")


def _joined(terms: list[str]) -> str:
    if not terms:
        return "0"
    text = " ".join(terms)
    return text.removeprefix("+ ") if text.startswith("+") else text.replace("- ", "-", 1)
