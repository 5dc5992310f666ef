"""What a log is good for, in words that the page and the terminal share."""

from __future__ import annotations

from dataclasses import replace

from rotorid.data.findings import Finding
from rotorid.reviewing.inspection import Inspection, answering_model
from rotorid.reviewing.missing import Unavailable, merged_axes

_BY = {
    "excitation": "from its test inputs",
    "ordinary flight": "from ordinary flight; a sweep would give intervals several times narrower",
    "motors": "from motor outputs",
    "motor speeds": "from outputs and speeds of the motors",
}
"""What a model would be identified from."""


def good_for(inspection: Inspection) -> tuple[tuple[str, str], ...]:
    """Models that a log supports, and what they would be identified from."""
    by: dict[str, list[str]] = {}
    for model, support in inspection.supports.items():
        if support.possible:
            by.setdefault(_BY.get(support.by, support.because), []).append(model)
    if answers := answering_model(inspection):
        by["from its set-points"] = [answers]
    return tuple((", ".join(models), words) for words, models in by.items())


_OF_SIZE = ("--layout ", "--arm ")
"""Options for what a table of numbers does not say: where the rotors are."""


def good_with_options(inspection: Inspection) -> tuple[Unavailable, ...]:
    """Models that lack nothing but the rotors' places, which an option gives: why, and what to type."""
    return tuple(
        Unavailable(what=model, why=support.because, remedy=support.remedy)
        for model, support in inspection.supports.items()
        if not support.possible and support.remedy.startswith(tuple(f"add {option}" for option in _OF_SIZE))
    )


def not_for(inspection: Inspection) -> tuple[Unavailable, ...]:
    """Models that a log does not support: why, and what to do; one row for those that differ in their axes alone."""
    with_options = {row.what for row in good_with_options(inspection)}
    rows = merged_axes(
        Unavailable(what=model, why=support.because, remedy=support.remedy)
        for model, support in inspection.supports.items()
        if not support.possible and model not in with_options
    )
    if len(rows) == 1 and not good_for(inspection):
        return (replace(rows[0], what="any model"),)
    return tuple(replace(row, what=row.what.replace("; ", ", ")) for row in rows)


def further_findings(inspection: Inspection) -> tuple[Finding, ...]:
    """Findings without the reason that every model was refused for, which :func:`not_for` gives."""
    reasons = {support.because.removeprefix("the log ") for support in inspection.supports.values() if support.because}
    return tuple(
        finding
        for finding in inspection.findings
        if finding.kind != "never_airborne" or not any(reason in finding.message for reason in reasons)
    )
