r"""The parameter of the autopilot that linearizes thrust, so that gains act equally over the whole throttle.

An autopilot turns a demand :math:`d`, a share of full thrust, into an output :math:`s` by a curve with one parameter.
With the thrust :math:`T(s)` of ``physical.motors`` the gain of every loop is proportional to

.. math:: g = \frac{dT}{ds} \frac{ds}{dd}

and the best parameter makes it change least over the flown outputs. It changes the gain in hover too, so the rate gains
are divided by that change: in hover the vehicle flies as before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.autopilots.registry import named
from rotorid.autopilots.thrust import ThrustParameter, expo_bend
from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark
from rotorid.data.quantity import Quantity, with_ends
from rotorid.data.record import FlightRecord
from rotorid.results.model import IdentifiedModel, bounds_of
from rotorid.tuning.loops import over_draws
from rotorid.typing import FloatArray

_GRID = 201
_DRAWS = 200
_OUTPUTS = 41

_WIDEST = 0.2
"""Half the interval of a parameter, over its range, above which nothing is proposed."""

_WORTH = 0.9
"""Largest remaining share of the change of gain over the throttle for a proposal."""


@dataclass(frozen=True, kw_only=True)
class ThrustLinearization(Immutable):
    """The parameter that linearizes thrust.

    Parameters
    ----------
    parameter
        Its name in the firmware.
    flown, proposed
        Its values; equal where it does not change.
    best
        The best value by the fit, with its interval.
    flown_range, proposed_range
        Least and largest gain of the loops over the flown outputs, relative to hover.
    hover_gain
        Gain in hover with the proposed value relative to the flown one: the rate gains are divided by it.
    hover_demand, flown_hover_demand
        Demand of thrust in hover with the proposed value, and with the flown one.
    findings
        Why nothing is proposed.
    """

    parameter: str
    flown: float
    proposed: float
    best: Quantity
    flown_range: tuple[float, float]
    proposed_range: tuple[float, float]
    hover_gain: float
    hover_demand: float
    flown_hover_demand: float
    findings: tuple[Finding, ...] = field(default=())

    @property
    def changed(self) -> bool:
        """Whether another value is proposed."""
        return self.proposed != self.flown

    def kept(self, why: str) -> ThrustLinearization:
        """The same with the flown value, where the gains cannot be adapted to another one."""
        message = f"{self.parameter} is not changed: {why}."
        return replace(
            self,
            proposed=self.flown,
            proposed_range=self.flown_range,
            hover_gain=1.0,
            hover_demand=self.flown_hover_demand,
            findings=(*self.findings, remark("thrust_stays", self.parameter, message)),
        )


def linearization(
    models: Sequence[IdentifiedModel], record: FlightRecord | None, *, autopilot: str, seed: int = 0
) -> ThrustLinearization | None:
    """The parameter that linearizes thrust, by a fit of ``physical.motors`` or ``physical.flight``; ``None`` without.

    Parameters
    ----------
    models
        Of which the first that knows its motors counts.
    record
        Log with the parameters as flown.
    autopilot
        ``PX4``, ``ArduPilot`` or ``Betaflight``.
    """
    model = next((model for model in models if model.motors is not None), None)
    parameter = named(autopilot).thrust_parameter
    kind = parameter() if parameter is not None else None
    if model is None or model.motors is None or kind is None or model.motors.outputs == "speed":
        return None
    motors = model.motors
    flown = _flown(kind, record, model)
    known = motors.straightening
    low, high = (known.low, known.high) if known is not None else (0.0, 1.0)
    outputs = np.linspace(*motors.flown_outputs, _OUTPUTS)
    hover = np.array([motors.hover_output])
    if motors.outputs == "thrust_demand":
        # The curve was fitted by the demand: the autopilot's own curve leads to the output.
        straightened = known.expo if known is not None else flown
        shares, at_hover = (_share_of(demand, straightened) for demand in (outputs, hover))
        slopes, slope_hover = (
            _slope(model, demand, seed) * expo_bend(share, np.array(straightened))
            for demand, share in ((outputs, shares), (hover, at_hover))
        )
    else:
        shares, at_hover = ((value - low) / (high - low) for value in (outputs, hover))
        slopes, slope_hover = _slope(model, outputs, seed), _slope(model, hover, seed)
    shares = np.clip(shares, 1e-3, 1.0)
    grid = np.linspace(0.0, kind.largest, _GRID)[:, None]
    relative = kind.bend(shares[None], grid) / kind.bend(at_hover[None], grid)
    spread = np.array(
        [np.ptp(np.log(np.abs(row / top) / relative), axis=1) for row, top in zip(slopes, slope_hover, strict=True)]
    )
    best = over_draws(grid[np.argmin(spread, axis=1), 0], "1")
    proposed = float(round(best.value)) if kind.integer else float(np.float32(f"{best.value:.3g}"))

    def ranged(value: float) -> tuple[float, float]:
        point = np.array([[value]])
        gain = slopes[0] / slope_hover[0] * kind.bend(at_hover[None], point)[0] / kind.bend(shares[None], point)[0]
        return float(gain.min()), float(gain.max())

    before, after = ranged(flown), ranged(proposed)
    findings = _stays(kind, model, best, before, after)
    if findings:
        proposed, after = flown, before
    bends = [float(kind.bend(at_hover, np.array([value]))[0]) for value in (flown, proposed)]
    return ThrustLinearization(
        parameter=kind.name,
        flown=flown,
        proposed=proposed,
        best=best,
        flown_range=before,
        proposed_range=after,
        hover_gain=bends[0] / bends[1],
        hover_demand=float(kind.demand(at_hover, np.array([proposed]))[0]),
        flown_hover_demand=float(kind.demand(at_hover, np.array([flown]))[0]),
        findings=findings,
    )


def _flown(kind: ThrustParameter, record: FlightRecord | None, model: IdentifiedModel) -> float:
    if record is not None and kind.name in record.parameters:
        return float(record.parameters[kind.name])
    known = model.motors.straightening if model.motors is not None else None
    return float(known.expo) if known is not None and not kind.integer else 0.0


def _share_of(demand: FloatArray, expo: float) -> FloatArray:
    """Share of the range of the output for a demand, by the curve of ArduPilot and PX4."""
    if expo < 1e-6:
        return demand
    half = (1.0 - expo) / (2.0 * expo)
    return np.asarray(np.sqrt(half**2 + demand / expo) - half)


def _slope(model: IdentifiedModel, at: FloatArray, seed: int) -> FloatArray:
    """Slope of thrust of the fit and of draws of it, the fit itself first, shape ``(1 + draws, x)``."""
    names = [name for name in ("c_1", "c_2") if name in model.parameters]
    mean = np.array([model.parameters[name].value for name in names])
    covariance = np.zeros((len(names), len(names)))
    free = [index for index, name in enumerate(names) if name in model.bounds.names]
    if free:
        covariance[np.ix_(free, free)] = bounds_of(model.bounds, [names[index] for index in free]).covariance
    drawn = np.random.default_rng(seed).multivariate_normal(mean, covariance, size=_DRAWS)
    powers = {"c_1": np.ones_like(at), "c_2": 2.0 * at}
    return np.asarray(np.vstack([mean, drawn]) @ np.array([powers[name] for name in names]))


def _stays(
    kind: ThrustParameter,
    model: IdentifiedModel,
    best: Quantity,
    before: tuple[float, float],
    after: tuple[float, float],
) -> tuple[Finding, ...]:
    """Why the parameter does not change; empty where it does."""
    assert model.motors is not None
    if model.motors.curve_assumed:
        message = (
            f"{kind.name} is not changed: the throttle did not move, so the thrust curve was assumed. Fly "
            "throttle steps."
        )
    elif model.flight is not None and "c_1" not in model.parameters:
        message = f"{kind.name} is not changed: these flights do not show the bend of thrust. Fly throttle steps."
    elif "c_2" not in model.parameters or "c_1" not in model.parameters:
        message = (
            f"{kind.name} is not changed: thrust was fitted as {model.motors.curve}. Fly throttle steps and identify "
            "with "
            "--curve polynomial."
        )
    elif best.upper - best.lower > 2.0 * _WIDEST * kind.largest:
        message = (
            f"{kind.name} is not changed: its best value {with_ends(best.value, best.lower, best.upper)} is too "
            "uncertain. "
            "Fly larger throttle steps."
        )
    elif np.log(after[1] / after[0]) > _WORTH * np.log(before[1] / before[0]):
        message = (
            f"{kind.name} is not changed: thrust is nearly linear; over the flown throttle the loop gain is "
            f"{before[0]:.2f} to {before[1]:.2f} times that in hover."
        )
    else:
        return ()
    return (remark("thrust_stays", kind.name, message),)
