"""Every guard of the lab is there for something: with one of them taken away, what it held off comes through."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.unit.lab.lab_client import HOST, SECRET, StillWorkers, client_of, lab_session

from rotorid.errors import UsageError
from rotorid.lab import guard
from rotorid.lab import server as lab_server
from rotorid.lab import session as lab_session_module
from rotorid.lab import workers as lab_workers
from rotorid.lab.session import Session
from rotorid.lab.steps import Step
from rotorid.lab.workers import Workers

pytest.importorskip("fastapi", reason="the extra lab is not installed")
pytest.importorskip("httpx", reason="httpx is not installed")

Attack = Callable[[Session], bool]
"""Whether it comes through."""
Remove = Callable[[pytest.MonkeyPatch], None]


def _no_token(session: Session) -> bool:
    return bool(client_of(session, cookie=None).get("/api/state").status_code == 200)


def _no_one_asks_for_the_token(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(guard, "_is", lambda *_: True)


def _another_name(session: Session) -> bool:
    return bool(client_of(session).get("/api/state", headers={"host": "evil.example:1234"}).status_code == 200)


class _AllHosts(frozenset[str]):
    def __contains__(self, _: object) -> bool:
        return True


def _any_name_will_do(patch: pytest.MonkeyPatch) -> None:
    made = guard.Guard.__init__

    def init(self: Any, app: Any, **named: Any) -> None:
        made(self, app, **named | {"hosts": _AllHosts()})

    patch.setattr(guard.Guard, "__init__", init)


def _another_page(session: Session) -> bool:
    headers = {"origin": "http://evil.example"}
    return bool(client_of(session).post("/api/demo", headers=headers).status_code == 200)


def _another_site(session: Session) -> bool:
    headers = {"sec-fetch-site": "cross-site"}
    return bool(client_of(session).post("/api/demo", headers=headers).status_code == 200)


def _any_page_may_ask(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(guard.Guard, "_is_foreign", staticmethod(lambda *_: False))


def _foreign_script(session: Session) -> bool:
    policy = client_of(session).get("/").headers.get("content-security-policy", "")
    return "script-src 'self'" not in policy or "default-src 'none'" not in policy


def _no_policy(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(guard, "_OWN_PAGE", ((b"content-security-policy", b"default-src *"),))


def _report_with_rights(session: Session) -> bool:
    """A page made by a command, asked for as the browser asks, with scripts that could call the server."""
    from rotorid.lab.session import Ran

    folder = session.place / "step-1" / "out"
    folder.mkdir(parents=True)
    (folder / "report.html").write_text("<script>fetch('/api/state')</script>")
    job = StillWorkers().start(["review"], folder)
    job.state = "done"
    session.steps.append(Ran(1, Step(verb="review", logs=(1,)), job, folder))
    answer = client_of(session).get("/api/steps/1/report")
    assert answer.status_code == 200
    policy = answer.headers["content-security-policy"]
    return not policy.startswith("sandbox allow-scripts allow-downloads;") or "allow-same-origin" in policy


def _report_is_one_of_ours(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(lab_server, "_REPORT_POLICY", "script-src 'unsafe-inline'")


def _long_body(session: Session) -> bool:
    return bool(client_of(session).post("/api/steps", content=b"[" * 70_000).status_code != 413)


def _bodies_of_any_length(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(guard, "BODY_BYTES", 1 << 40)


def _large_upload(session: Session) -> bool:
    return bool(client_of(session).post("/api/upload?name=a.ulg", content=b"x" * 2500).status_code == 200)


def _uploads_of_any_size(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(guard, "UPLOAD_BYTES", 1 << 40)


def _upload_that_lies(session: Session) -> bool:
    """Without a length, in parts that are more than allowed together."""
    parts = (b"x" * 350 for _ in range(8))
    return bool(client_of(session).post("/api/upload?name=a.ulg", content=parts).status_code == 200)


def _nobody_counts(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(guard, "_limited", lambda receive, _: receive)


def _many_uploads(session: Session) -> bool:
    client = client_of(session)
    return all(client.post(f"/api/upload?name={k}.ulg", content=b"x" * 900).status_code == 200 for k in range(4))


def _uploads_without_end(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(lab_session_module, "ALL_UPLOAD_BYTES", 1 << 40)


def _link_outward(session: Session) -> bool:
    return bool(client_of(session).post("/api/open", json={"name": "link.ulg"}).status_code == 200)


def _links_are_followed(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "_inside", lambda _, path: path if path.is_file() else None)


def _path_outward(session: Session) -> bool:
    return bool(client_of(session).post("/api/open", json={"name": "../outside.ulg"}).status_code == 200)


def _any_path_will_do(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Session, "choose", lambda self, name: self.open(self.root / name, name))


def _name_outward(session: Session) -> bool:
    answer = client_of(session).post("/api/upload?name=../../evil.ulg", content=b"x")
    return bool(answer.status_code == 200) and (session.place.parent / "evil.ulg").exists()


def _names_as_they_come(patch: pytest.MonkeyPatch) -> None:
    def upload_path(self: Session, name: str) -> tuple[Path, str]:
        path = self.place / "upload" / name
        (self.place / "upload").mkdir()
        self._uploads[path] = 0
        return path, name

    patch.setattr(Session, "upload_path", upload_path)


def _many_logs(session: Session) -> bool:
    client = client_of(session)
    return all(client.post("/api/open", json={"name": "a.ulg"}).status_code == 200 for _ in range(25))


def _logs_without_end(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(lab_session_module, "MOST_LOGS", 1000)


GUARDS: dict[str, tuple[Attack, Remove]] = {
    "the token": (_no_token, _no_one_asks_for_the_token),
    "the names of the server": (_another_name, _any_name_will_do),
    "the origin of a request": (_another_page, _any_page_may_ask),
    "the site of a request": (_another_site, _any_page_may_ask),
    "the policy of the page": (_foreign_script, _no_policy),
    "the sandbox of reports": (_report_with_rights, _report_is_one_of_ours),
    "the length of bodies": (_long_body, _bodies_of_any_length),
    "the size of an upload": (_large_upload, _uploads_of_any_size),
    "the bytes that come": (_upload_that_lies, _nobody_counts),
    "the size of all uploads": (_many_uploads, _uploads_without_end),
    "links": (_link_outward, _links_are_followed),
    "paths": (_path_outward, _any_path_will_do),
    "names of uploads": (_name_outward, _names_as_they_come),
    "the number of logs": (_many_logs, _logs_without_end),
}


@pytest.mark.parametrize("name", GUARDS)
def test_a_guard_holds_off_what_comes_through_without_it(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    attack, remove = GUARDS[name]
    monkeypatch.setattr(guard, "UPLOAD_BYTES", 2000)
    monkeypatch.setattr(lab_session_module, "ALL_UPLOAD_BYTES", 3000)
    # What breaks out of the private folder lands in the test's own.
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with lab_session(tmp_path / "guarded") as session:
        assert not attack(session)
    remove(monkeypatch)
    with lab_session(tmp_path / "unguarded") as session:
        assert attack(session)


@pytest.mark.parametrize("removed", [False, True])
def test_workers_are_limited_in_number(removed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slow commands wait for a place, and do not wait without end."""
    if removed:
        monkeypatch.setattr(lab_workers, "MOST_WAITING", 1000)
    hold, most, running = threading.Event(), 0, 0
    lock = threading.Lock()

    def carry_out(_self: Workers, _job: Any) -> None:
        nonlocal most, running
        with lock:
            running += 1
            most = max(most, running)
        hold.wait(20.0)
        with lock:
            running -= 1

    monkeypatch.setattr(Workers, "_carry_out", carry_out)
    workers = Workers(most_running=50 if removed else lab_workers.MOST_RUNNING)

    def all_were_taken() -> bool:
        try:
            for k in range(30):
                workers.start(["review"], tmp_path / str(k))
        except UsageError:
            return False
        return True

    assert all_were_taken() == removed
    time.sleep(0.2)
    hold.set()
    assert (most > lab_workers.MOST_RUNNING) == removed


