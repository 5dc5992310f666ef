"""Logs, uploads and steps of a session: nothing is mixed up, lost, or named as what it is not."""

from __future__ import annotations

import os
import shutil
import tomllib
from collections.abc import MutableMapping, Sequence
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from tests.unit.lab.lab_client import HOST, SECRET, StillWorkers, client_of, lab_session, seen

from rotorid.errors import UsageError
from rotorid.lab import session as lab_session_module
from rotorid.lab.session import Ran, Session
from rotorid.lab.steps import Project, Step, arguments, project_text
from rotorid.lab.workers import Job, State

pytest.importorskip("fastapi", reason="the extra lab is not installed")
pytest.importorskip("httpx", reason="httpx is not installed")


class SettledWorkers(StillWorkers):
    """Workers whose jobs end as they are told, at once; an empty word lets them run."""

    def __init__(self, *states: State) -> None:
        super().__init__()
        self.states = list(states)

    def start(self, words: Sequence[str], folder: Path) -> Job:
        self.words.append(list(words))
        job = Job(list(words), folder)
        state = self.states.pop(0) if self.states else "done"
        if state == "running":
            job.state = state
        else:
            job.end(state)
        return job


def _upload(client: Any, name: str) -> int:
    answer = client.post("/api/upload", params={"name": name}, content=b"x")
    assert answer.status_code == 200
    return int(answer.json()["log"])


def test_an_upload_keeps_its_name(tmp_path: Path) -> None:
    with lab_session(tmp_path) as session:
        client = client_of(session)
        for name in ("my flight ü.ulg", "2024-01-01 (1).bin", 'a "b" <c>.csv', "-x.ulg"):
            number = _upload(client, name)
            assert client.get("/api/state").json()["logs"][number - 1]["name"] == name
        # A command line takes it for a file, whatever it begins with.
        command = client.post("/api/preview", json={"verb": "review", "logs": [4]}).json()["command"]
        assert command[:3] == ["rotorid", "review", "./-x.ulg"]
        assert session.logs[2].path.name == "a _b_ _c_.csv"


def test_two_files_of_one_name_can_be_told_apart(tmp_path: Path) -> None:
    with lab_session(tmp_path, SettledWorkers()) as session:
        client = client_of(session)
        for _ in range(3):
            _upload(client, "flight.ulg.xz")
        told = client.get("/api/state").json()["logs"]
        assert [one["name"] for one in told] == ["flight.ulg.xz", "flight-2.ulg.xz", "flight-3.ulg.xz"]
        assert told[0]["note"] == ""
        assert told[1]["note"].startswith("Another log is called flight.ulg.xz: this one is flight-2.ulg.xz")
        step = {"verb": "identify", "logs": [1], "verify": [2], "models": ["rate.roll"]}
        command = client.post("/api/preview", json=step).json()["command"]
        assert command[2:7] == ["flight.ulg.xz", "--model", "rate.roll", "--verify", "flight-2.ulg.xz"]
        assert tomllib.loads(client.get("/api/project").text)["logs"] == [one["name"] for one in told]


def test_a_log_of_the_folder_is_named_as_the_shell_would(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "flights" / "may").mkdir(parents=True)
    (tmp_path / "flights" / "may" / "a.ulg").write_bytes(b"no log")
    monkeypatch.chdir(tmp_path)
    session = Session(Path("flights"), workers=StillWorkers())
    try:
        log = session.choose("may/a.ulg")
        # A project file lies in the folder, and names what is below it.
        assert (log.name, log.words) == ("may/a.ulg", str(Path("flights/may/a.ulg")))
        assert session.preview(Step(verb="review", logs=(1,)))[2] == log.words
        # The same file once more is the same file.
        assert session.choose("may/a.ulg").note == ""
    finally:
        session.close()


def test_a_name_that_is_no_text_stops_nothing(tmp_path: Path) -> None:
    odd = os.fsdecode(b"caf\xe9.ulg")
    with lab_session(tmp_path) as session:
        assert session.root is not None
        try:
            (session.root / odd).write_bytes(b"no log")
        except OSError:
            pytest.skip("this file system takes no such name")
        client = client_of(session)
        assert client.get("/api/folder").json() == ["a.ulg"]
        session.open(session.root / odd, odd, words=str(session.root / odd))
        assert client.get("/api/state").json()["logs"][0]["name"] == "caf\ufffd.ulg"
        assert client.post("/api/preview", json={"verb": "review", "logs": [1]}).status_code == 200
        assert client.get("/api/project").status_code == 200
        assert session.workers.words[0][1].endswith(odd)  # type: ignore[attr-defined]


