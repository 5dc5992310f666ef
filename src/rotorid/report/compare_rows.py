"""A comparison as rows: one for each model, one for each parameter, one for each maneuver."""

from __future__ import annotations

from dataclasses import dataclass

from rotorid.pipeline.compare_document import (
    ComparedManeuverDocument,
    ComparedModelDocument,
    CompareDocument,
    ComparedParameterDocument,
)
from rotorid.pipeline.document import PoleDocument
from rotorid.report.numbers import MISSING, milliseconds, significant, unit, with_error
from rotorid.report.parameter_table import FAR_SIGMAS, Cell

METHODS = {
    "frequency": "frequency responses",
    "output_error": "output error",
    "prediction_error": "prediction error",
    "equation_error": "equation error",
}
_KINDS = {"each": "on each", "leave_one_out": "leave one out"}


@dataclass(frozen=True, kw_only=True, slots=True)
class ModelRow:
    """One result; numbers are text."""

    label: str
    model: str
    method: str
    outputs: str
    order: str
    parameters: str
    own: str
    validated: str
    validated_kind: str
    on_logs: str
    cost: str
    aic: str
    bic: str
    poles: tuple[str, ...]
    delays: tuple[tuple[str, str], ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class SharedRow:
    """One parameter: a value, and how far it lies from the first, for each result."""

    name: str
    unit: str
    values: tuple[Cell, ...]
    distances: tuple[Cell, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class ManeuverRow:
    """One maneuver: fit of every model, marked where it was fitted."""

    record: str
    what: str
    fits: tuple[Cell, ...]


def model_rows(document: CompareDocument) -> tuple[ModelRow, ...]:
    """One row for each result."""
    return tuple(_model_row(one) for one in document.models)


def _model_row(one: ComparedModelDocument) -> ModelRow:
    validated, logs = one.cross_validation, one.on_logs
    return ModelRow(
        label=one.label,
        model=one.model,
        method=METHODS.get(one.method, one.method),
        outputs=", ".join(one.outputs),
        order=str(one.order),
        parameters=str(one.free_parameters),
        own=percents(own_percent(one), None),
        validated=percents(validated.mean_percent, validated.spread_percent) if validated else MISSING,
        validated_kind=_KINDS[validated.kind] if validated else "",
        on_logs=percents(logs.mean_percent, logs.spread_percent) if logs else MISSING,
        cost=significant(one.cost),
        aic=_criterion(one.aic),
        bic=_criterion(one.bic),
        poles=tuple(_pole(pole) for pole in one.poles if pole.imag >= 0.0),
        delays=tuple(
            (name, milliseconds(delay.total_s, delay.total_std_s))
            for name, delay in one.delays.items()
            if delay.total_s > 0.0
        ),
    )


def own_percent(one: ComparedModelDocument) -> float | None:
    """Mean fit of the outputs on the data that were fitted."""
    fits = list((one.fit_percent or {}).values())
    return sum(fits) / len(fits) if fits else None


def percents(mean: float | None, spread: float | None) -> str:
    """A percentage and its standard deviation, to a tenth.

    Examples
    --------
    >>> percents(83.17, 2.85), percents(74.7, None), percents(None, None)
    ('83.2 ± 2.9', '74.7', '–')
    """
    if mean is None:
        return MISSING
    text = f"{mean:.1f}" if spread is None else f"{mean:.1f} ± {spread:.1f}"
    return text.replace("-", "−")


def _criterion(value: float | None) -> str:
    return MISSING if value is None else f"{value:.0f}".replace("-", "−")


def _pole(pole: PoleDocument) -> str:
    real = significant(pole.real)
    return real if pole.imag == 0.0 else f"{real} ± {significant(pole.imag)}j"


def shared_rows(document: CompareDocument) -> tuple[SharedRow, ...]:
    """Parameters that at least two results have and have not dropped; those of all first."""
    labels = [one.label for one in document.models]
    kept = {
        name: one
        for name, one in document.parameters.items()
        if sum(value.status != "dropped" for value in one.values.values()) > 1
    }
    ordered = sorted(kept.items(), key=lambda item: -len(item[1].values))
    return tuple(_shared_row(name, one, labels) for name, one in ordered)


def lone_parameters(document: CompareDocument) -> dict[str, int]:
    """Label to the number of parameters that no other result has."""
    names = {row.name for row in shared_rows(document)}
    return {
        model.label: sum(
            name not in names and model.label in one.values and one.values[model.label].status != "dropped"
            for name, one in document.parameters.items()
        )
        for model in document.models
    }


def _shared_row(name: str, one: ComparedParameterDocument, labels: list[str]) -> SharedRow:
    def value(label: str) -> Cell:
        found = one.values.get(label)
        if found is None:
            return Cell(MISSING)
        return Cell("dropped" if found.status == "dropped" else with_error(found.value, found.std))

    def distance(label: str) -> Cell:
        found = one.values.get(label)
        if found is None or found.z is None:
            return Cell("")
        sign = "+" if found.z >= 0.0 else "−"
        return Cell(f"{sign}{abs(found.z):.1f} σ", abs(found.z) > FAR_SIGMAS)

    return SharedRow(
        name=name.partition(" [")[0],
        unit=unit(one.unit),
        values=tuple(value(label) for label in labels),
        distances=tuple(distance(label) for label in labels),
    )


def maneuver_rows(document: CompareDocument) -> tuple[ManeuverRow, ...]:
    """One row for each maneuver."""
    return tuple(_maneuver_row(one, [model.label for model in document.models]) for one in document.maneuvers)


def _maneuver_row(one: ComparedManeuverDocument, labels: list[str]) -> ManeuverRow:
    def fit(label: str) -> Cell:
        found = one.models.get(label)
        return Cell(MISSING) if found is None else Cell(percents(found.mean_percent, None), found.seen)

    return ManeuverRow(
        record=one.record,
        what=f"{maneuver_words(one.axis, one.kind)}{one.start_s:.1f} to {one.stop_s:.1f} s",
        fits=tuple(fit(label) for label in labels),
    )


def scored_words(document: CompareDocument) -> str:
    """How models were scored on logs, behind a title: over which band, how far ahead."""
    band = " to ".join(significant(edge) for edge in document.band_rad_s or ())
    ahead = f", {significant(document.horizon_s, digits=2)} s ahead" if document.horizon_s else ""
    return f"{f', {band} rad/s' if band else ''}{ahead}"


def maneuver_words(axis: str, kind: str) -> str:
    """What was flown, before its times; of a stretch without a name nothing.

    Examples
    --------
    >>> maneuver_words("roll", "random_binary"), maneuver_words("roll", "other")
    ('roll random binary, ', '')
    """
    return "" if kind == "other" else f"{axis} {kind.replace('_', ' ')}, "
