"""``rotorid inspect``: what a log is good for, and what it contains."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from rotorid.cli.command import print_if_asked, target_of
from rotorid.cli.console import as_given, log_progress, progress
from rotorid.cli.folders import Found
from rotorid.cli.options import AgainstPlan, ForPaper, Logs, Map, Only, Output
from rotorid.data.display import counted
from rotorid.data.findings import worst_first
from rotorid.data.quantity import milliseconds, with_error
from rotorid.errors import UsageError
from rotorid.settings.option import Option

if TYPE_CHECKING:
    from rich.table import Table

    from rotorid.data.flight_plan import FlightPlan
    from rotorid.data.record import FlightRecord, Maneuver
    from rotorid.flights.consistency import ChannelSkew
    from rotorid.reviewing.inspection import Inspection, LoggedChannel

Plot: TypeAlias = Annotated[Path | None, Option("--plot", "Write a picture of the log: FILE.html or FILE.png.")]

FILE, REPORT = "inspect.json", "report.html"
_MOST_SKEWS = 6
_MOST_CANDIDATES = 3
_SHOWN_ELSEWHERE = ("airborne", "bench_log", "clock_skew", "kinematic_consistency", "kinematics_unchecked")
"""Kinds that have lines of their own; only their warnings are printed again."""


def inspect_command(
    logs: Logs,
    *,
    map: Map = None,
    plan: AgainstPlan = None,
    plot: Plot = None,
    out: Annotated[
        Path | None,
        Option("--out", "Folder for inspect.json and report.html. [default: nothing is written]"),
    ] = None,
    output: Annotated[Output, Only("json", "quiet", "verbose", "force")],
    paper: Annotated[ForPaper, Only("pdf")],
) -> None:
    """List what a log is good for, and what to fly or log for the rest."""
    if paper.pdf and out is None:
        raise UsageError("--pdf is used without --out", remedy="add --out FOLDER")
    found = Found.behind(logs)
    alone = plot is not None or out is not None
    if alone and len(found.named) > 1:
        raise _too_many(f"{len(found.files)} logs")
    if len(found.files) > 1 and not alone:
        _inspect_several(found, map, plan, output)
        return
    from rotorid.io.folders import making

    wanted = plan_of(plan)
    if plot is not None:
        from rotorid.report.files import require_replaceable
        from rotorid.report.inspection import require_suffix, write_inspection

        require_suffix(plot)
        require_replaceable(plot, force=output.force)
    if out is not None:
        target = target_of(replace(output, out=out), out, FILE, paper)
    with progress(quiet=output.quiet):
        # Files of a folder that are no logs do not count.
        record, *others = islice(found.records(map), 2)
        if others:
            raise _too_many("a folder of several logs")
        log_progress("inspecting")
        inspection = _inspected(record, wanted)
    if plot is not None:
        write_inspection(plot, record, inspection)
    if out is not None:
        with making(target) as made:
            _write(made.place, record, inspection)
            print_if_asked(made.place, paper)
    found.say_skipped()
    if output.json:
        from rotorid.documents.base import to_json
        from rotorid.documents.inspection import inspect_document

        sys.stdout.write(to_json(inspect_document(inspection)))
    elif not output.quiet:
        _print(inspection, found.read[-1], map, plot, out, verbose=output.verbose)


def _too_many(came: str) -> UsageError:
    return UsageError(
        f"--plot or --out is used with {came}",
        needed="a single log",
        remedy="use rotorid review for a page of several",
    )


def plan_of(file: Path | None) -> FlightPlan | None:
    """The plan that a log is compared with."""
    if file is None:
        return None
    from rotorid.documents.design import read_plan

    return read_plan(file)


def _inspected(record: FlightRecord, plan: FlightPlan | None) -> Inspection:
    """The inspection of a log, with its comparison with a plan among the findings."""
    from rotorid.flying.plan_checks import plan_findings
    from rotorid.reviewing.inspection import inspect

    inspection = inspect(record)
    if plan is None:
        return inspection
    return replace(inspection, findings=worst_first((*plan_findings(record, plan), *inspection.findings)))


def _inspect_several(found: Found, map: Path | None, plan: Path | None, output: Output) -> None:
    """One after the other; a file that cannot be read ends no other, and the exit code is 2 where it was named."""
    from rotorid.documents.base import to_json
    from rotorid.documents.inspection import InspectionsDocument, inspect_document

    inspections, wanted = [], plan_of(plan)
    for record in found.records(map, each_alone=True):
        inspections.append(_inspected(record, wanted))
        if not output.json and not output.quiet:
            _print(inspections[-1], found.read[len(inspections) - 1], map, None, None, verbose=output.verbose)
            sys.stdout.write("\n")
    found.say_skipped()
    if output.json:
        documents = [inspect_document(inspection) for inspection in inspections]
        # A folder with a single log is that log; with a named file that failed, it is one of several.
        alone = len(found.files) == len(found.skipped) + 1
        sys.stdout.write(to_json(documents[0] if alone else InspectionsDocument(inspections=documents)))
    if found.failed:
        raise typer.Exit(2)


def _write(folder: Path, record: FlightRecord, inspection: Inspection) -> None:
    from rotorid.documents.inspection import inspect_document
    from rotorid.report.files import write_together
    from rotorid.report.inspection import render_inspection

    write_together(folder, {FILE: inspect_document(inspection), REPORT: render_inspection(record, inspection)})


def _print(
    inspection: Inspection, file: Path, map: Path | None, plot: Path | None, out: Path | None, *, verbose: bool
) -> None:
    """What the log is good for and what not, warnings, and what to do next; with ``verbose`` everything else too."""
    from rotorid.cli.console import output_console, print_findings, print_lines
    from rotorid.report.inspection_words import further_findings, good_with_options

    console = output_console()

    def say(lines: Iterable[str], heading: str = "") -> None:
        if heading:
            console.print(f"\n[bold]{heading}[/bold]")
        for line in lines:
            # Names come from the log: brackets in them are no markup.
            console.print(line, markup=False, soft_wrap=True)

    say(_head(inspection))
    say(_good_for(inspection), "good for")
    if with_options := [f"  {row.what}: {row.why}; {row.remedy}" for row in good_with_options(inspection)]:
        say(with_options, "good for, with what the log does not say")
    if not_possible := list(_not_for(inspection)):
        say(not_possible, "not for")
    hertz = in_hertz(inspection)
    if inspection.candidates:
        say([], "possible test inputs: name those that were meant")
        lines = [
            f"  {_maneuver(item, hertz=hertz)} in {item.signal}: --segment {item.segment}"
            for item in inspection.candidates
        ]
        print_lines(lines, verbose=verbose, item="possible test input", most=_MOST_CANDIDATES, page="")
    if verbose:
        console.print()
        console.print(_topics(inspection))
        if inspection.settings:
            say(["  ".join(f"{name}={_setting(value)}" for name, value in inspection.settings.items())], "parameters")
        lines = [f"  {_maneuver(item, hertz=hertz)} {item.origin} in {item.signal}" for item in inspection.excitations]
        say(lines or ["  none found"], "test inputs")
        if inspection.kinematics or inspection.skews:
            say([*_kinematics(inspection), *_skews(inspection.skews)], "do sensors and clocks agree?")
    findings = [f for f in further_findings(inspection) if f.severity != "info" or f.kind not in _SHOWN_ELSEWHERE]
    # Notes on a plan that was asked for are part of the answer.
    notes = [f for f in findings if not verbose and f.severity == "info" and f.kind.startswith("plan_")]
    if notes or any(verbose or finding.severity != "info" for finding in findings):
        say([], "warnings and notes")
        print_findings(findings, (file,), verbose=verbose, page="" if out is None else REPORT)
        print_findings(notes, (file,), verbose=True, page="")
    commands = [f"  {as_given(command, file, map)}" for command in inspection.next_commands]
    say(commands or [f"  fly: {_no_flight(inspection)}"], "next")
    if not verbose:
        say(["\n-v shows topics, rates, test inputs and sensor checks"])
    if plot is not None:
        say([f"\npicture: {plot}"])
    if out is not None:
        say([f"\nreport: {out / REPORT}", f"file: {out / FILE}"])


def _no_flight(inspection: Inspection) -> str:
    if any(finding.kind == "never_airborne" for finding in inspection.findings):
        return "this log contains no flight"
    if bench := of_bench(inspection):
        return bench
    return "this log does not show whether the vehicle flew"


def of_bench(inspection: Inspection) -> str:
    """That a log is of a bench, and with what; empty for others."""
    found = next((finding.message for finding in inspection.findings if finding.kind == "bench_log"), "")
    return found.removeprefix(f"{inspection.name} is ").rstrip(".")


def in_hertz(inspection: Inspection) -> bool:
    """Whether frequencies of a log are shown in Hz."""
    from rotorid.report.frame import frequency_of

    return frequency_of([inspection.name, inspection.format]) == "Hz"


def _head(inspection: Inspection) -> Iterator[str]:
    firmware = f", {inspection.firmware}" if inspection.firmware else ""
    battery = inspection.battery
    volts = f", battery {battery.start_v:.2f} to {battery.stop_v:.2f} V" if battery else ""
    span = f"{inspection.start_s:.1f} to {inspection.stop_s:.1f} s"
    yield f"{inspection.name}  {inspection.format}{firmware}, {span}{volts}"
    if bench := of_bench(inspection):
        yield bench
    if inspection.flights:
        spans = ", ".join(f"{flight.start_s:.1f} to {flight.stop_s:.1f} s" for flight in inspection.flights)
        yield f"in the air {spans}"


def _good_for(inspection: Inspection) -> Iterator[str]:
    from rotorid.report.inspection_words import good_for

    yield from [f"  {models}: {words}" for models, words in good_for(inspection)] or ["  no model"]


def _not_for(inspection: Inspection) -> Iterator[str]:
    from rotorid.report.inspection_words import not_for

    for row in not_for(inspection):
        yield f"  {row.what}: {row.why}{f'; {row.remedy}' if row.remedy else ''}"


def _setting(value: float) -> str:
    """A parameter for a person; whole numbers with all digits, since many are masks of bits."""
    return f"{value:.0f}" if value == round(value) else f"{value:.6g}"


def _topics(inspection: Inspection) -> Table:
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for name in ("topic", "rate", "from", "to", "gaps", "channels"):
        table.add_column(name, justify="right" if name in ("rate", "from", "to", "gaps") else "left")
    for topic, rows in groupby(inspection.channels, key=lambda channel: channel.topic):
        channels = list(rows)
        first = channels[0]
        cells = (
            topic,
            f"{first.rate_hz:.0f} Hz",
            "" if first.start_s is None else f"{first.start_s:.1f}",
            "" if first.stop_s is None else f"{first.stop_s:.1f}",
            f"{first.gaps} (longest {first.longest_gap_s:.2f} s)" if first.gaps else "0",
            _names(channels),
        )
        table.add_row(*(Text(cell) for cell in cells))
    return table


def _names(channels: Sequence[LoggedChannel]) -> str:
    """Names of channels in a row; numbered ones, such as the motors, as the first and the last."""
    shown = []
    for _, group in groupby((channel.name for channel in channels), key=lambda name: re.sub(r"\d+$", "#", name)):
        names = list(group)
        shown.append(f"{names[0]}…{names[-1].rpartition('_')[2]}" if len(names) > 2 else " ".join(names))
    return " ".join(shown)


def _maneuver(item: Maneuver, *, hertz: bool) -> str:
    band = ""
    if item.band_rad_s:
        low, high = (end / (2.0 * math.pi) if hertz else end for end in item.band_rad_s)
        band = f"{low:.2g} to {high:.3g} {'Hz' if hertz else 'rad/s'}"
    return f"{item.axis:<7}{item.kind:<14}{item.start_s:9.2f} to {item.stop_s:9.2f} s  {band:<20}"


def _kinematics(inspection: Inspection) -> Iterator[str]:
    """A line for each sensor; those that could not be checked share one."""
    for row in inspection.kinematics:
        yield (
            f"  {row.channel:<3} {row.verdict:<12} scale {with_error(row.scale, row.scale_std)}, lag "
            f"{milliseconds(row.lag_s, row.lag_std_s)} ms against {row.against}"
        )
    checked = [row.channel for row in inspection.kinematics]
    unchecked = [f.where for f in inspection.findings if f.kind == "kinematics_unchecked" and f.where not in checked]
    if unchecked:
        yield f"  not checked: {', '.join(unchecked)}"


def _skews(skews: Sequence[ChannelSkew]) -> Iterator[str]:
    """A line for each pair of topics, and for each output against its command; what needs a remedy comes first."""
    pairs = {(row.reference, row.delayed): row for row in (*skews[::-1], *(row for row in skews if row.remedy))}
    rows = sorted(pairs.values(), key=lambda row: (not row.remedy, row.nature, row.start_s))
    for row in rows[:_MOST_SKEWS]:
        late = f"lags by {milliseconds(row.seconds, row.std_s)} ms"
        if row.nature == "vehicle":
            yield f"  {row.channel:<3} {late} behind {row.reference} (vehicle, motors, filters and stamps together)"
            continue
        known = f" (known filters: {1e3 * row.known_s[0]:.1f} to {1e3 * row.known_s[1]:.1f} ms)"
        rest = f"{known if any(row.known_s) else ''}{f': {row.remedy}' if row.remedy else ''}"
        yield f"  {row.channel:<3} in {row.delayed} {late} behind {row.reference}{rest}"
    if len(rows) > _MOST_SKEWS:
        yield f"  {counted(len(rows) - _MOST_SKEWS, 'more pair')}: --json shows all"
