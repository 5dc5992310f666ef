"""Logs that ``simulate`` makes of a result of ``physical.flight``, from hover to 8 m/s and back, give that result."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from tests.unit.cli.commands import rotorid
from tests.unit.flying.flights import DISC_M2, OF_OUTPUTS, flight, layout
from tests.unit.identifying.flight_logs import layout_file

from rotorid.documents.result import load, save

THERE_AND_BACK = ("0:8", "8:0")


@pytest.mark.slow
def test_a_simulated_result_is_identified_as_itself(tmp_path: Path) -> None:
    save(flight(), tmp_path / "result")
    logs = []
    for seed, speed in enumerate(THERE_AND_BACK):
        logs.append(tmp_path / speed.replace(":", "-"))
        ran = rotorid(
            *("simulate", tmp_path / "result", "--like", "x500", "--plan", "everyday", "--duration", "40"),
            *("--speed", speed, "--seed", str(seed), "--out", logs[-1], "--quiet"),
        )
        assert ran.code == 0, ran.err
    ran = rotorid(
        *("identify", *(folder / "flight.ulg" for folder in logs), "--model", "physical.flight"),
        *("--layout", layout_file(tmp_path, layout()), "--rotor-diameter", str(math.sqrt(4.0 * DISC_M2 / math.pi))),
        *("--fix", f"m={OF_OUTPUTS['m']}", "--fix", f"I_zz={OF_OUTPUTS['I_zz']}"),
        *("--out", tmp_path / "again", "--quiet"),
    )
    assert ran.code == 0, ran.err
    again, was = load(tmp_path / "again"), flight()
    free = {name: found for name, found in again.parameters.items() if found.std}
    assert {"c_2", "k_d", "T_motor", "I_xx", "I_yy", "kappa", "x_imu"} <= set(free)
    for name, found in free.items():
        # What the ladder adds in vain is zero within its error.
        assert abs(found.value - OF_OUTPUTS.get(name, 0.0)) < 3.0 * (found.std or 0.0), name
    assert again["k_d"].value == pytest.approx(OF_OUTPUTS["k_d"], rel=0.05)
    assert again.flight is not None
    assert was.flight is not None
    for name, stated in was.flight.hover.items():
        assert again.flight.hover[name].value == pytest.approx(stated.value, rel=0.08), name
