"""Do intervals of ``physical.flight`` hold, and are they sharp? Twins of fast flights, identified from their logs.

``python -m tests.twins.flight_coverage --out FILE`` flies, identifies each flight alone, with another of its vehicle
and without its velocity, writes numbers against truth as lines of JSON and prints a table of all lines of the file;
``--dev`` takes winds of development. What is known is what an owner knows: mass, rotors, inertia of yaw. All flights of
a twin have the same truth, so that random errors alone are to be sharp; what is stated contains the scatter of real
vehicles between flights too.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tests.twins.flight_flights import AIR, DISC_M2, Case, FlightTwin, twin
from tests.unit.identifying.flight_logs import layout_file, without

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.models.flight import hover_thrust

VELOCITY = ("velocity_north", "velocity_east", "velocity_down")
DEV_WINDS = ((0.0, 0.0, 0.2), (3.0, -2.0, 0.4))
WINDS = ((-1.0, 2.0, 0.3), (2.0, 4.0, 0.5), (0.5, -0.5, 0.1))
MISSIONS = ("eights", "steps", "climbs", "slow")
KINDS = ("alone", "pairs", "no velocity")
TWO_SIDED = 1.96


class Group(NamedTuple):
    """Flights of one vehicle that are identified together.

    Parameters
    ----------
    cases
        What flies.
    velocity
        Whether their logs hold it.
    """

    cases: tuple[Case, ...]
    velocity: bool = True

    @property
    def kind(self) -> str:
        """One of :data:`KINDS`."""
        return KINDS[2] if not self.velocity else KINDS[len(self.cases) - 1]


class Judged(NamedTuple):
    """A number against its truth."""

    vehicle: str
    missions: str
    motors: str
    terms: str
    velocity: bool
    flights: int
    seed: int
    name: str
    truth: float
    value: float
    std: float
    random: float


def truths(flown: FlightTwin) -> dict[str, float]:
    """What is true of a twin, numbers of hover too."""
    hover = hover_thrust(flown.truth, flown.frame)
    return {
        **flown.truth,
        "hover.speed": hover.speed,
        "hover.thrust_coefficient": hover.coefficient,
        "hover.thrust_slope": hover.slope_n,
        "hover.drag": flown.frame.rotors * flown.truth["k_d"] * hover.speed / flown.frame.mass_kg,
    }


def judge(group: Group) -> list[Judged]:
    """The numbers of some flights; none where they are refused."""
    flights = [twin(case) for case in group.cases]
    first, case = flights[0], group.cases[0]
    records = [flown.record if group.velocity else without(flown.record, *VELOCITY) for flown in flights]
    truth = truths(first)
    with tempfile.TemporaryDirectory() as folder:
        try:
            found = rotorid.identify(
                records,
                "physical.flight",
                layout=str(layout_file(Path(folder), first.layout)),
                rotor_diameter_m=2.0 * math.sqrt(DISC_M2[case.vehicle] / math.pi),
                fix={"m": truth["m"], "I_zz": truth["I_zz"]},
            )
        except InsufficientDataError as error:
            print(f"{group}: {error}", file=sys.stderr)
            return []
    numbers = {name: (p.value, p.std, p.std_random) for name, p in found.parameters.items() if p.status == "free"}
    assert found.flight is not None
    numbers |= {f"hover.{name}": (p.value, p.std, 0.0) for name, p in found.flight.hover.items()}
    missions = "+".join(one.mission for one in group.cases)
    key = (case.vehicle, missions, case.motors, case.terms, group.velocity, len(flights), case.seed)
    return [
        Judged(*key, name, truth.get(name, 0.0), value, float(std or 0.0), float(random or 0.0))
        for name, (value, std, random) in numbers.items()
        if name in truth or not name.startswith("hover.")
    ]


def groups(winds: Sequence[tuple[float, float, float]], seeds: Iterable[int]) -> Iterator[Group]:
    """Flights of all vehicles alone, and in pairs; one mission after the other, so that a part is balanced."""
    for seed in seeds:
        for at, mission in enumerate(MISSIONS):
            for place, vehicle in enumerate(AIR):
                wind = winds[(place + at + seed) % len(winds)]
                for motors in ("speeds", "outputs"):
                    one = Case(vehicle, mission, motors, wind, "basic", seed)  # type: ignore[arg-type]
                    other = one._replace(
                        mission=MISSIONS[(at + 1) % 3], seed=seed + 500, wind=winds[(place + at) % len(winds)]
                    )
                    yield Group((one,))
                    yield Group((one, other))
                    yield Group((one,), velocity=False)


class Cell(NamedTuple):
    """How numbers lie to their truth.

    Parameters
    ----------
    numbers
        How many.
    inside
        Share of stated intervals with the truth in them.
    rms
        Of error over random error.
    ratio
        Median random error over median error; both over the size of the number.
    stated_rms
        Of error over stated error.
    """

    numbers: int
    inside: float
    rms: float
    ratio: float
    stated_rms: float

    def __str__(self) -> str:
        share = f"{100.0 * self.inside:.1f} %".replace("100.0", "100")
        return f"{share}, {self.rms:.2f}, {self.ratio:.1f}, {self.stated_rms:.2f}"


def cell(rows: Sequence[Judged]) -> Cell:
    """Some numbers together; random errors without hover, which has none, and without thrust that is tied.

    Slow flights tie inflow to thrust, as usual: that is no random error of ``c_2``, nor of ``kappa`` over it.
    """
    errors = np.array([row.value - row.truth for row in rows])
    stds = np.array([row.std for row in rows])
    noisy = [row for row in rows if row.random and not (row.missions == "slow" and row.name in ("c_2", "kappa"))]
    left = np.array([row.value - row.truth for row in noisy])
    random = np.array([row.random for row in noisy])
    size = np.array([abs(row.truth or row.value) for row in noisy])
    return Cell(
        len(rows),
        float(np.mean(np.abs(errors) <= TWO_SIDED * stds)),
        float(np.sqrt(np.mean((left / random) ** 2))) if noisy else math.nan,
        float(np.median(random / size) / np.median(np.abs(left) / size)) if noisy else math.nan,
        float(np.sqrt(np.mean((errors / stds) ** 2))),
    )


def table(rows: Sequence[Judged]) -> str:
    """Cells by vehicle, what is logged of the motors, and kind."""
    found: dict[tuple[str, ...], list[Judged]] = {}
    for row in rows:
        kind = KINDS[2] if not row.velocity else KINDS[row.flights - 1]
        for vehicle in (row.vehicle, "all"):
            found.setdefault((vehicle, row.motors, kind), []).append(row)
    return "\n".join(f"{', '.join(key)}: {len(some)}: {cell(some)}" for key, some in sorted(found.items()))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--dev", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--motors", nargs="*", default=["speeds", "outputs"])
    parser.add_argument("--kinds", nargs="*", choices=KINDS, default=KINDS)
    parser.add_argument("--seeds", type=int, nargs="*", default=[0])
    given = parser.parse_args()
    chosen = list(groups(DEV_WINDS if given.dev else WINDS, given.seeds))
    chosen = [one for one in chosen if one.cases[0].motors in given.motors and one.kind in given.kinds]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool, given.out.open("a") as file:
        for rows in pool.map(judge, chosen):
            for row in rows:
                file.write(json.dumps(row) + "\n")
            file.flush()
    print(table([Judged(*json.loads(line)) for line in given.out.read_text().splitlines()]))


if __name__ == "__main__":
    main()
