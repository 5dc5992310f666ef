"""Every reader and every document against inputs with a sound structure and hostile contents.

100 of each format (200 of ROS and of documents) in every run, 2000 under ``-m slow``, made by one seed: no traceback,
nothing that takes 20 s, no more than 1 GiB, an error that says what came, what was needed and what to do, no control on
the console or in the JSON.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from scipy.signal import lfilter
from tests.hostile.damage import ROOT, hang_limit
from tests.hostile.structured import BUILDERS, EXTREMES, ODD, spoiled, twisted
from tests.hostile.test_documents import JSON, OTHERS, TOML

import rotorid
from rotorid.documents.base import to_json
from rotorid.documents.design import plan_document
from rotorid.documents.result import save
from rotorid.documents.vehicle import vehicle_toml
from rotorid.errors import RotoridError
from rotorid.excitation.plan import planned, sequence
from rotorid.fleets.table import Failed, Journal, LogAnswer, Row, sorted_failures, sorted_rows
from rotorid.io.tables.csv import write_csv
from rotorid.lab.steps import arguments, read_project
from rotorid.settings.parsing import parse_segment
from rotorid.vehicles.catalog import VEHICLES

pytest.importorskip("resource", reason="limits of memory are those of Unix")

FOREIGN = frozenset({"MAT", "HDF5", "Parquet", "ROS"})
"""Formats that are read by parsers of others, in the sandbox."""

CHEAP = tuple(name for name in BUILDERS if name != "ROS")


def child(folder: Path, formats: tuple[str, ...], count: int, *, whole: bool, limit_s: float) -> list[str]:
    """Put inputs through a child with limits, and go on behind each that kills it; one line for each input."""
    places = [str(ROOT), *(entry for entry in sys.path if entry)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(places), "OPENBLAS_NUM_THREADS": "1", "NO_COLOR": "1"}
    lines: list[str] = []
    while len(lines) < count * len(formats):
        words = [str(folder), ",".join(formats), str(count), str(len(lines)), "whole" if whole else "part"]
        ran = subprocess.run(
            [sys.executable, "-m", "tests.hostile.fuzz_child", *words],
            env=environment,
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
        lines += ran.stdout.splitlines()
        if ran.returncode > 0:
            raise AssertionError(
                f"the child ended with {ran.returncode} after {len(lines)} inputs: {ran.stderr[-2000:]}"
            )
        if ran.returncode < 0:
            # Behind the sandbox a crash of a foreign parser is a sentence; here the parser runs in the child itself.
            name = formats[len(lines) // count]
            crash = name in FOREIGN and -ran.returncode in (signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS)
            lines.append(f"{name} {'refused' if crash else f'FAULT ended by signal {-ran.returncode}'}")
    return lines


def faults(lines: list[str]) -> list[str]:
    return [line for line in lines if "FAULT" in line]


@pytest.mark.parametrize(("formats", "count"), [(CHEAP, 100), (("ROS",), 200)], ids=["own", "ROS"])
def test_hostile_logs(formats: tuple[str, ...], count: int, tmp_path: Path) -> None:
    if "ROS" in formats:
        pytest.importorskip("rosbags", reason="the extra [ros] is not installed")
    for module, name in (("h5py", "HDF5"), ("pyarrow", "Parquet")):
        try:
            __import__(module)
        except ImportError:
            formats = tuple(one for one in formats if one != name)
    lines = child(tmp_path, formats, count, whole=False, limit_s=300.0)
    assert faults(lines) == []
    # What is only refused tries nothing.
    assert sum(not line.endswith("refused") for line in lines) > 0.2 * len(lines)


@pytest.mark.slow
@pytest.mark.parametrize("name", BUILDERS)
def test_thousands_of_hostile_logs(name: str, tmp_path: Path) -> None:
    """Each inspected, shown on the console, and some put through the estimation of a model."""
    assert faults(child(tmp_path, (name,), 2000, whole=True, limit_s=3000.0)) == []


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result of a model, and a plan, as the package writes them."""
    folder = tmp_path_factory.mktemp("sound")
    time_s = np.arange(0.0, 60.0, 0.01)
    command = 0.1 * np.sin(time_s + 0.25 * time_s**2)
    rate = lfilter([0.0, 0.4], [1.0, -0.92], command) + 0.002 * np.random.default_rng(0).standard_normal(time_s.size)
    write_csv(folder / "flight.csv", time_s, {"roll_command": command, "p": rate})
    stretch = parse_segment("roll:0:60")
    save(rotorid.identify([rotorid.read(folder / "flight.csv")], "rate.roll", segments=[stretch]), folder)
    sweep = planned("roll", "doublet", start_s=0.0, amplitude=0.1, duration_s=2.0, sample_rate_hz=50.0)
    step = planned("yaw", "doublet", start_s=0.0, amplitude=-0.2, duration_s=1.0, sample_rate_hz=50.0)
    (folder / "plan.json").write_text(to_json(plan_document(sequence("two", [sweep, step], trim_s=2.5))))
    return folder


