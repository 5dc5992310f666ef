"""What a verb answers to the same question on the same log is computed once, however many commands ask for it.

Tests of files, streams and exit codes run a command anew; its numbers are those of the first that asked. A module asks
for this by the fixture ``computed_once``, and never one that looks at whether the same command answers the same twice.
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from rotorid.data.record import FlightRecord

VERBS = (
    "rotorid.flying.designs.design",
    "rotorid.identifying.comparison.compare",
    "rotorid.identifying.delays.delay",
    "rotorid.identifying.identification.identify",
    "rotorid.identifying.identify_many.identify_several",
    "rotorid.identifying.tracking.track",
    "rotorid.identifying.verification.verify",
    "rotorid.loops.responses.response",
    "rotorid.proposing.proposal.tune",
    "rotorid.reviewing.assembly.review",
    "rotorid.reviewing.inspection.inspect",
)
READ = "rotorid.io.registry.read"

_keeping = False
_answers: dict[Hashable, Any] = {}
_records: dict[Hashable, FlightRecord] = {}


@contextmanager
def computed_once() -> Iterator[None]:
    """All verbs, and the reading of tables, answer from what was computed before."""
    with pytest.MonkeyPatch.context() as patch:
        for name in (READ, *VERBS):
            module, _, verb = name.rpartition(".")
            place = import_module(module)
            patch.setattr(place, verb, (_read if name == READ else _kept)(getattr(place, verb)))
        # A module of the program that is imported now keeps what it found here.
        patch.setattr("tests.unit.cli.once._keeping", True)
        yield


def _read(function: Callable[..., FlightRecord]) -> Callable[..., FlightRecord]:
    @wraps(function)
    def read(path: Any, **options: Any) -> FlightRecord:
        file = Path(path)
        alone = options.get("mapping") is None and file.suffix == ".csv" and file.is_file()
        if not (_keeping and alone):
            return function(path, **options)
        key = file.name, hashlib.sha256(file.read_bytes()).digest()
        if key not in _records:
            _records[key] = function(path, **options)
        return _records[key]

    return read


def _kept(function: Callable[..., Any]) -> Callable[..., Any]:
    @wraps(function)
    def verb(*arguments: Any, **options: Any) -> Any:
        if not _keeping:
            return function(*arguments, **options)
        try:
            key = function.__qualname__, _by_value((arguments, options))
        except (pickle.PicklingError, AttributeError, TypeError):
            return function(*arguments, **options)
        if key not in _answers:
            _answers[key] = function(*arguments, **options)
        return _answers[key]

    return verb


class _Question(pickle.Pickler):
    """Writes what is equal for equal questions only."""

    def persistent_id(self, value: Any) -> int | None:
        """Logs that were read are the same while they are the same object."""
        if isinstance(value, Path):
            # What lies there may be another file tomorrow.
            raise pickle.PicklingError(str(value))
        return id(value) if any(value is record for record in _records.values()) else None


def _by_value(asked: object) -> bytes:
    text = io.BytesIO()
    _Question(text).dump(asked)
    return hashlib.sha256(text.getvalue()).digest()
