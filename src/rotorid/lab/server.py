"""The server of the lab: one page, its guards, and the routes behind it.

Whoever may ask is settled before any route is looked at: :class:`Guard` knows the names by which this server may be
called (a page of another origin that had its name point here comes with another ``Host``), refuses requests that
another page made, and lets in who has the session's token.
"""

import contextlib
import hmac
import ipaddress
import json
import secrets
import signal
import socket
import sys
import threading
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rotorid.errors import RotoridError, UsageError
from rotorid.lab.session import ALL_UPLOAD_BYTES, UPLOAD_BYTES, OpenLog, Ran, Session, curves, document, listed
from rotorid.lab.steps import Step, read_project
from rotorid.lab.workers import Job

if TYPE_CHECKING:
    from fastapi import FastAPI

STATIC = Path(__file__).resolve().parent / "static"
BODY_BYTES = 1 << 16
TOKEN_SIGNS = 20
_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# A report carries its own scripts: they run in an origin of their own, which may ask this server for nothing.
_REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = (
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


class Guard:
    """Lets in who calls the server by its name, from its own page, with its token.

    Parameters
    ----------
    app
        What is guarded.
    token
        Of the session.
    hosts
        Values of ``Host`` that name this server.
    cookie
        Name of the cookie that carries the token.
    """

    def __init__(self, app: App, *, token: str, hosts: frozenset[str], cookie: str) -> None:
        self._app, self._token, self._hosts, self._cookie = app, token, hosts, cookie

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Refuse, exchange the token for a cookie, or pass on."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            await send({"type": "websocket.close", "code": 1008})
            return

        begun = False

        async def answer(message: MutableMapping[str, Any]) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                kept = [(name, value) for name, value in message.get("headers", []) if name.lower() != b"server"]
                own = any(name == b"content-security-policy" for name, _ in kept)
                policy = [] if own else [(b"content-security-policy", _POLICY.encode())]
                message["headers"] = [*kept, *policy, *_HEADERS]
            await send(message)

        headers: dict[bytes, list[bytes]] = {}
        for name, value in scope["headers"]:
            headers.setdefault(name.lower(), []).append(value)
        hosts = [value.decode("latin-1").lower() for value in headers.get(b"host", [])]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            await _say(answer, 421, "This server has another name.")
            return
        if self._is_foreign(scope["method"], hosts[0], headers):
            await _say(answer, 403, "Another page asked.")
            return
        given = parse_qs(scope["query_string"].decode("latin-1"), max_num_fields=20) if _few(scope) else {}
        if scope["path"] == "/" and scope["method"] == "GET" and self._is_token(*given.get("token", [])):
            cookie = f"{self._cookie}={self._token}; Path=/; HttpOnly; SameSite=Strict"
            await _say(answer, 303, "", (b"location", b"/"), (b"set-cookie", cookie.encode()))
            return
        if not self._is_token(*_cookies(headers.get(b"cookie", []), self._cookie)):
            await _say(answer, 401, "Open the address that rotorid lab printed: it carries the token of this session.")
            return
        if not self._fits(scope, headers):
            await _say(answer, 413, "The request is too large.")
            return
        try:
            await self._app(scope, _limited(receive, scope["path"]), answer)
        except _TooLargeError:
            if not begun:
                await _say(answer, 413, "The request is too large.")
        except Exception:
            # What went wrong is this server's own matter: the page gets a sentence, no traceback.
            if not begun:
                await _say(answer, 500, "The server could not answer that.")

    @staticmethod
    def _is_foreign(method: str, host: str, headers: dict[bytes, list[bytes]]) -> bool:
        """Whether a page of another origin asked, or had its visitor's browser ask."""
        origins = [value.decode("latin-1").lower() for value in headers.get(b"origin", [])]
        site = headers.get(b"sec-fetch-site", [b"none"])[0]
        own = all(origin == f"http://{host}" for origin in origins)
        return not own or (method not in ("GET", "HEAD") and site not in (b"same-origin", b"none"))

    def _is_token(self, *given: str) -> bool:
        return len(given) == 1 and hmac.compare_digest(given[0].encode("utf-8", "replace"), self._token.encode())

    @staticmethod
    def _fits(scope: Scope, headers: dict[bytes, list[bytes]]) -> bool:
        most = UPLOAD_BYTES if scope["path"] == "/api/upload" else BODY_BYTES
        length = headers.get(b"content-length", [b"0"])[-1]
        return length.isdigit() and len(length) < 16 and int(length) <= most


def _few(scope: Scope) -> bool:
    return len(scope["query_string"]) < 4096 and scope["query_string"].count(b"&") < 20


class _TooLargeError(Exception):
    """More came than was announced or allowed."""


def _limited(receive: Receive, path: str) -> Receive:
    left = UPLOAD_BYTES if path == "/api/upload" else BODY_BYTES

    async def counted() -> MutableMapping[str, Any]:
        nonlocal left
        message = await receive()
        left -= len(message.get("body", b""))
        if left < 0:
            raise _TooLargeError
        return message

    return counted


def _cookies(values: list[bytes], name: str) -> list[str]:
    pairs = (part.strip().partition("=") for value in values for part in value.decode("latin-1").split(";"))
    return [value for key, _, value in pairs if key == name]


async def _say(send: Send, status: int, sentence: str, *headers: tuple[bytes, bytes]) -> None:
    body = sentence.encode()
    shown = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode()), *headers]
    await send({"type": "http.response.start", "status": status, "headers": shown})
    await send({"type": "http.response.body", "body": body})


