"""A fleet answers each log once, goes on where it was, and gives the same table however it was carried out."""

from __future__ import annotations

import json
import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.fleet_logs import WORK, Here, read_table, row_of, write_logs

from rotorid import read
from rotorid.errors import ModelError, UsageError
from rotorid.fleets import Fleet, FleetSettings, Limits, LogAnswer, Processes, fleet
from rotorid.fleets.engines import Engine
from rotorid.fleets.places import Place
from rotorid.fleets.table import FAILED, FILE, JOURNAL, PAGE, SALT, TABLE, Row, write_table
from rotorid.fleets.work import Task, _stayed_on_the_ground, answer
from rotorid.io.tables.csv import write_csv

pytest.importorskip("pyarrow")
SETTINGS = FleetSettings(models=("rate.roll",))


def processes(workers: int) -> Processes:
    return Processes(workers, Limits(work=WORK, timeout_s=60.0, memory_bytes=1 << 30))


def run(logs: Path, out: Path, settings: FleetSettings = SETTINGS, *, engine: Engine | None = None) -> Fleet:
    one = Fleet([logs], settings, out, engine=engine or Here())
    list(one)
    one.write_tables()
    one.close()
    return one


def test_one_process_and_two_give_the_same_bytes(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 12)
    first = run(tmp_path / "logs", tmp_path / "one", engine=processes(1))
    for name, engine in (("two", processes(2)), ("here", Here())):
        run(tmp_path / "logs", tmp_path / name, engine=engine)
        assert (tmp_path / "one" / TABLE).read_bytes() == (tmp_path / name / TABLE).read_bytes()
    assert [row.value for row in first.rows()] == [100.0 + k for k in range(1, 13)]


def test_a_log_once_done_is_not_done_again(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 3)
    run(tmp_path / "logs", tmp_path / "out")
    write_logs(tmp_path / "logs", 1, first=9)
    again = run(tmp_path / "logs", tmp_path / "out")
    assert (again.resumed, len(again.rows())) == (3, 4)
    moved = shutil.move(tmp_path / "logs", tmp_path / "elsewhere")
    assert run(Path(moved), tmp_path / "out").resumed == 4


def test_all_logs_are_done_again_where_that_is_asked_for(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 2)
    run(tmp_path / "logs", tmp_path / "out")
    again = run(tmp_path / "logs", tmp_path / "out", replace(SETTINGS, resume=False))
    assert (again.resumed, len(again.rows())) == (0, 2)


def test_wrong_use_forgets_nothing_that_was_done(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 2)
    run(tmp_path / "logs", tmp_path / "out")
    with pytest.raises(UsageError):
        run(tmp_path / "nowhere", tmp_path / "out", replace(SETTINGS, resume=False))
    assert run(tmp_path / "logs", tmp_path / "out").resumed == 2


def test_a_cluster_has_its_own_workers() -> None:
    with pytest.raises(UsageError, match="--workers and --scheduler"):
        FleetSettings(workers=2, scheduler="tcp://10.0.0.1:8786")


def test_a_log_that_changed_is_done_again_and_so_are_other_questions(tmp_path: Path) -> None:
    logs = write_logs(tmp_path / "logs", 2)
    run(tmp_path / "logs", tmp_path / "out")
    logs[0].write_text("value 500")
    assert {row.value for row in run(tmp_path / "logs", tmp_path / "out").rows()} == {600.0, 102.0}
    other = run(tmp_path / "logs", tmp_path / "out", FleetSettings(models=("rate.pitch",)))
    assert other.resumed == 0


def test_copies_count_once(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 3)
    shutil.copytree(tmp_path / "logs", tmp_path / "logs" / "copy")
    found = run(tmp_path / "logs", tmp_path / "out")
    assert (len(found.rows()), found.duplicates) == (3, 3)
    again = run(tmp_path / "logs", tmp_path / "out")
    assert (len(again.rows()), again.duplicates) == (3, 3)


