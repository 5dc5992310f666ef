"""A recorded conversation of tool calls; run as a module it is recorded anew.

The server runs as its users run it, ``rotorid mcp FOLDER``, and is spoken to through the SDK's client.
"""

from __future__ import annotations

import asyncio
import json
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.unit.cli.commands import fly_roll_sweeps

RECORD = Path(__file__).parent / "conversation.json"

SHORT: Sequence[tuple[str, dict[str, Any]]] = (
    ("files", {}),
    ("inspect", {"log": "../secret.csv"}),
    ("inspect", {"log": "out.csv"}),
    ("tune", {"given": ["sweeps.csv"], "robustness": "firm"}),
    ("tune", {"given": ["sweeps.csv"], "judge_text": "roll: P=0.1"}),
)
"""Calls of every run: what is there, what is refused, and gains that cannot be judged without a controller."""

LONG: Sequence[tuple[str, dict[str, Any]]] = (
    ("inspect", {"log": "sweeps.csv"}),
    ("review", {"log": "sweeps.csv", "models": False}),
    ("identify", {"logs": ["sweeps.csv"], "models": ["rate.roll"], "band_rad_s": [12.0, 50.0], "out": "roll"}),
    ("identify", {"logs": ["sweeps.csv"], "models": ["rate.yaw"]}),
    ("verify", {"result": "rotorid-out/roll", "logs": ["sweeps.csv"]}),
    ("tune", {"given": ["rotorid-out/roll"]}),
    ("export", {"results": ["rotorid-out/roll"], "to": "json"}),
    ("details", {"result": "rotorid-out/roll", "key": "correlation.names"}),
    ("picture", {"result": "rotorid-out/roll"}),
    ("files", {}),
)
"""The whole way from a log to a model that travels."""


def make_folder(place: Path) -> Path:
    """A folder with a log, and a link that leads out of it."""
    folder = place / "logs"
    folder.mkdir()
    fly_roll_sweeps(folder / "sweeps.csv")
    (place / "secret.csv").write_text("time [s],p [rad/s]\n0,1\n")
    (folder / "out.csv").symlink_to(place / "secret.csv")
    return folder


async def talk(folder: Path, calls: Sequence[tuple[str, dict[str, Any]]]) -> list[dict[str, Any]]:
    """Each call with its answer."""
    from mcp import ClientSession, StdioServerParameters, stdio_client

    server = StdioServerParameters(command=sys.executable, args=["-m", "rotorid", "mcp", str(folder)])
    found = []
    async with stdio_client(server) as streams, ClientSession(*streams) as session:
        await session.initialize()
        for tool, arguments in calls:
            result = await session.call_tool(tool, arguments)
            (content,) = result.content
            text = getattr(content, "text", "")
            found.append({"tool": tool, "arguments": arguments, "error": result.is_error, "bytes": len(text.encode())})
            found[-1]["answer"] = json.loads(text)
    return found


def spoken(folder: Path, calls: Sequence[tuple[str, dict[str, Any]]]) -> list[dict[str, Any]]:
    """A conversation about a folder."""
    return asyncio.run(talk(folder, calls))


def comparable(value: Any) -> Any:
    """An answer without what another processor or version changes in the last digits."""
    if isinstance(value, dict):
        return {name: comparable(part) for name, part in value.items() if name not in ("sha256", "bytes", "version")}
    if isinstance(value, list):
        return [comparable(part) for part in value]
    if isinstance(value, float):
        return float(f"{value:.2g}")
    return re.sub(r"\d+([.,]\d+)*", "#", value) if isinstance(value, str) else value


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as temporary:
        record = spoken(make_folder(Path(temporary)), [*SHORT, *LONG])
    RECORD.write_text(json.dumps(record, indent=1, ensure_ascii=True) + "\n", encoding="utf-8")
