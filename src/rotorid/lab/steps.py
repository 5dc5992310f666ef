"""Steps: what was chosen on the page, as the words of a command line, and as a project file that repeats them.

A step names its logs and the earlier steps whose results it takes; :func:`arguments` makes the command line of it, and
nothing else does. A page, a project file and a hand at the terminal thus compute the same.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, model_validator

from rotorid.errors import UsageError
from rotorid.io.documents import parse_toml, read_text, toml_text

SCHEMA: Final = "rotorid.project/1"
_NEEDED = "a project file of rotorid lab"

MOST_STEPS = 100
"""Steps that a project may have."""


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,60}")
_MODEL = re.compile(r"[a-z_]{1,30}[.:][A-Za-z0-9_./]{1,60}")


def _matching(form: re.Pattern[str], needed: str) -> AfterValidator:
    """Texts of a form, refused in words."""

    def checked(text: str) -> str:
        if not form.fullmatch(text):
            raise ValueError(f"{text[:80]!r} is not {needed}")
        return text

    return AfterValidator(checked)


Name = Annotated[str, _matching(_NAME, "a name of letters, digits and _, such as p or motor_1")]
Model = Annotated[str, _matching(_MODEL, "a model of the list, such as rate.roll or hover.full")]
Number = Annotated[float, Field(allow_inf_nan=False)]


class Segment(BaseModel):
    """An interval of a log on its own clock, in seconds, and the axis that was excited in it."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    axis: Literal["roll", "pitch", "yaw", "thrust"]
    start_s: Number
    stop_s: Number


