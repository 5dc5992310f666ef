"""Calls of tools: what each may choose, as a schema, and the words of the command line that does it.

Nothing but these words is carried out, so a tool computes, refuses and writes what the command does. A choice that
names a place is a path inside the folders; all others are names, numbers and words of a list, which cannot lead to a
file or pass for an option.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from rotorid.errors import UsageError, unknown_name
from rotorid.lab.steps import Model, Name, Number, Segment, first_wrong
from rotorid.mcp.folders import MAINS, Folders

MOST_LOGS = 20
"""Logs or results that one call may name."""

_PLACE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_+-]*(\.[A-Za-z0-9_+-]+)*")


def _is_printable(text: str) -> str:
    if not text.isprintable():
        raise ValueError("the path has a sign that is no letter")
    return text


def _is_place(text: str) -> str:
    if not _PLACE.fullmatch(text):
        raise ValueError("use letters, digits, -, _ and dots between them")
    return text


Place: TypeAlias = Annotated[str, Field(min_length=1, max_length=1024), AfterValidator(_is_printable)]
Paths: TypeAlias = Annotated[tuple[Place, ...], Field(min_length=1, max_length=MOST_LOGS)]
FolderName: TypeAlias = Annotated[str, Field(min_length=1, max_length=60), AfterValidator(_is_place)]
Axis: TypeAlias = Literal["roll", "pitch", "yaw", "velocity", "climb"]


class Call(BaseModel):
    """Choices of a tool; what was not chosen is left to the command's defaults."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    about: ClassVar[str] = ""
    """What the tool does, for who chooses among tools."""


class FilesCall(Call):
    """No choices."""

    about = "List the logs inside the folders, and the folders of earlier results."


class DetailsCall(Call):
    """A part of a result."""

    about = "Show a part of a result that an answer left out, by its key, such as axes.roll.path."
    result: Annotated[Place, Field(description="Folder of the result.")]
    key: Annotated[str, Field(max_length=300, description="Keys and places in lists, with dots between them.")] = ""


class PictureCall(Call):
    """A picture of a result."""

    about = "Show a picture of a result that was made with pictures=true; without a name, list them."
    result: Annotated[Place, Field(description="Folder of the result.")]
    name: Annotated[str | None, Field(max_length=200, description="One of those listed.")] = None


class _OfLogs(Call):
    map: Annotated[Place | None, Field(description="TOML file that names the channels of a foreign table.")] = None


class _Written(Call):
    out: Annotated[FolderName | None, Field(description="Name of the folder for the results.")] = None


class InspectCall(_OfLogs):
    """Choices of inspect."""

    about = "List what is in a log, which models it supports, and what to fly or log for the rest. Takes seconds."
    log: Annotated[Place, Field(description="A log.")]


class ReviewCall(_OfLogs, _Written):
    """Choices of review."""

    about = (
        "Analyze an ordinary flight: tracking, margins, noise, motors, battery, models, and what was not measured. "
        "Each answer has the spans of the log that show it. Takes up to some minutes."
    )
    log: Annotated[Place, Field(description="A log.")]
    models: Annotated[bool, Field(description="Identify models too; the longest part.")] = True
    mass_kg: Annotated[Number | None, Field(gt=0.0, description="Mass in flight: thrust in newtons.")] = None
    pictures: bool = False


class IdentifyCall(_OfLogs, _Written):
    """Choices of identify."""

    about = "Identify models from logs: parameters with intervals, verdicts, and checks on unseen maneuvers."
    logs: Annotated[Paths, Field(description="Logs to fit.")]
    models: Annotated[
        tuple[Model | Literal["all"], ...],
        Field(max_length=20, description="Models, such as rate.roll; inspect lists those that the log supports."),
    ] = ()
    model_file: Annotated[Place | None, Field(description="TOML file of a model, in place of models.")] = None
    verify: Annotated[tuple[Place, ...], Field(max_length=MOST_LOGS, description="Logs to validate on.")] = ()
    segments: Annotated[tuple[Segment, ...], Field(max_length=50, description="Excitations, if not all.")] = ()
    inputs: Annotated[tuple[Name, ...], Field(max_length=12)] = ()
    outputs: Annotated[tuple[Name, ...], Field(max_length=12)] = ()
    fix: Annotated[dict[Name, Number], Field(max_length=30, description="Parameters to fix.")] = Field(
        default_factory=dict
    )
    band_rad_s: tuple[Number, Number] | None = None
    reduce: Annotated[bool, Field(description="Drop parameters that the data do not need.")] = False
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0
    pictures: bool = False


