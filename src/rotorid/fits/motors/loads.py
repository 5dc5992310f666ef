r"""Payload between logs, and thrust over battery voltage, both from the weight in flight.

The specific force along z is thrust over mass. Over pieces of some seconds b of a log j, the ratio of measured to
modeled force

.. math:: k_{jb} = \frac{\overline{a_z}}{\overline{\hat a_z}} = \kappa_j \, (V_b / V_0)^{n - 2}

shows how far thrust over mass of that log differs from that of the whole, and by which power n thrust follows the
voltage, where the model takes the square. Two logs whose ratios differ by more than their errors carry another mass, or
rotors and battery changed: :math:`m_B / m_A = \kappa_A / \kappa_B`. The exponent comes from within each log, so that a
payload between two logs is not taken for it.

Errors: pieces scatter by gusts, and the bias of an accelerometer, 0.05 m/s², stands in every log by itself. Thrust that
changes with the air, climbs and wind, is in the scatter of the pieces only as far as it changes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from rotorid.data.findings import Finding, remark, warn
from rotorid.data.quantity import with_error
from rotorid.fits.motors.errors import ACCELEROMETER_BIAS_M_S2
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.results.summary import LogThrust, VoltageExponent
from rotorid.typing import FloatArray
from rotorid.units import STANDARD_GRAVITY_M_S2

_PIECE_S = 4.0
_FEWEST_PIECES = 4
_SIGMAS = 3.0
_LEAST_STEP = 0.02
_LEAST_SWING = 0.03
"""Least change of the voltage over a log for an exponent."""

_LARGEST_STD = 1.0
_SQUARE = 2.0


def thrust_of_logs(problem: MotorProblem, theta: FloatArray) -> tuple[LogThrust, ...]:
    """Thrust over mass of each log, over that of the fit.

    Parameters
    ----------
    problem
        Records as flown.
    theta
        Where the fit ended.

    Returns
    -------
    tuple of LogThrust
        One for each log, in their order.
    """
    found: dict[str, list[FloatArray]] = {}
    for record, ratios, _ in _pieces(problem, theta):
        found.setdefault(record, []).append(ratios)
    bias = ACCELEROMETER_BIAS_M_S2 / STANDARD_GRAVITY_M_S2
    rows = []
    for record, parts in found.items():
        ratios = np.concatenate(parts)
        scatter = float(ratios.std(ddof=1) / math.sqrt(ratios.size)) if ratios.size > 1 else 0.0
        rows.append(LogThrust(record=record, ratio=float(ratios.mean()), std=math.hypot(scatter, bias)))
    return tuple(rows)


def voltage_exponent(problem: MotorProblem, theta: FloatArray, reference_v: float | None) -> VoltageExponent | None:
    """The power by which thrust follows the voltage; ``None`` where it did not sag enough, or is no matter.

    Parameters
    ----------
    problem, theta
        As in :func:`thrust_of_logs`.
    reference_v
        Voltage of the strengths of the records.
    """
    if reference_v is None:
        return None
    logs: dict[str, list[tuple[FloatArray, FloatArray]]] = {}
    for record, ratios, strength in _pieces(problem, theta):
        logs.setdefault(record, []).append((0.5 * np.log(strength), np.log(ratios)))
    moved, answered = [], []
    for parts in logs.values():
        volts, ratios = (np.concatenate(rows) for rows in zip(*parts, strict=True))
        moved.append(volts - volts.mean())
        answered.append(ratios - ratios.mean())
    if not moved:
        return None
    x, y = np.concatenate(moved), np.concatenate(answered)
    swing, freedom = max(float(np.ptp(row)) for row in moved), x.size - len(moved) - 1
    if swing < _LEAST_SWING or freedom < _FEWEST_PIECES:
        return None
    slope = float(x @ y / (x @ x))
    std = math.sqrt(float(np.sum((y - slope * x) ** 2)) / freedom / float(x @ x))
    if std > _LARGEST_STD:
        return None
    volts = reference_v * np.sqrt(np.concatenate([record.strength for record in problem.records]))
    return VoltageExponent(
        exponent=_SQUARE + slope,
        std=std,
        reference_v=reference_v,
        lowest_v=float(volts.min()),
        highest_v=float(volts.max()),
    )


def _pieces(problem: MotorProblem, theta: FloatArray) -> Iterator[tuple[str, FloatArray, FloatArray]]:
    """Of each record its name, and over pieces of some seconds measured over modeled force and strength of thrust."""
    values = problem.parameters.unpack(theta).values
    for record in problem.records:
        (force,) = problem.predictions(record, values, ("az",))
        count = max(1, round(force.measured.size / record.sample_rate_hz / _PIECE_S))
        rows = [
            (float(force.measured[part].mean()), float(force.predicted[part].mean()), float(strength.mean()))
            for part, strength in zip(
                np.array_split(np.arange(force.measured.size), count),
                np.array_split(record.strength[1:], count),
                strict=True,
            )
        ]
        kept = [(made / modeled, power) for made, modeled, power in rows if made * modeled > 0.0 and power > 0.0]
        if kept:
            ratios, strengths = np.array(kept).T
            yield record.name, ratios, strengths


def judge_loads(logs: Sequence[LogThrust], exponent: VoltageExponent | None) -> Iterator[Finding]:
    """Steps of thrust over mass between logs, each against the first, and a voltage that is not followed by its square.

    Parameters
    ----------
    logs
        Of :func:`thrust_of_logs`.
    exponent
        Of :func:`voltage_exponent`.
    """
    for first, log in ((logs[0], other) for other in logs[1:]):
        ratio = first.ratio / log.ratio
        std = ratio * math.hypot(first.std / first.ratio, log.std / log.ratio)
        if abs(ratio - 1.0) > max(_SIGMAS * std, _LEAST_STEP):
            heavier = "more" if ratio > 1.0 else "less"
            yield warn(
                "payload_step",
                log.record,
                f"{log.record} has {with_error(100.0 * abs(ratio - 1.0), 100.0 * std)} % {heavier} mass than "
                f"{first.record} at the same thrust: the payload, rotors or battery changed. The identified "
                "values are a mixture; identify each log separately, with its own --fix m=KILOGRAMS.",
                mass_ratio=ratio,
                std=std,
            )
    if exponent is not None:
        contradicts_square = abs(exponent.exponent - _SQUARE) > max(_SIGMAS * exponent.std, 0.5)
        message = (
            f"Thrust follows the voltage by the power {with_error(exponent.exponent, exponent.std)} from "
            f"{exponent.lowest_v:.3g} to {exponent.highest_v:.3g} V; the model assumes the square."
        )
        numbers = {"exponent": exponent.exponent, "std": exponent.std}
        yield (warn if contradicts_square else remark)("voltage_exponent", "thrust", message, **numbers)
