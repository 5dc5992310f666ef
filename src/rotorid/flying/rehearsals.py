"""Rehearsals of a plan: a flight in the simulator, whose log is read and measured as that of a real flight.

What an identification states as model error depends on the flight: how far it leaned, how its mean thrust changed, how
well its sensors agree, how late its log stamps them. A rehearsal asks the functions of the identification itself.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rotorid.data.base import Immutable
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.flight_plan import FlightPlan, Shape
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError, ModelError, UsageError
from rotorid.flying.settings import DesignSettings, SimulateSettings
from rotorid.flying.simulation import fly_run, write_run
from rotorid.identifying.families import method_of
from rotorid.io.registry import read
from rotorid.models.structure import LinearStructure
from rotorid.planning.responses import answers_setpoints
from rotorid.planning.systematic import KnownErrors
from rotorid.settings.identifying import IdentifySettings
from rotorid.uncertainty.cramer_rao import Bounds

_FLIGHTS = 3
"""Rehearsals of a plan: gusts and noise differ, and what they do to lean and thrust."""


def rehearsed(choices: DesignSettings, plan: FlightPlan) -> tuple[FlightRecord, ...]:
    """Logs of a plan that was flown in the simulator, without flights that were lost.

    Parameters
    ----------
    choices
        What is designed.
    plan
        All test inputs, before an autopilot shapes them.
    """
    flies = replace(choices.entry, make=lambda: choices.craft)
    simulated = SimulateSettings(
        vehicle=flies, plan=plan, wind=choices.plan.wind, seed=choices.plan.seed, runs=_FLIGHTS
    )
    logs = []
    for number in range(_FLIGHTS):
        try:
            run = fly_run(simulated, number)
        except (ModelError, UsageError):
            continue
        with tempfile.TemporaryDirectory() as folder:
            log = Path(folder) / f"simulated_{simulated.file_names[number]}"
            write_run(log, run, simulated)
            logs.append(read(log))
    return tuple(logs)


@dataclass(frozen=True, kw_only=True, eq=False)
class Rehearsal(Immutable):
    """What an identification of a rehearsal states.

    Parameters
    ----------
    errors
        Of responses: the problems that it poses, and sizes of the model error in earlier results.
    bounds
        Of a model that is fitted to records in time, whose residuals alone show its model error.
    least_std
        Of that model: standard deviations of model error in an earlier result.
    refused
        Why an identification of a rehearsal answers nothing, where that is so of all.
    refusals
        Reasons of all rehearsals of which an identification answers nothing.
    """

    errors: KnownErrors = field(default_factory=KnownErrors)
    bounds: tuple[Bounds, ...] = ()
    least_std: Mapping[str, float] = field(default_factory=dict)
    refused: InsufficientDataError | None = None
    refusals: tuple[InsufficientDataError, ...] = ()

    def __post_init__(self) -> None:
        self._set(bounds=tuple(self.bounds), least_std=self.least_std, refusals=tuple(self.refusals))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Outputs that an identification fits to the responses of a rehearsal; empty where there is none."""
        return self.errors.rehearsals[0].data.outputs if self.errors.rehearsals else ()

    @classmethod
    def of(cls, choices: DesignSettings, model: LinearStructure, records: Sequence[FlightRecord]) -> Rehearsal:
        """The rehearsals of a plan for a model.

        Parameters
        ----------
        records
            Of :func:`rehearsed`.
        """
        prepared: list[Any] = []
        refusals = []
        for record in records:
            method = method_of(model, [record], _identify_settings(choices))
            try:
                data = method.prepare([record])
                prepared.append(method.fit(data).bounds if answers_setpoints(model) else data.screened.problem)
            except InsufficientDataError as error:
                refusals.append(error)
        if refusals and not prepared:
            return cls(refused=refusals[-1], refusals=tuple(refusals))
        if answers_setpoints(model):
            earlier = choices.earlier
            same = earlier is not None and earlier.structure.name == model.name
            least = earlier.std_model if earlier is not None and same else {}
            return cls(bounds=tuple(prepared), least_std=least, refusals=tuple(refusals))
        errors = KnownErrors(rehearsals=tuple(prepared), sizes=_earlier_sizes(choices, model))
        return cls(errors=errors, refusals=tuple(refusals))


def failed_rehearsals(kind: Shape, flown: int, rehearsals: Mapping[str, Rehearsal]) -> list[Finding]:
    """Findings on rehearsals of a plan that say nothing of its model error.

    Parameters
    ----------
    kind
        Shape of the plan.
    flown
        How many flights were not lost.
    rehearsals
        By model; where an identification refuses all of them, its prediction says why.
    """
    found = []
    if flown == 0:
        message = (
            f"All {_FLIGHTS} rehearsals in the simulator were lost. Predicted model errors are those of clocks and the "
            "least one alone; the flight may state larger ones. Lower the amplitude, or plan for less wind."
        )
        found.append(warn("rehearsal_failed", kind, message, failed=_FLIGHTS, flights=_FLIGHTS))
    elif flown < _FLIGHTS:
        message = (
            f"{_FLIGHTS - flown} of {_FLIGHTS} rehearsals in the simulator lost the vehicle; the others gave the model "
            "errors. Lower the amplitude, or plan for less wind."
        )
        found.append(warn("rehearsal_failed", kind, message, failed=_FLIGHTS - flown, flights=_FLIGHTS))
    for model, rehearsal in rehearsals.items():
        refused = len(rehearsal.refusals)
        if refused and rehearsal.refused is None:
            message = (
                f"{refused} of {flown} rehearsals of the {kind.replace('_', ' ')} do not support {model}, so the "
                f"flight may not either: {rehearsal.refusals[-1]} Fly the plan twice, or longer."
            )
            found.append(remark("rehearsal_failed", model, message, failed=refused, flights=flown))
    return found


def _earlier_sizes(choices: DesignSettings, model: LinearStructure) -> dict[str, float]:
    """Relative model errors of responses that earlier results of the vehicle state, the largest of each."""
    found: dict[str, float] = dict(choices.prior.model_error) if choices.prior is not None else {}
    for result in choices.own.joined.models if choices.own is not None else ():
        if result.structure.name == model.name:
            for name, size in result.fit.end.model_error.items():
                found[name] = max(size, found.get(name, 0.0))
    return found


def _identify_settings(choices: DesignSettings) -> IdentifySettings:
    """How the flight will be identified."""
    fit = choices.fit
    return IdentifySettings(
        band_rad_s=fit.band_rad_s,
        windows_s=fit.windows_s,
        coherence=fit.coherence,
        estimate=fit.estimate,
        weights=fit.weights,
        outputs=fit.outputs,
    )
