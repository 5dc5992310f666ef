"""The work behind ``rotorid identify``, once its options are read."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import typer

from rotorid.cli.console import progress, say_refused
from rotorid.cli.identify_print import print_result

if TYPE_CHECKING:
    from collections.abc import Callable

    from rotorid.data.record import FlightRecord
    from rotorid.models.structure import LinearStructure
    from rotorid.pipeline.identification import Identification
    from rotorid.pipeline.motor_choices import MotorChoices
    from rotorid.pipeline.settings import IdentifySettings
    from rotorid.verify.cross_validation import Kind


class Job(NamedTuple):
    """What is to be identified, from what, and where the answer goes.

    Parameters
    ----------
    logs, unseen
        Files to identify on, and to judge the model on.
    mapping
        What names the channels of other sources.
    model
        A structure, or the name of one that finds its channels in the logs.
    settings
        Choices of the run.
    motors
        Those of ``physical.motors``, ``None`` for another model.
    kind
        Of a cross-validation, ``None`` for none.
    folder
        For the files.
    json, quiet
        What to say.
    """

    logs: list[Path]
    unseen: list[Path]
    mapping: Path | None
    model: str | LinearStructure
    settings: IdentifySettings
    motors: MotorChoices | None
    kind: Kind | None
    folder: Path
    json: bool
    quiet: bool

    @property
    def name(self) -> str:
        """Of the model."""
        return self.model if isinstance(self.model, str) else self.model.name


def run_identify(job: Job) -> None:
    """Identify, write the files and say what was found.

    Raises
    ------
    typer.Exit
        With code 1: the data cannot support the model.
    """
    from rotorid.errors import InsufficientDataError
    from rotorid.pipeline.identify import refused
    from rotorid.report.output import to_json, write_results

    records: list[FlightRecord] = []
    try:
        with progress(quiet=job.quiet) as tell:
            result = _identified(job, records, tell)
            tell("writing the report")
            title = f"{job.name} from {', '.join(log.name for log in job.logs)}"
            write_results(job.folder, result, title=title)
    except InsufficientDataError as error:
        document = refused(error, records, job.model, settings=job.settings, command=_command())
        if job.json:
            sys.stdout.write(to_json(document))
        say_refused(error, document.findings, job.folder / "result.json", quiet=job.quiet)
        raise typer.Exit(1) from None
    if job.json:
        sys.stdout.write(to_json(result.document))
    elif not job.quiet:
        print_result(result.document, job.folder)


def _identified(job: Job, records: list[FlightRecord], tell: Callable[[str], None]) -> Identification:
    """The result; ``records`` fill up as they are read, so that a refusal can tell of them."""
    from rotorid.io.registry import read
    from rotorid.pipeline.identify import identify
    from rotorid.pipeline.time_crossed import cross_validated

    for log in job.logs:
        tell(f"reading {log.name}")
        records.append(read(log, mapping=job.mapping))
    unseen = [read(log, mapping=job.mapping) for log in job.unseen]
    if job.motors is not None:
        from rotorid.pipeline.motor_identify import identify_motors

        return identify_motors(records, job.motors, verify=unseen, command=_command(), progress=tell)
    result = identify(records, job.model, settings=job.settings, verify=unseen, command=_command(), progress=tell)
    if job.kind is None:
        return result
    # Folds are scored, and need no spread.
    once = replace(job.settings, bootstrap=None)
    return cross_validated(result, records, job.model, kind=job.kind, settings=once, progress=tell)


def _command() -> list[str]:
    return ["rotorid", *sys.argv[1:]]
