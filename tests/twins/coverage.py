"""Do intervals of 95 % hold, and are they sharp? Flights of the library's vehicles, identified as their owners would.

``python -m tests.twins.coverage FOLDER`` flies what the folder does not hold yet (logs are kept, and flown once),
identifies what this version of the program has not identified yet, and prints the tables; interrupted, it goes on where
it was. ``--vehicles``, ``--weathers``, ``--seeds`` and ``--models`` select: a flight takes half a minute.
``--before LABEL`` prints another version's rows first.

All parameters are judged, those that are zero or dropped too. What is true of a flight: see
:mod:`tests.twins.coverage_flights`. A dropped parameter is the statement that it is zero, with the deviation that is
stated for it; without one it is *silent*, and counted apart.

Flights are counted beside intervals: intervals of one flight share its noise, its wind and its sweeps. The standard
error of a share is that over flights.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom
from tests.twins.coverage_flights import BEHIND_SETPOINTS, DEV_SEEDS, DEV_WEATHERS, KeptFlight, fly, read_flight
from tests.twins.motor_twins import VEHICLES

import rotorid
from rotorid.errors import InsufficientDataError
from rotorid.identifying.identification import identify_motors

RATE = tuple(f"rate.{axis}" for axis in ("roll", "pitch", "yaw", "vertical"))
AXIS = tuple(f"axis.{axis}" for axis in ("roll", "pitch", "yaw"))
HOVER = ("hover.lateral", "hover.longitudinal")
REDUCED = tuple(f"{model}/reduced" for model in HOVER)
MOTORS = "physical.motors"
DRAG = ("drag.linear",)
MODELS = (*RATE, *AXIS, *HOVER, *REDUCED, MOTORS, *DRAG)
KINDS: Mapping[str, tuple[str, ...]] = {
    "rate": RATE,
    "axis": AXIS,
    "hover": HOVER,
    "reduced": REDUCED,
    "motors": (MOTORS,),
    "drag": DRAG,
}
FLOWN = (*VEHICLES, BEHIND_SETPOINTS)
WRONG_STRUCTURES = frozenset({("s500", "rate"), ("s500", "axis")})
"""What turns the S500 beside one axis has no place in these models: ``structure_error`` is right."""
TWO_SIDED = 1.96
BLUNT = 0.005
"""Median error over the value above which errors, below which half a percent, say how wide an interval may be."""
WIDEST, FINEST = 1.8, 0.007
"""Most of stated over error (median, 1.48 for normal errors), and of stated over the value where errors are tiny."""


class Case(NamedTuple):
    """One identification of one flight."""

    vehicle: str
    weather: str
    seed: int
    model: str

    @property
    def flight(self) -> tuple[str, str, int]:
        return self[:3]

    @property
    def kind(self) -> str:
        return next(kind for kind, models in KINDS.items() if self.model in models)


class Judged(NamedTuple):
    """A parameter of one identification against its truth; ``std`` is missing where a dropped one states none."""

    case: Case
    name: str
    truth: float
    value: float
    std: float | None
    std_random: float | None
    status: str

    @property
    def ratio(self) -> float:
        """Error over stated deviation."""
        assert self.std
        return (self.value - self.truth) / self.std

    @property
    def holds(self) -> bool:
        return abs(self.ratio) <= TWO_SIDED


class Identified(NamedTuple):
    """An identification that ended: whether it was refused, and its findings."""

    case: Case
    refused: bool
    findings: tuple[str, ...]
    message: str = ""


class Study(NamedTuple):
    """All that was judged."""

    judged: tuple[Judged, ...]
    identified: tuple[Identified, ...]
    moved: Mapping[tuple[str, str], tuple[float, ...]]
    """Of each vehicle and parameter, what flights show over what is true of hover in still air."""

    @property
    def flights(self) -> frozenset[tuple[str, str, int]]:
        return frozenset(run.case.flight for run in self.identified)

    @property
    def intervals(self) -> list[Judged]:
        """Parameters of which an interval is stated."""
        return [row for row in self.judged if row.std]

    @property
    def silent(self) -> list[Judged]:
        """Parameters that were dropped without a deviation."""
        return [row for row in self.judged if not row.std]

    def where(self, wanted: Callable[[Case], bool]) -> Study:
        """The part of some cases."""
        return Study(
            judged=tuple(row for row in self.judged if wanted(row.case)),
            identified=tuple(run for run in self.identified if wanted(run.case)),
            moved=self.moved,
        )

    def cell(self, vehicle: str, kind: str) -> Study:
        """The part of a vehicle and a kind of model."""
        return self.where(lambda case: (case.vehicle, case.kind) == (vehicle, kind))

    @property
    def share_refused(self) -> float:
        """Share of identifications that were refused."""
        return float(np.mean([run.refused for run in self.identified]))

    def share_with(self, kind: str) -> float:
        """Share of the identifications that ended, with a finding of a kind; zero where none ended."""
        ended = [kind in run.findings for run in self.identified if not run.refused]
        return float(np.mean(ended)) if ended else 0.0


class Share(NamedTuple):
    """A share of intervals, and its standard error over flights (missing for one flight)."""

    value: float
    error: float

    def __str__(self) -> str:
        return f"{100.0 * self.value:.1f} ± {100.0 * self.error:.1f} %"


def models_of(vehicle: str, models: Iterable[str]) -> list[str]:
    """Those of some models that a vehicle's log is for."""
    return [model for model in models if (model in DRAG) == (vehicle == BEHIND_SETPOINTS)]