class Chosen(BaseModel):
    """A log of the folder given at start."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(max_length=4096)


def lab_app(
    session: Session,
    *,
    token: str,
    hosts: frozenset[str],
    cookie: str = "rotorid_lab",
    preferred: Mapping[str, str] | None = None,
) -> App:
    """The guarded application of a session; ``preferred`` is how the page looks first."""
    from fastapi import FastAPI, Request
    from fastapi.exceptions import RequestValidationError
    from fastapi.responses import FileResponse, JSONResponse, PlainTextResponse, Response
    from starlette.staticfiles import StaticFiles

    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)

    def refused(_: Request, error: Exception) -> Response:
        return JSONResponse({"sentence": str(error)}, status_code=400)

    def wrong(_: Request, __: Exception) -> Response:
        return JSONResponse({"sentence": "The request is not one that this page makes."}, status_code=422)

    def too_large(_: Request, __: Exception) -> Response:
        return PlainTextResponse("The request is too large.", status_code=413)

    app.add_exception_handler(_TooLargeError, too_large)
    app.add_exception_handler(RotoridError, refused)
    app.add_exception_handler(RequestValidationError, wrong)
    app.add_exception_handler(ValidationError, wrong)
    app.add_exception_handler(UnicodeError, wrong)

    @app.get("/")
    def page() -> Response:
        return FileResponse(STATIC / "index.html")

    @app.get("/api/state")
    def state() -> Response:
        logs = [
            {"name": one.name, "seen": one.tracks is not None}
            | _told(one.job)
            | ({"state": "closed"} if one.closed else {})
            for one in session.logs
        ]
        steps = [
            {"step": one.step.model_dump(mode="json"), "command": one.shown, "seconds": one.job.seconds}
            | {"costs": one.job.costs[-200:]}
            | _told(one.job)
            for one in session.steps
        ]
        waiting = [one.model_dump(mode="json") for one in session.waiting]
        told = {"logs": logs, "steps": steps, "waiting": waiting, "folder": session.root is not None}
        return JSONResponse(told | {"preferred": dict(preferred or {})})

    _add_logs(app, session)
    _add_steps(app, session)
    app.mount("/static", StaticFiles(directory=STATIC, follow_symlink=False))
    return Guard(app, token=token, hosts=hosts, cookie=cookie)


def _add_logs(app: "FastAPI", session: Session) -> None:
    """Routes that open logs, and show what is in them."""
    from fastapi import Request
    from fastapi.responses import JSONResponse, Response

    def log_of(number: int) -> OpenLog:
        if not 1 <= number <= len(session.logs) or session.logs[number - 1].closed:
            raise UsageError(f"log {number} came", needed=f"one of the {len(session.logs)} that are open")
        return session.logs[number - 1]

    @app.get("/api/folder")
    def folder() -> Response:
        return JSONResponse(session.choices())

    @app.post("/api/open")
    def choose(chosen: Chosen) -> Response:
        session.choose(chosen.name)
        return JSONResponse({"log": len(session.logs)})

    @app.post("/api/demo")
    def demo() -> Response:
        session.demo()
        return JSONResponse({})

    @app.post("/api/upload")
    async def upload(request: Request, name: str) -> Response:
        from anyio import open_file

        too_much = UsageError("more came than a session keeps", needed="a log to be closed")
        if session.uploaded_bytes() + int(request.headers.get("content-length", 0)) > ALL_UPLOAD_BYTES:
            raise too_much
        path = session.upload_path(name)
        try:
            async with await open_file(path, "xb") as file:
                async for part in request.stream():
                    await file.write(part)
            # A request without a length says only now how much it was.
            if session.uploaded_bytes() > ALL_UPLOAD_BYTES:
                raise too_much
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        try:
            session.open(path, path.name)
        except UsageError:
            path.unlink(missing_ok=True)
            raise
        return JSONResponse({"log": len(session.logs)})

    @app.delete("/api/logs/{number}")
    def close(number: int) -> Response:
        session.close_log(log_of(number))
        return JSONResponse({})

    @app.get("/api/logs/{number}")
    def log(number: int) -> Response:
        tracks = _tracks(log_of(number))
        told = {"channels": tracks.channels, "span_s": tracks.span_s, "inspection": tracks.inspection()}
        return JSONResponse(told)

    @app.get("/api/logs/{number}/track")
    def track(number: int, channel: int, start: float, stop: float, points: int = 1000) -> Response:
        pyramid = _tracks(log_of(number), channel).pyramid(channel)
        x, y = pyramid.view(start, stop, min(max(points, 10), 4000))
        return JSONResponse({"x": listed(x), "y": listed(y)})

    @app.get("/api/logs/{number}/spectrum")
    def spectrum(number: int, channel: int, start: float, stop: float) -> Response:
        return JSONResponse(_tracks(log_of(number), channel).spectrum(channel, start, stop))

    @app.get("/api/logs/{number}/spectrogram")
    def spectrogram(number: int, channel: int, start: float, stop: float) -> Response:
        return JSONResponse(_tracks(log_of(number), channel).spectrogram(channel, start, stop))


def _add_steps(app: "FastAPI", session: Session) -> None:
    """Routes that carry out commands, and hand out what they wrote."""
    from fastapi.responses import FileResponse, JSONResponse, PlainTextResponse, Response

    def ran_of(number: int) -> Ran:
        if not 1 <= number <= len(session.steps):
            raise UsageError(f"step {number} came", needed=f"one of the {len(session.steps)} there are")
        return session.steps[number - 1]

    @app.get("/api/models")
    def models() -> Response:
        return JSONResponse(session.models())

    @app.post("/api/preview")
    def preview(step: Step) -> Response:
        return JSONResponse({"command": session.preview(step)})

    @app.post("/api/steps")
    def run(step: Step) -> Response:
        session.run(step)
        return JSONResponse({"step": len(session.steps)})

    @app.get("/api/steps/{number}")
    def step(number: int) -> Response:
        ran = ran_of(number)
        files = [one.relative_to(ran.folder).as_posix() for one in session.files(ran)]
        if not ran.job.ended.is_set():
            return JSONResponse({"document": None, "curves": {}, "files": []})
        told = {"document": document(ran), "curves": curves(ran), "files": files}
        return PlainTextResponse(json.dumps(told), media_type="application/json")

    @app.delete("/api/steps/{number}")
    def cancel(number: int) -> Response:
        session.workers.cancel(ran_of(number).job)
        return JSONResponse({})

    @app.get("/api/steps/{number}/files/{place}")
    def file(number: int, place: int) -> Response:
        files = session.files(ran_of(number))
        if not 0 <= place < len(files):
            raise UsageError(f"file {place} came", needed=f"one of the {len(files)} there are")
        return FileResponse(
            files[place],
            filename=files[place].name,
            media_type="application/octet-stream",
            content_disposition_type="attachment",
        )

    @app.get("/api/steps/{number}/report")
    def report(number: int) -> Response:
        page = session.report(ran_of(number))
        return FileResponse(page, media_type="text/html", headers={"content-security-policy": _REPORT_POLICY})

    @app.get("/api/project")
    def project() -> Response:
        return Response(
            session.project(),
            media_type="application/toml",
            headers={"Content-Disposition": 'attachment; filename="rotorid.toml"'},
        )


def _told(job: Job | None) -> dict[str, Any]:
    """How far a job is; one that is about to begin waits."""
    if job is None:
        return {"state": "waiting", "told": "", "share": None, "sentence": ""}
    return {"state": job.state, "told": job.told, "share": job.share, "sentence": job.sentence}


def _tracks(log: OpenLog, channel: int = 0) -> Any:
    if log.tracks is None:
        raise UsageError(f"{log.name} is not read", needed="a log that was read")
    if not 0 <= channel < len(log.tracks.channels):
        raise UsageError(f"channel {channel} came", needed=f"one of the {len(log.tracks.channels)} there are")
    return log.tracks


def require_host(host: str, token: str | None) -> None:
    """Refuse an address that others reach without a token that was chosen for it.

    Raises
    ------
    UsageError
        The token is missing or short, or the address is every address.
    """
    if token is not None and (len(token) < TOKEN_SIGNS or not token.isascii() or not token.isalnum()):
        raise UsageError("a weak --token came", needed=f"{TOKEN_SIGNS} letters and digits or more")
    with contextlib.suppress(ValueError):
        if ipaddress.ip_address(host).is_unspecified:
            raise UsageError(f"--host {host} came, which is every address", needed="the one address to be reached by")
    if not _is_loopback(host) and token is None:
        raise UsageError(
            f"--host {host} came without a token: others could reach the page",
            needed=f"--token WORD of {TOKEN_SIGNS} letters and digits or more",
        )


def _is_loopback(host: str) -> bool:
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host).is_loopback
    return host == "localhost"


def serve(
    given: Path | None,
    *,
    host: str,
    port: int,
    token: str | None,
    show: Callable[[str], None],
    preferred: Mapping[str, str] | None = None,
) -> None:
    """Serve a session until it is interrupted; ``show`` is handed the address, ``preferred`` is how the page looks.

    Raises
    ------
    UsageError
        The extra is missing, the folder is absent, the port is taken, or the address wants a token.
    """
    try:
        import fastapi  # noqa: F401
        import uvicorn
    except ImportError:
        raise UsageError(
            "the lab needs FastAPI and uvicorn, which are not installed", needed="pip install 'rotorid[lab]'"
        ) from None
    require_host(host, token)
    if given is not None and not given.exists():
        raise UsageError(f"{given} does not exist", needed="a folder, a log or a project file")
    project = read_project(given) if given is not None and given.suffix == ".toml" else None
    with _listening(host, port) as listening:
        port = listening.getsockname()[1]
        root = None if given is None else given if given.is_dir() else given.parent
        session = Session(root)
        try:
            if project is not None and given is not None:
                for name in project.logs:
                    session.open(given.parent / name, name)
                session.waiting = project.steps
            elif given is not None and given.is_file():
                session.open(given, given.name)
            token = token or secrets.token_urlsafe(24)
            named = f"[{host}]" if ":" in host else host
            hosts = {f"{named}:{port}".lower()}
            if _is_loopback(host):
                hosts |= {f"127.0.0.1:{port}", f"localhost:{port}"}
            app = lab_app(
                session, token=token, hosts=frozenset(hosts), cookie=f"rotorid_lab_{port}", preferred=preferred
            )
            config = uvicorn.Config(
                app, log_level="critical", access_log=False, timeout_graceful_shutdown=1, limit_concurrency=200,
                timeout_keep_alive=30, h11_max_incomplete_event_size=1 << 15, ws="none", lifespan="off",
                server_header=False,
            )  # fmt: skip
            server = uvicorn.Server(config)
            server.capture_signals = contextlib.nullcontext  # type: ignore[method-assign,assignment]

            def stop(_number: int, _frame: Any) -> None:
                server.should_exit = True

            if threading.current_thread() is threading.main_thread():
                for number in (signal.SIGINT, signal.SIGTERM):
                    signal.signal(number, stop)
            show(f"http://{named}:{port}/?token={token}")
            server.run(sockets=[listening])
        finally:
            session.close()


def _listening(host: str, port: int) -> socket.socket:
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        listening = socket.socket(family, socket.SOCK_STREAM)
        if sys.platform != "win32":
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listening.bind((host, port))
        listening.listen(100)
    except (OSError, OverflowError) as error:
        listening.close()
        why = getattr(error, "strerror", None) or str(error)
        raise UsageError(f"port {port} of {host} cannot be used: {why}", needed="a free one, or --port 0") from None
    return listening
