"""The table of guards can be applied: each text stands once in its file, what takes its place parses, tests are there.

Whether the tests miss a guard is tried by ``python -m tests.mutations``; all rows are tried by ``make study``.
"""

from __future__ import annotations

import ast

import pytest
from tests.mutations import ROOT, TABLE, Mutation, kills, mutated

NAMES = [mutation.name for mutation in TABLE]


def test_names_are_unique() -> None:
    assert len(set(NAMES)) == len(NAMES)


@pytest.mark.parametrize("mutation", TABLE, ids=NAMES)
def test_a_guard_can_be_taken_out(mutation: Mutation) -> None:
    ast.parse(mutated(mutation))
    for path in mutation.paths:
        file, _, name = path.partition("::")
        assert f"def {name}" in (ROOT / file).read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("mutation", TABLE, ids=NAMES)
def test_a_guard_that_is_taken_out_is_missed(mutation: Mutation) -> None:
    assert kills(mutation)
