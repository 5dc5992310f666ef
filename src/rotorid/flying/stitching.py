r"""Models identified at several speeds as one over speed, with bands, and a flight through the speeds to judge it on.

A derivative goes straight from one speed to the next,

.. math::

    \theta(V) = (1 - \lambda) \theta_i + \lambda \theta_{i+1}, \qquad
    \sigma^2(V) = (1 - \lambda)^2 s_i^2 + \lambda^2 s_{i+1}^2 + ((1 - \lambda) m_i + \lambda m_{i+1})^2, \qquad
    \lambda = \frac{V - V_i}{V_{i+1} - V_i}

with the random errors :math:`s`, which are independent in different flights, and the model errors :math:`m`, which are
not: the same sensors, clocks and structure made all of them. What the straight line misses in between is no part of the
band: of a curvature :math:`\theta''` it is up to :math:`\theta'' (V_{i+1} - V_i)^2 / 8`. Beyond the speeds that were
flown the last values hold.

A result of ``physical.flight`` takes the place of further sweeps: a model of one speed goes on to the others by the
change of its derivatives in the physics of that flight (:mod:`rotorid.flying.flight_points`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Unpack

import numpy as np

from rotorid.data.base import Immutable, ShownByDocument, read_only
from rotorid.data.findings import Finding, remark, warn, worst_first
from rotorid.data.record import AXES, FlightRecord, Maneuver, TimeHistory
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.flights.flights import longest_flight
from rotorid.flights.given_controllers import Controllers, doubts_of, no_controller
from rotorid.flights.segments import built, with_ingredients
from rotorid.flying.flight_points import over_speed
from rotorid.flying.model_from_results import HALVES
from rotorid.flying.settings import StitchSettings
from rotorid.io.records import as_records
from rotorid.models.controller import stepped
from rotorid.results.model import IdentifiedModel, Records, as_models, bounds_of
from rotorid.results.provenance import Provenance, hashes, logged
from rotorid.settings.given_controllers import GivenController
from rotorid.settings.option import as_settings
from rotorid.signal.clock import resample
from rotorid.signal.excitations import ATTITUDE_SETPOINTS
from rotorid.simulation.stitched import (
    FORCES,
    MOTIONS,
    STATES,
    TRIMS,
    ClosedAxis,
    StitchedModel,
    simulate_stitched,
    steps_of,
)
from rotorid.typing import Axis, FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.verification.closed_loop import LoopScores, scored
from rotorid.verification.sampled import low_pass

if TYPE_CHECKING:
    from rotorid.settings.option_types import StitchOptions

_PROGRESS = logging.getLogger("rotorid.progress")

SAMPLE_RATE_HZ = 100.0
"""Of the flight through the speeds."""

DRAWS = 20
"""Models drawn from the covariance for the spread of a flight."""

_LEAST_SPACING_M_S = 0.2
"""Least distance of the speeds of two results of one half."""

_COLUMNS = (*MOTIONS, *AXES)
_OWN: Mapping[str, tuple[str, ...]] = {
    HALVES[0]: ("u", "w", "theta", "pitch_command", "thrust_command"),
    HALVES[1]: ("v", "phi", "roll_command", "yaw_command"),
}
_TRIM_CONSTANTS = {"u": "U0", "v": "V0", "w": "W0", "phi": "phi0", "theta": "theta0"}
_COMPARED_STATES = ("u", "v", "w", "phi", "theta", "p", "q", "r")
_FLOWN: tuple[Axis, ...] = ("roll", "pitch", "yaw")

_SHORTEST_S = 5.0
"""A log that flies for less is not flown through the speeds."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StitchedPoint(Immutable):
    """One result at its speed.

    Parameters
    ----------
    label
        What the result is called.
    model
        The result.
    speed_m_s
        Forward speed of its trim, along the body.
    trim
        Of :data:`rotorid.simulation.stitched.TRIMS`, what it knows.
    """

    label: str
    model: IdentifiedModel
    speed_m_s: float
    trim: Mapping[str, float]

    def __post_init__(self) -> None:
        self._set(trim=self.trim)


