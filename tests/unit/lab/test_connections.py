"""Slow, silent and broken clients: each loses its connection, and nobody waits for one."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.unit.lab.lab_client import SECRET, TOKEN, lab_session

from rotorid.lab import serving

pytest.importorskip("fastapi", reason="the extra lab is not installed")
httpx = pytest.importorskip("httpx", reason="httpx is not installed")
connections = pytest.importorskip("rotorid.lab.connections", reason="the extra lab is not installed")

COOKIE = f"Cookie: rotorid_lab={SECRET}\r\n"
HALVES = {
    "nothing": "",
    "half a head": "GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n",
    "half a body": "POST /api/steps HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n" + COOKIE + "Content-Length: 50\r\n\r\nhalf",
    "the rest of a body that was refused": "POST /api/steps HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n"
    + COOKIE
    + "Content-Length: 999999\r\n\r\nhalf",
    "half a second head": "GET /api/state HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n" + COOKIE + "\r\nGET / HT",
}


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Any]:
    """In this process, with its port as ``port``."""
    from rotorid.lab.server import lab_app

    with lab_session(tmp_path) as session, serving.listening_at("127.0.0.1", 0) as listening:
        port = listening.getsockname()[1]
        names = serving.names_of("127.0.0.1", port)
        server: Any = serving.server_of(lab_app(session, token=TOKEN, secret=SECRET, hosts=names))
        server.port = port
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        thread.start()
        yield server
        server.should_exit = True
        thread.join(10.0)


@pytest.fixture
def port(server: Any) -> int:
    return int(server.port)


def _answers(port: int) -> bool:
    headers = {"cookie": f"rotorid_lab={SECRET}"}
    return bool(httpx.get(f"http://127.0.0.1:{port}/api/state", headers=headers, timeout=5.0).status_code == 200)


def _connected(port: int, text: str, source: str = "127.0.0.1") -> socket.socket:
    made = socket.create_connection(("127.0.0.1", port), timeout=5.0, source_address=(source, 0))
    made.sendall(text.replace("{port}", str(port)).encode())
    return made


def _is_closed(one: socket.socket) -> bool:
    """Wait until the other side closes, for 5 s at most."""
    try:
        while one.recv(1 << 16):
            pass
    except ConnectionError:
        return True
    except TimeoutError:
        return False
    return True


@pytest.mark.parametrize("half", HALVES)
def test_what_does_not_come_is_not_waited_for(half: str, port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    assert _answers(port)
    monkeypatch.setattr(connections, "HEAD_S", 0.2)
    monkeypatch.setattr(connections, "PAUSE_S", 0.2)
    # A connection at rest is closed by the library after 5 s; what is tested comes before that.
    with _connected(port, HALVES[half]) as one:
        one.settimeout(3.0)
        assert _is_closed(one)


def test_a_body_may_take_long_as_long_as_it_comes(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every part starts the clock anew, and the time for a head is over with the head."""
    monkeypatch.setattr(connections, "HEAD_S", 1.0)
    body = b"x" * 8
    head = f"POST /api/upload?name=a.ulg HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n{COOKIE}Content-Length: 8\r\n\r\n"
    with _connected(port, head) as one:
        for k in range(len(body)):
            one.sendall(body[k : k + 1])
            threading.Event().wait(0.15)
        assert b"200 OK" in one.recv(1 << 16)


def test_who_does_not_read_is_not_waited_for(server: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "PAUSE_S", 0.2)
    asked = f"GET /static/vendor/uPlot.iife.min.js HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n{COOKIE}\r\n"
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        one.settimeout(5.0)
        one.connect(("127.0.0.1", server.port))
        one.sendall((asked * 100).encode())
        for wanted in (True, False):
            last = time.monotonic() + 5.0
            while bool(server.server_state.connections) != wanted:
                assert time.monotonic() < last, "the connection stays"
                threading.Event().wait(0.01)


def test_many_strangers_do_not_keep_the_page_from_anybody(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The oldest of those that have asked for nothing goes, whoever comes new is served."""
    monkeypatch.setattr(connections, "MOST_OPEN", 20)
    held = [_connected(port, "GET / HTTP/1.1\r\nHost: ") for _ in range(60)]
    try:
        assert _answers(port)
        assert all(_is_closed(one) for one in held[:40])
        held[-1].setblocking(False)
        with pytest.raises(BlockingIOError):
            held[-1].recv(1)
    finally:
        for one in held:
            one.close()


def _is_open(one: socket.socket) -> bool:
    one.setblocking(False)
    try:
        return bool(one.recv(1))
    except BlockingIOError:
        return True
    except ConnectionError:
        return False


def test_standing_uploads_do_not_use_up_all_connections(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MOST_OPEN", 20)
    head = "POST /api/upload?name=a{}.ulg HTTP/1.1\r\nHost: 127.0.0.1:{{port}}\r\n" + COOKIE
    held = [_connected(port, head.format(k) + "Content-Length: 50\r\n\r\nhalf") for k in range(30)]
    try:
        for _ in range(3):
            assert _answers(port)
        assert all(_is_closed(one) for one in held[:10])
        assert _is_open(held[-1])
    finally:
        for one in held:
            one.close()


def test_the_limit_is_that_of_each_peer(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MOST_OPEN", 20)
    half = "GET / HTTP/1.1\r\nHost: "
    try:
        own = [_connected(port, half, "127.0.0.2") for _ in range(5)]
    except OSError:
        pytest.skip("this system has one address of its own only")
    held = [_connected(port, half) for _ in range(60)]
    try:
        assert _answers(port)
        assert all(map(_is_open, own))
    finally:
        for one in (*own, *held):
            one.close()


def test_good_requests_get_through_a_flood(port: int) -> None:
    """Strangers come faster than they can be sent away; what was accepted is read before it must make room."""
    held: list[socket.socket] = []

    def flood() -> None:
        held.extend(_connected(port, "GET / HTTP/1.1\r\nHost: ") for _ in range(300))

    stranger = threading.Thread(target=flood)
    stranger.start()
    try:
        assert all(_answers(port) for _ in range(8))
    finally:
        stranger.join()
        for one in held:
            one.close()


@pytest.mark.parametrize("head", ["Host: evil", "Host: 127.0.0.1:{port}", "Host: 127.0.0.1:{port}\r\nOrigin: x"])
def test_a_stranger_keeps_no_connection(head: str, port: int) -> None:
    with _connected(port, f"GET /api/state HTTP/1.1\r\n{head}\r\n\r\n") as one:
        one.settimeout(3.0)
        assert _is_closed(one)


def test_a_head_without_end_is_refused(port: int) -> None:
    with _connected(port, "GET / HTTP/1.1\r\n") as one:
        line: Any = b"X-Long: " + b"x" * (1 << 20)
        try:
            one.sendall(line)
            answer = one.recv(1 << 16)
        except ConnectionError:
            return
        assert answer.startswith(b"HTTP/1.1 400")
