"""Hostile documents: every kind that is read, with words, numbers and parts replaced, or with its bytes spoiled.

Sound ones are what the package writes, or what its documentation shows. One seed, one document.
"""

from __future__ import annotations

import io
import json
import random
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.signal import lfilter
from tests.hostile.damage import Sample
from tests.hostile.samples import MAPPING
from tests.hostile.structured import EXTREMES, ODD, spoiled, twisted
from tests.hostile.test_documents import JSON, OTHERS, TOML

import rotorid
from rotorid.documents.base import to_json
from rotorid.documents.design import plan_document
from rotorid.documents.result import save
from rotorid.documents.results import load_results
from rotorid.documents.tune_check import load_foretold
from rotorid.documents.vehicle import vehicle_toml
from rotorid.excitation.plan import planned, sequence
from rotorid.fleets.table import SCHEMA, Failed, Journal, LogAnswer, Row, sorted_failures, sorted_rows
from rotorid.io.tables.csv import write_csv
from rotorid.io.tables.npz import read_arrays
from rotorid.lab.steps import arguments, read_project
from rotorid.settings.parsing import parse_segment
from rotorid.vehicles.catalog import VEHICLES

LAYOUT = '[[rotor]]\nposition_m = [0.1, 0.12, 0.0]\nspin = "ccw"\n[[rotor]]\nposition_m = [-0.1, 0.1, 0]\nspin = "cw"\n'
CONTROLLERS = '[pitch]\nproportional_s = 0.15\nintegral = 0.2\nangle_1_s = 6.0\nsetpoint = "theta_setpoint"\n'
PROJECT = (
    'schema = "rotorid.project/1"\nlogs = ["flight.csv"]\n[[steps]]\nverb = "identify"\nlogs = [1]\n'
    'models = ["rate.roll"]\nsegments = [{ axis = "roll", start_s = 0.0, stop_s = 60.0 }]\n'
)
PREFERENCES = 'theme = "dark"\nfrequency = "Hz"\nout = "results"\n'
VEHICLES_CSV = 'log,vehicle,time,group\na.csv,one,2026-01-01,x\n"b,c.csv",two,,\n'


class Sound:
    """Sound documents of a folder, each made when it is first asked for."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def result(self) -> Mapping[str, bytes]:
        """Files of an identified model, by name."""
        folder = self.folder / "result"
        names = ("result.json", "model.toml", "responses.npz")
        if not all((folder / name).is_file() for name in names):
            self._identify(folder)
        return {name: (folder / name).read_bytes() for name in names}

    def _identify(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.write_log(folder / "flight.csv")
        stretch = parse_segment("roll:0:60")
        save(rotorid.identify([rotorid.read(folder / "flight.csv")], "rate.roll", segments=[stretch]), folder)

    @staticmethod
    def write_log(path: Path) -> None:
        """A sweep of roll, from which a model is identified."""
        time_s = np.arange(0.0, 60.0, 0.01)
        command = 0.1 * np.sin(time_s + 0.25 * time_s**2)
        noise = 0.002 * np.random.default_rng(0).standard_normal(time_s.size)
        rate = lfilter([0.0, 0.4], [1.0, -0.92], command) + noise
        write_csv(path, time_s, {"roll_command": command, "p": rate})

    @cached_property
    def plan(self) -> bytes:
        """Two doublets."""
        sweep = planned("roll", "doublet", start_s=0.0, amplitude=0.1, duration_s=2.0, sample_rate_hz=50.0)
        step = planned("yaw", "doublet", start_s=0.0, amplitude=-0.2, duration_s=1.0, sample_rate_hz=50.0)
        return to_json(plan_document(sequence("two", [sweep, step], trim_s=2.5))).encode()

    @cached_property
    def results(self) -> bytes:
        """Several models, of which one is identified."""
        rows = [json.loads(self.result["result.json"]), {"model": "rate.pitch", "findings": []}]
        return json.dumps({"schema": "rotorid.results/1", "results": rows, "findings": []}).encode()

    @cached_property
    def proposal(self) -> bytes:
        """Gains of one axis."""
        size = {"value": 1.5, "std": 0.1, "lower": 1.3, "upper": 1.7, "unit": "1"}
        sizes = dict.fromkeys(("sensitivity_peak", "phase_margin_deg", "crossover_rad_s"), size)
        axis = dict.fromkeys(("flown", "proposed", "flown_whole", "proposed_whole"), sizes)
        axis |= {"changed": True, "band_rad_s": [1.0, 50.0], "attitude_ratio": size, "noise_ratio": 1.1}
        axis["gains"] = {"MC_ROLLRATE_P": {"flown": 0.15, "proposed": 0.2}}
        made = json.loads(self.result["result.json"])["provenance"] | {"settings": {"robustness": 1.7}}
        return json.dumps({"schema": "rotorid.tune/1", "axes": {"roll": axis}, "provenance": made}).encode()

    @cached_property
    def journal(self) -> bytes:
        """Two logs of a fleet, as a run writes them down."""
        row = Row(
            **dict.fromkeys(("log", "log_sha256", "vehicle", "time_utc", "model", "parameter", "unit"), "a"),
            **dict.fromkeys(("findings", "format", "firmware", "settings"), "b"),
            **dict.fromkeys(("value", "std", "std_random", "lower", "upper"), 0.5),  # type: ignore[arg-type]
            flight=1,
        )
        failed = Failed(log="a", log_sha256="a", vehicle="v", flight=1, model="m", kind="refused", reason="r")
        self.folder.mkdir(parents=True, exist_ok=True)
        whole = Journal(self.folder / "whole.journal")
        for name in "ab":
            whole.add(
                LogAnswer(
                    log=name, place=name, mark="1-1", log_sha256=name, settings="0", rows=(row,), failed=(failed,)
                )
            )
        return whole.path.read_bytes()

    @cached_property
    def table(self) -> bytes:
        """A table with the metadata of a fleet's."""
        import pyarrow
        from pyarrow import parquet

        schema = pyarrow.schema([("value", pyarrow.float64())], metadata={"rotorid": SCHEMA})
        buffer = io.BytesIO()
        parquet.write_table(pyarrow.table({"value": [1.0, 2.0]}, schema=schema), buffer)
        return buffer.getvalue()


