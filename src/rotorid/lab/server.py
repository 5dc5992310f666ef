"""The application behind the page: routes that show logs, carry out commands, and hand out what these wrote."""

import json
import logging
from collections.abc import AsyncIterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rotorid.data.findings import KINDS
from rotorid.data.quantities import QUANTITIES
from rotorid.errors import RotoridError, UsageError
from rotorid.lab.guard import Guard, TooLargeError
from rotorid.lab.session import OpenLog, Ran, Session, curves, document, parts
from rotorid.lab.steps import Step, first_wrong
from rotorid.lab.tracks import Tracks, listed
from rotorid.lab.workers import Job

if TYPE_CHECKING:
    from fastapi import FastAPI
    from starlette.types import ASGIApp

STATIC = Path(__file__).resolve().parent / "static"
# A report carries its own scripts: they run in an origin of their own, which may ask this server for nothing.
_REPORT_POLICY = (
    "sandbox allow-scripts allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_LOG = logging.getLogger("rotorid.lab")

Seconds = Annotated[float, Field(allow_inf_nan=False)]


class Chosen(BaseModel):
    """A log of the folder given at start."""

    model_config = ConfigDict(extra="forbid")
    name: str = Field(max_length=4096)


def lab_app(
    session: Session,
    *,
    token: str,
    secret: str,
    hosts: frozenset[str],
    cookie: str = "rotorid_lab",
    once: bool = False,
    preferred: Mapping[str, str] | None = None,
) -> "ASGIApp":
    """The guarded application of a session; ``preferred`` is how the page looks first."""
    from fastapi import FastAPI
    from fastapi.responses import FileResponse, JSONResponse, Response
    from starlette.staticfiles import StaticFiles

    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)
    _add_sentences(app)

    @app.get("/")
    def page() -> Response:
        return FileResponse(STATIC / "index.html")

    @app.get("/api/state")
    def state() -> Response:
        state = {
            "logs": [_describe_log(log) for log in list(session.logs)],
            "steps": [_describe_step(step, session.logs) for step in list(session.steps)],
            "waiting": [step.model_dump(mode="json") for step in session.waiting],
            "following": not session.followed.is_set(),
            "folder": session.root is not None,
            "preferred": dict(preferred or {}),
        }
        return JSONResponse(state)

    for add in (_add_logs, _add_views, _add_steps, _add_files):
        add(app, session)
    app.mount("/static", StaticFiles(directory=STATIC, follow_symlink=False))
    return Guard(app, token=token, secret=secret, hosts=hosts, cookie=cookie, once=once)


def _add_sentences(app: "FastAPI") -> None:
    """What went wrong, as a sentence for the page."""
    from fastapi import Request
    from fastapi.exceptions import RequestValidationError
    from fastapi.responses import JSONResponse, PlainTextResponse, Response
    from starlette.requests import ClientDisconnect

    def sentence_response(status: int, sentence: str) -> Response:
        return JSONResponse({"sentence": sentence}, status_code=status)

    def refused(_: Request, error: Exception) -> Response:
        return sentence_response(400, str(error))

    def wrong(_: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError | ValidationError)
        return sentence_response(422, f"{first_wrong(error.errors())}.")

    def no_text(_: Request, __: Exception) -> Response:
        return sentence_response(422, "The server cannot read this request.")

    def too_large(_: Request, __: Exception) -> Response:
        return PlainTextResponse("The request is too large.", status_code=413)

    def gone(_: Request, __: Exception) -> Response:
        return sentence_response(410, "This is no longer available: its log was closed, or the session ended.")

    def failed(_: Request, error: Exception) -> Response:
        _LOG.error("the lab could not answer", exc_info=error)
        return sentence_response(500, "The server failed; see its terminal for the reason.")

    app.add_exception_handler(TooLargeError, too_large)
    app.add_exception_handler(RotoridError, refused)
    app.add_exception_handler(RequestValidationError, wrong)
    app.add_exception_handler(ValidationError, wrong)
    app.add_exception_handler(UnicodeError, no_text)
    app.add_exception_handler(FileNotFoundError, gone)
    app.add_exception_handler(ClientDisconnect, gone)
    app.add_exception_handler(Exception, failed)


