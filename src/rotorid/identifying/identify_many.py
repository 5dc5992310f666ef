"""Several models of the same logs in one run, each accepted or refused separately."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from rotorid.data.base import Immutable
from rotorid.data.findings import refusal
from rotorid.data.record import FlightRecord
from rotorid.errors import FaultError, InsufficientDataError, RotoridError, UsageError, reason_of
from rotorid.flights.instruments import axes_of
from rotorid.flights.supports import supported_models, supports
from rotorid.identifying.families import own_settings
from rotorid.identifying.identification import identify, refused
from rotorid.io.pool import pool
from rotorid.io.records import as_records
from rotorid.models.derived import useful_known
from rotorid.models.parameter import no_such
from rotorid.models.structure import LinearStructure
from rotorid.results.model import IdentifiedModel, Records, Refused
from rotorid.results.provenance import Provenance, provenance
from rotorid.settings.identifying import IdentifySettings
from rotorid.settings.models import ALL, asks_all
from rotorid.settings.option import as_settings
from rotorid.settings.resolve import asked_model

if TYPE_CHECKING:
    from rotorid.settings.option_types import IdentifyOptions

_PROGRESS = logging.getLogger("rotorid.progress")


@dataclass(frozen=True, kw_only=True, eq=False)
class SeveralModels(Immutable, Mapping[str, "IdentifiedModel | Refused"]):
    """The result of each model, by its name.

    Parameters
    ----------
    answers
        Identified models, and what to say of those that the data cannot support.
    """

    answers: Mapping[str, IdentifiedModel | Refused]
    provenance: Provenance

    def __post_init__(self) -> None:
        self._set(answers=self.answers)

    def __getitem__(self, name: str) -> IdentifiedModel | Refused:
        return self.answers[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.answers)

    def __len__(self) -> int:
        return len(self.answers)

    @property
    def identified(self) -> dict[str, IdentifiedModel]:
        """The identified models."""
        return {name: answer for name, answer in self.answers.items() if isinstance(answer, IdentifiedModel)}

    @property
    def refused(self) -> dict[str, Refused]:
        """Those that the data cannot support."""
        return {name: answer for name, answer in self.answers.items() if isinstance(answer, Refused)}


def none_identified(models: SeveralModels, records: Sequence[FlightRecord]) -> InsufficientDataError:
    """The error that the data support none of the models."""
    findings = [
        finding for answer in models.refused.values() for finding in answer.findings if finding.severity == "error"
    ]
    if not models:
        found = [(record.source.name, supports(record)) for record in records]
        # A requirement that several models lack is listed once.
        why = {(log, support.because): (support.lacks, model) for log, each in found for model, support in each.items()}
        findings = [refusal(kind, model, f"{log}: {because}.") for (log, because), (kind, model) in why.items()]
    logs = " and ".join(record.source.name for record in records)
    return InsufficientDataError(
        f"not enough data for {' or '.join(models)}" if models else f"not enough data in {logs} for any model",
        needed="flights that move these axes, logged fast enough",
        remedy="see the findings for what each lacks",
        findings=findings,
    )


def identify_several(
    records: Records,
    models: Sequence[str | Path | LinearStructure] | str = ALL,
    *,
    settings: IdentifySettings | None = None,
    verify: Records = (),
    **options: Unpack[IdentifyOptions],
) -> SeveralModels:
    """Identify several models, see :func:`rotorid.identify`; one that the data cannot support ends no other.

    Options that a model does not have are left out for it.

    Parameters
    ----------
    records, settings, verify
        As for :func:`rotorid.identify`.
    models
        Names, files or structures; ``all`` for those that the logs may support (:func:`supported_models`).
    **options
        Fields of :class:`rotorid.settings.identifying.IdentifySettings`, which go before ``settings``.

    Returns
    -------
    SeveralModels
        By name an identified model, or what to say of data that cannot support it.

    Raises
    ------
    UsageError
        An option is wrong, or is one of no model that was asked for.
    RotoridError
        Each of the models that were named fails by more than a lack of data; the error is that of the first.

    Examples
    --------
    >>> answers = identify_several("flight.ulg", ["rate.roll", "rate.pitch"])  # doctest: +SKIP
    """
    chosen = as_settings(IdentifySettings, settings, options)
    logs, unseen = as_records(records), as_records(verify, optional=True)
    wanted = supported_models(logs, chosen) if asks_all(models) else _each(models)
    require_known_by_any(wanted, chosen)
    answers: dict[str, IdentifiedModel | Refused] = {}
    wrong: list[RotoridError] = []
    # Runs of one model have the workers for themselves.
    single = chosen.add_noise_percent is None and chosen.runs is None and chosen.bootstrap is None
    with pool(chosen.workers if single and len(wanted) > 1 else None) as workers:
        each = workers.shared(_EachModel(logs, unseen, replace(chosen, workers=None) if single else chosen))
        found = (map if workers.executor is None else workers.executor.map)(each, wanted)
        for number, model in enumerate(wanted):
            name = _name(model)
            _PROGRESS.info(f"identifying {name}", extra={"done": number, "total": len(wanted)})
            answers[name], error = next(found)
            wrong += [] if error is None else [error]
    if wrong and len(wrong) == len(answers) and not asks_all(models):
        raise wrong[0]
    return SeveralModels(answers=answers, provenance=provenance((*logs, *unseen), chosen))


@dataclass(frozen=True)
class _EachModel:
    """The identification of one of the models: its answer, and the error that is more than a lack of data."""

    logs: tuple[FlightRecord, ...]
    unseen: tuple[FlightRecord, ...]
    settings: IdentifySettings

    def __call__(self, model: str | Path | LinearStructure) -> tuple[IdentifiedModel | Refused, RotoridError | None]:
        own = _settings_of(model, self.settings)
        try:
            return identify(self.logs, model, settings=own, verify=self.unseen), None
        except InsufficientDataError as error:
            return refused(error, self.logs, model, settings=own), None
        except Exception as error:
            # What one model makes of a log, such as rotors that do not fit it, ends no other.
            name = _name(model)
            wrong = reason_of(error, name)
            return refused(_as_refusal(wrong, name), self.logs, model, settings=own), wrong


def _name(model: str | Path | LinearStructure) -> str:
    return model.name if isinstance(model, LinearStructure) else str(model)


def _as_refusal(error: RotoridError, model: str) -> InsufficientDataError:
    """The error of a model as what the data do not support."""
    kind = "internal_error" if isinstance(error, FaultError) else "not_identifiable"
    why = refusal(kind, model, error.reason)
    return InsufficientDataError(error.came, needed=error.needed, remedy=error.remedy, findings=[why])


def _settings_of(model: str | Path | LinearStructure, settings: IdentifySettings) -> IdentifySettings:
    """The choices that a model has."""
    own = own_settings(model if isinstance(model, LinearStructure) else str(model), settings)
    asked = asked_model(model)
    return own if isinstance(asked, str) else own_choices(asked, own)


def own_choices(structure: LinearStructure, settings: IdentifySettings) -> IdentifySettings:
    """The choices without parameters, constants, responses and segments that a model does not have."""
    axes = axes_of(structure.inputs, structure.outputs)
    kept: dict[str, Any] = {
        name: {key: value for key, value in getattr(settings, name).items() if key in known}
        for name, known in _known(structure).items()
    }
    return replace(
        settings, segments=tuple(maneuver for maneuver in settings.segments if maneuver.axis in axes), **kept
    )


def _known(structure: LinearStructure) -> dict[str, frozenset[str]]:
    """Names that a structure knows, by the choice that takes them."""
    parameters = frozenset(structure.parameters.names)
    responses = frozenset(f"{output}/{source}" for output in structure.outputs for source in structure.inputs)
    return {
        "fix": parameters,
        "known": useful_known(parameters),
        "ties": parameters,
        "constants": frozenset(structure.constants),
        "pairs": responses,
        "pair_weights": responses,
        "input_windows_s": frozenset(structure.inputs),
    }


_KINDS = {
    "fix": "parameter",
    "known": "known quantity",
    "ties": "parameter",
    "constants": "constant",
    "pairs": "response",
    "pair_weights": "response",
    "input_windows_s": "input",
}


def require_known_by_any(models: Sequence[str | Path | LinearStructure], settings: IdentifySettings) -> None:
    """Refuse a name that none of the models has.

    Raises
    ------
    ModelError
        The nearest name is suggested.
    """
    structures = [asked for model in models if not isinstance(asked := asked_model(model), str)]
    if len(structures) < len(models):
        # What the others take is known when their logs are read.
        return
    known = [_known(structure) for structure in structures]
    for choice, kind in _KINDS.items():
        names = frozenset[str]().union(*(channels[choice] for channels in known))
        for name in getattr(settings, choice):
            if name not in names:
                raise no_such(kind, name, sorted(names))


def _each(models: Sequence[str | Path | LinearStructure] | str) -> tuple[str | Path | LinearStructure, ...]:
    """The models in their order, each once."""
    listed = (models,) if isinstance(models, str) else tuple(models)
    if not listed:
        raise UsageError("no model was given", needed="a name of rotorid models, a file, or all")
    return tuple(dict.fromkeys(listed))