def test_a_command_that_wants_too_much_memory_ends_alone(tmp_path: Path) -> None:
    """With the limit it cannot even start its libraries; without it, it carries its words out."""
    for memory_bytes, state in ((1 << 26, ("failed", "refused")), (lab_workers.MEMORY_BYTES, ("done",))):
        workers = Workers(memory_bytes=memory_bytes)
        job = workers.start(["models", "--json"], tmp_path / str(memory_bytes))
        assert job.ended.wait(60.0)
        assert job.state in state
        assert "Traceback" not in job.sentence
        workers.close()


def test_tokens_are_compared_in_constant_time_and_whole(tmp_path: Path) -> None:
    with lab_session(tmp_path) as session:
        for wrong in (SECRET[:-1], SECRET + "b", SECRET.upper(), "é" * 32):
            client = client_of(session, cookie=None)
            assert client.get("/api/state", headers={"cookie": f"rotorid_lab={wrong}".encode()}).status_code == 401
        twice = f"rotorid_lab={SECRET}; rotorid_lab={SECRET}"
        assert client_of(session, cookie=None).get("/api/state", headers={"cookie": twice}).status_code == 401
        assert client_of(session, host=HOST).get("/api/state").status_code == 200


def test_slow_and_broken_clients_hold_up_nobody(tmp_path: Path) -> None:
    """Connections that send half a request, or a body that never ends, while somebody else looks on."""
    import httpx

    command = [sys.executable, "-m", "rotorid", "lab", "--no-browser"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    assert server.stdout is not None
    address = httpx.URL(server.stdout.readline().strip())
    held = []
    try:
        with httpx.Client(follow_redirects=True, timeout=5.0) as client:
            assert client.get(address).status_code == 200
            cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
            halves = (
                b"GET / HTTP/1.1\r\nHost: ",
                b"\x00\xff" * 50,
                f"POST /api/upload?name=a.ulg HTTP/1.1\r\nHost: 127.0.0.1:{address.port}\r\nCookie: {cookie}\r\n"
                "Content-Length: 100000\r\n\r\nhalf".encode(),
            )
            for k in range(60):
                one = socket.create_connection(("127.0.0.1", address.port or 0), timeout=5.0)
                one.sendall(halves[k % len(halves)])
                held.append(one)
            began = time.monotonic()
            for _ in range(20):
                assert client.get(address.join("/api/state")).status_code == 200
            assert time.monotonic() - began < 5.0
    finally:
        for one in held:
            one.close()
        server.terminate()
        server.communicate(timeout=10)
