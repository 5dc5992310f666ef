"""``rotorid review LOG...``, or ``rotorid LOG...`` for short: an ordinary flight analyzed."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.command import print_if_asked, target_of
from rotorid.cli.console import (
    INKS,
    as_given,
    default_folder,
    log_progress,
    output_console,
    print_findings,
    print_lines,
    progress,
    say,
)
from rotorid.cli.folders import Found
from rotorid.cli.inspect import plan_of
from rotorid.cli.options import AgainstPlan, ForPaper, Logs, Map, Only, Output
from rotorid.data.display import capital, counted
from rotorid.data.findings import worst_first
from rotorid.errors import UsageError
from rotorid.reviewing.settings import ReviewSettings
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rotorid.data.flight_plan import FlightPlan
    from rotorid.data.record import FlightRecord
    from rotorid.documents.base import Document
    from rotorid.plot.printed import PrintedAs
    from rotorid.reviewing.card import Card
    from rotorid.reviewing.values import Review

FILE, ARRAYS, PAGE = "review.json", "review.npz", "review.html"
_WIDTH = len("not enough data")


def review_command(
    logs: Logs,
    *,
    map: Map = None,
    plan: AgainstPlan = None,
    settings: ReviewSettings,
    show: Annotated[bool, Option("--open", "Show the page in the browser.")] = False,
    output: Output,
    brief: Annotated[
        bool, Option("--brief", "With --json: answers, numbers, evidence below 20 kB.", "Results")
    ] = False,
    paper: Annotated[ForPaper, Only("figures", "pdf")],
) -> None:
    """Analyze an ordinary flight: seven answers, and what to fly next (same as rotorid LOG)."""
    from rotorid.documents.base import to_json
    from rotorid.io.folders import making
    from rotorid.report.review import render_reviews
    from rotorid.reviewing.assembly import has_answers, review

    if brief and not output.json:
        raise UsageError("--brief shortens the JSON", remedy="add --json")
    found = Found.behind(logs)
    target = target_of(output, default_folder(found.files, "review"), FILE, paper)
    wanted = plan_of(plan)
    with progress(quiet=output.quiet):
        reviews = [_against(wanted, record, review(record, settings=settings)) for record in found.records(map)]
        if found.skipped:
            # Results are named after logs only.
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
        sys.stdout.write(_brief(reviews) if brief else text)
    elif not output.quiet:
        if len(reviews) > 1 and not output.verbose:
            _print_several(reviews)
        else:
            for item, file in zip(reviews, found.read, strict=True):
                _print(item, file, map, verbose=output.verbose)
        output_console().print(f"page: {made.folder / PAGE}", soft_wrap=True, markup=False)
    if show:
        typer.launch(str(made.folder / PAGE))
    if not any(has_answers(review) for review in reviews):
        say("rotorid: not enough data for any answer; the page lists what was missing")
        raise typer.Exit(1)


def _against(plan: FlightPlan | None, record: FlightRecord, reviewed: Review) -> Review:
    """A review whose findings compare the log with a plan."""
    if plan is None:
        return reviewed
    from rotorid.flying.plan_checks import plan_findings

    return replace(reviewed, findings=worst_first((*plan_findings(record, plan), *reviewed.findings)))


def _document(reviews: Sequence[Review]) -> Document:
    from rotorid.documents.review import ReviewsDocument, review_document

    documents = [review_document(review) for review in reviews]
    return documents[0] if len(documents) == 1 else ReviewsDocument(reviews=documents)


def _brief(reviews: Sequence[Review]) -> str:
    """One line of JSON, of all logs."""
    from rotorid.documents.base import to_json
    from rotorid.documents.brief import BriefsDocument, brief_document

    documents = [brief_document(review) for review in reviews]
    return to_json(documents[0] if len(documents) == 1 else BriefsDocument(reviews=documents), indent=None)


def _write(folder: Path, text: str, page: str, reviews: Sequence[Review]) -> None:
    from rotorid.documents.review import review_arrays
    from rotorid.io.files import write_atomically, write_npz
    from rotorid.reviewing.filters import filter_files

    for number, review in enumerate(reviews, start=1):
        name = ARRAYS if len(reviews) == 1 else f"review-{number}.npz"
        write_npz(folder / name, review_arrays(review))
        if topics := review.logging.topics:
            write_atomically(folder / "logger_topics.txt", topics)
        for name, lines in filter_files(review).items():
            write_atomically(folder / (name if len(reviews) == 1 else f"{number}-{name}"), lines)
    write_atomically(folder / PAGE, page)
    write_atomically(folder / FILE, text)


def _write_figures(folder: Path, reviews: Sequence[Review], kind: PrintedAs) -> None:
    from rotorid.io.files import write_atomically
    from rotorid.plot.printed import printed
    from rotorid.report.review import pictures_of

    folder.mkdir()
    for name, figure in pictures_of(reviews).items():
        write_atomically(folder / f"{name}.{kind}", printed(figure, kind))


_MOST_LOGS = 12
_MOST_TO_LOOK_AT = 20


def _print_several(reviews: Sequence[Review]) -> None:
    """What to look at in several logs, the logs with most of it first, then a line for each log."""
    from rotorid.reviewing.cards import cards

    found = sorted(
        ((review, cards(review)) for review in reviews),
        key=lambda pair: -sum(card.state == "look" for card in pair[1]),
    )
    look = [
        f"  {review.name}: {card.title} {card.headline}{f' {capital(card.measured)}.' if card.measured else ''}"
        for review, answers in found
        for card in answers
        if card.state == "look"
    ]
    if look:
        output_console().print("look here", style=INKS["red"])
    print_lines(look, verbose=False, item="answer", most=_MOST_TO_LOOK_AT, page=PAGE)
    print_lines([f"\n{counted(len(reviews), 'log')}"], verbose=True)
    print_lines(
        [f"  {_states(review.name, answers)}" for review, answers in found],
        verbose=False,
        item="log",
        most=_MOST_LOGS,
        page=PAGE,
    )


def _states(name: str, answers: Sequence[Card]) -> str:
    """A log, and how many of its answers are of each kind."""
    counts = Counter(card.word for card in answers)
    return f"{name}: {', '.join(f'{count} {word}' for word, count in counts.items())}"


def _print(reviewed: Review, file: Path, map: Path | None = None, *, verbose: bool = False, page: str = PAGE) -> None:
    """What flew, seven answers, warnings, and what to do next; with ``verbose`` also what was not measured."""
    from rotorid.report.review import headline
    from rotorid.reviewing.baseline import left_out_words
    from rotorid.reviewing.cards import cards, interval_words
    from rotorid.reviewing.missing_words import gathered

    console = output_console()

    def plain(text: str) -> None:
        # Names come from the log: brackets in them are no markup.
        console.print(text, markup=False, soft_wrap=True)

    plain(f"{reviewed.name}  {headline(reviewed)}\n")
    lost = [finding for finding in reviewed.findings if finding.kind == "control_lost"]
    for finding in lost:
        # Before all answers: they are about the flight up to here.
        console.print(f"{'look here':<{_WIDTH}}", style=INKS["red"], end=" ")
        plain(finding.message)
    answers = cards(reviewed)
    for card in answers:
        console.print(f"{card.word:<{_WIDTH}}", style=INKS[card.color], end=" ")
        plain(f"{card.title} {card.headline}{f' {capital(card.measured)}.' if card.measured else ''}")
        # What needs a look brings its remedy, and what is unknown the one thing to do.
        more = card.sentence.removeprefix(card.headline).strip() if verbose else ""
        more = more or (
            card.details if card.state in ("look", "part") else card.action or card.details * (card.state == "cannot")
        )
        if more:
            plain(f"{'':<{_WIDTH}} {more}")
    if words := interval_words(answers):
        plain(words)
    if reviewed.baseline is not None:
        plain("\nsince earlier flights")
        for sentence in (*reviewed.baseline.sentences, *left_out_words(reviewed.baseline, all_of_them=verbose)):
            plain(f"  {sentence}")
    remarks = [finding for finding in reviewed.findings if finding not in lost]
    if any(verbose or finding.severity != "info" for finding in remarks):
        plain("")
        print_findings(remarks, (file,), verbose=verbose, page=page)
    if not verbose:
        # Notes on a plan that was asked for are part of the answer.
        notes = [finding for finding in reviewed.findings if finding.severity == "info"]
        print_findings([note for note in notes if note.kind.startswith("plan_")], (file,), verbose=True, page=page)
    if unavailable := gathered(reviewed.cannot_tell):
        things = counted(len(unavailable), "more thing")
        plain("\nnot enough data" if verbose else f"\n{things} could be measured: -v lists what to fly or log")
        for gap in unavailable if verbose else ():
            plain(f"  {gap.what}: {gap.why}{f' To do: {gap.remedy}' if gap.remedy else ''}")
    if reviewed.next_commands:
        plain("\nnext")
        for command in reviewed.next_commands:
            plain(f"  {as_given(command, file, map)}")
    plain("")
