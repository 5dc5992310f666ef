"""Vehicles of known drag fly in wind ahead and aside, and give it back: flights, fits, and how often intervals hold."""

from __future__ import annotations

import functools
import json
import math
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tests.unit.cli.commands import rotorid

from rotorid.data.record import STANDARD_UNITS, FlightRecord, Topic
from rotorid.identifying import identify
from rotorid.io import read
from rotorid.results import IdentifiedModel
from rotorid.signal.stamps import CLOCK_SAMPLES

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


@functools.cache
def planned(vehicle: str, plan: str, seed: int, duration_s: int) -> str:
    """A plan of random binary set-points, which every wind has."""
    sizes = [word for size in PLANS[vehicle][plan] for word in ("--amplitude", size)]
    model = ("--model", "response.second_order_delay")
    with tempfile.TemporaryDirectory() as folder:
        made = rotorid(
            *("design", "binary", "--vehicle", vehicle, *model, *sizes, "--duration", str(duration_s)),
            *("--seed", str(seed), "--out", folder),
        )
        assert made.code in (0, 1), made.err
        return (Path(folder) / "plan.json").read_text()


def flown(flight: DragFlight, folder: Path) -> Path:
    """The log of a flight in a folder."""
    plan: Path | str = "everyday"
    length: tuple[str, ...] = ("--duration", str(flight.duration_s))
    if PLANS[flight.vehicle][flight.plan]:
        (folder / "plan").mkdir()
        plan, length = folder / "plan" / "plan.json", ()
        plan.write_text(planned(flight.vehicle, flight.plan, flight.seed, flight.duration_s))
    wind, gusts = WINDS[flight.wind]
    ran = rotorid(
        *("simulate", flight.vehicle, "--plan", plan, *length, "--wind", wind, "--turbulence", gusts),
        *("--seed", str(flight.seed), "--out", folder, "--json"),
    )
    assert ran.code == 0, ran.err
    return folder / json.loads(ran.out)["logs"][0]["file"]


def with_clocks(record: FlightRecord, rng: np.random.Generator) -> FlightRecord:
    """A log whose angles and speeds have clocks of their own, off by what is usual, which intervals are to hold."""
    return replace(record, topics=tuple(late for topic in record.topics for late in _by_clocks(topic, rng)))


def _by_clocks(topic: Topic, rng: np.random.Generator) -> Iterator[Topic]:
    units = [STANDARD_UNITS.get(channel.name, "") for channel in topic.channels]
    for unit in dict.fromkeys("m/s" if unit == "m" else unit for unit in units):
        rows = [row for row, own in enumerate(units) if own == unit or (unit, own) == ("m/s", "m")]
        late_s = CLOCK_SAMPLES * float(np.median(np.diff(topic.time_s))) * rng.standard_normal()
        channels = tuple(topic.channels[row] for row in rows)
        yield replace(topic, time_s=topic.time_s + late_s, channels=channels, values=topic.values[rows])


def identified(flight: DragFlight, model: str = "drag.linear", *, clocks: bool = False) -> IdentifiedModel:
    """A flight, identified without choices; on request with clocks that are off (:func:`with_clocks`)."""
    with tempfile.TemporaryDirectory() as folder:
        record = read(flown(flight, Path(folder)))
        rng = np.random.default_rng([flight.seed, *flight.plan.encode()])
        return identify([with_clocks(record, rng) if clocks else record], model)


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
    """Error, stated deviation and truth of both coefficients, by a log whose clocks are off."""
    found = identified(flight, clocks=True)
    return [
        (found[name].value - truth, float(found[name].std or 0.0), truth)
        for name, truth in DRAG[flight.vehicle].items()
    ]
