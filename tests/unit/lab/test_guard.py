"""Who may ask the lab what: every guard refuses alone, and hostile requests cost a sentence."""

from __future__ import annotations

import gc
import json
import math
import os
import re
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.unit.lab.lab_client import HOST, SECRET, TOKEN, client_of, lab_session, seen

from rotorid.errors import UsageError
from rotorid.lab import guard, serving
from rotorid.lab import session as lab_session_module
from rotorid.lab.pyramid import Pyramid, extremes_of
from rotorid.lab.session import Session
from rotorid.lab.steps import Project, Segment, Step, arguments, project_text, read_project
from rotorid.lab.workers import Workers

pytest.importorskip("fastapi", reason="the extra lab is not installed")
httpx = pytest.importorskip("httpx", reason="httpx is not installed")


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    with lab_session(tmp_path) as made:
        yield made


def test_the_token_of_the_address_becomes_a_cookie(session: Session) -> None:
    client = client_of(session, cookie=None)
    assert client.get("/").status_code == 401
    assert client.get(f"/api/state?token={TOKEN}").status_code == 401
    assert client.get("/?token=wrong").status_code == 401
    answer = client.get(f"/?token={TOKEN}", headers={"sec-fetch-site": "none"})
    assert answer.status_code == 303
    assert answer.headers["location"] == "/"
    assert {"HttpOnly", "SameSite=Strict"} <= set(answer.headers["set-cookie"].split("; "))
    assert TOKEN not in answer.headers["set-cookie"]
    assert client.get("/").status_code == 200


@pytest.mark.parametrize("site", [None, "cross-site"])
def test_from_elsewhere_the_page_itself_leads_on(session: Session, site: str | None) -> None:
    """A redirection that another page began would come without the cookie."""
    headers = {} if site is None else {"sec-fetch-site": site}
    answer = client_of(session, cookie=None).get(f"/?token={TOKEN}", headers=headers)
    assert answer.status_code == 200
    assert SECRET in answer.headers["set-cookie"]
    assert 'content="0;url=/"' in answer.text


def test_the_printed_address_lets_one_browser_in(session: Session) -> None:
    first = client_of(session, cookie=None, once=True)
    assert first.get(f"/?token={TOKEN}").status_code == 200
    # Who is in may open the address again, and load the page again.
    assert first.get(f"/?token={TOKEN}").status_code == 200
    assert first.get("/").status_code == 200
    first.cookies.clear()
    assert "set-cookie" not in first.get(f"/?token={TOKEN}").headers
    assert first.get("/").status_code == 401
    # A token that somebody chose lets in as many as know it.
    other = client_of(session, cookie=None)
    for _ in range(2):
        other.cookies.clear()
        assert SECRET in other.get(f"/?token={TOKEN}").headers["set-cookie"]


@pytest.mark.parametrize("cookie", [None, "", "wrong", SECRET + "b", SECRET[:-1], TOKEN])
def test_nothing_is_told_without_the_token(session: Session, cookie: str | None) -> None:
    client = client_of(session, cookie=cookie)
    for path in ("/", "/api/state", "/static/lab.js", "/api/project"):
        assert client.get(path).status_code == 401
    assert client.post("/api/steps", json={"verb": "review", "logs": [1]}).status_code == 401


@pytest.mark.parametrize("host", ["evil.example:1234", "127.0.0.1:1235", "127.0.0.1"])
def test_another_name_is_refused(session: Session, host: str) -> None:
    assert client_of(session).get("/api/state", headers={"host": host}).status_code == 421


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1:1234", "http://127.0.0.1:1"])
def test_another_origin_is_refused(session: Session, origin: str) -> None:
    client = client_of(session)
    assert client.get("/api/state", headers={"origin": origin}).status_code == 403
    assert client.get("/api/state", headers={"origin": f"http://{HOST}"}).status_code == 200


def test_a_request_that_another_site_made_is_refused(session: Session) -> None:
    answer = client_of(session).post("/api/demo", headers={"sec-fetch-site": "cross-site"})
    assert answer.status_code == 403


def test_no_script_but_the_own_runs(session: Session) -> None:
    answer = client_of(session).get("/")
    policy = answer.headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert not re.search(r"<script(?![^>]*src=)|\son\w+=|style=", answer.text)
    assert "http://" not in answer.text
    assert "https://" not in answer.text