def judge(case: Case, flight: KeptFlight) -> list[Judged | Identified]:
    """One identification, parameter by parameter."""
    model, _, reduced = case.model.partition("/")
    truth = dict(flight.truth)
    try:
        if model == MOTORS:
            result = identify_motors([flight.record], flight.choices)
            assert result.motors is not None
            found: dict[str, Any] = {**result.motors.derived, **result.parameters}
            truth = dict(flight.motors)
            if not {"I_xx", "I_yy"} & set(found) and "tau_gyro" in truth:
                # Where yaw alone is known, the delay is that of yaw.
                truth["tau_gyro"] = truth["tau_gyro_yaw"]
        else:
            result = rotorid.identify(flight.record, model, reduce=bool(reduced))
            found = dict(result.parameters)
            if model in RATE:
                truth |= flight.rate_damping
    except InsufficientDataError as error:
        return [Identified(case, True, tuple(sorted({finding.kind for finding in error.findings})), str(error))]
    rows: list[Judged | Identified] = [
        Identified(case, False, tuple(sorted({finding.kind for finding in result.findings})))
    ]
    for name in truth.keys() & found.keys():
        parameter = found[name]
        status = getattr(parameter, "status", "derived")
        if status == "dropped" or (parameter.std and status in ("free", "derived")):
            random = getattr(parameter, "std_random", None)
            rows.append(Judged(case, name, truth[name], parameter.value, parameter.std, random, status))
    return rows


@cache
def version() -> str:
    """Short hash of the program's source: rows of one version are never taken for those of another."""
    code = hashlib.sha256()
    for file in sorted(Path(rotorid.__file__).parent.rglob("*")):
        if file.suffix in (".py", ".toml"):
            code.update(file.read_bytes())
    return code.hexdigest()[:10]


def identify_flight(
    folder: Path, flight: tuple[str, str, int], models: Sequence[str], label: str
) -> dict[str, list[dict[str, Any]]]:
    """Fly what was not flown, identify what was not identified, and keep the rows: model to rows."""
    vehicle, weather, seed = flight
    kept = fly(folder / "flights", *flight)
    rows_file = folder / f"rows-{label}" / kept.name
    rows = json.loads(rows_file.read_text(encoding="utf-8")) if rows_file.exists() else {}
    models = models_of(vehicle, models)
    missing = [model for model in models if model not in rows]
    if missing:
        read = read_flight(kept, vehicle)
        for model in missing:
            judged = judge(Case(vehicle, weather, seed, model), read)
            rows[model] = [{"row": type(row).__name__, **row._asdict()} for row in judged]
        rows_file.parent.mkdir(parents=True, exist_ok=True)
        part = rows_file.with_suffix(".part")
        part.write_text(json.dumps(rows), encoding="utf-8")
        part.replace(rows_file)
    return {model: rows[model] for model in models}


def study(
    folder: Path,
    *,
    vehicles: Sequence[str] = FLOWN,
    weathers: Sequence[str] = tuple(DEV_WEATHERS),
    seeds: Sequence[int] = DEV_SEEDS,
    models: Sequence[str] = MODELS,
    label: str | None = None,
    workers: int = 1,
) -> Study:
    """Fly and identify what the folder does not hold yet, and read all of it.

    With a ``label`` the rows go by that name instead of the version's: a state that is to be kept, such as *before*.
    """
    label = label or version()
    flights = [(vehicle, weather, seed) for seed in seeds for weather in weathers for vehicle in vehicles]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    if workers == 1:
        found = {flight: identify_flight(folder, flight, models, label) for flight in flights}
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            running = {pool.submit(identify_flight, folder, flight, models, label): flight for flight in flights}
            found = {running[done]: done.result() for done in as_completed(running)}
    return collected(folder, (row for flight in flights for rows in found[flight].values() for row in rows))


