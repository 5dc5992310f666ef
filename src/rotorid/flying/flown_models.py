"""Fly an identified model: through the inputs of a log beside what was measured there, or through a plan alone.

The model is simulated over whole flights, not over the maneuvers that suit it. What it cannot know of a flight is
estimated from that flight: the state in which it begins and, of a model about trim, its trim. Everything else is held,
so that what the simulation misses is the model's. Where a mode grows, or where a model only says accelerations, a
simulation begins anew after some seconds, since any error would decide all that follows; how long such a piece is, is
said.

- a **linear** model follows its outputs about trim;
- a **nonlinear** one, such as ``flight.first_order``, all it has: positions, velocities, attitude;
- **responses to set-points** of roll, pitch and climb together with a **linear drag** are joined into such a flight;
- ``physical.motors`` says angular accelerations, which are integrated to rates.

Bands are 95 % over vehicles drawn from the covariance of the parameters: what the model may err by where its structure
is right and the air is still. Gusts and noise are not in them.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any

import numpy as np

from rotorid.checking.candidate import identified_motors
from rotorid.checking.flown_motors import predicted, predicted_by
from rotorid.checking.flown_nonlinear import flown_records, logged_outputs, output_scores, whole_flights
from rotorid.data.axes import RATES
from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, refusal, remark, warn, worst_first
from rotorid.data.flight_plan import FlightPlan
from rotorid.data.record import FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.fits.motors.fitted import levers_of
from rotorid.fits.motors.motion import Motion
from rotorid.fits.time.fit import growth, piece_s, posed_in_pieces
from rotorid.fitting.motors.problem import MotorProblem
from rotorid.fitting.time.nonlinear import NonlinearProblem, fit_nonlinear
from rotorid.flights.flights import Flight
from rotorid.flights.segments import holds, time_records
from rotorid.flights.selection import require_inside, require_reached
from rotorid.models.equations import structure_from_equations
from rotorid.models.families import family_of
from rotorid.models.nonlinear import AXES as FLIGHT_AXES
from rotorid.models.nonlinear import NonlinearStructure, flight_structure, linear_of
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure, connected
from rotorid.planning.responses import SETPOINTS, setpoint_of
from rotorid.results.model import IdentifiedModel, Records, Refused, bounds_of, parameter_estimates
from rotorid.results.provenance import Provenance, provenance
from rotorid.settings.settings import FlySettings, IdentifySettings, as_records, as_settings
from rotorid.simulation.nonlinear import Scheme, simulate_nonlinear
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds
from rotorid.verification.verification import Scores

_PROGRESS = logging.getLogger("rotorid.progress")

_DRAWS = 60
_BAND = (2.5, 97.5)

_MOTORS_PIECE_S = 2.0
"""Length of the pieces in which rates by motors are integrated, unless the user chose one."""

_PLAN_RATE_HZ = 100.0

_YAW_LAG_S = 0.2
"""Lag of the yaw rate where no result says how it answers."""

_START_ROUNDS = 3
"""Estimates of the noise while a start is sought: it only weighs the outputs against each other."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownStretch(Immutable):
    """A flight as it was measured and as the model flies it.

    Parameters
    ----------
    record
        Name of the log, or of the plan.
    maneuver
        The interval.
    time_s
        Stamps, shape ``(samples,)``.
    inputs
        Shape ``(u, samples)``; of a model about trim as differences from their mean.
    measured
        Shape ``(y, samples)``; not a number in a row that the log does not hold.
    simulated, lower, upper
        Shape ``(y, samples)``: the model, and its band of 95 %.
    input_names, output_names
        Names of the rows.
    starts
        Samples at which the simulation began anew, the first included.
    scores
        Output to how it was followed, where it was measured and moved.
    held
        Whether inputs are constant between their samples.
    """

    record: str
    maneuver: Maneuver
    time_s: FloatArray
    inputs: FloatArray
    measured: FloatArray
    simulated: FloatArray
    lower: FloatArray
    upper: FloatArray
    input_names: tuple[str, ...]
    output_names: tuple[str, ...]
    starts: tuple[int, ...] = (0,)
    scores: Mapping[str, Scores] = field(default_factory=dict)
    held: bool = False

    def __post_init__(self) -> None:
        self._set(
            time_s=read_only(self.time_s, np.float64, ndim=1),
            **{
                name: read_only(getattr(self, name), np.float64, ndim=2)
                for name in ("inputs", "measured", "simulated", "lower", "upper")
            },
            input_names=tuple(self.input_names),
            output_names=tuple(self.output_names),
            starts=tuple(self.starts),
            scores=self.scores,
        )

    @property
    def sample_rate_hz(self) -> float:
        """Of everything."""
        return (self.time_s.size - 1) / float(self.time_s[-1] - self.time_s[0])

    @property
    def duration_s(self) -> float:
        """From the first sample to the last."""
        return float(self.time_s[-1] - self.time_s[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownModel(Immutable):
    """What an identified model does with the inputs of logs or of a plan.

    Parameters
    ----------
    model
        What flew; of several results the flight that was joined of them.
    stretches
        Flights, in the order of the logs.
    findings
        Remarks, the worst first.
    provenance
        Which logs it flew through.
    """

    model: IdentifiedModel
    stretches: tuple[FlownStretch, ...]
    findings: tuple[Finding, ...]
    provenance: Provenance


def fly_log(
    models: IdentifiedModel | Sequence[IdentifiedModel],
    records: Records,
    *,
    settings: FlySettings | None = None,
    **options: Any,
) -> FlownModel:
    """Simulate an identified model through whole flights of logs, beside what was measured there.

    Parameters
    ----------
    models
        A result; or results of responses to set-points and of ``drag.linear``, which are joined into a flight.
    records
        Logs as :func:`rotorid.read` gives them, or their files.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.settings.settings.FlySettings`, which go before ``settings``.

    Raises
    ------
    InsufficientDataError
        No log holds what the model needs; findings say what.
    UsageError
        Results do not go together, or an option is wrong.

    Examples
    --------
    >>> import rotorid
    >>> flown = fly_log(rotorid.load("flight"), "flight.bag")  # doctest: +SKIP
    >>> flown.stretches[0].scores["north"].nrmse_fit_percent  # doctest: +SKIP
    83.1
    """
    settings, logs = as_settings(FlySettings, settings, options), as_records(records)
    model, joined = one_model(models)
    fly = _chosen(model)
    stretches: list[FlownStretch] = []
    findings = [*(finding for record in logs for finding in record.findings), *joined]
    flights: list[Flight] = []
    require_inside(logs, settings.segments)
    for record in logs:
        name = record.source.name
        _PROGRESS.info(f"flying {model.name} through {name}")
        try:
            require_reached(record, settings.segments)
            found, told = fly(model, record, settings)
        except InsufficientDataError as error:
            findings += [*error.findings, warn("not_verified", name, f"{name} was not flown: {error}")]
            continue
        stretches += found
        findings += told
        flights += [Flight(record, one.maneuver) for one in found]
    if not stretches:
        causes = "; ".join(one.message.rstrip(".") for one in findings if one.kind == "not_verified")
        raise InsufficientDataError(
            causes or "no log came",
            needed=f"a flight with {' or '.join(model.structure.inputs)} and an output of the model",
            remedy="see what rotorid inspect finds, or name an interval with --segment",
            findings=findings,
        )
    return FlownModel(
        model=model,
        stretches=tuple(stretches),
        findings=worst_first(findings),
        provenance=provenance(logs, settings, flights=flights),
    )


def refused_flight(
    error: InsufficientDataError, records: Sequence[FlightRecord], name: str, settings: FlySettings
) -> Refused:
    """What to say of logs that a model cannot fly through."""
    remarks = [finding for record in records for finding in record.findings]
    return Refused(
        name=name,
        structure=None,
        findings=worst_first(error.findings or [*remarks, refusal("not_verified", name, str(error))]),
        provenance=provenance(records, settings),
    )


def fly_plan(
    models: IdentifiedModel | Sequence[IdentifiedModel], plan: FlightPlan, *, settings: FlySettings | None = None
) -> FlownModel:
    """Simulate an identified model through the test inputs of a plan, from rest.

    Parameters
    ----------
    models
        As for :func:`fly_log`; its inputs are set-points.
    plan
        What is asked of it.
    settings
        Choices; everything has a default.

    Raises
    ------
    UsageError
        The plan moves no input of the model, or the model needs a log.
    """
    settings = settings or FlySettings()
    model, joined = one_model(models)
    if not flies_plans(model):
        raise UsageError(
            f"{model.name} came, which has the inputs {', '.join(model.structure.inputs)}",
            needed="a model whose inputs are set-points, such as response.* or flight.*",
        )
    count = round(plan.duration_s * _PLAN_RATE_HZ) + 1
    time_s = np.arange(count) / _PLAN_RATE_HZ
    inputs = np.zeros((len(model.structure.inputs), count))
    left = set()
    for one in plan.inputs:
        name = setpoint_of(one.axis, one.entry)
        if name is None or name not in model.structure.inputs:
            left.add(f"{one.axis} by {one.entry.replace('_', ' ')}")
            continue
        inputs[model.structure.inputs.index(name)] += SETPOINTS[name].sign * one.at(time_s)
    if not inputs.any():
        raise UsageError(
            f"the plan moves {', '.join(sorted(left))}, and {model.name} has {', '.join(model.structure.inputs)}",
            needed="a plan of an input that the model has",
        )
    outputs = model.nonlinear.outputs if model.nonlinear is not None else model.structure.outputs

    def simulated(values: Mapping[str, float]) -> FloatArray:
        return _moved_by(model, values).simulate(inputs, sample_rate_hz=_PLAN_RATE_HZ, hold="zero")

    rows, lower, upper = _with_band(model, simulated, seed=settings.seed)
    stretch = FlownStretch(
        record=plan.name,
        maneuver=Maneuver(axis=plan.axes[0], kind="other", start_s=0.0, stop_s=float(time_s[-1]), origin="given"),
        time_s=time_s,
        inputs=inputs,
        measured=np.full(rows.shape, np.nan),
        simulated=rows,
        lower=lower,
        upper=upper,
        input_names=model.structure.inputs,
        output_names=outputs,
        held=True,
    )
    lost = [remark("unused_choice", what, f"The plan moves {what}, which the model does not have.") for what in left]
    return FlownModel(
        model=model,
        stretches=(stretch,),
        findings=worst_first([*joined, *lost]),
        provenance=provenance((), settings),
    )


def flies_plans(model: IdentifiedModel) -> bool:
    """Whether a model can fly a plan by itself: its inputs are set-points, so that its own loops are in it."""
    return model.motors is None and set(model.structure.inputs) <= set(SETPOINTS)


def _chosen(model: IdentifiedModel) -> Callable[..., tuple[list[FlownStretch], list[Finding]]]:
    """How a kind of model flies."""
    if model.motors is not None:
        return _fly_motors
    return _fly_nonlinear if model.nonlinear is not None else _fly_linear


def _fly_nonlinear(
    model: IdentifiedModel, record: FlightRecord, settings: FlySettings
) -> tuple[list[FlownStretch], list[Finding]]:
    equations = model.nonlinear
    assert equations is not None
    outputs = logged_outputs(equations, [record])
    if not outputs:
        raise InsufficientDataError(
            f"it holds none of {', '.join(equations.outputs)}", needed="an output of the model to begin at"
        )
    seen = equations.select(outputs)
    flights = whole_flights([record], settings.segments)
    records = flown_records(seen, flights, IdentifySettings(hold=settings.hold))
    scheme = Scheme(hold=records.hold)
    stretches = []
    for segment, data in zip(records.segments, records.data, strict=True):
        pieces = [data] if settings.pieces_s is None else list(data.pieces(settings.pieces_s))
        problem = NonlinearProblem(
            structure=seen, parameters=_held(equations.parameters), records=tuple(pieces), scheme=scheme
        )
        starts = fit_nonlinear(problem, rounds=_START_ROUNDS).estimate.starts
        whole = np.zeros((len(pieces), len(equations.states)))
        for number, piece in enumerate(pieces):
            first = dict(zip(seen.outputs, piece.outputs[:, 0].tolist(), strict=True))
            first |= dict(zip(seen.inputs, piece.inputs[:, 0].tolist(), strict=True))
            whole[number] = _measured_start(equations, first)
            for state, value in zip(seen.states, starts[number], strict=True):
                whole[number, equations.states.index(state)] = value

        def simulated(values: Mapping[str, float], pieces: list[Any] = pieces, whole: FloatArray = whole) -> FloatArray:
            rows = [
                simulate_nonlinear(
                    equations,
                    values,
                    piece.inputs,
                    sample_rate_hz=piece.sample_rate_hz,
                    x0=start,
                    before=piece.before,
                    scheme=scheme,
                )
                for piece, start in zip(pieces, whole, strict=True)
            ]
            return np.hstack(rows)

        rows, lower, upper = _with_band(model, simulated, seed=settings.seed)
        measured = np.full(rows.shape, np.nan)
        for name, values in zip(seen.outputs, data.outputs, strict=True):
            measured[equations.outputs.index(name)] = values
        stretches.append(
            FlownStretch(
                record=segment.record,
                maneuver=_interval(segment.maneuver, segment.history.time_s),
                time_s=segment.history.time_s,
                inputs=data.inputs,
                measured=measured,
                simulated=rows,
                lower=lower,
                upper=upper,
                input_names=equations.inputs,
                output_names=equations.outputs,
                starts=_starts(pieces),
                scores=_scored(equations.outputs, measured, rows),
                held=records.hold == "zero",
            )
        )
    told = [finding for finding in records.findings if "needed_hz" not in finding.numbers]
    return stretches, [*told, *_missing(equations.outputs, outputs, record)]


def _measured_start(equations: NonlinearStructure, first: Mapping[str, float]) -> FloatArray:
    """What a first sample says of the states; zero where an output that says it was not measured."""
    known = {**equations.constants, **first}
    told = {state: one for state, one in equations.starts.items() if one.names <= set(known)}
    return np.array([told[state].evaluate(known) if state in told else 0.0 for state in equations.states])


def _fly_linear(
    model: IdentifiedModel, record: FlightRecord, settings: FlySettings
) -> tuple[list[FlownStretch], list[Finding]]:
    whole = model.structure
    inputs = [name for name in whole.inputs if holds(record, name)]
    outputs = [name for name in whole.outputs if holds(record, name)]
    if not inputs or not outputs:
        lacking = whole.inputs if not inputs else whole.outputs
        raise InsufficientDataError(f"it holds none of {', '.join(lacking)}", needed="an input and an output")
    structure = connected(whole.select(inputs=inputs, outputs=outputs))
    flights = whole_flights([record], settings.segments)
    records = time_records(structure, flights, IdentifySettings(hold=settings.hold), every_input=False)
    parameters = structure.parameters
    length_s = settings.pieces_s or piece_s(structure, parameters, records.data)
    stretches = []
    for segment, data in zip(records.segments, records.data, strict=True):
        problem = posed_in_pieces(structure, parameters, records._replace(data=(data,)), length_s)

        def simulated(values: Mapping[str, float], problem: Any = problem) -> FloatArray:
            moved = parameters.with_values({name: values[name] for name in parameters.free})
            return np.hstack([one.predicted for one in problem.predicted(moved.pack())])

        rows, lower, upper = _with_band(model, simulated, seed=settings.seed)
        stretches.append(
            FlownStretch(
                record=segment.record,
                maneuver=_interval(segment.maneuver, segment.history.time_s),
                time_s=segment.history.time_s,
                inputs=data.inputs,
                measured=data.outputs,
                simulated=rows,
                lower=lower,
                upper=upper,
                input_names=structure.inputs,
                output_names=structure.outputs,
                starts=_starts(problem.records),
                scores=_scored(structure.outputs, data.outputs, rows),
                held=records.hold == "zero",
            )
        )
    findings = [*records.findings, *_missing(whole.outputs, structure.outputs, record)]
    rate = growth(structure, parameters)
    if length_s is not None and settings.pieces_s is None:
        message = (
            f"The fastest mode of {whole.name} grows e-fold in {1.0 / rate:.2g} s, and over a whole flight any error "
            f"would explode: the simulation begins anew every {length_s:.2g} s."
        )
        findings.append(remark("flown_in_pieces", whole.name, message, length_s=length_s, growth_1_s=rate))
    return stretches, findings


def _fly_motors(
    model: IdentifiedModel, record: FlightRecord, settings: FlySettings
) -> tuple[list[FlownStretch], list[Finding]]:
    """Rates as integrals of the angular accelerations that the motors make, each piece at its measured mean."""
    known = identified_motors(model)
    assert known is not None
    found = predicted_by(known, record, settings.segments)
    length_s = settings.pieces_s or _MOTORS_PIECE_S
    axes = tuple(axis for axis in RATES if all(f"{axis}_dot" in one.rows for one in found.moved))
    if not axes:
        raise InsufficientDataError("no rate of it was identified", needed="motion in roll, pitch or yaw")
    forces = () if "az" in known.axes else ("weight",)

    def motions_at(values: Mapping[str, float]) -> Sequence[Motion]:
        parameters = ParameterSet(
            tuple(replace(one, value=values.get(one.name, one.value)) for one in known.parameters)
        )
        problem = MotorProblem(
            records=found.data.records,
            levers=levers_of(found.data),
            parameters=parameters,
            axes=(*forces, *known.axes),
        )
        moved, _ = predicted(problem, np.zeros(0), found.data)
        return moved

    drawn = [motions_at(values) for values in _drawn_values(model, seed=settings.seed)]
    stretches = []
    for place, motion in enumerate(found.moved):
        rows = _integrated(motion, motion, axes, length_s)
        others = [_integrated(motion, one[place], axes, length_s) for one in drawn if len(one) == len(found.moved)]
        lower, upper = _band(rows, others)
        measured = _measured_rates(motion, axes)
        time_s = motion.flight.record.time_s[motion.kept]
        stretches.append(
            FlownStretch(
                record=motion.flight.record.name,
                maneuver=_interval(motion.flight.maneuver, time_s),
                time_s=time_s,
                inputs=motion.flight.record.outputs[:, motion.kept],
                measured=measured,
                simulated=rows,
                lower=lower,
                upper=upper,
                input_names=tuple(f"motor_{number + 1}" for number in range(motion.flight.record.outputs.shape[0])),
                output_names=axes,
                starts=_edges(time_s, length_s)[:-1],
                scores=_scored(axes, measured, rows),
                held=True,
            )
        )
    message = f"Motors say accelerations: rates are their integrals, begun anew every {length_s:.2g} s."
    return stretches, [*found.findings, remark("flown_in_pieces", model.name, message, length_s=length_s)]


def _measured_rates(motion: Motion, axes: Sequence[str]) -> FloatArray:
    """Rates of a stretch, shape ``(axes, n)``."""
    return np.stack([motion.flight.record.rates["pqr".index(axis)][motion.kept] for axis in axes])


def _edges(time_s: FloatArray, length_s: float) -> tuple[int, ...]:
    """Samples at which pieces of about one length begin, and the end."""
    count = max(1, round((float(time_s[-1]) - float(time_s[0])) / length_s))
    return tuple(int(edge) for edge in np.linspace(0, time_s.size, count + 1).round())


def _integrated(measured: Motion, modeled: Motion, axes: Sequence[str], length_s: float) -> FloatArray:
    """Rates of a stretch from modeled accelerations, each piece about its measured mean."""
    record = measured.flight.record
    rates = _measured_rates(measured, axes)
    step_s = 1.0 / record.sample_rate_hz
    edges = _edges(record.time_s[measured.kept], length_s)
    found = np.zeros(rates.shape)
    for row, axis in enumerate(axes):
        _, acceleration = modeled.rows[f"{axis}_dot"]
        for first, last in pairwise(edges):
            part = acceleration[first:last]
            moved = np.concatenate([[0.0], np.cumsum(0.5 * step_s * (part[1:] + part[:-1]))])
            found[row, first:last] = moved + float(np.mean(rates[row, first:last] - moved))
    return found


def _held(parameters: ParameterSet) -> ParameterSet:
    """All parameters held at their values."""
    values = parameters.values
    return ParameterSet(tuple(replace(one, value=values[one.name], status="fixed", tied=None) for one in parameters))


def _interval(maneuver: Maneuver, time_s: FloatArray) -> Maneuver:
    return replace(maneuver, start_s=float(time_s[0]), stop_s=float(time_s[-1]))


def _starts(pieces: Sequence[Any]) -> tuple[int, ...]:
    """First sample of each piece."""
    return tuple(int(place) for place in np.cumsum([0, *(piece.samples for piece in pieces[:-1])]))


def _scored(names: Sequence[str], measured: FloatArray, simulated: FloatArray) -> dict[str, Scores]:
    """Scores of the outputs that were measured and moved."""
    return {
        name: output_scores(one, other)
        for name, one, other in zip(names, measured, simulated, strict=True)
        if np.isfinite(one).all() and np.ptp(one) > 0.0
    }


def _missing(outputs: Sequence[str], logged: Sequence[str], record: FlightRecord) -> list[Finding]:
    name = record.source.name
    return [
        remark("missing_channel", one, f"{one} is not in {name}, and has no measurement beside it.")
        for one in outputs
        if one not in logged
    ]


def _moved_by(model: IdentifiedModel, values: Mapping[str, float]) -> IdentifiedModel:
    """The model at other values of its parameters."""
    if model.nonlinear is not None:
        free = model.nonlinear.parameters.free
        moved = model.nonlinear.parameters.with_values({name: values[name] for name in free if name in values})
        return replace(model, nonlinear=replace(model.nonlinear, parameters=moved))
    own = model.structure.parameters
    moved = own.with_values({name: values[name] for name in own.free if name in values})
    return replace(model, structure=replace(model.structure, parameters=moved))


def _parameters(model: IdentifiedModel) -> ParameterSet:
    return model.nonlinear.parameters if model.nonlinear is not None else model.structure.parameters


def _drawn_values(model: IdentifiedModel, *, seed: int) -> list[dict[str, float]]:
    """Values of all parameters, drawn from the covariance and inside their bounds."""
    parameters = _parameters(model)
    if model.motors is not None:
        names: tuple[str, ...] = model.bounds.names
        center = np.array([model.parameters[name].value for name in names])
        limits = np.full((2, len(names)), np.inf) * np.array([[-1.0], [1.0]])
        fixed = {name: one.value for name, one in model.parameters.items()}
    else:
        names = tuple(name for name in parameters.free if name in model.bounds.names)
        center = np.array([parameters.values[name] for name in names])
        limits = np.array([[parameters[name].lower, parameters[name].upper] for name in names]).reshape(-1, 2).T
        fixed = parameters.values
    if not names:
        return []
    rng = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(bounds_of(model.bounds, names).covariance)
    # Rounding may leave a variance below zero.
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    drawn = center + rng.standard_normal((_DRAWS, len(names))) @ spread.T
    drawn = np.clip(drawn, limits[0], limits[1])
    return [{**fixed, **dict(zip(names, one.tolist(), strict=True))} for one in drawn]


def _with_band(
    model: IdentifiedModel, simulate: Callable[[Mapping[str, float]], FloatArray], *, seed: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A simulation at the identified values, and its band over vehicles drawn from the covariance."""
    rows = simulate(_parameters(model).values)
    others = []
    for values in _drawn_values(model, seed=seed):
        try:
            one = simulate(values)
        except ModelError:
            continue
        if np.isfinite(one).all():
            others.append(one)
    return (rows, *_band(rows, others))


def _band(rows: FloatArray, others: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Quantiles over draws; the simulation itself where hardly a draw can be simulated."""
    if len(others) < _DRAWS // 2:
        return rows, rows
    low, high = np.percentile(np.stack(others), _BAND, axis=0)
    return np.minimum(low, rows), np.maximum(high, rows)


def one_model(
    models: IdentifiedModel | Sequence[IdentifiedModel],
) -> tuple[IdentifiedModel, tuple[Finding, ...]]:
    """The model that flies: a result, or the flight that several results join to.

    Responses of roll, pitch and climb to their set-points say how the vehicle leans, ``drag.linear`` how it then moves,
    see :func:`rotorid.models.nonlinear.flight_structure`. Errors of different results are independent. Where no
    response of the yaw rate came, a lag of 0.2 s is taken.

    Raises
    ------
    UsageError
        The results do not go together.
    """
    if isinstance(models, IdentifiedModel):
        return models, ()
    if len(models) == 1:
        return models[0], ()
    needed = "responses of phi, theta and velocity_down to their set-points, and drag.linear"
    drags = [one for one in models if one.nonlinear is not None]
    answers = [one for one in models if one.nonlinear is None]
    names = ", ".join(one.name for one in models)
    if len(drags) != 1 or not {"k_Dx", "k_Dy"} <= set(drags[0].parameters):
        raise UsageError(f"{names} came together", needed=needed)
    if not all(family_of(one.structure).answers_setpoints for one in answers):
        raise UsageError(f"{names} came together", needed=needed, remedy="fly other models one by one")
    axes: dict[str, LinearStructure] = {}
    sources: list[tuple[IdentifiedModel, dict[str, str]]] = []
    for one in answers:
        renamed: dict[str, str] = {}
        for source, response in zip(one.structure.inputs, one.structure.outputs, strict=False):
            axis = "psi_dot" if response == "r" else response
            if axis not in FLIGHT_AXES:
                continue
            if axis in axes:
                raise UsageError(f"{names} both say how {response} answers", needed="each response once")
            axes[axis] = connected(one.structure.select(inputs=[source], outputs=[response]))
            renamed |= {name: f"{name}_{axis}" for name in axes[axis].parameters.names}
        sources.append((one, renamed))
    findings = []
    if "psi_dot" not in axes:
        axes["psi_dot"] = _yaw_lag()
        message = f"No result says how the yaw rate answers; a lag of {_YAW_LAG_S:g} s was taken."
        findings.append(remark("assumed_axis", "psi_dot", message))
    if lost := [axis for axis in FLIGHT_AXES if axis not in axes]:
        raise UsageError(f"{names} do not say how {' and '.join(lost)} answers", needed=needed)
    drag = {name: drags[0].parameters[name].value for name in ("k_Dx", "k_Dy")}
    flight = flight_structure(axes, drag_per_s=(drag["k_Dx"], drag["k_Dy"]), name="flight")
    sources.append((drags[0], {name: name for name in drag}))
    return _joined(answers[0], flight, sources), tuple(findings)


def _yaw_lag() -> LinearStructure:
    return structure_from_equations(
        name="yaw",
        inputs=["r_setpoint"],
        states=["r"],
        equations=["T*r' = -r + r_setpoint"],
        outputs=["r"],
        parameters=ParameterSet([Parameter(name="T", value=_YAW_LAG_S, unit="s", status="fixed")]),
    )


def _joined(
    first: IdentifiedModel, flight: NonlinearStructure, sources: Sequence[tuple[IdentifiedModel, Mapping[str, str]]]
) -> IdentifiedModel:
    """A flight with the covariance of the results that it was made of, which are independent."""
    names: list[str] = []
    blocks = []
    for model, renamed in sources:
        own = [name for name in renamed if name in model.bounds.names]
        names += [renamed[name] for name in own]
        blocks.append(bounds_of(model.bounds, own))
    from scipy.linalg import block_diag

    bounds = Bounds(
        names=tuple(names),
        cramer_rao=np.concatenate([one.cramer_rao for one in blocks]),
        insensitivity=np.concatenate([one.insensitivity for one in blocks]),
        covariance=np.asarray(block_diag(*(one.covariance for one in blocks))),
        random=np.asarray(block_diag(*(one.random for one in blocks))),
        inflation=math.exp(float(np.mean([math.log(one.inflation) for one in blocks]))),
    )
    parameters = flight.parameters
    for name in parameters.free:
        if name not in names:
            parameters = parameters.fix(name, parameters[name].value)
    whole = replace(flight, parameters=parameters)
    own_bounds = bounds_of(bounds, parameters.free)
    return replace(
        first,
        structure=linear_of(whole),
        nonlinear=whole,
        parameters=parameter_estimates(parameters, own_bounds),
        bounds=own_bounds,
        fit=replace(first.fit, outputs=whole.outputs),
        pole_estimates=(),
        delays={},
        combinations=(),
        cross_validation=None,
        findings=(),
    )
