r"""The cost of measured against modeled accelerations, from the outputs of the motors around hover.

.. math::

    \tau \dot x_i + x_i = \sigma_i, \qquad F_i = c_t \, \omega_{max}^2 \, x_i, \qquad U = B(\kappa) F

    \ddot z = \frac{U_1}{m} \cos\phi \cos\theta - g, \qquad
    \dot p = \frac{U_2}{I_{xx}}, \qquad \dot q = \frac{U_3}{I_{yy}}, \qquad \dot r = \frac{U_4}{I_{zz}}

A gain of the motors, such as that of a transfer function in series with them, is one with :math:`c_t`. So are, to the
data, κ and I_zz: yaw shows their ratio only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal, TypeAlias, get_args

import numpy as np

from rotorid.data.immutable import Immutable, read_only
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fit.solution import Solution
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.rotor_layout import UP, RotorLayout
from rotorid.search.acceleration_polish import error_sums, polished
from rotorid.search.acceleration_sums import ErrorSum
from rotorid.search.design_of_starts import Scale, StartBox
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

ErrorKind: TypeAlias = Literal["absolute", "squared"]
"""How errors of single samples are added up."""

OUTPUTS = ("z_ddot", "p_dot", "q_dot", "r_dot")
"""Vertical acceleration, upward, and those of roll, pitch and yaw."""

NAMES = ("c_t", "kappa", "I_xx", "I_yy", "I_zz", "m", "omega_max", "T_motor")

POWERS = np.array(
    [
        [1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 2.0],
        [1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 2.0],
        [1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 2.0],
        [1.0, 1.0, 0.0, 0.0, -1.0, 0.0, 2.0],
    ]
)
"""Gains of the four accelerations as products of powers; columns follow the names without the lag."""

_DECADE = 10.0


def hover_parameters(*, m: float, omega_max: float, T_motor: float) -> ParameterSet:
    """What a small multirotor may have: ranges of decades, within which searches begin and end.

    Parameters
    ----------
    m, omega_max, T_motor
        Mass in kg, speed of the motors at full output in rad/s, and their lag in s, held at these values;
        ``free_again`` frees one.

    Examples
    --------
    >>> hover_parameters(m=1.023, omega_max=900.0, T_motor=0.1).free
    ('c_t', 'kappa', 'I_xx', 'I_yy', 'I_zz')
    """
    ranges = (
        ("c_t", "N s^2", 1e-6, 1e-4),
        ("kappa", "m", 0.005, 0.5),
        ("I_xx", "kg m^2", 0.001, 0.2),
        ("I_yy", "kg m^2", 0.001, 0.2),
        ("I_zz", "kg m^2", 0.002, 0.4),
    )
    held = (("m", "kg", m, 1e-3, 1e3), ("omega_max", "rad/s", omega_max, 1.0, 1e5), ("T_motor", "s", T_motor, 0.0, 1.0))
    free = [
        Parameter(name=name, value=float(np.sqrt(low * high)), unit=unit, lower=low, upper=high)
        for name, unit, low, high in ranges
    ]
    fixed = [
        Parameter(name=name, value=value, unit=unit, lower=low, upper=high, status="fixed")
        for name, unit, value, low, high in held
    ]
    return ParameterSet((*free, *fixed))


@dataclass(frozen=True, kw_only=True, eq=False)
class AccelerationProblem(Immutable):
    r"""Search motor and inertia constants with the least difference of four accelerations.

    .. math:: f = \frac{1}{4} \sum_c \frac{\sum_k |a_c(k) - \hat a_c(k)|}{\sum_k |a_c(k) - \bar a_c|}

    A model that knows nothing but the means has a cost of one, and none is better than the noise. Of the four sums, the
    published fitness is the first, over z; how they are put together was not printed. Each channel has a gain of its
    own, so that a common factor of one does not move the minimum where all inertias are free.

    Noise is assumed on the accelerations only. What differentiation has smoothed or delayed, and outputs that are
    logged less often than the motors answer, bias lag and inertia. Angles and
    rates are small: there are no gyroscopic moments and no drag.

    Parameters
    ----------
    motors
        Normalized outputs, zero to one, held until the next sample, shape ``(k, n)``.
    tilt
        cos φ cos θ, shape ``(n,)``.
    accelerations
        ``z_ddot`` upward in m/s², zero at rest, and ``p_dot q_dot r_dot`` in rad/s²; shape ``(4, n)``.
    sample_rate_hz
        Of all.
    layout
        Where the motors are, in meters, and which way they turn; they push straight up.
    parameters
        Named ``c_t kappa I_xx I_yy I_zz m omega_max T_motor``; their bounds are the box of the search.
    error
        ``absolute`` as published, which outliers hardly move; ``squared`` for the least variance under normal noise.

    Raises
    ------
    UsageError
        Shapes do not belong together, the arm is not known or a rotor is tilted, a parameter is missing or a free one
        is without finite bounds, or a value is not finite.
    InsufficientDataError
        A channel stands still.

    Examples
    --------
    >>> from rotorid.vehicles import hover_quadrotor
    >>> flight = hover_quadrotor.fly(np.random.default_rng(0))
    >>> problem = AccelerationProblem(
    ...     motors=flight.motors, tilt=flight.tilt, accelerations=flight.accelerations, sample_rate_hz=100.0,
    ...     layout=hover_quadrotor.layout(),
    ...     parameters=hover_parameters(m=1.023, omega_max=900.0, T_motor=0.1).fix("kappa", 0.05))
    >>> found = problem.polish(problem.parameters.pack())
    >>> {name: round(value / hover_quadrotor.TRUTH[name], 2) for name, value in problem.named(found.theta).items()}
    {'c_t': 1.0, 'I_xx': 1.0, 'I_yy': 1.0, 'I_zz': 0.99}
    """

    at_once: ClassVar[int] = 128

    motors: FloatArray
    tilt: FloatArray
    accelerations: FloatArray
    sample_rate_hz: float
    layout: RotorLayout
    parameters: ParameterSet
    error: ErrorKind = "absolute"

    def __post_init__(self) -> None:
        motors, accelerations = (read_only(rows, np.float64, ndim=2) for rows in (self.motors, self.accelerations))
        tilt = read_only(self.tilt, np.float64, ndim=1)
        count, samples = self.layout.rotors, tilt.size
        if motors.shape != (count, samples) or accelerations.shape != (len(OUTPUTS), samples):
            raise UsageError(
                f"outputs of shape {motors.shape}, accelerations of {accelerations.shape} and {samples} tilts came",
                needed=f"shapes ({count}, n), ({len(OUTPUTS)}, n) and (n,)",
            )
        if not all(np.isfinite(rows).all() for rows in (motors, accelerations, tilt)):
            raise UsageError("data came that are not finite", needed="numbers", remedy="cut out the gaps")
        if missing := [name for name in NAMES if name not in self.parameters.names]:
            raise UsageError(f"parameters without {', '.join(missing)} came", needed=", ".join(NAMES))
        if self.error not in get_args(ErrorKind):
            raise UsageError(f"error={self.error!r} came", needed=" or ".join(map(repr, get_args(ErrorKind))))
        if not self.layout.arm_known or np.any(self.layout.thrust_axes.T != UP):
            raise UsageError(
                f"the layout {self.layout.name} came", needed="positions in meters and rotors that push straight up"
            )
        self._set(motors=motors, accelerations=accelerations, tilt=tilt)
        self._require_movement()
        _ = self.box

    def _require_movement(self) -> None:
        still = [name for name, size in zip(OUTPUTS, self._sizes.tolist(), strict=True) if size == 0.0]
        if still:
            raise InsufficientDataError(
                f"{' and '.join(still)} stand still", needed="flight in which all accelerations move"
            )

    @property
    def name(self) -> str:
        """What is fitted, for messages."""
        return "accelerations from motor outputs"

    @cached_property
    def box(self) -> StartBox:
        """Bounds of the free parameters; those over a decade and more are divided logarithmically."""
        free = [self.parameters[name] for name in self.parameters.free]
        wide: list[Scale] = [
            "logarithmic" if p.lower > 0.0 and p.upper >= _DECADE * p.lower else "linear" for p in free
        ]
        return StartBox(
            lower=np.array([p.lower for p in free]), upper=np.array([p.upper for p in free]), scales=tuple(wide)
        )

    def named(self, theta: FloatArray) -> dict[str, float]:
        """Free parameters by their names."""
        return dict(zip(self.parameters.free, np.asarray(theta).tolist(), strict=True))

    def costs(self, thetas: FloatArray) -> FloatArray:
        """Cost of many parameter vectors ``(b, p)``, shape ``(b,)``; infinite where the model has no value."""
        gains, kept = self._model(self._values(thetas))
        if self.holds_lag:
            sums = np.stack([total(gain) for total, gain in zip(self.sums, gains.T, strict=True)], axis=1)
        else:
            sums = self._sums_with_lags(gains, kept)
        costs: FloatArray = sums @ self.channel_weights
        return np.where(np.isfinite(costs), costs, np.inf)

    def point_costs(self, thetas: FloatArray) -> FloatArray:
        """What every sample adds to the cost, ``(b, p)`` to ``(b, n)``."""
        gains, kept = self._model(self._values(thetas))
        rows: list[FloatArray] = []
        for gain, share in zip(gains, kept.tolist(), strict=True):
            errors = np.abs(self.made - gain[:, None] * self._settled(share))
            rows.append(self.channel_weights @ (errors**2 if self.error == "squared" else errors))
        costs: FloatArray = np.array(rows).reshape(len(gains), self.tilt.size)
        return np.where(np.isfinite(costs), costs, np.inf)

    def modeled(self, theta: FloatArray) -> FloatArray:
        """Accelerations of the model beside the measured ones, shape ``(4, n)``."""
        gains, kept = self._model(self._values(np.atleast_2d(theta)))
        model: FloatArray = gains[0][:, None] * self._settled(float(kept[0]))
        model[0] -= STANDARD_GRAVITY_M_S2
        return model

    def polish(self, start: FloatArray) -> Solution:
        """Local search from a start ``(p,)``; its cost is that of :meth:`costs`, and never above that of the start.

        Where the lag is held and each acceleration can have the gain that suits it best, which is so with all inertias
        free, this is the only minimum, in closed form: see :mod:`rotorid.search.acceleration_polish`.
        """
        return polished(self, start, None)

    def polish_points(self, start: FloatArray, points: FloatArray) -> Solution:
        """The same with weights of the samples, shape ``(n,)``.

        Raises
        ------
        UsageError
            There is not one weight for every sample, or one is negative.
        """
        weights = np.asarray(points, dtype=np.float64)
        if weights.shape != self.tilt.shape or not weights.min(initial=0.0) >= 0.0:
            raise UsageError(f"weights of shape {weights.shape} came", needed="one for every sample, none negative")
        return polished(self, start, weights)

    @cached_property
    def channel_weights(self) -> FloatArray:
        """Weight of an error of each acceleration in the cost, shape ``(4,)``."""
        weights: FloatArray = 1.0 / (len(OUTPUTS) * self._sizes)
        return weights

    @cached_property
    def made(self) -> FloatArray:
        """Accelerations that the motors must make: the vertical one with gravity, shape ``(4, n)``."""
        made = self.accelerations.copy()
        made[0] += STANDARD_GRAVITY_M_S2
        return made

    def gains(self, thetas: FloatArray) -> FloatArray:
        """Acceleration over what the motors carry, ``(b, p)`` to ``(b, 4)``."""
        return self._model(self._values(thetas))[0]

    def carried(self, theta: FloatArray) -> FloatArray:
        """What the motors carry at a vector ``(p,)``, with unit gains, shape ``(4, n)``."""
        return self._settled(float(self._model(self._values(theta))[1][0]))

    def slopes(self, theta: FloatArray) -> FloatArray:
        """Derivatives of the modeled accelerations with the free parameters, shape ``(p, 4, n)``."""
        here = self.parameters.unpack(theta)
        values = np.array([here.values[name] for name in NAMES])
        directions = here.directions[[here.names.index(name) for name in NAMES]]
        gains, (kept,) = self._model(values[None])
        of_gains = gains[0][:, None] * (POWERS / values[:-1]) @ directions[:-1]
        # Sums over samples are fast where those of one acceleration lie side by side.
        slopes: FloatArray = np.ascontiguousarray(of_gains.T)[:, :, None] * self._settled(float(kept))
        if directions[-1].any():
            # The derivative of a lag is a lag of what it has not yet followed.
            behind = self._lagged(self._lagged(self._drives, kept) - self._drives, kept)
            behind *= kept / (1.0 - kept) / (self.sample_rate_hz * values[-1] ** 2)
            behind[0] *= self.tilt
            slopes += directions[-1][:, None, None] * gains[0][:, None] * behind
        return slopes

    @cached_property
    def holds_lag(self) -> bool:
        """Whether the motors answer alike whatever the free parameters are."""
        return self.parameters["T_motor"].status not in ("free", "tied")

    @cached_property
    def free_powers(self) -> FloatArray | None:
        """Powers of the free parameters in the gains, shape ``(4, p)``; ``None`` where that is not all: lag, ties."""
        _, free, tied = self._columns
        return None if tied or not self.holds_lag else POWERS[:, free]

    @cached_property
    def sums(self) -> tuple[ErrorSum, ...]:
        """Sum of errors of each acceleration by its gain, where the lag is held."""
        return error_sums(self, None)

    def _sums_with_lags(self, gains: FloatArray, kept: FloatArray) -> FloatArray:
        """Sums of errors of candidates with a lag of their own each, shape ``(b, 4)``."""
        from rotorid.search.acceleration_kernels import error_sums as at_once

        squared = self.error == "squared"
        pairs = zip(gains, kept, strict=True)
        return np.array([at_once(row[None], self._carried(lag), self.made, squared)[0] for row, lag in pairs])

    @cached_property
    def _sizes(self) -> FloatArray:
        """How much each channel moves about its mean, in all, shape ``(4,)``."""
        moved: FloatArray = self.accelerations - self.accelerations.mean(axis=1, keepdims=True)
        return np.asarray(np.sum(moved**2 if self.error == "squared" else np.abs(moved), axis=1))

    @cached_property
    def _drives(self) -> FloatArray:
        """Outputs after a mixer of unit thrust and drag and before the lag, which all motors share; ``(4, n)``."""
        arms, spins = self.layout.moment_arms, self.layout.spins
        return np.stack([np.ones_like(spins), arms[0], arms[1], spins]) @ self.motors

    @cached_property
    def _columns(self) -> tuple[FloatArray, list[int], bool]:
        """Present values, where the free ones stand, and whether others depend on them."""
        here = self.parameters.values
        tied = any(parameter.status == "tied" for parameter in self.parameters)
        return np.array([here[name] for name in NAMES]), [NAMES.index(name) for name in self.parameters.free], tied

    def _values(self, thetas: FloatArray) -> FloatArray:
        """Values by name of many vectors ``(b, p)``, shape ``(b, 8)``; not a number where ties allow none."""
        rows = np.atleast_2d(np.asarray(thetas, dtype=np.float64))
        here, free, tied = self._columns
        if tied:
            return np.array([self._tied(row) for row in rows])
        values = np.empty((len(rows), here.size))
        values[:] = here
        values[:, free] = rows
        return values

    def _tied(self, theta: FloatArray) -> list[float]:
        try:
            values = self.parameters.unpack(theta).values
        except ModelError:
            return [np.nan] * len(NAMES)
        return [values[name] for name in NAMES]

    def _model(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gains ``(b, 4)`` and what the motors keep from a sample to the next ``(b,)``."""
        from rotorid.search.acceleration_kernels import products

        with np.errstate(divide="ignore"):
            kept = np.exp(-1.0 / (self.sample_rate_hz * np.maximum(values[:, -1], 0.0)))
        return products(values[:, :-1], POWERS), kept

    @cached_property
    def _held(self) -> FloatArray:
        """What the motors carry where their lag is held, shape ``(4, n)``."""
        return self._carried(float(self._model(self._values(self.parameters.pack()))[1][0]))

    def _settled(self, kept: float) -> FloatArray:
        """What the motors carry of the drives, the first row tilted, shape ``(4, n)``."""
        return self._held if self.holds_lag else self._carried(kept)

    def _carried(self, kept: float) -> FloatArray:
        settled = self._lagged(self._drives, kept)
        settled[0] *= self.tilt
        return settled

    @staticmethod
    def _lagged(drives: FloatArray, kept: float) -> FloatArray:
        from rotorid.search.acceleration_kernels import lagged

        return np.asarray(lagged(drives, float(kept)))
