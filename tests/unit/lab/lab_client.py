"""A session whose workers stand still, and a client that speaks to its server without a network."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rotorid.lab import server as lab_server
from rotorid.lab.session import OpenLog, Session
from rotorid.lab.tracks import write_tracks
from rotorid.lab.workers import Job, Workers

TOKEN, SECRET = "a" * 32, "b" * 32
HOST = "127.0.0.1:1234"


class StillWorkers(Workers):
    """Workers that only take down what they would run."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[list[str]] = []

    def start(self, words: Sequence[str], folder: Path) -> Job:
        self.words.append(list(words))
        job = Job(list(words), folder)
        job.end("refused")
        return job


@contextmanager
def lab_session(place: Path, workers: Workers | None = None) -> Iterator[Session]:
    """A session over a folder with a log in it, and one that only a link leads to."""
    root = place / "root"
    root.mkdir(parents=True)
    (root / "a.ulg").write_bytes(b"no log")
    (place / "outside.ulg").write_bytes(b"secret")
    (root / "link.ulg").symlink_to(place / "outside.ulg")
    made = Session(root, workers=workers or StillWorkers())
    try:
        yield made
    finally:
        made.close()


def seen(session: Session, table: str | None = None) -> OpenLog:
    """A log of the session that is read: by default one channel for a second at 1 kHz."""
    file = session.place / f"table-{len(session.logs)}.csv"
    samples = (f"{k / 1000},{np.sin(0.3 * k)}" for k in range(1000))
    file.write_text(table or "\n".join(["time [s],p [rad/s]", *samples]), encoding="utf-8")
    log = session.open(file, file.name)
    write_tracks(file, log.folder)
    return log


def client_of(session: Session, *, cookie: str | None = SECRET, host: str = HOST, once: bool = False) -> Any:
    """A client of the guarded application."""
    with warnings.catch_warnings():
        # It would rather have httpx2, and takes httpx.
        warnings.simplefilter("ignore", UserWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        from starlette.testclient import TestClient

    app = lab_server.lab_app(session, token=TOKEN, secret=SECRET, hosts=frozenset({HOST}), once=once)
    cookies = {} if cookie is None else {"rotorid_lab": cookie}
    return TestClient(app, base_url=f"http://{host}", cookies=cookies, follow_redirects=False)
