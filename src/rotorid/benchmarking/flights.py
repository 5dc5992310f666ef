"""Flights of a benchmark: the files of a folder, known by their names and hashes, as records on one clock."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rotorid.benchmarking.catalog import STEPS, Benchmark
from rotorid.data.base import Immutable, read_only
from rotorid.data.display import listed
from rotorid.data.findings import Finding, remark, warn
from rotorid.data.record import FlightRecord, MotorRecord
from rotorid.errors import InsufficientDataError, LogError, UsageError
from rotorid.fitting.flight.fit import FlightChoices
from rotorid.frames import earth_to_body
from rotorid.io.documents import parse_toml
from rotorid.io.files import compression_of, sha256_of, unpacked
from rotorid.io.registry import read
from rotorid.io.tables.mapping import ChannelMapping, parse_mapping
from rotorid.models.flight import Airframe
from rotorid.models.rotors import RotorLayout
from rotorid.typing import FloatArray

_PROGRESS = logging.getLogger("rotorid.progress")

_PACKED = r"(?:\.(?:xz|gz|bz2|zip))?"
_BELOW = ("train", "test")
"""Folders of a folder that are looked into too."""


class Vehicle(NamedTuple):
    """What is known of the vehicle of a benchmark before a fit.

    Parameters
    ----------
    airframe
        Rotors, mass and discs.
    choices
        How models of rotorid are fitted.
    published_inertia
        By which moments are compared, kg m²; empty where motion is compared.
    cutoff_hz
        Of the filter that the specific force of the data has passed, without phase; ``None`` for none.
    """

    airframe: Airframe
    choices: FlightChoices
    published_inertia: tuple[float, ...] = ()
    cutoff_hz: float | None = None


def _square(forward_m: float, right_m: float, spins: Sequence[float], *, mass_kg: float, radius_m: float) -> Airframe:
    """A quadrotor with the motors front right, rear right, rear left, front left."""
    places = [(forward_m, right_m), (-forward_m, right_m), (-forward_m, -right_m), (forward_m, -right_m)]
    return Airframe(
        positions=np.array([(*place, 0.0) for place in places]),
        spins=np.array(spins),
        mass_kg=mass_kg,
        disc_m2=np.pi * radius_m**2,
    )


def vehicle_of(name: str) -> Vehicle:
    """The vehicle that flew a benchmark."""
    match name:
        case "neurobem":
            # The file's order: rear right, front right, rear left, front left. Mass and inertia follow exactly from
            # the columns of the network's errors.
            frame = Airframe(
                positions=np.array([[-0.075, 0.1, 0.0], [0.075, 0.1, 0.0], [-0.075, -0.1, 0.0], [0.075, -0.1, 0.0]]),
                spins=np.array([-1.0, 1.0, 1.0, -1.0]),
                mass_kg=0.752,
                disc_m2=np.pi * 0.0646**2,
            )
            choices = FlightChoices(terms=("m_f", "m_fx"), predictor=True)
            return Vehicle(frame, choices, (2.52e-3, 2.14e-3, 4.36e-3), 9.0)
        case "idsia":
            frame = _square(0.0353, 0.0353, (1.0, -1.0, 1.0, -1.0), mass_kg=0.045, radius_m=0.0275)
            # Of yaw only the ratio of inertia to the torque of the rotors acts. In a hall, and no run turns its
            # heading: what looks like wind is a bias.
            return Vehicle(frame, FlightChoices(values={"I_zz": 5e-5}, wind=False, predictor=True))
        case _:
            frame = _square(0.0325, 0.0325, (1.0, -1.0, 1.0, -1.0), mass_kg=0.027, radius_m=0.0231)
            return Vehicle(frame, FlightChoices(values={"I_zz": 3e-5}, wind=False, predictor=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class BenchFlight(Immutable):
    """One flight of a benchmark.

    Parameters
    ----------
    name
        By which all tables know it.
    log
        As it was read.
    record
        Motors and motion on one clock, forward right down.
    position
        North, east and down as logged, m, shape ``(3, n)``; empty where only loads are compared.
    network
        Force (N) and moment (N m) that the file says a published model predicts, shape ``(6, n)``; empty for none.
    skew_s
        How much earlier the stamps of the motors are than those of the gyro.
    first, samples
        First sample of the record in the file, and samples of the file.
    """

    name: str
    log: FlightRecord
    record: MotorRecord
    position: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    network: FloatArray = field(default_factory=lambda: np.zeros((6, 0)))
    skew_s: float = 0.0
    first: int = 0
    samples: int = 0

    def __post_init__(self) -> None:
        self._set(
            position=read_only(self.position, np.float64, ndim=2), network=read_only(self.network, np.float64, ndim=2)
        )


class Flights(NamedTuple):
    """The flights of a folder, and remarks on what was left out or is not the published file."""

    flights: tuple[BenchFlight, ...]
    findings: tuple[Finding, ...]


def files_of(benchmark: Benchmark, folder: Path) -> dict[str, Path]:
    """Flight to its file, in the order of their names.

    Raises
    ------
    UsageError
        There is no such folder, it contains no flight of the benchmark, or one of them twice.
    """
    get = f"download {benchmark.address} (license: {benchmark.license})"
    if not folder.is_dir():
        raise UsageError(
            f"there is no folder {str(folder)!r}", needed=f"the data of {benchmark.name}", remedy=f"{get}, then --data"
        )
    found: dict[str, Path] = {}
    for place in (folder, *(folder / name for name in _BELOW)):
        for path in sorted(place.iterdir()) if place.is_dir() else ():
            known = re.fullmatch(benchmark.pattern + _PACKED, path.name)
            if known is None or not path.is_file():
                continue
            if known[1] in found:
                raise UsageError(
                    f"{known[1]} is in {str(folder)!r} twice, as {found[known[1]].name} and {path.name}",
                    needed="each flight once",
                    remedy="move one of them away",
                )
            found[known[1]] = path
    if not found:
        raise UsageError(
            f"{str(folder)!r} contains no flight of {benchmark.name}",
            needed=f"files such as {next(iter(benchmark.hashes))}",
            remedy=get,
        )
    return dict(sorted(found.items()))


def read_flights(benchmark: Benchmark, folder: Path, *, sandbox: bool = True) -> Flights:
    """All flights of a folder, those left out that a fit cannot use.

    Parameters
    ----------
    sandbox
        Whether files are read in a confined process; without it only files that are trusted.

    Raises
    ------
    UsageError
        As for :func:`files_of`, or a file lacks a column.
    InsufficientDataError
        Fewer than two flights can be used: each is predicted by a fit of others.
    """
    found: list[BenchFlight] = []
    findings: list[Finding] = []
    usable = {}
    for name, path in files_of(benchmark, folder).items():
        _PROGRESS.info("reading %s", path.name)
        try:
            own = _READ[benchmark.name](name, path, sandbox)
            _require_steps(benchmark, own)
        except (InsufficientDataError, LogError) as error:
            findings.append(warn("not_verified", name, f"{name} is left out: {error.reason}"))
            continue
        found += own
        usable[name] = path
        findings += _of_hash(benchmark, name, path)
    if benchmark.name == "nanobench" and len(usable) > 1:
        found = _nanobench_together(usable, sandbox)
    if len(found) < 2:
        raise InsufficientDataError(
            f"{str(folder)!r} contains {len(found)} usable flight{'s' if len(found) != 1 else ''} of {benchmark.name}",
            needed="two or more: each is predicted by a fit of the others",
            remedy=f"download more of {benchmark.address}",
            findings=findings,
        )
    return Flights(tuple(found), tuple(findings))


def _require_steps(benchmark: Benchmark, flights: Sequence[BenchFlight]) -> None:
    """Refuse flights without a sample from which states can be predicted."""
    longest = max((flight.record.samples for flight in flights), default=0)
    if benchmark.kind == "steps" and longest <= STEPS:
        raise InsufficientDataError(f"only {longest} of its samples are usable", needed=f"more than {STEPS}")


def _of_hash(benchmark: Benchmark, name: str, path: Path) -> Iterator[Finding]:
    """Whether a file is the one that was published, as far as its hash is known."""
    known = benchmark.hashes.get(name)
    if known is None:
        yield remark("not_verified", name, f"{name} may differ from the published file: its hash is not known.")
        return
    with path.open("rb") as file:
        packed = compression_of(file.read(16))
    if packed:
        with unpacked(path, packed) as plain:
            own = sha256_of(plain)
    else:
        own = sha256_of(path)
    if own != known:
        message = f"{name} differs from the published file (SHA-256 {own[:12]}… instead of {known[:12]}…)."
        yield warn("not_verified", name, message)


def _mapping(name: str, **more: Any) -> ChannelMapping:
    """The mapping of a file, with further channels."""
    text = (files("rotorid.benchmarking") / "mappings" / f"{name}.toml").read_text(encoding="utf-8")
    document = parse_toml(text)
    return parse_mapping(document | {"channels": document["channels"] | more}, f"{name}.toml")


def _rows(log: FlightRecord, names: str, part: slice = slice(None)) -> FloatArray:
    """Channels as rows.

    Raises
    ------
    InsufficientDataError
        They are not sample by sample on one clock.
    """
    rows = [log[name].values[part] for name in names.split()]
    if len({row.size for row in rows}) > 1 or not all(np.isfinite(row).all() for row in rows):
        raise InsufficientDataError(f"{log.source.name} lacks samples of {listed(names.split())}")
    return np.stack(rows)


_NETWORK = ("network_fx", "network_fy", "network_fz", "network_mx", "network_my", "network_mz")
_FLIPPED = np.array([1.0, -1.0, -1.0] * 2)[:, None]


def _neurobem(name: str, path: Path, sandbox: bool) -> list[BenchFlight]:
    """A segment with the published network's force and moment, where the file has these columns."""
    columns = {
        channel: {"source": "*", "column": 29 + place, "unit": "N" if place < 3 else "N m"}
        for place, channel in enumerate(_NETWORK)
    }
    try:
        log = read(path, mapping=_mapping("neurobem", **columns), sandbox=sandbox)
        network = _FLIPPED * _rows(log, " ".join(_NETWORK))
    except UsageError:
        log, network = read(path, mapping=_mapping("neurobem"), sandbox=sandbox), np.zeros((6, 0))
    force = _rows(log, "ax ay az")
    record = MotorRecord(
        name=name,
        sample_rate_hz=400.0,
        outputs=_rows(log, "motor_speed_1 motor_speed_2 motor_speed_3 motor_speed_4"),
        rates=_rows(log, "p q r"),
        az=force[2],
        force=force,
        velocity=_rows(log, "u v w"),
        attitude=_rows(log, "phi theta psi"),
        between="lines",
    )
    return [BenchFlight(name=name, log=log, record=record, network=network, samples=record.samples)]


