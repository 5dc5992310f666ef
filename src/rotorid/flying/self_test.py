"""A flight made, written, read back and identified: a test of an installation in a few seconds."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path

from rotorid.flying.examples import EXAMPLES, Example
from rotorid.flying.simulation import truth_of
from rotorid.identifying.identification import identify
from rotorid.settings.identifying import IdentifySettings

MODEL = "rate.roll"
PARAMETERS = ("L_roll", "T_motor")


@dataclass(frozen=True, kw_only=True)
class Found:
    """A parameter as identified, with its standard deviation, and as it flew, in the unit of its model."""

    value: float
    std: float
    truth: float
    unit: str

    @property
    def off(self) -> float:
        """How far it lies from the truth, in its own standard deviations."""
        return (self.value - self.truth) / self.std


def self_test() -> dict[str, Found]:
    """Fly 30 s of a sweep of roll with PX4's simulated quadrotor, write the log, read it, identify it.

    Returns
    -------
    dict
        Parameter to what was found of it.

    Raises
    ------
    RotoridError, InsufficientDataError
        Something does not work.
    """
    from rotorid.flying.simulation import fly_run
    from rotorid.io.folders import scratch_folder
    from rotorid.io.registry import read, write_log
    from rotorid.vehicles.catalog import aircraft

    whole = EXAMPLES["px4"]
    short = Example(
        name="self-test",
        about="",
        vehicle=whole.vehicle,
        file=whole.file,
        next=(),
        sweeps={"roll": whole.sweeps["roll"]},
        doublets={"roll": whole.doublets["roll"]},
        entry=whole.entry,
        duration_s=30.0,
    )
    with scratch_folder() as folder:
        log = Path(folder) / whole.file
        write_log(log, fly_run(short.choices(), 0).flown, format="ulg")
        model = identify([read(log)], MODEL, settings=IdentifySettings())
    truth = truth_of(aircraft(whole.vehicle))
    found = {}
    for name in PARAMETERS:
        parameter = model.parameters[name]
        found[name] = Found(
            value=parameter.value, std=parameter.std or 0.0, truth=truth[name].value, unit=parameter.unit
        )
    return found


def main() -> None:
    """Print what was found, as a line of JSON."""
    found = self_test()
    summary = {name: {**vars(item), "off": item.off} for name, item in found.items()}
    sys.stdout.write(json.dumps(summary) + "\n")