def test_looking_through_a_folder_has_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with lab_session(tmp_path) as session:
        assert session.root is not None
        deep = session.root
        for k in range(9):
            deep = deep / f"d{k}"
            deep.mkdir()
            (deep / "x.ulg").write_bytes(b"no log")
        assert len(session.choices()) == 1 + lab_session_module.MOST_DEPTH - 1
        looked = []
        inside = Session._inside
        monkeypatch.setattr(Session, "_inside", lambda self, path: (looked.append(path), inside(self, path))[1])
        for k in range(100):
            (session.root / f"{k}.ulg").write_bytes(b"no log")
        monkeypatch.setattr(lab_session_module, "MOST_ENTRIES", 50)
        assert len(session.choices()) <= 50
        assert len(looked) <= 50
        looked.clear()
        # What is chosen is looked up alone, also where the list does not reach.
        session.choose("99.ulg")
        assert len(looked) == 1


def test_what_was_chosen_is_what_is_read(tmp_path: Path) -> None:
    """A link that is turned elsewhere afterwards leads no command out of the folder."""
    with lab_session(tmp_path) as session:
        assert session.root is not None
        link = session.root / "turned.ulg"
        link.symlink_to(session.root / "a.ulg")
        session.choose("turned.ulg")
        link.unlink()
        link.symlink_to(tmp_path / "outside.ulg")
        session.run(Step(verb="review", logs=(1,)))
        read, ran = session.workers.words  # type: ignore[attr-defined]
        assert read[1] == ran[1] == str(session.root / "a.ulg")


def test_uploads_that_were_refused_leave_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with lab_session(tmp_path) as session:
        client = client_of(session)

        async def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        with monkeypatch.context() as patch:
            patch.setattr(anyio, "open_file", full)
            answer = client.post("/api/upload?name=a.ulg", content=b"x")
        assert answer.status_code == 400
        assert "No space left on device" in answer.json()["sentence"]
        monkeypatch.setattr(lab_session_module, "MOST_LOGS", 0)
        assert client.post("/api/upload?name=a.ulg", content=b"x").status_code == 400
        monkeypatch.setattr(lab_session_module, "ALL_UPLOAD_BYTES", 10)
        assert client.post("/api/upload?name=a.ulg", content=b"x" * 11).status_code == 400
        assert list(session.place.iterdir()) == []
        assert session.uploaded_bytes() == 0