def kept_study(folder: Path, label: str) -> Study:
    """The rows of a version or label, whatever flights it has."""
    files = sorted((folder / f"rows-{label}").glob("*.json"))
    kept = (json.loads(file.read_text(encoding="utf-8")) for file in files)
    return collected(folder, (row for models in kept for rows in models.values() for row in rows))


def collected(folder: Path, kept: Iterable[dict[str, Any]]) -> Study:
    """Rows of files as a study."""
    judged: list[Judged] = []
    identified: list[Identified] = []
    for fields in kept:
        values = {name: value for name, value in fields.items() if name != "row"} | {"case": Case(*fields["case"])}
        if fields["row"] == "Judged":
            judged.append(Judged(**values))
        else:
            identified.append(Identified(**values | {"findings": tuple(values["findings"])}))
    moved: dict[tuple[str, str], tuple[float, ...]] = {}
    for vehicle, weather, seed in sorted({run.case.flight for run in identified}):
        flight = json.loads(fly(folder / "flights", vehicle, weather, seed).read_text(encoding="utf-8"))
        for name, exact in flight["exact"].items():
            if exact and flight["truth"][name] != exact:
                moved[vehicle, name] = (*moved.get((vehicle, name), ()), flight["truth"][name] / exact)
    return Study(judged=tuple(judged), identified=tuple(identified), moved=moved)


def held(rows: Sequence[Judged]) -> Share:
    """Share of intervals that hold what is true."""
    of_flights: dict[tuple[str, str, int], list[bool]] = {}
    for row in rows:
        of_flights.setdefault(row.case.flight, []).append(row.holds)
    holding = np.array([sum(holds) for holds in of_flights.values()], dtype=float)
    counts = np.array([len(holds) for holds in of_flights.values()], dtype=float)
    share, flights = holding.sum() / counts.sum(), counts.size
    scatter = np.sum((holding - share * counts) ** 2) * flights / (flights - 1) if flights > 1 else math.nan
    return Share(float(share), float(np.sqrt(scatter) / counts.sum()))


def size(rows: Sequence[Judged]) -> float:
    """Root mean square of error over what is stated."""
    return float(np.sqrt(np.mean([row.ratio**2 for row in rows])))


class Sharpness(NamedTuple):
    """How wide intervals are; a number is missing where no parameter is of its kind.

    Parameters
    ----------
    over_error
        Median of stated deviation over error, of the parameters whose median error is above half a percent of the
        value, and of those that are zero.
    over_value
        Median of stated deviation over value, of the others.
    too_wide
        Parameters that miss the bar of their kind, with that number.
    """

    over_error: float | None
    over_value: float | None
    too_wide: Mapping[tuple[str, str, str], float]

    @property
    def reaches(self) -> bool:
        return (self.over_error or 0.0) <= WIDEST and (self.over_value or 0.0) <= FINEST


def sharpness(rows: Sequence[Judged]) -> Sharpness:
    """Sharpness of the intervals of a cell, parameter by parameter and pooled."""
    over_error: list[float] = []
    over_value: list[float] = []
    too_wide = {}
    for key, of in by_parameter(rows).items():
        errors = np.array([abs(row.value - row.truth) for row in of])
        stds = np.array([row.std for row in of], dtype=float)
        truths = np.array([abs(row.truth) for row in of])
        if not truths.any() or np.median(errors) > BLUNT * np.median(truths):
            ratios, pool, bar = stds / np.maximum(errors, 1e-12), over_error, WIDEST
        else:
            ratios, pool, bar = stds / truths, over_value, FINEST
        pool += ratios.tolist()
        if np.median(ratios) > bar:
            too_wide[key] = float(np.median(ratios))
    return Sharpness(
        over_error=float(np.median(over_error)) if over_error else None,
        over_value=float(np.median(over_value)) if over_value else None,
        too_wide=too_wide,
    )


def wrong(part: Study) -> tuple[float, float]:
    """Wrong statements per flight: intervals that miss the truth, and parameters dropped in silence that are not zero.

    Of right intervals of 95 %, one of twenty misses.
    """
    flights = len(part.flights)
    missed = sum(not row.holds for row in part.intervals)
    return missed / flights, sum(row.truth != 0.0 for row in part.silent) / flights


def by_parameter(rows: Iterable[Judged]) -> dict[tuple[str, str, str], list[Judged]]:
    """The judged of each vehicle's, model's parameter."""
    found: dict[tuple[str, str, str], list[Judged]] = {}
    for row in rows:
        found.setdefault((row.case.vehicle, row.case.model, row.name), []).append(row)
    return found


