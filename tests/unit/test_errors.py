"""Sentences of errors: one line that does nothing to a terminal, whoever wrote the words in it."""

from __future__ import annotations

import pytest

from rotorid.errors import InsufficientDataError, LogError, ModelError, RotoridError, UsageError, unknown_name

KINDS = (RotoridError, UsageError, LogError, ModelError, InsufficientDataError)
FOREIGN = {
    "escape": ("a\x1b[2Jb", r"a\x1b[2Jb"),
    "direction of writing": ("a\u202eb", r"a\u202eb"),
    "end of a line": ("a\nb", "a b"),
    "end of a paragraph": ("a\u2029b", r"a\u2029b"),
    "control of Latin-1": ("a\x9b2Jb", r"a\x9b2Jb"),
    "byte that is no text": ("a\udcffb", r"a\xffb"),
    "nothing of that": ("größe 1", "größe 1"),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("text", "shown"), FOREIGN.values(), ids=FOREIGN.keys())
def test_words_of_others_are_shown_and_do_nothing(kind: type[RotoridError], text: str, shown: str) -> None:
    error = kind(f"unknown {text}", needed=f"not {text}", remedy=f"remove {text}")
    assert (error.came, error.needed, error.remedy) == (f"unknown {shown}", f"not {shown}", f"remove {shown}")
    assert str(error) == f"unknown {shown}; {error.expectation}; remove {shown}."
    assert error.reason.lower() == f"unknown {shown}; {error.expectation}.".lower()


def test_a_name_that_was_wrapped_twice_reads_as_once() -> None:
    inner = unknown_name("axis", "rol\x1bl", ["yaw"])
    outer = UsageError(f"flight.csv: {inner.came}", needed=inner.needed, remedy=inner.remedy)
    assert outer.came == r"flight.csv: unknown axis 'rol\x1bl'"
