"""Do intervals of ``physical.flight`` hold, and are they sharp? Twins of fast flights, identified from their logs.

``python -m tests.twins.flight_coverage --out FILE`` flies, identifies each flight alone, with another of its vehicle
and without its velocity, and writes numbers against truth as lines of JSON; ``--dev`` takes winds of development. What
is known is what an owner knows: mass, rotors, inertia of yaw. All flights of a twin have the same truth, so that random
errors alone are to be sharp; what is stated contains the scatter of real vehicles between flights too.
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

from tests.twins.flight_flights import AIR, DISC_M2, Case, FlightTwin, twin
from tests.unit.identifying.flight_logs import layout_file, without

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.models.flight import hover_thrust

VELOCITY = ("velocity_north", "velocity_east", "velocity_down")
DEV_WINDS = ((0.0, 0.0, 0.2), (3.0, -2.0, 0.4))
WINDS = ((-1.0, 2.0, 0.3), (2.0, 4.0, 0.5), (0.5, -0.5, 0.1))
MISSIONS = ("eights", "steps", "climbs", "slow")
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
    """Flights of all vehicles alone, and in pairs."""
    for seed in seeds:
        for place, vehicle in enumerate(AIR):
            for at, mission in enumerate(MISSIONS):
                wind = winds[(place + at + seed) % len(winds)]
                for motors in ("speeds", "outputs"):
                    one = Case(vehicle, mission, motors, wind, "basic", seed)  # type: ignore[arg-type]
                    other = one._replace(
                        mission=MISSIONS[(at + 1) % 3], seed=seed + 500, wind=winds[(place + at) % len(winds)]
                    )
                    yield Group((one,))
                    yield Group((one, other))
                    yield Group((one,), velocity=False)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--dev", action="store_true")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--motors", nargs="*", default=["speeds", "outputs"])
    parser.add_argument("--alone", action="store_true")
    parser.add_argument("--seeds", type=int, nargs="*", default=[0])
    given = parser.parse_args()
    chosen = list(groups(DEV_WINDS if given.dev else WINDS, given.seeds))
    chosen = [one for one in chosen if one.cases[0].motors in given.motors]
    if given.alone:
        chosen = [one for one in chosen if len(one.cases) == 1 and one.velocity]
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool, given.out.open("a") as file:
        for rows in pool.map(judge, chosen):
            for row in rows:
                file.write(json.dumps(row) + "\n")
            file.flush()


if __name__ == "__main__":
    main()
