r"""What physics allows of thrust, inertia and torque constants that were identified from motor outputs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.motor_record import MotorRecord
from rotorid.errors import ModelError
from rotorid.models.physical_checks import check_inertia
from rotorid.models.thrust_curve import PolynomialCurve
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_TWO_SIDED = 1.96
_WEIGHT_TOLERANCE = 0.05
_THRUST_TO_WEIGHT = (1.2, 15.0)
_MERIT = (0.3, 0.9)
_GYRATION = (0.05, 1.5)
_AIR_DENSITY_KG_M3 = 1.225
_TERMS = ("c_0", "c_1", "c_2")
_IDLE = 0.05
"""Share of full output below which a motor idles, on the ground or for a moment."""
_FLOWN = (0.01, 0.99)
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

    Moments of inertia are positive and meet the triangle inequality; a violation within the interval of 95 % is told as
    such. The curve of thrust rises wherever it was flown, outputs below a twentieth of the full one and one percent at
    each end left out, as far as it is known there; it carries the weight on average; thrust at full output is
    1.2 to 15 weights; inertia is 0.05 to 1.5 times mass by the mean square of the lever.

    Parameters
    ----------
    values
        Of :func:`rotorid.models.motor_parameters.motor_parameters`, as far as known.
    records
        What was flown; without them weight and curve are not judged.
    levers
        As for :class:`rotorid.fit.motor_problem.MotorProblem`, where they are in meters; by default inertia is not
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
        findings += _rising(curve, records, certain, full_output) + _carrying(values, curve, records)
    if full_output is not None and "m" in values:
        findings += _lifting(values["m"], curve, rotors, full_output)
    return findings


def check_figure_of_merit(
    values: Mapping[str, float],
    *,
    speed_rad_s: float,
    rotor_diameter_m: float,
    rotors: int = 4,
    air_density_kg_m3: float = _AIR_DENSITY_KG_M3,
) -> list[Finding]:
    r"""A remark where the rotors would hover with more or less power than rotors do.

    .. math:: FM = \frac{T^{3/2} / \sqrt{2 \rho A}}{\kappa T \Omega}, \qquad T = \frac{m g}{n}

    Assumes a measured speed: with outputs alone the power on the shaft is not known.

    Parameters
    ----------
    values
        With ``m`` and ``kappa``; nothing is judged without them.
    speed_rad_s
        Of the rotors in hover.
    rotor_diameter_m, rotors, air_density_kg_m3
        Of the vehicle and its air.

    Examples
    --------
    >>> finding = check_figure_of_merit({"m": 1.5, "kappa": 0.005}, speed_rad_s=560.0, rotor_diameter_m=0.25)[0]
    >>> round(finding.numbers["figure_of_merit"], 2)
    1.97
    """
    if not {"m", "kappa"} <= set(values):
        return []
    thrust = values["m"] * STANDARD_GRAVITY_M_S2 / rotors
    ideal = math.sqrt(thrust / (2.0 * air_density_kg_m3 * math.pi * (rotor_diameter_m / 2.0) ** 2))
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
    return [_weighed(one, values, covariance) for one in check_inertia(*(values[name] for name in _INERTIA))]


def _weighed(finding: Finding, values: Mapping[str, float], covariance: Mapping[tuple[str, str], float]) -> Finding:
    """A violation that the uncertainty explains is none."""
    signs = {name: 1.0 if name == finding.where else -1.0 for name in _INERTIA}
    excess = sum(sign * values[name] for name, sign in signs.items())
    variance = sum(
        signs[one] * signs[other] * _of_pair(covariance, one, other) for one in _INERTIA for other in _INERTIA
    )
    reach = _TWO_SIDED * math.sqrt(max(variance, 0.0))
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
    if not any(name in values for name in _TERMS):
        return None
    return PolynomialCurve(coefficients=tuple(values.get(name, 0.0) for name in _TERMS))


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
    if np.all(curve.slope(outputs) + _TWO_SIDED * _slope_std(outputs, covariance) > 0.0):
        return []
    message = f"The identified thrust falls with the output somewhere from {low:.2f} to {high:.2f}, which was flown."
    return [_remark("impossible_physics", "thrust", message, {"low": low, "high": high})]


def _slope_std(outputs: FloatArray, covariance: Mapping[tuple[str, str], float]) -> FloatArray:
    """Standard deviation of the slope of the curve at some outputs."""
    powers = range(1, len(_TERMS))
    slopes = np.stack([power * outputs ** (power - 1) for power in powers])
    spread = np.array([[_of_pair(covariance, _TERMS[one], _TERMS[other]) for other in powers] for one in powers])
    return np.asarray(np.sqrt(np.maximum(np.einsum("in,ij,jn->n", slopes, spread, slopes), 0.0)))


def _of_pair(covariance: Mapping[tuple[str, str], float], one: str, other: str) -> float:
    return covariance.get((one, other), covariance.get((other, one), 0.0))


def _carrying(values: Mapping[str, float], curve: PolynomialCurve, records: Sequence[MotorRecord]) -> list[Finding]:
    """Over a flight the rotors carry the weight on average."""
    if "m" not in values:
        return []
    lifted = sum(float(np.sum(curve.thrust(record.outputs) * record.strength)) for record in records)
    share = lifted / sum(record.samples for record in records) / (values["m"] * STANDARD_GRAVITY_M_S2)
    if abs(share - 1.0) <= _WEIGHT_TOLERANCE:
        return []
    message = (
        f"The rotors carry {100.0 * share:.0f} % of the weight on average: mass and thrust do not belong together."
    )
    return [_remark("impossible_physics", "thrust", message, {"thrust_per_weight": share})]


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
    return Finding(
        kind=kind,
        severity="warning" if kind == "impossible_physics" else "info",
        where=where,
        message=message,
        numbers=numbers,
    )


def _rounded(value: float) -> float:
    """Without the last digits, which are rounding."""
    return float(f"{value:.14g}")