_WORDS = re.compile(r'\[\[|\]\]|"[^"\n]*"|[^\s\[\]{},="]+|\s+|.', re.DOTALL)
Spoil = Callable[[random.Random, bytes], bytes]


def changed_toml(chance: random.Random, content: bytes) -> bytes:
    """A document in TOML with words and numbers replaced, or with parts spoiled."""
    words = _WORDS.findall(content.decode())
    places = [place for place, word in enumerate(words) if word.strip()]
    for _ in range(chance.randint(1, 3)):
        numbers = [repr(number) for number in EXTREMES]
        words[chance.choice(places)] = chance.choice(
            [*numbers, "[", "]", "{}", "9" * 400, "'x'", "true", "[[", '"\\u001b"', *ODD[:5], *ODD[-3:]]
        )
    changed = "".join(words).encode()
    return spoiled(chance, changed, (b"=", b"[", b'"""', b"\n")) if chance.random() < 0.2 else changed


def changed_json(chance: random.Random, content: bytes) -> bytes:
    """A document in JSON with parts of another kind or size, or with parts spoiled."""
    text = json.dumps(twisted(chance, json.loads(content))).encode()
    return spoiled(chance, text) if chance.random() < 0.1 else text


def changed_lines(chance: random.Random, content: bytes) -> bytes:
    """A journal, of which each line behind the first is a document in JSON."""
    if chance.random() < 0.5:
        return changed_text(chance, content)
    head, *lines = content.splitlines()
    return b"\n".join([head, *(json.dumps(twisted(chance, json.loads(line))).encode() for line in lines), b""])


