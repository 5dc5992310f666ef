"""A session whose workers stand still, and a client that speaks to its server without a network."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rotorid.lab import server as lab_server
from rotorid.lab.session import Session
from rotorid.lab.workers import Job, Workers

TOKEN = "a" * 32
HOST = "127.0.0.1:1234"


class StillWorkers(Workers):
    """Workers that only take down what they would run."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[list[str]] = []

    def start(self, words, folder, *, then=None):  # type: ignore[no-untyped-def]
        self.words.append(list(words))
        job = Job(list(words), folder, state="refused", output=folder / "output.json")
        job.ended.set()
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


def client_of(session: Session, *, cookie: str | None = TOKEN, host: str = HOST) -> Any:
    """A client of the guarded application."""
    with warnings.catch_warnings():
        # It would rather have httpx2, and takes httpx.
        warnings.simplefilter("ignore", UserWarning)
        warnings.simplefilter("ignore", DeprecationWarning)
        from starlette.testclient import TestClient

    app = lab_server.lab_app(session, token=TOKEN, hosts=frozenset({HOST}))
    cookies = {} if cookie is None else {"rotorid_lab": cookie}
    return TestClient(app, base_url=f"http://{host}", cookies=cookies, follow_redirects=False)
