"""Do intervals of 95 % hold? Flights of vehicles of the library, identified as their owners would, against the truth.

True is the exact linearization in hover, with what a flight makes of it:

- rotors whose thrust is quadratic in what is commanded have the slope at the mean command, and the mean command of a
  sweep that holds the height is lower than that of hover;
- rotors that speed up and slow down differently show fast motion a shorter lag than the mean of the two.

Reported apart, because nothing true is known of them: drag and speed derivatives of ArduPilot's vehicle (quadratic
drag has no slope at rest), couplings of zero in steady wind, and rate models of the S500, without what turns it.

``python -m tests.twins.coverage FOLDER`` flies and identifies, goes on where it was interrupted, and prints the table.
"""

from __future__ import annotations

import json
import os
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom
from tests.twins.motor_twins import VEHICLES, Twin, twin

import rotorid
from rotorid.data.record import FlightRecord
from rotorid.errors import InsufficientDataError
from rotorid.flying.settings import SimulateSettings
from rotorid.flying.simulation import truth_of
from rotorid.identifying.identification import identify_motors

WEATHERS = ("calm", "wind")
RATE = tuple(f"rate.{axis}" for axis in ("roll", "pitch", "yaw", "vertical"))
AXIS = tuple(f"axis.{axis}" for axis in ("roll", "pitch", "yaw"))
HOVER = ("hover.lateral", "hover.longitudinal")
MOTORS = "physical.motors"
FAMILIES = ("rate", "axis", "hover", "physical")
SLOPES_OF_SPEED = ("X_u", "Y_v", "Z_w", "M_u", "L_v")
QUADRATIC_THRUST = ("crazyflie", "hummingbird", "iris", "x500")
TWO_SIDED = 1.96


class Case(NamedTuple):
    """One identification of one flight."""

    vehicle: str
    weather: str
    seed: int
    model: str
    reduced: bool

    @property
    def family(self) -> str:
        return self.model.partition(".")[0]


class Judged(NamedTuple):
    """A parameter of one identification against its truth."""

    case: Case
    name: str
    truth: float
    value: float
    std: float
    std_random: float

    @property
    def ratio(self) -> float:
        return (self.value - self.truth) / self.std


class Refused(NamedTuple):
    """An identification that was refused, and why."""

    case: Case
    kinds: tuple[str, ...]
    message: str


class Dropped(NamedTuple):
    """A parameter that was left out although it is not zero."""

    case: Case
    name: str
    truth: float


def flown_truth(vehicle: str, record: FlightRecord) -> dict[str, float]:
    """What one flight shows of its vehicle."""
    craft = SimulateSettings(vehicle=vehicle).aircraft
    truth = {name: true.value for name, true in truth_of(craft).items()}
    rotors = craft.vehicle.rotors
    if rotors.lag_down_s and rotors.lag_down_s != rotors.lag_up_s:
        apart = (rotors.lag_up_s - rotors.lag_down_s) / (rotors.lag_up_s + rotors.lag_down_s)
        truth["T_motor"] *= 1.0 - (1.0 - 8.0 / np.pi**2) * apart**2
    if vehicle in QUADRATIC_THRUST:
        thrust = record["thrust_command"]
        sweep = rotorid.find_excitations(record, "thrust")[0]
        inside = (thrust.time_s >= sweep.start_s) & (thrust.time_s <= sweep.stop_s)
        before = (thrust.time_s >= sweep.start_s - 2.0) & (thrust.time_s < sweep.start_s)
        truth["Z_thrust"] *= float(np.mean(thrust.values[inside]) / np.mean(thrust.values[before]))
    return truth


def is_known(case: Case, name: str, truth: float) -> bool:
    """Whether anything true is known of a parameter of a flight."""
    if case.vehicle == "ardupilot_quad" and name in SLOPES_OF_SPEED:
        return False
    return not (case.weather == "wind" and truth == 0.0)


def is_judged(vehicle: str, family: str) -> bool:
    """Whether the models of a kind can be right for a vehicle at all."""
    return (vehicle, family) != ("s500", "rate")


