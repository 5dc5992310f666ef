"""Numbers on pages that a run of the program gives: ``python -m tests.docs.measured [SAMPLE…]`` writes them again.

Tests compare and write nothing, so that a person sees every change. Tables beside peers come from the record that
``python -m benchmarks.peers`` keeps.
"""

from __future__ import annotations

import contextlib
import json
import re
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import NamedTuple

from tests.golden.results import DATA

import rotorid
from rotorid.data.quantity import with_error
from rotorid.results.model import IdentifiedModel

ROOT = Path(__file__).resolve().parents[2]


class Flight(NamedTuple):
    """A flight whose truth is known, the model and band that were asked for, and the truth in words."""

    title: str
    log: str
    model: str
    gain: str
    unit: str
    truth: str
    lag_truth: str
    delay: str
    delay_truth: str
    band_rad_s: tuple[float, float] | None = None


ARDUPILOT_MS, PX4_MS = "2.4–2.5", "5.3"
FLIGHTS = (
    Flight(
        *("ArduPilot roll, calm, two chirps", "ardupilot_sitl/x_calm_roll.BIN", "rate.roll", "L_roll"),
        *("rad/s²", "437.2", "–", "tau_roll", ARDUPILOT_MS),
    ),
    Flight(
        *("ArduPilot roll, wind", "ardupilot_sitl/x_wind_rollpitch.BIN.xz", "rate.roll", "L_roll"),
        *("rad/s²", "437.2", "–", "tau_roll", ARDUPILOT_MS),
    ),
    Flight(
        *("ArduPilot pitch, wind", "ardupilot_sitl/x_wind_rollpitch.BIN.xz", "rate.pitch", "M_pitch"),
        *("rad/s²", "437.2", "–", "tau_pitch", ARDUPILOT_MS),
    ),
    Flight(
        *("ArduPilot yaw, wind", "ardupilot_sitl/x_wind_yawthrust.BIN.xz", "rate.yaw", "N_yaw"),
        *("rad/s²", "14.18", "–", "tau_yaw", ARDUPILOT_MS),
    ),
    Flight(
        *("ArduPilot thrust, wind", "ardupilot_sitl/x_wind_yawthrust.BIN.xz", "rate.vertical", "Z_thrust"),
        *("m/s²", "−27.05", "–", "tau_thrust", ARDUPILOT_MS),
    ),
    Flight(
        *("ArduPilot thrust, calm", "ardupilot_sitl/x_calm_thrust.BIN.xz", "rate.vertical", "Z_thrust"),
        *("m/s²", "−27.33", "–", "tau_thrust", ARDUPILOT_MS),
    ),
    Flight(
        *("PX4 roll, stick sweep", "px4_sitl/roll.ulg", "rate.roll", "L_roll"),
        *("rad/s²", "113.1", "48", "tau_roll", PX4_MS),
    ),
    Flight(
        *("PX4 pitch", "px4_sitl/pitch.ulg.xz", "rate.pitch", "M_pitch"),
        *("rad/s²", "113.1", "48", "tau_pitch", PX4_MS),
    ),
    Flight(
        *("PX4 yaw", "px4_sitl/yaw.ulg.xz", "rate.yaw", "N_yaw"),
        *("rad/s²", "13.33", "48", "tau_yaw", PX4_MS),
    ),
    Flight(
        *("PX4 thrust", "px4_sitl/thrust.ulg.xz", "rate.vertical", "Z_thrust"),
        *("m/s²", "−20.0", "48", "tau_thrust", "7.4"),
    ),
    Flight(
        *("S500 roll, 8 to 40 rad/s", "s500/roll_sweeps.csv", "rate.roll", "L_roll"),
        *("rad/s²", "153.4", "–", "tau_roll", "41.5", (8.0, 40.0)),
    ),
    Flight(
        *("S500 pitch, 8 to 40 rad/s", "s500/pitch_sweeps.csv", "rate.pitch", "M_pitch"),
        *("rad/s²", "149.8", "–", "tau_pitch", "37.5", (8.0, 40.0)),
    ),
)
HEAD = "| flight | gain, found | truth | motor lag [ms] | truth | delay [ms] | truth | cost |\n" + 8 * "|---" + "|\n"


def row_of(flight: Flight) -> str:
    """A row of the table: identified with no option but the model and, where one stands, the band."""
    options = {} if flight.band_rad_s is None else {"band_rad_s": flight.band_rad_s}
    model = rotorid.identify(DATA / flight.log, flight.model, **options)
    assert model.fit.cost is not None
    gain = model.parameters[flight.gain]
    cells = (
        *(flight.title, f"{with_error(gain.value, gain.std)} {flight.unit}", flight.truth),
        *(milliseconds(model, "T_motor"), flight.lag_truth, milliseconds(model, flight.delay), flight.delay_truth),
        f"{model.fit.cost.average:.1f}",
    )
    return f"| {' | '.join(cells)} |\n"


def milliseconds(model: IdentifiedModel, name: str) -> str:
    """A lag or a delay, and a dash for one that the data do not show."""
    one = model.parameters[name]
    return "–" if one.std is None else with_error(1e3 * one.value, 1e3 * one.std)


def known_truths() -> str:
    """The table of flights whose truth is known."""
    return HEAD + "".join(row_of(flight) for flight in FLIGHTS)


def printed(*words: str) -> list[str]:
    """Lines that a command prints, in the folder where this is called."""
    from typer.testing import CliRunner

    from rotorid.cli.app import app

    ran = CliRunner().invoke(app, list(words))
    assert ran.exit_code == 0, (ran.output, ran.stderr, ran.exception)
    return [line.rstrip() for line in ran.stdout.splitlines()]


