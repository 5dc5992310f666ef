"""Bad input: one clear sentence, the right exit code, no traceback, and nothing left behind."""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.unit.cli.commands import ROLL, Ran, fly_roll_sweeps, rotorid

from rotorid.documents.result import ResultDocument
from rotorid.io.tables.csv import write_csv

NOTHING_FLOWN_S = 60.0
RATE_HZ = 100.0


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    log = tmp_path_factory.mktemp("flight") / "sweeps.csv"
    fly_roll_sweeps(log)
    return log


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working folder, so that anything left behind shows."""
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return folder


def assert_one_sentence(ran: Ran, code: int, *, told: bool = False) -> str:
    """The sentence of an error; ``told`` under ``--json``, where scripts find it on standard output too."""
    assert ran.code == code, ran.err
    assert "Traceback" not in ran.err
    sentence, *remarks = ran.err.strip().splitlines()
    assert sentence.startswith("rotorid: ")
    assert sentence.endswith((".", "?"))
    assert all(remark.startswith("  ") for remark in remarks)
    if code == 2:
        assert remarks == []
        if told:
            document = json.loads(ran.out)
            assert (document["schema"], f"rotorid: {document['message']}") == ("rotorid.error/1", sentence)
        else:
            assert ran.out == ""
    return sentence


def noise_log(path: Path, *, without: str = "", duration_s: float = NOTHING_FLOWN_S) -> Path:
    """A log in which nothing was flown on purpose."""
    rng = np.random.default_rng(0)
    time_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    names = [name for name in ("roll_command", "p", "phi_setpoint") if name != without]
    write_csv(path, time_s, {name: 1e-3 * rng.standard_normal(time_s.size) for name in names})
    return path


def not_a_log(folder: Path) -> Path:
    path = folder / "notes.txt"
    path.write_text("dear diary", encoding="utf-8")
    return path


def binary_noise(folder: Path) -> Path:
    path = folder / "noise.ulg"
    path.write_bytes(np.random.default_rng(0).bytes(10_000))
    return path


def empty(folder: Path) -> Path:
    path = folder / "empty.BIN"
    path.touch()
    return path


def missing(folder: Path) -> Path:
    return folder / "nowhere.ulg"


def a_folder(folder: Path) -> Path:
    return folder


def header_only(folder: Path) -> Path:
    path = folder / "header.csv"
    path.write_text("time [s],roll_command [1],p [rad/s]\n", encoding="utf-8")
    return path


def cut_in_a_line(folder: Path) -> Path:
    path = folder / "cut.csv"
    path.write_text("time [s],roll_command [1],p [rad/s]\n0,0,0\n0.01,0.1,0\n0.02,0.", encoding="utf-8")
    return path


def half_an_archive(folder: Path) -> Path:
    path = folder / "half.csv.gz"
    path.write_bytes(gzip.compress(b"time [s],p [rad/s]\n" + b"0,0\n" * 1000)[:-20])
    return path


def ulog_header(folder: Path) -> Path:
    path = folder / "short.ulg"
    path.write_bytes(b"ULog\x01\x12\x35\x01" + bytes(8))
    return path


UNREADABLE = [
    *(not_a_log, binary_noise, empty, missing, a_folder, header_only, cut_in_a_line, half_an_archive),
    ulog_header,
]


@pytest.mark.parametrize("broken", UNREADABLE, ids=lambda make: getattr(make, "__name__", None))
@pytest.mark.parametrize("command", ["identify", "inspect"])
def test_unreadable_file(broken: Callable[[Path], Path], command: str, tmp_path: Path, here: Path) -> None:
    log = broken(tmp_path)
    options = ROLL if command == "identify" else ()
    sentence = assert_one_sentence(rotorid(command, log, *options, "--json"), 2, told=True)
    assert log.name in sentence
    assert ("check the path" if broken is missing else "expected ") in sentence
    assert list(here.iterdir()) == []


def test_truncated_real_log_is_read_as_far_as_it_goes_or_refused(shared_data: Path, tmp_path: Path, here: Path) -> None:
    whole = (shared_data / "px4_sitl" / "roll.ulg").read_bytes()
    for share, code, names in ((0.001, 2, "cut.ulg"), (0.3, 1, "roll_command")):
        cut = tmp_path / "cut.ulg"
        cut.write_bytes(whole[: int(share * len(whole))])
        ran = rotorid("identify", cut, "--model", "rate.roll")
        assert names in assert_one_sentence(ran, code)
    assert "corrupt_log: " in ran.err
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    ("make", "kind", "says"),
    [
        (lambda f: noise_log(f / "no_rate.csv", without="p"), "missing_channel", "has no p"),
        (lambda f: noise_log(f / "no_input.csv", without="roll_command"), "missing_channel", "has no roll_command"),
        (lambda f: noise_log(f / "calm.csv"), "no_excitation", "contains no excitation of roll"),
    ],
    ids=["missing output", "missing input", "no excitation"],
)
def test_data_that_cannot_support_the_model(
    make: Callable[[Path], Path], kind: str, says: str, tmp_path: Path, here: Path
) -> None:
    log = make(tmp_path)
    segment = () if kind == "no_excitation" else ("--segment", "roll:1:50")
    ran = rotorid("identify", log, *ROLL, *segment, "--json")
    assert says in assert_one_sentence(ran, 1)
    document = ResultDocument.model_validate_json(ran.out)
    assert kind in {finding.kind for finding in document.findings if finding.severity == "error"}
    assert document.parameters == {}
    assert document.cost is None
    assert document.provenance.inputs.keys() == {log.name}
    assert list(here.iterdir()) == []


def test_record_shorter_than_two_windows(flight: Path, here: Path) -> None:
    ran = rotorid("identify", flight, "--model", "rate.roll", "--segment", "roll:20:23", "--band", "12:20", "--json")
    sentence = assert_one_sentence(ran, 1)
    assert "record of 3 s" in sentence
    assert "two windows" in sentence
    kinds = {finding.kind for finding in ResultDocument.model_validate_json(ran.out).findings}
    assert "record_too_short" in kinds
    assert list(here.iterdir()) == []


def test_segment_outside_the_log_says_where_the_log_is(flight: Path, here: Path) -> None:
    sentence = assert_one_sentence(rotorid("identify", flight, *ROLL, "--segment", "roll:500:600"), 2)
    assert "0.0 to 111.0 s of sweeps.csv" in sentence
    assert list(here.iterdir()) == []


WRONG_USE = {
    "unknown model": ("--model", "rate.rol"),
    "model file missing": ("--model", "nowhere.toml"),
    "model is a folder": ("--model", "folder.toml"),
    "band of one": ("--band", "8"),
    "band of words": ("--band", "low:high"),
    "band backwards": ("--band", "50:12"),
    "band negative": ("--band=-1:50",),
    "band endless": ("--band", "1:inf"),
    "band not a number": ("--band", "nan:50"),
    "band beyond Nyquist": ("--band", "1000:2000"),
    "segment of two": ("--segment", "roll:1"),
    "segment of no axis": ("--segment", "sideways:1:50"),
    "segment backwards": ("--segment", "roll:50:1"),
    "segment endless": ("--segment", "roll:0:inf"),
    "segment not a number": ("--segment", "roll:nan:50"),
    "fix without value": ("--fix", "L_p"),
    "fix unknown name": ("--fix", "L_q=1"),
    "fix a word": ("--fix", "L_p=low"),
    "fix not a number": ("--fix", "L_p=nan"),
    "fix out of bounds": ("--fix", "tau_roll=-1"),
    "windows of words": ("--windows", "long,short"),
    "windows of nothing": ("--windows", ","),
    "windows of no length": ("--windows", "0"),
    "windows negative": ("--windows=-3",),
    "windows endless": ("--windows", "inf"),
    "windows absurd": ("--windows", "1e300"),
    "coherence above one": ("--coherence", "1.5"),
    "coherence not a number": ("--coherence", "nan"),
    "estimate unknown": ("--estimate", "guess"),
    "instrument with direct": ("--estimate", "direct", "--instrument", "roll_excitation"),
    "two instruments": ("--instrument", "roll_excitation,p"),
    "map for a foreign column": ("--map", "map.toml"),
    "map missing": ("--map", "nowhere.toml"),
}


@pytest.mark.parametrize("options", WRONG_USE.values(), ids=WRONG_USE)
def test_wrong_use(options: tuple[str, ...], flight: Path, here: Path) -> None:
    (here / "folder.toml").mkdir()
    (here / "map.toml").write_text('[channels.p]\nsource = "gyro"\ntime = "time [s]"\nunit = "rad/s"\n')
    model = () if "--model" in options else ROLL[:2]
    assert_one_sentence(rotorid("identify", flight, *model, *options), 2)
    assert {path.name for path in here.iterdir()} == {"folder.toml", "map.toml"}


@pytest.mark.parametrize("json_too", [(), ("--json",)], ids=["", "json"])
@pytest.mark.parametrize("option", [("--coherence", "high"), ("--seed", "x"), ("--frobnicate",)], ids=lambda o: o[0])
def test_options_that_the_parser_refuses(
    option: tuple[str, ...], json_too: tuple[str, ...], flight: Path, here: Path
) -> None:
    sentence = assert_one_sentence(rotorid("identify", flight, *ROLL, *option, *json_too), 2, told=bool(json_too))
    assert option[0] in sentence
    assert "needs a" in sentence or "see rotorid identify --help-all" in sentence
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [("frobnicate",), ("identify",), ("review",), ("--frobnicate",), ("track", "a", "b")],
)
def test_words_that_are_no_command(words: tuple[str, ...], here: Path) -> None:
    assert_one_sentence(rotorid(*words, "--json"), 2, told=True)
    assert list(here.iterdir()) == []


def test_the_same_log_twice(flight: Path, here: Path, tmp_path: Path) -> None:
    assert "given twice" in assert_one_sentence(rotorid("identify", flight, flight, *ROLL), 2)
    copy = tmp_path / "copy.csv"
    copy.write_bytes(flight.read_bytes())
    assert "are the same log" in assert_one_sentence(rotorid("identify", flight, copy, *ROLL), 2)
    assert list(here.iterdir()) == []


@pytest.mark.parametrize(("place", "says"), [("taken", "is a file"), ("taken/deeper", "cannot be written")])
def test_out_that_cannot_be_written(place: str, says: str, flight: Path, here: Path) -> None:
    (here / "taken").write_text("mine", encoding="utf-8")
    sentence = assert_one_sentence(rotorid("identify", flight, *ROLL, "--out", place), 2)
    assert says in sentence
    assert (here / "taken").read_text(encoding="utf-8") == "mine"
    assert [path.name for path in here.iterdir()] == ["taken"]


def test_a_report_that_fails_leaves_no_half_result(flight: Path, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> str:
        raise KeyboardInterrupt

    monkeypatch.setattr("rotorid.report.identification.render_report", fail)
    ran = rotorid("identify", flight, *ROLL, "--out", "results")
    assert ran.code == 130
    assert list(here.iterdir()) == []