def too_few_hold(rows: Sequence[Judged], *, promised: float = 0.9, risk: float = 0.01) -> bool:
    """Whether the count of intervals that hold rejects that ``promised`` of them do.

    A parameter has one interval in each flight and model, so that these are independent.
    """
    return bool(binom.cdf(sum(row.holds for row in rows), len(rows), promised) < risk)


def cells(found: Study) -> Iterator[tuple[str, str, Study]]:
    """Vehicle, kind of model and part of each cell."""
    vehicles = [name for name in FLOWN if any(flight[0] == name for flight in found.flights)]
    for vehicle in vehicles:
        for kind in KINDS:
            if (part := found.cell(vehicle, kind)).identified:
                yield vehicle, kind, part


STRUCTURE, REFUSED = "structure_error of a right structure", "often refused"


class Bar(NamedTuple):
    """What a cell must reach: a measure, and the least or most that it may be."""

    measure: Callable[[Study], float]
    least: float = -math.inf
    most: float = math.inf

    def reached(self, part: Study) -> bool:
        return self.least <= self.measure(part) <= self.most


BARS: Mapping[str, Bar] = {
    "few contain the truth": Bar(lambda part: held(part.intervals).value, least=0.90),
    "all contain the truth": Bar(lambda part: held(part.intervals).value, most=0.995),
    "errors exceed what is stated": Bar(lambda part: size(part.intervals), most=1.2),
    "wider than errors": Bar(lambda part: sharpness(part.intervals).over_error or 0.0, most=WIDEST),
    "wider than 0.7 % of tiny errors": Bar(lambda part: sharpness(part.intervals).over_value or 0.0, most=FINEST),
    "a parameter misses": Bar(
        lambda part: float(sum(map(too_few_hold, by_parameter(part.intervals).values()))), most=0.0
    ),
    REFUSED: Bar(lambda part: part.share_refused, most=0.1),
    STRUCTURE: Bar(lambda part: part.share_with("structure_error"), most=0.02),
}
"""What each cell must reach, and how it is called where it does not."""


def applies(bar: str, vehicle: str, kind: str, part: Study) -> bool:
    """Whether a bar is one of a cell: all but the share of refusals need intervals, and one a right structure."""
    if bar == STRUCTURE:
        return (vehicle, kind) not in WRONG_STRUCTURES
    return bool(part.intervals) or bar == REFUSED


def misses(found: Study) -> Iterator[tuple[str, str, str, float]]:
    """Bar, vehicle, kind of model and measure of every cell that misses a bar."""
    for vehicle, kind, part in cells(found):
        for name, bar in BARS.items():
            if applies(name, vehicle, kind, part) and not bar.reached(part):
                yield name, vehicle, kind, bar.measure(part)


HEAD = (
    "| vehicle | models | flights | intervals | refused | contain truth | of zeros | error/stated | stated/error "
    "| stated/value | missed, dropped in silence per flight | structure_error | parameters that miss | too wide |"
)


def table(found: Study) -> Iterator[str]:
    """Of every vehicle and kind of model: how many hold, how large errors are, how wide, and who misses."""
    yield HEAD
    yield "|---" * (HEAD.count("|") - 1) + "|"
    for vehicle, kind, part in cells(found):
        yield f"| {vehicle} | {kind} " + row_of(part)
    yield "| **all** | " + row_of(found)


def table_of_docs(found: Study) -> Iterator[str]:
    """The table of ``docs/accuracy.md``: kinds of models in columns but for reduced ones, what misses a bar in bold."""
    parts = {(vehicle, kind): part for vehicle, kind, part in cells(found)}
    vehicles = dict.fromkeys(vehicle for vehicle, _ in parts)
    kinds = [kind for kind in KINDS if kind != "reduced" and any((vehicle, kind) in parts for vehicle in vehicles)]
    yield f"| vehicle | {' | '.join(kinds)} |"
    yield "|---" * (len(kinds) + 1) + "|"
    for vehicle in vehicles:
        yield f"| {vehicle} | {' | '.join(_short(parts.get((vehicle, kind))) for kind in kinds)} |"


def _short(part: Study | None) -> str:
    """Share that contains the truth, error over stated, stated over error, stated over value."""
    if part is None or not (rows := part.intervals):
        return "–" if part is None else "refused"
    share, sharp = held(rows), sharpness(rows)
    contain = f"{100.0 * share.value:.1f} ± {100.0 * share.error:.1f} %" if share.error > 0.0 else f"{share.value:.0%}"
    measures = [
        (contain, 0.90 <= share.value <= 0.995),
        (f"{size(rows):.2f}", size(rows) <= 1.2),
        ("–" if sharp.over_error is None else f"{sharp.over_error:.1f}", (sharp.over_error or 0.0) <= WIDEST),
        ("–" if sharp.over_value is None else f"{100.0 * sharp.over_value:.1f} %", (sharp.over_value or 0.0) <= FINEST),
    ]
    return ", ".join(text if right else f"**{text}**" for text, right in measures)


