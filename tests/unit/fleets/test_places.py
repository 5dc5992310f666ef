"""Logs are found wherever they lie, each once; who flew and when is told by names, tables and boards."""

from __future__ import annotations

import gzip
import struct
import zipfile
from pathlib import Path

import pytest
from tests.fleet_logs import write_logs

from rotorid.errors import LogError, UsageError
from rotorid.fleets.identity import board_of, hidden, read_named, read_salt
from rotorid.fleets.places import Place, fetched, find_places
from rotorid.fleets.settings import FleetSettings, parse_memory
from rotorid.io.log_order import natural, time_of

CARD = b"\xbc" + struct.pack("<HHH", 2, 1, 7) + b"fixedFrequency\0"
"""How a file of a Crazyflie's card begins."""


def names(*paths: object) -> list[str]:
    return [place.name for place in find_places(paths).places]  # type: ignore[arg-type]


def test_files_folders_and_patterns(tmp_path: Path) -> None:
    write_logs(tmp_path / "a", 2)
    write_logs(tmp_path / "b" / "deep", 1, first=7)
    (tmp_path / "a" / "notes.docx").write_text("no log")
    everything = ["log-0001.ulg", "log-0002.ulg", "log-0007.ulg"]
    assert names(tmp_path) == everything
    assert names(str(tmp_path / "**" / "*.ulg")) == everything
    assert names(tmp_path / "a" / "log-0001.ulg", tmp_path / "a") == everything[:2]


def test_logs_in_an_archive(tmp_path: Path) -> None:
    logs = write_logs(tmp_path / "a", 3)
    with zipfile.ZipFile(tmp_path / "many.zip", "w") as archive:
        for log in logs:
            archive.write(log, f"drone/{log.name}")
    found = find_places([tmp_path / "many.zip"]).places
    assert [(place.name, place.folder) for place in found] == [(log.name, "drone") for log in logs]
    with fetched(found[1]) as log:
        assert log.read_text() == "value 2"
    assert not log.exists()


def test_links_that_lead_out_of_a_folder_are_not_followed(tmp_path: Path) -> None:
    outside = write_logs(tmp_path / "outside", 1)[0]
    inside = write_logs(tmp_path / "logs", 1, first=2)[0]
    (tmp_path / "logs" / "out.ulg").symlink_to(outside)
    (tmp_path / "logs" / "in.ulg").symlink_to(inside)
    (tmp_path / "logs" / "deep").symlink_to(tmp_path / "outside")
    found = find_places([tmp_path / "logs"])
    assert [place.name for place in found.places] == ["in.ulg", "log-0002.ulg"]
    assert found.skipped == ("out.ulg (a link out of the folder)",)
    # Links that were named themselves, and folders that are links, are what the user wants.
    (tmp_path / "link").symlink_to(tmp_path / "outside")
    assert names(tmp_path / "logs" / "out.ulg", tmp_path / "link") == ["log-0001.ulg", "out.ulg"]
    inside.unlink()
    with pytest.raises(UsageError, match=r"only 1 link that leads out of the folder: out\.ulg"):
        find_places([tmp_path / "logs"])


@pytest.mark.parametrize("name", [300 * "x" + ".csv", 300 * "\u00fc" + ".csv.gz"])
def test_a_member_of_any_name_is_fetched(tmp_path: Path, name: str) -> None:
    with zipfile.ZipFile(tmp_path / "many.zip", "w") as archive:
        archive.writestr("a.csv", "time,p\n0,0\n")
        archive.writestr(name, "time,p\n0,1\n")
    found = next(place for place in find_places([tmp_path / "many.zip"]).places if place.name == name)
    with fetched(found) as log:
        assert log.read_text() == "time,p\n0,1\n"
        assert log.suffixes == Path(name).suffixes


@pytest.mark.parametrize("name", ["log1\u00b23.csv", "log\u0663.csv", "log\u2460.csv", "20\u0662\u0665-03-09.csv"])
def test_digits_of_other_scripts_in_a_name_have_no_value(name: str) -> None:
    assert [one for one in sorted(["log10", name, "log9"], key=natural) if one != name] == ["log9", "log10"]
    assert time_of(name) == ""


