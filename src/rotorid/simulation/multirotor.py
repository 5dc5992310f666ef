r"""A multirotor as a rigid body with rotors, air, a battery and sensors: what flies in a nonlinear simulation.

With the velocity :math:`V` through the air and the rates :math:`\omega` in body axes, position and velocity over
ground in earth axes, the quaternion :math:`q` from body to earth and the speed :math:`x_i` of each rotor as a share of
its largest,

.. math::

    \dot v = g + \tfrac{1}{m} R(q) F, \qquad
    \dot\omega = J^{-1} \left[ M - \omega \times (J \omega + h) - \dot h \right], \qquad
    \dot q = \tfrac{1}{2} q \otimes (0, \omega), \qquad T_i \dot x_i = \gamma u_i - x_i

where :math:`T_i` is one lag upward and another one downward, :math:`\gamma` the voltage over the rated one, and
:math:`h = \sum s_i J_r \Omega_i a_i` the angular momentum of the rotors. Each rotor at :math:`r_i` moves through the
air with :math:`V_i = V + \omega \times r_i` and makes

.. math::

    F_i = a_i \left( c_0 + c_1 x_i + c_2 x_i^2 + k_w x_i w_i \right) - h_d x_i \, \eta_i \, (u_i, v_i, 0)^T, \qquad
    M_i = r_i \times F_i - s_i a_i Q(x_i)

with the inflow :math:`k_w`, the induced drag :math:`h_d`, and :math:`\eta_i = 1`, or :math:`\sqrt{u_i^2 + v_i^2}/|V_i|`
as in Niermeyer, Raffler and Holzapfel, eq 2. The body adds a force and a moment linear in :math:`(V, \omega)`, which
holds whatever stability derivatives were published, and a drag that grows with the square.

Rotors with a :class:`RotorFlow` change the velocity that they induce with their motion, by momentum theory, flap and
feel the wake of each other: the equations of `rotorid.models.flight`. Thrust and torque are those of hover all the
same, so that only what the motion changes is added.

Left out: ground effect, elastic frames.

Value objects come first. What compiled code reads (:class:`Body`, :class:`Supply`, :class:`Senses`, :class:`Control`)
are the same numbers as plain arrays under names, with the columns in which a flight is logged.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from rotorid.data.base import Immutable, read_only
from rotorid.errors import ModelError, UsageError
from rotorid.models.flight import AIR_DENSITY_KG_M3, CURVE_TERMS, speeds_of_outputs
from rotorid.models.rotors import RotorLayout
from rotorid.typing import FloatArray, IntArray
from rotorid.units import STANDARD_GRAVITY_M_S2

STATES = 13
"""Position, velocity (north, east, down), quaternion (w, x, y, z; body to earth), rates. The rotors come after."""


@dataclass(frozen=True, kw_only=True)
class RotorFlow(Immutable):
    r"""What rotors do beyond drag and inflow that are linear in the motion; the equations of `rotorid.models.flight`.

    With the edgewise flow :math:`h_i` of length :math:`|h_i|`, the climb :math:`c_i = -w_i`, the induced velocity
    :math:`v_i` and the inflow :math:`\lambda_i = c_i + v_i` of each rotor at the share :math:`x_i` of its full speed,
    of which thrust is the square: the root of its thrust in hover over that at full output. Drag, inflow and momentum
    of the rotors go by that share too.

    Parameters
    ----------
    disc_m2
        Area that a rotor sweeps: the inflow of :attr:`Rotors.inflow_n_s_m` takes in the change of the induced velocity
        from that of hover. Zero: only the motion counts.
    air_density_kg_m3
        Of the air.
    edge_lift_n_s_m
        Thrust by :math:`x_i |h_i|`.
    edge_climb_lift_n_s2_m2, edge_speed_lift_n_s2_m2
        Thrust by :math:`|h_i| c_i`, and by :math:`|h_i| |c_i|`.
    wake_n_s2_m3
        Thrust by :math:`(r_i \cdot h_i) c_i`.
    climb_drag_n_s2_m2
        Drag across the rotor by :math:`c_i`, in addition to the induced drag.
    flapping_n_s
        Moment that tilts back, by :math:`x_i v_{ind} h_i / (|\lambda_i| + \sqrt{h_i^2 + \lambda_i^2})`.
    forward_flapping_n_s
        What forward flow adds to that.
    side_flapping_n_s
        Moment to the side of the rotor's turn, by :math:`x_i h_i`.
    inflow_torque_n_s2_m
        Torque by the change of :math:`\lambda_i^2` from that of hover.
    yaw_damping_n_m_s
        Moment against the yaw rate by :math:`x_i`.
    """

    disc_m2: float = 0.0
    air_density_kg_m3: float = AIR_DENSITY_KG_M3
    edge_lift_n_s_m: float = 0.0
    edge_climb_lift_n_s2_m2: float = 0.0
    edge_speed_lift_n_s2_m2: float = 0.0
    wake_n_s2_m3: float = 0.0
    climb_drag_n_s2_m2: float = 0.0
    flapping_n_s: float = 0.0
    forward_flapping_n_s: float = 0.0
    side_flapping_n_s: float = 0.0
    inflow_torque_n_s2_m: float = 0.0
    yaw_damping_n_m_s: float = 0.0

    def __post_init__(self) -> None:
        numbers = vars(self)
        if not np.isfinite(list(numbers.values())).all() or self.disc_m2 < 0.0 or not self.air_density_kg_m3 > 0.0:
            raise ModelError(
                f"the flow of the rotors has {', '.join(f'{name} = {value:g}' for name, value in numbers.items())}",
                needed="finite numbers, a disc of zero or more, and a positive density",
            )

    def induced_m_s(self, thrust_n: float) -> float:
        """Velocity that a rotor induces in hover, m/s; zero without a disc."""
        return float(np.sqrt(thrust_n / (2.0 * self.air_density_kg_m3 * self.disc_m2))) if self.disc_m2 else 0.0


AIR = ("disc_m2", "air_density_kg_m3")
"""What of a :class:`RotorFlow` is no coefficient."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rotors(Immutable):
    r"""Where the rotors are and what they do.

    Parameters
    ----------
    layout
        Positions in meters from the geometric center, axes, directions of rotation.
    thrust
        Coefficients of the powers 0, 1 and 2 of the speed's share of its largest, in newtons, in still air.
    torque_per_thrust_m
        Torque over thrust; ``torque`` overrides it.
    torque
        Coefficients like those of ``thrust``, in newton meters.
    lag_up_s, lag_down_s
        First-order lags of speed; ``lag_down_s`` is ``lag_up_s`` when none is given, and zero means no lag.
    induced_drag_n_s_m
        Force against the motion across the rotor, per m/s, at full speed.
    inclined
        Whether that drag shrinks with the inclination of the inflow, as in the equation named at the head.
    inflow_n_s_m
        Thrust gained per m/s of descent, at full speed; :math:`-\rho n D^3 \, dc_T/dJ`.
    inertia_kg_m2, full_speed_rad_s
        Of one rotor about its axis, and its speed at a share of one: gyroscopic moments, and reactions to acceleration.
    flow
        Induced velocity, flapping and more; none where nothing is known of them.
    """

    layout: RotorLayout
    thrust: tuple[float, float, float]
    torque_per_thrust_m: float = 0.0
    torque: tuple[float, float, float] | None = None
    lag_up_s: float = 0.0
    lag_down_s: float | None = None
    induced_drag_n_s_m: float = 0.0
    inclined: bool = False
    inflow_n_s_m: float = 0.0
    inertia_kg_m2: float = 0.0
    full_speed_rad_s: float = 0.0
    flow: RotorFlow | None = None

    def __post_init__(self) -> None:
        if not self.layout.arm_known:
            raise ModelError(
                f"the layout {self.layout.name} is in units of its arm", needed="meters", remedy="use scaled(arm_m)"
            )
        lags = (self.lag_up_s, self.lag_up_s if self.lag_down_s is None else self.lag_down_s)
        numbers = (*self.thrust, *(self.torque or ()), *lags, self.torque_per_thrust_m, self.induced_drag_n_s_m)
        if not np.isfinite(numbers).all() or min(lags) < 0.0 or (0.0 in lags and any(lags)) or sum(self.thrust) <= 0.0:
            raise ModelError(
                f"the rotors have a thrust of {self.thrust} and lags of {lags} s",
                needed="finite numbers, a positive thrust at full speed, and two positive lags or none",
            )
        self._set(thrust=tuple(self.thrust), lag_down_s=lags[1])

    @property
    def mean_lag_s(self) -> float:
        """Mean of the lags of speeding up and slowing down."""
        assert self.lag_down_s is not None
        return 0.5 * (self.lag_up_s + self.lag_down_s)

    @property
    def torque_curve(self) -> tuple[float, float, float]:
        """Coefficients of the torque, N m."""
        if self.torque is not None:
            return self.torque
        c_0, c_1, c_2 = (self.torque_per_thrust_m * coefficient for coefficient in self.thrust)
        return c_0, c_1, c_2

    def thrust_at(self, share: float) -> float:
        """Newtons at a speed, away from any motion through the air."""
        return self.thrust[0] + share * (self.thrust[1] + share * self.thrust[2])

    def speed_shares(self, outputs: FloatArray) -> FloatArray:
        """Shares of the full speed by lagged outputs: with a flow, what the square of is thrust; else the outputs."""
        if self.flow is None:
            return outputs
        return speeds_of_outputs(dict(zip(CURVE_TERMS, self.thrust, strict=True)), outputs)

    def share_of(self, thrust_n: float) -> float:
        """Speed that makes a thrust where thrust rises with speed, as a share of the largest.

        Raises
        ------
        ModelError
            No speed from zero up does.
        """
        c_0, c_1, c_2 = self.thrust
        if c_2 == 0.0 and c_1 > 0.0:
            share = (thrust_n - c_0) / c_1
        else:
            inside = c_1**2 - 4.0 * c_2 * (c_0 - thrust_n)
            share = (-c_1 + inside**0.5) / (2.0 * c_2) if inside >= 0.0 and c_2 != 0.0 else -1.0
        if share < 0.0:
            raise ModelError(f"rotors with a thrust of {self.thrust} cannot make {thrust_n:g} N")
        return share


