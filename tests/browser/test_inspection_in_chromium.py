"""The page of ``inspect --plot`` in a real browser: it stands alone, draws its pictures, and nothing complains."""

from __future__ import annotations

import html
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.browser.chromium import SETTLED, asked, elements
from tests.unit.cli.commands import rotorid

from rotorid.data.record import Channel, FlightRecord, Source, Topic
from rotorid.io.tables.csv import write_csv
from rotorid.report.inspection import render_inspection
from rotorid.reviewing.inspection import inspect

OPENED = f"""
async () => {{
  {SETTLED}
  await openAll(document.querySelectorAll("details"));
  await settled();
  return document.documentElement.outerHTML;
}}
"""
"""The page with everything opened."""

HOSTILE = "</script><script>document.title='run'</script><img src=x onerror=document.title='run'>"


def sweep() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Forty seconds at 100 Hz: a roll sweep, the rate that follows it, and a battery that empties."""
    time_s = np.arange(0.0, 40.0, 0.01)
    moving = (time_s > 5.0) & (time_s < 35.0)
    phase = 2.0 * np.pi * np.cumsum(np.where(moving, 0.2 * 20.0 ** ((time_s - 5.0) / 30.0), 0.0)) * 0.01
    command = np.where(moving, 0.1 * np.sin(phase), 0.0)
    columns = {"roll_command": command, "p": 3.0 * command, "battery_voltage": np.linspace(16.0, 15.0, time_s.size)}
    return time_s, columns


def test_the_page_that_the_command_writes_draws_everything(alone: Any, tmp_path: Path) -> None:
    write_csv(tmp_path / "flight.csv", *sweep())
    assert rotorid("inspect", tmp_path / "flight.csv", "--plot", tmp_path / "flight.html").code == 0
    page = (tmp_path / "flight.html").read_text(encoding="utf-8")

    seen, console = asked(alone, page, tmp_path, OPENED)

    assert console == []
    assert 'data-pictures="drawn"' in seen
    body = seen[seen.index("<body") :]
    pictures = len(re.findall(r"data-picture=", page))
    assert pictures > 0
    assert body.count('class="cartesianlayer"') == pictures
    # The curves themselves, and not their axes alone: paths with points.
    assert len(re.findall(r'class="js-line"[^>]* d="M', body)) >= pictures
    assert re.findall(r' src="(?:\w+:)?//', seen) == []


def test_the_page_shows_the_commands_that_the_terminal_prints() -> None:
    time_s, columns = sweep()
    topic = Topic(
        name="log",
        time_s=time_s,
        channels=tuple(Channel(name=name, unit="1") for name in columns),
        values=np.stack(list(columns.values())),
    )
    record = FlightRecord(source=Source(name="my flight.csv", format="CSV", sha256="ab"), topics=(topic,))
    inspection = inspect(record)
    assert inspection.next_commands
    page = html.unescape(render_inspection(record, inspection))
    for command in inspection.next_commands:
        assert f"<pre><code>{command}</code></pre>" in page


def test_names_of_a_hostile_log_stay_text(alone: Any, tmp_path: Path) -> None:
    time_s, columns = sweep()
    record = FlightRecord(
        source=Source(name=f"{HOSTILE}.csv", format="CSV", sha256="ab"),
        topics=tuple(
            Topic(
                name=f"{HOSTILE}{name}",
                time_s=time_s,
                channels=(Channel(name=name, unit=unit, source=HOSTILE),),
                values=columns[name][None],
            )
            for name, unit in (("roll_command", "1"), ("p", "rad/s"))
        ),
    )

    seen, console = elements(alone, render_inspection(record, inspect(record)), tmp_path)

    assert console == []
    assert 'data-pictures="drawn"' in seen
    assert "<title>run</title>" not in seen


@pytest.mark.parametrize(
    "injected", ["<script>document.title = 'run'</script>", "<img src='http://example.com/x.png'>"]
)
def test_what_is_injected_is_refused(alone: Any, tmp_path: Path, injected: str) -> None:
    """The policy of the page holds even if escaping failed somewhere: no script of others, nothing from a network."""
    time_s, columns = sweep()
    channels = (Channel(name="p", unit="rad/s"),)
    topic = Topic(name="gyro", time_s=time_s, channels=channels, values=columns["p"][None])
    record = FlightRecord(source=Source(name="flight.csv", format="CSV", sha256="ab"), topics=(topic,))
    page = render_inspection(record, inspect(record))
    changed = page.replace('<main id="main" tabindex="-1">', f"<main>{injected}", 1)
    assert changed != page

    seen, console = elements(alone, changed, tmp_path)

    assert "<title>run</title>" not in seen
    assert any("Content Security Policy" in line for line in console)
