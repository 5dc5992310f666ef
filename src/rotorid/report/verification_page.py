"""The report of ``verify``: what unseen maneuvers and unseen sweeps say about a model."""

from __future__ import annotations

from rotorid.pipeline.verify import Verified
from rotorid.pipeline.verify_document import GuidelineDocument, VerifyDocument
from rotorid.report.checks import check_section
from rotorid.report.frame import render
from rotorid.report.numbers import significant
from rotorid.report.scope_rows import range_rows
from rotorid.report.tables import finding_rows
from rotorid.report.unseen_pictures import unseen_sweeps
from rotorid.report.wording import cost_verdict, unseen_sentences
from rotorid.verify.scores import JRMS_GUIDELINE


def render_verification(verified: Verified, *, title: str) -> str:
    """The report as one HTML document, which holds everything it shows and lets no text of a log act.

    Parameters
    ----------
    verified
        What ``verify`` found.
    title
        Heading of the page.
    """
    document = verified.document
    checks = [check_section(check, key=f"check-{number}") for number, check in enumerate(verified.verifications)]
    sweeps = [unseen_sweeps(one, key=f"sweeps-{number}") for number, one in enumerate(verified.judged)]
    return render(
        "verification.html",
        title=title,
        document=document,
        sentences=verification_summary(document),
        checks=checks,
        sweeps=sweeps,
        j_rms=j_rms_sentence(document),
        covered=range_rows(document.covered),
        remarks=finding_rows(document.findings),
        pictures=[
            *(picture for check in checks for picture in check.pictures),
            *(picture for one in sweeps for picture in one.pictures),
        ],
    )


def verification_summary(document: VerifyDocument) -> tuple[str, ...]:
    """What was found, in sentences: unseen maneuvers, closed loop, unseen sweeps."""
    sentences: list[str] = []
    if document.maneuvers:
        sentences += unseen_sentences(document.maneuvers)
    if closed := _closed_loop(document):
        sentences.append(closed)
    costs = {name: pair.value for sweep in document.frequency for name, pair in sweep.pairs.items()}
    if costs:
        worst = max(costs, key=costs.__getitem__)
        several = f", of {len(costs)} responses at worst in {worst}" if len(costs) > 1 else f" in {worst}"
        sentences.append(
            f"Unseen sweeps: cost {significant(costs[worst])}{several}: {cost_verdict(costs[worst]).words}."
        )
    return tuple(sentences) or (f"Nothing could be said about {document.model}.",)


def _closed_loop(document: VerifyDocument) -> str:
    """The worst command in closed loop: rates would flatter the model."""
    flown = [one.closed_loop for one in document.maneuvers if one.closed_loop]
    commands = [(one.scores[name].tic, name) for one in flown for name in one.setpoints]
    if not commands:
        return ""
    tic, name = max(commands)
    own = max(one.controller_tic[name] for one in flown if name in one.controller_tic)
    return (
        f"In closed loop, under the controller that flew, the {name.replace('_', ' ')} comes out with a TIC of "
        f"{significant(tic, digits=2)} at worst; the controller alone, on the measured rate, with one of "
        f"{significant(own, digits=2)}."
    )


def j_rms_sentence(document: VerifyDocument) -> str:
    """J_rms of all maneuvers against its guideline, in both readings where the scale is given; empty without any."""
    if not document.maneuvers:
        return ""
    values = [one.j_rms for one in document.maneuvers]
    ends = dict.fromkeys(significant(value, digits=2) for value in (min(values), max(values)))
    return f"J_rms is {' to '.join(ends)} in degrees and feet. {_guideline(document.j_rms_guideline)}"


def _guideline(guideline: GuidelineDocument | None) -> str:
    low, high = JRMS_GUIDELINE
    if guideline is None:
        return (
            f"The guideline of {low:g} to {high:g} is for aircraft of full scale; with --scale it is Froude scaled to "
            "this vehicle."
        )
    root, printed = ([significant(value) for value in pair] for pair in (guideline.root, guideline.printed))
    return (
        f"The guideline of {low:g} to {high:g} at full scale becomes {root[0]} to {root[1]} for N = "
        f"{significant(guideline.scale)} by the root of N, with which speeds go, and {printed[0]} to {printed[1]} by N "
        "itself, as it is found in print."
    )
