"""Predictions of anybody: a CSV file, or a Python function that is given what a model may know.

A function gets one flight at a time and the flights that it may learn from, as :class:`LoadsTask` or
:class:`StepsTask`, and returns an array. What it must predict is not among its arguments. A file is checked before
anything is computed: columns, rows of each flight, and that every value is a finite number.
"""

from __future__ import annotations

import csv
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from rotorid.data.display import cut, listed
from rotorid.errors import LogError, RotoridError, UsageError
from rotorid.io.documents import require_file
from rotorid.typing import AnyArray, FloatArray


class LoadsTask(NamedTuple):
    """A flight whose force and moment are predicted, body axes forward, right, down.

    Parameters
    ----------
    name
        Of the flight.
    time_s
        From its first sample, shape ``(n,)``.
    motors
        Speeds of the rotors in rad/s, in the order of the file, shape ``(rotors, n)``.
    velocity, rates
        m/s and rad/s, shape ``(3, n)``.
    attitude
        Roll, pitch and heading in rad, shape ``(3, n)``.
    force, moment
        Mass times specific force, N, and moment, N m, shape ``(3, n)``; empty in a flight to predict.
    """

    name: str
    time_s: FloatArray
    motors: FloatArray
    velocity: FloatArray
    rates: FloatArray
    attitude: FloatArray
    force: FloatArray
    moment: FloatArray


class StepsTask(NamedTuple):
    """States to predict from, north, east, down and forward, right, down.

    Parameters
    ----------
    name
        Of the flight.
    step_s
        Between samples.
    motors
        In the order of the file, shape ``(motors, steps + 1, starts)``: at the start and after each step.
    position, velocity, attitude, rates
        At the start: m, m/s, quaternion w, x, y, z from body to earth, rad/s; shape ``(rows, starts)``. In flights to
        learn from all samples, shape ``(rows, n)``, and so the motors.
    """

    name: str
    step_s: float
    motors: FloatArray
    position: FloatArray
    velocity: FloatArray
    attitude: FloatArray
    rates: FloatArray


Task: TypeAlias = LoadsTask | StepsTask
Function: TypeAlias = Callable[[Any, tuple[Any, ...]], Any]
_SAY = "add --predictions FILE.csv or MODULE:FUNCTION"


class Foreign(NamedTuple):
    """Where predictions come from.

    Parameters
    ----------
    label
        What the table calls them.
    source
        In words.
    path
        Of a file; ``None`` for a function.
    function
        That makes them; ``None`` for a file.
    """

    label: str
    source: str
    path: Path | None
    function: Function | None


def foreign_predictions(text: str, label: str | None = None) -> Foreign:
    """A file of predictions, or a function by ``module:function``, loaded and not yet called.

    Raises
    ------
    UsageError
        There is no such file, module or function.
    """
    module, colon, name = text.rpartition(":")
    if colon and module.replace(".", "").isidentifier() and name.isidentifier():
        return Foreign(label or name, f"Python function {name} of {module}", None, _function(module, name))
    path = Path(text)
    if path.suffix.lower() != ".csv":
        raise UsageError(f"--predictions {text!r} is no CSV file and no function", remedy=_SAY)
    try:
        require_file(path)
        if path.is_dir():
            raise UsageError(f"{text!r} is a folder", needed="a CSV file of predictions")
    except (LogError, OSError) as error:
        came = error.came if isinstance(error, LogError) else f"{text!r} cannot be read: {error.strerror or error}"
        raise UsageError(came, needed="a CSV file of predictions", remedy=_SAY) from error
    return Foreign(label or path.stem, f"predictions in {path.name}", path, None)


def _function(module: str, name: str) -> Function:
    with _working_folder():
        try:
            loaded = import_module(module)
        # A module of somebody else's may raise anything.
        except Exception as error:
            raise UsageError(
                f"the module {module!r} cannot be imported ({_words(error)})",
                needed="a module in the working folder or an installed one",
                remedy=_SAY,
            ) from error
    found = getattr(loaded, name, None)
    if not callable(found):
        there = [each for each in vars(loaded) if callable(getattr(loaded, each)) and not each.startswith("_")]
        raise UsageError(
            f"the module {module!r} has no function {name!r}",
            needed=f"one of {listed(there[:8])}" if there else "",
            remedy=_SAY,
        )
    return found  # type: ignore[no-any-return]


@contextmanager
def _working_folder() -> Iterator[None]:
    """Modules of the working folder can be imported, as ``python -m`` would."""
    sys.path.insert(0, str(Path.cwd()))
    try:
        yield
    finally:
        sys.path.pop(0)