def changed_text(chance: random.Random, content: bytes) -> bytes:
    """Any other document, with its bytes spoiled."""
    return spoiled(chance, content, (b",", b'"', b"\n", b"inf", "\u2460".encode(), b"\xff", b"=", b"9" * 400))


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of document.

    Parameters
    ----------
    read
        What commands and programs read it with.
    spoil
        Makes a hostile one.
    sound
        Sound ones, of which each is spoiled in turn.
    name
        Name of its file.
    beside
        Whether files of a result stand next to it.
    """

    read: Callable[[Path], object]
    spoil: Spoil
    sound: Callable[[Sound], Sequence[bytes]]
    name: str = "x.toml"
    beside: bool = False


def as_words(path: Path) -> object:
    """A project, and the command lines of its steps."""
    project = read_project(path)
    return [arguments(step, project.logs, ["out"] * number) for number, step in enumerate(project.steps)]


def compared(path: Path) -> object:
    """What ``rotorid compare`` makes of two results without a log."""
    from rotorid.documents.compare import compare_document, read_results
    from rotorid.identifying.comparison import compare

    entries = read_results([path, path.with_name("other.json")])
    return to_json(compare_document(compare(entries)))


def taken_in(path: Path) -> object:
    """All that a run does with the journal of an earlier one."""
    known = Journal(path)
    known.read()
    answers = list(known.answers.values())
    return sorted_rows(answers), sorted_failures(answers), [answer.as_json() for answer in answers]


def _gains(_: Sound) -> Sequence[bytes]:
    from tests.hostile.test_gain_file_damage import SOUND

    return [text.encode() for text in SOUND.values()]


def _toml(name: str, sound: Callable[[Sound], bytes]) -> Kind:
    return Kind(read=TOML[name], spoil=changed_toml, sound=lambda made: [sound(made)])


def _text(name: str, text: str) -> Kind:
    return Kind(read=OTHERS[name], spoil=changed_text, sound=lambda _: [text.encode()], name="x")


def _json(read: Callable[[Path], object], name: str, sound: Callable[[Sound], bytes], *, beside: bool = False) -> Kind:
    return Kind(read=read, spoil=changed_json, sound=lambda made: [sound(made)], name=name, beside=beside)


def _result(read: Callable[[Path], object]) -> Kind:
    return _json(read, "result.json", lambda made: made.result["result.json"], beside=True)


DOCUMENTS: Mapping[str, Kind] = MappingProxyType(
    {
        "layout": _toml("layout", lambda _: LAYOUT.encode()),
        "model": _toml("model", lambda made: made.result["model.toml"]),
        "mapping file": _toml("mapping", lambda _: MAPPING),
        "controllers": _toml("controllers", lambda _: CONTROLLERS.encode()),
        "model of a result": _toml("candidate", lambda made: made.result["model.toml"]),
        "vehicle": _toml("vehicle", lambda _: vehicle_toml(VEHICLES["x500"]).encode()),
        "project": Kind(read=as_words, spoil=changed_toml, sound=lambda _: [PROJECT.encode()]),
        "preferences": _toml("preferences", lambda _: PREFERENCES.encode()),
        "plan": _json(JSON["plan"], "plan.json", lambda made: made.plan),
        "result": _result(JSON["result"]),
        "result to verify": _result(TOML["candidate"]),
        "prior": _result(JSON["prior"]),
        "compared results": _result(compared),
        "several results": _json(lambda path: load_results([path]), "results.json", lambda made: made.results),
        "proposal": _json(load_foretold, "tune.json", lambda made: made.proposal),
        "arrays": Kind(
            read=read_arrays,
            spoil=changed_text,
            sound=lambda made: [made.result["responses.npz"]],
            name="responses.npz",
        ),
        "journal": Kind(read=taken_in, spoil=changed_lines, sound=lambda made: [made.journal], name="fleet.journal"),
        "fleet table": Kind(
            read=OTHERS["table"], spoil=changed_text, sound=lambda made: [made.table], name="x.parquet"
        ),
        "salt": _text("salt", "0123456789abcdef" * 2),
        "token": _text("token", "a-long-token-of-letters"),
        "vehicles": _text("vehicles", VEHICLES_CSV),
        "gains": Kind(read=OTHERS["gains"], spoil=changed_text, sound=_gains, name="x.params"),
    }
)
"""Every kind of document, with what reads it and what spoils it."""


def hostile_documents(name: str, count: int, made: Sound, seed: int = 0) -> Iterator[Sample]:
    """So many hostile documents of a kind; one seed, one list."""
    kind, sound = DOCUMENTS[name], sound_documents(name, made)
    for number in range(count):
        chance = random.Random(f"{name} {seed} {number}")
        sample = sound[number % len(sound)]
        yield replace(sample, content=kind.spoil(chance, sample.content))


def sound_documents(name: str, made: Sound) -> list[Sample]:
    """The documents that are spoiled, with the files that they need."""
    kind = DOCUMENTS[name]
    beside = {**made.result, "other.json": made.result["result.json"]} if kind.beside else {}
    if name == "several results":
        beside = {f"rate.roll/{file}": content for file, content in made.result.items()}
    return [Sample(name=kind.name, content=content, beside=beside) for content in kind.sound(made)]
