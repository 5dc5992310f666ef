"""The smallest inputs that hurt once, as a person would give them: the right exit code, one sentence, no hang.

Names that are no text, letters that a terminal obeys, pipes, and what a spreadsheet would compute.
"""

from __future__ import annotations

import json
import os
import struct
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from scipy.io import savemat
from tests.hostile.damage import hang_limit
from tests.unit.cli.commands import Ran, rotorid

from rotorid.data.flight_plan import FlightPlan
from rotorid.errors import LogError
from rotorid.excitation.plan import planned, sequence
from rotorid.io.tables.csv import write_csv
from rotorid.io.tables.matlab import extract
from rotorid.letters import HIDDEN
from rotorid.plans.csv import plan_csv

STAMPS = [round(0.004 * k, 4) for k in range(3000)]


def table(stamps: Sequence[float], name: str = "p [rad/s]") -> bytes:
    rows = [f"{stamp!r},{np.sin(0.3 * k):.6f},{np.cos(0.3 * k):.6f}" for k, stamp in enumerate(stamps)]
    return "\n".join([f"time [s],{name},roll_command [1]", *rows, ""]).encode()


def npz(path: Path) -> None:
    header = ("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1" * 60 + "x), }").encode()
    header += b" " * (63 - (10 + len(header)) % 64) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("time.npy", b"\x93NUMPY\x01\0" + struct.pack("<H", len(header)) + header)


ERASED = (
    b"H Product:Blackbox flight data recorder by Nicholas Sherlock\nH Field I name:loopIteration,time,gyroADC[0]\n"
    b"H Field I signed:0,0,1\nH Field I predictor:0,0,0\nH Field I encoding:1,1,0\nH Field P predictor:6,2,1\n"
    b"H Field P encoding:9,0,0\nH looptime:125\n" + b"\xff" * (1 << 18) + b"\0"
)

CASES: Mapping[str, tuple[Callable[[Path], object], int, str]] = MappingProxyType(
    {
        "a jump of 2.3 days": (
            lambda path: path.write_bytes(table([t + 2e5 * (k >= 1500) for k, t in enumerate(STAMPS)])),
            0,
            "gap",
        ),
        "a first stamp of zero": (
            lambda path: path.write_bytes(table([t + 1.7e9 * (k >= 1) for k, t in enumerate(STAMPS)])),
            0,
            "clock_disorder",
        ),
        "every stamp twice": (
            lambda path: path.write_bytes(table([STAMPS[k // 2 * 2] for k in range(3000)])),
            0,
            "clock_disorder",
        ),
        "a clock that wraps": (
            lambda path: path.write_bytes(table([t if k < 1500 else t - 2**64 / 1e6 for k, t in enumerate(STAMPS)])),
            0,
            "clock_disorder",
        ),
        "a shape of many digits": (npz, 2, "header of time.npy is damaged"),
        "erased memory": (lambda path: path.write_bytes(ERASED), 2, "expected "),
        "a header that does not end": (
            lambda path: path.write_bytes(
                ERASED.replace(b"H looptime", b"".join(b"H a%d:1\n" % k for k in range(20_000)) + b"H looptime")
            ),
            2,
            "more than 20000 lines",
        ),
        "a header that colors the terminal": (
            lambda path: path.write_bytes(b"time [s],\x1b]0;owned\x07\x1b[31mevil [furlong]\n0,1\n1,2\n"),
            2,
            "\\x1b[31mevil",
        ),
        "a header that turns the line": (
            lambda path: path.write_text("time [s],\u202eevil [furlong]\n0,1\n1,2\n", encoding="utf-8"),
            2,
            "\\u202eevil",
        ),
    }
)


def inspected(path: Path, *options: str) -> Ran:
    with hang_limit():
        ran = rotorid("inspect", path, *options)
    assert "Traceback" not in ran.err
    assert not HIDDEN.search(ran.out + ran.err)
    return ran


@pytest.mark.parametrize("name", CASES)
def test_a_log_that_hurt_once(name: str, tmp_path: Path) -> None:
    make, code, said = CASES[name]
    make(tmp_path / "flight.log")
    ran = inspected(tmp_path / "flight.log")
    assert ran.code == code, ran.err
    assert said in ran.out + ran.err


@pytest.mark.skipif(os.name != "posix", reason="names of files are text here")
def test_a_name_that_is_no_text_is_shown(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/bad\xff\x1b[31m\nname.csv"))
    try:
        path.write_bytes(table(STAMPS))
    except OSError:
        pytest.skip("this file system takes no such name")
    document = json.loads(inspected(path, "--json").out)
    assert "bad\\xff\\x1b[31m" in json.dumps(document, ensure_ascii=False).replace("\\\\", "\\")
    assert "bad\\xff" in inspected(path).out
    path.write_bytes(b"nothing")
    refused = inspected(path)
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)
    out = tmp_path / "results"
    path.write_bytes(table(STAMPS))
    assert inspected(path, "--out", str(out)).code == 0
    assert (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes here")
@pytest.mark.parametrize("option", [(), ("--json",)], ids=["", "json"])
def test_pipes_and_devices_are_refused_at_once(option: tuple[str, ...], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, word in ((tmp_path / "pipe", "is a pipe"), (Path("/dev/zero"), "is a device")):
        ran = inspected(path, *option)
        assert (ran.code, bool(ran.out)) == (2, bool(option))
        assert word in ran.err
    write_csv(tmp_path / "flight.csv", np.arange(10.0), {"p": np.zeros(10)})
    ran = rotorid("inspect", tmp_path / "flight.csv", "--map", tmp_path / "pipe")
    assert (ran.code, "is a pipe" in ran.err) == (2, True)


@pytest.mark.parametrize("name", ["=cmd|' /C calc'!A0", "@SUM(A1)", "+1", "-1", "\t=1", "\x1b[2J"])
def test_no_cell_of_a_table_is_computed_by_a_spreadsheet(name: str, tmp_path: Path) -> None:
    step = planned("roll", "doublet", start_s=0.0, amplitude=0.1, duration_s=1.0, sample_rate_hz=20.0)
    plan: FlightPlan = sequence(name, [step], trim_s=0.5)
    write_csv(tmp_path / "flight.csv", np.arange(3.0), {"p": np.array([0.0, -1e-9, 1e308])})
    for text in (plan_csv(plan)["plan.csv"], (tmp_path / "flight.csv").read_text()):
        for cell in text.replace("\n", ",").split(","):
            try:
                float(cell or "0")
            except ValueError:
                assert cell[:1].isalpha(), cell


def test_arrays_by_the_thousand_are_no_channels(tmp_path: Path) -> None:
    """Unless somebody names those that are wanted."""
    path = tmp_path / "flight.mat"
    savemat(path, {f"v{number}": np.zeros(1) for number in range(5001)})
    with pytest.raises(LogError, match=r"has 5001 arrays; expected at most 5000"):
        extract(path, {"names": []})
    assert extract(path, {"names": ["v7"]}).arrays.keys() == {"v7"}
