"""Commands that lead on run as they are printed, wherever the log lies."""

from __future__ import annotations

import shlex
from dataclasses import replace
from pathlib import Path

from tests.unit.cli.commands import fly_roll_sweeps, rotorid

from rotorid.data.record import FlightRecord, Source
from rotorid.flying.next_steps import KnownOfLog, next_steps


def test_the_next_commands_name_the_log_as_it_was_given(tmp_path: Path) -> None:
    log = tmp_path / "my flights" / "roll sweeps.csv"
    log.parent.mkdir()
    fly_roll_sweeps(log)
    told = rotorid("inspect", log).out
    commands = [
        line.strip() for line in told.partition("next\n")[2].splitlines() if line.strip().startswith("rotorid ")
    ]
    assert commands
    assert all(str(log) in shlex.split(command) for command in commands)
    # Nobody but the terminal learns where it lies.
    assert str(tmp_path) not in rotorid("inspect", log, "--json").out


def test_of_several_logs_each_has_its_own_path(tmp_path: Path) -> None:
    logs = [tmp_path / folder / "flight.csv" for folder in ("monday", "tuesday")]
    for log in logs:
        log.parent.mkdir()
    fly_roll_sweeps(logs[0])
    logs[1].write_text(logs[0].read_text() + "\n")
    lines = [line.strip() for line in rotorid("inspect", *logs).out.splitlines()]
    assert [line.split()[-1] for line in lines if line.startswith("rotorid review")] == [str(log) for log in logs]


def test_a_sweep_that_gave_a_rate_model_leads_to_gains() -> None:
    known = KnownOfLog(record=FlightRecord(source=Source(name="roll.ulg", format="ULog", sha256=""), topics=()))
    assert "rotorid tune roll.ulg" not in [*next_steps(known)]
    assert "rotorid tune roll.ulg" in [*next_steps(replace(known, tunes=True))]