@dataclass(frozen=True, kw_only=True)
class Battery(Immutable):
    r"""A battery whose voltage sags: :math:`V = V_{full} - (V_{full} - V_{empty}) Q / C - R I`.

    The current is :math:`k \sum F_i^{3/2}`, the power of an ideal rotor at constant voltage, and the speed that an
    output asks for is in proportion to the voltage.

    Parameters
    ----------
    full_v, empty_v
        At rest.
    rated_v
        Voltage at which the thrust curve holds.
    resistance_ohm
        Of the pack and its wires.
    capacity_ah
        From full to empty.
    hover_current_a
        What hovering draws.
    """

    full_v: float
    empty_v: float
    rated_v: float
    resistance_ohm: float
    capacity_ah: float
    hover_current_a: float

    def __post_init__(self) -> None:
        numbers = (self.full_v, self.empty_v, self.rated_v, self.capacity_ah, self.hover_current_a)
        if min(numbers) <= 0.0 or self.empty_v > self.full_v or self.resistance_ohm < 0.0:
            raise ModelError(f"impossible battery {self}", needed="positive numbers, and empty below full")


@dataclass(frozen=True, kw_only=True, eq=False)
class Multirotor(Immutable):
    """A vehicle.

    Parameters
    ----------
    name
        What messages and logs call it.
    mass_kg
        All of it.
    inertia_kg_m2
        About the center of gravity, shape ``(3, 3)``; three numbers are its diagonal.
    rotors
        See :class:`Rotors`.
    aerodynamics
        Force (N) and moment (N m) of the body per ``u v w`` through the air (m/s) and ``p q r`` (rad/s), ``(6, 6)``.
    quadratic_drag_n_s2_m2
        Along the three axes of the body.
    vertical_drag_n_s2_m2
        Along the vertical axis, by the velocity along it times the airspeed.
    center_of_gravity_m
        From the geometric center, to which the layout refers, in body axes.
    effectiveness
        Force and moment per newton of each rotor, ``(6, rotors)``, where it is not that of the layout: for vehicles of
        which control derivatives are known and no geometry. Includes the torque of the rotors.
    battery
        None: the voltage is the rated one throughout.
    source
        Where the numbers come from.

    Examples
    --------
    >>> from rotorid.models.rotors import library_layout
    >>> rotors = Rotors(layout=library_layout("quad.x").scaled(0.25), thrust=(0.0, 0.0, 9.0), torque_per_thrust_m=0.02)
    >>> vehicle = Multirotor(name="demo", mass_kg=1.2, inertia_kg_m2=(0.012, 0.012, 0.02), rotors=rotors)
    >>> vehicle.hover_shares.round(4).tolist()
    [0.5717, 0.5717, 0.5717, 0.5717]
    """

    name: str
    mass_kg: float
    inertia_kg_m2: FloatArray
    rotors: Rotors
    aerodynamics: FloatArray | None = None
    quadratic_drag_n_s2_m2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    vertical_drag_n_s2_m2: float = 0.0
    center_of_gravity_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    effectiveness: FloatArray | None = None
    battery: Battery | None = None
    source: str = ""

    def __post_init__(self) -> None:
        inertia = np.array(self.inertia_kg_m2, dtype=np.float64)
        inertia = np.diag(inertia) if inertia.ndim == 1 else inertia
        count = self.rotors.layout.rotors
        air = np.zeros((6, 6)) if self.aerodynamics is None else self.aerodynamics
        if inertia.shape != (3, 3) or not self.mass_kg > 0.0 or np.linalg.eigvalsh(inertia).min() <= 0.0:
            raise ModelError(
                f"{self.name} has {self.mass_kg:g} kg and the inertia {inertia.tolist()}",
                needed="a positive mass and an inertia with positive eigenvalues, kg m^2",
            )
        if self.effectiveness is not None and np.shape(self.effectiveness) != (6, count):
            raise ModelError(
                f"{self.name} has an effectiveness of shape {np.shape(self.effectiveness)}",
                needed=f"three forces and three moments for each of {count} rotors",
            )
        self._set(
            inertia_kg_m2=read_only(inertia, np.float64, ndim=2),
            aerodynamics=read_only(air, np.float64, ndim=2),
            effectiveness=None if self.effectiveness is None else read_only(self.effectiveness, np.float64, ndim=2),
        )

    @property
    def hubs_m(self) -> FloatArray:
        """Rotors from the center of gravity, shape ``(rotors, 3)``."""
        return np.asarray(self.rotors.layout.positions - np.array(self.center_of_gravity_m))

    @property
    def wrench(self) -> FloatArray:
        """Force and moment per newton of each rotor in hover, with its torque, shape ``(6, rotors)``."""
        if self.effectiveness is not None:
            return self.effectiveness
        layout = replace(self.rotors.layout, positions=self.hubs_m)
        return layout.effectiveness(self._hover_torque_per_thrust(layout))

    @cached_property
    def hover_shares(self) -> FloatArray:
        """Speeds of the rotors that carry the weight without turning the vehicle, shares, shape ``(rotors,)``.

        Raises
        ------
        ModelError
            The rotors cannot, or only beyond their largest speed.
        """
        wanted = np.array([-self.mass_kg * STANDARD_GRAVITY_M_S2, 0.0, 0.0, 0.0])
        thrusts = np.linalg.pinv(self.wrench[2:]) @ wanted
        shares = np.array([self.rotors.share_of(float(thrust)) for thrust in thrusts])
        if shares.max() > 1.0:
            raise ModelError(
                f"{self.name} is too heavy: it would hover at {shares.max():.2f} of full rotor speed",
                remedy="reduce the weight or increase the thrust",
            )
        return read_only(shares, np.float64, ndim=1)

    def _hover_torque_per_thrust(self, layout: RotorLayout) -> float:
        """Torque over thrust at the speed at which the rotors would share the weight alike."""
        lifting = float(-layout.thrust_axes[2].mean())
        share = self.rotors.share_of(self.mass_kg * STANDARD_GRAVITY_M_S2 / layout.rotors / max(lifting, 0.1))
        t_0, t_1, t_2 = self.rotors.torque_curve
        return (t_0 + share * (t_1 + share * t_2)) / self.rotors.thrust_at(share)

    def hovering(self) -> FloatArray:
        """State in level hover at the origin, heading north, shape ``(13 + rotors,)``."""
        state = np.zeros(STATES + self.rotors.layout.rotors)
        state[6] = 1.0
        state[STATES:] = self.hover_shares
        return state

    @property
    def induced_per_share_m_s(self) -> float:
        """Velocity that a rotor induces in hover, over its speed's share of the largest; zero without a disc."""
        flow = self.rotors.flow
        return 0.0 if flow is None else flow.induced_m_s(self.rotors.thrust_at(1.0))

    def body(self) -> Body:
        """The same as plain numbers, for the kernels."""
        rotors, layout = self.rotors, self.rotors.layout
        flow = rotors.flow or RotorFlow()
        hubs = self.hubs_m
        forces = self.effectiveness
        if forces is None:
            forces = np.concatenate([layout.thrust_axes, np.cross(hubs, layout.thrust_axes.T).T])
        torques = layout.torque_axes if self.effectiveness is None else np.zeros((3, layout.rotors))
        momentum = rotors.inertia_kg_m2 * rotors.full_speed_rad_s * layout.spins * layout.thrust_axes
        air = self.aerodynamics
        assert air is not None
        assert rotors.lag_down_s is not None
        return Body(
            mass=float(self.mass_kg),
            gravity=float(STANDARD_GRAVITY_M_S2),
            inertia=plain(self.inertia_kg_m2),
            inverse_inertia=plain(np.linalg.inv(self.inertia_kg_m2)),
            aerodynamics=plain(air),
            has_aerodynamics=bool(np.any(air)),
            quadratic_drag=plain(self.quadratic_drag_n_s2_m2),
            has_quadratic_drag=any(self.quadratic_drag_n_s2_m2),
            effectiveness=plain(forces),
            torque_axes=plain(torques),
            hubs=plain(hubs),
            thrust=plain(rotors.thrust),
            torque=plain(rotors.torque_curve),
            lag_up=float(rotors.lag_up_s or 1.0),
            lag_down=float(rotors.lag_down_s or 1.0),
            has_lag=bool(rotors.lag_up_s > 0.0),
            induced_drag=float(rotors.induced_drag_n_s_m),
            inclined=bool(rotors.inclined),
            inflow=float(rotors.inflow_n_s_m),
            has_air=bool(rotors.induced_drag_n_s_m or rotors.inflow_n_s_m or rotors.flow),
            has_flow=rotors.flow is not None,
            full_thrust=float(rotors.thrust_at(1.0)),
            induced_per_share=float(self.induced_per_share_m_s),
            edge_lift=float(flow.edge_lift_n_s_m),
            edge_climb_lift=float(flow.edge_climb_lift_n_s2_m2),
            edge_speed_lift=float(flow.edge_speed_lift_n_s2_m2),
            wake=float(flow.wake_n_s2_m3),
            climb_drag=float(flow.climb_drag_n_s2_m2),
            flapping=float(flow.flapping_n_s),
            forward_flapping=float(flow.forward_flapping_n_s),
            side_flapping=plain(flow.side_flapping_n_s * layout.spins),
            inflow_torque=float(flow.inflow_torque_n_s2_m),
            yaw_damping=float(flow.yaw_damping_n_m_s),
            vertical_drag=float(self.vertical_drag_n_s2_m2),
            spin_momentum=plain(momentum),
            has_spin=bool(np.any(momentum)),
        )

    def supply(self) -> Supply:
        """The battery as plain numbers, for the kernels."""
        if self.battery is None:
            return Supply(1.0, 1.0, 1.0, 0.0, 1.0, 0.0, False)
        lifted = sum(self.rotors.thrust_at(float(share)) ** 1.5 for share in self.hover_shares)
        return Supply(
            voltage_full=float(self.battery.full_v),
            voltage_empty=float(self.battery.empty_v),
            voltage_rated=float(self.battery.rated_v),
            resistance_ohm=float(self.battery.resistance_ohm),
            capacity_as=3600.0 * self.battery.capacity_ah,
            current_per_power=float(self.battery.hover_current_a / lifted),
            present=True,
        )


