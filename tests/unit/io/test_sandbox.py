"""The sandbox turns whatever a parser does into arrays or one sentence."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rotorid.errors import LogError
from rotorid.io.folders import clear_leftovers
from rotorid.io.sandbox import Extract, Limits, extract, protections

# A parser that does what it is told, put in the place of the one for MATLAB in the child alone.
PARSER = """
import ctypes, os, time
import numpy as np
from rotorid.errors import LogError
from rotorid.io.sandbox import Extract

def forked():
    try:
        child = os.fork()
    except OSError:
        return 0
    if child == 0:
        os.setsid(); time.sleep(60); os._exit(0)
    return 1

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
        case "write": open(options["at"], "w").write("owned")
        case "remove": os.remove(options["at"])
        case "read": return Extract(arrays={}, facts={"said": open(options["at"]).read()})
        case "list": return Extract(arrays={}, facts={"said": os.listdir(options["at"])})
        case "environment": return Extract(arrays={}, facts=dict(os.environ))
        case "connect":
            import socket
            for family, kind in ((socket.AF_INET, socket.SOCK_STREAM), (socket.AF_INET, socket.SOCK_DGRAM)):
                with socket.socket(family, kind) as one: one.connect(("127.0.0.1", options["port"]))
        case "fork":
            made = sum(forked() for _ in range(200))
            return Extract(arrays={}, facts={"made": made})
        case "run":
            os.execv("/bin/sh", ["sh", "-c", "echo owned"])
        case "link":
            os.symlink(options["at"], "arrays.npz")
        case "kill": os.kill(options["pid"], 0)
        case "thread":
            import threading
            done = []
            one = threading.Thread(target=lambda: done.append(1)); one.start(); one.join()
            return Extract(arrays={}, facts={"done": done})
        case "lie":
            open("answer.json", "w").write(options["answer"]); os._exit(0)
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


def run(path: Path, do: str, limits: Limits = LIMITS, **options: object) -> Extract:
    return extract("mat", path, {"do": do, **options}, limits=limits)


def needs(*names: str) -> None:
    """Skip where the system has not the means; ``protections`` says so."""
    if missing := [name for name in names if not protections()[name]]:
        pytest.skip(f"this system cannot protect {', '.join(missing)}")


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
        ("objects", "Python objects, which are not read"),
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


@pytest.fixture
def secret(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("home") / "key"
    path.write_text("secret")
    return path


@pytest.mark.parametrize("do", ["write", "remove", "read", "list", "link"])
def test_a_parser_sees_no_file_but_the_log(told: Path, secret: Path, do: str) -> None:
    needs("files")
    with pytest.raises(LogError, match="PermissionError"):
        run(told, do, at=str(secret.parent if do == "list" else secret))
    assert secret.read_text() == "secret"


def test_a_parser_cannot_change_the_log(told: Path) -> None:
    needs("files")
    with pytest.raises(LogError, match="PermissionError"):
        run(told, "write", at=str(told))
    assert told.read_bytes() == b"x"


def test_a_parser_gets_no_secrets_of_the_environment(told: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOME_TOKEN", "secret")
    assert "secret" not in run(told, "environment").facts.values()


def test_a_parser_has_no_network(told: Path) -> None:
    needs("network")
    with socket.create_server(("127.0.0.1", 0)) as server, pytest.raises(LogError, match="PermissionError"):
        run(told, "connect", port=server.getsockname()[1])


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no fork")
def test_a_parser_starts_no_processes_but_threads(told: Path) -> None:
    needs("processes")
    assert run(told, "fork").facts["made"] == 0
    assert run(told, "thread").facts["done"] == [1]
    for do in ("run", "kill"):
        with pytest.raises(LogError, match="PermissionError"):
            run(told, do, pid=os.getpid())


@pytest.mark.parametrize(
    "answer", ["", "[]", "{", '{"names": ["a"], "facts": {}}', '{"refused": {}}', '{"names": 1}', "[" * 100_000]
)
def test_what_a_parser_left_is_not_trusted(told: Path, answer: str) -> None:
    with pytest.raises(LogError, match="no answer that can be read"):
        run(told, "lie", answer=answer)


OUTLIVE = """
import sys
from pathlib import Path
from rotorid.io.sandbox import Limits, extract
extract("mat", Path(sys.argv[1]), {"do": "sleep"}, limits=Limits(memory_bytes=1 << 30, cpu_s=20, wall_s=60.0))
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are looked for in /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_parser_does_not_outlive_its_parent(told: Path, number: signal.Signals) -> None:
    needs("parent")
    home = told.parent / "temporary"
    home.mkdir()
    places = os.pathsep.join([str(told.parent), *filter(None, sys.path)])
    environment = os.environ | {"TMPDIR": str(home), "PYTHONPATH": places}
    parent = subprocess.Popen([sys.executable, "-c", OUTLIVE, told], env=environment, stderr=subprocess.DEVNULL)
    children = Path(f"/proc/{parent.pid}/task/{parent.pid}/children")
    until_s = time.monotonic() + 20.0
    while not (found := children.read_text().split()) and time.monotonic() < until_s:
        time.sleep(0.02)
    # Until it has limited itself.
    time.sleep(0.6)
    parent.send_signal(number)
    parent.wait()
    until_s = time.monotonic() + 10.0
    while alive(found[0]) and time.monotonic() < until_s:
        time.sleep(0.02)
    assert not alive(found[0])
    clear_leftovers(home)
    assert not list(home.iterdir())


def alive(process: str) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


LIMITED = """
import resource, sys
from pathlib import Path
from rotorid.errors import LogError
from rotorid.io.sandbox import extract
name, value = sys.argv[2], int(sys.argv[3])
resource.setrlimit(getattr(resource, name), (value, value))
try:
    print(sorted(extract("mat", Path(sys.argv[1]), {"names": ["q"]}).arrays))
except LogError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform in ("win32", "darwin"), reason="only Linux limits the addresses of a process")
@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("RLIMIT_AS", 3 << 30, "['q']"),
        ("RLIMIT_CPU", 60, "['q']"),
        ("RLIMIT_FSIZE", 1 << 24, "['q']"),
        ("RLIMIT_FSIZE", 1 << 16, "limits that this system has set"),
    ],
)
def test_limits_of_the_system_are_kept_and_the_file_is_not_blamed(
    tmp_path: Path, name: str, value: int, says: str
) -> None:
    from scipy.io import savemat

    savemat(tmp_path / "flight.mat", {"q": np.arange(50_000.0)})
    words = [sys.executable, "-c", LIMITED, str(tmp_path / "flight.mat"), name, str(value)]
    ran = subprocess.run(words, capture_output=True, text=True, check=False)
    assert says in ran.stdout, ran.stderr
