"""What each command answers of one log, by the question that it answers: two commands of one question must agree.

Every command runs once, as a person runs it. A question is asked in words such as ``roll loop: crossover, rad/s``; each
command that answers it gives an :class:`Answer`. :func:`contradictions` are the questions whose answers differ in the
digits that are printed.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import subprocess
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

DIGITS = 4
"""Significant digits of a number on a page."""

VERBS: Mapping[str, tuple[str, ...]] = {
    "inspect": (),
    "review": (),
    "identify": ("--model", "all"),
    "tune": (),
}
_AXES = {"p": "roll", "q": "pitch", "r": "yaw"}

Document: TypeAlias = Mapping[str, Any]


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What a command says to a question.

    Parameters
    ----------
    question
        In words.
    command
        Who says it.
    value
        A number, or words.
    """

    question: str
    command: str
    value: float | str

    @property
    def printed(self) -> str:
        """As it stands on a page."""
        return self.value if isinstance(self.value, str) else f"{self.value:.{DIGITS}g}"


@dataclass(frozen=True, kw_only=True)
class Ran:
    """What a command left: its exit code and its JSON, which is empty where it failed."""

    code: int
    document: Document


def run(words: Iterable[str], folder: Path) -> Ran:
    """A command in a process of its own, in a folder."""
    done = subprocess.run(
        [sys.executable, "-m", "rotorid", *words],
        cwd=folder,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    return Ran(code=done.returncode, document=json.loads(done.stdout) if done.stdout.lstrip().startswith("{") else {})


def run_all(log: Path, folder: Path, *further: str) -> dict[str, Ran]:
    """Every verb of :data:`VERBS` on a log, and ``response`` of each axis that ``inspect`` can identify."""
    ran = {
        verb: run([verb, str(log), *further, *words, "--json", *_out(verb)], folder) for verb, words in VERBS.items()
    }
    supports = ran["inspect"].document.get("supports", {})
    for rate, axis in _AXES.items():
        if supports.get(f"rate.{axis}", {}).get("possible"):
            words = ["response", str(log), *further, "--inputs", f"{axis}_command", "--outputs", rate, "--json"]
            ran[f"response {axis}"] = run([*words, *_out(f"response-{axis}")], folder)
    return ran


def _out(name: str) -> list[str]:
    return [] if name == "inspect" else ["--out", f"out-{name}"]


def answers(ran: Mapping[str, Ran]) -> list[Answer]:
    """All that the commands answer, command by command."""
    found: list[Answer] = []
    for name, result in ran.items():
        verb = name.partition(" ")[0]
        found += (
            Answer(question=question, command=name, value=value) for question, value in _READ[verb](result.document)
        )
    return found


def contradictions(found: Iterable[Answer]) -> dict[str, dict[str, str]]:
    """Questions that commands answer differently, with their answers as printed."""
    by_question: dict[str, dict[str, str]] = defaultdict(dict)
    for answer in found:
        by_question[answer.question][answer.command] = answer.printed
    return {question: given for question, given in by_question.items() if len(set(given.values())) > 1}


def next_commands(ran: Mapping[str, Ran]) -> list[list[str]]:
    """The commands that the review proposes, as words; those that plan a flight leave their files."""
    return [shlex.split(line)[1:] for line in ran["review"].document.get("next_commands", ())]


_Pairs: TypeAlias = Iterator[tuple[str, float | str]]


def _flights(document: Document) -> _Pairs:
    if "flights" in document:
        yield "number of flights", float(len(document["flights"]))
    for number, flight in enumerate(document.get("flights", ()), start=1):
        yield f"flight {number}: start, s", flight["start_s"]
        yield f"flight {number}: stop, s", flight["stop_s"]


def _parameters(result: Document) -> _Pairs:
    for name, parameter in result.get("parameters", {}).items():
        if parameter["value"] is not None:
            yield f"{result['model']}: {name}", parameter["value"]
            yield f"{result['model']}: {name} std", parameter["std"] if parameter["std"] is not None else "none"


def _inspect(document: Document) -> _Pairs:
    yield from _flights(document)
    for model, support in document.get("supports", {}).items():
        yield f"{model}: supported", str(support["possible"])


def _review(document: Document) -> _Pairs:
    yield from _flights(document)
    for model, result in document.get("models", {}).items():
        yield f"{model}: supported", str(bool(result.get("parameters")))
        yield from _parameters(result)
    for axis, margins in document.get("margins", {}).items():
        yield from _margins(axis, margins)


def _identify(document: Document) -> _Pairs:
    for result in document.get("results", [document] if "model" in document else []):
        yield f"{result['model']}: supported", str(bool(result.get("parameters")))
        yield from _parameters(result)


def _tune(document: Document) -> _Pairs:
    for axis, tuned in document.get("axes", {}).items():
        yield from _margins(axis, tuned.get("flown") or {})


_MARGINS = {
    "crossover_rad_s": "crossover, rad/s",
    "phase_margin_deg": "phase margin, deg",
    "gain_margin_db": "gain margin, dB",
    "delay_margin_s": "delay margin, s",
    "sensitivity_peak": "sensitivity peak",
    "disturbance_rejection_rad_s": "rejection bandwidth, rad/s",
    "rejection_bandwidth_rad_s": "rejection bandwidth, rad/s",
}


def _margins(axis: str, margins: Document) -> _Pairs:
    for key, words in _MARGINS.items():
        if isinstance(margins.get(key), dict) and margins[key]["value"] is not None:
            yield f"{axis} rate loop: {words}", margins[key]["value"]


_OF_RESPONSE: Mapping[str, tuple[str, Callable[[float], float]]] = {
    "crossover_rad_s": ("crossover, rad/s", float),
    "phase_margin_rad": ("phase margin, deg", math.degrees),
    "gain_margin_up": ("gain margin, dB", lambda factor: 20.0 * math.log10(factor)),
    "delay_margin_s": ("delay margin, s", float),
    "disturbance_rejection_bandwidth_rad_s": ("rejection bandwidth, rad/s", float),
}


def _response(document: Document) -> _Pairs:
    for axis, loop in document.get("loops", {}).items():
        numbers = {**(loop.get("beyond") or {}).get("numbers", {}), **loop["numbers"]}
        for key, (words, converted) in _OF_RESPONSE.items():
            if key in numbers:
                yield f"{axis} rate loop: {words}", converted(numbers[key]["value"])


_READ: Mapping[str, Callable[[Document], _Pairs]] = {
    "inspect": _inspect,
    "review": _review,
    "identify": _identify,
    "tune": _tune,
    "response": _response,
}