def test_a_journal_that_was_cut_off_loses_its_last_line_alone(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 4)
    run(tmp_path / "logs", tmp_path / "out")
    table = (tmp_path / "out" / TABLE).read_bytes()
    journal = tmp_path / "out" / JOURNAL
    journal.write_bytes(journal.read_bytes()[:-40])
    again = run(tmp_path / "logs", tmp_path / "out")
    assert again.resumed == 3
    assert (tmp_path / "out" / TABLE).read_bytes() == table


def test_names_and_times_of_a_table_go_before_those_of_folders(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 2)
    names = tmp_path / "names.csv"
    names.write_text("log,vehicle,time\nlog-0001.ulg,quad A,2025-01-02\n")
    settings = FleetSettings(models=("rate.roll",), vehicles=names)
    rows = run(tmp_path / "logs", tmp_path / "out", settings).rows()
    assert [(row.vehicle, row.time_utc) for row in rows] == [("quad A", "2025-01-02"), ("logs", "")]


def test_rows_come_from_python_and_join_with_pandas(tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    write_logs(tmp_path / "logs", 3)
    frame = pandas.DataFrame(fleet(tmp_path / "logs", settings=SETTINGS, engine=Here()))
    assert frame.value.sum() == 306.0
    run(tmp_path / "logs", tmp_path / "out")
    assert len(pandas.read_parquet(tmp_path / "out" / TABLE).merge(frame, on="log_sha256")) == 3


def test_other_readers_of_parquet_read_the_table(tmp_path: Path) -> None:
    write_table(tmp_path / TABLE, [row_of("a", 1, 2.0), row_of("a", 2, math.nan)], Row)
    duckdb = pytest.importorskip("duckdb")
    ((count,),) = duckdb.sql(f"select count(*) from '{tmp_path / TABLE}'").fetchall()
    assert count == 2


def test_the_table_comes_back_as_it_was(tmp_path: Path) -> None:
    rows = [row_of("a", 1, 2.0), row_of("b", 1, 3.0)]
    write_table(tmp_path / TABLE, rows, Row)
    assert read_table(tmp_path / TABLE) == rows


def test_an_answer_is_one_line_and_back() -> None:
    one = LogAnswer(log="a\n", place="a", mark="1", log_sha256="x", settings="s", rows=(row_of("v", 1, 2.0),))
    assert "\n" not in one.as_json()
    assert LogAnswer.from_json(one.as_json()) == one
    with pytest.raises(ValueError, match="no answer"):
        LogAnswer.from_json("{}")


def test_the_early_end_of_an_iteration_leaves_a_journal_to_go_on_from(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 20, "slow")
    one = Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out", engine=processes(2))
    for count, _ in enumerate(one, start=1):
        if count == 5:
            break
    one.close()
    assert 5 <= run(tmp_path / "logs", tmp_path / "out").resumed < 20


def test_other_files_of_a_folder_stay(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 1)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.txt").write_text("mine")
    for resumed in (0, 1):
        assert run(tmp_path / "logs", tmp_path / "out").resumed == resumed
        assert (tmp_path / "out" / "thesis.txt").read_text() == "mine"
        assert len(read_table(tmp_path / "out" / TABLE)) == 1
    assert {path.name for path in tmp_path.iterdir()} == {"logs", "out"}


@pytest.mark.parametrize("name", [TABLE, FAILED, PAGE, FILE, JOURNAL])
def test_foreign_files_where_the_tables_go_are_refused(tmp_path: Path, name: str) -> None:
    write_logs(tmp_path / "logs", 1)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text('{"schema": "somebody/1"}\n')
    with pytest.raises(UsageError, match=r"did not write|is not a journal"):
        Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out")
    assert [path.name for path in (tmp_path / "out").iterdir() if path.stat().st_size > 32] == []


def test_tables_of_a_later_run_leave_no_page_of_an_earlier_one(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 1)
    one = Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out", engine=Here())
    list(one)
    with one.writing() as place:
        (place / PAGE).write_text("page")
        (place / FILE).write_text('{"schema": "rotorid.fleet/1"}')
    one.close()
    stamps = {(tmp_path / "out" / name).stat().st_mtime_ns for name in (TABLE, FAILED, PAGE, FILE)}
    assert len(stamps) == 1
    run(tmp_path / "logs", tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {TABLE, FAILED, JOURNAL, SALT, "fleet.lock"}


def test_what_fails_while_a_page_is_made_leaves_the_set_of_before(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 1)
    run(tmp_path / "logs", tmp_path / "out")
    before = (tmp_path / "out" / TABLE).read_bytes()
    write_logs(tmp_path / "logs", 3)
    one = Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out", engine=Here())
    list(one)
    with pytest.raises(OSError, match="full"), one.writing():
        raise OSError("full")
    one.close()
    assert (tmp_path / "out" / TABLE).read_bytes() == before
    assert [path.name for path in tmp_path.iterdir() if path.name.startswith(".")] == []


def test_no_folder_of_this_machine_is_written(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 1)
    write_logs(tmp_path / "logs", 1, "unreadable", first=2)
    run(tmp_path / "logs", tmp_path / "out")
    assert not [path for path in (tmp_path / "out").iterdir() if str(tmp_path).encode() in path.read_bytes()]
    journal = tmp_path / "out" / JOURNAL
    old = journal.read_text()
    for line in old.splitlines()[1:]:
        place = json.loads(line)["place"]
        old = old.replace(place, str(tmp_path / "logs" / place.rpartition("/")[2]))
    journal.write_text(old)
    assert run(tmp_path / "logs", tmp_path / "out").resumed == 2


def test_a_store_that_fails_is_asked_again_by_the_next_run(tmp_path: Path) -> None:
    task = Task(place=Place(address="memory://nowhere/a.ulg", mark=""), asked={}, settings="", salt="")
    found = answer(task)
    assert [one.kind for one in found.failed] == ["unreachable"]
    assert not found.done
    gone = answer(replace(task, place=Place(address=str(tmp_path / "gone.ulg"), mark="")))
    assert [(one.kind, str(tmp_path) in one.reason) for one in gone.failed] == [("unreachable", False)]


def test_two_runs_in_one_folder_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    write_logs(tmp_path / "logs", 1)
    one = Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out")
    with pytest.raises(UsageError, match="another run is working"):
        Fleet([tmp_path / "logs"], SETTINGS, tmp_path / "out")
    one.close()


def test_an_unknown_model_is_refused_before_any_log_is_read(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 1)
    with pytest.raises((UsageError, ModelError), match=r"rate\.rol"):
        Fleet([tmp_path / "logs"], FleetSettings(models=("rate.rol",)), tmp_path / "out")


def test_failures_have_a_table_of_their_own(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 2)
    write_logs(tmp_path / "logs", 1, "unreadable", first=5)
    found = run(tmp_path / "logs", tmp_path / "out")
    assert [one.reason for one in found.failures()] == ["This is no flight log."]
    counts = found.counts()
    assert (counts.logs, counts.answered, counts.unreadable, counts.rows) == (3, 2, 1, 2)
    parquet = pytest.importorskip("pyarrow.parquet")
    assert parquet.read_table(tmp_path / "out" / FAILED).column("kind").to_pylist() == ["unreadable"]


def test_a_log_that_was_moved_is_in_the_rows_that_come(tmp_path: Path) -> None:
    write_logs(tmp_path / "logs", 3)
    run(tmp_path / "logs", tmp_path / "out")
    moved = shutil.move(tmp_path / "logs", tmp_path / "elsewhere")
    rows = list(fleet(moved, settings=SETTINGS, out=tmp_path / "out", engine=Here()))
    assert [row.vehicle for row in rows] == ["elsewhere"] * 3


def test_a_log_that_never_flew_is_refused_for_that(tmp_path: Path) -> None:
    time_s = np.arange(0.0, 60.0, 0.01)
    write_csv(tmp_path / "ground.csv", time_s, {"p": np.zeros(time_s.size)})
    assert _stayed_on_the_ground(read(tmp_path / "ground.csv"))
    write_csv(tmp_path / "little.csv", time_s, {"phi": np.zeros(time_s.size)})
    assert not _stayed_on_the_ground(read(tmp_path / "little.csv"))
