"""A short flight, and commands run as a person runs them but inside this process."""

from __future__ import annotations

import io
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from rotorid.cli import console
from rotorid.cli.app import main
from rotorid.io.tables.csv import write_csv
from rotorid.simulation.hover_flight import fly
from rotorid.vehicles import s500
from rotorid.vehicles.demo import SWEEPS, demo_plan

_PULSE_S = console._PULSE_S

ROLL = ("--model", "rate.roll", "--band", "12:50")


class Ran(NamedTuple):
    """What a command left: its exit code and its two streams."""

    code: int
    out: str
    err: str


def fly_roll_sweeps(log: Path) -> None:
    """The two roll sweeps of the demonstration, logged as CSV."""
    rng = np.random.default_rng(1)
    flight = fly(s500.vehicle(), demo_plan(rng=rng)[:SWEEPS], rng=rng)
    write_csv(log, flight.time_s, flight.columns)


def rotorid(*arguments: str | Path) -> Ran:
    """``rotorid ARGUMENTS`` by its entry point, errors mapped as for a person."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out), redirect_stderr(err):
        patch.setattr(sys, "argv", ["rotorid", *map(str, arguments)])
        if _PULSE_S == console._PULSE_S:
            # A busy machine takes longer than a person waits for: lines of progress have tests of their own.
            patch.setattr(console, "_PULSE_S", 1e6)
        with pytest.raises(SystemExit) as ended:
            main()
    return Ran(int(ended.value.code or 0), out.getvalue(), err.getvalue())