def test_addresses_of_a_store(tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    store = fsspec.filesystem("memory")
    for log in write_logs(tmp_path, 2):
        store.pipe_file(f"/fleet/quad/{log.name}", log.read_bytes())
    found = find_places(["memory://fleet"]).places
    assert [place.name for place in found] == ["log-0001.ulg", "log-0002.ulg"]
    with fetched(found[0]) as log:
        assert log.read_text() == "value 1"
    store.pipe_file("/fleet/quad/log-0001.ulg", b"value 11")
    assert find_places(["memory://fleet"]).places[0].mark != found[0].mark


@pytest.mark.parametrize("path", ["nowhere", "*.nothing", "nothing://there"])
def test_nothing_is_one_sentence(path: str) -> None:
    with pytest.raises(UsageError):
        find_places([path])


def test_cards_without_endings_are_logs_and_the_rest_is_named(tmp_path: Path) -> None:
    write_logs(tmp_path, 1)
    (tmp_path / "log00").write_bytes(CARD)
    (tmp_path / "log01.gz").write_bytes(gzip.compress(CARD))
    (tmp_path / "config").write_text("250\n1024\nlog\n0\non:fixedFrequency\n")
    (tmp_path / ".hidden").write_text("x")
    (tmp_path / "notes.txt").write_text("It was windy.\n")
    with zipfile.ZipFile(tmp_path / "deck.zip", "w") as archive:
        archive.writestr("card/log00", CARD)
        archive.writestr("card/photo.jpg", b"\xff\xd8\xff\xe0")
        archive.writestr("card/readme.txt", b"It was windy.\n")
    found = find_places([tmp_path])
    assert [place.name for place in found.places] == ["log00", "log-0001.ulg", "log00", "log01.gz"]
    assert found.skipped == ("config", "photo.jpg", "readme.txt", "notes.txt")


def test_cards_in_a_store(tmp_path: Path) -> None:
    fsspec = pytest.importorskip("fsspec")
    store = fsspec.filesystem("memory")
    store.pipe_file("/deck/cf1/log00", CARD)
    store.pipe_file("/deck/cf1/config", b"250\n")
    store.pipe_file("/deck/cf1/notes.txt", b"It was windy.\n")
    found = find_places(["memory://deck"])
    assert ([place.name for place in found.places], found.skipped) == (["log00"], ("config", "notes.txt"))


def test_an_empty_folder_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="contains no flight log"):
        find_places([tmp_path])


def test_a_damaged_archive_is_an_error_of_its_log(tmp_path: Path) -> None:
    with pytest.raises(LogError), fetched(Place(address=f"{tmp_path}/gone.zip!a.ulg", mark="")):
        pass


def test_a_changed_file_has_another_mark(tmp_path: Path) -> None:
    (log,) = write_logs(tmp_path, 1)
    before = find_places([log]).places[0].mark
    log.write_text("value 12345")
    assert find_places([log]).places[0].mark != before


@pytest.mark.parametrize(
    ("text", "board"),
    [
        (
            b"ULog\x01\x12\x35\x00\x00\x00I\x20char[24] sys_uuid00020000000034333732510d\x00",
            b"00020000000034333732510d",
        ),
        (b"\xa3\x95\x11xx CubeOrange 0029003A 3137510A 34323731\0", b"0029003A 3137510A 34323731"),
        (b"H Product:Blackbox\nH DeviceUID:0x3d0040000950334537373420\n", b"3d0040000950334537373420"),
        (b"H DeviceUID:0x000000000000000000000000\n", b""),
        (b"nothing at all", b""),
    ],
)
def test_boards(tmp_path: Path, text: bytes, board: bytes) -> None:
    plain, packed = tmp_path / "log.bin", tmp_path / "log.bin.gz"
    plain.write_bytes(text)
    packed.write_bytes(gzip.compress(text))
    assert board_of(plain) == board
    assert board_of(packed) == board


def test_a_hidden_name_needs_the_salt(tmp_path: Path) -> None:
    salt = read_salt(tmp_path / "salt")
    assert read_salt(tmp_path / "salt") == salt
    assert hidden(b"1234", salt) != hidden(b"1234", read_salt(tmp_path / "other"))
    assert "1234" not in hidden(b"1234", salt)


@pytest.mark.parametrize("name", ["99999999.bin", "2025-13-01.ulg", "log_2025.ulg", "20250000_000000.bin"])
def test_names_without_a_date(name: str) -> None:
    assert time_of(name) == ""


def test_vehicles_of_a_table(tmp_path: Path) -> None:
    table = tmp_path / "vehicles.csv"
    table.write_text("\ufefflog,vehicle,group\na.ulg,quad 1,before\nb.ulg,quad 1,after\n", encoding="utf-8")
    named = read_named(table)
    assert named.of(named.vehicle, "x", "a.ulg") == "quad 1"
    assert named.of(named.group, "b.ulg") == "after"
    assert named.of(named.time, "a.ulg") == ""


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("file;vehicle\n", "has the columns"),
        ("", "has the columns"),
        ("log,vehicle\n,x\n", "names no log"),
        ("log,vehicle\na,x\na,y\n", "lists a twice"),
        ('log,vehicle\n"a,x\n', "CSV"),
    ],
)
def test_wrong_tables_are_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    table = tmp_path / "vehicles.csv"
    table.write_text(text)
    with pytest.raises(UsageError, match=said):
        read_named(table)


@pytest.mark.parametrize(
    "wrong", [{"models": ()}, {"workers": 0}, {"timeout_s": 0.0}, {"memory_bytes": 1}, {"timeout_s": float("nan")}]
)
def test_settings_out_of_range(wrong: dict[str, object]) -> None:
    with pytest.raises(UsageError):
        FleetSettings(**wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("text", ["", "4 apples", "-1G", "1e9"])
def test_sizes_that_are_none(text: str) -> None:
    with pytest.raises(UsageError, match="memory"):
        parse_memory(text)