def cases_of(vehicle: str, weather: str, seed: int) -> Iterator[Case]:
    """Every identification of one flight."""
    for model in (*RATE, *AXIS, *HOVER, MOTORS):
        if is_judged(vehicle, model.partition(".")[0]):
            yield Case(vehicle, weather, seed, model, reduced=False)
    for model in HOVER:
        yield Case(vehicle, weather, seed, model, reduced=True)


def judge(case: Case, flight: Twin, truth: Mapping[str, float]) -> list[Judged | Refused | Dropped]:
    """One identification, parameter by parameter."""
    try:
        if case.model == MOTORS:
            model = identify_motors([flight.record], flight.choices)
            assert model.motors is not None
            found: dict[str, Any] = {**model.motors.derived, **model.parameters}
            truth = dict(flight.truth)
            if not {"I_xx", "I_yy"} & set(found) and "tau_gyro" in truth:
                # Where yaw alone is known, the delay is that of yaw.
                truth["tau_gyro"] = truth["tau_gyro_yaw"]
        else:
            found = dict(rotorid.identify(flight.record, case.model, reduce=case.reduced).parameters)
    except InsufficientDataError as error:
        kinds = tuple(sorted({finding.kind for finding in error.findings}))
        return [Refused(case, kinds, str(error))]
    rows: list[Judged | Refused | Dropped] = []
    for name, known in truth.items():
        if name not in found or not is_known(case, name, known):
            continue
        parameter = found[name]
        status = getattr(parameter, "status", "free")
        if parameter.std and status in ("free", "derived"):
            random = getattr(parameter, "std_random", None) or parameter.std
            rows.append(Judged(case, name, known, parameter.value, parameter.std, random))
        elif status == "dropped" and known != 0.0:
            rows.append(Dropped(case, name, known))
    return rows


def fly(vehicle: str, weather: str, seed: int) -> list[dict[str, Any]]:
    """One flight, all its identifications, as rows that can be kept in a file."""
    with tempfile.TemporaryDirectory() as folder:
        flight = twin(vehicle, weather, seed, Path(folder))
        truth = flown_truth(vehicle, flight.record)
        rows = [row for case in cases_of(vehicle, weather, seed) for row in judge(case, flight, truth)]
    return [{"row": type(row).__name__, **row._asdict()} for row in rows]


class Study(NamedTuple):
    """All that was judged."""

    judged: list[Judged]
    refused: list[Refused]
    dropped: list[Dropped]
    flights: frozenset[tuple[str, str, int]]

    def of(self, vehicle: str, family: str, reduced: bool = False) -> list[Judged]:
        return [
            row
            for row in self.judged
            if (row.case.vehicle, row.case.family, row.case.reduced) == (vehicle, family, reduced)
        ]

    def refusals(self, vehicle: str, family: str, reduced: bool = False) -> list[Refused]:
        return [
            row
            for row in self.refused
            if (row.case.vehicle, row.case.family, row.case.reduced) == (vehicle, family, reduced)
        ]

    def share_refused(self, vehicle: str, family: str, reduced: bool = False) -> float:
        """Of the identifications of a vehicle by models of a kind."""
        flights = sum(flight[0] == vehicle for flight in self.flights)
        models = {"rate": RATE, "axis": AXIS, "hover": HOVER, "physical": (MOTORS,)}[family]
        return len(self.refusals(vehicle, family, reduced)) / (flights * len(models))


def held(rows: Sequence[Judged]) -> float:
    """Share of intervals that hold what is true."""
    return float(np.mean([abs(row.ratio) <= TWO_SIDED for row in rows]))


def size(rows: Sequence[Judged]) -> float:
    """Root mean square of error over what is stated."""
    return float(np.sqrt(np.mean([row.ratio**2 for row in rows])))


