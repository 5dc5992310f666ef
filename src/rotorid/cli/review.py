"""``rotorid review LOG...``, or ``rotorid LOG...`` for short: everything that ordinary flights tell."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import print_if_asked, target_of
from rotorid.cli.console import INKS, as_given, default_folder, log_progress, output_console, progress, say
from rotorid.cli.folders import Found
from rotorid.cli.inspect import plan_of
from rotorid.cli.options import AgainstPlan, ForPaper, Logs, Map, Only, Output
from rotorid.data.findings import worst_first
from rotorid.reviewing.settings import ReviewSettings
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rotorid.data.findings import Finding
    from rotorid.data.flight_plan import FlightPlan
    from rotorid.data.record import FlightRecord
    from rotorid.documents.base import Document
    from rotorid.plot.printed import PrintedAs
    from rotorid.reviewing.values import Review

FILE, ARRAYS, PAGE = "review.json", "review.npz", "review.html"
_STYLES = {"warning": "bold yellow", "error": "bold red"}
_MOST_UNTOLD, _MOST_WARNINGS = 8, 8
_WIDTH = len("not enough data")


def review_command(
    logs: Logs,
    *,
    map: Map = None,
    plan: AgainstPlan = None,
    settings: ReviewSettings,
    show: Annotated[bool, Option("--open", "Show the page in the browser.")] = False,
    output: Output,
    paper: Annotated[ForPaper, Only("figures", "pdf")],
) -> None:
    """Say everything that ordinary flights tell: loops, steps, margins, models, noise, motors."""
    from rotorid.documents.base import to_json
    from rotorid.io.folders import making
    from rotorid.report.review import render_reviews
    from rotorid.reviewing.assembly import has_answers, review

    found = Found.behind(logs)
    target = target_of(output, default_folder(found.files, "review"), FILE, paper)
    wanted = plan_of(plan)
    with progress(quiet=output.quiet):
        reviews = [_against(wanted, record, review(record, settings=settings)) for record in found.records(map)]
        if found.skipped:
            # Results are not named after what is no log.
            target = target_of(output, default_folder(found.read, "review"), FILE, paper)
        log_progress("writing the page")
        document = _document(reviews)
        text, page = to_json(document), render_reviews(reviews)
        with making(target) as made:
            if paper.figures is not None:
                _write_figures(made.place / "figures", reviews, paper.figures)
            _write(made.place, text, page, reviews)
            print_if_asked(made.place, paper)
    found.say_skipped()
    if output.json:
        sys.stdout.write(text)
    elif not output.quiet:
        for item, file in zip(reviews, found.read, strict=True):
            _print(item, file, map)
        output_console().print(f"page: {made.folder / PAGE}", soft_wrap=True, markup=False)
    if show:
        typer.launch(str(made.folder / PAGE))
    if not any(has_answers(review) for review in reviews):
        say("rotorid: nothing could be told of any flight; the page says why")
        raise typer.Exit(1)


def _against(plan: FlightPlan | None, record: FlightRecord, reviewed: Review) -> Review:
    """A review with what the log has of a plan among its findings."""
    if plan is None:
        return reviewed
    from rotorid.flying.plan_checks import plan_findings

    return replace(reviewed, findings=worst_first((*plan_findings(record, plan), *reviewed.findings)))


def _document(reviews: Sequence[Review]) -> Document:
    from rotorid.documents.review import ReviewsDocument, review_document

    documents = [review_document(review) for review in reviews]
    return documents[0] if len(documents) == 1 else ReviewsDocument(reviews=documents)


def _write(folder: Path, text: str, page: str, reviews: Sequence[Review]) -> None:
    from rotorid.documents.review import review_arrays
    from rotorid.io.files import write_atomically, write_npz

    for number, review in enumerate(reviews, start=1):
        name = ARRAYS if len(reviews) == 1 else f"review-{number}.npz"
        write_npz(folder / name, review_arrays(review))
        if topics := review.logging.topics:
            write_atomically(folder / "logger_topics.txt", topics)
    write_atomically(folder / PAGE, page)
    write_atomically(folder / FILE, text)


def _write_figures(folder: Path, reviews: Sequence[Review], kind: PrintedAs) -> None:
    from rotorid.io.files import write_atomically
    from rotorid.plot.printed import printed
    from rotorid.report.review import pictures_of

    folder.mkdir()
    for name, figure in pictures_of(reviews).items():
        write_atomically(folder / f"{name}.{kind}", printed(figure, kind))


def _print(reviewed: Review, file: Path, map: Path | None = None) -> None:
    """One screen: what flew, a line for each card, warnings, what cannot be told, what comes next."""
    from rotorid.report.review import headline
    from rotorid.report.unavailable import gathered
    from rotorid.reviewing.cards import cards

    console = output_console()

    def plain(text: str) -> None:
        # Names come from the log: brackets in them are no markup.
        console.print(text, markup=False, soft_wrap=True)

    plain(f"{reviewed.name}  {headline(reviewed)}")
    for card in cards(reviewed):
        console.print(f"{card.word:<{_WIDTH}}", style=INKS[card.color], end=" ")
        number = f" {card.number}." if card.number else ""
        plain(f"{card.title}{number} {card.sentence}")
    if warned := _warnings(reviewed.findings):
        plain("\nfindings")
        for severity, line in warned[:_MOST_WARNINGS]:
            console.print(f"  {severity}", style=_STYLES.get(severity, "bold"), end=" ")
            plain(line)
        if len(warned) > _MOST_WARNINGS:
            plain(f"  and {len(warned) - _MOST_WARNINGS} more, which the page shows")
    if unavailable := gathered(reviewed.cannot_tell):
        plain("\ncannot be told from this flight")
        for gap in unavailable[:_MOST_UNTOLD]:
            plain(f"  {gap.what}: {gap.why}{f' To do: {gap.remedy}' if gap.remedy else ''}")
        if len(unavailable) > _MOST_UNTOLD:
            plain(f"  and {len(unavailable) - _MOST_UNTOLD} more, which the page shows")
    if reviewed.next_commands:
        plain("\nnext")
        for command in reviewed.next_commands:
            plain(f"  {as_given(command, file, map)}")
    plain("")


def _warnings(findings: Sequence[Finding]) -> list[tuple[str, str]]:
    """Severity and words of warnings and errors, the worst first; of one kind all but the first fold into it.

    What was found of a plan that was asked for is shown, be it a remark.
    """
    kinds: dict[tuple[str, str], dict[str, None]] = {}
    for finding in worst_first(findings):
        if finding.severity != "info" or finding.kind.startswith("plan_"):
            kinds.setdefault((finding.severity, finding.kind), {})[finding.message] = None
    lines = []
    for (severity, kind), messages in kinds.items():
        first, *others = messages
        more = f" (and {len(others)} more of this kind, which the page shows)" if others else ""
        lines.append((severity, f"{kind}: {first}{more}"))
    return lines