@dataclass(frozen=True, kw_only=True)
class Sensors(Immutable):
    r"""Gyroscopes, accelerometers and the estimates of attitude, velocity and position.

    A gyroscope reads :math:`\omega/(T s + 1) + b + \sigma n + A \sum x_i^2 \sin\varphi_i`, rounded to its step, and an
    accelerometer at :math:`r` so the specific force :math:`f + \dot\omega \times r + \omega \times (\omega \times r)`.
    The last term is vibration: one cycle a turn of every rotor, growing with the square of its speed; what lies above
    half the loop's rate folds down, as in a real log. The autopilot flies on these values, not on the true ones.

    Parameters
    ----------
    gyro_noise_rad_s, accelerometer_noise_m_s2
        Standard deviation of white noise, each sample of the control loop.
    gyro_bias_rad_s, accelerometer_bias_m_s2
        Constant, along the three axes.
    gyro_lag_s, accelerometer_lag_s
        First-order lags.
    gyro_step_rad_s, accelerometer_step_m_s2
        Steps of quantization; zero for none.
    gyro_vibration_rad_s, accelerometer_vibration_m_s2
        Amplitude of each rotor's vibration at full speed.
    rotor_speed_rad_s
        Full speed of the rotors, for that.
    accelerometer_place_m
        From the center of gravity, in body axes.
    attitude_noise_rad, velocity_noise_m_s, position_noise_m
        Standard deviations of what the estimator adds, white.

    Examples
    --------
    >>> Sensors().gyro_noise_rad_s, PERFECT.gyro_noise_rad_s
    (0.005, 0.0)
    """

    gyro_noise_rad_s: float = 0.005
    accelerometer_noise_m_s2: float = 0.08
    gyro_bias_rad_s: tuple[float, float, float] = (0.0, 0.0, 0.0)
    accelerometer_bias_m_s2: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gyro_lag_s: float = 0.0
    accelerometer_lag_s: float = 0.0
    gyro_step_rad_s: float = 0.0
    accelerometer_step_m_s2: float = 0.0
    gyro_vibration_rad_s: float = 0.0
    accelerometer_vibration_m_s2: float = 0.0
    rotor_speed_rad_s: float = 800.0
    accelerometer_place_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    attitude_noise_rad: float = 0.001
    velocity_noise_m_s: float = 0.02
    position_noise_m: float = 0.02

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            several = isinstance(value, tuple)
            if not np.isfinite(value).all() or (not several and value < 0.0):
                raise UsageError(
                    f"a sensor has {name} = {value}",
                    needed="finite numbers" if several else "zero or a positive number",
                )

    @property
    def noisy(self) -> bool:
        """Whether any of them has noise."""
        return any(
            (
                self.gyro_noise_rad_s,
                self.accelerometer_noise_m_s2,
                self.attitude_noise_rad,
                self.velocity_noise_m_s,
                self.position_noise_m,
            )
        )

    def senses(self) -> Senses:
        """The same as plain numbers, for the kernels."""
        return Senses(
            gyro_noise=float(self.gyro_noise_rad_s),
            gyro_bias=plain(self.gyro_bias_rad_s),
            gyro_lag_s=float(self.gyro_lag_s),
            gyro_step=float(self.gyro_step_rad_s),
            gyro_vibration=float(self.gyro_vibration_rad_s),
            accelerometer_noise=float(self.accelerometer_noise_m_s2),
            accelerometer_bias=plain(self.accelerometer_bias_m_s2),
            accelerometer_lag_s=float(self.accelerometer_lag_s),
            accelerometer_step=float(self.accelerometer_step_m_s2),
            accelerometer_vibration=float(self.accelerometer_vibration_m_s2),
            accelerometer_place=plain(self.accelerometer_place_m),
            attitude_noise=float(self.attitude_noise_rad),
            velocity_noise=float(self.velocity_noise_m_s),
            position_noise=float(self.position_noise_m),
            blade_rad_s=float(self.rotor_speed_rad_s),
        )


