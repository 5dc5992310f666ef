"""Damaged Parquet tables: a record or one sentence, and no more memory than a log may take."""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from rotorid.data.record import FlightRecord, Source
from rotorid.errors import RotoridError
from rotorid.io.tables import parquet

pa = pytest.importorskip("pyarrow", reason="the extra [parquet] is not installed")
pq = pytest.importorskip("pyarrow.parquet", reason="the extra [parquet] is not installed")

SOURCE = Source(name="flight.parquet", format=parquet.FORMAT, sha256="")


def outcome(folder: Path, content: bytes) -> FlightRecord | str:
    (folder / "flight.parquet").write_bytes(content)
    try:
        return parquet.read(folder / "flight.parquet", SOURCE, sandbox=False)
    except RotoridError as error:
        return str(error)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("parquet") / "flight.parquet"
    table = pa.table({"time [s]": np.arange(60.0), "q [rad/s]": np.sin(np.arange(60.0))})
    pq.write_table(table, path, write_page_checksum=True)
    return path.read_bytes()


def test_every_cut_is_one_sentence(tmp_path: Path, sound: bytes) -> None:
    for cut in np.linspace(0, len(sound) - 1, 220).astype(int).tolist():
        found = outcome(tmp_path, sound[:cut])
        assert isinstance(found, str)
        assert found.startswith("flight.parquet")


FLIPS = """
import sys
from pathlib import Path
import numpy as np
from rotorid.errors import LogError
from rotorid.io.tables.parquet import extract

sound, path = Path(sys.argv[1]).read_bytes(), Path(sys.argv[2])
rng = np.random.default_rng(int(sys.argv[3]))
for place in rng.integers(len(sound), size=50).tolist():
    content = bytearray(sound)
    content[place] ^= 1 << int(rng.integers(8))
    path.write_bytes(content)
    try:
        extract(path, {"names": []})
    except LogError as error:
        assert path.name in str(error)
"""


@pytest.mark.parametrize("seed", [*range(3), *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(3, 10))])
def test_flipped_bits_end_in_numbers_in_one_sentence_or_in_an_abort_of_the_child(
    tmp_path: Path, sound: bytes, seed: int
) -> None:
    """What the child of the sandbox meets: the parser may abort, and may neither hang nor raise anything else."""
    (tmp_path / "sound").write_bytes(sound)
    command = [sys.executable, "-c", FLIPS, str(tmp_path / "sound"), str(tmp_path / "flight.parquet"), str(seed)]
    finished = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    # A negative code is the signal that ended the child.
    assert finished.returncode <= 0, finished.stderr


@pytest.mark.parametrize("seed", range(4))
def test_a_damaged_table_is_survived_behind_the_sandbox(tmp_path: Path, sound: bytes, seed: int) -> None:
    content = bytearray(sound)
    rng = np.random.default_rng(seed)
    for place in rng.integers(4, len(content) - 8, 20).tolist():
        content[place] = int(rng.integers(256))
    (tmp_path / "flight.parquet").write_bytes(content)
    with suppress(RotoridError):
        assert isinstance(parquet.read(tmp_path / "flight.parquet", SOURCE), FlightRecord)


def test_a_bomb_is_refused_before_it_takes_memory(tmp_path: Path) -> None:
    path = tmp_path / "bomb.parquet"
    zeros = pa.table({"time [s]": np.zeros(1 << 20), "q [rad/s]": np.zeros(1 << 20)})
    with pq.ParquetWriter(path, zeros.schema, compression="zstd") as writer:
        for _ in range(12):
            writer.write_table(zeros)
    content = path.read_bytes()
    assert len(content) < 1 << 18
    before = pa.total_allocated_bytes()
    found = outcome(tmp_path, content)
    assert isinstance(found, str)
    assert "declares columns of 192 MiB" in found
    assert pa.total_allocated_bytes() - before < 1 << 20


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1PAR1", b"PAR1" + b"\xff" * 99 + b"PAR1", b"%PDF-1.7" * 9])
def test_foreign_files_are_one_sentence(tmp_path: Path, content: bytes) -> None:
    found = outcome(tmp_path, content)
    assert isinstance(found, str)
    assert "cannot be read as a Parquet table" in found