def row_of(part: Study) -> str:
    """Measures of a part as cells of a table."""
    rows = part.intervals
    zeros = [row for row in rows if row.truth == 0.0]
    structure = 100.0 * part.share_with("structure_error")
    counts = f"| {len(part.flights)} | {len(rows)} | {100.0 * part.share_refused:.0f} % "
    if not rows:
        return counts + "|  " * 9 + "|"
    sharp, (missed, dropped) = sharpness(rows), wrong(part)
    misses = [
        f"{model} {name} {100.0 * held(of).value:.0f} %"
        for (_, model, name), of in by_parameter(rows).items()
        if too_few_hold(of)
    ]
    wide = [
        f"{model} {name} {f'{value:.1f}' if value > WIDEST else f'{100.0 * value:.1f} %'}"
        for (_, model, name), value in sharp.too_wide.items()
    ]
    over_error = "–" if sharp.over_error is None else f"{sharp.over_error:.2f}"
    over_value = "–" if sharp.over_value is None else f"{100.0 * sharp.over_value:.2f} %"
    return (
        f"{counts}| {held(rows)} | {held(zeros) if zeros else '–'} | {size(rows):.2f} | {over_error} | {over_value} "
        f"| {missed:.1f}, {dropped:.1f} | {structure:.0f} % | {'; '.join(misses)} "
        f"| {len(wide)}: {'; '.join(wide[:8])} |"
    )


def moved_truth(found: Study) -> Iterator[str]:
    """What was moved as truth by more than 0.2 %, over its value in hover and still air."""
    for (vehicle, name), ratios in sorted(found.moved.items()):
        if max(abs(ratio - 1.0) for ratio in ratios) > 0.002:
            yield f"- {vehicle} {name}: {min(ratios):.3f} to {max(ratios):.3f} of hover in still air"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="Where logs and rows are kept.")
    parser.add_argument("--vehicles", default=",".join(FLOWN), help="Names, with commas.")
    parser.add_argument("--weathers", default=",".join(DEV_WEATHERS), help="Names, or NORTH/EAST/GUSTS in m/s.")
    parser.add_argument("--seeds", default=",".join(map(str, DEV_SEEDS)), help="Numbers, with commas.")
    parser.add_argument("--models", default=",".join(MODELS), help="Names, with commas, or kinds: " + ", ".join(KINDS))
    parser.add_argument("--label", help="Name of the rows, instead of the version's.")
    parser.add_argument("--before", help="Label of rows to print first, for the same flights and models.")
    parser.add_argument("--by-weather", action="store_true", help="Tables for each weather.")
    parser.add_argument("--docs", action="store_true", help="Print the table of the documentation.")
    parser.add_argument("--misses", action="store_true", help="List the cells that miss a bar.")
    parser.add_argument("--refusals", action="store_true", help="Print why identifications were refused.")
    parser.add_argument("--workers", type=int, default=1, help="Processes.")
    given = parser.parse_args()
    models = [model for name in given.models.split(",") for model in KINDS.get(name, (name,))]
    seeds = [int(seed) for seed in given.seeds.split(",")]
    found = study(
        given.folder,
        vehicles=given.vehicles.split(","),
        weathers=given.weathers.split(","),
        seeds=seeds,
        models=models,
        label=given.label,
        workers=given.workers,
    )
    if given.before:
        cases = {run.case for run in found.identified}
        print(given.before, *table(kept_study(given.folder, given.before).where(cases.__contains__)), "", sep="\n")
    print(given.label or version(), *table(found), "", *moved_truth(found), sep="\n")
    if given.by_weather:
        for weather in given.weathers.split(","):
            print("", weather, *table(found.where(lambda case, weather=weather: case.weather == weather)), sep="\n")  # type: ignore[misc]
    if given.docs:
        print("", *table_of_docs(found), sep="\n")
    if given.misses:
        print("", *(f"{vehicle}-{kind}: {bar} ({value:.3g})" for bar, vehicle, kind, value in misses(found)), sep="\n")
    if given.refusals:
        print(*(f"{'-'.join(map(str, run.case))}: {run.message}" for run in found.identified if run.refused), sep="\n")


if __name__ == "__main__":
    main()
