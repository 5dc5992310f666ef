"""Damaged and foreign files dropped onto the lab: each is a sentence, no request fails, and nothing lies elsewhere."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from tests.hostile.damage import Campaign, Sample
from tests.hostile.samples import blackbox, crazyflie, dataflash, tlog, ulog
from tests.unit.lab.lab_client import client_of, lab_session

from rotorid.lab.workers import Workers

pytest.importorskip("fastapi", reason="the extra lab is not installed")
pytest.importorskip("httpx", reason="httpx is not installed")

SAMPLES = (ulog, dataflash, blackbox, crazyflie, tlog)
FOREIGN = {
    "empty.ulg": b"",
    "page.html": b"<html><script>alert(1)</script></html>",
    "zeros.bin": bytes(4096),
    "bomb.ulg.gz": b"\x1f\x8b\x08\x00" + bytes(64),
    "rotorid.toml": b'schema = "rotorid.project/1"\nlogs = ["/etc/passwd"]\n',
    "table.csv": b"time,p\n0,nan\n1,inf\n",
}


def _files(each: int) -> list[tuple[str, bytes]]:
    found = list(FOREIGN.items())
    for make in SAMPLES:
        sample: Sample = make()
        damaged = Campaign(truncations=each // 2, flips=each - each // 2, seed=1).variants(sample.content)
        found += [(sample.name, content) for content in damaged]
    return found


@pytest.mark.parametrize("each", [1, pytest.param(40, marks=pytest.mark.slow)])
def test_what_is_dropped_costs_a_sentence(each: int, tmp_path: Path) -> None:
    with lab_session(tmp_path, Workers()) as session:
        before = {one for one in tmp_path.rglob("*") if not one.is_relative_to(session.place)}
        client = client_of(session)
        states: Counter[str] = Counter()
        for name, content in _files(each):
            answer = client.post("/api/upload", params={"name": name}, content=content)
            assert answer.status_code == 200, (name, answer.text)
            number = answer.json()["log"]
            job = session.logs[number - 1].job
            assert job is not None
            assert job.ended.wait(120.0), name
            state = client.get("/api/state").json()["logs"][number - 1]
            states[state["state"]] += 1
            assert state["state"] in ("done", "refused"), (name, state)
            assert state["state"] == "done" or state["sentence"]
            assert "Traceback" not in str(state)
            shown = client.get(f"/api/logs/{number}")
            assert shown.status_code == (200 if state["readable"] else 400)
            if state["readable"]:
                start, stop = shown.json()["span_s"]
                for kind in ("track", "spectrum", "spectrogram"):
                    asked = {"channel": 0, "start": start, "stop": stop}
                    assert client.get(f"/api/logs/{number}/{kind}", params=asked).status_code == 200
            assert client.delete(f"/api/logs/{number}").status_code == 200
        assert states["refused"] >= 4
        assert session.uploaded_bytes() == 0
        assert {one for one in tmp_path.rglob("*") if not one.is_relative_to(session.place)} == before
