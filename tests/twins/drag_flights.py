"""Vehicles of known drag fly in wind ahead and aside, and give it back: flights, fits, and how often intervals hold."""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tests.unit.cli.commands import rotorid

from rotorid.identifying import identify
from rotorid.io import read
from rotorid.results import IdentifiedModel

DRAG: dict[str, dict[str, float]] = {"bebop": {"k_Dx": 0.25, "k_Dy": 0.33}, "px4_quad": {"k_Dx": 1.0, "k_Dy": 1.0}}
"""Of the simulated vehicles over mass, 1/s."""

PLANS: dict[str, dict[str, tuple[str, ...]]] = {
    "bebop": {
        "even": ("roll=0.1", "pitch=0.1", "thrust=0.5"),
        "little climb": ("roll=0.08", "pitch=0.1", "thrust=0.3"),
        "little pitch": ("roll=0.1", "pitch=0.06", "thrust=0.5"),
    },
    "px4_quad": {"everyday": ()},
}
"""Random binary set-points by their sizes; sticks of an ordinary flight."""

WINDS: dict[str, tuple[str, str]] = {
    "still air": ("0,0", "0"),
    "ahead": ("2,0", "0.2"),
    "aside": ("0,2", "0.2"),
    "aslant, gusts": ("1.5,1.5", "0.4"),
    "from behind, gusts": ("-2,1", "0.7"),
}
"""Wind to north and east, and gusts, m/s; all head north."""


class DragFlight(NamedTuple):
    """What is flown."""

    vehicle: str
    plan: str
    wind: str
    seed: int
    duration_s: int = 45


def flown(flight: DragFlight, folder: Path) -> Path:
    """The log of a flight in a folder."""
    sizes = [word for size in PLANS[flight.vehicle][flight.plan] for word in ("--amplitude", size)]
    plan: Path | str = "everyday"
    length: tuple[str, ...] = ("--duration", str(flight.duration_s))
    if sizes:
        model = ("--model", "response.second_order_delay")
        made = rotorid(
            *("design", "binary", "--vehicle", flight.vehicle, *model, *sizes, *length),
            *("--seed", str(flight.seed), "--out", folder / "plan"),
        )
        assert made.code in (0, 1), made.err
        plan, length = folder / "plan" / "plan.json", ()
    wind, gusts = WINDS[flight.wind]
    ran = rotorid(
        *("simulate", flight.vehicle, "--plan", plan, *length, "--wind", wind, "--turbulence", gusts),
        *("--seed", str(flight.seed), "--out", folder, "--json"),
    )
    assert ran.code == 0, ran.err
    return folder / json.loads(ran.out)["logs"][0]["file"]


def identified(flight: DragFlight, model: str = "drag.linear") -> IdentifiedModel:
    """A flight, identified without choices."""
    with tempfile.TemporaryDirectory() as folder:
        return identify([read(flown(flight, Path(folder)))], model)


class Judged(NamedTuple):
    """How often intervals hold the truth.

    Parameters
    ----------
    intervals
        How many.
    inside
        Share of intervals of 95 % that hold the truth.
    rms
        Of errors over stated deviations.
    sharpness
        Median of stated deviations over errors; 1.48 is that of a normal error.
    median_error, median_std
        Relative to the truth.
    """

    intervals: int
    inside: float
    rms: float
    sharpness: float
    median_error: float
    median_std: float


def judged(errors: Iterable[tuple[float, float, float]]) -> Judged:
    """Errors, stated deviations and true values of intervals."""
    error, std, truth = np.array(list(errors)).T
    return Judged(
        intervals=int(error.size),
        inside=float(np.mean(np.abs(error) <= 1.96 * std)),
        rms=math.sqrt(float(np.mean((error / std) ** 2))),
        sharpness=float(np.median(std / np.abs(error))),
        median_error=float(np.median(np.abs(error / truth))),
        median_std=float(np.median(std / truth)),
    )


def errors_of(flight: DragFlight) -> list[tuple[float, float, float]]:
    """Error, stated deviation and truth of both coefficients."""
    found = identified(flight)
    return [
        (found[name].value - truth, float(found[name].std or 0.0), truth)
        for name, truth in DRAG[flight.vehicle].items()
    ]