class TuneCall(_OfLogs, _Written):
    """Choices of tune."""

    about = (
        "Propose gains from logs or results, with files to load and to go back; or judge given gains. "
        "The verdict is fly, gently, do_not_fly or not_enough_data. A person decides what is flown."
    )
    given: Annotated[Paths, Field(description="Logs with the flown gains, results of identify, or both.")]
    judge: Annotated[Place | None, Field(description="File of gains to judge.")] = None
    judge_text: Annotated[
        str | None, Field(max_length=4000, description="Gains to judge, a line each: roll: P=0.1 D=0.002.")
    ] = None
    axes: Annotated[tuple[Axis, ...], Field(max_length=5)] = ()
    robustness: Annotated[Number | None, Field(description="Largest peak sensitivity M_s; 1.7 by default.")] = None
    noise: Annotated[Number | None, Field(description="Largest noise of commands, relative to today's.")] = None
    keep: Annotated[tuple[Literal["P", "I", "D", "A"], ...], Field(max_length=4)] = ()


class VerifyCall(_OfLogs, _Written):
    """Choices of verify."""

    about = "Check how well a model predicts logs that it was not fitted to."
    result: Annotated[Place, Field(description="Folder of a result of identify.")]
    logs: Annotated[Paths, Field(description="Other logs.")]
    pictures: bool = False


class ExportCall(_Written):
    """Choices of export."""

    about = "Write a model for a simulator or tool; the answer lists what is kept, approximated and lost."
    results: Annotated[Paths, Field(description="Folders of results of identify, of one vehicle.")]
    to: Annotated[str, Field(max_length=40, pattern="^[a-z][a-z0-9-]*$", description="Such as px4-sih, mujoco, json.")]
    values: Annotated[
        dict[Name, Number], Field(max_length=30, description="What the results do not contain, such as m.")
    ] = Field(default_factory=dict)
    layout: Annotated[str | None, Field(max_length=40, pattern=r"^[a-z][a-z0-9_]*(\.[a-z0-9_]+)*$")] = None
    draws: Annotated[int, Field(ge=0, le=1000, description="Vehicles drawn from the covariance.")] = 0
    seed: Annotated[int, Field(ge=0, lt=2**32)] = 0


TOOLS: Mapping[str, type[Call]] = {
    "files": FilesCall,
    "inspect": InspectCall,
    "review": ReviewCall,
    "identify": IdentifyCall,
    "tune": TuneCall,
    "verify": VerifyCall,
    "export": ExportCall,
    "details": DetailsCall,
    "picture": PictureCall,
}
"""Tools by name."""


def parse_call(tool: str, arguments: Mapping[str, Any]) -> Call:
    """The choices of a call.

    Raises
    ------
    UsageError
        There is no such tool, or a choice is wrong.

    Examples
    --------
    >>> parse_call("inspect", {"log": "flight.ulg"}).log
    'flight.ulg'
    """
    if tool not in TOOLS:
        raise unknown_name("tool", tool[:80], TOOLS)
    try:
        return TOOLS[tool].model_validate(arguments)
    except ValidationError as error:
        first = error.errors()[0]
        if first["type"] == "extra_forbidden" and len(first["loc"]) == 1:
            choices = TOOLS[tool].model_fields
            if not choices:
                raise UsageError(f"{tool} takes no choices", remedy="call it without") from None
            raise unknown_name(f"choice of {tool}", str(first["loc"][0])[:80], choices) from None
        raise UsageError(f"{tool}: {first_wrong([first])}"[:500]) from None
    except RecursionError:
        raise UsageError(f"{tool}: the choices are nested too deeply") from None


class Command(BaseModel):
    """A command to carry out.

    Parameters
    ----------
    words
        Behind ``rotorid``, with whole paths.
    logs, results
        What the answer is about: logs, and results whose maneuvers are its evidence.
    out
        The folder of its results, or none.
    gains
        Text of a file ``gains.txt`` that the command reads in its own folder.
    """

    model_config = ConfigDict(frozen=True)
    words: tuple[str, ...]
    logs: tuple[Path, ...] = ()
    results: tuple[Path, ...] = ()
    out: Path | None = None
    gains: str | None = None


def command_of(call: Call, folders: Folders) -> Command:
    """The command line of a call.

    Raises
    ------
    UsageError
        A place is outside the folders or does not exist, or choices exclude each other.
    """
    return _COMMANDS[type(call)](call, folders)


def _inspect(call: InspectCall, folders: Folders) -> Command:
    log = folders.find(call.log)
    return Command(words=("inspect", str(log), *_mapping(call, folders)), logs=(log,))


def _review(call: ReviewCall, folders: Folders) -> Command:
    log = folders.find(call.log)
    out = _place(call.out, folders, log, "review")
    words = ["review", str(log), "--brief", *_mapping(call, folders), *([] if call.models else ["--no-models"])]
    words += [] if call.mass_kg is None else ["--set", f"m={call.mass_kg:.12g}"]
    return Command(words=(*words, *_pictures(call.pictures)), logs=(log,), out=out)


