"""Write simulated flights: all logs and what was true of them, or none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from rotorid.io.store import write_atomically
from rotorid.pipeline.plan_document import plan_document
from rotorid.pipeline.rig_simulation import LOG_NAME, move_rig, rig_document, write_rig
from rotorid.pipeline.simulation import SimulateChoices, fly_run, simulation_document, write_run
from rotorid.pipeline.simulation_document import SimulatedLogDocument, SimulationDocument
from rotorid.report.output import to_json, write_together


def write_simulation(
    folder: Path,
    choices: SimulateChoices,
    *,
    command: Sequence[str],
    progress: Callable[[str], None] = lambda _: None,
) -> SimulationDocument:
    """Fly all runs one after the other, and write their logs, ``plan.json`` and ``simulation.json`` into a folder.

    Parameters
    ----------
    folder
        Where they go; it is made when missing. Files of the same names are replaced.
    choices
        What is to be flown.
    command
        What the user typed, for the document.
    progress
        Is told what is being done.
    """
    logs: list[SimulatedLogDocument] = []
    documents: list[SimulationDocument] = []

    def fly(number: int) -> Callable[[Path], None]:
        def write(path: Path) -> None:
            progress(f"flying {choices.vehicle}" + (f", {number + 1} of {choices.runs}" if choices.runs > 1 else ""))
            logs.append(write_run(path, fly_run(choices, number), choices))

        return write

    def conclude(path: Path) -> None:
        documents.append(simulation_document(choices, logs, command=command))
        write_atomically(path, to_json(documents[0]))

    # In the order of the mapping: the document needs the logs' hashes.
    files = {name: fly(number) for number, name in enumerate(choices.file_names)}
    if choices.plan is not None:
        text = to_json(plan_document(choices.plan))
        files["plan.json"] = lambda path: write_atomically(path, text)
    write_together(folder, {**files, "simulation.json": conclude})
    return documents[0]


def write_rig_simulation(folder: Path, *, seed: int, command: Sequence[str]) -> SimulationDocument:
    """Move the rig on its pivot, and write its log and ``simulation.json`` into a folder."""
    record = move_rig(seed)
    documents: list[SimulationDocument] = []

    def conclude(path: Path) -> None:
        documents.append(rig_document(record, path.with_name(LOG_NAME), seed=seed, command=command))
        write_atomically(path, to_json(documents[0]))

    write_together(folder, {LOG_NAME: lambda path: write_rig(path, record), "simulation.json": conclude})
    return documents[0]
