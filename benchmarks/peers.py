"""What is measured of ours and of peers, kept as a record from which tables of the docs are written.

``python -m benchmarks.peers [WORK…]`` measures all, or the works that are named, as far as their peers are installed,
and keeps the results in ``benchmarks/peers.json``; what was not measured again stays, with the command and the day that
it is from. ``python -m tests.docs.measured`` writes the tables from it, and a test compares them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import NamedTuple, TypeAlias

from tests.twins.everyday_flights import cases

from benchmarks import accuracy, dataflash, frequency_response, genetic, state_space, step_response

RECORD = Path(__file__).with_suffix(".json")
FLIGHTS = 20
"""Of steps, as many as the docs speak of."""
FARTHEST_DB = 1.0
"""Beyond it a peer counts as not made for the work, and has a dash in the tables."""
ACCURACY = "python -m benchmarks.accuracy"


class Measured(NamedTuple):
    """Numbers of one method in one work, and where they come from."""

    work: str
    method: str
    numbers: Mapping[str, float]
    command: str


Record: TypeAlias = dict[str, dict[str, dict[str, float | str]]]
"""By work and method: the numbers, the ``command`` that measures them, and the ``day`` on which it did."""


def of_accuracy() -> Iterator[Measured]:
    """Errors of responses, of all methods that are here."""
    for work, job in zip(JOBS, accuracy.jobs(), strict=True):
        for method, found in accuracy.rows(job):
            numbers = {"magnitude_db": round(found.magnitude_db, 6), "phase_deg": round(found.phase_deg, 5)}
            yield Measured(work, method, numbers, ACCURACY)


def of_steps() -> Iterator[Measured]:
    """Shares of flights whose rise time is estimated within its planned error."""
    chosen = islice(cases(), 0, None, (96 // FLIGHTS) | 1)
    shares = step_response.rises_within(list(step_response.compare(chosen)))
    for method, share in zip(("PID-Analyzer", "rotorid"), shares, strict=True):
        numbers = {"rise_within_percent": share, "flights": FLIGHTS}
        yield Measured("steps", method, numbers, f"python -m benchmarks.step_response --flights {FLIGHTS}")


def of_spectra() -> Iterator[Measured]:
    """Seconds of spectra at the lower rate."""
    found, command = frequency_response.run(frequency_response.RATES_HZ[0]), "python -m benchmarks.frequency_response"
    for method in ("rotorid", "scipy"):
        yield Measured("spectra", method, {"seconds": found[f"{method}_s"]}, command)
    yield Measured("spectra", "numpy", {"times": found["ratio_numpy"]}, command)


def of_fits() -> Iterator[Measured]:
    """How many times as long the peer takes for one fit."""
    if state_space.AVAILABLE:
        job = state_space.small()
        numbers = {"times": state_space.run(job)["ratio"], "aim": job.bar}
        yield Measured("frequency fit", "python-control", numbers, "python -m benchmarks.state_space")


def of_reading() -> Iterator[Measured]:
    """Seconds for every column of a log."""
    if dataflash.LOG.is_file():
        found = dataflash.run()
        for method in ("rotorid", "pymavlink"):
            numbers = {"seconds": found[f"{method}_s"], "megabytes": found["log_mb"]}
            yield Measured("DataFlash", method, numbers, "python -m benchmarks.dataflash")


def of_searches() -> Iterator[Measured]:
    """Seconds of a genetic algorithm and its peers."""
    for method, found in genetic.run().items():
        if found.seconds and method != "evolution":
            yield Measured("genetic search", method, {"seconds": found.seconds}, "python -m benchmarks.genetic")


JOBS = ("closed loop", "closed loop, gusts", "four states")
WORKS: Mapping[str, Callable[[], Iterator[Measured]]] = {
    "accuracy": of_accuracy,
    "steps": of_steps,
    "spectra": of_spectra,
    "fits": of_fits,
    "reading": of_reading,
    "searches": of_searches,
}


def load() -> Record:
    """The record as it is kept."""
    found: Record = json.loads(RECORD.read_text(encoding="utf-8"))
    return found


def renewed(record: Record, one: Measured, day: str) -> Record:
    """A record in which what was measured stands in place of what stood there."""
    measured: dict[str, float | str] = {**one.numbers, "command": one.command, "day": day}
    return {**record, one.work: {**record.get(one.work, {}), one.method: measured}}


def _errors(record: Record, work: str, method: str) -> str:
    found = record[work].get(method)
    return (
        "–"
        if found is None or float(found["magnitude_db"]) > FARTHEST_DB
        else f"{found['magnitude_db']:.3f}, {found['phase_deg']:.2f}"
    )


def size_of(record: Record, work: str, method: str) -> float:
    """Relative error of a response: magnitude and phase as one."""
    found = record[work][method]
    return accuracy.Errors(float(found["magnitude_db"]), float(found["phase_deg"])).size


def _seconds(record: Record, work: str, method: str) -> str:
    found = record[work][method]
    most = f" to {found['most_seconds']:.2g}" if "most_seconds" in found else ""
    return f"{found['seconds']:.2g}{most} s"


OURS = ("rotorid, then output error", "rotorid, then prediction error", "rotorid, black box")
ALONE = ("rotorid, response alone", "rotorid, response alone", "rotorid, subspace alone")
DIRECT, TUNED = (accuracy.DIRECT,) * 3, (accuracy.TUNED,) * 3
PEERS = (
    *("SIPPY output error", "SIPPY CVA", "SIPPY N4SID", "nfoursid", "Octave n4sid", "ARX by least squares"),
    "python-control, ERA",
)


def accuracy_table(record: Record) -> str:
    """Errors of ours and of peers over the flights of each job, as ``docs/accuracy.md`` shows them."""
    named = {
        "rotorid, true structure or order: output error, prediction error, black box": OURS,
        "the same before the polish": ALONE,
        "rotorid, black box of scanned order": TUNED,
        "the way of pyAircraftIden, true structure: direct responses, log cost by coherence, local optimizer": DIRECT,
        **{name: (name,) * 3 for name in PEERS},
    }
    lines = ["| | closed loop, sensor noise | closed loop, gusts | 4 states, 2 × 2 |", "|---|---|---|---|"]
    for name, methods in named.items():
        cells = [_errors(record, work, method) for work, method in zip(JOBS, methods, strict=True)]
        if methods is OURS:
            cells = [f"**{cell}**" for cell in cells]
        lines.append(f"| {' | '.join([name, *cells])} |")
    return "\n".join(lines) + "\n"


def peers_table(record: Record) -> str:
    """Works, ours, peers and what each side knows, as ``docs/peers.md`` shows them."""
    calm, gusts, _ = JOBS
    output_error, cva, n4sid = "SIPPY output error", "SIPPY CVA", "Octave n4sid"
    better = size_of(record, calm, output_error) < size_of(record, calm, accuracy.TUNED)
    rule = record["gains, roll"]
    px4, simc = rule["PX4 autotune"], rule["SIMC"]
    stiffer, calmer = simc["stiffness"] > rule["rotorid"]["stiffness"], simc["M_s_90"] < rule["rotorid"]["M_s_90"]
    rises = record["steps"]
    fit = record["frequency fit"]["python-control"]
    rows = (
        (
            "closed loop, sensor noise, rms error of the response [dB, °]",
            _errors(record, calm, OURS[0]),
            f"SIPPY output error {_errors(record, calm, output_error)}; CVA {_errors(record, calm, cva)}; "
            f"Octave n4sid {_errors(record, calm, n4sid)}",
            "rotorid the structure; peers the best two of many settings, **chosen against the truth**",
        ),
        (
            "the same, a black box of scanned order on both sides",
            _errors(record, calm, accuracy.TUNED),
            f"{'**' * better}SIPPY output error {_errors(record, calm, output_error)}{' is better**' * better}",
            "the same on both sides",
        ),
        (
            "closed loop in gusts",
            _errors(record, gusts, OURS[1]),
            f"SIPPY CVA {_errors(record, gusts, cva)}; Octave n4sid {_errors(record, gusts, n4sid)}",
            f"as above; black boxes of ours by output error {_errors(record, gusts, accuracy.TUNED)}: "
            "**worse than CVA**, as every output error is under feedback",
        ),
        (
            "closed loop, sensor noise, by the way of pyAircraftIden",
            f"{_errors(record, calm, OURS[0])}; response alone {_errors(record, calm, ALONE[0])}",
            _errors(record, calm, accuracy.DIRECT),
            "both the structure and the hold; rotorid the excitation too, the peer windows **fit to the truth**",
        ),
        (
            "the same in gusts",
            f"{_errors(record, gusts, OURS[1])}; response alone {_errors(record, gusts, ALONE[1])}",
            _errors(record, gusts, accuracy.DIRECT),
            "as above",
        ),
        (
            "step response of an ordinary flight, rise time within 5 %",
            f"{rises['rotorid']['rise_within_percent']:.0f} % of {rises['rotorid']['flights']:.0f} flights",
            f"PID-Analyzer's published algorithm {rises['PID-Analyzer']['rise_within_percent']:.0f} %",
            "both the log; rotorid says how certain it is",
        ),
        (
            "gains for roll, stiffness against a moment (1: best within the limits)",
            f"{rule['rotorid']['stiffness']:.2f}, M_s {rule['rotorid']['M_s_90']:.2f} at most in 90 %",
            f"{'**' * stiffer}SIMC {simc['stiffness']:.2f}{'**' * stiffer}, "
            f"{'**' * calmer}with M_s {simc['M_s_90']:.2f} in 90 %{'**' * calmer}; "
            f"AMIGO {rule['AMIGO']['stiffness']:.2f}; PX4's rule {px4['stiffness']:.2f} and {px4['unstable']:.0f} "
            f"unstable; Quicktune's {rule['Quicktune']['stiffness']:.2f} with M_s {rule['Quicktune']['M_s_50']:.2f}",
            "rotorid one log; the rules the exact plant",
        ),
        (
            "spectra of 4 × 9 pairs, five windows",
            _seconds(record, "spectra", "rotorid"),
            f"`scipy.signal` {_seconds(record, 'spectra', 'scipy')}; one NumPy transform a window: "
            f"{record['spectra']['numpy']['times']:.1f} times as long",
            "the same",
        ),
        (
            "frequency fit, 4 states",
            "1",
            f"python-control with `least_squares`: {fit['times']:.0f} times as long (our aim was {fit['aim']:.0f})",
            "the same model and start",
        ),
        (
            f"reading a DataFlash of {record['DataFlash']['rotorid']['megabytes']:.0f} MB",
            _seconds(record, "DataFlash", "rotorid"),
            f"`pymavlink` {_seconds(record, 'DataFlash', 'pymavlink')}",
            "the same",
        ),
        (
            "genetic search of motors",
            _seconds(record, "genetic search", "genetic"),
            f"DEAP {_seconds(record, 'genetic search', 'deap')}, pygad {_seconds(record, 'genetic search', 'pygad')}; "
            "**pygad is faster where one in five offspring mutates**, since it computes no copy twice",
            "the same cost",
        ),
    )
    head = "| work | rotorid | peer | what each side knows |\n|---|---|---|---|\n"
    return head + "".join(f"| {' | '.join(row)} |\n" for row in rows)


def main() -> None:
    """Measure, and keep the record."""
    day = datetime.now(UTC).date().isoformat()
    for work in sys.argv[1:] or WORKS:
        for one in WORKS[work]():
            print(f"{one.work}: {one.method} {dict(one.numbers)}", flush=True)
            text = json.dumps(renewed(load(), one, day), indent=1, ensure_ascii=False)
            RECORD.write_text(f"{text}\n", encoding="utf-8")
    for sentence in accuracy.skipped():
        print(sentence)
    if genetic.MISSING:
        print(genetic.SKIPPED)
    print("the tables of the docs: python -m tests.docs.measured 'beside peers' 'accuracy beside peers'")


if __name__ == "__main__":
    main()
