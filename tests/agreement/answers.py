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
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

DIGITS = 4
"""Significant digits of a number on a page."""

LOG, RESULTS = "{log}", "{results}"
VERBS: Mapping[str, tuple[str, ...]] = {
    "inspect": ("inspect", LOG),
    "review": ("review", LOG),
    "identify": ("identify", LOG, "--model", "all"),
    "tune": ("tune", LOG),
    "tune results": ("tune", RESULTS),
    "tune both": ("tune", LOG, RESULTS),
    "fleet": ("fleet", LOG),
}
"""Name of a command to its words, with places of the log and of the folder in which ``identify`` left its results."""

RATES = {"p": "roll", "q": "pitch", "r": "yaw"}

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
    """Every command of :data:`VERBS` on a log, and ``response`` of each axis that was excited on purpose.

    Commands that need results run only where ``identify`` left some.
    """
    ran: dict[str, Ran] = {}
    for name, words in VERBS.items():
        if RESULTS not in words or ran["identify"].code == 0:
            ran[name] = run([*_filled(words, log), *further, "--json", *_out(name)], folder)
    ran["fleet"] = replace(ran["fleet"], document={**ran["fleet"].document, "rows": _rows(folder / _folder("fleet"))})
    excited = {one["axis"] for one in ran["inspect"].document.get("excitations", ())}
    supports = ran["inspect"].document.get("supports", {})
    for rate, axis in RATES.items():
        if axis in excited and supports.get(f"rate.{axis}", {}).get("possible"):
            words = ("response", LOG, "--inputs", f"{axis}_command", "--outputs", rate)
            name = f"response {axis}"
            ran[name] = run([*_filled(words, log), *further, "--json", *_out(name)], folder)
    return ran


def _filled(words: Iterable[str], log: Path) -> list[str]:
    places = {LOG: str(log), RESULTS: _folder("identify")}
    return [places.get(word, word) for word in words]


def _folder(name: str) -> str:
    return f"out-{name.replace(' ', '-')}"


def _out(name: str) -> list[str]:
    return [] if name == "inspect" else ["--out", _folder(name)]


def _rows(folder: Path) -> list[dict[str, Any]]:
    """Rows of the table of a fleet; none where it wrote no table."""
    from pyarrow import parquet

    table = folder / "fleet.parquet"
    return list(parquet.read_table(table).to_pylist()) if table.exists() else []


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
    """The commands that ``inspect`` and ``review`` propose, as words, in their order: a plan takes what came before."""
    proposed = [line for verb in ("inspect", "review") for line in ran[verb].document.get("next_commands", ())]
    return [shlex.split(line)[1:] for line in dict.fromkeys(proposed)]


def bold_cards(ran: Mapping[str, Ran]) -> list[str]:
    """Titles of green cards of a review that do not say everything was measured."""
    cards = ran["review"].document.get("cards", ())
    return [card["title"] for card in cards if card["color"] == "green" and "Not measured" in card["sentence"]]


def bold_verdicts(ran: Mapping[str, Ran]) -> list[str]:
    """Models that are called good beside a structure that does not fit."""
    results = ran["identify"].document.get("results", ())
    return [
        one["model"]
        for one in results
        if any(finding["kind"] == "structure_error" for finding in one["findings"])
        and (one.get("verdict") or {}).get("color") == "green"
    ]


_Pairs: TypeAlias = Iterator[tuple[str, float | str]]


def _flights(document: Document) -> _Pairs:
    if "flights" in document:
        yield "number of flights", float(len(document["flights"]))
    for number, flight in enumerate(document.get("flights", ()), start=1):
        yield f"flight {number}: start, s", flight["start_s"]
        yield f"flight {number}: stop, s", flight["stop_s"]


def _log(document: Document) -> _Pairs:
    """What every document says of the log itself."""
    yield from _remarks(document.get("findings", ()), "log")
    for key in ("autopilot", "battery"):
        found = document.get(key)
        if isinstance(found, str):
            yield key, found
    for key, volts in (document.get("battery") or {}).items():
        yield f"battery: {key}", volts["value"] if isinstance(volts, dict) else volts


def _remarks(findings: Iterable[Document], of: str) -> _Pairs:
    """Numbers of the findings of a log, or of a model of it."""
    for one in findings:
        for name, number in one["numbers"].items():
            yield f"{of}: {one['kind']} of {one['where']}: {name}", number


def _parameters(result: Document) -> _Pairs:
    for name, parameter in result.get("parameters", {}).items():
        if parameter["value"] is not None:
            yield f"{result['model']}: {name}", parameter["value"]
            yield f"{result['model']}: {name} std", parameter["std"] if parameter["std"] is not None else "none"


