r"""Quantities that follow from identified derivatives and from what is known of a vehicle.

A fit of one axis sees derivatives: what a command of one does to a rate. Which propeller, motor and inertia make it is
identified with more data: a mass, an inertia, how fast rotors turn. The relations are those of
:mod:`rotorid.models.physical`, solved for one quantity each; four rotors that all change by :math:`k_n` with a command
of one, as in yaw and heave of every layout:

.. math::

    n_m &= a + \sqrt{a^2 - (k_n \sigma)^2}, \quad a = -g k_n / Z_{thrust}, & n_h^2 &= n_m^2 + (k_n \sigma)^2, &
    c_T &= \frac{m g}{4 \rho n_h^2 D^4}

    \frac{dc_T}{dJ} &= \frac{m Z_w}{4 \rho n_m D^3}, & c_H &= -\frac{m X_u}{4 \rho n_h D^3}

    c_P &= \frac{\pi I_{zz} N_{yaw}}{4 k_n \rho n_h D^5}, & \kappa &= \frac{I_{zz} N_{yaw} n_h}{2 k_n m g}, &
    J_r &= \frac{I_{zz} N_{spin}}{8 \pi k_n}, & z &= -\frac{M_u I_{yy}}{X_u m}

and the yaw of Niermeyer, Raffler and Holzapfel in its own parameters (eq 19), for a motor controller of the gain
:math:`k_{\omega\delta}`:

.. math::

    M_{mot,\omega} = -1/T_{motor}, \qquad M_{mot,\delta} = 2 \pi k_n / T_{motor}, \qquad
    N_\omega = -\frac{N_{spin}}{k_{\omega\delta} T_{motor}}

In a sweep of thrust the mean square of the speeds carries the weight, and the slope of a square is that at the mean
speed :math:`n_m`; :math:`\sigma` is the deviation of the command in it, behind the lag of the motors.

Uncertainty is carried over by the exact slopes, that of identified derivatives with their covariance and that of known
quantities as independent of them and of each other. Assumed: hover without wind and no force but that of the rotors;
where the body drags too, c_H and z are those of rotors that would do the same. Speeds count in revolutions per second
for a command of one, so that commands and k_n must be of the same scale.

Source: Niermeyer, Raffler and Holzapfel, *Open-Loop Quadrotor Flight Dynamics Identification in Frequency Domain via
Closed-Loop Flight Testing*, eqs 1 to 6 and 19.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import cache

import numpy as np

from rotorid.data.base import Immutable, read_only
from rotorid.errors import ModelError
from rotorid.models.expression import Expression
from rotorid.models.parameter import no_such
from rotorid.models.physical import PHYSICAL_UNITS
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

KNOWN_UNITS: Mapping[str, str] = {**PHYSICAL_UNITS, "k_omega_delta": "rad/s"}
"""What may be given as known, with its unit: the physical parameters of hover, and the gain of a motor controller, the
speed in rad/s that a command of one asks for."""

SPREAD = "thrust_spread"
"""The deviation of the thrust command in sweeps of thrust, as relations and structures call it."""

_MEAN = "n_m"

_CONSTANTS = {"g": STANDARD_GRAVITY_M_S2, "pi": math.pi, SPREAD: 0.0}


@dataclass(frozen=True, kw_only=True)
class Relation:
    """How one quantity follows from others.

    Parameters
    ----------
    name, unit
        Of the quantity.
    text
        An expression of derivatives, known quantities and quantities of relations above.
    words
        What it is.
    """

    name: str
    unit: str
    text: str
    words: str

    @property
    def expression(self) -> Expression:
        """The text, read."""
        return _read(self.text)

    @property
    def needs(self) -> frozenset[str]:
        """Names in the expression that are no constants of nature."""
        return self.expression.names - set(_CONSTANTS)


@cache
def _read(text: str) -> Expression:
    return Expression.parse(text)


RELATIONS: tuple[Relation, ...] = (
    Relation(
        name=_MEAN,
        unit="1/s",
        text="sqrt((g*k_n/Z_thrust)**2 - (k_n*thrust_spread)**2) - g*k_n/Z_thrust",
        words="mean speed of the rotors in the sweep of thrust",
    ),
    Relation(
        name="n_h",
        unit="1/s",
        text="sqrt(n_m**2 + (k_n*thrust_spread)**2)",
        words="speed of the rotors in hover",
    ),
    # Of sweeps that are larger than such rotors can fly.
    Relation(name="n_h", unit="1/s", text="-2*g*k_n/Z_thrust", words="speed of the rotors in hover"),
    Relation(name=_MEAN, unit="1/s", text="n_h", words="mean speed of the rotors in the sweep of thrust"),
    Relation(name="c_T", unit="1", text="m*g/(4*rho*n_h**2*D**4)", words="thrust coefficient in hover"),
    Relation(name="dc_T_dJ", unit="1", text="m*Z_w/(4*rho*n_m*D**3)", words="its slope over the advance ratio"),
    Relation(name="c_H", unit="1", text="-m*X_u/(4*rho*n_h*D**3)", words="side-force coefficient"),
    Relation(name="c_H", unit="1", text="-m*Y_v/(4*rho*n_h*D**3)", words="side-force coefficient"),
    Relation(name="z", unit="m", text="-M_u*I_yy/(X_u*m)", words="height of the side force over the center of mass"),
    Relation(name="z", unit="m", text="L_v*I_xx/(Y_v*m)", words="height of the side force over the center of mass"),
    Relation(name="c_P", unit="1", text="pi*I_zz*N_yaw/(4*k_n*rho*n_h*D**5)", words="power coefficient"),
    Relation(name="kappa", unit="m", text="c_P*D/(2*pi*c_T)", words="torque of a rotor over its thrust"),
    Relation(name="kappa", unit="m", text="I_zz*N_yaw*n_h/(2*k_n*m*g)", words="torque of a rotor over its thrust"),
    Relation(name="J_r", unit="kg m^2", text="I_zz*N_spin/(8*pi*k_n)", words="inertia of a motor with its propeller"),
    Relation(name="J_r_per_I_zz", unit="1", text="N_spin/(8*pi*k_n)", words="that inertia over the vehicle's in yaw"),
    Relation(name="spin_up_lead", unit="s", text="N_spin/N_yaw", words="lead of yaw by the spin-up of the rotors"),
    Relation(name="M_motor_omega", unit="1/s", text="-1/T_motor", words="pole of the motor"),
    Relation(name="M_motor_delta", unit="rad/s^2", text="2*pi*k_n/T_motor", words="gain of the motor before it"),
    Relation(
        name="N_omega", unit="1/s", text="-N_spin/(k_omega_delta*T_motor)", words="yaw by the speed of the motors"
    ),
)
"""In the order in which they can be worked out; of several for one name the first counts that can be."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DerivedQuantities(Immutable):
    """What follows from a model and from what is known beside it.

    Parameters
    ----------
    values
        By name, in the units of their relations.
    covariance
        In that order, shape ``(k, k)``.
    of_identified
        The part of it that the identified derivatives bring, shape ``(k, k)``; the rest is that of known quantities.
    missing
        What else must be known for a quantity of which the model has the derivatives, by its name.
    """

    values: Mapping[str, float]
    covariance: FloatArray
    of_identified: FloatArray
    missing: Mapping[str, tuple[str, ...]]

    def __post_init__(self) -> None:
        self._set(
            values=self.values,
            missing=self.missing,
            covariance=read_only(self.covariance, np.float64, ndim=2),
            of_identified=read_only(self.of_identified, np.float64, ndim=2),
        )

    @property
    def std(self) -> dict[str, float]:
        """Standard deviations by name."""
        return dict(zip(self.values, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


def require_useful(parameters: Collection[str], known: Mapping[str, tuple[float, float]], *, model: str) -> None:
    """Refuse known quantities that say nothing of a model.

    Parameters
    ----------
    parameters
        Names of the parameters of the model.
    known
        Value and standard deviation by name.
    model
        Its name, for messages.

    Raises
    ------
    ModelError
        There is no such quantity, the model has it as a parameter, it cannot be, or nothing of the model follows with
        it.
    """
    for name, (value, std) in known.items():
        if name in parameters:
            raise ModelError(f"{name} is a parameter of {model}, not known data", needed=f"--fix {name}={value:g}")
        if name not in KNOWN_UNITS:
            raise no_such("known quantity", name, KNOWN_UNITS)
        if not math.isfinite(value) or value == 0.0 or (value < 0.0 and name not in ("z", "dc_T_dJ")):
            raise ModelError(f"the known {name} = {value:g} is not possible", needed="a positive number")
        if not 0.0 <= std < math.inf:
            raise ModelError(f"the standard deviation of {name} is {std:g}", needed="zero or more")
    useful = _useful(parameters)
    if lost := [name for name in known if name not in useful]:
        raise ModelError(
            f"{lost[0]} is known, but nothing of {model} follows from it",
            needed=f"one of {', '.join(sorted(useful))}" if useful else "a model with N_yaw, Z_thrust, X_u or the like",
            remedy="leave it out, or hold a parameter with --fix",
        )


def useful_known(parameters: Collection[str]) -> frozenset[str]:
    """Names of known quantities with which something follows from parameters.

    Examples
    --------
    >>> sorted(useful_known(["N_spin", "T_motor"]))
    ['I_zz', 'k_n', 'k_omega_delta']
    """
    return _useful(parameters) - set(parameters)


def _useful(parameters: Collection[str]) -> frozenset[str]:
    """Known quantities that stand in relations with a derivative of the model, directly or by what these need."""
    reached, found = set(parameters) - set(KNOWN_UNITS), set[str]()
    for relation in RELATIONS:
        if relation.needs & reached and relation.needs <= reached | set(KNOWN_UNITS):
            reached.add(relation.name)
            found |= relation.needs & set(KNOWN_UNITS)
    return frozenset(found)


def derived_quantities(
    parameters: Mapping[str, float],
    covariance: FloatArray,
    known: Mapping[str, tuple[float, float]] | None = None,
    *,
    thrust_spread: float = 0.0,
) -> DerivedQuantities:
    r"""Quantities that follow from parameters, with their covariance.

    .. math:: C_d = J_\theta C_\theta J_\theta^T + J_k \, \mathrm{diag}(\sigma_k^2) \, J_k^T

    Parameters
    ----------
    parameters
        Identified and held parameters by name, without those that were dropped.
    covariance
        Of them in that order, shape ``(p, p)``; rows of held ones are zero.
    known
        Value and standard deviation by name, in the units of :data:`KNOWN_UNITS`.
    thrust_spread
        Deviation of the thrust command in sweeps of thrust, behind the lag of the motors; without one ``n_m`` is
        ``n_h`` and not listed.

    Examples
    --------
    The inertia of a rotor out of yaw, with an inertia of the vehicle known to three percent:

    >>> found = derived_quantities({"N_spin": 0.8}, np.array([[0.04**2]]), {"I_zz": (0.02, 6e-4), "k_n": (100.0, 0.0)})
    >>> print(f"{found.values['J_r']:.3g} +- {found.std['J_r']:.2g} kg m^2")
    6.37e-06 +- 3.7e-07 kg m^2
    """
    given = dict(known or {})
    values = {name: value for name, (value, _) in given.items()}
    numbers = {**_CONSTANTS, SPREAD: thrust_spread, **dict(parameters), **values}
    basis = [*parameters, *given]
    slopes: dict[str, FloatArray] = dict(zip(basis, np.eye(len(basis)), strict=True))
    found: dict[str, float] = {}
    for relation in RELATIONS:
        if relation.name in numbers or not relation.needs <= slopes.keys():
            continue
        try:
            found[relation.name] = float(relation.expression.evaluate(numbers))
        except ModelError:  # a division by zero: nothing follows
            continue
        slopes[relation.name] = sum(
            (
                float(relation.expression.derivative(name).evaluate(numbers)) * slopes[name]
                for name in sorted(relation.needs)
            ),
            np.zeros(len(basis)),
        )
        numbers[relation.name] = found[relation.name]
    missing = _missing({*parameters, *found}, numbers)
    if not thrust_spread:
        found.pop(_MEAN, None)
        missing.pop(_MEAN, None)
    rows = np.array([slopes[name] for name in found]).reshape(len(found), len(basis))
    identified, others = rows[:, : len(parameters)], rows[:, len(parameters) :]
    part = identified @ np.asarray(covariance, dtype=np.float64) @ identified.T
    variances = np.square([std for _, std in given.values()])
    return DerivedQuantities(
        values=found,
        covariance=part + (others * variances) @ others.T,
        of_identified=part,
        missing=missing,
    )


def _missing(brought: Set[str], numbers: Collection[str]) -> dict[str, tuple[str, ...]]:
    """What else must be known, where all that a model can bring is there."""
    missing: dict[str, tuple[str, ...]] = {}
    for relation in RELATIONS:
        lacking = relation.needs - set(numbers)
        if relation.name not in {*numbers, *missing} and relation.needs & brought and lacking <= set(KNOWN_UNITS):
            missing[relation.name] = tuple(sorted(lacking))
    return missing


def thrust_coefficient(
    advance_ratio: Sequence[float] | FloatArray, c_T: float, dc_T_dJ: float, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    r"""Thrust coefficient over the advance ratio, as a straight line with its standard deviation.

    .. math:: c_T(J) = c_T + \frac{dc_T}{dJ} J, \qquad J = -w / (n D)

    The advance ratio is positive in climb. A propeller is a straight line near hover only; beyond what was flown the
    deviation holds for the line, not for the propeller.

    Parameters
    ----------
    advance_ratio
        Shape ``(k,)``.
    c_T, dc_T_dJ
        At zero, and the slope.
    covariance
        Of the two, shape ``(2, 2)``.

    Returns
    -------
    numpy.ndarray
        Coefficient, shape ``(k,)``.
    numpy.ndarray
        Standard deviation, shape ``(k,)``.

    Examples
    --------
    >>> thrust_coefficient([0.0, 0.1], 0.1, -0.13, np.diag([1e-6, 4e-4]))[0].round(3)
    array([0.1  , 0.087])
    """
    ratio = np.asarray(advance_ratio, dtype=np.float64)
    rows = np.stack([np.ones_like(ratio), ratio], axis=1)
    return c_T + dc_T_dJ * ratio, np.sqrt(np.einsum("ij,jk,ik->i", rows, np.asarray(covariance), rows))
