"""The page of the five papers as data, and one run of all its commands that several tests read.

Commands run in this process, so that what is compiled is compiled once, and every figure that is written leaves its
curves, bands and labels as numbers. ``ROTORID_PAPERS`` names a folder that keeps runs between sessions; a command that
has run there does not run again, so delete the folder after the program has changed.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import json
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from unittest import mock

import numpy as np
from typer.testing import CliRunner

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = Path(__file__).resolve().parents[2] / "docs" / "papers.md"
BLOCK = re.compile(r"^```(console|python)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"- `([^`]+)`: (.*)")
DIFFERENT = "\nDifferent on purpose:\n"

Json = Any
"""What a JSON text says."""


class Item(NamedTuple):
    """An item of a paper, and the run that gives it: a folder, a short command or Python."""

    paper: str
    run: str
    text: str

    @property
    def command(self) -> str:
        """The command of the run: in full, or that which writes the folder; else an expression of Python."""
        return self.run if self.run.startswith("rotorid ") else written().get(self.run, self.run)

    @property
    def is_python(self) -> bool:
        return "(" in self.run


@cache
def sections() -> list[tuple[str, str]]:
    parts = PAGE.read_text(encoding="utf-8").split("\n## ")[1:]
    return [(part.partition("\n")[0], part) for part in parts if part.startswith("Paper ")]


@cache
def items() -> list[Item]:
    """Items of all lists: of the folder at their beginning, or else of the command above."""
    found = []
    for title, part in sections():
        last = ""
        for line in part.partition(DIFFERENT)[0].splitlines():
            if line.startswith("$ rotorid "):
                last = folder_of(line)
            if line.startswith("- "):
                named = NAMED.match(line)
                found.append(Item(title, named[1], named[2]) if named else Item(title, last, line[2:]))
    return found


def steps(part: str) -> list[str]:
    """Commands and blocks of Python of a section, in their order."""
    found = []
    for language, text in BLOCK.findall(part):
        lines = [line.removeprefix("$ ") for line in text.splitlines() if line.startswith("$ rotorid ")]
        found += [text] if language == "python" else lines
    return found


def commands() -> list[str]:
    """Every command of the page once."""
    found = [step for _, part in sections() for step in steps(part)] + [item.run for item in items()]
    return [command for command in dict.fromkeys(found) if command.startswith("rotorid ")]


def of_paper(title: str) -> tuple[list[str], list[Item]]:
    """Steps of a section, short commands of its items, and these items."""
    own = [item for item in items() if item.paper == title]
    short = [item.run for item in own if item.run.startswith("rotorid ")]
    return list(dict.fromkeys([*steps(dict(sections())[title]), *short])), own


def folder_of(command: str) -> str:
    words = shlex.split(command)
    return words[words.index("--out") + 1] if "--out" in words else ""


@cache
def written() -> dict[str, str]:
    """Folders and the commands that write them."""
    return {folder_of(command): command for _, part in sections() for command in steps(part) if folder_of(command)}


class Ran:
    """A folder that a command wrote, and what it printed."""

    def __init__(self, root: Path, run: str, log: Mapping[str, Json]) -> None:
        self.root, self.folder, self.log = root, root / run, log

    @property
    def printed(self) -> str:
        return str(self.log["stdout"])

    @property
    def seconds(self) -> float:
        return float(self.log["seconds"])

    @cached_property
    def document(self) -> Json:
        """The JSON file of the command: the result, or else the only document beside plans and logs."""
        for name in ("result", "response", "verification", "compare", "design", "delay", "simulation", "export"):
            if (self.folder / f"{name}.json").is_file():
                return self.json(f"{name}.json")
        raise AssertionError(f"no document in {self.folder}")

    def json(self, name: str) -> Json:
        return json.loads((self.folder / name).read_text(encoding="utf-8"))

    def text(self, name: str) -> str:
        return (self.folder / name).read_text(encoding="utf-8")

    def table(self, name: str) -> list[dict[str, str]]:
        """Rows of ``tables/NAME.csv``."""
        with (self.folder / "tables" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    def figure(self, name: str) -> Json:
        """What a figure shows: axes with labels, lines, bands and texts."""
        return self.log["figures"][str((self.folder / "figures" / f"{name}.pdf").relative_to(self.root))]

    def arrays(self, name: str = "responses.npz") -> Mapping[str, Any]:
        with np.load(self.folder / name) as file:
            return dict(file)

    @property
    def kinds(self) -> list[str]:
        return [finding["kind"] for finding in self.document["findings"]]

    def said(self, kind: str) -> str:
        """Message of the first finding of a kind, or nothing."""
        return next((str(one["message"]) for one in self.document["findings"] if one["kind"] == kind), "")


class Runs:
    """All commands of the page, run once each when they are first asked for."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.logs = root / "runs"
        self.logs.mkdir(parents=True, exist_ok=True)
        self.given: dict[str, Any] = {}
        self.done: set[str] = set()

    def __getitem__(self, run: str) -> Ran:
        """A folder (or one inside it), or a short command."""
        command = run if run.startswith("rotorid ") else written()[run.partition("/")[0]]
        log = self._log(command)
        assert not log.get("refused"), f"{command}: {log['refused']}"
        return Ran(self.root, "" if run.startswith("rotorid ") else run, log)

    def before(self, run: str) -> None:
        """Run what comes before and with a run on the page: all commands of its section up to its own."""
        command = run if run.startswith("rotorid ") else written().get(run.partition("/")[0], run)
        title = next(item.paper for item in items() if item.run == run)
        chosen = of_paper(title)[0]
        last = chosen.index(command) if command in chosen else len(chosen) - 1
        for step in chosen[: last + 1]:
            if step.startswith("rotorid "):
                self._log(step)
            elif step not in self.done:
                with contextlib.chdir(self.root):
                    exec(step, self.given)
                self.done.add(step)

    def json_of(self, command: str) -> Json:
        """What a command printed as JSON."""
        return json.loads(self[command].printed)

    def python(self, expression: str) -> Any:
        """The value of an expression after the blocks of Python of the page."""
        with contextlib.chdir(self.root):
            return eval(expression, self.given)

    def _log(self, command: str) -> Json:
        file = self.logs / f"{folder_of(command) or re.sub(r'[^a-z0-9]+', '-', command)}.json"
        if not file.is_file():
            file.write_text(json.dumps(self._ran(command)), encoding="utf-8")
        log = json.loads(file.read_text(encoding="utf-8"))
        assert log["command"] == command, f"{file} is of another command; delete the folder"
        return log

    def _ran(self, command: str) -> dict[str, Json]:
        import time

        from rotorid.cli.app import app

        began = time.process_time()
        with contextlib.chdir(self.root), drawn() as seen:
            ran = CliRunner().invoke(app, shlex.split(command)[1:], catch_exceptions=False)
            folder = Path(folder_of(command) or "nothing")
            figures = {
                str(file): seen[hashlib.sha256(file.read_bytes()).hexdigest()] for file in folder.rglob("figures/*.pdf")
            }
        seconds = time.process_time() - began
        refused = ran.output if ran.exit_code else ""
        return {"command": command, "refused": refused, "stdout": ran.stdout, "seconds": seconds, "figures": figures}


