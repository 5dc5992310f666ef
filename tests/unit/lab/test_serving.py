"""`rotorid lab` at a terminal: where it listens, whom its address lets in, who sees its token, how it ends."""

from __future__ import annotations

import contextlib
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest
import typer
from tests.unit.cli.commands import fly_roll_sweeps
from typer.testing import CliRunner

from rotorid.cli.app import app
from rotorid.errors import UsageError
from rotorid.lab import serving

WORD = "x" * 20
FROM_HERE = [sys.executable, "-m", "rotorid", "lab", "--no-browser"]


def test_without_the_extra_it_says_what_to_install() -> None:
    script = (
        "import sys\nsys.modules['fastapi'] = None\nfrom rotorid.cli.app import main\n"
        "sys.argv = ['rotorid', 'lab', '--no-browser']\nmain()\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert "pip install 'rotorid[lab]'" in line


@pytest.mark.parametrize("host", ["0.0.0.0", "0", "", "0x0", "000.000.0.0", "::", "0::0", "::ffff:0.0.0.0"])
def test_no_spelling_is_every_address(host: str) -> None:
    with pytest.raises(UsageError, match=r"every address|cannot be used"):
        serving.listening_at(host, 0)


def test_a_host_that_this_machine_lacks_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    made = socket.socket

    def without_ipv6(family: int, *given: Any) -> socket.socket:
        if family == socket.AF_INET6:
            raise OSError(97, "Address family not supported by protocol")
        return made(family, *given)

    monkeypatch.setattr(socket, "socket", without_ipv6)
    for host in ("::1", "192.0.2.1", "no.such.name.invalid", "a" * 70 + ".example"):
        with pytest.raises(UsageError, match="cannot be used"):
            serving.listening_at(host, 0)


def test_a_port_that_is_taken_is_one_sentence() -> None:
    with serving.listening_at("127.0.0.1", 0) as first:
        port = first.getsockname()[1]
        with pytest.raises(UsageError, match=f"port {port} of 127.0.0.1 cannot be used"):
            serving.listening_at("127.0.0.1", port)


def test_browsers_leave_out_the_port_of_http() -> None:
    assert serving.names_of("localhost", 80) == {"localhost", "localhost:80", "127.0.0.1", "127.0.0.1:80"}
    assert serving.names_of("::1", 8000) == {"[::1]:8000", "localhost:8000", "127.0.0.1:8000"}
    assert serving.names_of("Lab.Example", 8000) == {"lab.example:8000"}


@pytest.mark.skipif(os.name == "nt", reason="files have no modes")
@pytest.mark.parametrize("snap", [False, True])
def test_the_door_is_for_this_user_alone(snap: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home, place = tmp_path / "home", tmp_path / "place"
    home.mkdir()
    place.mkdir()
    monkeypatch.setattr(Path, "home", lambda: home)
    monkeypatch.setattr(serving, "_SNAPS", tmp_path if snap else tmp_path / "none")
    door = serving.door_to(f"http://127.0.0.1:1234/?token={WORD}", place)
    assert door.parent == (home if snap else place)
    assert door.stat().st_mode & 0o777 == 0o600
    assert f'content="0;url=http://127.0.0.1:1234/?token={WORD}"' in door.read_text(encoding="utf-8")


def test_no_command_line_shows_the_token(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither that of the browser nor, where it is wanted so, that of the lab."""
    served: dict[str, Any] = {}
    launched: list[str] = []
    monkeypatch.setattr(serving, "serve", lambda _given, **named: served.update(named))
    monkeypatch.setattr(typer, "launch", launched.append)
    file = tmp_path / "word"
    file.write_text(WORD + "\n", encoding="utf-8")
    run = CliRunner().invoke
    assert run(app, ["lab", "--token", f"@{file}"]).exit_code == 0
    assert served["token"] == WORD
    served["launch"](tmp_path / "door.html")
    assert launched == [str(tmp_path / "door.html")]
    assert run(app, ["lab", "--no-browser"], env={"ROTORID_LAB_TOKEN": WORD}).exit_code == 0
    assert (served["token"], served["launch"]) == (WORD, None)
    missing = run(app, ["lab", "--token", f"@{tmp_path / 'none'}"])
    assert isinstance(missing.exception, UsageError)
    assert "cannot be read: No such file" in str(missing.exception)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes with names")
def test_what_is_no_file_is_not_waited_for(tmp_path: Path) -> None:
    pytest.importorskip("fastapi", reason="the extra lab is not installed")
    os.mkfifo(tmp_path / "pipe.ulg")
    for name, words in (("pipe.ulg", "is neither a file nor a folder"), ("none.ulg", "does not exist")):
        with pytest.raises(UsageError, match=words):
            serving.serve(tmp_path / name, host="127.0.0.1", port=0, token=None, show=print)


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="processes are looked for in /proc")
def test_an_interrupt_ends_all_that_runs_and_waits(tmp_path: Path) -> None:
    """Two commands run, others wait, and a request waits for one of these."""
    httpx = pytest.importorskip("httpx", reason="httpx is not installed")
    pytest.importorskip("fastapi", reason="the extra lab is not installed")
    log = tmp_path / "log.csv"
    # A flight, so that the commands take their time.
    fly_roll_sweeps(log)
    private = tmp_path / "private"
    private.mkdir()
    server = subprocess.Popen(
        [*FROM_HERE, str(log)], stdout=subprocess.PIPE, text=True, env={**os.environ, "TMPDIR": str(private)}
    )
    assert server.stdout is not None
    with httpx.Client(timeout=60.0) as client:
        address = httpx.URL(server.stdout.readline().strip())
        assert client.get(address).status_code == 200
        ask = address.join("/api/state")
        # Nothing beside the one log can be chosen.
        assert client.get(ask).json()["folder"] is False
        client.post(address.join("/api/demo"))
        for _ in range(3):
            client.post(address.join("/api/steps"), json={"verb": "review", "logs": [1]})
        waits = threading.Thread(target=_asks, args=(client, address.join("/api/models")))
        waits.start()
        states: list[str] = []
        while states.count("running") < 2:
            told = client.get(ask).json()
            states = [one["state"] for one in (*told["logs"], *told["steps"])]
        assert "waiting" in states
        server.send_signal(2)
        server.communicate(timeout=10)
        waits.join(10.0)
    assert server.returncode == 0
    assert list(private.iterdir()) == []
    assert _named_in_processes(str(private)) == []


def _asks(client: Any, address: Any) -> None:
    """Ask for what comes late; the server may end before."""
    import httpx

    with contextlib.suppress(httpx.HTTPError):
        client.get(address)


def _named_in_processes(words: str) -> list[str]:
    """Command lines that run and hold these words."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            line = (place / "cmdline").read_bytes().replace(b"\0", b" ").decode("utf-8", "replace")
        except OSError:
            continue
        found += [line] if words in line else []
    return found


def test_the_door_leads_a_browser_in(tmp_path: Path) -> None:
    """From a file, whose way on is that of another site; and again afterwards, by the address and by loading anew."""
    pytest.importorskip("fastapi", reason="the extra lab is not installed")
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    from tests.browser.lab_page import chromium
    from tests.browser.lab_page import serving as running

    with running(private=tmp_path) as (address, _), chromium() as browser:
        door = serving.door_to(address, tmp_path)
        page = browser.new_page()
        page.goto(door.as_uri())
        for again in (None, door.as_uri(), address):
            if again is not None:
                page.goto(again)
            page.wait_for_selector("#drop")
            assert "token" not in page.url
        page.reload()
        page.wait_for_selector("#drop")
        other = browser.new_context().new_page()
        other.goto(address)
        other.wait_for_selector("text=lets one browser in")
        door.unlink()
