"""The public verb `design`: plans for a vehicle, as large as limits allow, and what each of them will tell."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rotorid.data.findings import Finding
from rotorid.data.flight_plan import FlightPlan, Shape
from rotorid.data.immutable import Immutable
from rotorid.design.aircraft_loop import aircraft_loop
from rotorid.design.amplitude import Limits, limit_words
from rotorid.design.choices import FitChoices
from rotorid.design.loop import LoopModel
from rotorid.design.prediction import Prediction, predict
from rotorid.design.shortest import Shortest, shortest
from rotorid.errors import InsufficientDataError, UsageError
from rotorid.io.write_log import format_of, log_rate_hz
from rotorid.models.rate import RATE_AXES
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.design_prior import Prior, expected_values, with_prior
from rotorid.pipeline.planning import STEPS, PlanChoices, Planned, plan_for, plan_with
from rotorid.pipeline.resolve import named_model
from rotorid.pipeline.scope import INERTIAL
from rotorid.simulate.changes import changed, piloted
from rotorid.simulate.multirotor_flight import Aircraft
from rotorid.vehicles.catalog import aircraft as library_aircraft
from rotorid.vehicles.gains import with_gains

_LONGEST_S = 300.0
_SHORTEST_S = 15.0


@dataclass(frozen=True, kw_only=True)
class DesignChoices(Immutable):
    """What is to be designed.

    Parameters
    ----------
    vehicle
        Name in the library.
    kinds
        Shapes, one plan each.
    plan
        What all plans share: axes, band, duration, limits, wind.
    models
        Names of models whose parameters are to be known; by default the rate model of every axis.
    reach
        Parameter to the largest standard deviation wanted, in percent: the shortest duration is looked for.
    changes
        Numbers of the vehicle that are to be otherwise.
    prior
        A previous result, whose values replace those of the vehicle.
    gains
        Parameters of an autopilot, whose gains replace those of the vehicle.
    gains_source
        File that they came from.
    fit
        How the flight will be identified.
    """

    vehicle: str
    kinds: tuple[Shape, ...]
    plan: PlanChoices = field(default_factory=PlanChoices)
    models: tuple[str, ...] = ()
    reach: Mapping[str, float] = field(default_factory=dict)
    changes: Mapping[str, float] = field(default_factory=dict)
    prior: Prior | None = None
    gains: Mapping[str, float] = field(default_factory=dict)
    gains_source: str = ""
    fit: FitChoices = field(default_factory=FitChoices)

    def __post_init__(self) -> None:
        if not self.kinds or len(set(self.kinds)) < len(self.kinds):
            raise UsageError(f"the kinds {', '.join(self.kinds) or '(none)'} came", needed="at least one, each once")
        self._set(
            kinds=tuple(self.kinds), models=tuple(self.models), reach=self.reach, changes=self.changes, gains=self.gains
        )

    @property
    def aircraft(self) -> Aircraft:
        """What will fly."""
        craft = changed(library_aircraft(self.vehicle), self.changes)
        if self.gains_source:
            craft = with_gains(craft, self.gains, source=self.gains_source)
        return piloted(craft)

    @property
    def model_names(self) -> tuple[str, ...]:
        """The models in force."""
        if self.models:
            return self.models
        if self.prior is not None:
            return (self.prior.structure.name,)
        return tuple(
            name for name in RATE_AXES if named_model(name).inputs[0].removesuffix("_command") in self.plan.axes
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Told(Immutable):
    """What a plan will tell for a model, or why it could not support it."""

    model: str
    prediction: Prediction | None
    refused: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Designed(Immutable):
    """A plan and what it will tell.

    Parameters
    ----------
    kind
        Its shape.
    planned
        What to fly, with amplitudes and what it reaches.
    told
        One for each model.
    shortest
        By model, where an accuracy was asked for.
    wanted
        By model, what was asked for: parameter to percent.
    """

    kind: Shape
    planned: Planned
    told: tuple[Told, ...]
    shortest: Mapping[str, Shortest]
    wanted: Mapping[str, Mapping[str, float]]

    @property
    def percent(self) -> dict[str, float]:
        """Standard deviations in percent by model and parameter, ``rate.roll L_roll``, of all that will be shown."""
        return {
            f"{told.model} {one.name}": one.percent
            for told in self.told
            for one in (told.prediction.parameters if told.prediction is not None else ())
        }


def design(choices: DesignChoices, *, progress: Callable[[str], None] = lambda _: None) -> tuple[Designed, ...]:
    """Plans of all kinds, each with what it will tell.

    Amplitudes are searched for in the nonlinear simulator; what the flight will tell follows from the linear loop about
    hover, with the noise of the sensors and the turbulence of the wind, and takes no further flight.

    Parameters
    ----------
    choices
        What is to be designed.
    progress
        Is told what is being done.

    Raises
    ------
    UsageError
        A wanted parameter is in none of the models, or the limits leave no room for a test input.
    ModelError
        There is no such vehicle or model.
    """
    craft = choices.aircraft
    rate_hz = craft.autopilot.rate_hz
    logged_hz = log_rate_hz(format_of(craft.autopilot.kind), rate_hz)
    loop = aircraft_loop(craft, wind=choices.plan.wind, log_rate_hz=logged_hz)
    if choices.prior is not None:
        loop = with_prior(loop, choices.prior)
    models = [_model(choices, name) for name in choices.model_names]
    _require_wanted(choices, models)
    return tuple(_designed(choices, craft, loop, models, kind, progress) for kind in choices.kinds)


def beyond_limits(one: Designed, limits: Limits) -> list[Finding]:
    """The remark that a plan passes limits, as one with amplitudes given by hand may."""
    passed = one.planned.reached.beyond(limits)
    if not passed:
        return []
    reached = {name: float(getattr(one.planned.reached, name)) for name in passed}
    words = ", ".join(f"{limit_words([name])} {value:.3g}" for name, value in reached.items())
    message = (
        f"The plan passes its limits in simulation: {words} (SI units). Predictions hold for a loop that is linear, "
        "and motors at their limits are not. Fly less, or raise the limits on purpose with --limit."
    )
    return [Finding(kind="beyond_limits", severity="warning", where=one.kind, message=message, numbers=reached)]


def best_of(designed: Sequence[Designed]) -> dict[str, str]:
    """The kind that tells most about each parameter, where there are several."""
    if len(designed) < 2:
        return {}
    names = dict.fromkeys(name for one in designed for name in one.percent)
    return {name: min(designed, key=lambda one: one.percent.get(name, np.inf)).kind for name in names}


def _designed(
    choices: DesignChoices,
    craft: Aircraft,
    loop: LoopModel,
    models: Sequence[LinearStructure],
    kind: Shape,
    progress: Callable[[str], None],
) -> Designed:
    planned = plan_for(craft, replace(choices.plan, shape=kind), progress=progress)
    excited = tested(planned.plan, kind)
    told = []
    for model in models:
        progress(f"what the {kind.replace('_', ' ')} will tell about {model.name}")
        told.append(_told(choices, craft, loop, model, excited))
    return Designed(
        kind=kind,
        planned=planned,
        told=tuple(told),
        shortest=_shortest(choices, craft, loop, models, kind, planned, progress),
        wanted={model.name: _wanted(choices, model) for model in models},
    )


def tested(plan: FlightPlan, kind: Shape) -> FlightPlan:
    """The part of a plan that a model will be fitted to: without the doublets that verify it."""
    if kind in STEPS:
        return plan
    return replace(plan, inputs=tuple(one for one in plan.inputs if one.shape == kind))


def _told(choices: DesignChoices, craft: Aircraft, loop: LoopModel, model: LinearStructure, plan: FlightPlan) -> Told:
    try:
        prediction = predict(
            model, expected_values(model, craft, choices.prior), loop, plan, choices=_fit(choices, model)
        )
    except InsufficientDataError as error:
        return Told(model=model.name, prediction=None, refused=str(error))
    return Told(model=model.name, prediction=prediction)


def _shortest(
    choices: DesignChoices,
    craft: Aircraft,
    loop: LoopModel,
    models: Sequence[LinearStructure],
    kind: Shape,
    planned: Planned,
    progress: Callable[[str], None],
) -> dict[str, Shortest]:
    """Durations by model; amplitudes stay those of the plan, so that only time is asked for."""
    swept = [one for one in planned.plan.inputs if one.shape == kind]
    sizes: dict[str, float] = {one.axis: abs(one.amplitude) for one in swept}

    def lasting(duration_s: float) -> FlightPlan:
        wish = replace(choices.plan, shape=kind, duration_s=duration_s, amplitudes=sizes, doublets=False)
        return plan_with(craft, wish, sizes)

    found: dict[str, Shortest] = {}
    for model in models:
        wanted = _wanted(choices, model)
        if wanted and kind not in STEPS:
            progress(f"the shortest {kind.replace('_', ' ')} for {model.name}")
            found[model.name] = shortest(
                model,
                expected_values(model, craft, choices.prior),
                loop,
                lasting,
                wanted,
                shortest_s=_SHORTEST_S,
                longest_s=_LONGEST_S,
                choices=_fit(choices, model),
            )
    return found


def _fit(choices: DesignChoices, model: LinearStructure) -> FitChoices:
    """How an identification would fit: outputs that sensors measure, unless others were asked for."""
    measured = tuple(name for name in model.outputs if name in INERTIAL)
    return choices.fit if choices.fit.outputs or not measured else replace(choices.fit, outputs=measured)


def _wanted(choices: DesignChoices, model: LinearStructure) -> dict[str, float]:
    return {name: percent for name, percent in choices.reach.items() if name in model.parameters.free}


def _model(choices: DesignChoices, name: str) -> LinearStructure:
    if choices.prior is not None and name == choices.prior.structure.name:
        return choices.prior.structure
    return named_model(name)


def _require_wanted(choices: DesignChoices, models: Sequence[LinearStructure]) -> None:
    free = {name for model in models for name in model.parameters.free}
    if wrong := [name for name in choices.reach if name not in free]:
        raise UsageError(
            f"{wrong[0]} should be reached to {choices.reach[wrong[0]]:g} %",
            needed=f"a free parameter of {', '.join(model.name for model in models)}: {', '.join(sorted(free))}",
        )