PERFECT = Sensors(
    gyro_noise_rad_s=0.0,
    accelerometer_noise_m_s2=0.0,
    attitude_noise_rad=0.0,
    velocity_noise_m_s=0.0,
    position_noise_m=0.0,
)
"""Sensors that read the truth."""


class Body(NamedTuple):
    """A rigid body and its rotors. Forces and moments are about the center of gravity, in body axes."""

    mass: float
    gravity: float
    inertia: FloatArray
    """Shape ``(3, 3)``."""
    inverse_inertia: FloatArray
    aerodynamics: FloatArray
    """Force and moment per air velocity and rate, shape ``(6, 6)``."""
    has_aerodynamics: bool
    quadratic_drag: FloatArray
    """N/(m/s)² along each axis, shape ``(3,)``."""
    has_quadratic_drag: bool
    effectiveness: FloatArray
    """Force and moment per newton of thrust, without the torque of the rotors, shape ``(6, rotors)``."""
    torque_axes: FloatArray
    """Moment per newton meter of torque, shape ``(3, rotors)``."""
    hubs: FloatArray
    """Where the rotors sit, shape ``(rotors, 3)``."""
    thrust: FloatArray
    """Coefficients of the speed's powers 0 to 2, N."""
    torque: FloatArray
    """The same, N m."""
    lag_up: float
    lag_down: float
    has_lag: bool
    """Without one, the speeds are the outputs."""
    induced_drag: float
    """N/(m/s) at full speed."""
    inclined: bool
    inflow: float
    """Newtons of thrust per m/s of descent at full speed; negative for climb that unloads."""
    has_air: bool
    """Whether the rotors feel how they move through the air."""
    has_flow: bool
    """Whether they do more of what :class:`RotorFlow` holds, in its order."""
    full_thrust: float
    """Thrust of a rotor in hover at full output, N."""
    induced_per_share: float
    """Induced velocity of hover, m/s, at full speed."""
    edge_lift: float
    edge_climb_lift: float
    edge_speed_lift: float
    wake: float
    climb_drag: float
    flapping: float
    forward_flapping: float
    side_flapping: FloatArray
    """By the direction of each rotor, shape ``(rotors,)``."""
    inflow_torque: float
    yaw_damping: float
    vertical_drag: float
    """N/(m/s)², zero for none."""
    spin_momentum: FloatArray
    """Angular momentum of each rotor at full speed, shape ``(3, rotors)``."""
    has_spin: bool