def test_all_uploads_are_counted_while_they_come(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of an upload that says nothing of its length, no more is taken in than there is room for."""
    monkeypatch.setattr(lab_session_module, "ALL_UPLOAD_BYTES", 1000)
    came = 0
    status = []
    most = 0

    async def ask(session: Session) -> None:
        async def receive() -> MutableMapping[str, Any]:
            nonlocal came, most
            came += 1
            most = max(most, sum(one.stat().st_size for one in session.place.rglob("*") if one.is_file()))
            return {"type": "http.request", "body": b"x" * 100, "more_body": came < 100}

        async def send(message: MutableMapping[str, Any]) -> None:
            status.append(message.get("status"))

        headers = [(b"host", HOST.encode()), (b"cookie", f"rotorid_lab={SECRET}".encode())]
        scope: dict[str, Any] = {
            "type": "http", "method": "POST", "path": "/api/upload", "raw_path": b"/api/upload", "headers": headers,
            "query_string": b"name=a.ulg", "root_path": "", "scheme": "http", "http_version": "1.1",
        }  # fmt: skip
        await client_of(session).app(scope, receive, send)

    with lab_session(tmp_path) as session:
        anyio.run(ask, session)
        assert status[0] == 400
        assert came == 11
        assert most <= 1000
        assert list(session.place.iterdir()) == []


def test_a_log_that_is_closed_meanwhile_is_gone_in_words(tmp_path: Path) -> None:
    with lab_session(tmp_path) as session:
        client = client_of(session)
        log = seen(session)
        asked = {"channel": 0, "start": 0, "stop": 1}
        assert client.get("/api/logs/1/track", params=asked).status_code == 200
        # Its tracks are being asked for while another request removes them.
        shutil.rmtree(log.folder)
        for kind in ("track", "spectrum", "spectrogram"):
            answer = client.get(f"/api/logs/1/{kind}", params=asked)
            assert answer.status_code == 410
            assert "no longer available" in answer.json()["sentence"]


def test_no_command_begins_with_a_log_that_is_being_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with lab_session(tmp_path) as session:
        session.choose("a.ulg")

        def cancel(_: Job) -> None:
            with pytest.raises(UsageError, match="no log 1"):
                session.run(Step(verb="review", logs=(1,)))

        monkeypatch.setattr(session.workers, "cancel", cancel)
        session.close_log(session.logs[0])
        assert session.steps == []


def test_the_demonstration_is_an_open_log_from_the_start(tmp_path: Path) -> None:
    with lab_session(tmp_path, SettledWorkers("running", "failed")) as session:
        client = client_of(session)
        assert client.post("/api/demo").json() == {"log": 1}
        (told,) = client.get("/api/state").json()["logs"]
        assert (told["name"], told["state"], told["readable"]) == ("flight.ulg", "running", False)
        # One flight at a time, and another after it.
        assert client.post("/api/demo").json() == {"log": 1}
        session.logs[0].job.end("failed", "It crashed.")
        assert client.get("/api/state").json()["logs"][0]["sentence"] == "It crashed."
        assert client.post("/api/demo").json() == {"log": 2}


@pytest.mark.slow
def test_the_demonstration_flies(tmp_path: Path) -> None:
    session = Session()
    try:
        log = session.demo()
        assert log.job.ended.wait(300.0)
        assert log.job.state == "done", log.job.sentence
        assert log.tracks is not None
        assert log.tracks.inspection() is not None
    finally:
        session.close()


def test_models_are_asked_for_again_after_a_failure(tmp_path: Path) -> None:
    with lab_session(tmp_path, SettledWorkers("failed", "done")) as session:
        client = client_of(session)
        assert client.get("/api/models").json() == {"models": []}
        (session.place / "models").mkdir()
        (session.place / "models" / "output.json").write_text('{"models": [{"name": "x"}]}', encoding="utf-8")
        for _ in range(2):
            assert client.get("/api/models").json() == {"models": [{"name": "x"}]}
        assert len(session.workers.words) == 2  # type: ignore[attr-defined]


def test_a_project_holds_what_can_be_done_again(tmp_path: Path) -> None:
    """Logs that nothing needs any more are no part of it, and all numbers are those of what is."""
    states: tuple[State, ...] = ("refused", "done", "done", "done", "refused", "done", "done", "failed")
    with lab_session(tmp_path, SettledWorkers(*states)) as session:
        for k in range(1, 5):
            (session.place / f"{k}.ulg").write_bytes(b"x")
            session.open(session.place / f"{k}.ulg", f"{k}.ulg")
        session.run(Step(verb="review", logs=(2,)))
        session.run(Step(verb="identify", logs=(4,), verify=(2,), models=("rate.roll",)))
        session.run(Step(verb="export", results=(2,)))
        session.run(Step(verb="tune", results=(2,)))
        session.close_log(session.logs[2])
        session.waiting = (Step(verb="export", results=(3,)),)
        told = tomllib.loads(session.project())
        assert told["logs"] == ["2.ulg", "4.ulg"]
        assert [(one["verb"], one.get("logs"), one.get("verify"), one.get("results")) for one in told["steps"]] == [
            ("identify", [2], [1], None),
            ("export", None, None, [1]),
        ]


def test_a_project_that_was_opened_is_not_lost_before_it_runs(tmp_path: Path) -> None:
    steps = (
        Step(verb="identify", logs=(1,), models=("rate.roll",)),
        Step(verb="tune", results=(1,)),
        Step(verb="export", results=(1,)),
    )
    text = project_text(Project(schema="rotorid.project/1", logs=("a.ulg",), steps=steps))
    with lab_session(tmp_path, SettledWorkers("done", "done", "done", "failed", "done")) as session:
        session.choose("a.ulg")
        session.waiting = steps
        assert session.project() == text
        # Whatever was done before, the steps of the project refer to each other.
        session.run(Step(verb="review", logs=(1,)))
        client = client_of(session)
        assert client.post("/api/waiting").status_code == 200
        assert session.followed.wait(10.0)
        state = client.get("/api/state").json()
        assert (state["waiting"], state["following"]) == ([], False)
        assert [(one["step"]["verb"], one["step"]["results"], one["state"]) for one in state["steps"]] == [
            ("review", [], "done"),
            ("identify", [], "done"),
            ("tune", [2], "failed"),
            ("export", [2], "done"),
        ]
        assert client.post("/api/waiting").status_code == 200
        assert len(session.steps) == 4


def test_a_step_that_cannot_begin_says_why(tmp_path: Path) -> None:
    with lab_session(tmp_path, SettledWorkers("done", "failed", "done")) as session:
        session.choose("a.ulg")
        session.waiting = (
            Step(verb="identify", logs=(1,), models=("rate.roll",)),
            Step(verb="tune", results=(1,)),
            Step(verb="review", logs=(1,)),
        )
        session.follow()
        assert session.followed.wait(10.0)
        assert [one.job.state for one in session.steps] == ["failed", "refused", "done"]
        assert "no step 1" in session.steps[1].job.sentence


def _wrote(session: Session, *files: str) -> Ran:
    ran = session.run(Step(verb="review", logs=(1,)))
    for name in files:
        (ran.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (ran.folder / name).write_text("<h1>x</h1>", encoding="utf-8")
    return ran


def test_the_report_of_several_models_is_the_one_of_all(tmp_path: Path) -> None:
    with lab_session(tmp_path, SettledWorkers()) as session:
        session.choose("a.ulg")
        ran = _wrote(session, "axis.roll/report.html", "rate.roll/report.html", "report.html", "flight.html")
        assert session.report(ran) == ran.folder / "report.html"
        with (ran.folder / "rate.roll" / "responses.npz").open("wb") as file:
            np.savez(file, omega_rad_s=[1.0, 2.0], values=[1j, np.nan])
        told = client_of(session).get("/api/steps/1").json()
        assert told["parts"] == {
            "rate.roll": {"omega_rad_s": [1.0, 2.0], "values.re": [0.0, None], "values.im": [1.0, 0.0]}
        }
        assert told["curves"] == {}


def test_costs_are_told_while_a_fit_goes_on(tmp_path: Path) -> None:
    with lab_session(tmp_path, SettledWorkers("done", "running")) as session:
        session.choose("a.ulg")
        job = session.run(Step(verb="review", logs=(1,))).job
        job.costs = [3.0, 2.0]
        client = client_of(session)
        assert client.get("/api/state").json()["steps"][0]["costs"] == [3.0, 2.0]
        job.end("done")
        (told,) = client.get("/api/state").json()["steps"]
        assert told["costs"] == []
        assert told["logs"] == ["a.ulg"]


@pytest.mark.parametrize(
    ("chosen", "words"),
    [({"inputs": ["roll rate"]}, "inputs.0: 'roll rate' is not a name of letters"),
     ({"models": ["../x"]}, "models.0: '../x' is not a model of the list"),
     ({"band_rad_s": [50, 5]}, "the upper end of the band must be above the lower one"),
     ({"method": "guess"}, "method: "), ({"verb": "rm"}, "verb: "), ({"logs": ["x"]}, "logs.0: ")],
)  # fmt: skip
def test_what_was_wrong_with_a_choice_is_named(chosen: dict[str, Any], words: str, tmp_path: Path) -> None:
    with lab_session(tmp_path) as session:
        answer = client_of(session).post("/api/preview", json={"verb": "identify", "logs": [1]} | chosen)
        assert answer.status_code == 422
        assert words in answer.json()["sentence"]


@pytest.mark.parametrize("kind", ["track", "spectrum", "spectrogram"])
@pytest.mark.parametrize("edge", ["-inf", "nan", "1e999"])
def test_an_interval_has_edges(kind: str, edge: str, tmp_path: Path) -> None:
    with lab_session(tmp_path) as session:
        client = client_of(session)
        seen(session)
        answer = client.get(f"/api/logs/1/{kind}", params={"channel": 0, "start": edge, "stop": 1})
        assert answer.status_code == 422
        assert answer.json()["sentence"].startswith("start: ")


def test_what_fails_inside_is_said_here_and_logged_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    with lab_session(tmp_path) as session:

        def choices(_: Session) -> list[str]:
            raise RuntimeError("a mistake")

        monkeypatch.setattr(Session, "choices", choices)
        answer = client_of(session).get("/api/folder")
        assert answer.status_code == 500
        assert answer.json()["sentence"] == "The server failed; see its terminal for the reason."
        assert "a mistake" in caplog.text


def test_no_path_is_an_option() -> None:
    step = Step(verb="identify", logs=(1,), verify=(1,), models=("rate.roll",))
    assert arguments(step, ["--out=x.ulg"], [])[1:] == [
        "./--out=x.ulg", "--model", "rate.roll", "--verify", "./--out=x.ulg",
    ]  # fmt: skip