def _identify(call: IdentifyCall, folders: Folders) -> Command:
    if bool(call.models) == (call.model_file is not None):
        raise UsageError("identify needs either models or model_file", remedy="inspect lists what the log supports")
    logs = _found(call.logs, folders)
    what = "models" if call.model_file is not None or len(call.models) > 1 else call.models[0]
    out = _place(call.out, folders, logs[0], re.sub(r"[^A-Za-z0-9.]+", "-", what))
    model = ",".join(call.models) if call.model_file is None else str(folders.find(call.model_file, "file"))
    words = ["identify", *map(str, logs), "--model", model, *_mapping(call, folders)]
    unseen = _found(call.verify, folders)
    words += [word for log in unseen for word in ("--verify", str(log))]
    for segment in call.segments:
        words += ["--segment", f"{segment.axis}:{segment.start_s:.12g}:{segment.stop_s:.12g}"]
    words += ["--inputs", ",".join(call.inputs)] if call.inputs else []
    words += ["--outputs", ",".join(call.outputs)] if call.outputs else []
    words += _assignments("--fix", call.fix)
    words += [] if call.band_rad_s is None else ["--band", "{:.12g}:{:.12g}".format(*call.band_rad_s)]
    words += ["--reduce"] if call.reduce else []
    words += ["--seed", str(call.seed), *_pictures(call.pictures)]
    return Command(words=tuple(words), logs=(*logs, *unseen), out=out)


def _tune(call: TuneCall, folders: Folders) -> Command:
    if call.judge is not None and call.judge_text is not None:
        raise UsageError("judge and judge_text exclude each other", remedy="give one of them")
    given = _found(call.given, folders)
    results = tuple(path for path in given if _is_result(path))
    judging = call.judge is not None or call.judge_text is not None
    out = _place(call.out, folders, given[0], "judged" if judging else "tune")
    words = ["tune", *map(str, given), *_mapping(call, folders)]
    words += [] if call.judge is None else ["--judge", str(folders.find(call.judge, "file"))]
    words += [] if call.judge_text is None else ["--judge", "gains.txt"]
    words += ["--axes", ",".join(call.axes)] if call.axes else []
    words += [] if call.robustness is None else ["--robustness", f"{call.robustness:.12g}"]
    words += [] if call.noise is None else ["--noise", f"{call.noise:.12g}"]
    words += ["--keep", ",".join(call.keep)] if call.keep else []
    logs = tuple(path for path in given if path not in results)
    return Command(words=tuple(words), logs=logs, results=results, out=out, gains=call.judge_text)


def _verify(call: VerifyCall, folders: Folders) -> Command:
    result, logs = folders.find(call.result), _found(call.logs, folders)
    out = _place(call.out, folders, logs[0], "verify")
    words = ("verify", str(result), *map(str, logs), *_mapping(call, folders), *_pictures(call.pictures))
    return Command(words=words, logs=logs, out=out)


def _export(call: ExportCall, folders: Folders) -> Command:
    results = _found(call.results, folders)
    out = _place(call.out, folders, results[0], f"export-{call.to}")
    words = ["export", *map(str, results), "--to", call.to, *_assignments("--set", call.values)]
    words += [] if call.layout is None else ["--layout", call.layout]
    words += ["--draws", str(call.draws)] if call.draws else []
    return Command(words=(*words, "--seed", str(call.seed)), results=results, out=out)


_COMMANDS: Mapping[type[Call], Callable[[Any, Folders], Command]] = {
    InspectCall: _inspect,
    ReviewCall: _review,
    IdentifyCall: _identify,
    TuneCall: _tune,
    VerifyCall: _verify,
    ExportCall: _export,
}


def _found(names: Sequence[str], folders: Folders) -> tuple[Path, ...]:
    return tuple(folders.find(name) for name in names)


def _mapping(call: _OfLogs, folders: Folders) -> list[str]:
    return [] if call.map is None else ["--map", str(folders.find(call.map, "file"))]


def _pictures(wanted: bool) -> list[str]:
    return ["--figures", "png"] if wanted else []


def _assignments(option: str, values: Mapping[str, float]) -> list[str]:
    return [word for name, value in values.items() for word in (option, f"{name}={value:.12g}")]


def _is_result(path: Path) -> bool:
    folder = path if path.is_dir() else path.parent
    return (path.is_dir() or path.name in MAINS) and any((folder / main).is_file() for main in MAINS)


def _place(name: str | None, folders: Folders, subject: Path, verb: str) -> Path:
    """Where results go: a new folder of that name, or one that is called after the log; older results stay.

    Raises
    ------
    UsageError
        There is such a folder.
    """
    if name is not None:
        if not folders.is_free(place := folders.new(name)):
            raise UsageError(f"there is a folder {name!r} already", remedy="give another name for out, or none")
        return place
    stem = re.sub(r"[^A-Za-z0-9_+-]+", "-", subject.name.partition(".")[0]).strip("-")[:40] or "log"
    names = itertools.chain([f"{stem}-{verb}"], (f"{stem}-{verb}-{number}" for number in itertools.count(2)))
    return next(place for place in map(folders.new, names) if folders.is_free(place))
