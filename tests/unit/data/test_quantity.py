"""A number with its uncertainty is written by one rule."""

from __future__ import annotations

import ast
import math
import re
from pathlib import Path

import pytest
from tests.sources import nodes

import rotorid
from rotorid.data.quantity import beyond, error_columns, rounded_ends, with_ends, with_error, with_half, with_interval

SOURCE = Path(rotorid.__file__).parent
RULE = SOURCE / "data" / "quantity.py"
OWN_DIGITS = re.compile(r"± %[.\d]*[fg]")


@pytest.mark.parametrize(
    ("std", "shown"),
    [
        (0.9, "12.3 ± 0.9"),
        (0.31, "12.3 ± 0.3"),
        (0.2999, "12.35 ± 0.30"),
        (0.1, "12.35 ± 0.10"),
        (30.0, "10 ± 30"),
        (26.0, "12 ± 26"),
        (math.nan, "12.35"),
        (math.inf, "12.35"),
        (0.0, "12.35"),
    ],
)
def test_an_uncertainty_keeps_one_digit_or_two_where_it_begins_with_one_or_two(std: float, shown: str) -> None:
    assert with_error(12.346, std) == shown
    assert " ± ".join(part for part in error_columns(12.346, std) if part) == shown


def test_ends_of_an_interval_end_at_the_same_digit() -> None:
    assert with_interval(12.346, 12.0, 12.6) == ("12.3", "12.0 to 12.6")
    assert with_half(12.346, 12.0, 12.69, "ms") == "12.3 ± 0.3 ms"
    assert with_half(12.346, 12.0, 15.0, "ms") == with_ends(12.346, 12.0, 15.0, "ms") == "12.3 ms (12.0 to 15.0 ms)"
    assert with_ends(12.346, None, None, "ms") == "12.3 ms"
    assert (with_ends(127.3, 96.0, 158.0), with_half(127.3, 96.0, 158.0)) == ("130 (100 to 160)", "130 ± 30")
    assert rounded_ends(127.3, 96.0, 158.0) == (100.0, 160.0)


def test_a_number_beyond_its_limit_is_printed_beyond_it() -> None:
    assert (beyond(20.04, 20.0), beyond(25.0, 20.0)) == ("20.04", "25")


def test_no_module_rounds_an_uncertainty_by_a_rule_of_its_own() -> None:
    own = {
        f"{path.relative_to(SOURCE)}:{line}" for path in SOURCE.rglob("*.py") if path != RULE for line in _rounded(path)
    }
    own |= {
        f"{path.relative_to(SOURCE)}" for path in SOURCE.rglob("*.html") if OWN_DIGITS.search(path.read_text("utf-8"))
    }
    assert not own, f"rotorid.data.quantity writes numbers with their errors: {sorted(own)}"


def _rounded(path: Path) -> list[int]:
    """Lines of texts in which a number with digits of its own follows ±."""
    found = []
    for node in nodes(path):
        if isinstance(node, ast.JoinedStr):
            for before, after in zip(node.values, node.values[1:], strict=False):
                if (
                    isinstance(before, ast.Constant)
                    and str(before.value).endswith("± ")
                    and isinstance(after, ast.FormattedValue)
                    and after.format_spec is not None
                    and "." in ast.unparse(after.format_spec)
                ):
                    found.append(node.lineno)
    return found