LAYOUT = '[[rotor]]\nposition_m = [0.1, 0.12, 0.0]\nspin = "ccw"\n[[rotor]]\nposition_m = [-0.1, 0.1, 0]\nspin = "cw"\n'
CONTROLLERS = '[pitch]\nproportional_s = 0.15\nintegral = 0.2\nangle_1_s = 6.0\nsetpoint = "theta_setpoint"\n'
PROJECT = (
    'schema = "rotorid.project/1"\nlogs = ["flight.csv"]\n[[steps]]\nverb = "identify"\nlogs = [1]\n'
    'models = ["rate.roll"]\nsegments = [{ axis = "roll", start_s = 0.0, stop_s = 60.0 }]\n'
)
PREFERENCES = 'theme = "dark"\nfrequency = "Hz"\nout = "results"\n'
VEHICLES_CSV = 'log,vehicle,time,group\na.csv,one,2026-01-01,x\n"b,c.csv",two,,\n'
GAINS = "# Onboard parameters\n1\t1\tMC_ROLLRATE_P\t0.15\t9\n1\t1\tMC_ROLLRATE_I\t0.2\t9\n"


def test_what_is_spoiled_was_sound(tmp_path: Path) -> None:
    path = tmp_path / "x.params"
    for read, text in (
        (as_words, PROJECT),
        (TOML["preferences"], PREFERENCES),
        (OTHERS["vehicles"], VEHICLES_CSV),
        (OTHERS["gains"], GAINS),
    ):
        path.write_text(text)
        assert read(path)


def as_words(path: Path) -> object:
    """A project, and the command lines of its steps."""
    project = read_project(path)
    return [arguments(step, project.logs, ["out"] * number) for number, step in enumerate(project.steps)]


def text_of(name: str, sound: Path) -> str:
    from tests.hostile.samples import MAPPING

    if name in ("model", "candidate"):
        return (sound / "model.toml").read_text()
    if name == "vehicle":
        return vehicle_toml(VEHICLES["x500"])
    return {
        "layout": LAYOUT,
        "mapping": MAPPING.decode(),
        "controllers": CONTROLLERS,
        "project": PROJECT,
        "preferences": PREFERENCES,
    }[name]


def changed_text(chance: random.Random, text: str) -> bytes:
    """A document in TOML with words and numbers replaced, or with parts spoiled."""
    words = text.replace("[", " [ ").replace("]", " ] ").split(" ")
    for _ in range(chance.randint(1, 4)):
        place = chance.randrange(len(words))
        new = [
            *(repr(number) for number in EXTREMES),
            "[",
            "]",
            "{}",
            "9" * 400,
            "'x'",
            "true",
            "[[",
            '"\\u001b"',
            *ODD[:5],
        ]
        words[place] = chance.choice(new)
    changed = " ".join(words).encode("utf-8")
    return spoiled(chance, changed, (b"=", b"[", b'"""', b"\n")) if chance.random() < 0.3 else changed


def wrong_with(read: Callable[[Path], object], path: Path) -> str:
    try:
        with hang_limit():
            read(path)
    except RotoridError as error:
        said = str(error)
        return "" if len(said) < 4000 and error.came and "\n" not in said else f"{said[:200]!r} is no sentence"
    except Exception as error:
        trace = error.__traceback__
        while trace and trace.tb_next:
            trace = trace.tb_next
        where = f"{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}" if trace else ""
        return f"{type(error).__name__} {error!s:.100} at {where}"
    return ""