_ENDS = slice(60, -10)
"""Without the jolt of take-off."""


def _idsia(name: str, path: Path, sandbox: bool) -> list[BenchFlight]:
    """A run without its ends; one whose motors are out of step is refused."""
    from rotorid.flights.motor_stamps import motor_skew

    log = read(path, mapping=_mapping("idsia_nanodrone"), sandbox=sandbox)
    frame = vehicle_of("idsia").airframe
    layout = RotorLayout(name="nanodrone", positions=frame.positions, spins=frame.spins, arm_known=True)
    skew_s = motor_skew(log, layout).late_s.value
    attitude, force = _rows(log, "phi theta psi", _ENDS), _rows(log, "ax ay az", _ENDS)
    record = MotorRecord(
        name=name,
        sample_rate_hz=100.0,
        outputs=_rows(log, "motor_speed_1 motor_speed_2 motor_speed_3 motor_speed_4", _ENDS),
        rates=_rows(log, "p q r", _ENDS),
        az=force[2],
        force=force,
        velocity=earth_to_body(attitude, _rows(log, "velocity_north velocity_east velocity_down", _ENDS)),
        attitude=attitude,
        between="lines",
    )
    return [
        BenchFlight(
            name=name,
            log=log,
            record=record,
            position=_rows(log, "north east down", _ENDS),
            skew_s=skew_s,
            first=_ENDS.start,
            samples=log["p"].values.size,
        )
    ]