class Step(BaseModel):
    """A command with its choices: those that were not made are left to the command's defaults.

    ``logs`` are numbers of logs, ``verify`` of logs kept unseen, ``results`` of earlier steps; all count from one.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    verb: Literal["review", "response", "identify", "verify", "tune", "export"]
    logs: tuple[int, ...] = Field(default=(), max_length=20)
    verify: tuple[int, ...] = Field(default=(), max_length=20)
    results: tuple[int, ...] = Field(default=(), max_length=20)
    models: tuple[Model, ...] = Field(default=(), max_length=20)
    segments: tuple[Segment, ...] = Field(default=(), max_length=50)
    inputs: tuple[Name, ...] = Field(default=(), max_length=12)
    outputs: tuple[Name, ...] = Field(default=(), max_length=12)
    instrument: tuple[Name, ...] = Field(default=(), max_length=12)
    band_rad_s: tuple[Number, Number] | None = None
    reduce: bool = False
    method: Literal["auto", "frequency", "output_error", "prediction_error", "equation_error"] = "auto"
    robustness: Number | None = None
    noise: Number | None = None
    keep: tuple[Literal["P", "I", "D", "A"], ...] = ()
    to: Literal[
        "px4-sih",
        "ardupilot",
        "gazebo",
        "mujoco",
        "rotorpy",
        "urdf",
        "rl-tools",
        "crazyflow",
        "pyflyt",
        "aerial-gym",
        "flightmare",
        "allocation",
        "matlab",
        "control",
        "fmu",
        "json",
    ] = "json"
    values: dict[Name, Number] = Field(default_factory=dict, max_length=30)

    @model_validator(mode="after")
    def _require(self) -> Step:
        for name in self.models:
            if name.endswith((".toml", "/")) or ".." in name:
                raise ValueError(f"{name} is a file, not a model of the list")
        if self.band_rad_s is not None and not self.band_rad_s[0] < self.band_rad_s[1]:
            raise ValueError("the upper end of the band must be above the lower one")
        return self


def arguments(step: Step, logs: Sequence[str], results: Sequence[str]) -> list[str]:
    """Words of the command line behind ``rotorid``, without where the results go.

    Parameters
    ----------
    step
        What was chosen.
    logs
        Paths of all logs, by number.
    results
        Folders of all earlier steps, by number.

    Raises
    ------
    UsageError
        A log or a step does not exist, or the verb needs one more choice.

    Examples
    --------
    >>> step = Step(verb="identify", logs=(1,), models=("rate.roll",), band_rad_s=(1.0, 40.0))
    >>> arguments(step, ["a.ulg"], [])
    ['identify', 'a.ulg', '--model', 'rate.roll', '--band', '1:40']
    """
    words: list[str] = [step.verb]
    words += [_of(results, number, "step") for number in step.results]
    words += [_of(logs, number, "log") for number in step.logs]
    if len(words) == 1:
        raise UsageError(f"{step.verb} needs a log or a result")
    if step.verb == "identify":
        if not step.models:
            raise UsageError("identify needs a model", remedy="choose one of the list")
        words += ["--model", ",".join(step.models)]
        words += [word for number in step.verify for word in ("--verify", _of(logs, number, "log"))]
        words += ["--reduce"] if step.reduce else []
        words += ["--method", step.method] if step.method != "auto" else []
    if step.verb in ("identify", "response"):
        for segment in step.segments:
            words += ["--segment", f"{segment.axis}:{segment.start_s:.12g}:{segment.stop_s:.12g}"]
        for option in ("inputs", "outputs", "instrument"):
            if names := getattr(step, option):
                words += [f"--{option}", ",".join(names)]
        if step.band_rad_s is not None:
            words += ["--band", "{:.12g}:{:.12g}".format(*step.band_rad_s)]
    if step.verb == "tune":
        for option in ("robustness", "noise"):
            if (value := getattr(step, option)) is not None:
                words += [f"--{option}", f"{value:.12g}"]
        if step.keep:
            words += ["--keep", ",".join(step.keep)]
    if step.verb == "export":
        words += ["--to", step.to]
    if step.verb in ("tune", "export"):
        words += [word for name, value in step.values.items() for word in ("--set", f"{name}={value:.12g}")]
    return words


def _of(paths: Sequence[str], number: int, what: str) -> str:
    if not 1 <= number <= len(paths) or not paths[number - 1]:
        raise UsageError(f"there is no {what} {number}")
    path = paths[number - 1]
    # A command would take it for an option.
    return f"./{path}" if path.startswith("-") else path


def first_wrong(errors: Sequence[Any]) -> str:
    """The first thing that pydantic found wrong, in words that name the field."""
    first = errors[0]
    field = ".".join(str(part) for part in first["loc"] if part not in ("body", "query", "path"))
    message = first["msg"].removeprefix("Value error, ")
    given = first.get("input")
    value_words = f", not {given!r}"[:100] if isinstance(given, str | int | float) and message == first["msg"] else ""
    return f"{field or 'the file'}: {message}{value_words}"


class Project(BaseModel):
    """``rotorid.toml``: logs as paths relative to the file, and steps in order."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    schema_name: Literal["rotorid.project/1"] = Field(default=SCHEMA, alias="schema")
    logs: tuple[Annotated[str, Field(min_length=1, max_length=4096)], ...] = Field(max_length=100)
    steps: tuple[Step, ...] = Field(default=(), max_length=MOST_STEPS)


def project_text(project: Project) -> str:
    """A project as TOML.

    Examples
    --------
    >>> print(project_text(Project(logs=["a.ulg"], steps=[Step(verb="review", logs=(1,))])))
    schema = "rotorid.project/1"
    logs = ["a.ulg"]
    <BLANKLINE>
    [[steps]]
    verb = "review"
    logs = [1]
    <BLANKLINE>
    """
    lines = [f"schema = {_toml(SCHEMA)}", f"logs = {_toml(list(project.logs))}", ""]
    for step in project.steps:
        chosen = step.model_dump(exclude_defaults=True)
        lines += ["[[steps]]", *(f"{name} = {_toml(value)}" for name, value in chosen.items()), ""]
    return "\n".join(lines)


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name} = {_toml(item)}" for name, item in value.items()) + " }"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(item) for item in value)}]"
    if isinstance(value, str):
        return toml_text(value)
    return repr(value)


def read_project(path: Path) -> Project:
    """A project file.

    Raises
    ------
    UsageError
        It cannot be read, or holds something else.
    """
    try:
        return Project.model_validate(parse_toml(read_text(path, needed=_NEEDED)))
    except ValidationError as error:
        wrong = first_wrong(error.errors())
        raise UsageError(f"{path.name}: {wrong}", needed=_NEEDED) from None
    except ValueError as error:
        raise UsageError(f"{path.name} cannot be read: {' '.join(str(error).split())}", needed=_NEEDED) from None