def first_command() -> str:
    """What the README shows of an identification: its table of parameters."""
    with tempfile.TemporaryDirectory() as folder:
        log = str(DATA / "ardupilot_sitl" / "x_calm_roll.BIN")
        lines = printed("identify", log, "--model", "rate.roll", "--out", folder)
    start = next(place for place, line in enumerate(lines) if line.startswith("parameter"))
    stop = next(place for place, line in enumerate(lines) if line.startswith("cost of "))
    return "\n".join(lines[start:stop]) + "\n"


DESIGN = "design sweep --vehicle px4_quad --axis roll,pitch --duration 40 --turbulence 0.5 --doublets"
SIMULATE = "simulate px4_quad --plan rotorid-out/px4_quad-design/plan.json --turbulence 0.5 --seed 7"
IDENTIFY = "identify rotorid-out/px4_quad/flight.ulg --model rate.roll"
DESIGNED = Path("rotorid-out", "px4_quad-design")


class Designed(NamedTuple):
    """Output of the first command of ``docs/design.md``: lines, plan, true values and predicted deviations."""

    lines: Sequence[str]
    plan: str
    predicted: dict[str, tuple[float, float]]


@cache
def designed() -> Designed:
    """The first command of ``docs/design.md``."""
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        lines = printed(*DESIGN.split())
        document = json.loads((DESIGNED / "design.json").read_text(encoding="utf-8"))
        plan = (DESIGNED / "plan.json").read_text(encoding="utf-8")
    roll = next(one for one in document["plans"][0]["predictions"] if one["model"] == "rate.roll")
    return Designed(lines, plan, {name: (one["value"], one["std"]) for name, one in roll["parameters"].items()})


def a_plan() -> str:
    """The answer that ``rotorid design`` prints, and the first rows of its table of inputs."""
    lines = designed().lines
    table = next(place for place, line in enumerate(lines) if line.startswith("axis "))
    reaches = next(line for line in lines if line.startswith("The flight reaches"))
    answer = takewhile(str.strip, lines)
    return "\n".join([f"$ rotorid {DESIGN}", *answer, *lines[table : table + 4], "…", reaches]) + "\n"


def a_flown_plan() -> str:
    """The plan flown in simulation and identified, with the predicted errors."""
    head = "| parameter | true | predicted ± | identified | random ± | whole ± |\n|---|---|---|---|---|---|\n"
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        DESIGNED.mkdir(parents=True)
        (DESIGNED / "plan.json").write_text(designed().plan, encoding="utf-8")
        printed(*SIMULATE.split())
        printed(*IDENTIFY.split())
        found = rotorid.load(Path("rotorid-out", "flight-rate.roll")).parameters
    rows = []
    for name, (truth, predicted) in designed().predicted.items():
        one = found[name]
        assert one.std is not None
        assert one.std_random is not None
        cells = (f"{truth:#.4g}", f"{predicted:#.2g}", f"{one.value:#.4g}", f"{one.std_random:#.2g}", f"{one.std:#.2g}")
        unit = one.unit.replace("^2", "²")
        rows.append(f"| {name} [{unit}] | {' | '.join(cells)} |\n".replace("-", "−"))
    return head + "".join(rows)


def beside_peers() -> str:
    """The first table of ``docs/peers.md``."""
    from benchmarks import peers

    return peers.peers_table(peers.load())


def accuracy_beside_peers() -> str:
    """The table of peers of ``docs/accuracy.md``."""
    from benchmarks import peers

    return peers.accuracy_table(peers.load())


class Sample(NamedTuple):
    """Where a sample stands, between what, and what it prints."""

    page: Path
    between: re.Pattern[str]
    made: Callable[[], str]
    of_flights: bool = True
    """Whether it is made of flight data that are not in the repository."""

    @property
    def shown(self) -> str:
        """What the page shows today."""
        found = self.between.search(self.page.read_text(encoding="utf-8"))
        assert found is not None, f"{self.page} has no place for it"
        return found[0]


OF_RECORD = re.compile(r"(?<=<!-- written by tests/docs/measured.py from benchmarks/peers.json -->\n)(?:\|.*\n)*")
SAMPLES = {
    "first command": Sample(
        ROOT / "README.md",
        re.compile(r"(?<=# the whole way to a model, with a report\n)(?:(?!```).*\n)*"),
        first_command,
    ),
    "known truths": Sample(
        ROOT / "docs" / "accuracy.md",
        re.compile(r"(?<=<!-- written by tests/docs/measured.py -->\n)(?:\|.*\n)*"),
        known_truths,
    ),
    "a plan": Sample(
        ROOT / "docs" / "design.md",
        re.compile(r"(?<=```console\n)\$ rotorid design sweep .*\n(?:(?!```).*\n)*"),
        a_plan,
        False,
    ),
    "a flown plan": Sample(
        ROOT / "docs" / "design.md",
        re.compile(r"(?<=<!-- written by tests/docs/measured.py -->\n)(?:\|.*\n)*"),
        a_flown_plan,
        False,
    ),
    "beside peers": Sample(ROOT / "docs" / "peers.md", OF_RECORD, beside_peers, False),
    "accuracy beside peers": Sample(ROOT / "docs" / "accuracy.md", OF_RECORD, accuracy_beside_peers, False),
}


def main() -> None:
    """Write samples again, all or those that are named."""
    for name in sys.argv[1:] or SAMPLES:
        sample = SAMPLES[name]
        if sample.of_flights and not DATA.is_dir():
            sys.exit(f"no flight data at {DATA}; set ROTORID_DATA to their folder")
        text = sample.page.read_text(encoding="utf-8")
        made = sample.made()
        sample.page.write_text(sample.between.sub(lambda _, made=made: made, text), encoding="utf-8")  # type: ignore[misc]


if __name__ == "__main__":
    main()
