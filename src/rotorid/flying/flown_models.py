"""Fly an identified model: through the inputs of a log, to compare with what was measured, or through a plan.

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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias, Unpack

import numpy as np

from rotorid.checking.candidate import candidate_model
from rotorid.checking.predictions import Simulation, between, not_moved
from rotorid.checking.predictors import predictor_of
from rotorid.checking.scores import common_band, score_flights
from rotorid.data.base import Immutable, read_only
from rotorid.data.findings import Finding, refusal, remark, warn, worst_first
from rotorid.data.flight_plan import FlightPlan
from rotorid.data.quantity import minus
from rotorid.data.record import STANDARD_UNITS, FlightRecord, Maneuver
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.flights.flights import Flight
from rotorid.flights.selection import require_inside, require_reached
from rotorid.flying.model_from_results import joined_halves
from rotorid.flying.model_logs import ModelFlight, ModelLog, flies_under_control, fly_under_control, model_logs
from rotorid.io.records import as_records
from rotorid.models.equations import structure_from_equations
from rotorid.models.families import family_of
from rotorid.models.nonlinear import AXES as FLIGHT_AXES
from rotorid.models.nonlinear import NonlinearStructure, flight_structure, linear_of
from rotorid.models.parameter import Parameter, ParameterSet
from rotorid.models.structure import LinearStructure, connected
from rotorid.planning.responses import SETPOINTS, setpoint_of
from rotorid.results.model import IdentifiedModel, Records, Refused, bounds_of, parameter_estimates
from rotorid.results.provenance import Provenance, provenance
from rotorid.settings.flying import FlySettings
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.option import as_settings
from rotorid.typing import FloatArray
from rotorid.uncertainty.cramer_rao import Bounds, colored_of
from rotorid.verification.scores import GUIDELINES, guidelines_met
from rotorid.verification.verification import Scores

if TYPE_CHECKING:
    from rotorid.settings.option_types import FlyOptions

_PROGRESS = logging.getLogger("rotorid.progress")

_DRAWS = 60
_BAND = (2.5, 97.5)

_PLAN_RATE_HZ = 100.0

_YAW_LAG_S = 0.2
"""Lag of the yaw rate where no result says how it answers."""

Flown: TypeAlias = str | IdentifiedModel


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
    """Simulated flights of an identified model through logs or a plan.

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
    logs
        With noise, of a plan.
    """

    model: IdentifiedModel
    stretches: tuple[FlownStretch, ...]
    findings: tuple[Finding, ...]
    provenance: Provenance
    logs: tuple[ModelLog, ...] = ()


def fly_log(
    models: IdentifiedModel | Sequence[IdentifiedModel],
    records: Records,
    *,
    settings: FlySettings | None = None,
    **options: Unpack[FlyOptions],
) -> FlownModel:
    """Simulate an identified model through whole flights of logs, to compare with what was measured.

    Parameters
    ----------
    models
        A result; or results of responses to set-points and of ``drag.linear``, which are joined into a flight.
    records
        Logs as :func:`rotorid.read` gives them, or their files.
    settings
        Choices; everything has a default.
    **options
        Fields of :class:`rotorid.settings.FlySettings`, which go before ``settings``.

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
    predictor = predictor_of(candidate_model(model))
    values, draws = predictor.parameters.values, drawn_values(model, predictor.parameters, seed=settings.seed)
    stretches: list[FlownStretch] = []
    findings = [*(finding for record in logs for finding in record.findings), *joined]
    flights: list[Flight] = []
    require_inside(logs, settings.segments)
    for record in logs:
        name = record.source.name
        _PROGRESS.info(f"flying {model.name} through {name}")
        try:
            require_reached(record, settings.segments)
            simulations, stretch_findings = predictor.simulations(record, settings)
        except InsufficientDataError as error:
            findings += [*error.findings, warn("not_verified", name, f"{name} was not flown: {error}")]
            continue
        found = [_stretch(stretch, values, draws) for stretch in simulations]
        stretches += found
        findings += [*stretch_findings, *_unmoved(name, simulations, found), *_drifting(model, record, found, settings)]
        flights += [Flight(record, stretch.maneuver) for stretch in found]
    if not stretches:
        causes = "; ".join(finding.message.rstrip(".") for finding in findings if finding.kind == "not_verified")
        raise InsufficientDataError(
            causes or "no log was given",
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


def _unmoved(record: str, simulations: Sequence[Simulation], flown: Sequence[FlownStretch]) -> list[Finding]:
    """A note on measured outputs of a log without a score."""
    measured = {
        name: None
        for simulation in simulations
        for name, row in zip(simulation.output_names, simulation.measured, strict=True)
        if simulation.moved is not None and np.isfinite(row).all()
    }
    still = [name for name in measured if all(name not in stretch.scores for stretch in flown)]
    return [not_moved(record, still)] if still else []


def _drifting(
    model: IdentifiedModel, record: FlightRecord, flown: Sequence[FlownStretch], settings: FlySettings
) -> list[Finding]:
    """A warning for each stretch with outputs that drift off, although the model predicts them in its own band.

    Integrators sum up what is below that band: errors of trim, and what noise and gusts leave.
    """
    band_rad_s = common_band([model])
    found = []
    for stretch in flown:
        far = [name for name, scores in stretch.scores.items() if scores.nrmse_fit_percent < 0.0]
        if band_rad_s is None or not far or len(stretch.starts) > 1:
            continue
        flight, choices = Flight(record, stretch.maneuver), IdentifySettings(hold=settings.hold)
        try:
            (inside,) = score_flights(model.structure, [flight], choices, np.inf, band_rad_s)
        except (InsufficientDataError, ValueError):
            continue
        for name in far:
            score = inside.scores.get(name)
            if score is None or guidelines_met(score.tic, score.nrmse_fit_percent) < GUIDELINES:
                continue
            fit = stretch.scores[name].nrmse_fit_percent
            message = (
                f"{name} drifts off in {stretch.record}: the fit is {minus(f'{fit:.0f}')} % over the whole stretch and "
                f"{score.nrmse_fit_percent:.0f} % within the fitted band ({band_rad_s[0]:.2g} to "
                f"{band_rad_s[1]:.3g} rad/s). The model is not to blame: errors below this band grow with time. "
                "Restart the simulation with --pieces SECONDS."
            )
            numbers = {"fit_percent": fit, "fit_in_band_percent": score.nrmse_fit_percent}
            found.append(warn("open_loop_diverges", f"{stretch.record}: {name}", message, **numbers))
    return found


def refused_flight(
    error: InsufficientDataError, records: Sequence[FlightRecord], name: str, settings: FlySettings
) -> Refused:
    """The refusal of logs that a model cannot fly through."""
    remarks = [finding for record in records for finding in record.findings]
    return Refused(
        name=name,
        structure=None,
        findings=worst_first(error.findings or [*remarks, refusal("not_verified", name, str(error))]),
        provenance=provenance(records, settings),
    )


def fly_plan(
    models: IdentifiedModel | Sequence[IdentifiedModel],
    plan: FlightPlan,
    *,
    settings: FlySettings | None = None,
    runs: int = 1,
) -> FlownModel:
    """Simulate an identified model through the test inputs of a plan, from rest, and make logs of it with noise.

    Parameters
    ----------
    models
        As for :func:`fly_log`, with set-points as inputs; or a linear model of the airframe by commands, which a
        controller keeps in the air, see :mod:`rotorid.flying.model_logs`. Both halves of a hover model fly together.
    plan
        What is asked of it.
    settings
        Choices; everything has a default.
    runs
        How many logs, each with its own noise.

    Raises
    ------
    UsageError
        The plan moves no input of the model, or the model needs a log.
    """
    settings = settings or FlySettings()
    whole = None if isinstance(models, IdentifiedModel) else joined_halves(models)
    model, joined = (whole, whole.findings) if whole is not None else one_model(models)
    if flies_under_control(model):
        flight = fly_under_control(model, plan)
        stretch = _held(flight, plan)
    elif flies_plans(model):
        flight, stretch = _by_setpoints(model, plan, settings)
    else:
        raise UsageError(
            f"{model.name} cannot fly a plan: its inputs are {', '.join(model.structure.inputs)}",
            needed="a model by commands or set-points, such as hover.*, axis.*, rate.*, response.* or flight.*",
            remedy="simulate it as a vehicle with --like NAME",
        )
    logs = model_logs(model, flight, seed=settings.seed, runs=runs)
    lost = [
        remark("unused_choice", what, f"The plan moves {what}, which the model does not have.") for what in flight.left
    ]
    return FlownModel(
        model=model,
        stretches=(stretch,),
        findings=worst_first([*joined, *lost, *_assumed(logs[0])]),
        provenance=provenance((), settings),
        logs=logs,
    )


def _assumed(log: ModelLog) -> list[Finding]:
    """The remark on noise that no result knows."""
    if not log.assumed:
        return []
    sizes = ", ".join(f"{name} {log.noise[name]:g} {STANDARD_UNITS[name]}" for name in log.assumed)
    message = f"The result does not know the noise of its flight. That of usual sensors was assumed: {sizes}."
    return [remark("assumed_noise", "noise", message)]


def _held(flight: ModelFlight, plan: FlightPlan) -> FlownStretch:
    """A flight under a controller, whose band is not known, as a stretch."""
    rows = np.stack(list(flight.outputs.values()))
    return FlownStretch(
        record=plan.name,
        maneuver=_whole(plan, flight.time_s),
        time_s=flight.time_s,
        inputs=np.stack(list(flight.inputs.values())),
        measured=np.full(rows.shape, np.nan),
        simulated=rows,
        lower=rows,
        upper=rows,
        input_names=tuple(flight.inputs),
        output_names=tuple(flight.outputs),
    )


def _whole(plan: FlightPlan, time_s: FloatArray) -> Maneuver:
    return Maneuver(axis=plan.axes[0], kind="other", start_s=0.0, stop_s=float(time_s[-1]), origin="given")


def _by_setpoints(model: IdentifiedModel, plan: FlightPlan, settings: FlySettings) -> tuple[ModelFlight, FlownStretch]:
    """A model of set-points through a plan."""
    count = round(plan.duration_s * _PLAN_RATE_HZ) + 1
    time_s = np.arange(count) / _PLAN_RATE_HZ
    inputs = np.zeros((len(model.structure.inputs), count))
    left = set()
    for planned in plan.inputs:
        name = setpoint_of(planned.axis, planned.entry)
        if name is None or name not in model.structure.inputs:
            left.add(f"{planned.axis} by {planned.entry.replace('_', ' ')}")
            continue
        inputs[model.structure.inputs.index(name)] += SETPOINTS[name].sign * planned.at(time_s)
    if not inputs.any():
        raise UsageError(
            f"the plan moves {', '.join(sorted(left))}, which {model.name} does not have",
            needed=f"a plan that moves {' or '.join(model.structure.inputs)}",
        )
    outputs = model.nonlinear.outputs if model.nonlinear is not None else model.structure.outputs
    simulation = Simulation(
        record=plan.name,
        maneuver=_whole(plan, time_s),
        time_s=time_s,
        inputs=inputs,
        measured=np.full((len(outputs), count), np.nan),
        input_names=model.structure.inputs,
        output_names=outputs,
        outputs_at=lambda values: with_values(model, values).simulate(
            inputs, sample_rate_hz=_PLAN_RATE_HZ, hold="zero"
        ),
        held=True,
    )
    parameters = predictor_of(candidate_model(model)).parameters
    stretch = _stretch(simulation, parameters.values, drawn_values(model, parameters, seed=settings.seed))
    flight = ModelFlight(
        time_s=time_s,
        inputs=dict(zip(stretch.input_names, stretch.inputs, strict=True)),
        outputs=dict(zip(stretch.output_names, stretch.simulated, strict=True)),
        left=tuple(sorted(left)),
    )
    return flight, stretch


def flies_plans(model: IdentifiedModel) -> bool:
    """Whether a model can fly a plan by itself: its inputs are set-points, so that its own loops are in it."""
    return set(model.structure.inputs) <= set(SETPOINTS)


def _stretch(simulation: Simulation, values: Mapping[str, float], draws: Sequence[Mapping[str, float]]) -> FlownStretch:
    """A simulation at the identified values, with its band over vehicles drawn from the covariance."""
    measured = simulation.measured
    rows = simulation.outputs_at(values)
    lower, upper = band_of(rows, list(_others(simulation, draws)))
    return FlownStretch(
        record=simulation.record,
        maneuver=between(simulation.maneuver, simulation.time_s),
        time_s=simulation.time_s,
        inputs=simulation.inputs,
        measured=measured,
        simulated=rows,
        lower=lower,
        upper=upper,
        input_names=simulation.input_names,
        output_names=simulation.output_names,
        starts=simulation.starts,
        scores={
            name: scores
            for name, row, other in zip(simulation.output_names, measured, rows, strict=True)
            if np.isfinite(row).all()
            and np.ptp(row) > 0.0
            and simulation.judges(name, (scores := Scores.plain(row, other)).nrmse_fit_percent)
        },
        held=simulation.held,
    )


def _others(simulation: Simulation, draws: Sequence[Mapping[str, float]]) -> Iterator[FloatArray]:
    """Outputs of other likely vehicles, of those that can be simulated."""
    for values in draws:
        try:
            rows = simulation.outputs_at(values)
        except ModelError:
            continue
        if np.isfinite(rows).all():
            yield rows


def with_values(model: IdentifiedModel, values: Mapping[str, float]) -> IdentifiedModel:
    """The model at other values of its parameters."""
    if model.nonlinear is not None:
        free = model.nonlinear.parameters.free
        moved = model.nonlinear.parameters.with_values({name: values[name] for name in free if name in values})
        return replace(model, nonlinear=replace(model.nonlinear, parameters=moved))
    own = model.structure.parameters
    moved = own.with_values({name: values[name] for name in own.free if name in values})
    return replace(model, structure=replace(model.structure, parameters=moved))


def drawn_values(model: IdentifiedModel, parameters: ParameterSet, *, seed: int) -> list[dict[str, float]]:
    """Values of all parameters, drawn from the covariance and inside their bounds."""
    values = parameters.values
    names = tuple(name for name in parameters.names if name in model.bounds.names)
    if not names:
        return []
    center = np.array([values[name] for name in names])
    limits = np.array([[parameters[name].lower, parameters[name].upper] for name in names]).T
    rng = np.random.default_rng(seed)
    variances, vectors = np.linalg.eigh(bounds_of(model.bounds, names).covariance)
    # Rounding may leave a variance below zero.
    spread = vectors * np.sqrt(np.maximum(variances, 0.0))
    drawn = center + rng.standard_normal((_DRAWS, len(names))) @ spread.T
    drawn = np.clip(drawn, limits[0], limits[1])
    return [{**values, **dict(zip(names, draw.tolist(), strict=True))} for draw in drawn]


def band_of(rows: FloatArray, others: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Quantiles over draws; the simulation itself where too few draws can be simulated."""
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
    drags = [model for model in models if model.nonlinear is not None]
    answers = [model for model in models if model.nonlinear is None]
    names = ", ".join(model.name for model in models)
    if len(drags) != 1 or not {"k_Dx", "k_Dy"} <= set(drags[0].parameters):
        raise UsageError(f"{names} cannot be flown together", needed=needed)
    if not all(family_of(model.structure).answers_setpoints for model in answers):
        raise UsageError(f"{names} cannot be flown together", needed=needed, remedy="fly other models one by one")
    axes: dict[str, LinearStructure] = {}
    sources: list[tuple[IdentifiedModel, dict[str, str]]] = []
    for model in answers:
        renamed: dict[str, str] = {}
        for source, response in zip(model.structure.inputs, model.structure.outputs, strict=False):
            axis = "psi_dot" if response == "r" else response
            if axis not in FLIGHT_AXES:
                continue
            if axis in axes:
                raise UsageError(f"{names}: more than one model of {response}", needed="one model of each response")
            axes[axis] = connected(model.structure.select(inputs=[source], outputs=[response]))
            renamed |= {name: f"{name}_{axis}" for name in axes[axis].parameters.names}
        sources.append((model, renamed))
    findings = []
    if "psi_dot" not in axes:
        axes["psi_dot"] = _yaw_lag()
        message = f"No result has a model of the yaw rate, so a lag of {_YAW_LAG_S:g} s was assumed."
        findings.append(remark("assumed_axis", "psi_dot", message))
    if lost := [axis for axis in FLIGHT_AXES if axis not in axes]:
        raise UsageError(f"{names}: no model of {' and '.join(lost)}", needed=needed)
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
        cramer_rao=np.concatenate([bounds.cramer_rao for bounds in blocks]),
        insensitivity=np.concatenate([bounds.insensitivity for bounds in blocks]),
        covariance=np.asarray(block_diag(*(bounds.covariance for bounds in blocks))),
        random=np.asarray(block_diag(*(bounds.random for bounds in blocks))),
        colored=colored_of(blocks),
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
