"""A server for one session: where it listens, who learns its address, and how it ends."""

import contextlib
import html
import ipaddress
import os
import secrets
import signal
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotorid.errors import UsageError
from rotorid.lab.steps import Project, read_project

if TYPE_CHECKING:
    import uvicorn
    from starlette.types import ASGIApp

    from rotorid.lab.session import Session

TOKEN_SIGNS = 20
_HTTP_PORT = 80
_QUEUE = 2048
_SNAPS = Path("/snap")


def require_host(host: str, token: str | None) -> None:
    """Refuse an address that others reach without a token that was chosen for it.

    Raises
    ------
    UsageError
        The token is missing or short.
    """
    if token is not None and (len(token) < TOKEN_SIGNS or not token.isascii() or not token.isalnum()):
        raise UsageError("the token is too weak", needed=f"{TOKEN_SIGNS} or more letters and digits")
    if not _is_loopback(host) and token is None:
        raise UsageError(
            f"--host {host} lets others reach the page, so it needs a token",
            remedy=f"add --token WORD with {TOKEN_SIGNS} or more letters and digits",
        )


def _is_loopback(host: str) -> bool:
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


def _is_every_address(bound: str) -> bool:
    address = ipaddress.ip_address(bound.partition("%")[0])
    return address.is_unspecified or bool(getattr(address, "ipv4_mapped", None) and address.ipv4_mapped.is_unspecified)  # type: ignore[union-attr]


def names_of(host: str, port: int) -> frozenset[str]:
    """Values of ``Host`` by which browsers call a server; they leave out the port of HTTP.

    Examples
    --------
    >>> sorted(names_of("192.168.1.5", 80)), sorted(names_of("::1", 8000))[:1]
    (['192.168.1.5', '192.168.1.5:80'], ['127.0.0.1:8000'])
    """
    names = {_named(host).lower(), *(("127.0.0.1", "localhost") if _is_loopback(host) else ())}
    return frozenset({f"{name}:{port}" for name in names} | (names if port == _HTTP_PORT else set()))


def _named(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def serve(
    given: Path | None,
    *,
    host: str,
    port: int,
    token: str | None,
    show: Callable[[str], None],
    launch: Callable[[Path], object] | None = None,
    preferred: Mapping[str, str] | None = None,
) -> None:
    """Serve a session until it is interrupted.

    Parameters
    ----------
    given
        A folder to choose logs from, a log, or a project file.
    host, port
        Where to listen.
    token
        What lets browsers in; without one it is drawn at random, and lets in one.
    show
        Is handed the address.
    launch
        Is handed a page to open in a browser, which leads there.
    preferred
        How the page looks first.

    Raises
    ------
    UsageError
        The extra is missing, what was given is absent, the port is taken, or the address wants a token.
    """
    try:
        import fastapi  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError:
        raise UsageError("the lab needs FastAPI and uvicorn", remedy="pip install 'rotorid[lab]'") from None
    from rotorid.lab.server import lab_app
    from rotorid.lab.session import Session

    require_host(host, token)
    project = _require_given(given)
    with contextlib.ExitStack() as stack:
        listening = stack.enter_context(listening_at(host, port))
        port = listening.getsockname()[1]
        session = Session(given if given is not None and given.is_dir() else None)
        stack.callback(session.close)
        if project is not None and given is not None:
            for name in project.logs:
                session.open(given.parent / name, name, words=str(given.parent / name))
            session.waiting = project.steps
        elif given is not None and given.is_file():
            session.open(given, given.name, words=str(given))
        word = token or secrets.token_urlsafe(24)
        app = lab_app(
            session,
            token=word,
            secret=secrets.token_urlsafe(24),
            once=token is None,
            hosts=names_of(host, port),
            cookie=f"rotorid_lab_{port}",
            preferred=preferred,
        )
        server = server_of(app)
        _end_on_signal(server, session)
        address = f"http://{_named(host)}:{port}/?token={word}"
        show(address)
        if launch is not None:
            door = door_to(address, session.place)
            stack.callback(door.unlink, missing_ok=True)
            launch(door)
        server.run(sockets=[listening])


def _require_given(given: Path | None) -> Project | None:
    """The project that was given, if it is one."""
    if given is None or given.is_dir():
        return None
    if not given.is_file():
        what = "is neither a file nor a folder" if given.exists() else "does not exist"
        raise UsageError(f"{given} {what}", needed="a folder, a log or a project file")
    return read_project(given) if given.suffix == ".toml" else None


def door_to(address: str, place: Path) -> Path:
    """A page for this user alone that leads to an address: on a command line everybody could read its token.

    A browser that came as a snap has a folder for temporary files of its own, and reads what lies in the home.
    """
    door = (Path.home() if _SNAPS.is_dir() else place) / f"rotorid-lab-{secrets.token_hex(4)}.html"
    there = html.escape(address)
    with os.fdopen(os.open(door, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        file.write(
            f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0;url={there}">'
            f'<title>rotorid lab</title><a href="{there}">rotorid lab</a>\n'
        )
    return door


def server_of(app: "ASGIApp") -> "uvicorn.Server":
    """A server for an application, whose slow clients hold up nobody."""
    import uvicorn

    from rotorid.lab.connections import ACCEPTED_AT_ONCE, PromptProtocol, Room

    config = uvicorn.Config(
        app, http=partial(PromptProtocol, room=Room()), ws="none", lifespan="off", log_level="critical",  # type: ignore[arg-type]
        access_log=False, timeout_graceful_shutdown=1, server_header=False, proxy_headers=False,
        backlog=ACCEPTED_AT_ONCE,
    )  # fmt: skip
    server = uvicorn.Server(config)
    server.capture_signals = contextlib.nullcontext  # type: ignore[method-assign,assignment]
    begin = server.startup

    async def startup(sockets: list[socket.socket] | None = None) -> None:
        await begin(sockets)
        # Whoever is not taken in at once waits in the system's queue: where it is full, clients try again in seconds.
        for listening in sockets or ():
            listening.listen(_QUEUE)

    server.startup = startup  # type: ignore[method-assign]
    return server


def _end_on_signal(server: "uvicorn.Server", session: "Session") -> None:
    def stop(_number: int, _frame: Any) -> None:
        server.should_exit = True
        # Requests that wait for a command end with it.
        threading.Thread(target=session.workers.close, daemon=True).start()

    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            if hasattr(signal, name):
                signal.signal(getattr(signal, name), stop)


def listening_at(host: str, port: int) -> socket.socket:
    """A socket that listens at one address.

    Raises
    ------
    UsageError
        It cannot, or the address is every address.
    """
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        *_, place = socket.getaddrinfo(host or "0.0.0.0", port, family, socket.SOCK_STREAM)[0]
        with contextlib.ExitStack() as stack:
            listening = stack.enter_context(socket.socket(family, socket.SOCK_STREAM))
            if sys.platform != "win32":
                listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listening.bind(place)
            if _is_every_address(listening.getsockname()[0]):
                raise UsageError(
                    f"--host {host or repr(host)} means every address of this machine",
                    needed="the one address to serve",
                )
            listening.listen(100)
            stack.pop_all()
    except (OSError, OverflowError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"port {port} of {host} cannot be used: {why}", remedy="choose a free one, or --port 0"
        ) from None
    return listening
