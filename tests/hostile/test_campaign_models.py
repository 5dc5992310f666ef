"""Good logs of 30 s with one to five bad numbers in their bytes: the model stays within its interval, or is refused."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest
from tests.hostile.spoiled_logs import SPOILERS, spoiled

import rotorid
from rotorid.errors import RotoridError
from rotorid.flying.designs import plan_with
from rotorid.flying.examples import EXAMPLES
from rotorid.flying.settings import PlanSettings
from rotorid.io.registry import write_log
from rotorid.results.model import IdentifiedModel
from rotorid.vehicles.catalog import aircraft

MODEL = "rate.roll"
MOST_REFUSED = 0.1
FLOWN = {"BIN": "ardupilot", "ulg": "px4", "bbl": "betaflight", "csv": "px4"}
"""Ending of a log to the example whose roll is flown."""


@dataclass(frozen=True, kw_only=True)
class Good:
    """A sound log, and the model of roll that it gives."""

    ending: str
    content: bytes
    model: IdentifiedModel

    def told(self, seed: int, folder: Path) -> str:
        """``within``, ``refused``, or what moved."""
        path = folder / f"flight.{self.ending}"
        path.write_bytes(spoiled(self.ending, self.content, seed))
        try:
            found = rotorid.identify([rotorid.read(path)], MODEL).parameters
        except RotoridError:
            return "refused"
        moved = []
        for name, sound in self.model.parameters.items():
            if not sound.std:
                continue
            half = 0.5 * (sound.upper - sound.lower)
            distance = abs(found[name].value - sound.value) / half if name in found else float("inf")
            if not distance <= 1.0:
                moved.append(f"{name} by {distance:.2f}")
        return f"seed {seed}: {', '.join(moved)}" if moved else "within"


@pytest.fixture(scope="module", params=sorted(SPOILERS))
def good(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Good:
    return fly(request.param, tmp_path_factory.mktemp("good"))


def fly(ending: str, folder: Path) -> Good:
    """Roll alone, swept for half a minute."""
    example = EXAMPLES[FLOWN[ending]]
    choices = PlanSettings(
        shape=example.shape,
        axes=("roll",),
        band_rad_s=example.band_rad_s,
        duration_s=24.0,
        repeats=1,
        doublets=False,
        entry=example.entry,
    )
    plan = plan_with(aircraft(example.vehicle), choices, {"roll": example.sweeps["roll"]}, name="campaign")
    path = folder / f"flight.{ending}"
    write_log(path, rotorid.simulate(example.vehicle, plan), format=ending.lower())
    return Good(ending=ending, content=path.read_bytes(), model=rotorid.identify([rotorid.read(path)], MODEL))


def judge(good: Good, seeds: range, folder: Path) -> None:
    told = Counter(good.told(seed, folder) for seed in seeds)
    refused = told.pop("refused", 0)
    told.pop("within", 0)
    assert sorted(told) == []
    assert refused <= max(MOST_REFUSED * len(seeds), 1)


def test_a_few_bad_numbers_move_no_model(good: Good, tmp_path: Path) -> None:
    judge(good, range(5), tmp_path)


@pytest.mark.slow
def test_a_few_bad_numbers_move_no_model_in_a_campaign(good: Good, tmp_path: Path) -> None:
    judge(good, range(1000, 1500), tmp_path)
