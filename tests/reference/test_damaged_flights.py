"""Flights that did not go as planned: a sweep cut short, a log with a hole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rotorid
from rotorid.documents.result import result_document
from rotorid.errors import InsufficientDataError


def cut(source: Path, share: float, folder: Path) -> rotorid.FlightRecord:
    """The first part of a log, as after a crash."""
    data = source.read_bytes()
    path = folder / "cut.BIN"
    path.write_bytes(data[: int(share * len(data))])
    return rotorid.read(path)


def test_a_sweep_that_never_got_fast_is_refused(shared_data: Path, tmp_path: Path) -> None:
    record = cut(shared_data / "ardupilot_sitl" / "x_calm_roll.BIN", 0.35, tmp_path)
    with pytest.raises(InsufficientDataError, match=r"no excitation above 1\.6 rad/s"):
        rotorid.identify([record], "rate.roll")
    assert "sweep_ended_early" in {finding.kind for finding in record.findings}


def test_a_sweep_that_ended_early_is_fitted_as_far_as_it_went(shared_data: Path, tmp_path: Path) -> None:
    record = cut(shared_data / "ardupilot_sitl" / "x_calm_roll.BIN", 0.45, tmp_path)
    document = result_document(rotorid.identify([record], "rate.roll"))
    gain = document.parameters["L_roll"]
    assert gain.std is not None
    assert abs(gain.value - 437.2) <= 3.0 * gain.std
    assert document.cost is not None
    assert document.cost.pairs["p/roll_command"].band_rad_s[1] < 9.4


def test_one_hole_near_the_end_of_a_sweep_changes_little(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "s500" / "roll_sweeps.csv"
    lines = source.read_text().splitlines(keepends=True)
    time_s = np.array([float(line.split(",", 1)[0]) for line in lines[1:]])
    path = tmp_path / "hole.csv"
    kept = [line for line, t in zip(lines[1:], time_s, strict=True) if not 21.5 < t < 21.7]
    path.write_text("".join([lines[0], *kept]))
    settings = rotorid.IdentifySettings(band_rad_s=(8.0, 40.0))
    whole, holed = (
        result_document(rotorid.identify([rotorid.read(log)], "rate.roll", settings=settings)) for log in (source, path)
    )
    assert {finding.kind for finding in holed.findings} >= {"gap"}
    std = whole.parameters["L_roll"].std
    assert std is not None
    assert abs(whole.parameters["L_roll"].value - holed.parameters["L_roll"].value) < std