def _add_logs(app: "FastAPI", session: Session) -> None:
    """Routes that open logs, and close them."""
    from fastapi import Request
    from fastapi.responses import JSONResponse, Response

    @app.get("/api/folder")
    def folder() -> Response:
        return JSONResponse(session.choices())

    @app.post("/api/open")
    def choose(chosen: Chosen) -> Response:
        return JSONResponse({"log": session.choose(chosen.name).number})

    @app.post("/api/demo")
    def demo() -> Response:
        return JSONResponse({"log": session.demo().number})

    @app.post("/api/upload")
    async def upload(request: Request, name: str) -> Response:
        # What is announced is refused before it is sent, and what was not announced as it comes.
        announced = int(request.headers.get("content-length", 0))
        return JSONResponse({"log": (await _taken_in(session, name, request.stream(), announced)).number})

    @app.delete("/api/logs/{number}")
    def close(number: int) -> Response:
        session.close_log(_log_of(session, number))
        return JSONResponse({})


def _add_views(app: "FastAPI", session: Session) -> None:
    """Routes that show what is in a log."""
    from fastapi.responses import JSONResponse, Response

    def tracks_of(number: int, channel: int = 0) -> Tracks:
        log = _log_of(session, number)
        if log.tracks is None:
            raise UsageError(f"{log.name} has not been read yet")
        if not 0 <= channel < len(log.tracks.channels):
            raise UsageError(f"there is no channel {channel}", remedy="reload the page")
        return log.tracks

    @app.get("/api/logs/{number}")
    def log(number: int) -> Response:
        tracks = tracks_of(number)
        answer = {"channels": tracks.channels, "span_s": tracks.span_s, "inspection": tracks.inspection()}
        return JSONResponse(answer)

    @app.get("/api/logs/{number}/track")
    def track(number: int, channel: int, start: Seconds, stop: Seconds, points: int = 1000) -> Response:
        pyramid = tracks_of(number, channel).pyramid(channel)
        x, y = pyramid.view(start, stop, min(max(points, 10), 4000))
        return JSONResponse({"x": listed(x), "y": listed(y)})

    @app.get("/api/logs/{number}/spectrum")
    def spectrum(number: int, channel: int, start: Seconds, stop: Seconds) -> Response:
        return JSONResponse(tracks_of(number, channel).spectrum(channel, start, stop))

    @app.get("/api/logs/{number}/spectrogram")
    def spectrogram(number: int, channel: int, start: Seconds, stop: Seconds) -> Response:
        return JSONResponse(tracks_of(number, channel).spectrogram(channel, start, stop))


def _add_steps(app: "FastAPI", session: Session) -> None:
    """Routes that carry out commands."""
    from fastapi.responses import JSONResponse, PlainTextResponse, Response

    @app.get("/api/words")
    def words() -> Response:
        # The address is known, and a browser on its way, before what measures loops is imported.
        from rotorid.reviewing.loops import LOOPS

        figures = {
            name: {"words": row.words, "unit": row.unit, "factor": row.factor or 1.0}
            for name, row in QUANTITIES.items()
        }
        headings = {name: kind.heading for name, kind in KINDS.items()}
        return JSONResponse(
            {"figures": figures, "findings": headings, "loops": {loop.name: loop.words for loop in LOOPS}}
        )

    @app.get("/api/models")
    def models() -> Response:
        return JSONResponse(session.models())

    @app.post("/api/preview")
    def preview(step: Step) -> Response:
        return JSONResponse({"command": session.preview(step)})

    @app.post("/api/steps")
    def run(step: Step) -> Response:
        return JSONResponse({"step": session.run(step).number})

    @app.post("/api/waiting")
    def follow() -> Response:
        session.follow()
        return JSONResponse({})

    @app.get("/api/steps/{number}")
    def step(number: int) -> Response:
        ran = _step_of(session, number)
        if not ran.job.ended.is_set():
            return JSONResponse({"document": None, "curves": {}, "parts": {}, "files": [], "unavailable": []})
        files = [path.relative_to(ran.folder).as_posix() for path in session.files(ran)]
        printed = document(ran)
        answer = {
            "document": printed,
            "curves": curves(ran.folder),
            "parts": parts(ran.folder),
            "files": files,
            "unavailable": unavailable(printed) if ran.step.verb == "review" else [],
        }
        return PlainTextResponse(json.dumps(answer), media_type="application/json")

    @app.delete("/api/steps/{number}")
    def cancel(number: int) -> Response:
        session.workers.cancel(_step_of(session, number).job)
        return JSONResponse({})


