"""The sandbox turns whatever a parser does into arrays or one sentence."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from rotorid.errors import LogError
from rotorid.io.sandbox import Extract, Limits, extract

# A parser that does what it is told, put in the place of the one for MATLAB in the child alone.
PARSER = """
import ctypes, os, time
import numpy as np
from rotorid.errors import LogError
from rotorid.io.sandbox import Extract

def extract(path, options):
    print("noise on standard output")
    match options["do"]:
        case "work":
            arrays = {"../odd name": np.arange(3.0), "b": np.array([1, 2], "<u8")}
            return Extract(arrays=arrays, facts={"n": 1})
        case "refuse": raise LogError("a came", needed="b", remedy="c")
        case "raise": raise ZeroDivisionError("by zero")
        case "recurse": return extract(path, options)
        case "sleep": time.sleep(60)
        case "spin":
            while True: pass
        case "memory": return Extract(arrays={"a": np.empty(1 << 27)[:0]}, facts={})
        case "crash": ctypes.string_at(0)
        case "exit": os._exit(3)
        case "objects": return Extract(arrays={"a": np.array([object()])}, facts={})
"""
CUSTOMIZE = """
import rotorid.io.sandbox
rotorid.io.sandbox.PARSERS = {"mat": "told_parser"}
"""
LIMITS = Limits(memory_bytes=1 << 30, cpu_s=20, wall_s=20.0)


@pytest.fixture
def told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "told_parser.py").write_text(PARSER)
    (tmp_path / "sitecustomize.py").write_text(CUSTOMIZE)
    (tmp_path / "flight.mat").write_bytes(b"x")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    return tmp_path / "flight.mat"


def run(path: Path, do: str, limits: Limits = LIMITS) -> Extract:
    return extract("mat", path, {"do": do}, limits=limits)


def test_arrays_and_facts_come_back_whatever_their_names(told: Path) -> None:
    found = run(told, "work")
    assert found.arrays["../odd name"].tolist() == [0.0, 1.0, 2.0]
    assert found.arrays["b"].dtype == np.dtype("<u8")
    assert found.facts == {"n": 1}


def test_a_refusal_keeps_its_three_sentences(told: Path) -> None:
    with pytest.raises(LogError) as caught:
        run(told, "refuse")
    assert (caught.value.came, caught.value.needed, caught.value.remedy) == ("a came", "b", "c")


@pytest.mark.parametrize(
    ("do", "sentence"),
    [
        ("raise", "ZeroDivisionError: by zero"),
        ("recurse", "nested without end"),
        ("exit", "ended with code 3"),
        ("objects", "would have to be pickled"),
    ],
)
def test_whatever_a_parser_raises_is_one_sentence(told: Path, do: str, sentence: str) -> None:
    with pytest.raises(LogError, match=sentence):
        run(told, do)


def test_a_hanging_parser_is_ended_by_the_clock(told: Path) -> None:
    with pytest.raises(LogError, match="had not ended after 1 s"):
        run(told, "sleep", Limits(memory_bytes=1 << 30, cpu_s=20, wall_s=1.0))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")
def test_a_crash_is_one_sentence(told: Path) -> None:
    with pytest.raises(LogError, match=r"crashed on it .signal SIG(SEGV|BUS)"):
        run(told, "crash")


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="only Linux limits the addresses of a process")
def test_a_parser_gets_the_memory_of_its_limits_and_no_more(told: Path) -> None:
    """One gibibyte, which no page of this machine need hold: refused at a limit of one, and given at one of four."""
    with pytest.raises(LogError, match="it asked for more than 1024 MiB of memory"):
        run(told, "memory")
    assert run(told, "memory", Limits(memory_bytes=4 << 30, cpu_s=20, wall_s=20.0)).arrays["a"].size == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such limits")
def test_a_spinning_parser_is_ended_by_its_processor_time(told: Path) -> None:
    with pytest.raises(LogError, match="after 1 s of processor time"):
        run(told, "spin", Limits(memory_bytes=1 << 30, cpu_s=1, wall_s=20.0))


def test_modules_in_the_folder_of_the_log_are_never_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "numpy.py").write_text("raise SystemExit('a module next to the log was imported')")
    (tmp_path / "flight.mat").write_bytes(b"no MATLAB file")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    with pytest.raises(LogError, match="MatReadError"):
        extract("mat", tmp_path / "flight.mat", {})