def test_every_answer_has_its_headers(session: Session) -> None:
    """Refusals too: nothing is guessed, kept, shown elsewhere, or told to another page."""
    client = client_of(session)
    kept = {
        "x-content-type-options": "nosniff",
        "referrer-policy": "no-referrer",
        "cross-origin-resource-policy": "same-origin",
        "cross-origin-opener-policy": "same-origin",
        "cache-control": "no-store",
    }
    for path in ("/", "/api/state", "/static/lab.js", "/none"):
        for answer in (client.get(path), client.get(path, headers={"host": "x"})):
            assert kept.items() <= dict(answer.headers).items(), path
            assert answer.headers["content-security-policy"].startswith("default-src 'none'")
            assert "server" not in answer.headers


def test_what_a_command_wrote_is_no_page_of_this_server(session: Session) -> None:
    """Files are saved, not shown, and a report is shown in a sandbox alone."""
    session.choose("a.ulg")
    ran = session.run(Step(verb="review", logs=(1,)))
    ran.job.state = "done"
    ran.folder.mkdir(parents=True)
    (ran.folder / "report.html").write_text("<script>fetch('/api/state')</script>", encoding="utf-8")
    (ran.folder / "link.html").symlink_to("/etc/passwd")
    client = client_of(session)
    file = client.get("/api/steps/1/files/0")
    assert file.headers["content-disposition"] == 'attachment; filename="report.html"'
    assert file.headers["content-type"] == "application/octet-stream"
    assert client.get("/api/steps/1/files/1").status_code == 400
    report = client.get("/api/steps/1/report")
    assert report.headers["content-security-policy"].startswith("sandbox allow-scripts allow-downloads;")
    assert "allow-same-origin" not in report.headers["content-security-policy"]
    # With it, a browser that follows the HTML specification shows an error in place of a page in a sandbox.
    assert "cross-origin-opener-policy" not in report.headers


def test_two_names_are_none(session: Session) -> None:
    answer = client_of(session).get("/api/state", headers=[("host", HOST), ("host", HOST)])
    assert answer.status_code == 421