def _add_files(app: "FastAPI", session: Session) -> None:
    """Routes that hand out what the commands wrote."""
    from fastapi.responses import FileResponse, Response

    @app.get("/api/steps/{number}/files/{place}")
    def file(number: int, place: int) -> Response:
        files = session.files(_step_of(session, number))
        if not 0 <= place < len(files):
            raise UsageError(f"there is no file {place}", remedy="reload the page")
        return FileResponse(
            files[place],
            filename=files[place].name,
            media_type="application/octet-stream",
            content_disposition_type="attachment",
        )

    @app.get("/api/steps/{number}/report")
    def report(number: int) -> Response:
        page = session.report(_step_of(session, number))
        return FileResponse(page, media_type="text/html", headers={"content-security-policy": _REPORT_POLICY})

    @app.get("/api/project")
    def project() -> Response:
        return Response(
            session.project(),
            media_type="application/toml",
            headers={"Content-Disposition": 'attachment; filename="rotorid.toml"'},
        )


def _log_of(session: Session, number: int) -> OpenLog:
    if not 1 <= number <= len(session.logs) or session.logs[number - 1].closed:
        raise UsageError(f"log {number} is not open", remedy="reload the page")
    return session.logs[number - 1]


def _step_of(session: Session, number: int) -> Ran:
    if not 1 <= number <= len(session.steps):
        raise UsageError(f"there is no step {number}", remedy="reload the page")
    return session.steps[number - 1]


async def _taken_in(session: Session, name: str, parts: AsyncIterable[bytes], announced: int) -> OpenLog:
    """Save and open an uploaded log; on failure nothing of it remains."""
    from anyio import open_file

    path, called = session.upload_path(name)
    try:
        session.take_in(path, 0, announced=announced)
        async with await open_file(path, "xb") as file:
            async for part in parts:
                session.take_in(path, len(part))
                await file.write(part)
        return session.open(path, called)
    except OSError as error:
        session.drop_upload(path)
        why = error.strerror or type(error).__name__
        raise UsageError(f"the log could not be saved: {why}", remedy=f"make room in {path.parents[1]}") from error
    except BaseException:
        session.drop_upload(path)
        raise


def unavailable(printed: Any) -> list[list[dict[str, str]]]:
    """What each review of a document could not measure, in words."""
    if printed is None:
        return []
    from rotorid.reviewing.missing import Unavailable
    from rotorid.reviewing.missing_words import gathered

    reviews = printed.get("reviews") or [printed]
    return [
        [
            {"what": gap.what, "why": gap.why, "remedy": gap.remedy}
            for gap in gathered(Unavailable(**row) for row in review.get("cannot_tell", ()))
        ]
        for review in reviews
    ]


def _describe_log(log: OpenLog) -> dict[str, Any]:
    answer = {"number": log.number, "name": log.name, "note": log.note, "bytes": log.size_bytes}
    closed = {"state": "closed"} if log.closed else {}
    return answer | {"readable": log.tracks is not None} | _describe_job(log.job) | closed


def _describe_step(ran: Ran, logs: list[OpenLog]) -> dict[str, Any]:
    answer = {"number": ran.number, "step": ran.step.model_dump(mode="json"), "command": list(ran.shown)}
    names = [logs[number - 1].name for number in ran.step.logs if 1 <= number <= len(logs)]
    # Costs are drawn while a fit goes on, and are in its document afterwards.
    costs = [] if ran.job.ended.is_set() else ran.job.costs[-200:]
    return answer | {"logs": names, "seconds": ran.job.seconds, "costs": costs} | _describe_job(ran.job)


def _describe_job(job: Job) -> dict[str, Any]:
    """How far a job is."""
    return {"state": job.state, "doing": job.doing, "share": job.share, "sentence": job.sentence}
