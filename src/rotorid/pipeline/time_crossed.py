"""An identification with its cross-validation, by the same model, method and choices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

from rotorid.data.record import FlightRecord
from rotorid.errors import UsageError
from rotorid.models.structure import LinearStructure
from rotorid.pipeline.assemble import finding_documents
from rotorid.pipeline.cross_validation import cross_validate
from rotorid.pipeline.hold_out import nothing_left
from rotorid.pipeline.identification import Identification
from rotorid.pipeline.identify import identify, logged_by_all
from rotorid.pipeline.resolve import resolve_model
from rotorid.pipeline.settings import IdentifySettings
from rotorid.pipeline.time_judge import nothing_unseen
from rotorid.verify.cross_validation import Kind


def parse_kind(text: str | None) -> Kind | None:
    """Read ``each`` or ``leave_one_out``; ``None`` for no cross-validation.

    Examples
    --------
    >>> parse_kind("each")
    'each'
    """
    if text is None or text in get_args(Kind):
        return text  # type: ignore[return-value]
    raise UsageError(f"the cross-validation {text!r} came", needed=f"one of {', '.join(get_args(Kind))}")


def cross_validated(
    identified: Identification,
    records: Sequence[FlightRecord],
    model: str | Path | LinearStructure,
    *,
    kind: Kind,
    settings: IdentifySettings,
    progress: Callable[[str], None] = lambda _: None,
) -> Identification:
    """The same identification with a cross-validation in its document.

    Parameters
    ----------
    identified
        The model of all records.
    records, model, settings
        What it came from.
    kind
        Which records each model is identified on.
    progress
        Told what is being done.

    Raises
    ------
    InsufficientDataError
        No fold has a model that could be scored.
    UsageError
        There is one record only.
    """
    structure = resolve_model(model, outputs=settings.outputs, logged=logged_by_all(records))
    crossed = cross_validate(
        records,
        structure,
        identify=lambda some, choices: identify(some, structure, settings=choices),
        kind=kind,
        settings=settings,
        progress=progress,
    )
    document = identified.document
    own = [finding for finding in finding_documents(crossed.findings) if finding not in document.findings]
    # A model that was judged on unseen records is verified; why another log failed to verify it stays of interest.
    names = [one.record for one in identified.segments]
    answered = finding_documents([nothing_unseen(names), nothing_left()])
    kept = [finding for finding in document.findings if finding not in answered]
    update = {"cross_validation": crossed.document, "findings": [*kept, *own]}
    return replace(identified, document=document.model_copy(update=update))