class Supply(NamedTuple):
    """A battery."""

    voltage_full: float
    voltage_empty: float
    voltage_rated: float
    resistance_ohm: float
    capacity_as: float
    current_per_power: float
    """Ampere per newton to the power 1.5, all rotors together."""
    present: bool


class Senses(NamedTuple):
    """Sensors; noise is the standard deviation of each sample."""

    gyro_noise: float
    gyro_bias: FloatArray
    gyro_lag_s: float
    gyro_step: float
    gyro_vibration: float
    accelerometer_noise: float
    accelerometer_bias: FloatArray
    accelerometer_lag_s: float
    accelerometer_step: float
    accelerometer_vibration: float
    accelerometer_place: FloatArray
    attitude_noise: float
    velocity_noise: float
    position_noise: float
    blade_rad_s: float
    """Speed of a rotor at full output, for vibration."""


class Control(NamedTuple):
    """An autopilot. Arrays of three are roll, pitch, yaw."""

    tick_s: float
    substeps: int
    proportional: FloatArray
    integral: FloatArray
    derivative: FloatArray
    feedforward: FloatArray
    integral_limit: FloatArray
    derivative_of_error: bool
    derivative_keep: FloatArray
    """What first-order filters keep of the last sample: of the derivative, the error, the target, the command."""
    error_keep: FloatArray
    target_keep: FloatArray
    command_keep: FloatArray
    gyro_filter: FloatArray
    """b0 b1 b2 a1 a2 of the filter of the rates."""
    accelerometer_filter: FloatArray
    angle: FloatArray
    rate_limit: FloatArray
    tilt_limit: float
    velocity_p: float
    velocity_i: float
    position_p: float
    climb_p: float
    climb_i: float
    height_p: float
    hold_velocity: bool
    heading_follows: bool
    """Whether the heading set-point follows the vehicle while the yaw stick is out."""
    hold_height: bool
    tilt_compensation: bool
    stick_tilt: float
    stick_yaw_rate: float
    stick_climb: float
    stick_thrust: float
    hover_thrust: float
    mixer: FloatArray
    """Shape ``(rotors, 4)``."""
    low: float
    high: float
    expo: float
    output_low: float
    output_high: float
    voltage_max: float
    voltage_min: float
    delay_steps: IntArray
    """Of each command, in steps of the integrator."""


def plain(values: ArrayLike) -> FloatArray:
    """A fresh array. Kernels are compiled anew for integers, for read-only arrays and for other orders in memory."""
    return np.array(values, dtype=np.float64, order="C")


RATE_RAW, ACCELERATION_RAW, RATE, ACCELERATION = 0, 3, 6, 9
ANGLE, VELOCITY, POSITION, ANGLE_SETPOINT, RATE_SETPOINT = 12, 15, 18, 21, 24
COMMAND, VOLTAGE, SATURATED, MOTORS = 27, 31, 32, 33
"""First column of each group; the motors come last."""