def _words(error: Exception) -> str:
    return cut(" ".join(f"{type(error).__name__}: {error}".split()), 160)


def called(foreign: Foreign, task: Task, training: Sequence[Task], shape: tuple[int, ...]) -> FloatArray:
    """What a function predicts of a flight, of the wanted shape and finite.

    Raises
    ------
    UsageError
        It raised, or its answer has another shape or has a cell that is no number.
    """
    assert foreign.function is not None
    try:
        answer = np.asarray(foreign.function(task, tuple(training)), dtype=np.float64)
    except RotoridError:
        raise
    # So may its function.
    except Exception as error:
        raise UsageError(
            f"{foreign.label} failed on {task.name} ({_words(error)})", needed=f"an array of shape {shape}"
        ) from error
    if answer.shape != shape:
        raise UsageError(f"{foreign.label} gave an array of shape {answer.shape} for {task.name}", needed=f"{shape}")
    if not np.isfinite(answer).all():
        count = int((~np.isfinite(answer)).sum())
        raise UsageError(
            f"{foreign.label} gave {count} values for {task.name} that are no numbers", needed="finite ones"
        )
    return answer


def table_of(path: Path, columns: Sequence[str], rows: Sequence[tuple[str, int]]) -> list[FloatArray]:
    """Columns of a CSV file for each flight, shape ``(columns, rows of the flight)``, in the order of ``rows``.

    Parameters
    ----------
    columns
        Names in the header, without units.
    rows
        Flight and how many rows it must have. With a column ``flight`` the order in the file is free.

    Raises
    ------
    UsageError
        A column is missing, a flight has another number of rows, or a value is no finite number.
    """
    names = _header(path)
    missing = [name for name in columns if name not in names]
    if missing:
        shown = listed(missing[:4]) + (f" and {len(missing) - 4} more" if len(missing) > 4 else "")
        raise UsageError(f"{path.name} has no column {shown}", needed=f"{_first_and_last(columns)} in its header")
    values = _numbers(path, [names.index(name) for name in columns], columns)
    if "flight" not in names:
        total = sum(count for _, count in rows)
        if values.shape[1] != total:
            each = listed([f"{count} of {name}" for name, count in rows])
            raise UsageError(f"{path.name} has {values.shape[1]} rows", needed=f"{total}: {each}")
        edges = np.cumsum([0, *(count for _, count in rows)])
        return [values[:, first:last] for first, last in pairwise(edges)]
    flights = np.char.strip(_cells(path, [names.index("flight")], str)[0])
    found = []
    for name, count in rows:
        own = values[:, flights == name]
        if own.shape[1] != count:
            raise UsageError(f"{path.name} has {own.shape[1]} rows of {name}", needed=str(count))
        found.append(own)
    return found


def _header(path: Path) -> list[str]:
    with path.open(encoding="utf-8-sig", newline="", errors="replace") as file:
        try:
            cells = next(csv.reader(file), [])
        except csv.Error as error:
            raise UsageError(
                f"{path.name} has no header ({_words(error)})", needed="names in its first line"
            ) from error
    return [cell.partition("[")[0].strip() for cell in cells]


def _first_and_last(columns: Sequence[str]) -> str:
    return listed(columns) if len(columns) <= 8 else f"{columns[0]}, {columns[1]}, …, {columns[-1]}"


def _cells(path: Path, places: Sequence[int], kind: type[Any]) -> AnyArray:
    """Columns behind the header, shape ``(columns, rows)``; cells may be in quotes."""
    # Given a name, NumPy unpacks by its ending, whatever the file holds.
    with path.open(encoding="utf-8") as text, warnings.catch_warnings():
        # Of a file without rows; their number is looked at.
        warnings.filterwarnings("ignore", "loadtxt: input contained no data", UserWarning)
        return np.loadtxt(text, kind, delimiter=",", skiprows=1, usecols=places, ndmin=2, quotechar='"').T


def _numbers(path: Path, places: Sequence[int], columns: Sequence[str]) -> FloatArray:
    try:
        values = _cells(path, places, float)
    except (ValueError, IndexError, UnicodeDecodeError) as error:
        raise UsageError(
            f"{path.name} has a cell that is no number ({_words(error)})", needed="a number in each cell"
        ) from error
    wrong = np.argwhere(~np.isfinite(values))
    if wrong.size:
        column, row = wrong[0]
        raise UsageError(
            f"{path.name} has no number in column {columns[column]} of row {row + 2}",
            needed="a finite number in each cell",
        )
    return np.asarray(values, dtype=np.float64)