def _nanobench_together(named: Mapping[str, Path], sandbox: bool) -> list[BenchFlight]:
    """The stretch of each flight in the air, as ``identify`` reads it; stamps of motors are relative to all flights."""
    from rotorid.flights.flight_data import flight_data
    from rotorid.settings.motors import MotorSettings

    frame = vehicle_of("nanobench").airframe
    settings = MotorSettings(
        layout="quad.x.crazyflie",
        arm_m=float(np.hypot(*frame.positions[0][:2])),
        known={"m": frame.mass_kg},
        rotor_diameter_m=2.0 * float(np.sqrt(frame.disc_m2 / np.pi)),
    )
    logs = {name: read(path, mapping=_mapping("nanobench"), sandbox=sandbox) for name, path in named.items()}
    data = flight_data(list(logs.values()), settings, reference_v=_REFERENCE_V)
    found = []
    for name, log in logs.items():
        own = [place for place, record in enumerate(data.records) if record.name == log.source.name]
        if not own:
            continue
        place = max(own, key=lambda place: data.records[place].samples)
        record = data.records[place]
        position = [np.interp(record.time_s, log[axis].time_s, log[axis].values) for axis in ("north", "east", "down")]
        found.append(
            BenchFlight(
                name=name,
                log=log,
                record=record,
                position=np.stack(position),
                skew_s=data.skews_s[place],
                samples=record.samples,
            )
        )
    return found


def _nanobench(name: str, path: Path, sandbox: bool) -> list[BenchFlight]:
    return _nanobench_together({name: path}, sandbox)


_REFERENCE_V = 3.7
"""Voltage of a cell at which thrust is stated, the same for all flights."""

_READ = {"neurobem": _neurobem, "idsia": _idsia, "nanobench": _nanobench}


def folds(benchmark: Benchmark, flights: Sequence[BenchFlight]) -> tuple[str, list[tuple[list[int], list[int]]]]:
    """How flights are split, in words, and pairs of those that are fitted and those that are predicted.

    Up to eight flights are left out one after another, more in five groups; the authors' split counts where the folder
    has both of its parts.
    """
    names = [flight.name for flight in flights]
    test = [place for place, name in enumerate(names) if benchmark.test and name.startswith(benchmark.test)]
    rest = [place for place in range(len(names)) if place not in test]
    if test and rest:
        return f"the authors' split: fitted to {len(rest)} flights, tested on {len(test)} ({benchmark.test})", [
            (rest, test)
        ]
    count = len(names) if len(names) <= _MOST_ALONE else _GROUPS
    groups = [list(range(start, len(names), count)) for start in range(count)]
    words = (
        f"each of {len(names)} flights by a fit of the others"
        if count == len(names)
        else f"{len(names)} flights in {count} groups, each by a fit of the others"
    )
    return words, [([place for place in range(len(names)) if place not in group], group) for group in groups]


_MOST_ALONE, _GROUPS = 8, 5