_TRIED = frozenset({"poor_fit", "structure_error", "not_identifiable", "impossible_physics"})
"""Findings of a fit that was made and refused: the log supports its model, and no parameters came of it."""


def _model(result: Document) -> _Pairs:
    """A model that was identified, or refused."""
    model = result["model"]
    refused_by = {one["kind"] for one in result.get("findings", ()) if one["severity"] == "error"}
    yield f"{model}: identified", str(bool(result.get("parameters")))
    yield f"{model}: supported", str(bool(result.get("parameters")) or not refused_by.isdisjoint(_TRIED))
    if verdict := result.get("verdict"):
        yield f"{model}: verdict", f"{verdict['word']}, {verdict['color']}"
    yield from _parameters(result)
    yield from _remarks(result.get("findings", ()), model)
    provenance = result.get("provenance") or {}
    if result.get("parameters") and model.startswith("rate."):
        yield f"{model}: instruments", ", ".join(provenance["instruments"])
        for number, one in enumerate(provenance["maneuvers"], start=1):
            yield f"{model}: maneuver {number}", f"{one['kind']} {one['start_s']:.2f} to {one['stop_s']:.2f} s"
    controller = result.get("controller") or {}
    if controller:
        yield "firmware that flew", controller["firmware"]
    for name, value in (controller.get("gains") or {}).items():
        yield f"gain {name}", value


def _inspect(document: Document) -> _Pairs:
    yield from _flights(document)
    yield from _log(document)
    for model, support in document.get("supports", {}).items():
        yield f"{model}: supported", str(support["possible"])
    for name, value in document.get("settings", {}).items():
        if name.startswith(("MC_", "ATC_")):
            yield f"gain {name}", value


def _review(document: Document) -> _Pairs:
    yield from _flights(document)
    yield from _log(document)
    for model, result in document.get("models", {}).items():
        yield from _model({"model": model, **result})
    for axis, margins in document.get("margins", {}).items():
        yield from _margins(axis, margins)
    numbers = (document.get("motors") or {}).get("numbers", {})
    for end, name in (("low", "lower"), ("high", "upper")):
        if f"saturated_{end}_share" in numbers:
            yield f"log: saturation of motors: {name}_share", numbers[f"saturated_{end}_share"]["value"]


def _identify(document: Document) -> _Pairs:
    yield from _log(document)
    for result in document.get("results", [document] if "model" in document else []):
        yield from _model(result)


def _tune(document: Document) -> _Pairs:
    if document.get("axes"):
        yield from _log(document)
        yield "firmware that flew", document["firmware"]
    for axis in RATES.values():
        yield f"{axis}: gains proposed", str(axis in document.get("axes", {}))
    for axis, tuned in document.get("axes", {}).items():
        yield from _margins(axis, tuned.get("flown") or {})
        yield f"{axis}: filters", ", ".join(one["name"] for one in tuned["filters"])
        for name, gain in tuned["gains"].items():
            yield f"gain {name}", gain["flown"]
            yield f"proposed gain {name}", gain["proposed"]
        for key, one in (tuned.get("proposed") or {}).items():
            yield f"{axis} rate loop as proposed: {key}", one["value"]


def _fleet(document: Document) -> _Pairs:
    """Rows of its table are estimates of one flight; a mean over one flight is its value."""
    rows = document.get("rows", ())
    if len({row["flight"] for row in rows}) > 1:
        # Numbered flights of one log are identified one by one; other commands take them together.
        return
    for row in rows:
        yield f"{row['model']}: {row['parameter']}", row["value"]
        yield f"{row['model']}: {row['parameter']} std", row["std"] if row["std"] is not None else "none"
    for model in sorted({row["model"] for row in rows}):
        yield f"{model}: identified", "True"
    for model, parameters in document.get("population", {}).items():
        for name, found in parameters.items():
            yield f"{model}: {name}", found["mean"]["value"]
    for refused in document.get("failed", ()):
        if refused.get("model"):
            yield f"{refused['model']}: identified", "False"


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
    "disturbance_rejection_peak": ("sensitivity peak", float),
}


def _response(document: Document) -> _Pairs:
    yield from _log({key: value for key, value in document.items() if key != "findings"})
    axes = [name.removesuffix("_command") for name in document.get("inputs", ())]
    if document.get("outputs") and len(axes) == 1:
        yield from _remarks(document["findings"], f"rate.{axes[0]}")
        yield f"rate.{axes[0]}: instruments", ", ".join(document["instruments"])
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
    "fleet": _fleet,
    "response": _response,
}