@dataclass(frozen=True, kw_only=True, eq=False)
class SpeedCurve(Immutable):
    """A parameter over speed.

    Parameters
    ----------
    unit
        Of the parameter.
    speed_m_s, value
        Where it was identified, shape ``(k,)``.
    std
        One standard deviation, shape ``(k,)``; not a number where the parameter was dropped and stands at zero.
    std_model
        Its part that all results have alike, shape ``(k,)``.
    """

    unit: str
    speed_m_s: FloatArray
    value: FloatArray
    std: FloatArray
    std_model: FloatArray

    def __post_init__(self) -> None:
        for name in ("speed_m_s", "value", "std", "std_model"):
            self._set(**{name: read_only(getattr(self, name), np.float64, ndim=1)})

    def at(self, speed_m_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Values and standard deviations at some speeds, each of their shape.

        Examples
        --------
        >>> curve = SpeedCurve(unit="1/s", speed_m_s=[0.0, 4.0], value=[-0.2, -0.4], std=[0.03, 0.04], std_model=[0, 0])
        >>> [numbers.round(4).tolist() for numbers in curve.at(np.array([0.0, 2.0, 9.0]))]
        [[-0.2, -0.3, -0.4], [0.03, 0.025, 0.04]]
        """
        weights = np.array([np.interp(speed_m_s, self.speed_m_s, row) for row in np.eye(self.speed_m_s.size)])
        known = np.isfinite(self.std)
        random, alike = np.where(known, [self.std**2 - self.std_model**2, self.std_model], 0.0)
        variance = np.maximum(random, 0.0) @ weights**2 + (alike @ weights) ** 2
        return self.value @ weights, np.where((weights * ~known[:, None]).any(axis=0), np.nan, np.sqrt(variance))


@dataclass(frozen=True, kw_only=True, eq=False)
class ThroughSpeeds(Immutable):
    """A flight through the speeds, as it was and as the stitched model flies it.

    Parameters
    ----------
    record
        Name of the log.
    start_s, stop_s
        Interval on its clock.
    time_s
        Shape ``(samples,)``.
    measured, simulated, spread
        Channel to its samples; ``spread`` is one standard deviation by the parameters' covariance.
    scores
        Channel to how it was predicted, commands of closed loops among them.
    setpoints
        Command to the channel that drove its controller.
    low_pass_rad_s
        Measured and simulated pass the same filter before they are scored: up to where all models were fitted. ``None``
        where they were not fitted to responses.
    """

    record: str
    start_s: float
    stop_s: float
    time_s: FloatArray
    measured: Mapping[str, FloatArray]
    simulated: Mapping[str, FloatArray]
    spread: Mapping[str, FloatArray]
    scores: Mapping[str, LoopScores]
    setpoints: Mapping[str, str]
    low_pass_rad_s: float | None = None

    def __post_init__(self) -> None:
        self._set(time_s=read_only(self.time_s, np.float64, ndim=1), scores=self.scores, setpoints=self.setpoints)
        for name in ("measured", "simulated", "spread"):
            rows = {key: read_only(row, np.float64, ndim=1) for key, row in getattr(self, name).items()}
            self._set(**{name: rows})


@dataclass(frozen=True, kw_only=True, eq=False)
class Stitched(ShownByDocument, Immutable):
    """Models at several speeds as one.

    Parameters
    ----------
    points
        The results, by model and rising speed.
    flights
        Logs through the speeds, judged.
    findings
        Remarks, the grave ones first.
    provenance
        Where all of it came from.
    """

    points: tuple[StitchedPoint, ...]
    provenance: Provenance
    flights: tuple[ThroughSpeeds, ...] = ()
    findings: tuple[Finding, ...] = ()

    def __post_init__(self) -> None:
        self._set(points=tuple(self.points), flights=tuple(self.flights), findings=tuple(self.findings))

    @property
    def models(self) -> tuple[str, ...]:
        """Names of the models that are stitched."""
        return tuple(dict.fromkeys(point.model.name for point in self.points))

    @property
    def speed_m_s(self) -> FloatArray:
        """Speeds of all points, rising, shape ``(k,)``."""
        return np.unique([point.speed_m_s for point in self.points])

    def of(self, model: str) -> tuple[StitchedPoint, ...]:
        """The points of one model."""
        return tuple(point for point in self.points if point.model.name == model)

    @property
    def curves(self) -> dict[str, dict[str, SpeedCurve]]:
        """Model to its parameters over speed."""
        return {name: _curves(self.of(name)) for name in self.models}

    def stitched_model(self, draw: np.random.Generator | None = None) -> StitchedModel:
        """The tables that fly.

        Parameters
        ----------
        draw
            Draws the parameters from their covariance; their values when none is given.

        Raises
        ------
        UsageError
            A result does not say at which commands it was in trim.
        """
        speeds = self.speed_m_s
        derivatives = np.zeros((speeds.size, len(FORCES), len(_COLUMNS)))
        lag_s, delay_s = np.zeros((speeds.size, len(AXES))), np.zeros((speeds.size, len(AXES)))
        trim = np.zeros((speeds.size, len(TRIMS)))
        trim[:, TRIMS.index("u")] = speeds
        for model in self.models:
            points = self.of(model)
            own = [point.speed_m_s for point in points]
            drawn = None if draw is None else _Draw.of(points, draw)
            values = [_values(point, drawn) for point in points]
            table = {
                name: np.interp(speeds, own, [derivatives.get(name, 0.0) for derivatives in values])
                for name in {name for derivatives in values for name in derivatives}
            }
            for (row, letter), (column, motion) in _entries():
                if f"{letter}_{motion}" in table:
                    derivatives[:, row, column] = table[f"{letter}_{motion}"]
            for axis in (name.removesuffix("_command") for name in points[0].model.structure.inputs):
                lag_s[:, AXES.index(axis)] = table.get("T_motor", 0.0)
                delay_s[:, AXES.index(axis)] = table.get(f"tau_{axis}", 0.0)
            for name in set(TRIMS) - {"u"}:
                if name in _OWN[model] or len(self.models) == 1:
                    trim[:, TRIMS.index(name)] = np.interp(speeds, own, [_trim(point, name) for point in points])
        return StitchedModel(speed_m_s=speeds, derivatives=derivatives, trim=trim, lag_s=lag_s, delay_s=delay_s)


def _entries() -> list[tuple[tuple[int, str], tuple[int, str]]]:
    return [(row, column) for row in enumerate(FORCES) for column in enumerate(_COLUMNS)]


def _trim(point: StitchedPoint, name: str) -> float:
    if name not in point.trim:
        if name.endswith("_command"):
            raise UsageError(
                f"{point.label} does not contain {name} at trim",
                needed="a result of this version",
                remedy="identify the model again",
            )
        return 0.0
    return point.trim[name]


@dataclass(frozen=True, kw_only=True)
class _Draw:
    """Draws of the results of one model: random errors of each, and model errors shared by all."""

    rng: np.random.Generator
    alike: Mapping[str, float]

    @classmethod
    def of(cls, points: Sequence[StitchedPoint], rng: np.random.Generator) -> _Draw:
        names = dict.fromkeys(name for point in points for name in point.model.structure.parameters.free)
        return cls(rng=rng, alike=dict(zip(names, rng.standard_normal(len(names)), strict=True)))

    def errors(self, bounds: Bounds) -> FloatArray:
        """Errors of the parameters of one result, shape ``(p,)``."""
        size, vectors = np.linalg.eigh(bounds.covariance - bounds.random)
        root = (vectors * np.sqrt(np.maximum(size, 0.0))) @ vectors.T
        chance = self.rng.multivariate_normal(np.zeros(len(bounds.names)), bounds.random, method="eigh")
        return np.asarray(chance + root @ np.array([self.alike[name] for name in bounds.names]))


def _values(point: StitchedPoint, draw: _Draw | None) -> dict[str, float]:
    """Parameters of a result, dropped ones at zero; drawn from their covariance where that is wanted."""
    structure = point.model.structure
    parameters = structure.parameters
    if draw is not None:
        bounds = bounds_of(point.model.bounds, parameters.free)
        changed = draw.errors(bounds)
        drawn = {
            name: float(np.clip(parameters[name].value + by, parameters[name].lower, parameters[name].upper))
            for name, by in zip(bounds.names, changed, strict=True)
        }
        parameters = parameters.with_values(drawn)
    return dict(parameters.values)


def _curves(points: Sequence[StitchedPoint]) -> dict[str, SpeedCurve]:
    names = dict.fromkeys(name for point in points for name in point.model.parameters)
    curves = {}
    for name in names:
        found = [point.model.parameters.get(name) for point in points]
        if all(estimate is None or estimate.status == "dropped" for estimate in found):
            continue
        kept = [estimate for estimate in found if estimate is not None]
        curves[name] = SpeedCurve(
            unit=kept[0].unit,
            speed_m_s=np.array([point.speed_m_s for point in points]),
            value=np.array(
                [0.0 if estimate is None or estimate.status == "dropped" else estimate.value for estimate in found]
            ),
            std=np.array([_std(estimate) for estimate in found]),
            std_model=np.array([getattr(estimate, "std_model", None) or 0.0 for estimate in found]),
        )
    return curves


def _std(number: object) -> float:
    status, std = getattr(number, "status", "dropped"), getattr(number, "std", None)
    if status == "fixed":
        return 0.0
    return float("nan") if std is None or status == "dropped" else float(std)


def stitch(
    models: Mapping[str, IdentifiedModel],
    records: Records = (),
    *,
    settings: StitchSettings | None = None,
    **options: Unpack[StitchOptions],
) -> Stitched:
    """Stitch models over speed, and judge them on flights through the speeds.

    Parameters
    ----------
    models
        What each result is called, to ``hover.longitudinal`` or ``hover.lateral``, identified in level flight at
        several speeds: two and more of each model that is there, or one and a result of ``physical.flight`` of the
        same vehicle. Their trim is that of their constants ``U0 W0 theta0 phi0`` and of the mean commands.
    records
        Flights in which the speed changes, or their files, flown under controllers whose gains the log holds; both
        models are needed.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.flying.settings.StitchSettings`, which go before ``settings``.

    Raises
    ------
    UsageError
        A model is none of these two, two results of one model have the same speed, or one is alone.
    InsufficientDataError
        A log does not hold what the simulation needs.

    Examples
    --------
    >>> import rotorid
    >>> names = ("hover", "four", "eight")  # doctest: +SKIP
    >>> stitched = rotorid.stitch({name: rotorid.load(name) for name in names})  # doctest: +SKIP
    >>> stitched.curves["hover.longitudinal"]["X_u"].at(np.array([2.0]))  # doctest: +SKIP
    (array([-0.27]), array([0.012]))
    """
    chosen, records = as_settings(StitchSettings, settings, options), as_records(records, optional=True)
    if not isinstance(models, Mapping):
        raise UsageError(f"{type(models).__name__} has no names of models", needed="a dictionary of names to results")
    as_models(models.values())
    further, added = _with_further_speeds(models)
    points = _points(further)
    sources = [model.provenance for model in models.values()]
    result = Stitched(
        points=points,
        findings=(*_dropped(points), *added),
        provenance=Provenance(
            inputs={name: sha256 for provenance in sources for name, sha256 in provenance.inputs.items()}
            | hashes(records),
            seed=chosen.seed,
        ),
    )
    for number, record in enumerate(records):
        _PROGRESS.info("flying %s", record.source.name, extra={"done": number, "total": len(records)})
        flown, findings = _through(result, record, chosen.controllers, chosen.seed)
        maneuver = Maneuver(axis="pitch", kind="other", start_s=flown.start_s, stop_s=flown.stop_s, origin="found")
        result = replace(
            result,
            flights=(*result.flights, flown),
            findings=(*result.findings, *findings),
            provenance=replace(result.provenance, maneuvers=(*result.provenance.maneuvers, logged(record, maneuver))),
        )
    return replace(result, findings=worst_first(result.findings))


def refused_flight(error: InsufficientDataError, stitched: Stitched, records: Sequence[FlightRecord]) -> Stitched:
    """A stitched model without the flights that the data do not support, and why.

    Parameters
    ----------
    error
        What ended the run.
    stitched
        The model without flights.
    """
    why = error.findings or (
        Finding(kind="lost_through_speeds", severity="error", where="logs", message=f"{error.came}.", numbers={}),
    )
    remarks = [finding for record in records for finding in record.findings]
    provenance = replace(stitched.provenance, inputs={**stitched.provenance.inputs, **hashes(records)})
    return replace(stitched, findings=worst_first((*remarks, *why, *stitched.findings)), provenance=provenance)


def _with_further_speeds(models: Mapping[str, IdentifiedModel]) -> tuple[dict[str, IdentifiedModel], list[Finding]]:
    """The results of the halves, and those that a result of ``physical.flight`` makes of a half of one speed."""
    flights = {label: model for label, model in models.items() if model.flight is not None}
    halves = {label: model for label, model in models.items() if label not in flights}
    if not flights:
        return halves, []
    if len(flights) > 1:
        raise UsageError(f"{', '.join(flights)} are results of physical.flight", needed="one for one vehicle")
    ((source, flight),) = flights.items()
    names = [model.name for model in halves.values()]
    alone = {
        label: model
        for label, model in halves.items()
        if names.count(model.name) == 1 and "U0" in model.structure.constants
    }
    if not alone:
        raise UsageError(
            f"{source} adds no speed",
            needed="a model that was identified at one speed alone",
            remedy="leave it out",
        )
    findings: list[Finding] = []
    for label, model in alone.items():
        (halves[label], *further), remarks = over_speed(model, flight)
        findings += remarks
        trims = [one.structure.constants for one in further]
        speeds = [round(math.hypot(trim["U0"], trim["W0"]), 1) for trim in trims]
        halves |= {f"{label} at {speed:g} m/s": one for speed, one in zip(speeds, further, strict=True)}
        findings.append(
            remark(
                "speeds_by_physics",
                model.name,
                f"{model.name} was identified at one speed. Up to {speeds[-1]:g} m/s its derivatives follow from "
                f"{source}: what the physics leaves out stays as it was.",
                highest_m_s=speeds[-1],
            )
        )
    return halves, findings


def _points(models: Mapping[str, IdentifiedModel]) -> tuple[StitchedPoint, ...]:
    points = []
    for label, model in models.items():
        if model.name not in HALVES:
            raise UsageError(f"{label} is a result of {model.name}", needed=f"results of {' or '.join(HALVES)}")
        constants, means = model.structure.constants, {name: point.mean for name, point in model.covered.items()}
        trim = {name: float(constants[own]) for name, own in _TRIM_CONSTANTS.items() if own in constants}
        trim |= {name: mean for name in TRIMS if name.endswith("_command") and (mean := means.get(name)) is not None}
        points.append(StitchedPoint(label=label, model=model, speed_m_s=trim["u"], trim=trim))
    ordered = sorted(points, key=lambda point: (HALVES.index(point.model.name), point.speed_m_s))
    for name in dict.fromkeys(point.model.name for point in ordered):
        own = [point for point in ordered if point.model.name == name]
        if len(own) < 2:
            raise UsageError(
                f"{name} has only one speed, {own[0].speed_m_s:.2f} m/s",
                needed="two or more speeds of each model",
                remedy="identify it at another speed, give a result of physical.flight, or leave it out",
            )
        for point, other in pairwise(own):
            if other.speed_m_s - point.speed_m_s < _LEAST_SPACING_M_S:
                raise UsageError(
                    f"{point.label} and {other.label} are both {name} at {point.speed_m_s:.2f} m/s",
                    needed=f"speeds at least {_LEAST_SPACING_M_S:g} m/s apart",
                    remedy="identify one model from both logs, or leave one out",
                )
    if not ordered:
        raise UsageError("no result was given", needed="two or more results of hover.longitudinal or hover.lateral")
    return tuple(ordered)


def _dropped(points: Sequence[StitchedPoint]) -> list[Finding]:
    """Remarks on parameters that some speeds know and others dropped."""
    findings = []
    for name in dict.fromkeys(point.model.name for point in points):
        own = [point for point in points if point.model.name == name]
        for parameter, curve in _curves(own).items():
            zero = [f"{speed:.1f}" for speed, std in zip(curve.speed_m_s, curve.std, strict=True) if np.isnan(std)]
            if zero:
                findings.append(
                    remark(
                        "dropped_at_speed",
                        parameter,
                        f"{parameter} of {name} was dropped from the fit at {', '.join(zero)} m/s and is zero there, "
                        "without an error. Excite it more strongly at that speed, or --fix it everywhere.",
                        speeds=float(len(zero)),
                    )
                )
    return findings


def _through(
    stitched: Stitched, record: FlightRecord, given: Mapping[Axis, GivenController], seed: int
) -> tuple[ThroughSpeeds, list[Finding]]:
    """A log flown by the stitched model: set-points of roll, pitch and yaw and the command of thrust are the log's."""
    if set(stitched.models) != set(HALVES):
        raise UsageError(
            f"{' and '.join(stitched.models)} alone cannot be flown", needed=f"results of {' and '.join(HALVES)}"
        )
    flying = Controllers(record=record, given=given)
    history = _history(record, flying)
    closed, setpoints, findings = _closed_axes(record, flying, history)
    names = (*_COMPARED_STATES, *setpoints)
    simulated = _fly(stitched.stitched_model(None), history, closed)
    _require_in_the_air(record, history, simulated, names)
    rng = np.random.default_rng(seed)
    draws = [_fly(stitched.stitched_model(rng), history, closed) for _ in range(DRAWS)]
    scores, cutoff = _scored(stitched, history, simulated, names)
    return (
        ThroughSpeeds(
            record=record.source.name,
            start_s=history.start_s,
            stop_s=float(history.time_s[-1]),
            time_s=history.time_s,
            measured={name: history[name] for name in names},
            simulated={name: simulated[name] for name in names},
            spread={name: np.nanstd([draw[name] - simulated[name] for draw in draws], axis=0) for name in names},
            scores=scores,
            setpoints=setpoints,
            low_pass_rad_s=cutoff,
        ),
        [*findings, *_beyond_speeds(record, history, stitched.speed_m_s)],
    )


def _closed_axes(
    record: FlightRecord, flying: Controllers, history: TimeHistory
) -> tuple[list[ClosedAxis], dict[str, str], list[Finding]]:
    """The loops that the log's controllers close, command to the channel that drives each, and doubts about them."""
    step_hz = steps_of(history.sample_rate_hz) * history.sample_rate_hz
    closed: list[ClosedAxis] = []
    setpoints: dict[str, str] = {}
    findings: list[Finding] = []
    for axis in _FLOWN:
        found = flying.loop(axis, history, lambda rows: rows)
        if found is None:
            raise _unflown(record, no_controller(flying, [axis]))
        loop, setpoint, _ = found
        findings += doubts_of(flying, axis, found)[1]
        # Whether its controller is the one that flew shows at the rate, because the integral of a rate is no angle over
        # a flight. Yaw follows its rate, since a heading that is held moves with the stick.
        angle = ATTITUDE_SETPOINTS.get(axis, "")
        if loop.controller.angle_1_s and angle in history.names:
            loop, setpoint = replace(loop, driven="angle", setpoint=history[angle]), angle
        controller = stepped(loop.controller, step_s=1.0 / step_hz, driven=loop.driven)
        closed.append(
            ClosedAxis(command=loop.command, controller=controller, setpoint=loop.setpoint, excitation=loop.excitation)
        )
        setpoints[loop.command] = setpoint
    return closed, setpoints, findings


def _fly(model: StitchedModel, history: TimeHistory, closed: Sequence[ClosedAxis]) -> dict[str, FloatArray]:
    """The flight as a model has it, from the mean of the first fifth of a second on."""
    first = max(1, round(0.2 * history.sample_rate_hz))
    return simulate_stitched(
        model,
        np.array([history[f"{axis}_command"] for axis in AXES]),
        sample_rate_hz=history.sample_rate_hz,
        start={name: float(history[name][:first].mean()) for name in STATES},
        closed=closed,
    )


def _require_in_the_air(
    record: FlightRecord, history: TimeHistory, simulated: Mapping[str, FloatArray], names: Sequence[str]
) -> None:
    if all(np.isfinite(simulated[name]).all() for name in names):
        return
    lost_s = float(np.argmax(~np.isfinite(simulated["theta"]))) / history.sample_rate_hz
    finding = warn(
        "lost_through_speeds",
        record.source.name,
        f"The stitched model falls over {lost_s:.1f} s into {record.source.name}: it is unstable under these "
        "controllers, or they are not those that flew.",
        after_s=lost_s,
    )
    raise _unflown(record, finding)


def _scored(
    stitched: Stitched, history: TimeHistory, simulated: Mapping[str, FloatArray], names: Sequence[str]
) -> tuple[dict[str, LoopScores], float | None]:
    """How each channel was predicted, and the low-pass that both pass before: up to where all models were fitted."""
    highest = [band[1] for point in stitched.points if (band := point.model.band_rad_s) is not None]
    cutoff = min(highest) if len(highest) == len(stitched.points) else None
    passed = low_pass(cutoff, history.sample_rate_hz) if cutoff is not None else lambda rows: rows
    measured, predicted = (passed(np.array([row[name] for name in names])) for row in (history, simulated))
    return {name: scored(*pair) for name, *pair in zip(names, measured, predicted, strict=True)}, cutoff


def _beyond_speeds(record: FlightRecord, history: TimeHistory, speeds: FloatArray) -> list[Finding]:
    """The warning for a flight that is more than 1 m/s slower or faster than all models."""
    reach = [float(history["u"].min()), float(history["u"].max())]
    if reach[0] >= speeds[0] - 1.0 and reach[1] <= speeds[-1] + 1.0:
        return []
    return [
        warn(
            "beyond_speeds",
            record.source.name,
            f"{record.source.name} flies at {reach[0]:.1f} to {reach[1]:.1f} m/s, but the models cover "
            f"{speeds[0]:.1f} to {speeds[-1]:.1f} m/s. Outside, the nearest model was used.",
            lowest_m_s=reach[0],
            highest_m_s=reach[1],
        )
    ]


def _unflown(record: FlightRecord, finding: Finding) -> InsufficientDataError:
    return InsufficientDataError(
        f"{record.source.name} cannot be flown through the speeds", needed=finding.message, findings=(finding,)
    )


def _history(record: FlightRecord, flying: Controllers) -> TimeHistory:
    """The longest stretch in the air, with all that the simulation takes and is judged on."""
    start_s, stop_s = longest_flight(record, or_whole=False)
    if stop_s - start_s < _SHORTEST_S:
        raise InsufficientDataError(
            f"{record.source.name} is only {stop_s - start_s:.1f} s in the air", needed=f"{_SHORTEST_S:g} s"
        )
    wanted = (*STATES, *(f"{axis}_command" for axis in AXES), *flying.channels(_FLOWN))
    channels = with_ingredients(record, wanted)
    conditioned = resample(record, channels=channels, start_s=start_s, stop_s=stop_s, sample_rate_hz=SAMPLE_RATE_HZ)
    return built(conditioned.longest, tuple(dict.fromkeys(wanted)))