@contextlib.contextmanager
def drawn() -> Iterator[dict[str, Json]]:
    """What figures show that are written meanwhile, by the hash of their file."""
    from rotorid.plot import printed as room

    seen: dict[str, Json] = {}
    saved = room.saved

    def watched(canvas: Figure, kind: Any) -> bytes:
        file = saved(canvas, kind)
        seen[hashlib.sha256(file).hexdigest()] = [shown(cell) for cell in canvas.axes]
        return file

    with mock.patch.object(room, "saved", watched):
        yield seen


def shown(cell: Any) -> Json:
    """An axis as numbers: labels, curves and bands with their ranges, texts."""
    lines = [_curve(line.get_label(), *line.get_data()) for line in cell.get_lines()]
    areas = [part for one in cell.collections for part in one.get_paths()] + [one.get_path() for one in cell.patches]
    labels = [one.get_label() for one in (*cell.collections, *cell.patches)]
    return {
        "x": cell.get_xlabel(),
        "y": cell.get_ylabel(),
        "title": cell.get_title(),
        "lines": [line for line in lines if line["points"]],
        "bands": len(areas),
        "labels": sorted({str(label) for label in labels if not str(label).startswith("_")}),
        "texts": [text.get_text() for text in cell.texts],
    }


def _curve(label: object, x: Sequence[float], y: Sequence[float]) -> Json:
    try:
        points = np.array([x, y], dtype=float)
    except (TypeError, ValueError):
        return {"label": str(label), "points": len(x), "x": None, "y": None}
    seen = np.isfinite(points).all(axis=0)
    ends = [[float(one[seen].min()), float(one[seen].max())] if seen.any() else None for one in points]
    return {"label": str(label), "points": int(seen.sum()), "x": ends[0], "y": ends[1]}
