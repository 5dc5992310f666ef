"""The page on gains: what it prints of logs of real autopilots is what the command says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import rotorid
from rotorid.documents.tune import tune_document

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tutorials" / "my-gains.md"


@pytest.mark.parametrize("log", ["px4_sitl/roll.ulg", "ardupilot_sitl/x_calm_roll.BIN"])
def test_gains_of_real_autopilots_are_those_of_the_page(shared_data: Path, log: str) -> None:
    _, _, after = PAGE.read_text().partition(f"$ rotorid tune {Path(log).name} --axes roll\n")
    part = after.partition("```console")[0]
    printed = {
        name: (flown, proposed) for name, flown, proposed in re.findall(r"^\| (\w+) \| (\S+) \| (\S+) \|$", part, re.M)
    }
    printed.pop("parameter")
    axis = tune_document(rotorid.tune(records=str(shared_data / log), axes=["roll"])).axes["roll"]
    told = {
        name: (f"{gain.flown:.4g}", f"{gain.proposed:.4g}")
        for name, gain in axis.gains.items()
        if gain.flown != gain.proposed
    }
    assert printed == told
    peak = axis.proposed_whole["sensitivity_peak"]
    assert f"becomes {peak.value:.2f} ({peak.lower:.2f} to {peak.upper:.2f})" in part