@pytest.mark.parametrize("query", ["&".join(["token=x"] * 5000), "token=" + "x" * 5000, "&".join(["a=1"] * 30)])
def test_a_long_query_is_not_looked_at(session: Session, query: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def parse_qs(_: str) -> None:
        raise AssertionError("it is taken apart")

    monkeypatch.setattr(guard, "parse_qs", parse_qs)
    assert client_of(session, cookie=None).get(f"/?{query}").status_code == 401


def test_steps_have_an_end(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lab_session_module, "MOST_STEPS", 2)
    client = client_of(session)
    session.choose("a.ulg")
    answers = [client.post("/api/steps", json={"verb": "review", "logs": [1]}) for _ in range(3)]
    assert [one.status_code for one in answers] == [200, 200, 400]
    assert "at most 2 steps" in answers[2].json()["sentence"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names")
def test_only_files_are_logs(session: Session) -> None:
    """A command would wait for a pipe without end."""
    assert session.root is not None
    (session.root / "folder.ulg").mkdir()
    os.mkfifo(session.root / "pipe.ulg")
    client = client_of(session)
    assert client.get("/api/folder").json() == ["a.ulg"]
    for name in ("folder.ulg", "pipe.ulg"):
        assert client.post("/api/open", json={"name": name}).status_code == 400


def test_uploads_are_limited_and_go_away(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    client = client_of(session)
    monkeypatch.setattr(guard, "UPLOAD_BYTES", 1000)
    assert client.post("/api/upload?name=a.ulg", content=b"x" * 1001).status_code == 413
    assert client.post("/api/upload?name=a.ulg", content=(b"x" * 600 for _ in range(2))).status_code == 413
    assert not list(session.place.iterdir())
    assert client.post("/api/upload?name=a.ulg", content=b"x" * 900).status_code == 200
    assert [one.name for one in session.place.rglob("*") if one.is_file()] == ["a.ulg"]
    assert session.place.stat().st_mode & 0o077 == 0
    session.close()
    assert not session.place.exists()


def test_large_bodies_are_refused(session: Session) -> None:
    assert client_of(session).post("/api/steps", content=b"[" * 70_000).status_code == 413


@pytest.mark.parametrize(
    "name",
    ["../outside.ulg", "link.ulg", "/etc/passwd", "a.ulg\0", "..\\outside.ulg", "\\\\host\\share\\a.ulg", "", ".",
     "./a.ulg", "sub/../a.ulg", "//a.ulg", "a.ulg/"],
)  # fmt: skip
def test_no_path_leads_outside_the_folder(session: Session, name: str) -> None:
    client = client_of(session)
    assert client.post("/api/open", json={"name": name}).status_code == 400
    assert client.get("/api/folder").json() == ["a.ulg"]
    assert session.logs == []


@pytest.mark.parametrize("name", ["../../evil.ulg", "/etc/evil.ulg", "..\\evil.ulg", ".bashrc", "a\0b", "", "-x.ulg"])
def test_an_upload_stays_in_its_folder(session: Session, name: str) -> None:
    path, _ = session.upload_path(name)
    assert path.resolve().parent.parent == session.place.resolve()
    assert not path.name.startswith(".")
    path.write_bytes(b"it is a name that a file may have")


@pytest.mark.parametrize("path", ["/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py",
                                  "/static//etc/passwd", "/static/%00", "/docs", "/openapi.json"])  # fmt: skip
def test_only_the_own_files_are_served(session: Session, path: str) -> None:
    assert client_of(session).get(path).status_code in (400, 404, 422)


def test_hostile_requests_cost_a_sentence(session: Session, tmp_path: Path) -> None:
    """With a log open, so that numbers and names reach what computes with them."""
    client = client_of(session)
    seen(session)
    assert client.get("/api/logs/1/track", params={"channel": 0, "start": 0, "stop": 1}).status_code == 200
    began = list(session.workers.words)  # type: ignore[attr-defined]
    before = sorted(tmp_path.rglob("*"))
    rng = np.random.default_rng(0)
    numbers = ["0", "0.5", "1", "-1", "1e999", "-inf", "NaN", "9" * 40, "1e308", "-1e308", "4e-324", "1_0", "²"]
    words = [*numbers, "../x", "\0", "a" * 3000, "%00", "{}", "[]", "'; --", "<script>", "🚁"]
    verbs = ["review", "identify", "tune", "export", "verify", "demo", "read", "--out"]
    for k in range(400):
        word, other, verb = rng.choice(words), rng.choice(words), rng.choice(verbs)
        start, stop, kind = *rng.choice(numbers, 2), rng.choice(["track", "spectrum", "spectrogram"])
        requests = (
            lambda word=word, other=other: client.get(
                "/api/logs/1/track", params={"channel": word, "start": other, "stop": word}
            ),
            lambda kind=kind, start=start, stop=stop: client.get(
                f"/api/logs/1/{kind}", params={"channel": 0, "start": start, "stop": stop}
            ),
            lambda word=word, verb=verb: client.post("/api/steps", json={"verb": verb, "logs": [2], "models": [word]}),
            lambda word=word: client.post("/api/steps", content=word.encode(), headers={"content-type": "text/json"}),
            lambda word=word: client.post("/api/open", json={"name": word}),
            lambda word=word, other=other: client.post("/api/open", json={word: other}),
            lambda verb=verb, other=other: client.post(
                "/api/preview", content=json.dumps({"verb": verb, "values": {other: math.inf}})
            ),
            lambda word=word: client.request("DELETE", f"/api/steps/{len(word)}"),
            lambda word=word: client.get(f"/api/steps/{len(word)}/files/{-len(word)}"),
        )
        answer = requests[k % len(requests)]()
        assert answer.status_code < 500, (k, answer.status_code, answer.text)
        assert answer.status_code >= 400 or k % len(requests) < 2, (k, answer.status_code, answer.text)
        assert "Traceback" not in answer.text
    assert sorted(tmp_path.rglob("*")) == before
    assert session.workers.words == began  # type: ignore[attr-defined]


def test_words_are_no_options() -> None:
    for wrong in ("--out=/x", "/etc/x.toml", "a.b/../../c", "x.toml"):
        with pytest.raises(ValueError, match=r"models|file"):
            Step(verb="identify", logs=(1,), models=(wrong,))
    with pytest.raises(ValueError, match="inputs"):
        Step(verb="response", logs=(1,), inputs=("--out",))


def test_a_project_comes_back(tmp_path: Path) -> None:
    steps = (
        Step(verb="identify", logs=(1,), models=("rate.roll",), band_rad_s=(1.0, 1e2),
             segments=(Segment(axis="roll", start_s=40.0, stop_s=52.5),)),
        Step(verb="export", results=(1,), values={"m": 1.4}),
    )  # fmt: skip
    project = Project(schema="rotorid.project/1", logs=('a "b" \\ ü.ulg',), steps=steps)
    file = tmp_path / "rotorid.toml"
    file.write_text(project_text(project), encoding="utf-8")
    assert read_project(file) == project
    words = arguments(steps[0], project.logs, [])
    assert words[2:] == ["--model", "rate.roll", "--segment", "roll:40:52.5", "--band", "1:100"]
    for text in (
        "x",
        "x = " + "[" * 3000,
        "schema = 1",
        'schema = "rotorid.project/1"\nlogs = []\n[[steps]]\nverb = "rm"',
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(UsageError):
            read_project(file)


def test_no_peak_is_lost_in_a_pyramid() -> None:
    time_s = np.arange(100_000) / 100.0
    values = np.random.default_rng(1).normal(size=time_s.size)
    values[[777, 99_999]] = 50.0, -50.0
    values[5000:5100] = np.nan
    pyramid = Pyramid(time_s, values, extremes_of(values))
    for start, stop in ((0.0, 1000.0), (7.0, 400.0), (900.0, 2000.0)):
        x, y = pyramid.view(start, stop, 300)
        inside = values[(time_s >= start) & (time_s <= stop)]
        assert np.nanmax(y) >= np.nanmax(inside)
        assert np.nanmin(y) <= np.nanmin(inside)
        assert x.size <= 1300
        assert np.all(np.diff(x) >= 0.0)


def test_a_killed_worker_is_said_and_nothing_else_is_lost(tmp_path: Path) -> None:
    workers = Workers()
    job = workers.start(["demo", "--out", "out"], tmp_path / "job")
    while job.process is None:
        time.sleep(0.01)
    job.process.end()
    assert job.ended.wait(10.0)
    assert job.state == "failed"
    assert "signal 9" in job.sentence
    other = workers.start(["read", str(tmp_path / "none.ulg"), str(tmp_path)], tmp_path / "other")
    workers.cancel(other)
    assert other.ended.wait(10.0)
    assert other.state == "canceled"
    workers.close()
    with pytest.raises(UsageError):
        workers.start(["models"], tmp_path / "late")


@pytest.mark.parametrize(
    ("host", "token", "allowed"),
    [("127.0.0.1", None, True), ("localhost", None, True), ("::1", None, True), ("192.168.1.5", None, False),
     ("192.168.1.5", "short", False), ("192.168.1.5", "x" * 20, True), ("0.0.0.0", None, False), ("0", None, False)],
)  # fmt: skip
def test_other_addresses_want_a_token(host: str, token: str | None, allowed: bool) -> None:
    if allowed:
        serving.require_host(host, token)
    else:
        with pytest.raises(UsageError):
            serving.require_host(host, token)


def test_the_first_line_is_the_address_and_an_interrupt_ends_it(tmp_path: Path) -> None:
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    command = [sys.executable, "-m", "rotorid", "lab", "--no-browser"]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    assert server.stdout is not None
    address = server.stdout.readline().strip()
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]{32}", address)
    with httpx.Client(follow_redirects=True) as client:
        assert "rotorid lab" in client.get(address).text
        port = str(httpx.URL(address).port)
        taken = subprocess.run([*command, "--port", port], capture_output=True, text=True)
        began = time.monotonic()
        server.send_signal(2)
        server.communicate(timeout=10)
    # A second of grace for requests under way; an idle machine needs half of it, a busy one two more.
    assert time.monotonic() - began < 5.0
    assert server.returncode == 0
    assert not list(tmp_path.iterdir())
    absent = subprocess.run([*command[:4], str(tmp_path / "none")], capture_output=True, text=True)
    for done in (taken, absent):
        assert done.returncode == 2
        assert done.stdout == ""
        assert len(done.stderr.strip().splitlines()) == 1


def test_looking_on_leaves_nothing_behind(session: Session) -> None:
    """A page that asks again and again: neither memory of the lab nor threads grow."""
    client = client_of(session)
    tracemalloc.start()
    try:
        sizes = []
        for _ in range(3):
            for _ in range(40):
                assert client.get("/api/state").status_code == 200
                client.post("/api/preview", json={"verb": "review", "logs": [1]})
            gc.collect()
            own = tracemalloc.take_snapshot().filter_traces([tracemalloc.Filter(True, "*/rotorid/lab/*")])
            sizes.append((sum(one.size for one in own.statistics("filename")), threading.active_count()))
    finally:
        tracemalloc.stop()
    assert sizes[2][0] - sizes[0][0] < 1 << 14
    assert sizes[2][1] <= sizes[0][1]


def test_a_log_that_finds_no_place_shifts_no_other(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    client = client_of(session)
    assert client.post("/api/open", json={"name": "a.ulg"}).status_code == 200
    with monkeypatch.context() as full:
        full.setattr(session.workers, "start", _no_place)
        assert client.post("/api/open", json={"name": "a.ulg"}).status_code == 400
    assert client.post("/api/open", json={"name": "a.ulg"}).status_code == 200
    assert [one["state"] for one in client.get("/api/state").json()["logs"]] == ["refused", "refused"]


def _no_place(*_: object, **__: object) -> None:
    raise UsageError("20 commands are running or waiting", remedy="wait until one ends, or cancel one")


def test_an_upload_without_a_length_counts_too(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lab_session_module, "ALL_UPLOAD_BYTES", 1000)
    answer = client_of(session).post("/api/upload?name=a.ulg", content=(b"x" * 600 for _ in range(2)))
    assert answer.status_code == 400
    assert session.uploaded_bytes() == 0
