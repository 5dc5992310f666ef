"""Every reader and every document against inputs with a sound structure and hostile contents.

Some of each kind in every run, 2000 under ``-m slow``, made by one seed: no traceback, nothing that takes 20 s, no more
than 1 GiB, an error that says what came, what was needed and what to do, no control on the console or in the JSON.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.hostile.campaign import COUNT, Outcome, outcomes, table, tried
from tests.hostile.structured import BUILDERS, sound
from tests.hostile.structured_documents import DOCUMENTS, Sound, sound_documents
from tests.hostile.test_documents import JSON, OTHERS, TOML

from rotorid.io.formats import READERS

pytest.importorskip("resource", reason="limits of memory are those of Unix")

CHEAP = tuple(name for name in BUILDERS if name != "ROS")
ROUTINE_LOGS, ROUTINE_DOCUMENTS = 25, 50
NEEDS = {"ROS": "rosbags", "HDF5": "h5py", "Parquet": "pyarrow", "fleet table": "pyarrow"}
CHECKSUMMED = {"arrays", "fleet table"}
"""Documents of which few damaged ones can be read: their checksums do not match."""


def available(kinds: tuple[str, ...]) -> tuple[str, ...]:
    """Kinds whose extras are installed."""
    found = []
    for kind in kinds:
        try:
            __import__(NEEDS.get(kind, "rotorid"))
        except ImportError:
            continue
        found.append(kind)
    if not found:
        pytest.skip(f"the extra of {', '.join(kinds)} is not installed")
    return tuple(found)


def faults(found: list[Outcome]) -> list[str]:
    return [f"{one.kind} {one.number}: {one.fault}" for one in found if one.fault]


@pytest.mark.parametrize("kinds", [CHEAP, ("ROS",)], ids=["own", "ROS"])
def test_hostile_logs(kinds: tuple[str, ...], tmp_path: Path) -> None:
    found = tried(tmp_path / "inputs", available(kinds), ROUTINE_LOGS, whole=False, kept=tmp_path / "kept.tsv")
    assert faults(found) == []
    # What is only refused tries nothing.
    assert sum(one.said != "refused" for one in found) > 0.2 * len(found)


def test_hostile_documents(tmp_path: Path) -> None:
    kinds = available(tuple(DOCUMENTS))
    found = tried(tmp_path / "inputs", kinds, ROUTINE_DOCUMENTS, whole=True, kept=tmp_path / "kept.tsv")
    assert faults(found) == []
    # What is only refused tries nothing; a few dozen of a kind may be, where most damage ends the parsing.
    vain = [kind for kind in kinds if not any(one.said == "read" for one in found if one.kind == kind)]
    assert len(set(vain) - CHECKSUMMED) < 0.3 * len(kinds), vain


@pytest.mark.slow
@pytest.mark.parametrize("kind", [*BUILDERS, *DOCUMENTS])
def test_thousands_of_each(kind: str, tmp_path: Path) -> None:
    """Each inspected, shown on the console, and some put through the estimation of a model."""
    found = tried(tmp_path / "inputs", available((kind,)), COUNT, whole=True, kept=tmp_path / "kept.tsv")
    assert faults(found) == []


def test_every_reader_and_every_document_is_in_the_campaign(tmp_path: Path) -> None:
    from rotorid.io.registry import read

    formats = {read_of.module for read_of in READERS}
    names = {name for _, samples, _ in BUILDERS.values() for name in samples}
    found = set()
    for name in sorted(names - {"ulog2csv"}):
        try:
            sample = sound(name)
        except pytest.skip.Exception:
            continue
        sample.put(tmp_path, sample.content)
        mapping = tmp_path / sample.mapping if sample.mapping else None
        found.add(read(tmp_path / (sample.read or sample.name), mapping=mapping).source.format)
    assert len(found) >= len(formats) - len(NEEDS)
    read_documents = {kind.read for kind in DOCUMENTS.values()}
    own = {"project", "journal", "compared"}
    assert {name for name, one in {**TOML, **JSON, **OTHERS}.items() if one not in read_documents} <= own


def test_what_is_spoiled_was_sound(tmp_path: Path) -> None:
    made = Sound(tmp_path / "made")
    made.folder.mkdir()
    for name in available(tuple(DOCUMENTS)):
        folder = tmp_path / name
        folder.mkdir()
        for sample in sound_documents(name, made):
            sample.put(folder, sample.content)
            DOCUMENTS[name].read(folder / sample.name)


def test_a_stopped_campaign_goes_on_behind_its_last_line(tmp_path: Path) -> None:
    kept = tmp_path / "kept.tsv"
    whole = tried(tmp_path, ["salt"], 20, whole=True, kept=kept)
    text = kept.read_text()
    kept.write_text(text[: len(text) // 2])
    again = tried(tmp_path, ["salt"], 20, whole=True, kept=kept)
    assert [(one.number, one.said) for one in again] == [(one.number, one.said) for one in whole]


def test_faults_are_counted_by_their_kind() -> None:
    lines = ["salt\t0\t0.10\t2048\tread", "salt\t1\t0.10\t2048\trefused", "salt\t2\t0.10\t2048\tFAULT x"]
    lines += [
        "salt\t3\t21.00\t2048\tFAULT the reader had not ended after 20 s",
        "salt\t4\t0.1\t1\tFAULT more than 1 GiB",
    ]
    assert "| salt | 5 | 1 | 1 | 1 | 1 | 1 | 21.0 s | 2 MiB |" in table(outcomes(lines))