def compared(path: Path) -> object:
    """What ``rotorid compare`` makes of two results without a log."""
    from rotorid.documents.compare import compare_document, read_results
    from rotorid.identifying.comparison import compare

    entries = read_results([path, path.with_name("other.json")])
    return to_json(compare_document(compare(entries)))


def journal(folder: Path) -> bytes:
    """A journal of two logs, as a run writes it."""
    row = Row(
        **dict.fromkeys(("log", "log_sha256", "vehicle", "time_utc", "model", "parameter", "unit"), "a"),
        **dict.fromkeys(("findings", "format", "firmware", "settings"), "b"),
        **dict.fromkeys(("value", "std", "std_random", "lower", "upper"), 0.5),  # type: ignore[arg-type]
        flight=1,
    )
    failed = Failed(log="a", log_sha256="a", vehicle="v", flight=1, model="m", kind="refused", reason="r")
    whole = Journal(folder / "whole.journal")
    for name in "ab":
        whole.add(
            LogAnswer(log=name, place=name, mark="1-1", log_sha256=name, settings="0", rows=(row,), failed=(failed,))
        )
    return whole.path.read_bytes()


def taken_in(path: Path) -> object:
    """All that a run does with the journal of an earlier one."""
    known = Journal(path)
    known.read()
    answers = list(known.answers.values())
    return sorted_rows(answers), sorted_failures(answers), [answer.as_json() for answer in answers]


@pytest.mark.parametrize("count", [200, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["journal", "salt", "vehicles", "gains"])
def test_hostile_documents_of_other_kinds(name: str, count: int, tmp_path: Path) -> None:
    texts = {"salt": "0123456789abcdef" * 2, "vehicles": VEHICLES_CSV, "gains": GAINS}
    whole = journal(tmp_path) if name == "journal" else texts[name].encode()
    read = taken_in if name == "journal" else OTHERS[name]
    path = tmp_path / "x.params"
    found = []
    for number in range(count):
        chance = random.Random(f"{name} {number}")
        if name == "journal" and number % 2:
            head, *lines = whole.splitlines()
            twisted_lines = [json.dumps(twisted(chance, json.loads(line))).encode() for line in lines]
            path.write_bytes(b"\n".join([head, *twisted_lines, b""]))
        else:
            path.write_bytes(spoiled(chance, whole, (b",", b'"', b"\n", b"inf", "\u2460".encode(), b"\xff")))
        found += [f"{number}: {wrong}" for wrong in [wrong_with(read, path)] if wrong]
    assert found == []


READ_JSON: Mapping[str, Callable[[Path], object]] = MappingProxyType({**JSON, "compared": compared})


@pytest.mark.parametrize("count", [200, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", TOML)
def test_hostile_toml(name: str, count: int, sound: Path, tmp_path: Path) -> None:
    text = text_of(name, sound)
    found = []
    for number in range(count):
        path = tmp_path / "x.toml"
        path.write_bytes(changed_text(random.Random(f"{name} {number}"), text))
        found += [
            f"{number}: {wrong}" for wrong in [wrong_with(as_words if name == "project" else TOML[name], path)] if wrong
        ]
    assert found == []


@pytest.mark.parametrize("count", [200, pytest.param(2000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", READ_JSON)
def test_hostile_json(name: str, count: int, sound: Path, tmp_path: Path) -> None:
    file = "plan.json" if name == "plan" else "result.json"
    document = json.loads((sound / file).read_text())
    for beside in ("model.toml", "responses.npz"):
        (tmp_path / beside).write_bytes((sound / beside).read_bytes())
    (tmp_path / "other.json").write_text((sound / "result.json").read_text())
    found = []
    for number in range(count):
        chance = random.Random(f"{name} {number}")
        path = tmp_path / file
        text = json.dumps(twisted(chance, document))
        path.write_bytes(spoiled(chance, text.encode()) if chance.random() < 0.1 else text.encode())
        found += [f"{number}: {wrong}" for wrong in [wrong_with(READ_JSON[name], path)] if wrong]
    assert found == []