def width(rows: Sequence[Judged]) -> float:
    """What is stated over what the error is: of every parameter its median deviation by its rms error, their median."""
    return float(
        np.median(
            [
                np.median([row.std for row in of]) / np.sqrt(np.mean([(row.value - row.truth) ** 2 for row in of]))
                for of in by_parameter(rows).values()
            ]
        )
    )


def by_parameter(rows: Iterable[Judged]) -> dict[tuple[str, str], list[Judged]]:
    """The judged of each model's parameter."""
    found: dict[tuple[str, str], list[Judged]] = {}
    for row in rows:
        found.setdefault((row.case.model, row.name), []).append(row)
    return found


def too_few_hold(rows: Sequence[Judged], *, promised: float = 0.9, risk: float = 0.01) -> bool:
    """Whether the count of intervals that hold rejects that ``promised`` of them do."""
    holding = sum(abs(row.ratio) <= TWO_SIDED for row in rows)
    return bool(binom.cdf(holding, len(rows), promised) < risk)


def study(folder: Path, seeds: Iterable[int], *, vehicles: Sequence[str] = VEHICLES, workers: int = 2) -> Study:
    """Fly what the folder does not hold yet, and read all of it."""
    folder.mkdir(parents=True, exist_ok=True)
    flights = [(vehicle, weather, seed) for seed in seeds for vehicle in vehicles for weather in WEATHERS]
    files = {flight: folder / "-".join(map(str, (*flight, "rows.json"))) for flight in flights}
    missing = [flight for flight, file in files.items() if not file.exists()]
    if missing:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            running = {pool.submit(fly, *flight): flight for flight in missing}
            for done in as_completed(running):
                whole = files[running[done]]
                part = whole.with_suffix(".part")
                part.write_text(json.dumps(done.result()), encoding="utf-8")
                part.replace(whole)
    kinds: Mapping[str, type[Judged | Refused | Dropped]] = {
        "Judged": Judged,
        "Refused": Refused,
        "Dropped": Dropped,
    }
    rows: list[Any] = []
    for file in files.values():
        for row in json.loads(file.read_text(encoding="utf-8")):
            kind = kinds[row.pop("row")]
            rows.append(kind(**row | {"case": Case(*row["case"])}))
    return Study(
        judged=[row for row in rows if isinstance(row, Judged)],
        refused=[row for row in rows if isinstance(row, Refused)],
        dropped=[row for row in rows if isinstance(row, Dropped)],
        flights=frozenset(flights),
    )


def table(found: Study) -> Iterator[str]:
    """Of every vehicle and family: how many hold, how large errors are by what is stated, how wide, and who misses."""
    yield "| vehicle | models | flights | refused | held | error/stated | stated/error | parameters that miss |"
    yield "|---|---|---|---|---|---|---|---|"
    for vehicle in dict.fromkeys(vehicle for vehicle, _, _ in sorted(found.flights)):
        flown = sum(flight[0] == vehicle for flight in found.flights)
        for family, reduced in (*((family, False) for family in FAMILIES), ("hover", True)):
            rows = found.of(vehicle, family, reduced)
            if not rows:
                continue
            refused = 100.0 * found.share_refused(vehicle, family, reduced)
            misses = [
                f"{model} {name} {100.0 * held(of):.0f} %"
                for (model, name), of in by_parameter(rows).items()
                if too_few_hold(of)
            ]
            label = f"{family}{', reduced' if reduced else ''}"
            yield (
                f"| {vehicle} | {label} | {flown} | {refused:.0f} % | {100.0 * held(rows):.1f} % | {size(rows):.2f} "
                f"| {width(rows):.1f} | {'; '.join(misses)} |"
            )


def main() -> None:
    folder = Path(sys.argv[1])
    seeds = range(1, 1 + int(sys.argv[2])) if len(sys.argv) > 2 else range(1, 16)
    vehicles = tuple(sys.argv[3].split(",")) if len(sys.argv) > 3 else VEHICLES
    found = study(folder, seeds, vehicles=vehicles)
    print(*table(found), sep="\n")
    for row in found.refused:
        print(*row.case, row.kinds, row.message)


if __name__ == "__main__":
    main()
