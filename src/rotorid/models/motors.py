r"""The chain from motor outputs to accelerations: its parameters, which a flight can identify, what physics allows.

.. math::

    T_{motor} \dot x_i &= u_i(t - \tau) - x_i, \qquad F_i = c_0 + c_1 x_i + c_2 x_i^2

    a_z &= -\tfrac{1}{m} \sum F_i + Z_w w

    \dot p &= \tfrac{1}{I_{xx}} \sum (-y_i) F_i + L_p p, \qquad
    \dot q = \tfrac{1}{I_{yy}} \sum x_i F_i + M_q q, \qquad
    \dot r = \tfrac{\kappa}{I_{zz}} \sum s_i F_i + \tfrac{h}{I_{zz}} \sum s_i \dot x_i + N_r r

    \dot v_{forward} &= a_z \sin\theta \cos\phi + X_u u \cos\theta + Y_v v \sin\theta \sin\phi, \qquad
    \dot v_{right} = -a_z \sin\phi + Y_v v \cos\phi

with rotor i at :math:`(x_i, y_i)`, the direction :math:`s_i` of its torque, and the angular momentum h of a rotor at
full output: the vehicle takes up what rotors gain that speed up. Accelerations alone know ratios: thrust by mass, mass
by inertia, :math:`\kappa` and h by :math:`I_{zz}`. One known mass, thrust or inertia sets the scale of all; one of
:math:`\kappa` and :math:`I_{zz}` gives the other.

Identified constants are checked against physics (:func:`check_motor_constants`): inertia that a rigid body can have,
thrust that rises with the command, and makes the specific force that was measured, in a hover and in a turn of 2 g.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple, TypeAlias, get_args

import numpy as np

from rotorid.data.axes import RATES
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import TWO_SIDED_95
from rotorid.data.record import MotorRecord
from rotorid.errors import ModelError, nearest_name
from rotorid.models.expression import Expression
from rotorid.models.flight import CURVE_TERMS
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.physical import check_inertia
from rotorid.models.thrust_curve import PolynomialCurve
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

Curve: TypeAlias = Literal["linear", "quadratic", "affine", "polynomial"]
"""Thrust of a rotor: ``c_1 x``, ``c_2 x^2``, ``c_0 + c_1 x``, or all three."""

TERMS_OF_CURVE: Mapping[Curve, tuple[str, ...]] = {
    "linear": ("c_1",),
    "quadratic": ("c_2",),
    "affine": ("c_0", "c_1"),
    "polynomial": CURVE_TERMS,
}
"""Coefficients of each curve."""

SCALES = ("m", "c_1", "c_2", "c_0", "I_xx", "I_yy")
"""Any one of these, known and in the model, sets the scale of the others. I_zz does not: yaw has kappa of its own."""

POSITIVE = ("m", "I_xx", "I_yy", "I_zz", "kappa", "T_motor")
"""Numbers that no vehicle has at zero or below."""

_UNITS: Mapping[str, str] = {
    "m": "kg",
    "c_0": "N",
    "c_1": "N",
    "c_2": "N",
    "I_xx": "kg m^2",
    "I_yy": "kg m^2",
    "kappa_per_I_zz": "1/(kg m)",
    "h_per_I_zz": "rad/s",
    "T_motor": "s",
    "tau_gyro": "s",
    "tau_gyro_yaw": "s",
    "tau_accel": "s",
    "L_p": "1/s",
    "M_q": "1/s",
    "N_r": "1/s",
    "Z_w": "1/s",
    "X_u": "1/s",
    "Y_v": "1/s",
}
_STARTS: Mapping[str, float] = {
    "m": 1.0,
    "c_1": 5.0,
    "I_xx": 0.01,
    "I_yy": 0.01,
    "kappa_per_I_zz": 1.0,
    "T_motor": 0.03,
    "tau_gyro": 0.005,
    "tau_gyro_yaw": 0.005,
    "tau_accel": 0.005,
}
_BOUNDS: Mapping[str, tuple[float, float]] = {
    "m": (1e-4, 1e4),
    "I_xx": (1e-9, 1e5),
    "I_yy": (1e-9, 1e5),
    "h_per_I_zz": (0.0, 1e4),
    "T_motor": (1e-4, 1.0),
    "tau_gyro": (0.0, 0.2),
    "tau_gyro_yaw": (0.0, 0.2),
    "tau_accel": (0.0, 0.2),
}
SPIN_UP = "h_per_I_zz"
"""Angular momentum of a rotor over the inertia of yaw: what yaw gains while a rotor speeds up. It is that at full
output, in rad/s; where speeds were measured it is the momentum over the speed, a number."""

YAW_DELAY = "tau_gyro_yaw"
"""Delay to the gyro of yaw, where it is not that of roll and pitch."""

DELAYS = ("tau_gyro", YAW_DELAY, "tau_accel")

_OF_AXIS: Mapping[str, tuple[str, ...]] = {
    "az": ("tau_accel", "Z_w"),
    "p": ("I_xx", "L_p"),
    "q": ("I_yy", "M_q"),
    "r": ("kappa_per_I_zz", "N_r"),
    "x": ("X_u",),
    "y": ("Y_v",),
}


def motor_parameters(
    *,
    curve: Curve = "polynomial",
    known: Mapping[str, float] | None = None,
    axes: Sequence[str] = ("az", "p", "q", "r"),
    lag: bool = True,
    heave_damping: bool = True,
    earliest_s: float = 0.0,
    delays: bool = True,
    spin_up: bool = False,
    yaw_delay: bool = False,
) -> ParameterSet:
    """Parameters of the motor chain, with what is known held.

    Parameters
    ----------
    curve
        Thrust of a rotor by its lagged output.
    known
        Values that were measured otherwise: mass, inertia, a coefficient of thrust from a bench, ``kappa``, a lag.
        Where none of :data:`SCALES` is among them, mass is held at one kilogram: thrust and inertia are per kilogram.
    axes
        Those of ``az p q r x y`` that were excited; x and y are level axes, forward and right.
    lag
        Whether the motors lag behind their outputs; not so for measured speeds.
    heave_damping
        Whether the velocity along z was logged, for ``Z_w``.

    earliest_s
        Least delay; below zero where a delay is what is left of a known one, whose stamps may be off.
    delays
        Whether the sensors are late by delays of their own.
    spin_up
        Whether yaw has the reaction to the spin-up of the rotors; in any case where it is known.
    yaw_delay
        Whether the gyro of yaw is late by a delay of its own; in any case where it is known.

    Raises
    ------
    ModelError
        A name is not known, or both of ``kappa`` and ``I_zz`` are given.

    Examples
    --------
    >>> motor_parameters(curve="linear", known={"m": 1.5, "kappa": 0.06})["I_zz"].status
    'tied'
    """
    fixed = dict(known or {})
    _require(fixed, curve)
    if scale_of(fixed, axes) is None:
        fixed["m"] = 1.0
    names = ["m", *TERMS_OF_CURVE[curve]]
    names += [name for axis in ("p", "q", "r", "az", "x", "y") if axis in axes for name in _OF_AXIS[axis]]
    names += [SPIN_UP] if "r" in axes and (spin_up or SPIN_UP in fixed) else []
    # Without a lag a delay to samples of the force moves whole samples or nothing.
    names = [*names, "T_motor"] if lag else [name for name in names if name != "tau_accel"]
    names += ["tau_gyro"] if set(axes) & set(RATES) else []
    names += [YAW_DELAY] if "r" in axes and (yaw_delay or YAW_DELAY in fixed) else []
    if not delays:
        names = [name for name in names if name not in DELAYS]
    if not heave_damping:
        names = [name for name in names if name != "Z_w"]
    parameters = [_parameter(name, fixed.get(name), earliest_s) for name in names]
    return ParameterSet((*parameters, *_yaw(fixed, "r" in axes)))


def scale_of(known: Mapping[str, float], axes: Sequence[str]) -> str | None:
    """What is known that sets the scale of mass, thrust and inertia; ``None`` where nothing does.

    Examples
    --------
    >>> scale_of({"I_xx": 0.02}, ["q"]) is None
    True
    """
    of_axis = {"I_xx": "p", "I_yy": "q"}
    usable = (name for name in SCALES if known.get(name, 0.0) != 0.0)
    return next((name for name in usable if of_axis.get(name, "any") in (*axes, "any")), None)


def _parameter(name: str, value: float | None, earliest_s: float) -> Parameter:
    lower, upper = _BOUNDS.get(name, (-1e9, 1e9))
    lower = earliest_s if name in DELAYS else lower
    return Parameter(
        name=name,
        value=_STARTS.get(name, 0.0) if value is None else value,
        unit=_UNITS[name],
        lower=lower,
        upper=upper,
        status="free" if value is None else "fixed",
    )


def _yaw(fixed: Mapping[str, float], visible: bool) -> tuple[Parameter, ...]:
    """Torque by thrust and inertia of yaw, of which one gives the other."""
    if not visible:
        return ()
    if "kappa" in fixed:
        tie = Expression.parse("kappa/kappa_per_I_zz")
        known = Parameter(name="kappa", value=fixed["kappa"], unit="m", status="fixed")
        return known, Parameter(name="I_zz", unit="kg m^2", tied=tie)
    if "I_zz" in fixed:
        known = Parameter(name="I_zz", value=fixed["I_zz"], unit="kg m^2", status="fixed")
        return known, Parameter(name="kappa", unit="m", tied=Expression.parse("kappa_per_I_zz*I_zz"))
    return ()


def _require(fixed: Mapping[str, float], curve: Curve) -> None:
    if curve not in get_args(Curve):
        raise ModelError(f"there is no curve {curve!r}", needed=f"one of {', '.join(get_args(Curve))}")
    allowed = {*_UNITS, "kappa", "I_zz"}
    for name, value in fixed.items():
        if name not in allowed:
            near = nearest_name(name, allowed)
            raise ModelError(
                f"there is no parameter {name}",
                needed=f"one of {', '.join(sorted(allowed))}",
                remedy=f"did you mean {near}?" if near else "",
            )
        if name in POSITIVE and not value > 0.0:
            raise ModelError(f"the known {name} = {value:g} is not possible", needed="a positive number")
        if name.startswith("c_") and name not in TERMS_OF_CURVE[curve]:
            raise ModelError(f"a {curve} curve has no {name}", remedy="choose another curve")
    if any(name in fixed for name in TERMS_OF_CURVE[curve]) and not _lifts(fixed, curve):
        raise ModelError(
            "the known thrust lifts nothing",
            needed="coefficients that add up to a positive thrust",
        )
    if {"kappa", "I_zz"} <= set(fixed):
        raise ModelError("both kappa and I_zz are given as known", needed="one of them, which gives the other")


def _lifts(fixed: Mapping[str, float], curve: Curve) -> bool:
    """Whether known coefficients leave a rotor that lifts at full output, as far as all of them are known."""
    terms = TERMS_OF_CURVE[curve]
    return not set(terms) <= set(fixed) or sum(fixed[name] for name in terms) > 0.0


_FORCE_TOLERANCE, _IMPOSSIBLE_FORCE = 0.1, 0.2
"""How far the mean thrust of a flight may lie from mass times measured specific force: without a remark, and at all.
The thrust of flights of up to 2.4 g lies within 5 %."""

_THRUST_TO_WEIGHT = (1.2, 15.0)
"""Thrust of all rotors at full output over the weight that is plausible."""

_MERIT = (0.3, 0.9)
"""Figures of merit that are plausible in hover."""

_GYRATION = (0.05, 1.5)
"""Inertia over mass by the mean square of the lever that is plausible."""

_AIR_DENSITY_KG_M3 = 1.225
_IDLE = 0.05
"""Share of full output below which a motor idles, on the ground or for a moment."""

_FLOWN = (0.01, 0.99)
"""Quantiles of the flown outputs between which the curve of thrust is judged."""

_DENSE = 101
_INERTIA = ("I_xx", "I_yy", "I_zz")


class Range(NamedTuple):
    """Lowest and highest value that something can have."""

    low: float
    high: float


class YawRange(NamedTuple):
    r"""What is known of yaw where neither :math:`\kappa` nor :math:`I_{zz}` is.

    Parameters
    ----------
    I_zz
        kg m².
    kappa
        Torque by thrust, m.
    """

    I_zz: Range
    kappa: Range


def yaw_range(values: Mapping[str, float]) -> YawRange:
    r"""Inertia of yaw that a rigid body can have beside those of roll and pitch, and the torque constant with it.

    .. math:: |I_{xx} - I_{yy}| \le I_{zz} \le I_{xx} + I_{yy}, \qquad \kappa = (\kappa / I_{zz}) \, I_{zz}

    Flat vehicles, as multirotors are, lie near the upper ends.

    Parameters
    ----------
    values
        With ``I_xx``, ``I_yy`` and ``kappa_per_I_zz``.

    Raises
    ------
    ModelError
        One of the three is missing.

    Examples
    --------
    >>> yaw_range({"I_xx": 0.015, "I_yy": 0.018, "kappa_per_I_zz": 0.5}).kappa
    Range(low=0.0015, high=0.0165)
    """
    if missing := [name for name in ("I_xx", "I_yy", "kappa_per_I_zz") if name not in values]:
        raise ModelError(f"{', '.join(missing)} did not come", needed="I_xx, I_yy and kappa_per_I_zz")
    roll, pitch, ratio = (values[name] for name in ("I_xx", "I_yy", "kappa_per_I_zz"))
    low, high = abs(roll - pitch), roll + pitch
    ends = sorted((_rounded(ratio * low), _rounded(ratio * high)))
    return YawRange(I_zz=Range(_rounded(low), _rounded(high)), kappa=Range(ends[0], ends[1]))


def check_motor_constants(
    values: Mapping[str, float],
    *,
    records: Sequence[MotorRecord] = (),
    levers: FloatArray | None = None,
    covariance: Mapping[tuple[str, str], float] | None = None,
    full_output: float | None = 1.0,
) -> list[Finding]:
    """Remarks on identified values that physics or experience does not allow.

    Moments of inertia are positive and meet the triangle inequality; a violation within the 95 % interval is reported
    as such. The curve of thrust rises wherever it was flown, outputs below a twentieth of the full one and one percent
    at each end left out, as far as it is known there; on average it makes the measured specific force; thrust at full
    output is 1.2 to 15 weights; inertia is 0.05 to 1.5 times mass by the mean square of the lever.

    Parameters
    ----------
    values
        Of :func:`rotorid.models.motors.motor_parameters`, as far as known.
    records
        What was flown; without them thrust and its curve are not judged.
    levers
        As for :class:`rotorid.fitting.motors.fit.MotorProblem`, where they are in meters; by default inertia is not
        judged against the arm.
    covariance
        Of pairs of names, what is not named being certain; by default all is.
    full_output
        The largest output; ``None`` where outputs are speeds and it is not known.

    Examples
    --------
    >>> [finding.message for finding in check_motor_constants({"m": 1.0, "c_1": 2.0})]
    ['Four rotors at full output lift 0.82 weights: plausible are 1.2 to 15.']
    """
    certain: Mapping[tuple[str, str], float] = covariance or {}
    findings = _inertia(values, certain)
    if levers is not None and "m" in values:
        findings += _gyration(values, levers)
    rotors = records[0].outputs.shape[0] if records else (levers.shape[1] if levers is not None else 4)
    curve = _curve(values)
    if curve is None:
        return findings
    if records:
        findings += _rising(curve, records, certain, full_output) + _matches_force(values, curve, records)
    if full_output is not None and "m" in values:
        findings += _lifting(values["m"], curve, rotors, full_output)
    return findings


def check_figure_of_merit(
    values: Mapping[str, float],
    *,
    speed_rad_s: float,
    rotor_diameter_m: float,
    rotors: int = 4,
    load_factor: float = 1.0,
) -> list[Finding]:
    r"""A remark where the rotors would fly with more or less power than rotors do.

    .. math:: FM = \frac{T^{3/2} / \sqrt{2 \rho A}}{\kappa T \Omega}, \qquad T = \frac{m g n_z}{n}

    Assumes a measured speed: with outputs alone the power on the shaft is not known.

    Parameters
    ----------
    values
        With ``m`` and ``kappa``; nothing is judged without them.
    speed_rad_s
        Mean of the rotors.
    rotor_diameter_m, rotors
        Of the vehicle.
    load_factor
        Mean thrust over weight, :math:`n_z`: one in hover.

    Examples
    --------
    >>> finding = check_figure_of_merit({"m": 1.5, "kappa": 0.005}, speed_rad_s=560.0, rotor_diameter_m=0.25)[0]
    >>> round(finding.numbers["figure_of_merit"], 2)
    1.97
    """
    if not {"m", "kappa"} <= set(values):
        return []
    thrust = values["m"] * STANDARD_GRAVITY_M_S2 * load_factor / rotors
    ideal = math.sqrt(thrust / (2.0 * _AIR_DENSITY_KG_M3 * math.pi * (rotor_diameter_m / 2.0) ** 2))
    merit = ideal / (abs(values["kappa"]) * speed_rad_s) if values["kappa"] and speed_rad_s > 0.0 else math.inf
    if _MERIT[0] <= merit <= _MERIT[1]:
        return []
    message = (
        f"With kappa = {values['kappa']:.4g} m the rotors would hover with a figure of merit of {merit:.2f}: "
        f"{_MERIT[0]:g} to {_MERIT[1]:g} are plausible, and no rotor exceeds 1."
    )
    kind = "impossible_physics" if merit > 1.0 else "implausible_physics"
    return [_remark(kind, "kappa", message, {"figure_of_merit": merit})]


def _inertia(values: Mapping[str, float], covariance: Mapping[tuple[str, str], float]) -> list[Finding]:
    known = [name for name in _INERTIA if name in values]
    wrong = [name for name in known if not (values[name] > 0.0 and math.isfinite(values[name]))]
    if wrong:
        return [
            _remark(
                "impossible_physics",
                name,
                f"{name} = {values[name]:.4g} kg m^2 is not positive.",
                {"kg_m2": values[name]},
            )
            for name in wrong
        ]
    if len(known) < 3:
        return []
    return [_weighed(finding, values, covariance) for finding in check_inertia(*(values[name] for name in _INERTIA))]


def _weighed(finding: Finding, values: Mapping[str, float], covariance: Mapping[tuple[str, str], float]) -> Finding:
    """A violation that the uncertainty explains is none."""
    signs = {name: 1.0 if name == finding.where else -1.0 for name in _INERTIA}
    excess = sum(sign * values[name] for name, sign in signs.items())
    variance = sum(signs[a] * signs[b] * _of_pair(covariance, a, b) for a in _INERTIA for b in _INERTIA)
    reach = TWO_SIDED_95 * math.sqrt(max(variance, 0.0))
    numbers = {**finding.numbers, "excess_kg_m2": excess, "interval_kg_m2": reach}
    if excess > reach:
        return replace(finding, numbers=numbers)
    message = f"{finding.message[:-1]}; the difference is within the interval of 95 %, {reach:.2g} kg m^2."
    return replace(finding, severity="info", message=message, numbers=numbers)


def _gyration(values: Mapping[str, float], levers: FloatArray) -> list[Finding]:
    findings = []
    for name, lever in zip(("I_xx", "I_yy"), levers[:2], strict=True):
        size = values["m"] * float(np.mean(lever**2))
        share = values.get(name, size) / size if size > 0.0 else 1.0
        if not _GYRATION[0] <= share <= _GYRATION[1]:
            message = (
                f"{name} = {values[name]:.4g} kg m^2 is {share:.2g} of mass by mean square lever, {size:.3g} kg m^2: "
                f"plausible are {_GYRATION[0]:g} to {_GYRATION[1]:g}. Is the arm right, and what fixes the scale?"
            )
            findings.append(_remark("implausible_physics", name, message, {"share": share}))
    return findings


def _curve(values: Mapping[str, float]) -> PolynomialCurve | None:
    if not any(name in values for name in CURVE_TERMS):
        return None
    return PolynomialCurve(coefficients=tuple(values.get(name, 0.0) for name in CURVE_TERMS))


def _rising(
    curve: PolynomialCurve,
    records: Sequence[MotorRecord],
    covariance: Mapping[tuple[str, str], float],
    full_output: float | None,
) -> list[Finding]:
    """Where a motor idles, a polynomial that was fitted to flight need not hold."""
    flown = np.concatenate([record.outputs.ravel() for record in records])
    flown = flown[flown > _IDLE * (float(flown.max()) if full_output is None else full_output)]
    if not flown.size:
        return []
    low, high = np.quantile(flown, _FLOWN).tolist()
    outputs = np.linspace(low, high, _DENSE)
    if np.all(curve.slope(outputs) + TWO_SIDED_95 * _slope_std(outputs, covariance) > 0.0):
        return []
    message = f"The identified thrust falls with the output somewhere from {low:.2f} to {high:.2f}, which was flown."
    return [_remark("impossible_physics", "thrust", message, {"low": low, "high": high})]


def _slope_std(outputs: FloatArray, covariance: Mapping[tuple[str, str], float]) -> FloatArray:
    """Standard deviation of the slope of the curve at some outputs."""
    powers = range(1, len(CURVE_TERMS))
    slopes = np.stack([power * outputs ** (power - 1) for power in powers])
    spread = np.array([[_of_pair(covariance, CURVE_TERMS[a], CURVE_TERMS[b]) for b in powers] for a in powers])
    return np.asarray(np.sqrt(np.maximum(np.einsum("in,ij,jn->n", slopes, spread, slopes), 0.0)))


def _of_pair(covariance: Mapping[tuple[str, str], float], one: str, other: str) -> float:
    return covariance.get((one, other), covariance.get((other, one), 0.0))


def mean_force(records: Sequence[MotorRecord], heave_damping: float = 0.0) -> float:
    r"""Mean thrust over mass that an accelerometer shows, m/s², downward motion through the air taken out.

    .. math:: \overline{\tfrac{1}{m} \sum F_i} = \overline{-a_z} + Z_w \, \overline{w}

    Parameters
    ----------
    records
        Stretches of flights, each counting by its samples.
    heave_damping
        :math:`Z_w`, 1/s.

    Examples
    --------
    >>> still = np.zeros((3, 50))
    >>> record = MotorRecord(name="turn", sample_rate_hz=50.0, outputs=np.full((4, 50), 0.6), rates=still,
    ...                      az=np.full(50, -11.4))
    >>> round(mean_force([record]), 3)
    11.4
    """
    total = sum(float(heave_damping * record.w.sum() - record.az.sum()) for record in records)
    return total / sum(record.samples for record in records)


def _matches_force(
    values: Mapping[str, float], curve: PolynomialCurve, records: Sequence[MotorRecord]
) -> list[Finding]:
    """Over a flight the rotors make the measured specific force on average, whatever the load factor is."""
    if "m" not in values:
        return []
    lifted = sum(float(np.sum(curve.thrust(record.outputs) * record.strength)) for record in records)
    thrust = lifted / sum(record.samples for record in records)
    return check_mean_force(thrust, values["m"] * mean_force(records, values.get("Z_w", 0.0)), values["m"])


def check_mean_force(
    thrust_n: float, force_n: float, mass_kg: float, *, tolerance: float = _FORCE_TOLERANCE
) -> list[Finding]:
    """Whether the mean thrust of a flight is mass times the measured mean specific force.

    Parameters
    ----------
    thrust_n, force_n
        Of the model, and as measured.
    mass_kg
        Of the vehicle.
    tolerance
        Share that needs no remark.

    Examples
    --------
    >>> check_mean_force(10.0, 10.0, 1.0), check_mean_force(13.0, 10.0, 1.0)[0].kind
    ([], 'impossible_physics')
    """
    share = thrust_n / force_n if force_n > 0.0 else math.inf
    if abs(share - 1.0) <= tolerance:
        return []
    message = (
        f"The thrust curve makes {100.0 * share:.0f} % of the measured specific force on average "
        f"({100.0 * (1.0 - tolerance):.0f} to {100.0 * (1.0 + tolerance):.0f} % are plausible): check "
        "the mass and the time stamps."
        if math.isfinite(share)
        else f"The mean specific force along z is {-force_n / mass_kg:.2g} m/s^2, but the rotors lift: check the "
        "accelerometer and its axes."
    )
    numbers = {"thrust_per_weight": thrust_n / (mass_kg * STANDARD_GRAVITY_M_S2)}
    numbers |= {"thrust_per_force": share} if math.isfinite(share) else {}
    kind = "impossible_physics" if abs(share - 1.0) > _IMPOSSIBLE_FORCE else "implausible_physics"
    return [_remark(kind, "thrust", message, numbers)]


def _lifting(mass: float, curve: PolynomialCurve, rotors: int, full_output: float) -> list[Finding]:
    share = rotors * float(curve.thrust(full_output)) / (mass * STANDARD_GRAVITY_M_S2)
    if _THRUST_TO_WEIGHT[0] <= share <= _THRUST_TO_WEIGHT[1]:
        return []
    count = {3: "Three", 4: "Four", 6: "Six", 8: "Eight"}.get(rotors, str(rotors))
    message = (
        f"{count} rotors at full output lift {share:.2g} weights: plausible are {_THRUST_TO_WEIGHT[0]:g} to "
        f"{_THRUST_TO_WEIGHT[1]:g}."
    )
    return [_remark("implausible_physics", "thrust", message, {"thrust_per_weight": share})]


def _remark(kind: str, where: str, message: str, numbers: Mapping[str, float]) -> Finding:
    return (warn if kind == "impossible_physics" else remark)(kind, where, message, **numbers)


def _rounded(value: float) -> float:
    """Without the last digits, which are rounding."""
    return float(f"{value:.14g}")
