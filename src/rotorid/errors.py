"""What can go wrong, as one small tree.

Every error carries three sentences as attributes: what came, what was needed, what to do about it. Wrong use and
unreadable files end a command with exit code 2; data that cannot answer the question end it with exit code 1 and the
findings that say why.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rotorid.data.findings import Finding


class RotoridError(Exception):
    """Base of every error that rotorid raises on purpose."""

    exit_code = 2
    #: What stands before the part of the sentence that says what would have been right.
    before_needed = "expected"

    def __init__(self, came: str, *, needed: str = "", remedy: str = "") -> None:
        self.came = came
        self.needed = needed
        self.remedy = remedy
        sentence = "; ".join(part.rstrip(".") for part in (came, self.expectation, remedy) if part)
        super().__init__(sentence if sentence.endswith("?") else f"{sentence}.")

    @property
    def expectation(self) -> str:
        """The part of the sentence that says what would have been right; empty where nothing was named."""
        return f"{self.before_needed} {self.needed}" if self.needed else ""


class UsageError(RotoridError):
    """The call was wrong: an unknown name, an impossible option, a value out of range."""


class LogError(RotoridError):
    """A file cannot be read as a flight log: foreign, damaged, empty or missing."""


class ModelError(RotoridError):
    """A model description is wrong: an unknown parameter, a wrong shape, a loop of ties."""


class InsufficientDataError(RotoridError):
    """The log was read, and its data cannot support what was asked. Carries the findings that say why."""

    exit_code = 1
    before_needed = "this needs"

    def __init__(self, came: str, *, needed: str = "", remedy: str = "", findings: Sequence[Finding] = ()) -> None:
        super().__init__(came, needed=needed, remedy=remedy)
        self.findings = tuple(findings)
